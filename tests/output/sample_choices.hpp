#pragma once

#include "flight/plan.hpp"
#include "flight/route_choice.hpp"

namespace hedgehop::test {

/// A plan's own route, the same moved 900 m north ("hidden") and 1500 m south ("short-cut").
inline flight::RouteChoices make_sample_choices(const flight::Plan& plan) {
  flight::RouteChoices choices;
  choices.shared_within_m = 300.0;
  choices.shared_share_max = 0.5;
  choices.why_no_more = "quiet: no <valley>";
  const auto add = [&](const char* name, double north_m, const flight::RouteMeasures& measures) {
    flight::RouteChoice choice;
    choice.name = name;
    choice.plan = plan.route_plan;
    for (flight::Waypoint& waypoint : choice.plan.route.waypoints) {
      waypoint.y_m += north_m;
    }
    choice.plan.route.cost.length_m += north_m;
    choice.measures = measures;
    choice.visibility_weight = 25.0;
    choice.semantics_weight = 4.0;
    choices.routes.push_back(choice);
  };
  add("main", 0.0, {12001.5, 321.125, 45.5});
  add("hidden", 900.0, {13001.5, 221.125, 55.5});
  add("short-cut", -1500.0, {11001.5, 421.125, 65.5});
  choices.shared = {{1.0, 0.375, 0.125}, {0.4375, 1.0, 0.1875}, {0.3125, 0.25, 1.0}};
  return choices;
}

}  // namespace hedgehop::test
