#pragma once

#include <algorithm>
#include <cmath>

#include "flight/plan_request.hpp"
#include "geo/map_projection.hpp"
#include "support/test_map.hpp"
#include "support/utm_map.hpp"

namespace hedgehop::test {

/// 7.2 x 4.8 km of rolling hills in UTM zone 32, seen more in the north than in the south. Quick to
/// plan on; tiles differ from each other. With an exposure volume of two
/// heights.
inline map::Map small_hills() {
  map::Map map = make_map(240, 160, 30.0, [](double x_m, double y_m) {
    return 400.0 + 30.0 * std::sin(x_m / 700.0) + 30.0 * std::cos(y_m / 600.0);
  });
  place_in_utm(map);
  map.label = "TEST HILLS";
  map.attributions = {"Invented for a test"};
  for (int row = 0; row < map.geometry.rows; ++row) {
    for (int column = 0; column < map.geometry.columns; ++column) {
      map.visibility.at(column, row) = stored_visibility((row + 0.1 * column) / 200.0);
      if (column > 100 && column < 120 && row < 70) {
        map.semantics.at(column, row) = static_cast<std::uint16_t>(map::SemanticClass::kForest);
        map.surface_m.at(column, row) += 12.0F;
      }
    }
  }
  map.further_visibility = {{60.0, map.visibility}};
  for (std::uint16_t& share : map.further_visibility[0].share.values()) {
    share = std::max(share, stored_visibility(0.3));
  }
  map.overhead_lines = {{7,
                         {{{kUtmWest_m + 3000.0, kUtmSouth_m + 100.0}, 30.0},
                          {{kUtmWest_m + 3300.0, kUtmSouth_m + 400.0}, 30.0}}}};
  finish_map(map);
  return map;
}

/// The same hills with two named observers: "tower" sees what flies higher than 5 m above the
/// south, where across_the_hills() is best hidden from all others; "hill" a corner from 60 m on.
inline map::Map watched_hills() {
  map::Map map = small_hills();
  const auto add = [&](const char* name, float lowest_m, int column_begin, int row_begin,
                       int row_end) {
    raster::Grid<float> layer(map.geometry, std::nanf(""));
    for (int row = row_begin; row < row_end; ++row) {
      for (int column = column_begin; column < column_begin + 40; ++column) {
        layer.at(column, row) = lowest_m;
      }
    }
    map.threats.push_back({name, std::move(layer)});
  };
  add("tower", 5.0F, 90, 0, 30);
  add("hill", 60.0F, 0, 120, map.geometry.rows);
  finish_map(map);
  return map;
}

/// A flight of about 5 km from west to east.
inline flight::PlanRequest across_the_hills(const map::Map& map) {
  const geo::MapProjection projection(map.crs_wkt);
  flight::PlanRequest request;
  request.start.position = projection.to_geodetic({kUtmWest_m + 1000.0, kUtmSouth_m + 2600.0});
  request.goal.position = projection.to_geodetic({kUtmWest_m + 6200.0, kUtmSouth_m + 2200.0});
  request.work_budget = 20000;
  return request;
}

}  // namespace hedgehop::test
