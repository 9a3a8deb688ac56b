#include "evaluation/flown_route.hpp"

#include <variant>

#include "evaluation/crowd_observer.hpp"

namespace hedgehop::evaluation {

using planning::PlanningConfig;
using planning::RouteFlight;

PlanningConfig config_with(const std::string& text, const std::vector<std::string>& settings) {
  std::string changed = text;
  for (const std::string& setting : settings) {
    changed = set_config_value(changed, setting);
  }
  return planning::read_planning_config(changed, "planning config with settings of an evaluation");
}

std::optional<RouteFlight> flown(const risk::CostModel& costs, const PlanningConfig& config,
                                 const DrawnRoute& route, const Observer& observer) {
  planning::RouteTask task;
  task.start = route.start;
  task.goal = route.goal;
  task.guide = route.guide;
  task.held = {route.goal};
  task.speed_mps = config.speed_mps;
  task.initial = local_planning::state_at_start(task.guide, task.speed_mps, config.vehicle.limits);
  CrowdObserver crowd(observer);
  auto answer = planning::fly_route(costs, config, task, {}, crowd);
  observer.check_stop();
  auto* flight = std::get_if<RouteFlight>(&answer);
  return flight != nullptr ? std::optional(std::move(*flight)) : std::nullopt;
}

}  // namespace hedgehop::evaluation
