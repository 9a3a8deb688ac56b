#pragma once

#include <map>
#include <string>
#include <vector>

#include "map/map.hpp"
#include "map_sources/area_source.hpp"
#include "preparation/prepare.hpp"

namespace hedgehop::preparation {

struct Areas {
  std::vector<map::Area> areas;
  std::map<std::string, std::int64_t> left_out;  // how many of each kind
};

/// Areas of the sources as areas of the map.
///
/// An area is hard or soft as its source states it, else by its kind (AreaOptions, whatever the
/// case), else, if it has no kind, hard. Other kinds, such as the classes of controlled airspace,
/// are left out. Areas that do not touch `geometry` are left out without being counted.
Areas areas_of(const map_sources::AirspaceList& list, const raster::GridGeometry& geometry,
               const AreaOptions& options);

/// Reads areas and fences for a map: map_sources::read_areas(), areas_of_fences() and areas_of().
/// Throws what they throw.
Areas read_areas(const map_sources::AreaFiles& files, const std::vector<map_sources::Fence>& fences,
                 const geo::MapProjection& projection, const raster::GridGeometry& geometry,
                 const AreaOptions& options, Observer& observer);

}  // namespace hedgehop::preparation
