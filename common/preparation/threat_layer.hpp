#pragma once

#include <string>
#include <vector>

#include "base/config_reader.hpp"
#include "base/observer.hpp"
#include "geo/map_projection.hpp"
#include "preparation/visibility.hpp"
#include "raster/grid.hpp"

namespace hedgehop::preparation {

/// Somebody who looks, or something that does.
struct NamedObserver {
  std::string name;
  geo::GeodeticPosition position;
  double mast_height_m = 0.0;  // of the eye above the ground
  double range_m = 0.0;
};

/// The whole document: a list `observers` of name, latitude_deg, longitude_deg, mast_height_m,
/// range_m. Throws ConfigError.
std::vector<NamedObserver> read_named_observers(ConfigReader& reader);

/// What one observer sees.
struct ThreatLayer {
  std::string name;
  raster::Grid<float> lowest_seen_m;
};

/// Lowest height above the surface at which an observer sees something over each cell's centre [m]:
/// 0 where the surface itself is seen, NaN out of range, over unknown ground, and everywhere if the
/// observer stands on unknown ground or outside the raster.
///
/// The line of sight runs from the observer's place, exactly, to each cell's centre and meets the
/// surface at every row or column, along the longer axis, that it crosses between them,
/// interpolated between the two neighbouring cells. With E = ground + mast:
///
///     m = max over crossings of (z - drop d^2 - E) / d
///     lowest seen = max(0, E + m D + drop D^2 - surface)
///
/// Unknown ground hides nothing. Cells that lie within the observer's own or a neighbouring row and
/// column have nothing in between.
///
/// @param ground     opaque_m hides; surface_m is what heights are measured from.
/// @param terrain_m  the ground that the mast stands on; same geometry.
/// @throws Interrupted
/// @note  O(cells in range x range / cell): 0.2 s for a range of 10 km and 30 m cells.
raster::Grid<float> lowest_seen_height(const VisibilityGround& ground,
                                       const raster::Grid<float>& terrain_m,
                                       const geo::MapPoint& place, double mast_height_m,
                                       double range_m, double drop_1pm, int threads,
                                       Observer& observer);

}  // namespace hedgehop::preparation
