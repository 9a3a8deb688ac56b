#include "preparation/surface_model.hpp"

#include <algorithm>
#include <cmath>

#include "map/source_layer.hpp"
#include "preparation/burning.hpp"
#include "preparation/obstacles.hpp"
#include "preparation/settlements.hpp"
#include "raster/segment_walk.hpp"

namespace hedgehop::preparation {
namespace {

using map::SemanticClass;
using map_sources::ObjectClass;

constexpr char kStage[] = "surface";
constexpr double kSettlementTolerance = 0.02;  // of a cell

std::uint16_t bit_of(SemanticClass value) { return static_cast<std::uint16_t>(value); }

void set_bit(std::uint16_t& bits, SemanticClass value) {
  bits = static_cast<std::uint16_t>(bits | bit_of(value));
}

double default_height_m(ObjectClass object_class, const DefaultHeights& heights) {
  switch (object_class) {
    case ObjectClass::kForest:
      return heights.forest_m;
    case ObjectClass::kTree:
      return heights.tree_m;
    case ObjectClass::kBuilding:
      return heights.building_m;
    case ObjectClass::kStructure:
      return heights.structure_m;
    case ObjectClass::kBuiltUpArea:
      return heights.built_up_area_m;
    case ObjectClass::kWater:
      return 0.0;
  }
  return 0.0;
}

SemanticClass class_bit(ObjectClass object_class) {
  switch (object_class) {
    case ObjectClass::kForest:
      return SemanticClass::kForest;
    case ObjectClass::kTree:
      return SemanticClass::kTree;
    case ObjectClass::kBuilding:
    case ObjectClass::kStructure:
      return SemanticClass::kBuilding;
    case ObjectClass::kBuiltUpArea:
      return SemanticClass::kBuiltUpArea;
    case ObjectClass::kWater:
      return SemanticClass::kWater;
  }
  return SemanticClass::kBuilding;
}

void raise_along_line(const map::OverheadLine& line, const raster::Grid<float>& upper_terrain_m,
                      SurfaceModel& model) {
  const raster::GridGeometry& g = upper_terrain_m.geometry();
  const auto top_m = [&](const map::OverheadLine::Support& support) {
    const raster::CellIndex cell = g.cell_at(support.point);
    return g.contains(cell) ? static_cast<double>(upper_terrain_m.at(cell)) + support.height_m
                            : std::numeric_limits<double>::quiet_NaN();
  };
  for (std::size_t i = 0; i + 1 < line.supports.size(); ++i) {
    const map::OverheadLine::Support& a = line.supports[i];
    const map::OverheadLine::Support& b = line.supports[i + 1];
    double top_a_m = top_m(a);
    double top_b_m = top_m(b);
    if (std::isnan(top_a_m)) {
      top_a_m = top_b_m;
    } else if (std::isnan(top_b_m)) {
      top_b_m = top_a_m;
    }
    raster::walk_segment(
        g, a.point, b.point, [&](raster::CellIndex cell, double t_in, double t_out) {
          const auto greatest = [&](double at_a, double at_b) {
            return std::max(at_a + t_in * (at_b - at_a), at_a + t_out * (at_b - at_a));
          };
          set_bit(model.semantics.at(cell), line.kind == map::LineKind::kAerialway
                                                ? SemanticClass::kObstacle
                                                : SemanticClass::kPowerLine);
          float& surface_m = model.surface_m.at(cell);
          if (std::isnan(surface_m)) {
            return;
          }
          const double above_ground_m =
              static_cast<double>(upper_terrain_m.at(cell)) + greatest(a.height_m, b.height_m);
          surface_m = std::max(surface_m, rounded_up(above_ground_m));
          if (!std::isnan(top_a_m)) {
            surface_m = std::max(surface_m, rounded_up(greatest(top_a_m, top_b_m)));
          }
        });
  }
  for (const map::OverheadLine::Support& support : line.supports) {
    if (support.is_pole && line.kind != map::LineKind::kAerialway && g.contains(support.point)) {
      set_bit(model.semantics.at(g.cell_at(support.point)), SemanticClass::kPowerPole);
    }
  }
}

double default_support_height_m(const map_sources::PowerLineObject& line,
                                const DefaultHeights& heights) {
  if (line.is_aerialway) {
    return line.is_minor ? heights.drag_lift_m : heights.aerialway_m;
  }
  return line.is_minor ? heights.minor_power_line_m : heights.power_line_m;
}

map::LineKind kind_of(const map_sources::PowerLineObject& line) {
  return line.is_aerialway ? map::LineKind::kAerialway
         : line.is_minor   ? map::LineKind::kMinorPowerLine
                           : map::LineKind::kPowerLine;
}

// Outline of a box in degrees; its sides are curved on the map.
map_sources::MapPolygon outline_on_map(const geo::GeodeticBox& box,
                                       const geo::MapProjection& projection) {
  constexpr int kSteps = 64;
  map_sources::MapPolygon polygon;
  const std::array<geo::GeodeticPosition, 5> corners = {
      geo::GeodeticPosition{box.south_rad, box.west_rad},
      geo::GeodeticPosition{box.south_rad, box.east_rad},
      geo::GeodeticPosition{box.north_rad, box.east_rad},
      geo::GeodeticPosition{box.north_rad, box.west_rad},
      geo::GeodeticPosition{box.south_rad, box.west_rad}};
  for (std::size_t side = 0; side < 4; ++side) {
    for (int i = 0; i < kSteps; ++i) {
      const double t = static_cast<double>(i) / kSteps;
      const geo::GeodeticPosition& a = corners[side];
      const geo::GeodeticPosition& b = corners[side + 1];
      polygon.outer.push_back(
          projection.to_map({a.latitude_rad + t * (b.latitude_rad - a.latitude_rad),
                             a.longitude_rad + t * (b.longitude_rad - a.longitude_rad)}));
    }
  }
  polygon.outer.push_back(polygon.outer.front());
  return polygon;
}

}  // namespace

float rounded_up(double value_m) { return static_cast<float>(std::ceil(value_m * 64.0) / 64.0); }

SurfaceModel surface_model(const raster::Grid<float>& upper_terrain_m,
                           const raster::Grid<std::uint8_t>& is_surface,
                           const map_sources::LandUse& land_use,
                           const map_sources::ObstacleList& listed,
                           const geo::MapProjection& projection, const PrepareOptions& options,
                           Observer& observer) {
  const raster::GridGeometry& g = upper_terrain_m.geometry();
  SurfaceModel model;
  model.semantics = raster::Grid<std::uint16_t>(g, 0);

  std::array<std::vector<const OGRGeometry*>, map_sources::kObjectClassCount> by_class;
  std::vector<GeometryPointer> geometries;
  std::vector<BurnItem> obstacles;
  std::vector<BurnItem> thin_obstacles;  // that no elevation holds
  std::vector<const OGRGeometry*> built_up;
  const auto add = [&](ObjectClass object_class, GeometryPointer geometry,
                       std::optional<double> tagged_m, std::optional<double> levels,
                       std::optional<double> default_m) {
    double height_m = default_m.value_or(default_height_m(object_class, options.default_heights));
    HeightCounts& counts = model.heights[static_cast<std::size_t>(object_class)];
    if (object_class != ObjectClass::kWater) {
      auto origin = map::HeightOrigin::kClassDefault;
      if (tagged_m) {
        height_m = *tagged_m;
        origin = map::HeightOrigin::kStated;
        ++counts.tagged;
      } else if (levels && object_class == ObjectClass::kBuilding) {
        height_m = *levels * options.default_heights.building_level_m;
        origin = map::HeightOrigin::kStoreys;
        ++counts.from_levels;
      } else {
        ++counts.guessed;
      }
      obstacles.push_back({geometry.get(), height_m, static_cast<std::uint8_t>(origin)});
      if (object_class == ObjectClass::kStructure) {
        thin_obstacles.push_back(obstacles.back());
      }
    }
    by_class[static_cast<std::size_t>(object_class)].push_back(geometry.get());
    if (object_class == ObjectClass::kBuilding || object_class == ObjectClass::kBuiltUpArea) {
      built_up.push_back(geometry.get());
    }
    geometries.push_back(std::move(geometry));
  };
  for (const map_sources::AreaObject& area : land_use.areas) {
    if (is_obstacle(area)) {
      continue;
    }
    add(area.object_class, geometry_of(area.polygons), area.height_m, area.levels,
        area.default_height_m);
  }
  for (const map_sources::LineObject& line : land_use.lines) {
    if (is_obstacle(line)) {
      continue;
    }
    add(line.object_class, geometry_of(line.vertices), line.height_m, std::nullopt,
        line.default_height_m);
  }

  observer.progress(kStage, 0.0, 1.0);
  raster::Grid<float> offset_m(g, 0.0F);
  model.height_origin = raster::Grid<std::uint8_t>(g, 0);
  burn_greatest(offset_m, obstacles, Touch::kAny, observer, &model.height_origin);
  if (std::any_of(is_surface.values().begin(), is_surface.values().end(),
                  [](std::uint8_t value) { return value != 0; })) {
    raster::Grid<float> thin_m(g, 0.0F);
    raster::Grid<std::uint8_t> thin_origin(g, 0);
    burn_greatest(thin_m, thin_obstacles, Touch::kAny, observer, &thin_origin);
    for (std::size_t i = 0; i < g.cell_count(); ++i) {
      if (is_surface.values()[i] != 0) {
        offset_m.values()[i] = thin_m.values()[i];
        model.height_origin.values()[i] = thin_origin.values()[i];
      }
    }
  }
  model.surface_m = upper_terrain_m;
  for (std::size_t i = 0; i < g.cell_count(); ++i) {
    float& surface_m = model.surface_m.values()[i];
    surface_m =
        rounded_up(static_cast<double>(surface_m) + static_cast<double>(offset_m.values()[i]));
  }
  for (std::size_t i = 0; i < by_class.size(); ++i) {
    burn_bit(model.semantics, by_class[i], bit_of(class_bit(static_cast<ObjectClass>(i))),
             Touch::kAny, observer);
  }
  model.opaque_m = model.surface_m;
  for (const map_sources::PowerLineObject& source : land_use.power_lines) {
    observer.check_stop();
    map::OverheadLine line{source.source_id, {}, kind_of(source)};
    for (const map_sources::PowerLineObject::Support& support : source.supports) {
      ++(support.height_m ? model.support_heights.tagged : model.support_heights.guessed);
      line.supports.push_back({support.point,
                               support.height_m.value_or(source.default_height_m.value_or(
                                   default_support_height_m(source, options.default_heights))),
                               support.is_pole});
    }
    raise_along_line(line, upper_terrain_m, model);
    model.overhead_lines.push_back(std::move(line));
  }
  observer.progress(kStage, 1.0, 1.0);

  const Settlements settlements =
      settlements_of(built_up, options.settlements, kSettlementTolerance * g.cell_m, observer);
  model.village_count = static_cast<std::int64_t>(settlements.villages.size());
  model.settlement_count = static_cast<std::int64_t>(settlements.settlements.size());
  const auto burn_pieces = [&](const std::vector<GeometryPointer>& pieces, SemanticClass value) {
    std::vector<const OGRGeometry*> pointers;
    for (const GeometryPointer& piece : pieces) {
      pointers.push_back(piece.get());
    }
    burn_bit(model.semantics, pointers, bit_of(value), Touch::kAny, observer);
  };
  // The wider ring grows out of the narrower one, which has fewer corners than the pieces.
  const auto burn_rings = [&](const std::vector<GeometryPointer>& pieces, double adequate_m,
                              double desired_m, SemanticClass adequate, SemanticClass desired) {
    const std::vector<GeometryPointer> inner = grown(pieces, adequate_m, observer);
    burn_pieces(inner, adequate);
    burn_pieces(desired_m > adequate_m ? grown(inner, desired_m - adequate_m, observer)
                                       : grown(pieces, desired_m, observer),
                desired);
  };
  const SettlementOptions& distances = options.settlements;
  burn_pieces(settlements.villages, SemanticClass::kVillage);
  burn_rings(settlements.villages, distances.village_adequate_m, distances.village_desired_m,
             SemanticClass::kVillageAdequate, SemanticClass::kVillageDesired);
  burn_pieces(settlements.settlements, SemanticClass::kSettlement);
  burn_rings(settlements.settlements, distances.settlement_adequate_m,
             distances.settlement_desired_m, SemanticClass::kSettlementAdequate,
             SemanticClass::kSettlementDesired);

  raster::Grid<std::uint16_t> mapped(g, 0);
  std::vector<GeometryPointer> boxes;
  std::vector<const OGRGeometry*> box_pointers;
  for (const geo::GeodeticBox& box : land_use.mapped) {
    boxes.push_back(geometry_of({outline_on_map(box, projection)}));
    box_pointers.push_back(boxes.back().get());
  }
  burn_bit(mapped, box_pointers, 1, Touch::kCentre, observer);
  for (std::size_t i = 0; i < g.cell_count(); ++i) {
    if (mapped.values()[i] == 0) {
      model.semantics.values()[i] = bit_of(SemanticClass::kUnmapped);
    }
  }
  model.obstacles =
      obstacles_of(land_use, listed, upper_terrain_m, options, model.obstacle_heights);
  raise_obstacles(model.obstacles, upper_terrain_m, model.surface_m, model.semantics);
  for (std::size_t i = 0; i < g.cell_count(); ++i) {
    if (model.surface_m.values()[i] > model.opaque_m.values()[i]) {
      model.height_origin.values()[i] = static_cast<std::uint8_t>(map::HeightOrigin::kThin);
    }
  }
  return model;
}

}  // namespace hedgehop::preparation
