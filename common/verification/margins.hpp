#pragma once

#include <optional>
#include <string>
#include <vector>

#include "flight/trajectory.hpp"
#include "flight/vehicle.hpp"
#include "map/map.hpp"
#include "verification/verifier.hpp"

namespace hedgehop::verification {

/// What a flight may come near to.
enum class Hazard : std::uint8_t { kGround, kWire, kObstacle, kArea };
/// "ground" and so on.
const char* name_of(Hazard hazard);

/// Where a flight comes nearest to one kind of hazard. Never too far, too near by millimetres.
struct NearMiss {
  Hazard hazard = Hazard::kGround;
  std::string name;  // of the obstacle or area, may be empty; number of the line in its source
  double distance_m = 0.0;  // above the surface; else in space; 0 inside or below
  double required_m = 0.0;  // 0 for an area
  double time_s = 0.0;
  geo::MapPoint place;  // of the path; for all but the ground the state before the nearest place
  double altitude_m = 0.0;

  [[nodiscard]] double spare_m() const { return distance_m - required_m; }
};

/// How a flight passes a via point, seen from above.
struct ViaPass {
  double distance_m = 0.0;
  double time_s = 0.0;
};

/// How much a flight has to spare. Clearances are those of the pieces between states, the least of
/// each, weighted by length: at 1 % of the length the clearance is at most `clearance_p01_m`.
/// What is unknown is NaN.
struct Margins {
  double clearance_min_m = 0.0;
  double clearance_p01_m = 0.0;
  double clearance_p05_m = 0.0;
  double clearance_median_m = 0.0;
  double unknown_share = 0.0;     // of the length without a known clearance
  double height_max_m = 0.0;      // above the interpolated surface, on the continuous path
  double ceiling_margin_m = 0.0;  // ceiling_height_m less that; below 0 above the ceiling
  double load_factor_max = 0.0;   // thrust over weight [-]
  double load_factor_limit = 0.0;
  std::vector<NearMiss> nearest;  // one for each kind of hazard there is, the ground first
  std::vector<ViaPass> via;

  /// The one of `nearest` with the least to spare; null if nothing is known.
  [[nodiscard]] const NearMiss* nearest_miss() const;
};

/// Measures them, with the geometry of verify().
/// O(pieces x things within the distance of the nearest one). Needs at least two states.
Margins measure_margins(const map::Map& map, const flight::Trajectory& trajectory,
                        const std::vector<geo::MapPoint>& via, const flight::Limits& limits,
                        const Demands& demands);

}  // namespace hedgehop::verification
