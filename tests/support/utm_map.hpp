#pragma once

#include <utility>

#include "geo/map_projection.hpp"
#include "map/map.hpp"

namespace hedgehop::test {

inline constexpr double kUtmWest_m = 600000.0;
inline constexpr double kUtmSouth_m = 5500000.0;

/// Moves the south-western corner of a map from make_map to a place in UTM zone 32, so that it has
/// geodetic positions; no value of a layer changes. Call finish_map() afterwards.
inline void place_in_utm(map::Map& map, double west_m = kUtmWest_m, double south_m = kUtmSouth_m) {
  map.crs_wkt = geo::MapProjection("EPSG:32632").wkt();
  map.geometry.west_m = west_m;
  map.geometry.south_m = south_m;
  const auto move = [&](auto& grid) {
    auto values = grid.values();
    grid = {map.geometry, {}};
    grid.values() = std::move(values);
  };
  move(map.terrain_m);
  move(map.surface_m);
  move(map.semantics);
  move(map.visibility);
}

}  // namespace hedgehop::test
