#include "raster/grid.hpp"

#include <algorithm>

namespace hedgehop::raster {

double sample_bilinear(const Grid<float>& grid, const geo::MapPoint& point) {
  const GridGeometry& geometry = grid.geometry();
  if (!geometry.contains(point)) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  const double u = std::clamp((point.x_m - geometry.west_m) / geometry.cell_m - 0.5, 0.0,
                              static_cast<double>(geometry.columns - 1));
  const double v = std::clamp((point.y_m - geometry.south_m) / geometry.cell_m - 0.5, 0.0,
                              static_cast<double>(geometry.rows - 1));
  const int column = static_cast<int>(u);
  const int row = static_cast<int>(v);
  const double fu = u - column;
  const double fv = v - row;
  const int next_column = fu > 0.0 ? column + 1 : column;
  const int next_row = fv > 0.0 ? row + 1 : row;
  const double south = (1.0 - fu) * static_cast<double>(grid.at(column, row)) +
                       fu * static_cast<double>(grid.at(next_column, row));
  const double north = (1.0 - fu) * static_cast<double>(grid.at(column, next_row)) +
                       fu * static_cast<double>(grid.at(next_column, next_row));
  return (1.0 - fv) * south + fv * north;
}

double max_within(const Grid<float>& grid, const geo::MapPoint& centre, double radius_m) {
  const GridGeometry& geometry = grid.geometry();
  const CellIndex low = geometry.cell_at({centre.x_m - radius_m, centre.y_m - radius_m});
  const CellIndex high = geometry.cell_at({centre.x_m + radius_m, centre.y_m + radius_m});
  double greatest = -std::numeric_limits<double>::infinity();
  for (int row = low.row; row <= high.row; ++row) {
    const double south_m = geometry.south_m + row * geometry.cell_m;
    const double dy_m = centre.y_m - std::clamp(centre.y_m, south_m, south_m + geometry.cell_m);
    for (int column = low.column; column <= high.column; ++column) {
      const double west_m = geometry.west_m + column * geometry.cell_m;
      const double dx_m = centre.x_m - std::clamp(centre.x_m, west_m, west_m + geometry.cell_m);
      if (dx_m * dx_m + dy_m * dy_m > radius_m * radius_m) {
        continue;
      }
      if (!geometry.contains(CellIndex{column, row}) || std::isnan(grid.at(column, row))) {
        return std::numeric_limits<double>::quiet_NaN();
      }
      greatest = std::max(greatest, static_cast<double>(grid.at(column, row)));
    }
  }
  return greatest;
}

geo::GeodeticBox geodetic_box(const GridGeometry& g, const geo::MapProjection& projection) {
  geo::GeodeticBox box{1e9, 1e9, -1e9, -1e9};
  constexpr int kSteps = 32;
  for (int i = 0; i <= kSteps; ++i) {
    const double x_m = g.west_m + (g.east_m() - g.west_m) * i / kSteps;
    const double y_m = g.south_m + (g.north_m() - g.south_m) * i / kSteps;
    for (const geo::MapPoint& point :
         {geo::MapPoint{x_m, g.south_m}, geo::MapPoint{x_m, g.north_m()},
          geo::MapPoint{g.west_m, y_m}, geo::MapPoint{g.east_m(), y_m}}) {
      const geo::GeodeticPosition position = projection.to_geodetic(point);
      box.west_rad = std::min(box.west_rad, position.longitude_rad);
      box.east_rad = std::max(box.east_rad, position.longitude_rad);
      box.south_rad = std::min(box.south_rad, position.latitude_rad);
      box.north_rad = std::max(box.north_rad, position.latitude_rad);
    }
  }
  return box;
}

}  // namespace hedgehop::raster
