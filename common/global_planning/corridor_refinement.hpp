#pragma once

#include <cstdint>
#include <functional>
#include <optional>
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
/// (FlightEnvelope::is_turn_allowed). Stations and grids become finer from sweep to sweep; the
/// first sweeps look at two heights only. After some of them the line gets the lowest profile along
/// its own track where that is cheaper; at the end its waypoints move for themselves. A result
/// counts only if every leg passes FlightEnvelope::is_clear and the whole costs less than before,
/// integrated at steps of 1 m: the route never gets worse. Where the whole cannot be joined,
/// because a corner is too sharp for equal stations, pieces of it are tried. Legs are evaluated by
/// several threads; the result does not depend on their number.
///
/// Each evaluated leg adds 1 to `work_units`; no sweep begins that might exceed `work_budget`.
void refine(const FlightEnvelope& envelope, std::int64_t work_budget, std::int64_t& work_units,
            std::vector<flight::Waypoint>& waypoints, const OnRefined& on_refined);

/// The grid of places around each station of a corridor.
struct CorridorGrid {
  double station_m;  // between stations
  double aside_m;    // between neighbouring places
  double height_m;   // between neighbouring heights
  // Two heights, that of the line above the floor and a step higher, in place of five: a sixth of
  // the time, for lines that get another profile afterwards.
  bool has_few_heights = false;
};

/// One step of refine() for a line that need not be a route: the cheapest polyline through one
/// place of each station around `base`, ends fixed, all of whose legs are clear. Empty if none was
/// found.
///
/// @param before, after  where legs that join it at its ends come from and go to, for the turns
///                       there; may be missing.
std::vector<flight::Waypoint> corridor_route(const FlightEnvelope& envelope,
                                             const std::vector<flight::Waypoint>& base,
                                             const CorridorGrid& grid,
                                             const std::optional<flight::Waypoint>& before,
                                             const std::optional<flight::Waypoint>& after,
                                             std::int64_t& work_units);

/// One sweep of refine() over a route of this cost: the whole of it, or where that cannot be joined
/// pieces. Returns what it costs then (steps of 1 m), never more.
double sweep_corridor(const FlightEnvelope& envelope, const CorridorGrid& grid,
                      std::int64_t work_budget, std::int64_t& work_units,
                      std::vector<flight::Waypoint>& waypoints, double cost_m);

}  // namespace hedgehop::global_planning
