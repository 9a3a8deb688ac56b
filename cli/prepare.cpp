#include "preparation/prepare.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <unistd.h>

#include "base/angles.hpp"
#include "base/files.hpp"
#include "base/shipped_config.hpp"
#include "effective_config.hpp"
#include "map/map_bundle.hpp"
#include "map/source_layer.hpp"
#include "plan_result.hpp"
#include "preparation/estimate.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

struct PrepareArguments {
  std::vector<std::string> dem, osm, vectors, mappings, obstacles, areas, attributions, settings;
  std::vector<double> bbox_deg;
  double cell_m = 0.0;
  std::string crs, label, config_file, out, observers_file, tile;
  bool is_overwriting = false;
  bool is_dry_run = false;
};

preparation::PrepareOptions options_of(const PrepareArguments& arguments) {
  ConfigReader reader = effective_config("prepare.yaml", arguments.config_file, arguments.settings);
  return preparation::PrepareOptions::read(reader);
}

// A file, or the name of one of those that come with the program.
map_sources::VectorMapping mapping_of(const std::string& name) {
  const std::string shipped = "mappings/" + name + ".yaml";
  const std::vector<std::string> names = shipped_config_names();
  std::error_code error;
  if (!std::filesystem::exists(name, error) &&
      std::find(names.begin(), names.end(), shipped) != names.end()) {
    return map_sources::VectorMapping::read(std::string(shipped_config(shipped)),
                                            "config/" + shipped);
  }
  return map_sources::VectorMapping::read(read_file(name), name);
}

void add_vectors(const PrepareArguments& arguments, preparation::PrepareRequest& request) {
  if (arguments.vectors.size() != arguments.mappings.size()) {
    throw UsageError("--vectors is given " + std::to_string(arguments.vectors.size()) +
                         " times, --mapping " + std::to_string(arguments.mappings.size()) +
                         " times",
                     "each vector file needs its mapping, in the same order; the shipped one for "
                     "Taiwan's topographic map is called taiwan_topo25k");
  }
  for (std::size_t i = 0; i < arguments.vectors.size(); ++i) {
    request.vectors.push_back({arguments.vectors[i], mapping_of(arguments.mappings[i])});
  }
}

// "3/16"
preparation::TileNumber tile_of(const std::string& text) {
  preparation::TileNumber tile;
  const std::size_t slash = text.find('/');
  const char* end = text.data() + text.size();
  if (slash != std::string::npos) {
    const auto index = std::from_chars(text.data(), text.data() + slash, tile.index);
    const auto count = std::from_chars(text.data() + slash + 1, end, tile.count);
    if (index.ec == std::errc() && index.ptr == text.data() + slash && count.ec == std::errc() &&
        count.ptr == end) {
      return tile;
    }
  }
  throw UsageError("'" + text + "' is no tile", "give --tile as NUMBER/COUNT, 3/16 for example");
}

preparation::PrepareRequest request_of(const PrepareArguments& arguments, const Console& console) {
  preparation::PrepareRequest request;
  for (const std::string& dem : arguments.dem) {
    request.dem_files.push_back(map_sources::ElevationInput::parse(dem));
  }
  request.osm_files.assign(arguments.osm.begin(), arguments.osm.end());
  if (!arguments.bbox_deg.empty()) {
    geo::GeodeticBox box;
    box.west_rad = radians_from_degrees(arguments.bbox_deg[0]);
    box.south_rad = radians_from_degrees(arguments.bbox_deg[1]);
    box.east_rad = radians_from_degrees(arguments.bbox_deg[2]);
    box.north_rad = radians_from_degrees(arguments.bbox_deg[3]);
    request.extent = box;
  }
  if (arguments.cell_m > 0.0) {
    request.cell_m = arguments.cell_m;
  }
  add_vectors(arguments, request);
  request.crs = arguments.crs;
  request.label = arguments.label;
  request.attributions = arguments.attributions;
  request.observers_file = arguments.observers_file;
  if (!arguments.tile.empty()) {
    request.tile = tile_of(arguments.tile);
  }
  request.threads = console.threads;
  request.obstacle_files.assign(arguments.obstacles.begin(), arguments.obstacles.end());
  request.area_files.assign(arguments.areas.begin(), arguments.areas.end());
  return request;
}

// Processor time of visibility for a cell, measured here and now.
preparation::MachineSpeed machine_speed(const Console& console,
                                        const preparation::VisibilityOptions& options,
                                        double cell_m) {
  const int processors = static_cast<int>(std::max(1L, ::sysconf(_SC_NPROCESSORS_ONLN)));
  const auto before = std::chrono::steady_clock::now();
  preparation::visibility_sample(options, cell_m, 1);
  const double elapsed_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - before).count();
  return {elapsed_s / (preparation::kSampleCells * preparation::kSampleCells),
          console.threads > 0 ? std::min(console.threads, processors) : processors};
}

