#include "preparation/map_patches.hpp"

#include <algorithm>
#include <cmath>

#include "preparation/obstacles.hpp"
#include "preparation/threat_layer.hpp"

namespace hedgehop::preparation {
namespace {

using geo::MapPoint;
using map::PatchKind;
using map::SemanticClass;

constexpr auto kSeenByAll = static_cast<std::uint16_t>(map::kVisibilityScale);

// Twice the signed area of the triangle.
double turn(const MapPoint& a, const MapPoint& b, const MapPoint& c) {
  return (b.x_m - a.x_m) * (c.y_m - a.y_m) - (b.y_m - a.y_m) * (c.x_m - a.x_m);
}

bool is_between(const MapPoint& a, const MapPoint& b, const MapPoint& p) {
  return std::fmin(a.x_m, b.x_m) <= p.x_m && p.x_m <= std::fmax(a.x_m, b.x_m) &&
         std::fmin(a.y_m, b.y_m) <= p.y_m && p.y_m <= std::fmax(a.y_m, b.y_m);
}

bool do_meet(const MapPoint& a, const MapPoint& b, const MapPoint& c, const MapPoint& d) {
  const double c_side = turn(a, b, c);
  const double d_side = turn(a, b, d);
  const double a_side = turn(c, d, a);
  const double b_side = turn(c, d, b);
  if (((c_side > 0.0 && d_side < 0.0) || (c_side < 0.0 && d_side > 0.0)) &&
      ((a_side > 0.0 && b_side < 0.0) || (a_side < 0.0 && b_side > 0.0))) {
    return true;
  }
  return (c_side == 0.0 && is_between(a, b, c)) || (d_side == 0.0 && is_between(a, b, d)) ||
         (a_side == 0.0 && is_between(c, d, a)) || (b_side == 0.0 && is_between(c, d, b));
}

bool crosses_itself(const std::vector<MapPoint>& ring) {
  const std::size_t n = ring.size();
  for (std::size_t i = 0; i < n; ++i) {
    const MapPoint& a = ring[i];
    const MapPoint& b = ring[(i + 1) % n];
    const MapPoint& c = ring[(i + 2) % n];
    if ((a.x_m == b.x_m && a.y_m == b.y_m) ||
        (turn(a, b, c) == 0.0 &&
         (b.x_m - a.x_m) * (c.x_m - b.x_m) + (b.y_m - a.y_m) * (c.y_m - b.y_m) <= 0.0)) {
      return true;  // no length, or back the way it came
    }
    for (std::size_t j = i + 2; j < n; ++j) {
      if ((j + 1) % n != i && do_meet(a, b, ring[j], ring[(j + 1) % n])) {
        return true;
      }
    }
  }
  return false;
}

// Above the ground, which must be known.
double height_m(const raster::Grid<float>& ground_m, const map::Patch& patch) {
  const auto here_m = static_cast<double>(ground_m.at(ground_m.geometry().cell_at(patch.centre)));
  const double from_top_m = patch.top_m ? *patch.top_m - here_m : patch.height_m.value_or(0.0);
  return std::fmax(std::fmax(from_top_m, patch.height_m.value_or(from_top_m)), 0.0);
}

std::vector<raster::Grid<std::uint16_t>*> visibility_layers(map::Map& map) {
  std::vector<raster::Grid<std::uint16_t>*> layers = {&map.visibility};
  for (map::VisibilityBand& band : map.further_visibility) {
    layers.push_back(&band.share);
  }
  return layers;
}

void make_seen(raster::Grid<std::uint16_t>& layer, raster::CellIndex cell) {
  std::uint16_t& share = layer.at(cell);
  if (share != map::kVisibilityUnknown) {
    share = kSeenByAll;
  }
}

// The map does not keep the highest ground of a cell; no cell's surface is below it.
void add_obstacle(const map::Patch& patch, const raster::Grid<float>& ground_m, map::Map& map) {
  map::Obstacle obstacle;
  obstacle.source_id = patch.id;
  obstacle.name = patch.label;
  obstacle.point = patch.centre;
  obstacle.radius_m = patch.radius_m;
  obstacle.height_m = height_m(ground_m, patch);
  obstacle.top_m =
      static_cast<double>(ground_m.at(map.geometry.cell_at(patch.centre))) + obstacle.height_m;
  if (patch.top_m) {
    obstacle.top_m = std::fmax(obstacle.top_m, *patch.top_m);
  }
  const auto layers = visibility_layers(map);
  std::vector<std::pair<raster::CellIndex, float>> before;
  for_each_touched_cell(
      map.geometry, obstacle.point, obstacle.radius_m,
      [&](raster::CellIndex cell) { before.emplace_back(cell, map.surface_m.at(cell)); });
  raise_obstacles({obstacle}, ground_m, map.surface_m, map.semantics);
  for (const auto& [cell, surface_m] : before) {
    if (map.surface_m.at(cell) > surface_m) {  // false for NaN
      for (raster::Grid<std::uint16_t>* layer : layers) {
        make_seen(*layer, cell);
      }
      for (map::HeightLayer& threat : map.threats) {  // at the altitude that it was
        float& lowest_m = threat.height_m.at(cell);
        lowest_m -= map.surface_m.at(cell) - surface_m;
        lowest_m = lowest_m < 0.0F ? 0.0F : lowest_m;
      }
    }
  }
  map.obstacles.push_back(std::move(obstacle));
}

// What hides: the surface, or the ground where wires or obstacles may have raised it.
raster::Grid<float> opaque_m(const map::Map& map) {
  constexpr auto kThin = static_cast<std::uint16_t>(SemanticClass::kPowerLine) |
                         static_cast<std::uint16_t>(SemanticClass::kPowerPole) |
                         static_cast<std::uint16_t>(SemanticClass::kObstacle);
  raster::Grid<float> result = map.surface_m;
  for (std::size_t i = 0; i < result.values().size(); ++i) {
    if ((map.semantics.values()[i] & kThin) != 0) {
      result.values()[i] = map.terrain_m.values()[i];
    }
  }
  return result;
}

void add_threat(const map::Patch& patch, const raster::Grid<float>& opaque,
                const PatchOptions& options, Observer& observer, map::Map& map) {
  const raster::Grid<float> lowest_m = lowest_seen_height(
      VisibilityGround{.opaque_m = opaque, .surface_m = map.surface_m}, map.terrain_m, patch.centre,
      height_m(map.terrain_m, patch), patch.radius_m, options.drop_1pm, options.threads, observer);
  if (!map.threats.empty()) {
    map.threats.push_back({patch.label, lowest_m});
  }
  const auto layers = visibility_layers(map);
  for (std::size_t layer = 0; layer < layers.size(); ++layer) {
    const double at_m =
        layer == 0 ? map.reference_height_m : map.further_visibility[layer - 1].height_m;
    for (int row = 0; row < map.geometry.rows; ++row) {
      for (int column = 0; column < map.geometry.columns; ++column) {
        if (static_cast<double>(lowest_m.at(column, row)) <= at_m) {  // false for NaN
          make_seen(*layers[layer], {column, row});
        }
      }
    }
  }
}

void add_area(const map::Patch& patch, map::Map& map) {
  map::Area area;
  area.name = patch.label;
  area.kind = patch.is_hard ? "no_fly" : "avoid";
  area.is_hard = patch.is_hard;
  area.floor = patch.floor;
  area.ceiling = patch.ceiling;
  map::Area::Polygon& polygon = area.polygons.emplace_back();
  polygon.outer = patch.outline;
  polygon.outer.push_back(patch.outline.front());
  map.areas.push_back(std::move(area));
}

}  // namespace

std::string reason_against(const map::Map& base, const map::Patch& patch) {
  const raster::GridGeometry& g = base.geometry;
  if (patch.kind == PatchKind::kArea) {
    if (patch.outline.size() < 3) {
      return "its outline has fewer than 3 corners";
    }
    if (crosses_itself(patch.outline)) {
      return "its outline crosses itself or goes back the way it came";
    }
    if (patch.floor.reference == patch.ceiling.reference &&
        !(patch.floor.value_m <= patch.ceiling.value_m)) {
      return "it ends below its beginning";
    }
    double west_m = patch.outline.front().x_m, east_m = west_m;
    double south_m = patch.outline.front().y_m, north_m = south_m;
    for (const MapPoint& corner : patch.outline) {
      west_m = std::fmin(west_m, corner.x_m);
      east_m = std::fmax(east_m, corner.x_m);
      south_m = std::fmin(south_m, corner.y_m);
      north_m = std::fmax(north_m, corner.y_m);
    }
    if (west_m > g.east_m() || east_m < g.west_m || south_m > g.north_m() || north_m < g.south_m) {
      return "it lies outside the map";
    }
    return {};
  }
  if (!patch.height_m && !patch.top_m) {
    return "neither a height above ground nor an altitude is stated";
  }
  if (!g.contains(patch.centre)) {
    return "its centre lies outside the map";
  }
  if (std::isnan(base.terrain_m.at(g.cell_at(patch.centre)))) {
    return "the ground at its centre is unknown";
  }
  return {};
}

map::Map patched_map(const map::Map& base, std::vector<map::Patch> patches,
                     const PatchOptions& options, Observer& observer) {
  map::Map map = base;
  if (patches.empty()) {
    return map;
  }
  std::sort(patches.begin(), patches.end(),
            [](const map::Patch& a, const map::Patch& b) { return a.id < b.id; });
  for (const map::Patch& patch : patches) {
    if (patch.kind == PatchKind::kObstacle) {
      add_obstacle(patch, base.surface_m, map);
    } else if (patch.kind == PatchKind::kArea) {
      add_area(patch, map);
    }
  }
  // After all obstacles, for heights are measured from what they raise.
  const bool has_threats = std::any_of(patches.begin(), patches.end(), [](const auto& patch) {
    return patch.kind == PatchKind::kThreat;
  });
  if (has_threats) {
    const raster::Grid<float> opaque = opaque_m(map);
    for (const map::Patch& patch : patches) {
      if (patch.kind == PatchKind::kThreat) {
        add_threat(patch, opaque, options, observer, map);
      }
    }
  }
  map.hash = map::map_hash(map);
  return map;
}

}  // namespace hedgehop::preparation
