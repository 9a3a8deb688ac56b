#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/config_reader.hpp"
#include "base/observer.hpp"
#include "geo/geodetic_box.hpp"
#include "map/map.hpp"
#include "map_sources/elevation_source.hpp"
#include "map_sources/vector_source.hpp"
#include "preparation/threat_layer.hpp"
#include "preparation/visibility.hpp"

namespace hedgehop::preparation {

/// Heights that a kind of object gets when its source states none.
struct DefaultHeights {
  double forest_m = 0.0;
  double tree_m = 0.0;  // single trees and rows of trees
  double building_m = 0.0;
  double building_level_m = 0.0;  // one storey of `building:levels`
  double structure_m = 0.0;       // silos, tanks, water towers and what else stands out
  double mast_m = 0.0;
  double tower_m = 0.0;
  double chimney_m = 0.0;
  double wind_turbine_m = 0.0;  // up to the tip of the rotor
  double built_up_area_m = 0.0;
  double power_line_m = 0.0;        // pole of power=line
  double minor_power_line_m = 0.0;  // pole of power=minor_line
  double aerialway_m = 0.0;         // pylon of a cable car or chair lift
  double drag_lift_m = 0.0;
};

/// How wide obstacles count, and what an unknown accuracy means.
struct ObstacleOptions {
  double safety_radius_m = 0.0;             // around every obstacle, added to its extent and error
  double wind_turbine_radius_m = 0.0;       // of a rotor whose source states none
  double unknown_horizontal_error_m = 0.0;  // of obstacle files
  double unknown_vertical_error_m = 0.0;
};

/// Which areas must not be entered and which cost, by what their source calls them.
struct AreaOptions {
  std::vector<std::string> hard_kinds;
  std::vector<std::string> soft_kinds;
};

struct SettlementOptions {
  double grow_m = 0.0;    // outwards, before the union
  double shrink_m = 0.0;  // inwards, after the union
  double village_area_max_m2 =
      0.0;  // at most this after shrinking: village or stand-alone building
  double village_adequate_m = 0.0;
  double village_desired_m = 0.0;
  double settlement_adequate_m = 0.0;
  double settlement_desired_m = 0.0;
  /// Visibility that built-up cells have at least, whatever the ground sees of them: people do.
  double visibility_min = 0.0;
};

/// How much ground of a kind counts as a place from which is looked, 0 to 1.
struct GroundWeights {
  double forest = 0.0;
  double urban = 0.0;
  double water = 0.0;
  double open = 0.0;  // agricultural, and whatever is none of the others
};

/// What config/prepare.yaml holds.
struct PrepareOptions {
  double cell_m = 0.0;
  geo::VerticalDatum vertical_datum;  // of the map; heights in another one are converted
  double void_fill_radius_m = 0.0;    // how far a void cell may lie from known ones to be filled in
  std::string attribution_srtm;
  std::string attribution_openstreetmap;
  DefaultHeights default_heights;
  ObstacleOptions obstacles;
  AreaOptions areas;
  SettlementOptions settlements;
  VisibilityOptions visibility;
  GroundWeights ground_weights;
  std::int64_t cells_max = 0;  // refuse larger regions, halo included

  /// The whole document. Throws ConfigError.
  static PrepareOptions read(ConfigReader& reader);
};

/// Tile `index` of `count`, from 1, row by row from the south-west. Regions are cut into columns
/// and rows of tiles such that these are as square as `count` allows.
struct TileNumber {
  int index = 1;
  int count = 1;
};

struct PrepareRequest {
  std::vector<map_sources::ElevationInput>
      dem_files;  // at least one; earlier files win where they overlap
  std::vector<std::filesystem::path> osm_files;  // without them and vectors every cell is unmapped
  std::optional<geo::GeodeticBox> extent;        // default: all that the elevation files cover
  std::optional<double> cell_m;                  // default: PrepareOptions::cell_m
  std::string crs;                               // empty: UTM zone of the region's centre
  std::string label;                      // shown on every product, "SYNTHETIC REGION" for example
  std::vector<std::string> attributions;  // added to those that the sources bring
  int threads = 0;                        // 0: one for each processor; never changes a byte
  std::vector<map_sources::VectorInput> vectors =
      {};                                         // land use of other kinds, each with its mapping
  std::filesystem::path observers_file = {};      // YAML, see read_named_observers(); empty: none
  std::optional<TileNumber> tile = std::nullopt;  // one part of the region; default: all of it
  std::vector<std::filesystem::path> obstacle_files = {};  // FAA DOF or CSV
  std::vector<std::filesystem::path> area_files = {};      // OpenAir or whatever OGR reads
};

struct PreparedMap {
  map::Map map;
  raster::Grid<std::uint16_t> sources;  // for map::write_source_layer
  std::vector<ThreatLayer> threats;     // of the named observers, in their order
  std::string provenance_json;          // for map::write_map_bundle
};

/// Makes a map out of elevation and land-use files.
///
/// Terrain is warped to square cells in a metric projection. The surface is the terrain plus what
/// stands on it: forest, trees, buildings, built-up areas, power lines and obstacles, each with its
/// tagged height or the default of its class; every cell that an object touches is raised.
/// Settlements are grown, joined, shrunk, split by size and get their rings (the paper's figure 2).
/// Visibility is the share of the surroundings that sees a point at reference height, computed on a
/// halo of one radius where the elevation files cover it, so that the map's edges are as good as
/// its middle.
///
/// A tile has the same bytes in every layer as that part of the whole region: it is computed with a
/// margin of its own, land use is read for the whole region, and lines of sight are anchored to the
/// map frame. (Spans of power lines must be shorter than the visibility radius.)
///
/// Same request files, options and build, same map, whatever `threads` is.
///
/// @throws DataError    a file is missing, damaged, no raster, all void, without nodes, or the
/// extent
///                      lies outside the elevation files; says which and what to do.
/// @throws UsageError   the request contradicts itself: no elevation file, empty extent, bad cell
/// size.
/// @throws Interrupted  the observer asked to stop; checked at least every 0.2 s.
/// @note  About 2 s of processor time for a million cells on AVX2, most of it visibility.
PreparedMap prepare(const PrepareRequest& request, const PrepareOptions& options,
                    Observer& observer);

}  // namespace hedgehop::preparation
