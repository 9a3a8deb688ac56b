#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "local_planning/polar_geometry.hpp"
#include "local_planning/surroundings.hpp"

namespace hedgehop::local_planning {

/// What the terrain around asks for, a sector each. Tangents of climb angles; minus infinity:
/// nothing. The arrays are padded to a multiple of kLanes.
struct PolarHistogram {
  std::vector<float> tan_climb;    // eq. (2), cells beyond the disc
  std::vector<float> tan_masked;   // the same after the arc mask (eq. (4) and algorithm 1)
  std::vector<float> tan_mask;     // eq. (4) alone
  float tan_climb_near = 0.0F;     // of the cells within the disc: they belong to every sector
  std::vector<float> risk;         // eq. (5), weighted mean; 0 without a cell
  std::vector<float> risk_weight;  // sum of the weights; 0: no cell

  /// Sets the size for so many sectors and what stands in the padding: not feasible, no cell.
  void resize(int sectors);
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
/// d, beta  horizontal distance and azimuth of the cell's centre, counter-clockwise from east,
///          seen from the centre of the sub-cell (a square of at most kSubcell_m) that holds the
///          helicopter
/// r_s  the disc radius of the options plus half the diagonal of a sub-cell: what is asked for is
///      enough wherever in its sub-cell the helicopter is
///
/// Risks are told apart by squares of at most kRiskSubcell_m and seen from their centres, with the
/// plain disc radius; they neither depend on heading nor reach.
///
/// Which sectors a cell belongs to is decided in double precision, tangents and masks are single
/// precision, sums of risk are fixed-point numbers: they do not depend on the order of the cells.
///
/// Source: the polar histogram of J. Borenstein and Y. Koren, "The vector field histogram", IEEE
/// T-RA 7(3), 1991, doi:10.1109/70.88137, and I. Ulrich and J. Borenstein, "VFH+", ICRA 1998,
/// doi:10.1109/ROBOT.1998.677362, with obstacle density replaced by climb angle.
///
/// Cost O((w / cell)^2 + K). Each object has scratch memory: one thread at a time. This is the
/// plain form; HistogramTable gives the same bits many times faster.
class HistogramKernel {
 public:
  /// Holds a reference to `surroundings`, whose padding must suit the window.
  HistogramKernel(const Surroundings& surroundings, const HistogramOptions& options);

  /// @param turn_radius_min_m  r_min of the coordinated turn at the present speed
  /// @param histogram          overwritten; memory is reused
  /// @param reach_m            climbs over cells further away than this are left out even within
  ///                           the window
  void compute(const geo::MapPoint& place, double altitude_m, double heading_math_rad,
               double turn_radius_min_m, PolarHistogram& histogram,
               double reach_m = std::numeric_limits<double>::infinity());

  [[nodiscard]] const Sectors& sectors() const { return sectors_; }
  [[nodiscard]] const PolarConstants& constants() const { return constants_; }
  [[nodiscard]] const PolarConstants& risk_constants() const { return risk_constants_; }

 private:
  void compute_risk(const Viewpoint& view);

  const Surroundings* surroundings_;
  Sectors sectors_;
  PolarConstants constants_;
  PolarConstants risk_constants_;
  std::optional<Viewpoint> risk_view_;  // that of the risks below
  std::vector<float> sector_risk_;
  std::vector<float> sector_weight_;
  std::vector<std::int64_t> risk_;    // K + 1, differences
  std::vector<std::int64_t> weight_;  // K + 1, differences
};

/// Algorithm 1: tan_masked from tan_climb and tan_mask.
void apply_mask(int heading_sector, int sectors, PolarHistogram& histogram);

}  // namespace hedgehop::local_planning
