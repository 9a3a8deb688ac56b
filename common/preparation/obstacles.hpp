#pragma once

#include <vector>

#include "map/map.hpp"
#include "map_sources/land_use_source.hpp"
#include "map_sources/obstacle_file.hpp"
#include "preparation/prepare.hpp"
#include "preparation/surface_model.hpp"
#include "raster/grid.hpp"

namespace hedgehop::preparation {

/// Whether a structure of the land use is narrow enough to count as an obstacle; broader ones are
/// raised as the polygons that they are.
bool is_obstacle(const map_sources::AreaObject& area);
bool is_obstacle(const map_sources::LineObject& object);

/// The height that a structure gets when its source states none.
double default_height_m(map_sources::StructureKind kind, const DefaultHeights& heights);

/// Structures of the land use and entries of obstacle files as cylinders.
///
/// The radius is the sum of the object's own extent (its outline, its rotor), the error of its
/// position and ObstacleOptions::safety_radius_m; the height includes the error of the height. The
/// top is the higher one of terrain + height and of the altitude that the source states, each with
/// its error: sources that contradict the terrain make an obstacle higher, never lower. Where only
/// the top is stated and the terrain is unknown, the height is the top's distance to the lowest
/// known terrain.
std::vector<map::Obstacle> obstacles_of(const map_sources::LandUse& land_use,
                                        const map_sources::ObstacleList& listed,
                                        const raster::Grid<float>& upper_terrain_m,
                                        const PrepareOptions& options, HeightCounts& counts);

/// Calls visit(cell) for every cell inside the grid whose square the disc touches, its edge
/// included.
template <typename Visit>
void for_each_touched_cell(const raster::GridGeometry& g, const geo::MapPoint& centre,
                           double radius_m, const Visit& visit) {
  const auto bound = [](double value, int high) {
    return static_cast<int>(std::fmin(std::fmax(value, 0.0), static_cast<double>(high)));
  };
  // One more on each side than the disc needs: the test below decides.
  const double first_column = std::floor((centre.x_m - radius_m - g.west_m) / g.cell_m) - 1.0;
  const double last_column = std::floor((centre.x_m + radius_m - g.west_m) / g.cell_m) + 2.0;
  const double first_row = std::floor((centre.y_m - radius_m - g.south_m) / g.cell_m) - 1.0;
  const double last_row = std::floor((centre.y_m + radius_m - g.south_m) / g.cell_m) + 2.0;
  for (int row = bound(first_row, g.rows); row < bound(last_row, g.rows); ++row) {
    const double south_m = g.south_m + row * g.cell_m;
    const double dy_m =
        std::fmax(std::fmax(south_m - centre.y_m, centre.y_m - south_m - g.cell_m), 0.0);
    for (int column = bound(first_column, g.columns); column < bound(last_column, g.columns);
         ++column) {
      const double west_m = g.west_m + column * g.cell_m;
      const double dx_m =
          std::fmax(std::fmax(west_m - centre.x_m, centre.x_m - west_m - g.cell_m), 0.0);
      if (dx_m * dx_m + dy_m * dy_m <= radius_m * radius_m) {
        visit(raster::CellIndex{column, row});
      }
    }
  }
}

/// Raises every cell that an obstacle touches to its top, and at least by its height above the
/// cell's own ground; sets SemanticClass::kObstacle there.
void raise_obstacles(const std::vector<map::Obstacle>& obstacles,
                     const raster::Grid<float>& upper_terrain_m, raster::Grid<float>& surface_m,
                     raster::Grid<std::uint16_t>& semantics);

}  // namespace hedgehop::preparation
