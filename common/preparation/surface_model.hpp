#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "base/observer.hpp"
#include "map/map.hpp"
#include "map_sources/land_use_source.hpp"
#include "map_sources/obstacle_file.hpp"
#include "preparation/prepare.hpp"

namespace hedgehop::preparation {

/// Heights of the surface are multiples of 1/64 m, rounded up.
float rounded_up(double value_m);

/// Where the heights of objects come from.
struct HeightCounts {
  std::int64_t tagged = 0;
  std::int64_t from_levels = 0;
  std::int64_t guessed = 0;
};

struct SurfaceModel {
  raster::Grid<float> surface_m;  // everything that must be flown over
  raster::Grid<float> opaque_m;   // the same without wires and obstacles: what hides from view
  raster::Grid<std::uint16_t> semantics;
  raster::Grid<std::uint8_t> height_origin;  // map::HeightOrigin of surface_m
  std::vector<map::OverheadLine> overhead_lines;
  std::vector<map::Obstacle> obstacles;
  std::array<HeightCounts, map_sources::kObjectClassCount> heights;  // by ObjectClass
  HeightCounts support_heights;
  HeightCounts obstacle_heights;
  std::int64_t village_count = 0;
  std::int64_t settlement_count = 0;
};

/// Puts what stands on the ground onto it.
///
/// Every cell that an object touches, however small, is raised by the object's height above
/// `upper_terrain_m`; the highest object counts. Between two supports of a power line or aerialway
/// each touched cell is raised to the straight line between their tops, and at least to the
/// supports' height above its ground: nothing flies under or through a line. Masts, towers,
/// chimneys, wind turbines and the entries of obstacle files raise every cell that their cylinder
/// touches, see obstacles_of(). Values are multiples of 1/64 m, rounded up.
///
/// Where `is_surface` is not 0, trees, houses and built-up areas are in the elevation already and
/// raise nothing; structures and power lines, too thin to be seen from above, do.
///
/// Semantics are set in touched cells too. Cells whose centre no land-use file covers are unmapped
/// and carry no other bit but that of obstacles; objects that stick out of the covered part still
/// raise the surface there.
SurfaceModel surface_model(const raster::Grid<float>& upper_terrain_m,
                           const raster::Grid<std::uint8_t>& is_surface,
                           const map_sources::LandUse& land_use,
                           const map_sources::ObstacleList& listed,
                           const geo::MapProjection& projection, const PrepareOptions& options,
                           Observer& observer);

}  // namespace hedgehop::preparation
