#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "raster/grid.hpp"

namespace hedgehop::raster {

/// Calls visit(cell, t_in, t_out) for every cell inside the grid that the segment a-b passes
/// through, in order; t runs from 0 at a to 1 at b. Both ends must be finite. A segment that only
/// touches a corner of a cell may leave that cell out.
/// O(cells passed), wherever the segment begins.
template <typename Visit>
void walk_segment(const GridGeometry& g, const geo::MapPoint& a, const geo::MapPoint& b,
                  const Visit& visit) {
  const double dx_m = b.x_m - a.x_m;
  const double dy_m = b.y_m - a.y_m;
  // Clipped to the raster, so that a line from far away costs nothing.
  double t_begin = 0.0;
  double t_end = 1.0;
  const auto clip = [&](double start, double delta, double low, double high) {
    if (delta == 0.0) {
      return start >= low && start < high;
    }
    double t0 = (low - start) / delta;
    double t1 = (high - start) / delta;
    if (t0 > t1) {
      std::swap(t0, t1);
    }
    t_begin = std::max(t_begin, t0);
    t_end = std::min(t_end, t1);
    return t_begin <= t_end;
  };
  if (!clip(a.x_m, dx_m, g.west_m, g.east_m()) || !clip(a.y_m, dy_m, g.south_m, g.north_m())) {
    return;
  }
  std::vector<double> crossings = {t_begin, t_end};
  const auto add_crossings = [&](double start, double delta, double origin) {
    if (delta == 0.0) {
      return;
    }
    const double u0 = (start + t_begin * delta - origin) / g.cell_m;
    const double u1 = (start + t_end * delta - origin) / g.cell_m;
    const auto low = static_cast<std::int64_t>(std::ceil(std::min(u0, u1)));
    const auto high = static_cast<std::int64_t>(std::floor(std::max(u0, u1)));
    for (std::int64_t line = low; line <= high; ++line) {
      const double t = (origin + static_cast<double>(line) * g.cell_m - start) / delta;
      if (t > t_begin && t < t_end) {
        crossings.push_back(t);
      }
    }
  };
  add_crossings(a.x_m, dx_m, g.west_m);
  add_crossings(a.y_m, dy_m, g.south_m);
  std::sort(crossings.begin(), crossings.end());
  for (std::size_t i = 0; i + 1 < crossings.size(); ++i) {
    const double t = 0.5 * (crossings[i] + crossings[i + 1]);
    const CellIndex cell = g.cell_at({a.x_m + t * dx_m, a.y_m + t * dy_m});
    if (g.contains(cell)) {
      visit(cell, crossings[i], crossings[i + 1]);
    }
  }
}

}  // namespace hedgehop::raster
