#pragma once

#include <cstdint>
#include <vector>

#include "base/observer.hpp"
#include "preparation/visibility_kernel.hpp"
#include "raster/grid.hpp"

namespace hedgehop::preparation {

struct VisibilityOptions {
  double radius_m = 0.0;
  double reference_height_m = 0.0;  // h_ref
  int azimuths = 0;                 // multiple of 4, at least 8
  bool is_earth_curved = false;
  double refraction = 0.0;                // share of the curvature that refraction takes back
  std::vector<double> further_heights_m;  // of the exposure volume, beside h_ref
};

/// How far ground at distance d looks lower than on a flat earth is this times d^2 [1/m].
inline double drop_per_square_1pm(const VisibilityOptions& options) {
  constexpr double kEarthRadius_m = 6371000.0;
  return options.is_earth_curved ? (1.0 - options.refraction) / (2.0 * kEarthRadius_m) : 0.0;
}

/// Ground of this weight counts fully.
inline constexpr std::uint8_t kGroundWeightMax = 64;

/// What is looked over. Layers share one geometry; NaN is unknown.
struct VisibilityGround {
  const raster::Grid<float>& opaque_m;   // what hides and is seen; NaN in the same cells
  const raster::Grid<float>& surface_m;  // what heights are measured from
  // How much each cell counts as a place from which is looked, 0..kGroundWeightMax; null: all fully
  const raster::Grid<std::uint8_t>* weight = nullptr;
};

/// How the work is done; never changes a byte.
struct VisibilityExecution {
  int threads = 0;  // 0: one for each processor
  Simd simd = Simd::kBest;
};

/// Cells of a block that are computed: columns [begin, end) of each of its rows.
struct ColumnSpan {
  int begin = 0;
  int end = 0;
};

struct VisibilityLayers {
  /// map::Map's stored form, share x 65534, at reference height and at each further one; 65535
  /// where the cell is unknown, knows nothing around it or was not asked for.
  std::vector<raster::Grid<std::uint16_t>> shares;
  /// 1 where part of the surroundings is unknown or outside the raster, so that the share is that
  /// of the rest.
  raster::Grid<std::uint8_t> is_partial;
};

/// Whole numbers of a block that its shares are made of, for update_visibility_of_block().
struct VisibilitySums {
  /// Seen and known weights; then, for every four further heights, on the lines that look from
  /// there too: seen from the reference height, from each of the four, known.
  std::vector<raster::Grid<std::int64_t>> planes;
};

/// Share of the surroundings that sees a point at a height over the surface, for a block of cells.
///
/// For every azimuth a ray leaves the point P = (x_0, y_0, e_0 + h_ref) over each cell's centre. It
/// meets the surface at every row (or column, along the longer axis) it crosses, where the height
/// is interpolated linearly between the two neighbouring cells:
///
///     s_k = (z_k - e_0 - h_ref) / d_k - (1 - refraction) d_k / (2 R)
///     seen if  s_k + b_k / d_k >= max(s_1 .. s_k-1)
///     share = sum of w_k over seen samples / sum of w_k over known samples
///
/// e_0  what h_ref is measured from: everything that must be flown over             [m]
/// z_k  what hides and is seen: the same without power lines, which hide nothing    [m]
/// b_k  by how much the nearer of the two cells is higher, if it is the edge of a forest or a house
///      or a ridge, 0 otherwise: those who look stand in cells and not on the slope between a tree
///      top and the ground beside                                                   [m]
/// w_k  area of the ring segment that sample k stands for, so that far ground counts for as much as
///      it covers, times the weight of the ground; segments end at radius_m.
/// R    radius of the earth; without the last term if it is taken as flat           [m]
///
/// The nearest eight samples lie exactly on the ray and have b_k = 0; beyond them it may lie up to
/// a quarter of a cell beside its observer (see visibility_lines.hpp). Unknown cells (NaN) and
/// cells outside the raster neither count nor hide anything.
///
/// All numbers are whole. Heights are rounded to u = 1/16 m, weights of a ray to 1/32767 of all. In
/// ring D, the samples from D to 2 D - 1 with D = 1, 2, 4, 8 .., slopes are what they are in height
/// at D steps, so that they resolve u to 2 u wherever the ground lies; the greatest slope so far
/// doubles from ring to ring:
///
///     S_k = round((z_k - e_0 - h_ref) / u * D / k) - round(c k D / u)    c k^2: drop at k steps
///
/// Rounding makes ties, of which those of odd k count as seen: so shares are not biased. Far out,
/// slopes of smooth ground differ by about u or less, and rounding would hide some of it from all
/// sides. So a cell that lies in line with its neighbours to the left and right to within u is
/// looked at u higher, or 2 u where the slopes of an even plane rise by less than 3/4 u from step
/// to step (low eyes, many steps) and where it lies level with both neighbours. From sample 17
/// or later on, rings and drops change where eight rows of the map frame end
/// (visibility_lines.hpp). Differences of heights and slopes saturate at 2048 m. If the horizon of
/// a smooth earth lies within the radius (low eyes, long rays), u is 2^-15 m, as the place of the
/// horizon hangs on it.
///
/// Further heights look along every second line and add what they see more than the reference
/// height does on the same lines: share_i = share + (seen_i - seen) / known. A greater height never
/// has a smaller share.
///
/// Whole numbers do not depend on their order, and lines are anchored to the map frame: same bytes
/// for any number of threads, any block and any raster of which it is cut, any instructions.
///
/// @param block      lower left cell of the block, and its size below; must lie inside the raster,
///                   which should reach radius_m and two cells beyond it.
/// @param spans      null, or for each row of the block which of its columns are wanted.
/// @param sums       null, or takes the sums, which updates need.
/// @throws std::invalid_argument  options, sizes or SIMD that are not possible
/// @throws Interrupted
/// @note  With 180 azimuths over 5 km of 30 m cells, on a shared AMD EPYC (Zen 4) with 3.7 GHz:
///        1.5 to 1.8 us of processor time for each cell with AVX-512, 2.2 to 2.5 us with AVX2
///        (`hedgehop evaluate protection --azimuths 180`), and a fifth more with 216. 180 are
///        26,908 samples a cell. The bare inner loop over ground that is in the nearest cache takes
///        0.027 ns a sample with AVX-512 and 0.048 ns with AVX2 (tests/bench/visibility_bench
///        measures it), so 0.74 and 1.3 us for all of a cell's samples: the layer is at 2.1 and 1.7
///        times that. It looks at half of them, since nobody sees the blocks of the others; that is
///        a third of its time, and the nearest rows, finding the blocks and interpolating the
///        ground are another sixth, eighth and twelfth. Where heights of a tile and what lies
///        around it differ by more than 4090 m, or units are fine, lanes have 32 bits. Four further
///        heights take 2.5 to 2.9 times as long. Memory: 45 to 90 bytes a cell and 8 more for each
///        further height.
VisibilityLayers visibility_of_block(const VisibilityGround& ground, raster::CellIndex block,
                                     int columns, int rows, const VisibilityOptions& options,
                                     const VisibilityExecution& execution, Observer& observer,
                                     const std::vector<ColumnSpan>* spans = nullptr,
                                     VisibilitySums* sums = nullptr);

/// A rectangle of cells.
struct CellRectangle {
  int column = 0;  // lower left cell
  int row = 0;
  int columns = 0;
  int rows = 0;
};

/// Brings the layers of a block up to date after the ground has changed inside `changed`, which is
/// given in the raster and may stick out of it. Only cells within radius_m and two cells of it can
/// see the difference, and of their rays only those that cross it: what these saw before is
/// taken back from the sums, what they see now is added. The result is the same bytes as
/// visibility_of_block() over the new ground.
///
/// @param before  the ground as it was; the same as `ground` outside of `changed`.
/// @param layers  of visibility_of_block() over `before`, with the same block and options.
/// @param sums    of the same call.
/// @throws std::invalid_argument, Interrupted; then layers and sums are as they were.
/// @note  A patch of 32 x 32 cells in 30 m changes up to 110,000 cells: 0.09 to 0.15 s of processor
///        time, where computing these cells anew takes 0.2 s. Sums take 16 bytes a cell, and 8
///        for each further height and 16 for every four of them.
void update_visibility_of_block(const VisibilityGround& before, const VisibilityGround& ground,
                                raster::CellIndex block, const CellRectangle& changed,
                                const VisibilityOptions& options,
                                const VisibilityExecution& execution, Observer& observer,
                                VisibilityLayers& layers, VisibilitySums& sums);

/// The same bytes, ray by ray and without SIMD; slow. The yardstick of the kernel.
VisibilityLayers plain_visibility_of_block(const VisibilityGround& ground, raster::CellIndex block,
                                           int columns, int rows, const VisibilityOptions& options);

/// The share for one cell by brute force: one line of sight to every known cell whose centre lies
/// within the radius, each cell counted with its weight. Interpolated as above. NaN where unknown.
/// Slow (about 20 ms at 5 km); the yardstick for the definition.
double reference_visibility_share(const VisibilityGround& ground, raster::CellIndex cell,
                                  double height_m, const VisibilityOptions& options);

}  // namespace hedgehop::preparation
