#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <unistd.h>
#include <vector>

#include "bus/blob_exchange.hpp"
#include "bus/bus.hpp"
#include "bus/service.hpp"
#include "messages/channels.hpp"
#include "messages/plan_blobs.hpp"
#include "services/command_model/command_model_service.hpp"
#include "services/flight_logger/flight_logger_service.hpp"
#include "services/global_planner/global_planner_service.hpp"
#include "services/local_planner/local_planner_service.hpp"
#include "services/map_tiler/map_tiler_service.hpp"
#include "services/shared/service_start.hpp"

namespace hedgehop::test {

/// One process on a memory bus.
struct Station {
  bus::Bus bus;
  bus::BlobExchange exchange;
  bus::ServiceLoop loop;
  std::function<void(Time)> tick = [](Time) {};

  Station(const std::string& url, const std::string& name)
      : bus({.url = url, .channel_prefix = {}}), exchange({}, bus), loop(bus, exchange, name, {}) {}
  void turn() { loop.turn(0.0, tick); }
};

/// A name for a memory bus that no other test uses.
inline std::string memory_url() {
  static int count = 0;
  return "memq://services-" + std::to_string(::getpid()) + "-" + std::to_string(++count);
}

/// The shipped options, but with a status at every chance: tests are over before a quarter second.
template <typename Service>
typename Service::Options frequent_planner_options(const std::string& name) {
  typename Service::Options options =
      Service::read_options(services::load_config("", name + ".yaml").reader());
  options.status_period_s = 0.02;
  return options;
}

/// Services on one memory bus in one thread, taking turns, and a listener that notes what is said.
class InProcessChain {
 public:
  InProcessChain() : listener_(url_, "listener") {
    listener_.bus.subscribe<messages::MapIndex>(
        messages::kMapIndexChannel,
        [this](const messages::MapIndex& message, const messages::Stamp&) { index = message; });
    listener_.bus.subscribe<messages::PlanStatus>(
        messages::kPlanStatusChannel,
        [this](const messages::PlanStatus& message, const messages::Stamp&) {
          statuses.push_back(message);
        });
    listener_.bus.subscribe<messages::RouteHeader>(
        messages::kRouteChannel,
        [this](const messages::RouteHeader& message, const messages::Stamp&) {
          routes.push_back(message);
          listener_.exchange.want(message.plan, "route");
        });
    listener_.bus.subscribe<messages::TrajectoryHeader>(
        messages::kTrajectoryChannel,
        [this](const messages::TrajectoryHeader& message, const messages::Stamp&) {
          trajectories.push_back(message);
          listener_.exchange.want(message.plan, "trajectory");
        });
    listener_.bus.subscribe<messages::MapPatch>(
        messages::kMapPatchChannel,
        [this](const messages::MapPatch& message, const messages::Stamp&) {
          if (message.patch_number > 0) {
            patches[message.patch.id] = message;
          }
        });
    listener_.bus.subscribe<messages::MapPatchState>(
        messages::kMapPatchStateChannel, [this](const messages::MapPatchState& message,
                                                const messages::Stamp&) { patch_state = message; });
    listener_.bus.subscribe<messages::VehicleState>(
        messages::kVehicleStateChannel,
        [this](const messages::VehicleState& message, const messages::Stamp&) {
          vehicle_states.push_back(message);
        });
  }

  void add_map_tiler(const map::Map& map, const std::filesystem::path& journal = {}) {
    Station& station = add("map_tiler");
    auto service = std::make_shared<services::MapTilerService>(
        services::read_map_tiler_options(services::load_config("", "map_tiler.yaml").reader()), map,
        station.bus, station.exchange, journal);
    station.tick = [service](Time now) { service->tick(now); };
  }
  services::GlobalPlannerService& add_global_planner() {
    return add_planner<services::GlobalPlannerService>("global_planner");
  }
  services::LocalPlannerService& add_local_planner() {
    return add_planner<services::LocalPlannerService>("local_planner");
  }
  static services::CommandModelOptions shipped_command_model() {
    return services::read_command_model_options(
        services::load_config("", "command_model.yaml").reader());
  }
  void add_command_model(const services::CommandModelOptions& options = shipped_command_model()) {
    Station& station = add("command_model");
    auto service = std::make_shared<services::CommandModelService>(
        options, station.bus, station.exchange, station.loop, services::shipped_rotor());
    station.tick = [service](Time now) { service->tick(now); };
  }
  void add_flight_logger(const std::filesystem::path& file) {
    Station& station = add("flight_logger");
    auto service = std::make_shared<services::FlightLoggerService>(
        services::read_flight_logger_options(
            services::load_config("", "flight_logger.yaml").reader()),
        file, station.bus, station.exchange, station.loop);
    station.tick = [service](Time now) { service->tick(now); };
  }

