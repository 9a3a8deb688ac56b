#pragma once

#include <string>
#include <vector>

#include "flight/route.hpp"
#include "map/map.hpp"
#include "verification/margins.hpp"

namespace hedgehop::verification {

/// A rule that a straight leg breaks, at its worst place.
struct LegViolation {
  std::string rule;  // as of verify(): clearance, wire_clearance, obstacle_clearance, no_fly_area,
                     // unknown_surface, outside_map
  std::size_t leg = 0;  // from 1 on
  flight::Waypoint place;
  double value = 0.0;  // NaN for what is unknown
  double limit = 0.0;
};

/// What lies around straight legs.
struct LegCheck {
  bool is_verified = false;
  std::vector<LegViolation> violations;  // one a leg and rule, in the order of the legs
  double length_m = 0.0;                 // horizontal
  double clearance_min_m = 0.0;          // above the interpolated surface; NaN if nothing is known
  std::vector<NearMiss> nearest;         // of each kind; their times are NaN
};

/// Checks legs as lines, straight in map position and altitude: clearance above the interpolated
/// surface, wires and obstacles in closed form; hard areas in pieces of at most a metre, each as a
/// whole, so that a corner that is missed by less may be claimed. There is no vehicle in this:
/// corners are sharp, climbs as steep as they are.
///
/// A waypoint that is not finite, or less than two of them, break the rule `states`.
LegCheck check_legs(const map::Map& map, const std::vector<flight::Waypoint>& waypoints,
                    double required_clearance_m);

}  // namespace hedgehop::verification
