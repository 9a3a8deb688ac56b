#pragma once

#include "base/config_reader.hpp"
#include "flight/plan_request.hpp"
#include "flight/route.hpp"
#include "flight/trajectory.hpp"
#include "flight/vehicle.hpp"
#include "flight/verdict.hpp"
#include "map/map.hpp"

namespace hedgehop::verification {

/// Section `verification` of the planning config: what a finished trajectory must hold.
struct Demands {
  double required_clearance_m = 0.0;  // above the interpolated surface, everywhere on the path
  double ceiling_height_m = 0.0;      // height under which a contour flight counts as low
  double share_under_ceiling_min = 0.0;
  double goal_radius_m = 0.0;
  double start_radius_m = 0.0;
};
Demands read_demands(ConfigReader& reader);

/// Checks a finished trajectory on its own terms: own interpolation, own geometry, own kinematics.
/// Shares no code with the planners.
flight::Verdict verify(const map::Map& map, const flight::Trajectory& trajectory,
                       const flight::Waypoint& start, const flight::Waypoint& goal,
                       const flight::Limits& limits, const Demands& demands);

}  // namespace hedgehop::verification