ExitCode tell_estimate(const Console& console, const preparation::PrepareRequest& request,
                       const preparation::PrepareOptions& options) {
  const double cell_m = request.cell_m.value_or(options.cell_m);
  const preparation::MachineSpeed speed = machine_speed(console, options.visibility, cell_m);
  const preparation::PrepareEstimate estimate =
      preparation::estimate_prepare(request, options, speed);
  const raster::GridGeometry& map = estimate.grids.map;
  if (console.is_json) {
    const geo::GeodeticBox& e = estimate.grids.extent;
    const nlohmann::ordered_json json = {{"schema", "hedgehop prepare estimate"},
                                         {"schema_version", 1},
                                         {"columns", map.columns},
                                         {"rows", map.rows},
                                         {"cell_m", map.cell_m},
                                         {"crs", estimate.grids.crs},
                                         {"extent_deg",
                                          {{"west", degrees_from_radians(e.west_rad)},
                                           {"south", degrees_from_radians(e.south_rad)},
                                           {"east", degrees_from_radians(e.east_rad)},
                                           {"north", degrees_from_radians(e.north_rad)}}},
                                         {"working_cells", estimate.grids.working.cell_count()},
                                         {"input_bytes", estimate.input_bytes},
                                         {"disk_bytes", std::round(estimate.disk_bytes)},
                                         {"memory_bytes", std::round(estimate.memory_bytes)},
                                         {"duration_s", estimate.duration_s},
                                         {"threads", speed.threads},
                                         {"factor", 3.0}};
    std::printf("%s\n", json.dump(2).c_str());
    return ExitCode::kOk;
  }
  std::printf("size          %d x %d cells of %g m, %.1f x %.1f km, %s\n", map.columns, map.rows,
              map.cell_m, 1e-3 * map.columns * map.cell_m, 1e-3 * map.rows * map.cell_m,
              estimate.grids.crs.c_str());
  std::printf("with margin   %.2f million cells to work on\n",
              1e-6 * static_cast<double>(estimate.grids.working.cell_count()));
  std::printf("inputs        %.1f MB\n", 1e-6 * static_cast<double>(estimate.input_bytes));
  std::printf("disk          about %.1f MB\n", 1e-6 * estimate.disk_bytes);
  std::printf("memory        about %.0f MB\n", 1e-6 * estimate.memory_bytes);
  std::printf("time          about %s with %d threads\n",
              duration_text(estimate.duration_s).c_str(), speed.threads);
  console.say("nothing is written; each of the last three is good to a factor of 3");
  return ExitCode::kOk;
}

ExitCode run(const Console& console, const PrepareArguments& arguments) {
  const preparation::PrepareOptions options = options_of(arguments);
  const preparation::PrepareRequest request = request_of(arguments, console);
  if (arguments.is_dry_run) {
    return tell_estimate(console, request, options);
  }
  StagedFolder folder(arguments.out, map::kMapManifestFile, arguments.is_overwriting);
  const auto observer = console.observer();

  StageTimer timer;
  const preparation::PreparedMap prepared = preparation::prepare(request, options, *observer);
  timer.lap("prepare");
  observer->check_stop();
  observer->progress("writing the map", 0.0, 1.0);
  map::write_map_bundle(prepared.map, prepared.provenance_json, folder.path(), observer.get());
  map::write_source_layer(prepared.map, prepared.sources, folder.path());
  if (!prepared.threats.empty()) {
    std::vector<map::NamedBand> bands;
    for (const preparation::ThreatLayer& threat : prepared.threats) {
      bands.push_back({threat.name, &threat.lowest_seen_m});
    }
    map::write_height_bands(prepared.map, bands, folder.path() / map::kThreatsFile, observer.get());
  }
  observer->progress("writing the map", 1.0, 1.0);
  observer->check_stop();
  folder.commit();
  timer.lap("write");

  const map::Map& map = prepared.map;
  if (console.is_json) {
    nlohmann::ordered_json json;
    json["schema"] = "hedgehop prepare";
    json["schema_version"] = 1;
    json["map"] = arguments.out;
    json["map_hash"] = map.hash.hex();
    json["columns"] = map.geometry.columns;
    json["rows"] = map.geometry.rows;
    json["cell_m"] = map.geometry.cell_m;
    json["provenance"] = nlohmann::ordered_json::parse(prepared.provenance_json);
    std::printf("%s\n", json.dump(2).c_str());
  } else {
    std::printf("map           %s\n", arguments.out.c_str());
    std::printf("size          %d x %d cells of %g m, %.1f x %.1f km\n", map.geometry.columns,
                map.geometry.rows, map.geometry.cell_m,
                1e-3 * map.geometry.columns * map.geometry.cell_m,
                1e-3 * map.geometry.rows * map.geometry.cell_m);
    std::printf("hash          %s\n", map.hash.hex().c_str());
    for (const std::string& line : map.attributions) {
      std::printf("attribution   %s\n", line.c_str());
    }
  }
  return ExitCode::kOk;
}

}  // namespace

