#pragma once

#include <cstdint>
#include <vector>

#include "flight/route.hpp"
#include "global_planning/flight_envelope.hpp"

namespace hedgehop::global_planning {

/// Whether FlightEnvelope::is_turn_allowed holds at every corner of a route in plan view. Waypoints
/// on a straight run change the climb alone; what must hold the arc beside a corner is the run. If
/// the route begins at the start of the envelope, it must continue from there as it may.
bool are_turns_allowed(const FlightEnvelope& envelope,
                       const std::vector<flight::Waypoint>& waypoints);

/// Scans for shortcuts: legs between two waypoints that skip at least one other, are clear, turn no
/// more than allowed at both ends, and cost less than what they replace. Each waypoint is tried
/// with each later one, the greatest saving is taken, and the scan repeats until nothing is found.
/// Costs are integrated at `step_m`, so the sum never grows. Each leg tried adds 1 to `work_units`
/// and the scan ends when that reaches `work_budget`.
void cut_short(const FlightEnvelope& envelope, double step_m, std::int64_t work_budget,
               std::int64_t& work_units, std::vector<flight::Waypoint>& waypoints);

/// Points at equal distance along the polyline, first and last point included. The distance is
/// the one nearest to `spacing_m` that divides the length into whole parts; it is returned in
/// `actual_spacing_m`.
std::vector<flight::Waypoint> equidistant(const std::vector<flight::Waypoint>& waypoints,
                                          double spacing_m, double& actual_spacing_m);

}  // namespace hedgehop::global_planning
