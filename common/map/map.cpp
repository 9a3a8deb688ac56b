#include "map/map.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <type_traits>

#include "base/errors.hpp"
#include "map/patch.hpp"

namespace hedgehop::map {
namespace {

template <typename T>
void update(Hasher128& hasher, const T& value) {
  static_assert(std::is_arithmetic_v<T>);
  hasher.update(std::as_bytes(std::span<const T, 1>(&value, 1)));
}

void update_text(Hasher128& hasher, std::string_view text) {
  update(hasher, static_cast<std::uint64_t>(text.size()));
  hasher.update(text);
}

void update(Hasher128& hasher, const geo::MapPoint& point) {
  update(hasher, point.x_m);
  update(hasher, point.y_m);
}

void update_ring(Hasher128& hasher, const std::vector<geo::MapPoint>& ring) {
  update(hasher, static_cast<std::uint64_t>(ring.size()));
  for (const geo::MapPoint& point : ring) {
    update(hasher, point);
  }
}

// Rows are hashed as they lie in memory: little-endian, south to north. NaN has one bit pattern
// here.
void update_heights(Hasher128& hasher, const raster::Grid<float>& grid) {
  std::vector<float> row(static_cast<std::size_t>(grid.columns()));
  for (int r = 0; r < grid.rows(); ++r) {
    for (int c = 0; c < grid.columns(); ++c) {
      const float value = grid.at(c, r);
      row[static_cast<std::size_t>(c)] =
          std::isnan(value) ? std::numeric_limits<float>::quiet_NaN() : value + 0.0F;
    }
    hasher.update(std::as_bytes(std::span<const float>(row)));
  }
}

void update_bits(Hasher128& hasher, const raster::Grid<std::uint16_t>& grid) {
  hasher.update(std::as_bytes(std::span<const std::uint16_t>(grid.values())));
}

}  // namespace

const std::vector<SemanticName>& semantic_names() {
  static const std::vector<SemanticName> kNames = {
      {SemanticClass::kForest, "forest"},
      {SemanticClass::kTree, "tree"},
      {SemanticClass::kBuilding, "building"},
      {SemanticClass::kBuiltUpArea, "built_up_area"},
      {SemanticClass::kVillage, "village"},
      {SemanticClass::kVillageAdequate, "village_adequate"},
      {SemanticClass::kVillageDesired, "village_desired"},
      {SemanticClass::kSettlement, "settlement"},
      {SemanticClass::kSettlementAdequate, "settlement_adequate"},
      {SemanticClass::kSettlementDesired, "settlement_desired"},
      {SemanticClass::kPowerLine, "power_line"},
      {SemanticClass::kWater, "water"},
      {SemanticClass::kPowerPole, "power_pole"},
      {SemanticClass::kObstacle, "obstacle"},
      {SemanticClass::kVisibilityPartial, "visibility_partial"},
      {SemanticClass::kUnmapped, "unmapped"},
  };
  return kNames;
}

bool covers_height(const Map& map, double height_m) {
  constexpr double kSame_m = 1e-6;
  double low_m = map.reference_height_m;
  double high_m = map.reference_height_m;
  for (const VisibilityBand& band : map.further_visibility) {
    low_m = std::min(low_m, band.height_m);
    high_m = std::max(high_m, band.height_m);
  }
  return height_m >= low_m - kSame_m && height_m <= high_m + kSame_m;
}

const char* name_of(LineKind kind) {
  switch (kind) {
    case LineKind::kPowerLine:
      return "power_line";
    case LineKind::kMinorPowerLine:
      return "minor_power_line";
    case LineKind::kAerialway:
      return "aerialway";
  }
  HEDGEHOP_ASSERT(!"a kind of line without a name");
  return "";
}

const char* name_of(ObstacleKind kind) {
  switch (kind) {
    case ObstacleKind::kMast:
      return "mast";
    case ObstacleKind::kTower:
      return "tower";
    case ObstacleKind::kChimney:
      return "chimney";
    case ObstacleKind::kWindTurbine:
      return "wind_turbine";
    case ObstacleKind::kStructure:
      return "structure";
    case ObstacleKind::kOther:
      return "other";
  }
  HEDGEHOP_ASSERT(!"a kind of obstacle without a name");
  return "";
}

const char* name_of(PatchKind kind) {
  switch (kind) {
    case PatchKind::kObstacle:
      return "obstacle";
    case PatchKind::kThreat:
      return "threat";
    case PatchKind::kArea:
      return "area";
  }
  HEDGEHOP_ASSERT(!"a kind of patch without a name");
  return "";
}

bool Patch::operator==(const Patch& other) const {
  const auto is_same = [](const geo::MapPoint& a, const geo::MapPoint& b) {
    return a.x_m == b.x_m && a.y_m == b.y_m;
  };
  return id == other.id && kind == other.kind && is_same(centre, other.centre) &&
         radius_m == other.radius_m && height_m == other.height_m && top_m == other.top_m &&
         is_hard == other.is_hard && floor == other.floor && ceiling == other.ceiling &&
         std::equal(outline.begin(), outline.end(), other.outline.begin(), other.outline.end(),
                    is_same) &&
         label == other.label;
}

namespace {

void update_without_threats(Hasher128& hasher, const Map& map) {
  update_text(hasher, "hedgehop map 2");
  update(hasher, map.geometry.west_m);
  update(hasher, map.geometry.south_m);
  update(hasher, map.geometry.cell_m);
  update(hasher, static_cast<std::int64_t>(map.geometry.columns));
  update(hasher, static_cast<std::int64_t>(map.geometry.rows));
  update_text(hasher, map.crs_wkt);
  update_text(hasher, map.vertical_datum);
  update(hasher, map.reference_height_m);
  update(hasher, map.visibility_radius_m);
  update_heights(hasher, map.terrain_m);
  update_heights(hasher, map.surface_m);
  update_bits(hasher, map.semantics);
  update_bits(hasher, map.visibility);
  update(hasher, static_cast<std::uint64_t>(map.overhead_lines.size()));
  for (const OverheadLine& line : map.overhead_lines) {
    update(hasher, line.source_id);
    update(hasher, static_cast<std::uint8_t>(line.kind));
    update(hasher, static_cast<std::uint64_t>(line.supports.size()));
    for (const OverheadLine::Support& support : line.supports) {
      update(hasher, support.point);
      update(hasher, support.height_m);
      update(hasher, static_cast<std::uint8_t>(support.is_pole));
    }
  }
  update(hasher, static_cast<std::uint64_t>(map.obstacles.size()));
  for (const Obstacle& obstacle : map.obstacles) {
    update(hasher, obstacle.source_id);
    update(hasher, static_cast<std::uint8_t>(obstacle.kind));
    update_text(hasher, obstacle.name);
    update(hasher, obstacle.point);
    update(hasher, obstacle.radius_m);
    update(hasher, obstacle.height_m);
    update(hasher,
           std::isnan(obstacle.top_m) ? std::numeric_limits<double>::quiet_NaN() : obstacle.top_m);
  }
  update(hasher, static_cast<std::uint64_t>(map.areas.size()));
  for (const Area& area : map.areas) {
    update_text(hasher, area.name);
    update_text(hasher, area.kind);
    update(hasher, static_cast<std::uint8_t>(area.is_hard));
    for (const AreaLimit& limit : {area.floor, area.ceiling}) {
      update(hasher, limit.value_m);
      update(hasher, static_cast<std::uint8_t>(limit.reference));
    }
    update(hasher, static_cast<std::uint64_t>(area.polygons.size()));
    for (const Area::Polygon& polygon : area.polygons) {
      update_ring(hasher, polygon.outer);
      update(hasher, static_cast<std::uint64_t>(polygon.holes.size()));
      for (const auto& hole : polygon.holes) {
        update_ring(hasher, hole);
      }
    }
  }
  update(hasher, static_cast<std::uint64_t>(map.attributions.size()));
  for (const std::string& line : map.attributions) {
    update_text(hasher, line);
  }
  update_text(hasher, map.label);
  // What most maps do not have leaves their hash as it was before there was such a thing.
  for (const VisibilityBand& band : map.further_visibility) {
    update_text(hasher, "visibility band");
    update(hasher, band.height_m);
    update_bits(hasher, band.share);
  }
}

}  // namespace

Hash128 map_hash_without_threats(const Map& map) {
  Hasher128 hasher;
  update_without_threats(hasher, map);
  return hasher.digest();
}

Hash128 map_hash(const Map& map) {
  Hasher128 hasher;
  update_without_threats(hasher, map);
  for (const HeightLayer& threat : map.threats) {
    update_text(hasher, "threat");
    update_text(hasher, threat.name);
    update_heights(hasher, threat.height_m);
  }
  return hasher.digest();
}

namespace {

void check(bool condition, const std::string& what) {
  if (!condition) {
    throw DataError("map: " + what, "prepare the map again");
  }
}

}  // namespace

void validate_threats(const Map& map) {
  for (const HeightLayer& threat : map.threats) {
    const std::string who = "the layer of observer '" + threat.name + "' ";
    check(threat.height_m.geometry() == map.geometry, who + "has another geometry than the map");
    for (int row = 0; row < map.geometry.rows; ++row) {
      for (int column = 0; column < map.geometry.columns; ++column) {
        const float height_m = threat.height_m.at(column, row);
        if (height_m < 0.0F || std::isinf(height_m)) {
          std::ostringstream what;
          what << who << "holds " << height_m << " m at column " << column << ", row " << row
               << ", which is no height";
          check(false, what.str());
        }
      }
    }
  }
}

void validate(const Map& map) {
  const raster::GridGeometry& geometry = map.geometry;
  check(geometry.columns > 0 && geometry.rows > 0, "has no cells");
  check(std::isfinite(geometry.cell_m) && geometry.cell_m > 0.0, "cell size is not positive");
  check(std::isfinite(geometry.west_m) && std::isfinite(geometry.south_m), "origin is not finite");
  check(map.terrain_m.geometry() == geometry, "layer terrain has another geometry than the map");
  check(map.surface_m.geometry() == geometry, "layer surface has another geometry than the map");
  check(map.semantics.geometry() == geometry, "layer semantics has another geometry than the map");
  check(map.visibility.geometry() == geometry,
        "layer visibility has another geometry than the map");
  for (std::size_t i = 0; i < map.further_visibility.size(); ++i) {
    const VisibilityBand& band = map.further_visibility[i];
    check(band.share.geometry() == geometry,
          "a further height of layer visibility has another geometry than the map");
    check(std::isfinite(band.height_m) && band.height_m >= 0.0 &&
              band.height_m != map.reference_height_m &&
              (i == 0 || band.height_m > map.further_visibility[i - 1].height_m),
          "the further heights of layer visibility are not ascending, or one is the reference "
          "height");
  }
  validate_threats(map);
  for (int row = 0; row < geometry.rows; ++row) {
    for (int column = 0; column < geometry.columns; ++column) {
      const float terrain_m = map.terrain_m.at(column, row);
      const float surface_m = map.surface_m.at(column, row);
      if (std::isnan(terrain_m) != std::isnan(surface_m) || surface_m < terrain_m ||
          std::isinf(terrain_m) || std::isinf(surface_m)) {
        std::ostringstream what;
        what << "at column " << column << ", row " << row << " the surface (" << surface_m
             << " m) lies below the terrain (" << terrain_m << " m) or is not finite";
        check(false, what.str());
      }
    }
  }
  const auto is_place = [](const geo::MapPoint& point) {
    return std::fabs(point.x_m) < 1e9 && std::fabs(point.y_m) < 1e9;  // false for NaN
  };
  const auto is_size = [](double value) { return value >= 0.0 && value < 1e6; };
  for (const OverheadLine& line : map.overhead_lines) {
    check(line.supports.size() >= 2, "an overhead line has fewer than two supports");
    for (const OverheadLine::Support& support : line.supports) {
      check(is_place(support.point) && is_size(support.height_m),
            "a support of an overhead line has no place or height");
    }
  }
  for (const Obstacle& obstacle : map.obstacles) {
    check(is_place(obstacle.point) && is_size(obstacle.radius_m) && is_size(obstacle.height_m) &&
              !std::isinf(obstacle.top_m),
          "obstacle '" + obstacle.name + "' has no place, radius or height");
  }
  for (const Area& area : map.areas) {
    const std::string who = "area '" + area.name + "' ";
    check(!area.polygons.empty(), who + "has no polygon");
    check(!std::isnan(area.floor.value_m) && !std::isnan(area.ceiling.value_m) &&
              (area.floor.reference != area.ceiling.reference ||
               area.floor.value_m <= area.ceiling.value_m),
          who + "ends below its beginning");
    const auto check_ring = [&](const std::vector<geo::MapPoint>& ring) {
      check(ring.size() >= 4 && ring.front().x_m == ring.back().x_m &&
                ring.front().y_m == ring.back().y_m,
            who + "has a ring that is not closed");
      check(std::all_of(ring.begin(), ring.end(), is_place), who + "has a corner without a place");
    };
    for (const Area::Polygon& polygon : area.polygons) {
      check_ring(polygon.outer);
      std::for_each(polygon.holes.begin(), polygon.holes.end(), check_ring);
    }
  }
  check(map.hash == map_hash(map), "content does not match its hash " + map.hash.hex());
}

}  // namespace hedgehop::map
