#pragma once

#include <optional>

#include "geo/map_projection.hpp"
#include "global_planning/flight_envelope.hpp"

namespace hedgehop::global_planning {

/// Where the ground around the start comes nearest to the goal, if no route can exist.
struct Disconnection {
  geo::MapPoint nearest_to_goal;  // reachable cell nearest to the goal
  bool is_goal_enclosed = false;  // the cells around the goal are the smaller part
  std::size_t reachable_cells = 0;
};

/// Tries to prove that start and goal are not connected; nullopt when that is not proved.
///
/// Each cell is given all altitudes between the least floor and the greatest ceiling over its area
/// (from the 3 x 3 cell centres that interpolation uses there; floors of the funnels included), and
/// neighbouring cells, diagonal ones too, are joined when these intervals meet. Climb angle and
/// turns are left free: within a cell a route may gain any height. Every route that the envelope
/// admits also runs through these cells, so where they are not connected, no route is. The reverse
/// does not hold. O(cells).
std::optional<Disconnection> prove_disconnected(const FlightEnvelope& envelope);

}  // namespace hedgehop::global_planning
