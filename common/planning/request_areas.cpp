#include "planning/request_areas.hpp"

#include "base/errors.hpp"
#include "map/map_bundle.hpp"

namespace hedgehop::planning {
namespace {

using Reference = map::AreaLimit::Reference;

map::AreaLimit limit_of(const flight::RequestAreaEnd& end) {
  return {end.value_m, end.is_above_ground ? Reference::kAboveGround : Reference::kAmsl};
}

flight::RequestAreaEnd end_of(const map::AreaLimit& limit) {
  return {limit.value_m, limit.reference == Reference::kAboveGround};
}

}  // namespace

map::Map map_with_areas(map::Map map, const std::vector<flight::RequestArea>& areas) {
  if (areas.empty()) {
    return map;
  }
  const geo::MapProjection projection(map.crs_wkt);
  for (const flight::RequestArea& given : areas) {
    const auto ring_of = [&](const flight::RequestArea::Ring& corners) {
      std::vector<geo::MapPoint> ring;
      for (const geo::GeodeticPosition& corner : corners) {
        ring.push_back(projection.to_map(corner));
      }
      return ring;
    };
    map::Area area;
    area.name = given.name;
    area.kind = given.kind;
    area.is_hard = given.is_hard;
    area.floor = limit_of(given.floor);
    area.ceiling = limit_of(given.ceiling);
    for (const flight::RequestArea::Polygon& polygon : given.polygons) {
      map::Area::Polygon& placed = area.polygons.emplace_back();
      placed.outer = ring_of(polygon.outer);
      for (const flight::RequestArea::Ring& hole : polygon.holes) {
        placed.holes.push_back(ring_of(hole));
      }
    }
    map.areas.push_back(std::move(area));
  }
  map.hash = map::map_hash(map);
  return map;
}

map::Map map_of_plan(map::Map map, const flight::Plan& plan, const std::string& plan_name,
                     const std::string& map_name) {
  const std::string base_hash = map.hash.hex();
  map = map_with_areas(std::move(map), plan.route_plan.request.areas);
  if (plan.route_plan.map.hash != map.hash) {
    throw UsageError("plan " + plan_name + " was made on map " + plan.route_plan.map.hash.hex() +
                         ", but " + map_name + " is map " + base_hash +
                         (plan.route_plan.request.areas.empty()
                              ? ""
                              : ", with the areas of the plan " + map.hash.hex()),
                     "give the map that the plan was made on");
  }
  return map;
}

map::Map read_map_of_plan(const std::filesystem::path& bundle, const flight::Plan& plan,
                          const std::string& plan_name) {
  return map_of_plan(map::read_map_bundle(bundle), plan, plan_name, bundle.string());
}

std::vector<flight::RequestArea> request_areas_of(const std::vector<map::Area>& areas,
                                                  const geo::MapProjection& projection) {
  const auto ring_of = [&](const std::vector<geo::MapPoint>& points) {
    flight::RequestArea::Ring ring;
    for (const geo::MapPoint& point : points) {
      ring.push_back(projection.to_geodetic(point));
    }
    return ring;
  };
  std::vector<flight::RequestArea> result;
  for (const map::Area& area : areas) {
    flight::RequestArea& named = result.emplace_back();
    named.name = area.name;
    named.kind = area.kind;
    named.is_hard = area.is_hard;
    named.floor = end_of(area.floor);
    named.ceiling = end_of(area.ceiling);
    for (const map::Area::Polygon& polygon : area.polygons) {
      flight::RequestArea::Polygon& placed = named.polygons.emplace_back();
      placed.outer = ring_of(polygon.outer);
      for (const std::vector<geo::MapPoint>& hole : polygon.holes) {
        placed.holes.push_back(ring_of(hole));
      }
    }
  }
  return result;
}

}  // namespace hedgehop::planning
