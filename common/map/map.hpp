#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "base/hash.hpp"
#include "geo/map_projection.hpp"
#include "raster/grid.hpp"

namespace hedgehop::map {

/// Bits of the semantics layer. Bits overlap freely; what a combination costs stands in the config.
enum class SemanticClass : std::uint16_t {
  kForest = 1U << 0,
  kTree = 1U << 1,  // single trees and rows of trees
  kBuilding = 1U << 2,
  kBuiltUpArea = 1U << 3,      // residential, commercial, industrial land use as mapped
  kVillage = 1U << 4,          // small settlement or stand-alone building, after grow-union-shrink
  kVillageAdequate = 1U << 5,  // within the adequate distance of one, 30 m in the paper
  kVillageDesired = 1U << 6,   // within the desired distance of one, 60 m
  kSettlement = 1U << 7,       // larger settlement
  kSettlementAdequate = 1U << 8,  // 200 m
  kSettlementDesired = 1U << 9,   // 400 m
  kPowerLine = 1U << 10,          // a power line passes through the cell
  kWater = 1U << 11,
  kVisibilityPartial = 1U << 14,  // part of the ground within the radius of visibility is unknown
  kUnmapped = 1U << 15,  // no land-use source covers the cell: unknown, costs as configured
};

struct SemanticName {
  SemanticClass bit;
  std::string_view name;  // as used in config and in files: "settlement_adequate"
};
/// Every class, in the order of the bits.
const std::vector<SemanticName>& semantic_names();

/// Visibility is stored as share x 65534, rounded; 65535 means unknown.
inline constexpr std::uint16_t kVisibilityUnknown = 65535;
inline constexpr double kVisibilityScale = 65534.0;

/// An overhead line as a chain of supports.
struct PowerLine {
  struct Pole {
    geo::MapPoint point;
    double height_m = 0.0;  // above the terrain
  };
  std::int64_t source_id = 0;
  std::vector<Pole> poles;  // at least 2
};

/// Visibility at another height than the reference height; together they are the exposure volume.
struct VisibilityBand {
  double height_m = 0.0;              // above the surface
  raster::Grid<std::uint16_t> share;  // as Map::visibility
};

/// Everything planners need to know about a region. Layers share one geometry.
struct Map {
  raster::GridGeometry geometry;
  std::string crs_wkt;
  std::string vertical_datum;     // "EGM96" for example; heights are AMSL in it
  raster::Grid<float> terrain_m;  // ground elevation, NaN = void
  raster::Grid<float> surface_m;  // terrain plus trees and buildings, >= terrain, NaN = void
  raster::Grid<std::uint16_t> semantics;   // bits of SemanticClass
  raster::Grid<std::uint16_t> visibility;  // share of surface points in range that see this one
  double reference_height_m = 0.0;         // h_ref that the visibility layer was computed for
  // At further heights, ascending, none twice and none at h_ref; empty in most maps.
  std::vector<VisibilityBand> further_visibility;
  double visibility_radius_m = 0.0;
  std::vector<PowerLine> power_lines;
  std::vector<std::string> attributions;  // travel with every product of the map
  std::string label;                      // "SYNTHETIC REGION" or empty: shown on every product
  Hash128 hash;                           // map_hash() of all of the above
};

/// Share of the surroundings that sees a point at reference height over the cell, in [0, 1]; NaN
/// unknown.
inline double visibility_share(std::uint16_t stored) {
  return stored == kVisibilityUnknown ? std::numeric_limits<double>::quiet_NaN()
                                      : stored / kVisibilityScale;
}

/// Whether visibility at a height is known: at the reference height, or between the lowest and the
/// highest of the exposure volume.
bool covers_height(const Map& map, double height_m);

/// Identity of the content: geometry, CRS, layers, features, attributions, label; not of file
/// names, times or compression.
Hash128 map_hash(const Map& map);

/// Throws DataError naming what is inconsistent: layer sizes, surface below terrain, hash.
void validate(const Map& map);

}  // namespace hedgehop::map
