#include "preparation/areas.hpp"

#include <algorithm>

namespace hedgehop::preparation {
namespace {

bool is_same_word(const std::string& a, const std::string& b) {
  const auto lower = [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c; };
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [&](char x, char y) { return lower(x) == lower(y); });
}

bool is_among(const std::string& kind, const std::vector<std::string>& kinds) {
  return std::any_of(kinds.begin(), kinds.end(),
                     [&](const std::string& one) { return is_same_word(kind, one); });
}

bool may_touch(const map_sources::MapPolygon& polygon, const raster::GridGeometry& g) {
  double west_m = 1e18, south_m = 1e18, east_m = -1e18, north_m = -1e18;
  for (const geo::MapPoint& corner : polygon.outer) {
    west_m = std::min(west_m, corner.x_m);
    east_m = std::max(east_m, corner.x_m);
    south_m = std::min(south_m, corner.y_m);
    north_m = std::max(north_m, corner.y_m);
  }
  return west_m <= g.east_m() && east_m >= g.west_m && south_m <= g.north_m() &&
         north_m >= g.south_m;
}

map::AreaLimit limit_of(const map_sources::AltitudeLimit& limit) {
  return {limit.value_m, limit.is_above_ground ? map::AreaLimit::Reference::kAboveGround
                                               : map::AreaLimit::Reference::kAmsl};
}

}  // namespace

Areas areas_of(const map_sources::AirspaceList& list, const raster::GridGeometry& geometry,
               const AreaOptions& options) {
  Areas result;
  for (const map_sources::AirspaceArea& source : list.areas) {
    map::Area area;
    for (const map_sources::MapPolygon& polygon : source.polygons) {
      if (may_touch(polygon, geometry)) {
        area.polygons.push_back({polygon.outer, polygon.holes});
      }
    }
    if (area.polygons.empty()) {
      continue;
    }
    if (source.is_hard) {
      area.is_hard = *source.is_hard;
    } else if (source.kind.empty() || is_among(source.kind, options.hard_kinds)) {
      area.is_hard = true;
    } else if (is_among(source.kind, options.soft_kinds)) {
      area.is_hard = false;
    } else {
      ++result.left_out[source.kind];
      continue;
    }
    area.name = source.name;
    area.kind = source.kind;
    area.floor = limit_of(source.floor);
    area.ceiling = limit_of(source.ceiling);
    result.areas.push_back(std::move(area));
  }
  return result;
}

Areas read_areas(const map_sources::AreaFiles& files, const std::vector<map_sources::Fence>& fences,
                 const geo::MapProjection& projection, const raster::GridGeometry& geometry,
                 const AreaOptions& options, Observer& observer) {
  const geo::GeodeticBox region = raster::geodetic_box(geometry, projection);
  map_sources::AirspaceList list = map_sources::read_areas(files, projection, region, observer);
  for (auto& area : map_sources::areas_of_fences(fences, projection, region)) {
    list.areas.push_back(std::move(area));
  }
  return areas_of(list, geometry, options);
}

}  // namespace hedgehop::preparation
