#pragma once

#include <cstdint>

#include "base/observer.hpp"
#include "raster/grid.hpp"

namespace hedgehop::preparation {

struct VisibilityOptions {
  double radius_m = 0.0;
  double reference_height_m = 0.0;  // h_ref
  int azimuths = 0;                 // multiple of 4, at least 8
};

/// Share of the surroundings that sees a point at reference height, for a block of cells.
///
/// For every azimuth a ray leaves the point P = (x_0, y_0, e_0 + h_ref) over each cell's centre. It
/// meets the surface at every row (or column, along the longer axis) it crosses, where the height
/// is interpolated linearly between the two neighbouring cells:
///
///     s_k = (z_k - e_0 - h_ref) / d_k        seen if  s_k >= max(s_1 .. s_k-1)
///     share = sum of w_k over seen samples / sum of w_k over known samples
///
/// e_0  what h_ref is measured from: everything that must be flown over             [m]
/// z_k  what hides and is seen: the same without power lines, which hide nothing    [m]
/// w_k  area of the ring segment that sample k stands for, so that far ground counts for as much as
/// it
///      covers; segments end at radius_m.
///
/// Unknown cells (NaN) and cells outside the raster neither count nor hide anything. The earth is
/// flat here: at 5 km it would drop by 2 m, so a little more is seen than in truth.
///
/// Weights are whole numbers, so sums do not depend on their order: same bytes for any number of
/// threads and any block, on processors with fused multiply-add.
///
/// @param opaque_m   elevation of what hides; should reach radius_m beyond the block.
/// @param surface_m  elevation that h_ref is measured from; same geometry, NaN in the same cells.
/// @param block      lower left cell of the block, and its size below; must lie inside.
/// @return           map::Map's stored form: share x 65534, 65535 where the cell is unknown or
/// knows
///                   nothing around it.
/// @throws Interrupted
/// @note  With 180 azimuths over 5 km of 30 m cells: 2 to 4 us of processor time for each cell with
///        AVX-512 or AVX2.
raster::Grid<std::uint16_t> visibility_of_block(const raster::Grid<float>& opaque_m,
                                                const raster::Grid<float>& surface_m,
                                                raster::CellIndex block, int columns, int rows,
                                                const VisibilityOptions& options, int threads,
                                                Observer& observer);

/// The same share for one cell by brute force: one line of sight to every known cell whose centre
/// lies within the radius, each cell counted once. Interpolated as above. NaN where unknown. Slow
/// (about 20 ms at 5 km); the yardstick for visibility_of_block.
double reference_visibility_share(const raster::Grid<float>& opaque_m,
                                  const raster::Grid<float>& surface_m, raster::CellIndex cell,
                                  const VisibilityOptions& options);

}  // namespace hedgehop::preparation
