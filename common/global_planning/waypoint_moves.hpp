#pragma once

#include <cstdint>
#include <vector>

#include "flight/route.hpp"
#include "global_planning/flight_envelope.hpp"

namespace hedgehop::global_planning {

/// Moves waypoints of a route as far as that pays: one, two or three neighbours at a time, along
/// and across the way and up and down, by 20 m at first and 2.5 m at last (a seventh of that in
/// height). Corridors place waypoints on grids; this is what lies between their places, half a per
/// cent of the cost and more.
///
/// A move counts only if its legs pass FlightEnvelope::is_clear, all turns stay allowed, and it is
/// cheaper, integrated at steps of 2.5 m; all of them together only if the route is cheaper at
/// steps of 1 m. So the route never gets worse. First and last waypoint stay.
///
/// Each leg looked at adds a tenth to `work_units`; no round begins that might exceed
/// `work_budget`. 40 to 80 ms for 20 km.
///
/// @return  cost of the route (steps of 1 m), of which `cost_m` is what it costs before.
double move_waypoints(const FlightEnvelope& envelope, std::int64_t work_budget,
                      std::int64_t& work_units, std::vector<flight::Waypoint>& waypoints,
                      double cost_m);

}  // namespace hedgehop::global_planning
