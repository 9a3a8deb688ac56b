#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "flight/route.hpp"
#include "global_planning/flight_envelope.hpp"

namespace hedgehop::global_planning {

/// What refinement is doing, for progress; true ends it with the best route so far.
using OnRefined = std::function<bool(double best_cost_m, std::int64_t work_units)>;

/// Moves a route sideways and up and down inside a corridor until that no longer pays.
///
/// The route is cut into stations of equal distance. At each there is a small grid of places, some
/// sideways and some higher or lower, the place of the route among them; dynamic programming finds
/// the cheapest polyline through one place of each station. Its state holds the place and the
/// sideways offset of the station before, so turns between legs are exact
/// (FlightEnvelope::is_turn_allowed). Stations and grids become finer from sweep to sweep. A result
/// counts only if every leg passes FlightEnvelope::is_clear and the whole costs less than before,
/// integrated at steps of 1 m: the route never gets worse. Where the whole cannot be joined,
/// because a corner is too sharp for equal stations, pieces of it are tried. Legs are evaluated by
/// several threads; the result does not depend on their number.
///
/// Each evaluated leg adds 1 to `work_units`; no sweep begins that might exceed `work_budget`.
void refine(const FlightEnvelope& envelope, std::int64_t work_budget, std::int64_t& work_units,
            std::vector<flight::Waypoint>& waypoints, const OnRefined& on_refined);

}  // namespace hedgehop::global_planning
