#include "preparation/prepare.hpp"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <nlohmann/json.hpp>
#include <sstream>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "base/errors.hpp"
#include "base/hash.hpp"
#include "map/source_layer.hpp"
#include "map_sources/area_source.hpp"
#include "map_sources/elevation_source.hpp"
#include "map_sources/land_use_source.hpp"
#include "map_sources/obstacle_file.hpp"
#include "preparation/areas.hpp"
#include "preparation/estimate.hpp"
#include "preparation/ground_weights.hpp"
#include "preparation/surface_model.hpp"

namespace hedgehop::preparation {
namespace {

// Cells of a region that is prepared in tiles.
constexpr std::int64_t kTiledCellsMax = 1'000'000'000'000;
// Resampling and the surface's raising look this far around.
constexpr int kRimCells = 8;

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

double rounded_degrees(double angle_rad) {
  return std::round(degrees_from_radians(angle_rad) * 1e7) / 1e7;
}

Json json_of(const geo::GeodeticBox& box) {
  return {{"west", rounded_degrees(box.west_rad)},
          {"south", rounded_degrees(box.south_rad)},
          {"east", rounded_degrees(box.east_rad)},
          {"north", rounded_degrees(box.north_rad)}};
}

std::string text_of(const geo::GeodeticBox& box) {
  std::ostringstream text;
  text << std::fixed << std::setprecision(4) << degrees_from_radians(box.west_rad) << ","
       << degrees_from_radians(box.south_rad) << "," << degrees_from_radians(box.east_rad) << ","
       << degrees_from_radians(box.north_rad) << " (W,S,E,N)";
  return text.str();
}

std::string percent(double share) {
  std::ostringstream text;
  text << std::fixed << std::setprecision(share < 0.01 ? 2 : 0) << 100.0 * share << " %";
  return text.str();
}

bool overlap(const geo::GeodeticBox& a, const geo::GeodeticBox& b) {
  return a.west_rad < b.east_rad && b.west_rad < a.east_rad && a.south_rad < b.north_rad &&
         b.south_rad < a.north_rad;
}

geo::GeodeticBox intersection(const geo::GeodeticBox& a, const geo::GeodeticBox& b) {
  return {std::max(a.west_rad, b.west_rad), std::max(a.south_rad, b.south_rad),
          std::min(a.east_rad, b.east_rad), std::min(a.north_rad, b.north_rad)};
}

void check_request(const PrepareRequest& request, double cell_m) {
  if (request.dem_files.empty()) {
    throw UsageError("no elevation file is given", "add at least one with --dem");
  }
  if (!(cell_m >= 1.0) || !(cell_m <= 1000.0)) {
    throw UsageError("a cell size of " + std::to_string(cell_m) + " m is not possible",
                     "choose 1 to 1000 m; 30 m is usual");
  }
  if (request.extent) {
    const geo::GeodeticBox& e = *request.extent;
    const double half_turn = 0.5 * kTwoPi;
    if (!(e.west_rad < e.east_rad) || !(e.south_rad < e.north_rad) || !(e.west_rad >= -half_turn) ||
        !(e.east_rad <= half_turn) || !(e.south_rad >= -0.5 * half_turn) ||
        !(e.north_rad <= 0.5 * half_turn)) {
      throw UsageError("the bounding box " + text_of(e) + " is empty or not on the globe",
                       "give it as west,south,east,north in degrees, west below east; it cannot "
                       "cross the antimeridian");
    }
  }
  if (request.threads < 0) {
    throw UsageError("a negative number of threads is not possible");
  }
  if (request.tile && (request.tile->count < 1 || request.tile->count > 10'000'000 ||
                       request.tile->index < 1 || request.tile->index > request.tile->count)) {
    throw UsageError("tile " + std::to_string(request.tile->index) + "/" +
                         std::to_string(request.tile->count) + " is not possible",
                     "give --tile as NUMBER/COUNT, from 1/COUNT to COUNT/COUNT");
  }
}

// The smallest grid, its corner on a multiple of the cell size, that holds the box.
raster::GridGeometry grid_around(const geo::GeodeticBox& box, const geo::MapProjection& projection,
                                 double cell_m, std::int64_t cells_max) {
  constexpr int kSteps = 64;
  double west_m = 1e18, south_m = 1e18, east_m = -1e18, north_m = -1e18;
  for (int i = 0; i <= kSteps; ++i) {
    const double t = static_cast<double>(i) / kSteps;
    const double longitude_rad = box.west_rad + t * (box.east_rad - box.west_rad);
    const double latitude_rad = box.south_rad + t * (box.north_rad - box.south_rad);
    for (const geo::GeodeticPosition& position :
         {geo::GeodeticPosition{box.south_rad, longitude_rad},
          geo::GeodeticPosition{box.north_rad, longitude_rad},
          geo::GeodeticPosition{latitude_rad, box.west_rad},
          geo::GeodeticPosition{latitude_rad, box.east_rad}}) {
      const geo::MapPoint point = projection.to_map(position);
      west_m = std::min(west_m, point.x_m);
      east_m = std::max(east_m, point.x_m);
      south_m = std::min(south_m, point.y_m);
      north_m = std::max(north_m, point.y_m);
    }
  }
  const double first_column = std::floor(west_m / cell_m);
  const double first_row = std::floor(south_m / cell_m);
  const double columns = std::ceil(east_m / cell_m) - first_column;
  const double rows = std::ceil(north_m / cell_m) - first_row;
  if (columns * rows > static_cast<double>(cells_max)) {
    std::ostringstream what;
    what << "the region " << text_of(box) << " has " << std::fixed << std::setprecision(0)
         << columns * rows << " cells of " << cell_m << " m, more than the " << cells_max
         << " allowed";
    throw UsageError(what.str(), "choose a smaller bounding box or larger cells (--cell-m)");
  }
  return {first_column * cell_m, first_row * cell_m, cell_m, static_cast<int>(columns),
          static_cast<int>(rows)};
}

// `core` and a margin on each side, as far as it has cells in `limit`.
raster::GridGeometry with_margin(const raster::GridGeometry& core, int margin,
                                 const raster::GridGeometry& limit) {
  const auto cells = [&](double distance_m) {
    return std::clamp(static_cast<int>(std::lround(distance_m / core.cell_m)), 0, margin);
  };
  const int west = cells(core.west_m - limit.west_m);
  const int south = cells(core.south_m - limit.south_m);
  const int east = cells(limit.east_m() - core.east_m());
  const int north = cells(limit.north_m() - core.north_m());
  return {core.west_m - west * core.cell_m, core.south_m - south * core.cell_m, core.cell_m,
          core.columns + west + east, core.rows + south + north};
}

template <typename T>
raster::Grid<T> cut_out(const raster::Grid<T>& grid, const raster::GridGeometry& core,
                        raster::CellIndex corner) {
  raster::Grid<T> result(core, T{});
  for (int row = 0; row < core.rows; ++row) {
    std::copy_n(grid.row(corner.row + row) + corner.column, core.columns, result.row(row));
  }
  return result;
}

bool touches(const map::OverheadLine& line, const raster::GridGeometry& g) {
  double west_m = 1e18, south_m = 1e18, east_m = -1e18, north_m = -1e18;
  for (const map::OverheadLine::Support& support : line.supports) {
    west_m = std::min(west_m, support.point.x_m);
    east_m = std::max(east_m, support.point.x_m);
    south_m = std::min(south_m, support.point.y_m);
    north_m = std::max(north_m, support.point.y_m);
  }
  return west_m <= g.east_m() && east_m >= g.west_m && south_m <= g.north_m() &&
         north_m >= g.south_m;
}

bool touches(const map::Obstacle& obstacle, const raster::GridGeometry& g) {
  return obstacle.point.x_m + obstacle.radius_m >= g.west_m &&
         obstacle.point.x_m - obstacle.radius_m <= g.east_m() &&
         obstacle.point.y_m + obstacle.radius_m >= g.south_m &&
         obstacle.point.y_m - obstacle.radius_m <= g.north_m();
}

Json input_of(const fs::path& path, const char* kind, Observer& observer) {
  return {{"name", path.filename().string()},
          {"kind", kind},
          {"bytes", fs::file_size(path)},
          {"sha256", sha256_hex_of_file(path.string(), [&] { observer.check_stop(); })}};
}

void add_inputs(const map_sources::VectorInput& input, const map_sources::VectorFindings& findings,
                Json& inputs, Observer& observer) {
  for (const fs::path& part : findings.parts) {
    inputs.push_back(input_of(part, "land use", observer));
    inputs.back()["format"] = findings.format;
  }
  inputs.push_back({{"name", fs::path(input.mapping.name).filename().string()},
                    {"kind", "mapping"},
                    {"bytes", input.mapping.text.size()},
                    {"sha256", sha256_hex(bytes_of(input.mapping.text))}});
}

Json json_of(const map_sources::VectorInput& input, const map_sources::VectorFindings& findings) {
  Json rules = Json::array();
  for (std::size_t i = 0; i < input.mapping.rules.size(); ++i) {
    const map_sources::MappingRule& rule = input.mapping.rules[i];
    rules.push_back({{"layer", rule.layer},
                     {"class", rule.kind.word},
                     {"objects", findings.objects_of_rule[i]}});
  }
  return {{"name", input.file.filename().string()},
          {"mapping", fs::path(input.mapping.name).filename().string()},
          {"rules", std::move(rules)},
          {"unmapped_features", findings.unmapped_feature_count},
          {"unusable_features", findings.unusable_feature_count}};
}

Json json_of(const map_sources::ElevationFile& file, Observer& observer) {
  Json input = input_of(file.parts.front(), "elevation", observer);
  input["format"] = file.format;
  input["crs"] = file.crs;
  input["used_as"] = map_sources::word_of(file.kind);
  input["used_as_from"] = file.kind_from;
  input["vertical_datum"] = file.datum.name;
  input["vertical_datum_from"] = file.datum_from;
  input["vertical_conversion"] = file.datum_conversion;
  input["sample_spacing_m"] = file.sample_spacing_m;
  input["extent_deg"] = json_of(file.extent);
  return input;
}

Json json_of(const HeightCounts& counts) {
  return {
      {"tagged", counts.tagged}, {"from_levels", counts.from_levels}, {"guessed", counts.guessed}};
}

Json json_of(const PrepareOptions& o, double cell_m) {
  return {{"cell_m", cell_m},
          {"vertical_datum", o.vertical_datum.name},
          {"void_fill_radius_m", o.void_fill_radius_m},
          {"default_heights",
           {{"forest_m", o.default_heights.forest_m},
            {"tree_m", o.default_heights.tree_m},
            {"building_m", o.default_heights.building_m},
            {"building_level_m", o.default_heights.building_level_m},
            {"structure_m", o.default_heights.structure_m},
            {"built_up_area_m", o.default_heights.built_up_area_m},
            {"power_line_m", o.default_heights.power_line_m},
            {"minor_power_line_m", o.default_heights.minor_power_line_m},
            {"mast_m", o.default_heights.mast_m},
            {"tower_m", o.default_heights.tower_m},
            {"chimney_m", o.default_heights.chimney_m},
            {"wind_turbine_m", o.default_heights.wind_turbine_m},
            {"aerialway_m", o.default_heights.aerialway_m},
            {"drag_lift_m", o.default_heights.drag_lift_m}}},
          {"obstacles",
           {{"safety_radius_m", o.obstacles.safety_radius_m},
            {"wind_turbine_radius_m", o.obstacles.wind_turbine_radius_m},
            {"unknown_horizontal_error_m", o.obstacles.unknown_horizontal_error_m},
            {"unknown_vertical_error_m", o.obstacles.unknown_vertical_error_m}}},
          {"areas", {{"hard_kinds", o.areas.hard_kinds}, {"soft_kinds", o.areas.soft_kinds}}},
          {"settlements",
           {{"grow_m", o.settlements.grow_m},
            {"shrink_m", o.settlements.shrink_m},
            {"village_area_max_m2", o.settlements.village_area_max_m2},
            {"village_adequate_m", o.settlements.village_adequate_m},
            {"village_desired_m", o.settlements.village_desired_m},
            {"settlement_adequate_m", o.settlements.settlement_adequate_m},
            {"settlement_desired_m", o.settlements.settlement_desired_m},
            {"visibility_min", o.settlements.visibility_min}}},
          {"visibility",
           {{"radius_m", o.visibility.radius_m},
            {"reference_height_m", o.visibility.reference_height_m},
            {"azimuths", o.visibility.azimuths},
            {"earth_curvature", o.visibility.is_earth_curved},
            {"refraction", o.visibility.refraction},
            {"further_heights_m", o.visibility.further_heights_m},
            {"ground_weights",
             {{"forest", o.ground_weights.forest},
              {"urban", o.ground_weights.urban},
              {"water", o.ground_weights.water},
              {"open", o.ground_weights.open}}}}}};
}

void add_once(std::vector<std::string>& lines, const std::string& line) {
  if (!line.empty() && std::find(lines.begin(), lines.end(), line) == lines.end()) {
    lines.push_back(line);
  }
}

void check_text(const std::string& text, const char* what) {
  if (Json(text).dump(-1, ' ', false, Json::error_handler_t::replace) !=
      Json(text).dump(-1, ' ', false, Json::error_handler_t::ignore)) {
    throw UsageError(std::string(what) + " is not valid UTF-8 text");
  }
}

// People look up wherever they live, so the ground alone tells too little there.
void show_built_up_cells(double visibility_min, map::Map& map) {
  const auto least =
      static_cast<std::uint16_t>(std::lround(visibility_min * map::kVisibilityScale));
  const auto built_up = static_cast<std::uint16_t>(map::SemanticClass::kBuiltUpArea) |
                        static_cast<std::uint16_t>(map::SemanticClass::kVillage) |
                        static_cast<std::uint16_t>(map::SemanticClass::kSettlement);
  std::vector<raster::Grid<std::uint16_t>*> layers = {&map.visibility};
  for (map::VisibilityBand& band : map.further_visibility) {
    layers.push_back(&band.share);
  }
  for (raster::Grid<std::uint16_t>* layer : layers) {
    for (std::size_t i = 0; i < layer->values().size(); ++i) {
      std::uint16_t& stored = layer->values()[i];
      if ((map.semantics.values()[i] & built_up) != 0 && stored != map::kVisibilityUnknown) {
        stored = std::max(stored, least);
      }
    }
  }
}

raster::Grid<std::uint16_t> packed_sources(const raster::Grid<std::uint16_t>& elevation,
                                           const raster::Grid<std::uint8_t>& height_origin) {
  raster::Grid<std::uint16_t> result(elevation.geometry(), 0);
  for (std::size_t i = 0; i < result.values().size(); ++i) {
    const std::uint16_t number = elevation.values()[i];
    map::CellSource source;
    source.elevation = number == map_sources::ElevationLayers::kFilled
                           ? map::CellSource::kFilled
                           : std::min<int>(number, map::CellSource::kLater);
    source.origin = static_cast<map::HeightOrigin>(height_origin.values()[i]);
    result.values()[i] = map::packed(source);
  }
  return result;
}

// The outline of a tile. The number of columns and rows of tiles is the pair of divisors of the
// count that makes them most nearly square.
raster::GridGeometry part_of(const raster::GridGeometry& whole, const TileNumber& tile) {
  int across = 1;
  double best = std::numeric_limits<double>::infinity();
  for (int columns = 1; columns <= tile.count; ++columns) {
    if (tile.count % columns != 0) {
      continue;
    }
    const double width = static_cast<double>(whole.columns) / columns;
    const double height = static_cast<double>(whole.rows) * columns / tile.count;
    const double longer = std::max(width, height) / std::min(width, height);
    if (longer < best) {
      best = longer;
      across = columns;
    }
  }
  const int along = tile.count / across;
  const auto edge = [](int cells, int i, int n) {
    return static_cast<int>(std::int64_t{cells} * i / n);
  };
  const int column = (tile.index - 1) % across;
  const int row = (tile.index - 1) / across;
  const int west = edge(whole.columns, column, across);
  const int south = edge(whole.rows, row, along);
  raster::GridGeometry part = whole;
  part.west_m += west * whole.cell_m;
  part.south_m += south * whole.cell_m;
  part.columns = edge(whole.columns, column + 1, across) - west;
  part.rows = edge(whole.rows, row + 1, along) - south;
  if (part.columns < 1 || part.rows < 1) {
    throw UsageError("the region has fewer cells than tiles", "choose fewer tiles");
  }
  return part;
}

Json json_of(const NamedObserver& observer, const ThreatLayer& layer) {
  std::int64_t in_range = 0;
  std::int64_t surface_seen = 0;
  for (const float lowest_m : layer.lowest_seen_m.values()) {
    in_range += std::isnan(lowest_m) ? 0 : 1;
    surface_seen += lowest_m == 0.0F ? 1 : 0;
  }
  return {{"name", observer.name},
          {"latitude_deg", rounded_degrees(observer.position.latitude_rad)},
          {"longitude_deg", rounded_degrees(observer.position.longitude_rad)},
          {"mast_height_m", observer.mast_height_m},
          {"range_m", observer.range_m},
          {"cells_in_range", in_range},
          {"cells_with_surface_seen", surface_seen}};
}

}  // namespace

RegionGrids region_grids(const PrepareRequest& request, const PrepareOptions& options,
                         const map_sources::ElevationSource& elevation) {
  const double cell_m = request.cell_m.value_or(options.cell_m);
  check_request(request, cell_m);
  RegionGrids grids;
  const geo::GeodeticBox elevation_box = elevation.extent();
  grids.extent = request.extent.value_or(elevation_box);
  if (std::none_of(elevation.files().begin(), elevation.files().end(),
                   [&](const auto& file) { return overlap(file.extent, grids.extent); })) {
    throw DataError("the bounding box " + text_of(grids.extent) +
                        " lies outside the elevation files, which cover " + text_of(elevation_box),
                    "move the bounding box, or add the elevation files that cover it with --dem");
  }
  grids.crs = request.crs.empty() ? geo::utm_code(grids.extent.centre()) : request.crs;
  const geo::MapProjection projection(grids.crs);

  // Of all tiles together only the outline is needed.
  const std::int64_t whole_cells_max = request.tile ? kTiledCellsMax : options.cells_max;
  const raster::GridGeometry whole = grid_around(grids.extent, projection, cell_m, whole_cells_max);
  grids.map = request.tile ? part_of(whole, *request.tile) : whole;

  // Visibility at the border needs what lies beyond it. The files' own extent bounds the margin; it
  // is cut to the neighbourhood first, since a large file may reach where the projection does not.
  const int margin = static_cast<int>(std::ceil(options.visibility.radius_m / cell_m)) + 2;
  raster::GridGeometry wide = whole;
  wide = {wide.west_m - margin * cell_m, wide.south_m - margin * cell_m, cell_m,
          wide.columns + 2 * margin, wide.rows + 2 * margin};
  const geo::GeodeticBox near = intersection(raster::geodetic_box(wide, projection), elevation_box);
  grids.whole_working =
      with_margin(whole, margin, grid_around(near, projection, cell_m, kTiledCellsMax));
  // What is done at a raster's rim, void cells filled in for instance, must not reach a tile's
  // halo.
  const int rim = static_cast<int>(std::ceil(options.void_fill_radius_m / cell_m)) + kRimCells;
  grids.working = request.tile ? with_margin(grids.map, margin + rim, grids.whole_working)
                               : grids.whole_working;
  if (grids.working.cell_count() > static_cast<std::size_t>(options.cells_max)) {
    throw UsageError("the region with its margin for visibility has " +
                         std::to_string(grids.working.cell_count()) + " cells, more than the " +
                         std::to_string(options.cells_max) + " allowed",
                     "choose a smaller bounding box or larger cells (--cell-m)");
  }
  return grids;
}

PreparedMap prepare(const PrepareRequest& request, const PrepareOptions& options,
                    Observer& observer) {
  const double cell_m = request.cell_m.value_or(options.cell_m);
  check_request(request, cell_m);
  check_text(request.label, "the label");
  for (const std::string& line : request.attributions) {
    check_text(line, "an attribution line");
  }

  const map_sources::ElevationSource elevation(request.dem_files, options.vertical_datum,
                                               options.void_fill_radius_m);
  const RegionGrids grids = region_grids(request, options, elevation);
  const geo::GeodeticBox extent = grids.extent;
  const geo::MapProjection projection(grids.crs);

  PreparedMap result;
  map::Map& map = result.map;
  map.geometry = grids.map;
  map.crs_wkt = projection.wkt();
  map.vertical_datum = options.vertical_datum.name;
  map.reference_height_m = options.visibility.reference_height_m;
  map.visibility_radius_m = options.visibility.radius_m;
  map.label = request.label;
  const raster::GridGeometry& working = grids.working;
  const raster::GridGeometry& whole_working = grids.whole_working;
  const raster::CellIndex corner{
      static_cast<int>(std::lround((map.geometry.west_m - working.west_m) / cell_m)),
      static_cast<int>(std::lround((map.geometry.south_m - working.south_m) / cell_m))};

  Json inputs = Json::array();
  std::string assumed;
  for (const map_sources::ElevationFile& file : elevation.files()) {
    inputs.push_back(json_of(file, observer));
    for (std::size_t part = 1; part < file.parts.size(); ++part) {
      inputs.push_back(input_of(file.parts[part], "part of elevation", observer));
    }
    if (file.datum_from == "assumed") {
      assumed += (assumed.empty() ? "" : ", ") + file.name;
    }
    if (file.format == "SRTMHGT") {
      add_once(map.attributions, options.attribution_srtm);
    }
    check_text(file.copyright, "the copyright line of an elevation file");
    add_once(map.attributions, file.copyright);
  }
  if (!assumed.empty()) {
    observer.note("no word in " + assumed + " of what its heights refer to: taken as " +
                  map.vertical_datum + " (FILE:datum=NAME says otherwise)");
  }

  map_sources::ElevationLayers layers =
      elevation.on_grid(working, map.crs_wkt, request.threads, observer);
  map.terrain_m = cut_out(layers.terrain_m, map.geometry, corner);
  const auto void_count = static_cast<std::size_t>(
      std::count_if(map.terrain_m.values().begin(), map.terrain_m.values().end(),
                    [](float value) { return std::isnan(value); }));
  if (void_count == map.geometry.cell_count() && !request.tile) {
    throw DataError("the elevation files know no height anywhere in " + text_of(extent) +
                        ": every sample there is void",
                    "check them with gdalinfo -stats, or add another source with --dem");
  }
  const raster::Grid<std::uint16_t> sources = cut_out(layers.source, map.geometry, corner);
  const auto filled_count =
      std::count(sources.values().begin(), sources.values().end(), layers.kFilled);
  if (filled_count > 0) {
    observer.note(std::to_string(filled_count) +
                  " void cells of the elevation are filled in from their neighbours");
  }
  if (void_count > 0) {
    observer.note(
        percent(static_cast<double>(void_count) / static_cast<double>(map.geometry.cell_count())) +
        " of the map has no elevation and cannot be flown over");
  }

  map_sources::LandUse land_use;
  // Settlements are sorted by their whole size, so that each tile needs all of them.
  const geo::GeodeticBox working_box = raster::geodetic_box(whole_working, projection);
  Json vector_findings = Json::array();
  if (!request.osm_files.empty() || !request.vectors.empty()) {
    // Settlements beyond the border have rings that reach in.
    const double reach_rad = 2.0 * options.settlements.settlement_desired_m / 6.3e6 /
                             std::max(0.1, elementary::cos(working_box.centre().latitude_rad));
    const geo::GeodeticBox region{
        working_box.west_rad - reach_rad, working_box.south_rad - reach_rad,
        working_box.east_rad + reach_rad, working_box.north_rad + reach_rad};
    land_use = map_sources::read_land_use(request.osm_files, projection, region, observer);
    for (const fs::path& path : request.osm_files) {
      inputs.push_back(input_of(path, "land use", observer));
    }
    if (land_use.is_openstreetmap) {
      add_once(map.attributions, options.attribution_openstreetmap);
    }
    for (const map_sources::VectorInput& input : request.vectors) {
      const map_sources::VectorFindings findings =
          map_sources::read_vectors(input, projection, region, land_use, observer);
      vector_findings.push_back(json_of(input, findings));
      add_inputs(input, findings, inputs, observer);
      check_text(input.mapping.attribution, "the attribution of a mapping");
      add_once(map.attributions, input.mapping.attribution);
      if (findings.unusable_feature_count > 0) {
        observer.note(input.file.filename().string() + ": " +
                      std::to_string(findings.unusable_feature_count) +
                      " features have no geometry that can be used and are left out");
      }
    }
    std::vector<geo::GeodeticBox> mapped;
    for (const geo::GeodeticBox& box : land_use.mapped) {
      if (overlap(box, region)) {
        mapped.push_back(intersection(box, region));
      }
    }
    land_use.mapped = std::move(mapped);
    if (land_use.mapped.empty()) {
      observer.note("no land-use file covers any part of the region; every cell is unmapped");
    }
    if (land_use.incomplete_relation_count > 0) {
      std::string ids;
      constexpr std::size_t kNamedMax = 10;  // all of them stand in the manifest
      const std::size_t named = std::min(kNamedMax, land_use.incomplete_relation_ids.size());
      for (std::size_t i = 0; i < named; ++i) {
        ids += (ids.empty() ? "" : ", ") + std::to_string(land_use.incomplete_relation_ids[i]);
      }
      observer.note(
          std::to_string(land_use.incomplete_relation_count) +
          " multipolygon relations have members outside the land-use files and are left "
          "out: " +
          ids +
          (land_use.incomplete_relation_count > static_cast<std::int64_t>(named) ? ", ..." : ""));
    }
  }
  map_sources::ObstacleList listed;
  if (!request.obstacle_files.empty()) {
    listed = map_sources::read_obstacle_files(
        request.obstacle_files, projection, working_box,
        options.obstacles.safety_radius_m + options.obstacles.unknown_horizontal_error_m, observer);
    for (const fs::path& path : request.obstacle_files) {
      inputs.push_back(input_of(path, "obstacles", observer));
    }
    if (listed.unknown_accuracy_count > 0) {
      observer.note(std::to_string(listed.unknown_accuracy_count) + " of " +
                    std::to_string(listed.obstacles.size()) +
                    " entries of the obstacle files state no accuracy and get that of the config");
    }
  }
  Json areas_left_out = Json::object();
  if (!request.area_files.empty()) {
    map_sources::AreaFiles files;
    for (const fs::path& path : request.area_files) {
      files.push_back({path});
    }
    Areas areas = read_areas(files, {}, projection, map.geometry, options.areas, observer);
    map.areas = std::move(areas.areas);
    for (const fs::path& path : request.area_files) {
      inputs.push_back(input_of(path, "areas", observer));
    }
    std::int64_t left_out = 0;
    for (const auto& [kind, count] : areas.left_out) {
      areas_left_out[kind] = count;
      left_out += count;
    }
    if (left_out > 0) {
      observer.note(std::to_string(left_out) +
                    " areas are left out, since their kinds are neither "
                    "in areas.hard_kinds nor in areas.soft_kinds of the config: " +
                    areas_left_out.dump(-1, ' ', false, Json::error_handler_t::replace));
    }
  }
  for (const std::string& line : request.attributions) {
    add_once(map.attributions, line);
  }

  SurfaceModel model = surface_model(layers.upper_terrain_m, layers.is_surface, land_use, listed,
                                     projection, options, observer);
  map.surface_m = cut_out(model.surface_m, map.geometry, corner);
  map.semantics = cut_out(model.semantics, map.geometry, corner);
  for (map::OverheadLine& line : model.overhead_lines) {
    if (touches(line, map.geometry)) {
      map.overhead_lines.push_back(std::move(line));
    }
  }
  for (map::Obstacle& obstacle : model.obstacles) {
    if (touches(obstacle, map.geometry)) {
      map.obstacles.push_back(std::move(obstacle));
    }
  }
  const raster::Grid<std::uint8_t> ground_weight =
      ground_weights(model.semantics, options.ground_weights);
  VisibilityLayers visibility = visibility_of_block(
      {model.opaque_m, model.surface_m, ground_weight.is_empty() ? nullptr : &ground_weight},
      corner, map.geometry.columns, map.geometry.rows, options.visibility,
      {request.threads, Simd::kBest}, observer);
  map.visibility = std::move(visibility.shares.front());
  result.sources = packed_sources(sources, cut_out(model.height_origin, map.geometry, corner));
  for (std::size_t i = 0; i < options.visibility.further_heights_m.size(); ++i) {
    map.further_visibility.push_back(
        {options.visibility.further_heights_m[i], std::move(visibility.shares[i + 1])});
  }
  show_built_up_cells(options.settlements.visibility_min, map);
  for (std::size_t i = 0; i < map.semantics.values().size(); ++i) {
    if (visibility.is_partial.values()[i] != 0) {
      map.semantics.values()[i] |=
          static_cast<std::uint16_t>(map::SemanticClass::kVisibilityPartial);
    }
  }
  map.hash = map::map_hash(map);
  map::validate(map);

  Json threats = Json::array();
  if (!request.observers_file.empty()) {
    inputs.push_back(input_of(request.observers_file, "observers", observer));
    ConfigReader reader = ConfigReader::from_file(request.observers_file.string());
    for (const NamedObserver& named : read_named_observers(reader)) {
      check_text(named.name, "the name of an observer");
      const raster::Grid<float> lowest_m =
          lowest_seen_height({model.opaque_m, model.surface_m}, layers.terrain_m,
                             projection.to_map(named.position), named.mast_height_m, named.range_m,
                             drop_per_square_1pm(options.visibility), request.threads, observer);
      result.threats.push_back({named.name, cut_out(lowest_m, map.geometry, corner)});
      threats.push_back(json_of(named, result.threats.back()));
      if (threats.back()["cells_in_range"] == 0) {
        observer.note("observer '" + named.name +
                      "' has nothing of the map in range, or stands on unknown ground");
      }
    }
  }

  HeightCounts all = model.support_heights;
  all.tagged += model.obstacle_heights.tagged;
  all.guessed += model.obstacle_heights.guessed;
  Json heights = Json::object();
  static constexpr const char* kNames[] = {"forest",    "tree",          "building",
                                           "structure", "built_up_area", "water"};
  static_assert(std::size(kNames) == map_sources::kObjectClassCount);
  for (std::size_t i = 0; i + 1 < model.heights.size(); ++i) {
    heights[kNames[i]] = json_of(model.heights[i]);
    all.tagged += model.heights[i].tagged;
    all.from_levels += model.heights[i].from_levels;
    all.guessed += model.heights[i].guessed;
  }
  heights["line_support"] = json_of(model.support_heights);
  heights["obstacle"] = json_of(model.obstacle_heights);
  const std::int64_t objects = all.tagged + all.from_levels + all.guessed;
  const double guessed_share =
      objects == 0 ? 0.0 : static_cast<double>(all.guessed) / static_cast<double>(objects);
  if (all.guessed > 0) {
    observer.note(percent(guessed_share) + " of " + std::to_string(objects) +
                  " objects have no height of their own and get the default of their class");
  }
  Json mapped = Json::array();
  for (const geo::GeodeticBox& box : land_use.mapped) {
    mapped.push_back(json_of(box));
  }

  Json provenance;
  provenance["tool"] = "hedgehop";
  provenance["tool_version"] = HEDGEHOP_VERSION;
  provenance["inputs"] = std::move(inputs);
  provenance["settings"] = json_of(options, cell_m);
  provenance["settings"]["requested_extent_deg"] =
      request.extent ? json_of(*request.extent) : Json(nullptr);
  provenance["settings"]["requested_crs"] = request.crs;
  if (request.tile) {
    provenance["settings"]["tile"] =
        std::to_string(request.tile->index) + "/" + std::to_string(request.tile->count);
  }
  if (!threats.empty()) {
    provenance["threats"] = std::move(threats);
  }
  provenance["terrain_resampling"] =
      "bilinear at the cell's centre, exact transformer; surface starts from the terrain raised so "
      "that no source sample lies above its cell or above the bilinear surface";
  provenance["filled_void_count"] = filled_count;
  provenance["source_layer"] =
      "sources.tif: uint16, number of the elevation file among inputs + 4096 x origin of the "
      "surface "
      "(0 elevation, 1 stated height, 2 storeys, 3 default of the class, 4 wire or thin obstacle); "
      "0 unknown, 4095 filled in";
  Json cells_of_files = Json::array();
  for (std::size_t i = 0; i < elevation.files().size(); ++i) {
    cells_of_files.push_back({{"name", elevation.files()[i].name},
                              {"cells", std::count(sources.values().begin(), sources.values().end(),
                                                   static_cast<std::uint16_t>(i + 1))}});
  }
  provenance["elevation_cells"] = std::move(cells_of_files);
  provenance["visibility_method"] =
      "share of the ground within the radius that sees a point at reference height over the "
      "surface; "
      "lines of sight interpolated, power lines and obstacles hide nothing";
  provenance["mapped_extent_deg"] = std::move(mapped);
  provenance["guessed_height_share"] = std::round(guessed_share * 1e6) / 1e6;
  provenance["object_heights"] = std::move(heights);
  provenance["vector_sources"] = std::move(vector_findings);
  provenance["land_use_statistics"] = {
      {"villages", model.village_count},
      {"settlements", model.settlement_count},
      {"incomplete_relations", land_use.incomplete_relation_count},
      {"incomplete_relation_ids", land_use.incomplete_relation_ids},
      {"incomplete_ways", land_use.incomplete_way_count},
      {"invalid_areas", land_use.invalid_area_count},
      {"unreadable_heights", land_use.unreadable_height_count}};
  provenance["obstacle_file_statistics"] = {{"records", listed.record_count},
                                            {"near_the_region", listed.obstacles.size()},
                                            {"unverified", listed.unverified_count},
                                            {"of_unknown_accuracy", listed.unknown_accuracy_count}};
  provenance["areas_left_out_by_kind"] = std::move(areas_left_out);
  result.provenance_json = provenance.dump(2, ' ', false, Json::error_handler_t::replace);
  return result;
}

}  // namespace hedgehop::preparation
