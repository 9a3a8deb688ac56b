// The bus and its logs for Python. Messages cross as the bytes of LCM; each is checked here as in
// the services, so that Python neither sends nor gets what they would refuse.
#include <map>
#include <memory>
#include <pybind11/functional.h>
#include <pybind11/stl.h>

#include "base/errors.hpp"
#include "bus/bus.hpp"
#include "bus/event_log.hpp"
#include "bus/private_url.hpp"
#include "messages/channels.hpp"
#include "messages/message_error.hpp"
#include "native.hpp"

namespace py = pybind11;

namespace hedgehop::python {
namespace {

py::bytes bytes_of_message(const Bytes& bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

ByteView view_of(const py::bytes& bytes) { return bytes_of(std::string_view(bytes)); }

using Handler = std::function<void(const py::bytes&)>;

// What can be done with the messages of one channel.
struct ChannelActions {
  std::function<void(bus::Bus&, ByteView)> publish;
  std::function<void(bus::Bus&, Handler)> subscribe;
  std::function<void(ByteView)> check;
};

template <typename T>
void add_channel(std::map<std::string, ChannelActions, std::less<>>& table,
                 const messages::Channel<T>& channel) {
  table[std::string(channel.name)] = {
      [&channel](bus::Bus& bus, ByteView bytes) {
        messages::Stamp stamp;
        const T content = messages::from_message<T>(bytes, stamp);
        bus.publish(channel, content, stamp.time);
      },
      [&channel](bus::Bus& bus, Handler handler) {
        bus.subscribe<T>(channel, [handler = std::move(handler)](const T& content,
                                                                 const messages::Stamp& stamp) {
          const py::gil_scoped_acquire lock;
          handler(bytes_of_message(messages::to_message(content, stamp)));
        });
      },
      [](ByteView bytes) {
        messages::Stamp stamp;
        messages::from_message<T>(bytes, stamp);
      }};
}

const std::map<std::string, ChannelActions, std::less<>>& channels() {
  static const auto table = [] {
    std::map<std::string, ChannelActions, std::less<>> all;
    add_channel(all, messages::kMapIndexChannel);
    add_channel(all, messages::kMapPatchChannel);
    add_channel(all, messages::kMapPatchStateChannel);
    add_channel(all, messages::kChunkChannel);
    add_channel(all, messages::kChunkRequestChannel);
    add_channel(all, messages::kPlanRequestChannel);
    add_channel(all, messages::kPlanCancelChannel);
    add_channel(all, messages::kPlanStatusChannel);
    add_channel(all, messages::kRouteChannel);
    add_channel(all, messages::kTrajectoryChannel);
    add_channel(all, messages::kVehicleTargetChannel);
    add_channel(all, messages::kVehicleStateChannel);
    add_channel(all, messages::kLocalHistogramChannel);
    add_channel(all, messages::kServiceStatusChannel);
    HEDGEHOP_ASSERT(all.size() == messages::kChannelTypes.size());
    return all;
  }();
  return table;
}

const ChannelActions& actions_of(const std::string& channel) {
  const auto found = channels().find(channel);
  if (found == channels().end()) {
    throw UsageError("there is no channel '" + channel + "'",
                     "hedgehop.CHANNELS lists them; a prefix is given to the Bus");
  }
  return found->second;
}

}  // namespace

void add_bus(py::module_& module) {
  py::dict types;
  for (const messages::ChannelType& channel : messages::kChannelTypes) {
    types[py::str(std::string(channel.channel))] = py::str(std::string(channel.type));
  }
  module.attr("CHANNELS") = types;

  py::class_<bus::Bus, std::shared_ptr<bus::Bus>>(module, "Bus")
      .def(py::init([](const std::string& url, const std::string& channel_prefix) {
             return std::make_shared<bus::Bus>(
                 bus::BusOptions{.url = url, .channel_prefix = channel_prefix});
           }),
           py::arg("url") = "", py::arg("channel_prefix") = "")
      .def("publish",
           [](bus::Bus& bus, const std::string& channel, const py::bytes& message) {
             actions_of(channel).publish(bus, view_of(message));
           })
      .def("subscribe",
           [](bus::Bus& bus, const std::string& channel, Handler handler) {
             actions_of(channel).subscribe(bus, std::move(handler));
           })
      .def(
          "poll",
          [](bus::Bus& bus, double timeout_s) {
            int count = 0;
            {
              const py::gil_scoped_release released;
              count = bus.poll(timeout_s);
            }
            if (PyErr_CheckSignals() != 0) {
              throw py::error_already_set();
            }
            return count;
          },
          py::arg("timeout_s"))
      .def_property_readonly("url", &bus::Bus::url)
      .def_property_readonly("utime", [](const bus::Bus& bus) { return bus.now().utime_us; })
      .def_property_readonly("is_finished", &bus::Bus::is_finished)
      .def_property_readonly("counters", [](const bus::Bus& bus) {
        const bus::BusCounters counters = bus.counters();
        py::dict result;
        result["published"] = counters.published;
        result["received"] = counters.received;
        result["rejected"] = counters.rejected;
        result["gaps"] = counters.gaps;
        result["dropped_packets"] = counters.dropped_packets;
        return result;
      });

  module.def("check_message", [](const std::string& channel, const py::bytes& message) {
    actions_of(channel).check(view_of(message));
  });
  module.def("private_url", &bus::private_url);

  py::class_<bus::EventLogReader>(module, "LogReader")
      .def(py::init([](const std::string& file) { return bus::EventLogReader(file); }))
      .def("next",
           [](bus::EventLogReader& reader) -> py::object {
             const auto event = reader.next();
             if (!event) {
               return py::none();
             }
             return py::make_tuple(event->number, event->receive_time.utime_us, event->channel,
                                   bytes_of_message(event->bytes));
           })
      .def_property_readonly("skipped_bytes", &bus::EventLogReader::skipped_bytes);
}

}  // namespace hedgehop::python
