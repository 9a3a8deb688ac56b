#pragma once

#include <cstddef>
#include <vector>

#include "base/config_reader.hpp"
#include "flight/trajectory.hpp"
#include "map/map.hpp"

namespace hedgehop::output {

/// How far straight legs may stray from the flight that they stand for.
struct LegOptions {
  double lateral_tolerance_m = 0.0;   // > 0, horizontal
  double vertical_tolerance_m = 0.0;  // > 0
};
LegOptions read_leg_options(ConfigReader& reader);

/// A flight as few waypoints with straight legs between them.
struct StraightLegs {
  std::vector<std::size_t> states;  // of the trajectory that became waypoints, first and last too
  std::size_t added = 0;            // of these, what checking the legs against the map added
  double clearance_min_m = 0.0;     // of all legs above the interpolated surface
  double clearance_demanded_m = 0.0;
  double lateral_max_m = 0.0;  // what states stray from their leg
  double vertical_max_m = 0.0;
};

/// Leaves out states as long as those left out stay within the tolerances of the leg that replaces
/// them (Douglas and Peucker), then checks every leg as it would be flown, in a straight line of
/// map position and altitude: clearance above the interpolated surface in closed form, distance to
/// wires and obstacles not less than that clearance, hard areas not entered, nothing unknown below.
/// Where a leg does not hold, the state nearest to the place becomes a waypoint, until all do.
///
/// Corners are not rounded: what a vehicle does at a waypoint depends on its autopilot.
///
/// @throws UserError  exit code 4: the flight itself does not hold this clearance; names the place.
/// @throws DataError  fewer than 2 states.
/// @note  O(states) for each level of halving, and one sweep of the map for each leg tried.
StraightLegs straight_legs(const flight::Trajectory& trajectory, const map::Map& map,
                           double clearance_m, const LegOptions& options);

}  // namespace hedgehop::output
