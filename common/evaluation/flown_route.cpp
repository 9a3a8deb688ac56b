#include "evaluation/flown_route.hpp"

#include <cstdio>
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

std::string setting_of(const std::string& key, double value) {
  char number[40];
  std::snprintf(number, sizeof number, "%.10g", value);
  return key + "=" + number;
}

double value_of(const PlanningConfig& config, const std::string& key) {
  ConfigReader reader = ConfigReader::from_text(config.text, "base settings");
  std::size_t begin = 0;
  for (std::size_t end = key.find('.'); end != std::string::npos; end = key.find('.', begin)) {
    reader = reader.required_section(key.substr(begin, end - begin));
    begin = end + 1;
  }
  return reader.required_double(key.substr(begin));
}

namespace {

planning::RouteTask task_of(const PlanningConfig& config, const DrawnRoute& route) {
  planning::RouteTask task;
  task.start = route.start;
  task.goal = route.goal;
  task.guide = route.guide;
  task.held = {route.goal};
  task.speed_mps = config.speed_mps;
  task.initial = local_planning::state_at_start(task.guide, task.speed_mps, config.vehicle);
  return task;
}

std::optional<RouteFlight> flight_of(std::variant<RouteFlight, flight::NoPlan> answer,
                                     const Observer& observer) {
  observer.check_stop();
  auto* flight = std::get_if<RouteFlight>(&answer);
  return flight != nullptr ? std::optional(std::move(*flight)) : std::nullopt;
}

}  // namespace

std::optional<RouteFlight> flown(const risk::CostModel& costs, const PlanningConfig& calm,
                                 const DrawnRoute& route, const Observer& observer) {
  CrowdObserver crowd(observer);
  const PlanningConfig config = planning::in_wind(calm, costs.map().crs_wkt, route.start.point());
  return flight_of(planning::fly_route(costs, config, task_of(config, route), {}, crowd), observer);
}

std::optional<RouteFlight> flown(const planning::RouteGrounds& grounds, const PlanningConfig& calm,
                                 const DrawnRoute& route, const Observer& observer) {
  CrowdObserver crowd(observer);
  const PlanningConfig config =
      planning::in_wind(calm, grounds.costs().map().crs_wkt, route.start.point());
  return flight_of(planning::fly_route(grounds, config, task_of(config, route), crowd), observer);
}

}  // namespace hedgehop::evaluation
