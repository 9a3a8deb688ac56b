#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "local_planning/surroundings.hpp"

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
  double disc_radius_m = 0.0;          // r_s: lateral margin plus half the diagonal of a cell
  double safety_height_m = 0.0;        // h_s
  double near_distance_m = 0.0;        // eps, least distance in a denominator
  double truncation_angle_rad = 0.0;   // cells further off the heading ...
  double truncation_distance_m = 0.0;  // ... and nearer than this are left out
  double arc_radius_max_factor = 0.0;  // r_max0 / r_min
  bool is_arc_widened = false;         // [r_min, r_max] widened by r_s
};

/// What the terrain around asks for, a sector each. Tangents of climb angles; minus infinity:
/// nothing.
struct PolarHistogram {
  std::vector<double> tan_climb;    // eq. (2), cells beyond the disc
  std::vector<double> tan_masked;   // the same after the arc mask (eq. (4) and algorithm 1)
  std::vector<double> tan_mask;     // eq. (4) alone
  double tan_climb_near = 0.0;      // of the cells within the disc: they belong to every sector
  std::vector<double> risk;         // eq. (5), weighted mean; 0 without a cell
  std::vector<double> risk_weight;  // sum of the weights; 0: no cell
};

/// Climb angles needed to clear the terrain, for each azimuth sector, with the masks and risks of
/// TVFH+.
///
/// A straight climb must clear the whole disc of radius r_s around each cell c by the height h_s.
/// The binding edge of the disc is the near one for a cell that is too high, the far one else:
///
///     N   = H_c + h_s - z
///     t_c = N / max(d - r_s, eps)  if N > 0,   N / (d + r_s)  otherwise           (2)
///     t_k = max over the cells whose interval [beta - b, beta + b] meets sector k, b = asin(r_s /
///     d)
///
/// Cells with d <= r_s belong to every sector; they say nothing about a direction and are kept
/// apart in tan_climb_near.
///
/// An arc from the heading chi through the cell turns by 2 delta, delta = wrap(beta - chi), with
/// radius r_c = d / (2 sin |delta|) (3) over the length s = d |delta| / sin |delta|. A cell masks
/// the direction chi + 2 delta with t = N / (s -+ r_s) (4) if |delta| < 45 degrees and r_min <= r_c
/// <= r_max, r_max = (r_max0 - r_min) (1 - 2 |delta| / (pi / 2)) + r_min. From the heading
/// outwards, to both sides, each sector takes the greatest mask so far (algorithm 1); the opposite
/// sector takes the smaller one of the two sides.
///
/// Risk of a sector: sum n_c risk_c / sum n_c with n_c = 1 - d^2 / w^2 over the same cells (5).
///
/// H_c  surface of the cell; z: altitude [m AMSL]
/// d, beta  horizontal distance and azimuth of the cell's centre, counter-clockwise from east
///
/// Source: the polar histogram of J. Borenstein and Y. Koren, "The vector field histogram", IEEE
/// T-RA 7(3), 1991, doi:10.1109/70.88137, and I. Ulrich and J. Borenstein, "VFH+", ICRA 1998,
/// doi:10.1109/ROBOT.1998.677362, with obstacle density replaced by climb angle.
///
/// Cost O((w / cell)^2 + K). Each object has scratch memory: one thread at a time.
class HistogramKernel {
 public:
  /// Holds a reference to `surroundings`, whose padding must suit the window.
  HistogramKernel(const Surroundings& surroundings, const HistogramOptions& options);

  /// @param turn_radius_min_m  r_min of the coordinated turn at the present speed
  /// @param histogram          overwritten; memory is reused
  /// @param reach_m            cells further away than this are left out even within the window
  void compute(const geo::MapPoint& place, double altitude_m, double heading_math_rad,
               double turn_radius_min_m, PolarHistogram& histogram,
               double reach_m = std::numeric_limits<double>::infinity());

  [[nodiscard]] const Sectors& sectors() const { return sectors_; }

 private:
  void apply_mask(int heading_sector, PolarHistogram& histogram) const;

  const Surroundings* surroundings_;
  HistogramOptions options_;
  Sectors sectors_;
  double truncation_cosine_;
  std::vector<double> climb_;   // 2 K: sectors K.. 2 K - 1 are those that wrapped
  std::vector<double> risk_;    // 2 K + 2, differences
  std::vector<double> weight_;  // 2 K + 2, differences
};

}  // namespace hedgehop::local_planning
