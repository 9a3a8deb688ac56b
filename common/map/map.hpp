#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
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
  kPowerPole = 1U << 12,  // a tower or pole of a power line stands in the cell
  kObstacle = 1U << 13,  // mast, tower, chimney, wind turbine, aerialway, entry of an obstacle file
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

enum class LineKind : std::uint8_t { kPowerLine, kMinorPowerLine, kAerialway };
/// "power_line" and so on, as used in files.
const char* name_of(LineKind kind);

/// Wires above the ground as a chain of spans between supports.
struct OverheadLine {
  struct Support {
    geo::MapPoint point;
    double height_m = 0.0;  // above the terrain
    // Mapped as a tower, pole or pylon; else a vertex of the line of which the source says nothing
    // more. Both hold up the spans beside them.
    bool is_pole = true;
  };
  std::int64_t source_id = 0;
  std::vector<Support> supports;  // at least 2
  LineKind kind = LineKind::kPowerLine;
};

enum class ObstacleKind : std::uint8_t {
  kMast,
  kTower,
  kChimney,
  kWindTurbine,
  kStructure,  // silo, tank, water tower, cooling tower
  kOther,
};
/// "mast" and so on, as used in files.
const char* name_of(ObstacleKind kind);

/// Something thin and high: all that may stand in a vertical cylinder, from the ground up.
struct Obstacle {
  std::int64_t source_id = 0;  // of the object in its source, or the line of an obstacle file
  ObstacleKind kind = ObstacleKind::kOther;
  std::string name;  // may be empty
  geo::MapPoint point;
  double radius_m = 0.0;  // own extent, safety radius and error of the position
  double height_m = 0.0;  // above the terrain, error of the height included
  double top_m = 0.0;     // the same AMSL; NaN where the terrain is unknown and no source states it
};

/// Lower or upper end of an area.
struct AreaLimit {
  enum class Reference : std::uint8_t { kAmsl, kAboveGround };
  double value_m = 0.0;  // -infinity: from the ground on and below; +infinity: without end
  Reference reference = Reference::kAmsl;

  /// Altitude over ground of this elevation [m AMSL]; NaN over unknown ground, unless it does not
  /// matter.
  [[nodiscard]] double altitude_m(double terrain_m) const {
    return reference == Reference::kAmsl || std::isinf(value_m) ? value_m : terrain_m + value_m;
  }
  bool operator==(const AreaLimit&) const = default;
};

/// A volume that must not be entered (hard), or that costs (soft): polygons between two altitudes.
/// Its sides and ends belong to it.
struct Area {
  /// Rings are closed (first point = last) and do not cross themselves.
  struct Polygon {
    std::vector<geo::MapPoint> outer;
    std::vector<std::vector<geo::MapPoint>> holes;
  };
  std::string name;  // may be empty
  std::string kind;  // class or type in its source, "P" or "CTR" for example
  bool is_hard = true;
  AreaLimit floor;
  AreaLimit ceiling;
  std::vector<Polygon> polygons;  // at least 1
};

/// Visibility at another height than the reference height; together they are the exposure volume.
struct VisibilityBand {
  double height_m = 0.0;              // above the surface
  raster::Grid<std::uint16_t> share;  // as Map::visibility
};

/// Heights above the surface over each cell, with a name.
struct HeightLayer {
  std::string name;
  raster::Grid<float> height_m;
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
  // Of named observers: from which height on each sees what flies over a cell [m]; NaN: never, out
  // of its range or unknown. Empty unless somebody weighs it (planning::read_map_for()).
  std::vector<HeightLayer> threats;
  std::vector<OverheadLine> overhead_lines;
  std::vector<Obstacle> obstacles;
  std::vector<Area> areas;
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
/// Identity of the same map without Map::threats: that of its bundle.
Hash128 map_hash_without_threats(const Map& map);

/// Throws DataError naming what is inconsistent: layer sizes, surface below terrain, hash.
void validate(const Map& map);
/// The part of it that concerns Map::threats: sizes, and heights that are neither NaN nor finite
/// and at least 0.
void validate_threats(const Map& map);

}  // namespace hedgehop::map
