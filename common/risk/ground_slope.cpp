#include "risk/ground_slope.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace hedgehop::risk {
namespace {

constexpr double kReach_m = 60.0;
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

std::array<float, 2> slope_at(const raster::Grid<float>& terrain_m, int column, int row,
                              int reach) {
  const auto here_m = static_cast<double>(terrain_m.at(column, row));
  if (std::isnan(here_m)) {
    return {kNaN, kNaN};
  }
  double n = 0.0, x = 0.0, y = 0.0, z = 0.0, xx = 0.0, xy = 0.0, yy = 0.0, xz = 0.0, yz = 0.0;
  const int south = std::max(row - reach, 0);
  const int north = std::min(row + reach, terrain_m.rows() - 1);
  const int west = std::max(column - reach, 0);
  const int east = std::min(column + reach, terrain_m.columns() - 1);
  for (int r = south; r <= north; ++r) {
    for (int c = west; c <= east; ++c) {
      const double z_m = static_cast<double>(terrain_m.at(c, r)) - here_m;
      if (std::isnan(z_m)) {
        continue;
      }
      const double dx = c - column;
      const double dy = r - row;
      n += 1.0;
      x += dx;
      y += dy;
      z += z_m;
      xx += dx * dx;
      xy += dx * dy;
      yy += dy * dy;
      xz += dx * z_m;
      yz += dy * z_m;
    }
  }
  // About the means; sums of whole numbers, so the determinant of cells in a row is 0 exactly.
  xx = n * xx - x * x;
  xy = n * xy - x * y;
  yy = n * yy - y * y;
  xz = n * xz - x * z;
  yz = n * yz - y * z;
  const double determinant = xx * yy - xy * xy;
  if (!(determinant > 0.0)) {
    return {kNaN, kNaN};
  }
  const double scale = 1.0 / (determinant * terrain_m.geometry().cell_m);
  return {static_cast<float>((xz * yy - yz * xy) * scale),
          static_cast<float>((yz * xx - xz * xy) * scale)};
}

}  // namespace

std::vector<std::array<float, 2>> ground_slopes(const raster::Grid<float>& terrain_m) {
  const int reach =
      std::max(1, static_cast<int>(std::floor(kReach_m / terrain_m.geometry().cell_m + 0.5)));
  std::vector<std::array<float, 2>> slopes;
  slopes.reserve(terrain_m.geometry().cell_count());
  for (int row = 0; row < terrain_m.rows(); ++row) {
    for (int column = 0; column < terrain_m.columns(); ++column) {
      slopes.push_back(slope_at(terrain_m, column, row, reach));
    }
  }
  return slopes;
}

}  // namespace hedgehop::risk
