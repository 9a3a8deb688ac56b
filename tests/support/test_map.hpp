#pragma once

#include <cmath>
#include <functional>

#include "map/map.hpp"

namespace hedgehop::test {

using HeightAt = std::function<double(double x_m, double y_m)>;

/// A map made of functions of x and y, for tests: corner at (0, 0), square cells, terrain =
/// surface, nothing visible, no land use, no CRS. Change layers afterwards, then call finish_map().
inline map::Map make_map(int columns, int rows, double cell_m, const HeightAt& elevation_m) {
  map::Map map;
  map.geometry = {0.0, 0.0, cell_m, columns, rows};
  map.vertical_datum = "test";
  map.reference_height_m = 15.24;
  map.visibility_radius_m = 5000.0;
  map.terrain_m = raster::Grid<float>(map.geometry, 0.0F);
  map.semantics = raster::Grid<std::uint16_t>(map.geometry, 0);
  map.visibility = raster::Grid<std::uint16_t>(map.geometry, 0);
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const geo::MapPoint centre = map.geometry.centre({column, row});
      map.terrain_m.at(column, row) = static_cast<float>(elevation_m(centre.x_m, centre.y_m));
    }
  }
  map.surface_m = map.terrain_m;
  map.hash = map::map_hash(map);
  return map;
}

/// Call after changing layers by hand.
inline void finish_map(map::Map& map) { map.hash = map::map_hash(map); }

/// Stored form of a visibility share in [0, 1].
inline std::uint16_t stored_visibility(double share) {
  return static_cast<std::uint16_t>(std::lround(share * map::kVisibilityScale));
}

}  // namespace hedgehop::test
