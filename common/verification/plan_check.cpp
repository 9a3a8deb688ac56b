#include "verification/plan_check.hpp"

#include <algorithm>
#include <array>
#include <optional>
#include <utility>

#include "base/config_reader.hpp"
#include "base/errors.hpp"
#include "geo/map_projection.hpp"
#include "verification/figure_check.hpp"
#include "verification/findings.hpp"
#include "verification/trajectory_file_check.hpp"
#include "verification/verifier.hpp"

namespace hedgehop::verification {

PlanCheck check_plan(const map::Map& map, const flight::Plan& plan,
                     const std::string& trajectory_csv) {
  const flight::RoutePlan& route_plan = plan.route_plan;
  if (route_plan.map.hash != map.hash) {
    throw UsageError(
        "the plan was made on map " + route_plan.map.hash.hex() + ", not on map " + map.hash.hex(),
        "give the map that the plan was made on");
  }
  const std::string name = "config of the plan";
  ConfigReader config = ConfigReader::from_text(route_plan.config_text, name);
  ConfigReader demands_section = config.required_section("verification");
  Demands demands = read_demands(demands_section);
  ConfigReader vehicle = config.required_section("vehicle");
  ConfigReader limits_section = vehicle.required_section("limits");
  const flight::Limits limits = flight::read_limits(limits_section);
  if (config.has("conditions")) {  // plans of earlier versions have none
    ConfigReader section = config.required_section("conditions");
    const flight::Conditions conditions = flight::read_recorded_conditions(section);
    if (conditions.wind_mps > 0.0 && !map.crs_wkt.empty()) {
      const geo::MapProjection grid(map.crs_wkt);
      demands.wind = wind_of(conditions, grid.convergence_rad(route_plan.start.point()));
    }
    if (conditions.is_power_used) {
      ConfigReader power = vehicle.required_section("power");
      demands.power = PowerDemand{flight::read_power_curve(power), conditions};
    }
  }

  std::optional<geo::MapProjection> projection;
  std::vector<geo::MapPoint> via;
  if (!map.crs_wkt.empty()) {
    projection.emplace(map.crs_wkt);
    for (const flight::RequestPoint& point : route_plan.request.via) {
      via.push_back(projection->to_map(point.position));
    }
  }
  PlanCheck check;
  check.verdict =
      verify(map, plan.trajectory, route_plan.start, via, route_plan.goal, limits, demands);
  Findings findings;
  check_figures(map, plan, read_cost_rules(route_plan.config_text, name), via, demands,
                check.verdict, findings);
  check_trajectory_file(trajectory_csv, projection ? &*projection : nullptr, plan.trajectory.states,
                        findings);
  check.verdict.violation_count += findings.count();
  check.verdict.is_verified = check.verdict.violation_count == 0;
  for (flight::Violation& violation : findings.worst()) {
    check.verdict.violations.push_back(std::move(violation));
  }
  std::stable_sort(
      check.verdict.violations.begin(), check.verdict.violations.end(),
      [](const flight::Violation& a, const flight::Violation& b) { return a.rule < b.rule; });
  if (plan.trajectory.states.size() >= 2 && plan.trajectory.step_s > 0.0) {
    check.margins = measure_margins(map, plan.trajectory, via, limits, demands);
  }
  return check;
}

std::string_view unit_of(std::string_view rule) {
  using Entry = std::pair<std::string_view, std::string_view>;
  // Fields carry their unit at their end; the other rules are listed.
  constexpr std::array<Entry, 6> kEndings = {{{"_mps2", "m/s^2"},
                                              {"_radps", "rad/s"},
                                              {"_rad_m", "rad m"},
                                              {"_mps", "m/s"},
                                              {"_rad", "rad"},
                                              {"_m", "m"}}};
  constexpr std::array<Entry, 36> kRules = {{{"clearance", "m"},
                                             {"wire_clearance", "m"},
                                             {"obstacle_clearance", "m"},
                                             {"no_fly_area", "m"},
                                             {"bank", "rad"},
                                             {"roll_rate", "rad/s"},
                                             {"pitch", "rad"},
                                             {"climb_rate", "m/s"},
                                             {"descent_rate", "m/s"},
                                             {"climb_power", "m/s"},
                                             {"descent_power", "m/s"},
                                             {"vertical_acceleration", "m/s^2"},
                                             {"speed_min", "m/s"},
                                             {"speed_max", "m/s"},
                                             {"start", "m"},
                                             {"goal", "m"},
                                             {"via", "m"},
                                             {"timetable.via", "m"},
                                             {"surface_column", "m"},
                                             {"terrain_column", "m"},
                                             {"convergence_column", "rad"},
                                             {"position_columns", "m"},
                                             {"height_column", "m"},
                                             {"heading_grid_column", "rad"},
                                             {"time_step", "s"},
                                             {"measures.duration_s", "s"},
                                             {"continuity_position", "m"},
                                             {"continuity_altitude", "m"},
                                             {"continuity_heading", "rad"},
                                             {"continuity_bank", "rad"},
                                             {"continuity_pitch", "rad"},
                                             {"continuity_speed", "m/s"},
                                             {"continuity_climb_rate", "m/s"},
                                             {"continuity_roll_rate", "rad/s"},
                                             {"continuity_pitch_rate", "rad/s"},
                                             {"verification.clearance_min_place", "m"}}};
  for (const auto& [name, unit] : kRules) {
    if (rule == name) {
      return unit;
    }
  }
  if (rule == "request.start" || rule == "request.goal" || rule == "route.waypoints") {
    return "m";
  }
  for (const auto& [ending, unit] : kEndings) {
    if (rule.find('.') != std::string_view::npos && rule.size() > ending.size() &&
        rule.substr(rule.size() - ending.size()) == ending) {
      return unit;
    }
  }
  return "";
}

}  // namespace hedgehop::verification
