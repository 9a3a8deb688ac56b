#include "flight_logger_service.hpp"

#include <algorithm>

#include "base/errors.hpp"
#include "messages/message_error.hpp"

namespace hedgehop::services {

using messages::Stamp;

FlightLoggerOptions read_flight_logger_options(ConfigReader reader) {
  FlightLoggerOptions options;
  options.tick_period_s = reader.required_double("tick_period_s");
  options.flush_interval_s = reader.required_double("flush_interval_s");
  options.part_bytes_max = reader.required_integer("part_bytes_max");
  options.is_completing_blobs = reader.required_bool("is_completing_blobs");
  options.is_overwriting = reader.required_bool("is_overwriting");
  reader.finish();
  reader.require(options.tick_period_s >= 0.001 && options.tick_period_s <= 1.0, "tick_period_s",
                 "must lie between 0.001 and 1");
  reader.require(options.flush_interval_s >= 0.01 && options.flush_interval_s <= 60.0,
                 "flush_interval_s", "must lie between 0.01 and 60");
  reader.require(options.part_bytes_max == 0 || options.part_bytes_max >= 65536, "part_bytes_max",
                 "must be 0 or at least 65536");
  return options;
}

std::filesystem::path log_file(const bus::ServiceArguments& arguments) {
  const std::string file = arguments.value("--out");
  if (file.empty()) {
    throw UsageError("no log file given", "--out FILE, a file that does not exist yet");
  }
  return file;
}

FlightLoggerService::FlightLoggerService(const FlightLoggerOptions& options,
                                         const std::filesystem::path& file, bus::Bus& bus,
                                         bus::BlobExchange& exchange, bus::ServiceLoop& loop)
    : options_(options),
      bus_(bus),
      log_(file, options.is_overwriting, options.flush_interval_s, options.part_bytes_max),
      exchange_(exchange),
      loop_(loop) {
  bus.subscribe_raw([this](const bus::RawMessage& message) {
    log_.write(message.receive_time, std::string(message.channel), message.bytes);
  });
  if (!options.is_completing_blobs) {
    return;
  }
  assembly_.emplace(exchange);
  bus.subscribe<messages::MapIndex>(messages::kMapIndexChannel,
                                    [this](const messages::MapIndex& index, const Stamp& stamp) {
                                      assembly_->receive(index, stamp.sender_id);
                                    });
  bus.subscribe<messages::PlanRequestMessage>(
      messages::kPlanRequestChannel,
      [this](const messages::PlanRequestMessage& request, const Stamp&) {
        assembly_->need(request.map_hash);
        complete(request.config, "config of a request");
      });
  bus.subscribe<messages::RouteHeader>(messages::kRouteChannel,
                                       [this](const messages::RouteHeader& route, const Stamp&) {
                                         assembly_->need(route.map_hash);
                                         complete(route.plan, "route");
                                       });
  bus.subscribe<messages::TrajectoryHeader>(
      messages::kTrajectoryChannel,
      [this](const messages::TrajectoryHeader& trajectory, const Stamp&) {
        assembly_->need(trajectory.map_hash);
        complete(trajectory.route, "route");
        complete(trajectory.plan, "trajectory");
      });
}

void FlightLoggerService::complete(const messages::BlobRef& blob, const char* what) {
  if (!wanted_.insert(blob.id).second) {
    return;
  }
  try {
    exchange_.want(blob, what);
  } catch (const messages::MessageError&) {  // no room: a recorder goes on recording
    wanted_.erase(blob.id);
  }
}

void FlightLoggerService::tick(Time now) {
  log_.flush_if_due(now);
  if (assembly_) {
    assembly_->tick();
  }
  if (now < next_text_) {
    return;
  }
  next_text_ = now + 1.0;
  std::string text = "recorded " + std::to_string(log_.event_count()) + " events, " +
                     std::to_string(log_.byte_count()) + " bytes";
  if (log_.part_count() > 1) {
    text += " in " + std::to_string(log_.part_count()) + " files";
  }
  if (log_.lost_count() > 0) {
    text += "; not recorded " + std::to_string(log_.lost_count());
  }
  for (const auto& [sender_id, missing] : bus_.counters().gaps_by_sender) {
    text += "; missed " + std::to_string(missing) + " of sender " + std::to_string(sender_id);
  }
  const bool is_failing = !log_.failure().empty();
  loop_.set_state(is_failing ? messages::ServiceState::kDegraded : messages::ServiceState::kReady,
                  is_failing ? log_.failure() + "; " + text : text);
}

}  // namespace hedgehop::services