  /// Everybody once.
  void turn() {
    for (const auto& station : stations_) {
      station->turn();
    }
    listener_.turn();
  }
  /// True if `is_reached` became true within `timeout_s`.
  bool turn_until(const std::function<bool()>& is_reached, double timeout_s = 30.0) {
    const Time begin = listener_.bus.now();
    while (!is_reached() && seconds_between(begin, listener_.bus.now()) < timeout_s) {
      turn();
    }
    return is_reached();
  }

  /// Offers the config and publishes the request; the same again when called again.
  messages::PlanRequestMessage ask(const flight::PlanRequest& request, const Hash128& map_hash,
                                   const std::string& config_text) {
    messages::PlanRequestMessage message;
    message.request = request;
    message.map_hash = map_hash;
    message.request_id = flight::plan_request_id(request, map_hash, config_text);
    message.config = listener_.exchange.offer(messages::encode_planning_config(config_text), true);
    listener_.bus.publish(messages::kPlanRequestChannel, message, listener_.bus.now());
    return message;
  }

  [[nodiscard]] std::optional<messages::PlanStatus> newest_status(messages::PlanStage stage) const {
    for (auto status = statuses.rbegin(); status != statuses.rend(); ++status) {
      if (status->stage == stage) {
        return *status;
      }
    }
    return std::nullopt;
  }
  [[nodiscard]] bool is_global(messages::PlanState state) const {
    const auto status = newest_status(messages::PlanStage::kGlobal);
    return status && status->state == state;
  }
  [[nodiscard]] int count_of(messages::PlanStage stage, messages::PlanState state) const {
    int count = 0;
    for (const messages::PlanStatus& status : statuses) {
      count += status.stage == stage && status.state == state ? 1 : 0;
    }
    return count;
  }

  /// The plan behind the newest trajectory; nothing while its blobs are not complete.
  std::optional<flight::Plan> plan() {
    if (trajectories.empty()) {
      return std::nullopt;
    }
    const messages::TrajectoryHeader& header = trajectories.back();
    const Bytes* route = listener_.exchange.content(header.route.id);
    const Bytes* plan = listener_.exchange.content(header.plan.id);
    if (route == nullptr || plan == nullptr) {
      return std::nullopt;
    }
    return messages::decode_flight_plan(*plan, messages::decode_route_plan(*route),
                                        header.route.id);
  }

  [[nodiscard]] const std::string& url() const { return url_; }
  Station& listener() { return listener_; }
  /// Takes a service off the bus.
  void remove(std::size_t station) {
    stations_.erase(stations_.begin() + static_cast<long>(station));
  }

  std::optional<messages::MapIndex> index;
  std::map<std::int64_t, messages::MapPatch> patches;  // numbered ones
  std::optional<messages::MapPatchState> patch_state;
  std::vector<messages::PlanStatus> statuses;
  std::vector<messages::RouteHeader> routes;
  std::vector<messages::TrajectoryHeader> trajectories;
  std::vector<messages::VehicleState> vehicle_states;

 private:
  Station& add(const std::string& name) {
    stations_.push_back(std::make_unique<Station>(url_, name));
    return *stations_.back();
  }
  template <typename Service>
  Service& add_planner(const std::string& name) {
    Station& station = add(name);
    auto service = std::make_shared<Service>(frequent_planner_options<Service>(name), station.bus,
                                             station.exchange, station.loop);
    station.tick = [service](Time now) { service->tick(now); };
    return *service;
  }

  std::string url_ = memory_url();
  std::vector<std::unique_ptr<Station>> stations_;
  Station listener_;
};

}  // namespace hedgehop::test
