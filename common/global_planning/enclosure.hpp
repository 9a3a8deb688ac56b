#pragma once

#include <cstdint>
#include <optional>

#include "flight/route.hpp"
#include "geo/map_projection.hpp"
#include "global_planning/flight_envelope.hpp"

namespace hedgehop::global_planning {

/// Proof that no route leaves the surroundings of one end.
struct Enclosure {
  double reach_m = 0.0;  // no route gets farther from the end than this, in plan view
  std::int64_t states = 0;
};

/// Tries to prove that slope limits, turn limit and height envelope together hold every route that
/// ends at `end`, or begins there if that is the envelope's start, near it. nullopt when that is
/// not proved, and without a turn radius, as then a route may zigzag on the spot. The slopes are
/// those of `options`, at the lowest altitude that comes into question; in wind, for each sector of
/// headings the steepest of the courses that it may belong to, and the least radius of all turns.
///
/// Turn radius R and half legs that hold the tangents of every corner (FlightEnvelope::
/// is_turn_allowed) mean that a route, its corners rounded, is a curve of curvature 1 / R at most.
/// Each point of that curve belongs to a point of the route at most R (1 / cos(turn / 2) - 1) away,
/// and along the curve the altitude changes by at most tan(climb) tan(turn / 2) / (turn / 2) a
/// metre, or as much of the descent. The curve is followed from the end in steps of equal length.
/// Its states are (patch of the map, sector of heading, interval of altitudes); each step goes to
/// every state that some such curve could reach, if the bands near that patch admit its altitudes.
/// What cannot be reached that way, no route reaches. `other` must lie out of reach of one more
/// step.
///
/// Before that, and much sharper, the nearest surroundings are looked at for a hollow. A corner
/// turns by at most the leg before it divided by R, so a route that has flown s has turned by s / R
/// at most, got R sin(s / R) away at least, and flown R asin(r / R) at most where it is r away (up
/// to 0.9 R). That bounds its altitudes there; if no chain of small squares with such altitudes in
/// their bands leads out, no route does.
///
/// Gives up at `reach_max_m` from the end and after `work_max` steps between two states (15 ns
/// each).
std::optional<Enclosure> prove_enclosed(const FlightEnvelope& envelope,
                                        const GlobalOptions& options, const flight::Waypoint& end,
                                        const flight::Waypoint& other, double reach_max_m,
                                        std::int64_t work_max);

}  // namespace hedgehop::global_planning
