#pragma once

#include <functional>
#include <string>
#include <variant>

#include "messages/plan_messages.hpp"
#include "planning/planning.hpp"
#include "planning/roadmap_store.hpp"
#include "services/shared/config_memory.hpp"
#include "services/shared/planner_desk.hpp"

namespace hedgehop::services {

/// What makes routes: planning::plan_route, or one of one's own with the same rules: a function of
/// its arguments alone that looks at the observer now and then.
using RoutePlanner = std::function<std::variant<flight::RoutePlan, flight::NoPlan>(
    const map::Map& map, const flight::PlanRequest& request, const planning::PlanningConfig& config,
    const global_planning::OnProgress& on_progress, Observer& observer)>;

/// Turns PLAN_REQUEST into ROUTE, on the map that is on the bus and under the config that comes
/// with the request. `name` stands in the header of each route.
class GlobalPlannerService {
 public:
  using Options = PlannerOptions;
  static Options read_options(ConfigReader reader) {
    return read_planner_options(std::move(reader));
  }

  GlobalPlannerService(const PlannerOptions& options, bus::Bus& bus, bus::BlobExchange& exchange,
                       bus::ServiceLoop& loop, RoutePlanner planner = planning::RoadmapKeeper(),
                       std::string name = bus::provenance_of("global_planner"));

  void tick(Time now) { desk_.tick(now); }
  [[nodiscard]] std::string unanswered() const { return desk_.unanswered(); }

 private:
  std::variant<Answer, flight::NoPlan> plan(const messages::PlanRequestMessage& message, Time asked,
                                            const map::Map& map, const Bytes& config_blob,
                                            Observer& observer);

  bus::Bus& bus_;
  bus::BlobExchange& exchange_;
  RoutePlanner planner_;
  std::string name_;
  PlannerDesk desk_;
  ConfigMemory config_;
};

}  // namespace hedgehop::services
