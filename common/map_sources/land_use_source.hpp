#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/observer.hpp"
#include "geo/geodetic_box.hpp"
#include "geo/map_projection.hpp"

namespace hedgehop::map_sources {

enum class ObjectClass {
  kForest,
  kTree,  // a single tree or a row of trees
  kBuilding,
  kStructure,  // mast, tower, chimney, wind turbine: higher than buildings are
  kBuiltUpArea,
  kWater,
};
inline constexpr std::size_t kObjectClassCount = 6;

/// What a structure is, as far as its source says.
enum class StructureKind { kMast, kTower, kChimney, kWindTurbine, kStructure, kOther };

using MapLine = std::vector<geo::MapPoint>;

/// One outer ring with its holes; rings are closed (first point = last).
struct MapPolygon {
  MapLine outer;
  std::vector<MapLine> holes;
};

struct AreaObject {
  ObjectClass object_class = ObjectClass::kForest;
  std::int64_t source_id = 0;
  std::optional<double> height_m;  // as tagged
  std::optional<double> levels;    // storeys as tagged
  std::vector<MapPolygon> polygons;
  std::optional<double> default_height_m = std::nullopt;     // in place of the default of its class
  StructureKind structure_kind = StructureKind::kStructure;  // if object_class is kStructure
};

/// A point (one vertex) or a line.
struct LineObject {
  ObjectClass object_class = ObjectClass::kTree;
  std::int64_t source_id = 0;
  std::optional<double> height_m;
  MapLine vertices;
  std::optional<double> default_height_m = std::nullopt;
  StructureKind structure_kind = StructureKind::kStructure;  // if object_class is kStructure
  std::optional<double> radius_m = std::nullopt;             // of a rotor, as tagged
};

struct PowerLineObject {
  struct Support {
    geo::MapPoint point;
    std::optional<double> height_m;  // of the pole, else of the line
    bool is_pole = false;            // mapped as a tower, pole or pylon
  };
  std::int64_t source_id = 0;
  bool is_minor = false;          // a low one: minor power line, drag lift
  std::vector<Support> supports;  // in the order of the line, at least 2
  std::optional<double> default_height_m = std::nullopt;
  bool is_aerialway = false;
};

/// What stands and lies on the ground, in the map frame.
struct LandUse {
  std::vector<AreaObject> areas;
  std::vector<LineObject> lines;
  std::vector<PowerLineObject> power_lines;
  std::vector<geo::GeodeticBox> mapped;  // what each file covers
  bool is_openstreetmap = false;         // false if every file was written by hedgehop itself
  std::int64_t node_count = 0;
  std::int64_t incomplete_relation_count = 0;         // multipolygons with members outside the file
  std::vector<std::int64_t> incomplete_relation_ids;  // the first of them
  std::int64_t invalid_area_count = 0;                // rings that do not close or cross themselves
  std::int64_t incomplete_way_count = 0;              // ways with nodes outside the file
  std::int64_t unreadable_height_count = 0;  // tags that state no height, "low" for example
};

/// OpenStreetMap files: .osm, .osm.gz, .osm.bz2, .osm.pbf.
///
/// Forest: landuse=forest, natural=wood. Trees: natural=tree, tree_row. Buildings: building=*.
/// Structures: man_made mast, tower, chimney, communications_tower, water_tower, silo and wind
/// turbines. Built-up areas: landuse residential, commercial, industrial, retail, garages,
/// farmyard, institutional, construction, education. Water: natural=water, landuse reservoir and
/// basin, waterway=riverbank. Power lines: power=line, minor_line, unless location says that they
/// lie underground or under water; aerialways: all but magic carpets. Every node of them holds up
/// the spans beside it; those tagged as towers, poles, portals or pylons are marked. A wind turbine
/// brings the radius of its rotor (rotor:diameter).
/// Multipolygons are assembled, also those whose tags stand on their outer ways. An object that
/// several files hold counts once. Only objects that touch `region` are kept.
///
/// A file covers the bounds that its header states, else the box of its nodes.
///
/// @throws DataError    a file is missing, damaged, no OSM file, unsorted or without nodes.
/// @throws Interrupted
LandUse read_land_use(const std::vector<std::filesystem::path>& files,
                      const geo::MapProjection& projection, const geo::GeodeticBox& region,
                      Observer& observer);

}  // namespace hedgehop::map_sources
