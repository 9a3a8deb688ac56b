#pragma once

#include <string>
#include <vector>

#include "flight/route.hpp"
#include "flight/trajectory.hpp"
#include "flight/vehicle.hpp"
#include "map/map.hpp"
#include "verification/verifier.hpp"

namespace hedgehop::evaluation {

/// How near a flight comes, at its samples, to what must not be met [m]; infinite beyond 300 m.
struct SampledDistances {
  double ground_m = 0.0;    // straight down to the surface
  double wire_m = 0.0;      // to the curtain below a conductor
  double obstacle_m = 0.0;  // to a cylinder
  double area_m = 0.0;      // to a hard area, 0 inside

  /// The least beyond what is demanded.
  [[nodiscard]] double spare_m(double required_m) const;
};

struct BruteForceVerdict {
  std::vector<std::string> broken;  // names as the verifier's where there is one; sorted
  SampledDistances distances;
  [[nodiscard]] bool accepts() const { return broken.empty(); }
};

/// Judges a flight in the plainest way: every `sample_m` along the cubic between two states it
/// looks down, around and into each area; limits at the states; whether places, heights, headings
/// and banks change roughly as speed, climb rate, bank and roll rate say (`kinematics`: within 0.5
/// m/s of speed, 0.3 m/s of climb, 0.05 rad/s of turn and 0.1 rad/s of roll); start, goal, via
/// points.
///
/// Shares no code with the verifier, knows nothing between the samples, and is slow.
BruteForceVerdict judge_by_brute_force(const map::Map& map, const flight::Trajectory& trajectory,
                                       const flight::Waypoint& start,
                                       const std::vector<geo::MapPoint>& via,
                                       const flight::Waypoint& goal, const flight::Limits& limits,
                                       const verification::Demands& demands, double sample_m);

}  // namespace hedgehop::evaluation