void add_prepare_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand("prepare", "Make a map bundle from elevation and land-use files");
  verb->footer(
      "Elevation: SRTM .hgt and .hgt.zip, GeoTIFF and whatever else GDAL reads, in any projection. "
      "Land "
      "use: OpenStreetMap .osm, .osm.gz, .osm.bz2, .osm.pbf, and any other vector file with a "
      "mapping "
      "that says what its layers mean. The bundle holds terrain, surface, "
      "semantics and visibility as GeoTIFF, overhead lines, obstacles and areas as GeoPackage and "
      "a manifest; QGIS opens "
      "all of "
      "it. The same files and settings give the same bytes.\n"
      "Example:\n"
      "  hedgehop prepare --dem N49E011.hgt.zip --dem N50E011.hgt.zip --osm area.osm.pbf \\\n"
      "                   --bbox 11.38,49.87,11.69,50.11 --out map\n"
      "  hedgehop prepare --dem dem.tif --vectors topo.gpkg --mapping taiwan_topo25k --out map");
  auto arguments = std::make_shared<PrepareArguments>();
  verb->add_option(
          "--dem", arguments->dem,
          "Elevation file; repeat it for several, earlier ones win where they overlap. Behind "
          "it may stand :terrain or :surface (trees and houses are in it), :datum=EGM2008, "
          ":crs=EPSG:4326")
      ->required()
      ->allow_extra_args(false);
  verb->add_option("--osm", arguments->osm, "OpenStreetMap file; may be repeated")
      ->allow_extra_args(false);
  verb->add_option("--vectors", arguments->vectors,
                   "Vector file (GeoPackage, Shapefile, GeoJSON, ...); may be repeated")
      ->allow_extra_args(false);
  verb->add_option("--mapping", arguments->mappings,
                   "What the layers of the --vectors file mean: a YAML file, or the name of a "
                   "shipped one; one for each --vectors, in the same order")
      ->allow_extra_args(false);
  verb->add_option(
          "--obstacles", arguments->obstacles,
          "Obstacle file: FAA DOF (.DAT or .CSV), or CSV with latitude_deg, longitude_deg, "
          "height_m; may be repeated")
      ->allow_extra_args(false);
  verb->add_option("--areas", arguments->areas,
                   "Areas that must not be entered or are to be avoided: OpenAir (.txt), GeoJSON, "
                   "KML, GeoPackage, ...; may be repeated")
      ->allow_extra_args(false);
  verb->add_option("--bbox", arguments->bbox_deg,
                   "West,south,east,north in degrees (default: all that the elevation files cover)")
      ->delimiter(',')
      ->expected(4);
  verb->add_option("--cell-m", arguments->cell_m, "Cell size (default: cell_m of the config)")
      ->check(CLI::Range(0.5, 1000.0));
  verb->add_option(
      "--crs", arguments->crs,
      "Projection of the map, for example EPSG:32632 (default: UTM zone of the centre)");
  verb->add_option("--label", arguments->label, "Words that every product of the map must show");
  verb->add_option("--attribution", arguments->attributions,
                   "A line that every product must carry; may be repeated")
      ->allow_extra_args(false);
  verb->add_option("--config", arguments->config_file,
                   "YAML file whose keys replace those of the shipped prepare.yaml");
  verb->add_option("--set", arguments->settings, "One setting, key=value; may be repeated")
      ->allow_extra_args(false);
  verb->add_option("--observers", arguments->observers_file,
                   "YAML file of named observers; writes threats.tif, the lowest height above the "
                   "surface that each of them sees");
  verb->add_option(
      "--tile", arguments->tile,
      "Prepare tile NUMBER/COUNT of the region alone, 3/16 for example; its layers are "
      "that part of the whole region's, byte for byte");
  verb->add_option("--out", arguments->out, "Folder to write the map to")->required();
  verb->add_flag("--overwrite", arguments->is_overwriting, "Replace an existing map in --out");
  verb->add_flag("--dry-run", arguments->is_dry_run,
                 "Write nothing; say how large the map will be, and what memory and time it takes");
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] { return run(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
