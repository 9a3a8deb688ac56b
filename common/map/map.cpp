#include "map/map.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <type_traits>

#include "base/errors.hpp"

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

Hash128 map_hash(const Map& map) {
  Hasher128 hasher;
  update_text(hasher, "hedgehop map 1");
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
  update(hasher, static_cast<std::uint64_t>(map.power_lines.size()));
  for (const PowerLine& line : map.power_lines) {
    update(hasher, line.source_id);
    update(hasher, static_cast<std::uint64_t>(line.poles.size()));
    for (const PowerLine::Pole& pole : line.poles) {
      update(hasher, pole.point.x_m);
      update(hasher, pole.point.y_m);
      update(hasher, pole.height_m);
    }
  }
  update(hasher, static_cast<std::uint64_t>(map.attributions.size()));
  for (const std::string& line : map.attributions) {
    update_text(hasher, line);
  }
  update_text(hasher, map.label);
  // Maps with one height keep the hash that they had before there were more.
  for (const VisibilityBand& band : map.further_visibility) {
    update_text(hasher, "visibility band");
    update(hasher, band.height_m);
    update_bits(hasher, band.share);
  }
  return hasher.digest();
}

void validate(const Map& map) {
  const auto check = [](bool condition, const std::string& what) {
    if (!condition) {
      throw DataError("map: " + what, "prepare the map again");
    }
  };
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
  for (const PowerLine& line : map.power_lines) {
    check(line.poles.size() >= 2, "a power line has fewer than two supports");
  }
  check(map.hash == map_hash(map), "content does not match its hash " + map.hash.hex());
}

}  // namespace hedgehop::map
