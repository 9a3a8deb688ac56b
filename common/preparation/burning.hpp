#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "base/observer.hpp"
#include "map_sources/land_use_source.hpp"
#include "raster/grid.hpp"

class OGRGeometry;

namespace hedgehop::preparation {

struct GeometryDeleter {
  void operator()(OGRGeometry* geometry) const;
};
using GeometryPointer = std::unique_ptr<OGRGeometry, GeometryDeleter>;

GeometryPointer geometry_of(const std::vector<map_sources::MapPolygon>& polygons);
/// A point, if there is one vertex only.
GeometryPointer geometry_of(const map_sources::MapLine& vertices);

struct BurnItem {
  const OGRGeometry* geometry = nullptr;
  double value = 0.0;
  std::uint8_t mark = 0;  // what kind of value it is
};

enum class Touch {
  kAny,     // every cell that the geometry touches
  kCentre,  // cells whose centre lies in it
};

/// Writes each item's value into the cells of its geometry; where items overlap, the greatest wins.
/// `marks`, if there is such a grid, gets the marks of the same items. Throws Interrupted.
void burn_greatest(raster::Grid<float>& grid, std::vector<BurnItem> items, Touch touch,
                   Observer& observer, raster::Grid<std::uint8_t>* marks = nullptr);

/// Sets `bit` in every cell of the geometries.
void burn_bit(raster::Grid<std::uint16_t>& grid, const std::vector<const OGRGeometry*>& geometries,
              std::uint16_t bit, Touch touch, Observer& observer);

}  // namespace hedgehop::preparation
