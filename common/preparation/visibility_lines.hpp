#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "preparation/visibility.hpp"
#include "preparation/visibility_kernel.hpp"

/// The rule by which rays of the visibility layer are laid, for the kernel and for the plain
/// reference alike.
///
/// Rays that advance row by row (or column by column, in the transposed raster) run on lines
///
///     x(R) = j + slope R + phase / 2        R counted from the origin of the map frame
///
/// with whole numbers j, so that which line serves an observer depends on the place alone and not
/// on the block or tile that is computed: one at most a quarter of a cell beside the observer. The
/// nearest kExactSteps samples lie on the ray itself, x(R) = column + slope (R - row): a tree or a
/// house there hides much, and a quarter of a cell decides whether it does.
/// Positions are fixed-point numbers with 32 binary places.
///
/// Blocks are kBlockRows rows R, from multiples of it on. The near samples of a ray are those of
/// the blocks that it enters with sample kNearRows or before; each has the ring and the drop of its
/// own k. All samples of a far block have the ring of the one with which the ray enters it, and the
/// drop of its middle.
namespace hedgehop::preparation {

/// One direction and its opposite.
struct SightLine {
  std::int64_t slope = 0;  // columns a row
  bool has_further = false;
  RaySteps steps;
  std::int32_t ray_weight = 0;  // of all steps on ground of full weight
};

/// Weights of the steps of one ray add up to about this, those of both directions to 16 bits.
inline constexpr double kRayWeight = 32767.0;
/// Every n-th line looks from further heights too.
inline constexpr int kFurtherLineStride = 2;

/// Lines whose rays cross a row with each step; `is_transposed`: a column.
std::vector<SightLine> sight_lines(const VisibilityOptions& options, double cell_m,
                                   bool is_transposed);

/// Lines a cell.
inline constexpr int kPhaseBits = 1;
inline constexpr int kPhases = 1 << kPhaseBits;

/// The line that serves an observer in absolute row `row`: skewed column = column + shift.
struct Foot {
  int shift = 0;
  int phase = 0;  // 0 .. kPhases - 1
};
inline Foot foot_on_line(std::int64_t slope, std::int64_t row) {
  const std::int64_t parts = (-kPhases * slope * row + (std::int64_t{1} << 31)) >> 32;
  return {static_cast<int>(parts >> kPhaseBits), static_cast<int>(parts & (kPhases - 1))};
}

/// Where skewed column 0 crosses a row.
struct Crossing {
  std::int32_t left = 0;
  std::int16_t fraction = 0;  // of the right neighbour, in 1 / kOne
};
inline Crossing crossing_of_line(std::int64_t slope, int phase, std::int64_t row) {
  const std::int64_t x = slope * row + (static_cast<std::int64_t>(phase) << (32 - kPhaseBits));
  return {static_cast<std::int32_t>(x >> 32), static_cast<std::int16_t>((x >> 17) & (kOne - 1))};
}

/// Where a ray crosses the row that lies `rows` above its observer, columns counted from its own.
inline Crossing crossing_beside(std::int64_t slope, int rows) {
  return crossing_of_line(slope, 0, rows);
}

/// Which of the two cells beside a crossing is looked at: 0 the left one, 1 the right one.
inline int to_nearest(std::int16_t fraction) { return fraction < kOne / 2 ? 0 : 1; }
/// Where the right neighbour counts for nothing, the left one stands in: it may be unknown.
inline int to_right(std::int16_t fraction) { return fraction == 0 ? 0 : 1; }

/// Whether the block that a ray enters with sample `first` is far.
inline bool is_far(int first) { return first > kNearRows; }
/// The ring of a near sample, or of a far block that begins with it.
inline int ring_of(int first) {
  int ring = 1;
  while (2 * ring <= first) {
    ring *= 2;
  }
  return ring;
}

/// In how many units a metre is counted. On a smooth earth whose horizon lies within the radius,
/// less than kUnitsPerMetre can tell decides where that is.
inline int units_per_metre(const VisibilityOptions& options) {
  const double drop_m = drop_per_square_1pm(options) * options.radius_m * options.radius_m;
  return options.reference_height_m < drop_m ? kFineUnitsPerMetre : kUnitsPerMetre;
}
/// What slopes and differences of heights saturate at: 2048 m.
inline int limit_in_units(int units_per_metre) { return 2048 * units_per_metre - 1; }

/// Known heights are clamped to what is less than this from zero, eyes where reference heights are
/// great.
inline constexpr float kHeightMax_m = 20000.0F;
inline constexpr float kEyeMax_m = 30000.0F;
inline int in_units(float z_m, int units_per_metre) {
  return static_cast<int>(std::floor(z_m * static_cast<float>(units_per_metre) + 0.5F));
}
inline int ground_in_units(float z_m, int units_per_metre) {
  return in_units(std::clamp(z_m, -kHeightMax_m, kHeightMax_m), units_per_metre);
}
inline int eye_in_units(float z_m, float reference_height_m, int units_per_metre) {
  const float ground_m = std::clamp(z_m, -kHeightMax_m, kHeightMax_m);
  return in_units(std::min(ground_m + reference_height_m, kEyeMax_m), units_per_metre);
}
/// Weight of ground in units of the kernel.
inline std::uint16_t weight_in_units(std::uint8_t weight) {
  return static_cast<std::uint16_t>(std::min(weight, kGroundWeightMax) * kFullWeight /
                                    kGroundWeightMax);
}
/// What a sample of this weight counts for on ground of this weight.
inline int counted_weight(int weight, int ground_weight) {
  return static_cast<int>(
      (static_cast<std::uint32_t>(weight) + 1) * static_cast<std::uint32_t>(ground_weight) >> 16);
}

/// Rows or columns from the origin of the map frame to the raster's first.
std::int64_t rows_from_origin(double first_edge_m, double cell_m);

/// Stored form of a share.
std::uint16_t stored_share(double share);
/// Stored form of the share at a further height: the lines that look from there too have seen
/// `more` than from the reference height, of what they `known`.
std::uint16_t further_share(double share, std::int64_t more, std::int64_t known);
/// Rounding must not let a greater height have a smaller share.
void order_by_height(const VisibilityOptions& options,
                     std::vector<raster::Grid<std::uint16_t>>& shares);

/// Part of a raster as a geometry of its own.
raster::GridGeometry geometry_of_block(const raster::GridGeometry& geometry,
                                       raster::CellIndex block, int columns, int rows);

/// 1 for each cell of the block with a cell within the radius, centre to centre, that is unknown or
/// outside the raster.
raster::Grid<std::uint8_t> partial_surroundings(const raster::Grid<float>& opaque_m,
                                                raster::CellIndex block, int columns, int rows,
                                                double radius_m);

/// Throw std::invalid_argument for what makes no sense.
void validate(const VisibilityOptions& options, double cell_m);
void validate(const VisibilityGround& ground, raster::CellIndex block, int columns, int rows);

}  // namespace hedgehop::preparation
