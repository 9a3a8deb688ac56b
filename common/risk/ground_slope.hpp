#pragma once

#include <array>
#include <vector>

#include "raster/grid.hpp"

namespace hedgehop::risk {

/// How steep the hillside is around each cell, and which way: the gradient (east, north) [-] of the
/// plane of least squares through the centres of the known cells that lie at most k rows and k
/// columns away, k = round(60 m / cell), at least 1. So a plane has its own slope everywhere, and
/// what is smaller than some 100 m is smoothed out. NaN over unknown ground and where fewer than
/// three cells, or only cells in a row, are known.
///
/// @return  cell by cell, row by row from the south. O(cells k^2).
std::vector<std::array<float, 2>> ground_slopes(const raster::Grid<float>& terrain_m);

}  // namespace hedgehop::risk
