#include "planning/request_areas.hpp"

#include "base/errors.hpp"
#include "map/map_bundle.hpp"
#include "planning/map_for_plan.hpp"

namespace hedgehop::planning {
namespace {

using Reference = map::AreaLimit::Reference;

map::AreaLimit limit_of(const flight::RequestAreaEnd& end) {
  return {end.value_m, end.is_above_ground ? Reference::kAboveGround : Reference::kAmsl};
}

flight::RequestAreaEnd end_of(const map::AreaLimit& limit) {
  return {limit.value_m, limit.reference == Reference::kAboveGround};
}

// Name, kind, hardness and polygons, with each corner put elsewhere.
template <typename To, typename From, typename Place>
To area_elsewhere(const From& area, const Place& place) {
  To result;
  result.name = area.name;
  result.kind = area.kind;
  result.is_hard = area.is_hard;
  const auto ring_of = [&place](const auto& corners, auto& ring) {
    for (const auto& corner : corners) {
      ring.push_back(place(corner));
    }
  };
  for (const auto& polygon : area.polygons) {
    auto& placed = result.polygons.emplace_back();
    ring_of(polygon.outer, placed.outer);
    for (const auto& hole : polygon.holes) {
      ring_of(hole, placed.holes.emplace_back());
    }
  }
  return result;
}

}  // namespace

map::Map map_with_areas(map::Map map, const std::vector<flight::RequestArea>& areas) {
  if (areas.empty()) {
    return map;
  }
  const geo::MapProjection projection(map.crs_wkt);
  for (const flight::RequestArea& given : areas) {
    auto area = area_elsewhere<map::Area>(
        given, [&](const geo::GeodeticPosition& corner) { return projection.to_map(corner); });
    area.floor = limit_of(given.floor);
    area.ceiling = limit_of(given.ceiling);
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
  map::Map map = map::read_map_bundle(bundle);
  if (weighs_threats(plan.route_plan.config_text)) {
    map = with_threats(std::move(map), bundle);
  }
  return map_of_plan(std::move(map), plan, plan_name, bundle.string());
}

std::vector<flight::RequestArea> request_areas_of(const std::vector<map::Area>& areas,
                                                  const geo::MapProjection& projection) {
  std::vector<flight::RequestArea> result;
  for (const map::Area& area : areas) {
    result.push_back(area_elsewhere<flight::RequestArea>(
        area, [&](const geo::MapPoint& corner) { return projection.to_geodetic(corner); }));
    result.back().floor = end_of(area.floor);
    result.back().ceiling = end_of(area.ceiling);
  }
  return result;
}

}  // namespace hedgehop::planning
