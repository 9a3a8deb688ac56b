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
namespace hedgehop::preparation {

/// One direction and its opposite.
struct SightLine {
  std::int64_t slope = 0;  // columns a row
  bool has_further = false;
  RaySteps steps;
  std::uint32_t ray_weight = 0;  // of all steps on ground of full weight
};

/// Weights of the steps of one ray add up to about this.
inline constexpr double kRayWeight = 2097152.0;
/// The same when ground has weights of its own, up to kGroundWeightMax.
inline constexpr double kWeightedRayWeight = 65536.0;
/// Every n-th line looks from further heights too.
inline constexpr int kFurtherLineStride = 2;

/// Lines whose rays cross a row with each step; `is_transposed`: a column.
std::vector<SightLine> sight_lines(const VisibilityOptions& options, double cell_m,
                                   bool is_transposed, bool has_ground_weights);

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
  float fraction = 0.0F;  // of the right neighbour, a multiple of 2^-16 below 1
};
inline Crossing crossing_of_line(std::int64_t slope, int phase, std::int64_t row) {
  const std::int64_t x = slope * row + (static_cast<std::int64_t>(phase) << (32 - kPhaseBits));
  return {static_cast<std::int32_t>(x >> 32),
          static_cast<float>((x >> 16) & 0xffff) * (1.0F / 65536.0F)};
}

/// Where a ray crosses the row that lies `rows` above its observer, columns counted from its own.
inline Crossing crossing_beside(std::int64_t slope, int rows) {
  return crossing_of_line(slope, 0, rows);
}

/// What a ray looks at where it crosses a row between `left` and `right` is so much higher than the
/// ground interpolated there, which is what may hide it: at the edge of a forest the nearest of the
/// two cells is looked at, since nobody stands on the slope between them. `beside` is the other
/// neighbour of the nearest one.
inline float edge_height_m(float fraction, float left, float right, float beside, float ground_m) {
  const float nearest = fraction < 0.5F ? left : right;
  const float opposite = fraction < 0.5F ? right : left;
  const float bend = std::fabs((beside + opposite) - (nearest + nearest));
  return bend > kEdge_m && bend < -kUnknownBelow_m ? nearest - ground_m : 0.0F;
}

/// Height of a cell in the padded raster.
inline float padded_height_m(float z) {
  return std::isnan(z) ? kFarBelow_m : std::clamp(z, -kHeightMax_m, kHeightMax_m);
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
