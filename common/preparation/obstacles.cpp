#include "preparation/obstacles.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace hedgehop::preparation {
namespace {

using map::ObstacleKind;
using map_sources::ObjectClass;
using map_sources::StructureKind;

// A structure with a wider outline than this is no obstacle but an area.
constexpr double kOutlineRadiusMax_m = 100.0;

ObstacleKind kind_of(StructureKind kind) {
  switch (kind) {
    case StructureKind::kMast:
      return ObstacleKind::kMast;
    case StructureKind::kTower:
      return ObstacleKind::kTower;
    case StructureKind::kChimney:
      return ObstacleKind::kChimney;
    case StructureKind::kWindTurbine:
      return ObstacleKind::kWindTurbine;
    case StructureKind::kStructure:
      return ObstacleKind::kStructure;
    case StructureKind::kOther:
      return ObstacleKind::kOther;
  }
  return ObstacleKind::kOther;
}

struct Disc {
  geo::MapPoint centre;
  double radius_m = 0.0;
};

// A disc that holds every corner: around the middle of their bounding box.
Disc disc_around(const std::vector<map_sources::MapPolygon>& polygons) {
  double west_m = 1e18, south_m = 1e18, east_m = -1e18, north_m = -1e18;
  const auto for_each_corner = [&](const auto& visit) {
    for (const map_sources::MapPolygon& polygon : polygons) {
      for (const geo::MapPoint& corner : polygon.outer) {
        visit(corner);
      }
    }
  };
  for_each_corner([&](const geo::MapPoint& corner) {
    west_m = std::min(west_m, corner.x_m);
    east_m = std::max(east_m, corner.x_m);
    south_m = std::min(south_m, corner.y_m);
    north_m = std::max(north_m, corner.y_m);
  });
  Disc disc{{0.5 * (west_m + east_m), 0.5 * (south_m + north_m)}, 0.0};
  for_each_corner([&](const geo::MapPoint& corner) {
    const double dx_m = corner.x_m - disc.centre.x_m;
    const double dy_m = corner.y_m - disc.centre.y_m;
    disc.radius_m = std::max(disc.radius_m, std::sqrt(dx_m * dx_m + dy_m * dy_m));
  });
  return disc;
}

double ground_m(const raster::Grid<float>& terrain_m, const geo::MapPoint& point) {
  const raster::GridGeometry& g = terrain_m.geometry();
  return g.contains(point) ? static_cast<double>(terrain_m.at(g.cell_at(point)))
                           : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace

bool is_obstacle(const map_sources::AreaObject& area) {
  return area.object_class == ObjectClass::kStructure &&
         disc_around(area.polygons).radius_m <= kOutlineRadiusMax_m;
}

bool is_obstacle(const map_sources::LineObject& object) {
  return object.object_class == ObjectClass::kStructure && object.vertices.size() == 1;
}

double default_height_m(StructureKind kind, const DefaultHeights& heights) {
  switch (kind) {
    case StructureKind::kMast:
      return heights.mast_m;
    case StructureKind::kTower:
      return heights.tower_m;
    case StructureKind::kChimney:
      return heights.chimney_m;
    case StructureKind::kWindTurbine:
      return heights.wind_turbine_m;
    case StructureKind::kStructure:
    case StructureKind::kOther:
      return heights.structure_m;
  }
  return heights.structure_m;
}

std::vector<map::Obstacle> obstacles_of(const map_sources::LandUse& land_use,
                                        const map_sources::ObstacleList& listed,
                                        const raster::Grid<float>& upper_terrain_m,
                                        const PrepareOptions& options, HeightCounts& counts) {
  std::vector<map::Obstacle> obstacles;
  const auto add = [&](std::int64_t source_id, StructureKind kind, const Disc& disc,
                       std::optional<double> tagged_m, std::optional<double> default_m) {
    ++(tagged_m ? counts.tagged : counts.guessed);
    map::Obstacle obstacle;
    obstacle.source_id = source_id;
    obstacle.kind = kind_of(kind);
    obstacle.point = disc.centre;
    obstacle.radius_m = disc.radius_m + options.obstacles.safety_radius_m;
    obstacle.height_m =
        tagged_m.value_or(default_m.value_or(default_height_m(kind, options.default_heights)));
    obstacle.top_m = ground_m(upper_terrain_m, disc.centre) + obstacle.height_m;
    obstacles.push_back(std::move(obstacle));
  };
  for (const map_sources::AreaObject& area : land_use.areas) {
    if (is_obstacle(area)) {
      add(area.source_id, area.structure_kind, disc_around(area.polygons), area.height_m,
          area.default_height_m);
    }
  }
  for (const map_sources::LineObject& object : land_use.lines) {
    if (is_obstacle(object)) {
      const double rotor_m = object.structure_kind == StructureKind::kWindTurbine
                                 ? options.obstacles.wind_turbine_radius_m
                                 : 0.0;
      add(object.source_id, object.structure_kind,
          {object.vertices.front(), object.radius_m.value_or(rotor_m)}, object.height_m,
          object.default_height_m);
    }
  }

  double lowest_m = std::numeric_limits<double>::infinity();
  for (const float height_m : upper_terrain_m.values()) {
    lowest_m = std::fmin(lowest_m, static_cast<double>(height_m));
  }
  for (const map_sources::ObstacleObject& object : listed.obstacles) {
    const map_sources::ObstacleRecord& record = object.record;
    const double vertical_m =
        record.vertical_error_m.value_or(options.obstacles.unknown_vertical_error_m);
    map::Obstacle obstacle;
    obstacle.source_id = record.line;
    obstacle.kind = kind_of(record.kind);
    obstacle.name = record.name;
    obstacle.point = object.point;
    obstacle.radius_m =
        record.radius_m + options.obstacles.safety_radius_m +
        record.horizontal_error_m.value_or(options.obstacles.unknown_horizontal_error_m);
    const double terrain_m = ground_m(upper_terrain_m, object.point);
    if (record.height_m) {
      obstacle.height_m = *record.height_m + vertical_m;
    } else {
      const double below_m = std::isnan(terrain_m) ? lowest_m : terrain_m;
      obstacle.height_m =
          std::isfinite(below_m) ? std::max(*record.top_m + vertical_m - below_m, 0.0) : 0.0;
    }
    obstacle.top_m =
        record.height_m ? terrain_m + obstacle.height_m : std::numeric_limits<double>::quiet_NaN();
    if (record.top_m) {
      obstacle.top_m = std::fmax(obstacle.top_m, *record.top_m + vertical_m);
    }
    ++counts.tagged;
    obstacles.push_back(std::move(obstacle));
  }
  return obstacles;
}

void raise_obstacles(const std::vector<map::Obstacle>& obstacles,
                     const raster::Grid<float>& upper_terrain_m, raster::Grid<float>& surface_m,
                     raster::Grid<std::uint16_t>& semantics) {
  for (const map::Obstacle& obstacle : obstacles) {
    for_each_touched_cell(
        surface_m.geometry(), obstacle.point, obstacle.radius_m, [&](raster::CellIndex cell) {
          semantics.at(cell) = static_cast<std::uint16_t>(
              semantics.at(cell) | static_cast<unsigned>(map::SemanticClass::kObstacle));
          float& here_m = surface_m.at(cell);
          if (std::isnan(here_m)) {
            return;
          }
          const double above_ground_m =
              static_cast<double>(upper_terrain_m.at(cell)) + obstacle.height_m;
          here_m = std::max(here_m, rounded_up(std::fmax(above_ground_m, obstacle.top_m)));
        });
  }
}

}  // namespace hedgehop::preparation
