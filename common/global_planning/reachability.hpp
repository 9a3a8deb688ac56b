#pragma once

#include <optional>

#include "geo/map_projection.hpp"
#include "global_planning/flight_envelope.hpp"

namespace hedgehop::global_planning {

/// Where the ground around the start comes nearest to the goal, if no route can exist.
struct Disconnection {
  geo::MapPoint nearest_to_goal;  // middle of the reachable patch nearest to the goal
  bool is_goal_enclosed = false;  // the part around the goal is the smaller one
  std::size_t reachable_patches = 0;
  const map::Area* area = nullptr;  // without hard areas they are connected; this one is in the way
};

/// Tries to prove that start and goal are not connected; nullopt when that is not proved.
///
/// The map is cut into the patches of bilinear interpolation, the squares between four cell
/// centres. Each is given all altitudes between the least floor and the greatest ceiling at its
/// corners (floors of the funnels included), and neighbouring patches, diagonal ones too, are
/// joined when these intervals meet. Patches that hard areas close as a whole are left out. Climb
/// angle and turns are left free: within a patch a route may gain any height. Every route that the
/// envelope admits also runs through these patches, so where they are not connected, no route is.
/// The reverse does not hold. O(cells); where they are connected, mostly O(cells between them).
std::optional<Disconnection> prove_disconnected(const FlightEnvelope& envelope);

}  // namespace hedgehop::global_planning
