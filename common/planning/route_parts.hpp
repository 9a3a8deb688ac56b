#pragma once

#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "planning/planning.hpp"

namespace hedgehop::planning {

/// Start, via points and goal of a request with their altitudes, or which of them cannot be meant.
std::variant<std::vector<flight::Waypoint>, flight::NoPlan> place_stops(
    const risk::CostModel& costs, const flight::PlanRequest& request, const PlanningConfig& config);

/// The leg between two neighbouring stops, counted from 0: its share of the work, its seed and, for
/// the first one, the heading that the request asks for: the route leaves within 12 degrees of it.
global_planning::RouteProblem leg_problem(const map::Map& map,
                                          const std::vector<flight::Waypoint>& stops,
                                          const flight::PlanRequest& request,
                                          const PlanningConfig& config, std::int64_t leg);

/// Joins a leg to a route that ends where it begins; sums what both cost.
void append_leg(flight::Route& route, const flight::Route& leg);

/// "12.3", and "LAT,LON" in degrees, for sentences.
std::string text_of(double value, int decimals);
std::string text_of(const geo::GeodeticPosition& position);

}  // namespace hedgehop::planning
