#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "geo/map_projection.hpp"

namespace hedgehop::flight {

/// One demand that a trajectory breaks.
struct Violation {
  std::string rule;  // "clearance", "bank", "roll_rate", "climb_rate", "continuity_position", ...
  double time_s = 0.0;  // since the start
  geo::MapPoint place;
  double value = 0.0;  // what was found, in the unit of the rule (SI, radians)
  double limit = 0.0;  // what was demanded
};

/// Result of the independent check of a trajectory.
struct Verdict {
  bool is_verified = false;
  std::int64_t violation_count = 0;
  std::vector<Violation> violations;  // the worst of each rule first; at most 100 are kept
  double clearance_min_m = 0.0;       // over the continuous path above the interpolated surface
  geo::MapPoint clearance_min_place;
  double bank_max_rad = 0.0;
  double roll_rate_max_radps = 0.0;
  double climb_rate_max_mps = 0.0;
  double descent_rate_max_mps = 0.0;
  double speed_min_mps = 0.0;
  double speed_max_mps = 0.0;
  double share_under_ceiling = 0.0;  // of the horizontal length, in [0, 1]
  double goal_distance_m = 0.0;      // horizontal, of the last state
};

}  // namespace hedgehop::flight
