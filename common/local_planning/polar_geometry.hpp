#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <vector>

#include "raster/grid.hpp"

/// What the polar histogram's plain form and its SIMD form have in common: every operation on a
/// single cell, so that both give the same bits.
namespace hedgehop::local_planning {

/// K equal sectors of the circle. Sector k is centred on k * 2 pi / K, counter-clockwise from east.
class Sectors {
 public:
  /// @throws std::invalid_argument  unless 8 <= count <= 1024.
  explicit Sectors(int count);

  [[nodiscard]] int count() const { return count_; }
  [[nodiscard]] double width_rad() const { return width_rad_; }
  [[nodiscard]] double centre_rad(int sector) const { return sector * width_rad_; }
  /// Sector of an angle [rad].
  [[nodiscard]] int of_angle(double angle_rad) const;
  /// Sector of a direction, without a transcendental function; (0, 0) is in sector 0.
  [[nodiscard]] int of_direction(double x, double y) const;

 private:
  int count_;
  double width_rad_;
  std::vector<double> bounds_;       // pseudo-angles of the sectors' left edges, ascending, and 5
  std::vector<std::int16_t> first_;  // bounds at or below the start of a slot
  double slots_per_unit_;
};

/// Geometry of the histogram.
struct HistogramOptions {
  double window_m = 0.0;               // w
  int sectors = 0;                     // K
  double disc_radius_m = 0.0;          // lateral margin plus half the diagonal of a cell
  double safety_height_m = 0.0;        // h_s
  double near_distance_m = 0.0;        // eps, least distance in a denominator
  double truncation_angle_rad = 0.0;   // cells further off the heading ...
  double truncation_distance_m = 0.0;  // ... and nearer than this are left out
  double arc_radius_max_factor = 0.0;  // r_max0 / r_min
  bool is_arc_widened = false;         // [r_min, r_max] widened by r_s
};

/// Greatest side of the squares that the place of the helicopter is told apart by [m]: for climbs,
/// and for risks, which are means over many cells.
inline constexpr double kSubcell_m = 4.0;
inline constexpr double kRiskSubcell_m = 16.0;
enum class PolarUse : std::uint8_t { kClimb, kRisk };
/// Arrays over sectors have a multiple of this many entries.
inline constexpr int kLanes = 16;

constexpr int padded_to_lanes(int count) { return (count + kLanes - 1) / kLanes * kLanes; }

/// The sum of what was summed in kLanes parts, always in the same order; overwrites them.
inline float sum_of_parts(float (&parts)[kLanes]) {
  for (int width = kLanes / 2; width > 0; width /= 2) {
    for (int i = 0; i < width; ++i) {
      parts[i] += parts[i + width];
    }
  }
  return parts[0];
}

/// The cell and the part of it that hold a place.
struct Viewpoint {
  int column = 0;
  int row = 0;
  int sub_column = 0;
  int sub_row = 0;

  bool operator==(const Viewpoint&) const = default;
};

/// Numbers that a histogram needs for each cell, made from its options and the raster.
struct PolarConstants {
  PolarConstants(PolarUse use, const HistogramOptions& options,
                 const raster::GridGeometry& geometry, double risk_max);

  [[nodiscard]] Viewpoint viewpoint(double x_m, double y_m) const;
  /// Centre of the sub-cell, from the cell's south-west corner [m].
  [[nodiscard]] double within_cell_m(int sub) const { return (sub + 0.5) * subcell_m; }

  double west_m;
  double south_m;
  double cell_m;
  int subcells;  // a side
  double subcell_m;
  double window_m;
  double disc_m;  // r_s; for climbs half a sub-cell's diagonal included
  double safety_height_m;
  double arc_radius_max_factor;
  double widened_m;
  float disc;
  float near;
  float truncation_angle;
  float truncation_distance;
  float inverse_window2;
  float sectors_per_rad;
  float weight_scale;  // of the fixed-point sums
  float risk_scale;
  float risk_max;
};

/// The nearest whole number of a value in [0, 2^22], ties to even.
inline constexpr float kWholeShift = 8388608.0F;
inline constexpr std::uint32_t kWholeShiftBits = 0x4b000000U;
inline std::uint32_t nearest_whole(float value) {
  return std::bit_cast<std::uint32_t>(value + kWholeShift) - kWholeShiftBits;
}

/// A cell as seen from a viewpoint.
struct PolarCell {
  float distance_m = 0.0F;
  float azimuth_rad = 0.0F;
  float rise_1pm = 0.0F;  // 1 / max(d - r_s, eps)
  float fall_1pm = 0.0F;  // 1 / (d + r_s)
  int low = 0;   // sectors low..high, high < low + K; nothing if the cell is within the disc
  int high = 0;  // may be K or more
};

/// @param dx_m, dy_m  from the viewpoint to the centre of the cell; within the window
/// @param needs_azimuth  false: azimuth_rad stays 0
PolarCell polar_cell(const PolarConstants& constants, const Sectors& sectors, double dx_m,
                     double dy_m, bool needs_azimuth);

/// What one histogram depends on beside the cells.
struct PolarQuestion {
  PolarQuestion(const PolarConstants& constants, double altitude_m, double heading_math_rad,
                double turn_radius_min_m, double reach_m);

  float floor_m;      // altitude less h_s
  float heading_rad;  // in [-pi, pi)
  float reach_m;
  float arc_min;  // twice the least radius of an arc
  float arc_max;  // twice the greatest one straight ahead, less arc_spread
  float arc_spread;
};

/// Powers of a^2 in a / sin a, from the fourth on; |a| <= pi/4.
inline constexpr float kArcSeries[6] = {1.0F / 6.0F,        7.0F / 360.0F,      31.0F / 15120.0F,
                                        127.0F / 604800.0F, 73.0F / 3421440.0F, 2.163348e-6F};
inline constexpr float kPi_f = 3.14159274F;
inline constexpr float kTwoPi_f = 6.28318548F;
inline constexpr float kQuarterPi_f = 0.785398185F;
inline constexpr float kFourOverPi_f = 1.27323954F;
inline constexpr float kStraightAhead_rad = 1e-6F;

}  // namespace hedgehop::local_planning
