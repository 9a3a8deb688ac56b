#pragma once

#include <optional>
#include <string>
#include <variant>

#include "lockstep_model.hpp"
#include "messages/plan_messages.hpp"
#include "services/shared/config_memory.hpp"
#include "services/shared/planner_desk.hpp"

namespace hedgehop::services {

/// config/local_planner.yaml
struct LocalPlannerOptions : PlannerOptions {
  double histogram_rate_hz = 0.0;  // of LOCAL_HISTOGRAM while a flight is planned; 0: none
};

/// Turns ROUTE into TRAJECTORY with planning::plan_flight, on the map that is on the bus. The
/// route's blob holds request and config, so that a map and a route are all it needs. In lockstep
/// the command model that is on the bus is flown instead of one in this process; the trajectory is
/// the same. If asked to, it shows on LOCAL_HISTOGRAM what its decisions are made by.
class LocalPlannerService {
 public:
  using Options = LocalPlannerOptions;
  static Options read_options(ConfigReader reader);

  LocalPlannerService(const LocalPlannerOptions& options, bus::Bus& bus,
                      bus::BlobExchange& exchange, bus::ServiceLoop& loop,
                      bool is_lockstep = false);

  void tick(Time now) { desk_.tick(now); }
  [[nodiscard]] std::string unanswered() const { return desk_.unanswered(); }

 private:
  std::variant<Answer, flight::NoPlan> plan(const messages::RouteHeader& route, Time asked,
                                            const map::Map& map, const Bytes& route_blob,
                                            Observer& observer);

  [[nodiscard]] local_planning::DecisionWatch watch_of(const Hash128& request_id);

  double histogram_rate_hz_;
  bus::Bus& bus_;
  bus::BlobExchange& exchange_;
  PlannerDesk desk_;
  ConfigMemory config_;
  std::optional<LockstepModel> lockstep_;
};

}  // namespace hedgehop::services
