#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/config_reader.hpp"
#include "base/time.hpp"
#include "flight/plan.hpp"
#include "map/map.hpp"
#include "output/straight_legs.hpp"

namespace hedgehop::output {

enum class ExportFormat : std::uint8_t {
  kKml,
  kKmz,
  kGeoJson,
  kGpkg,
  kGpx,
  kCsv,
  kQgcPlan,
  kWaypoints,
  kCzml,
  kMcap,
};

/// A format as people name it, and what it holds.
struct ExportFormatEntry {
  ExportFormat format;
  const char* name;       // "kml"
  const char* extension;  // ".kml", of the file "flight.kml"
  const char* heights;    // what its heights are counted from
  bool needs_map;         // its legs are checked against the map
};
/// All of them.
const std::vector<ExportFormatEntry>& export_formats();
const ExportFormatEntry& entry_of(ExportFormat format);

/// Throws UsageError for an unknown name; the hint has the nearest known one and the list.
ExportFormat export_format(std::string_view name);

struct ExportOptions {
  double track_step_s = 0.0;    // > 0, between positions of a track for people
  double speed_step_mps = 0.0;  // >= 0
  LegOptions legs;
};
/// The whole of config/export.yaml.
ExportOptions read_export_options(ConfigReader& reader);

struct ExportRequest {
  std::optional<Time> start_time;    // without it, files carry no times of day
  const map::Map* map = nullptr;     // for formats whose legs are checked
  std::filesystem::path map_folder;  // its layers go into GeoPackages; empty: none
  double clearance_m = 0.0;          // that straight legs must hold
};

/// A file to be written.
struct ExportedFile {
  ExportFormat format = ExportFormat::kKml;
  std::string content;
  std::optional<StraightLegs> legs;  // of waypoint lists
  std::vector<std::string> remarks;  // what a user should know about it
};

/// A plan in another format. Same plan and request, same bytes.
///
/// Heights are converted with PROJ's geoid grids to what each format means: above mean sea level
/// (EGM96) in KML, KMZ, GPX, `.plan` and waypoint lists; above the WGS 84 ellipsoid in GeoJSON
/// (RFC 7946), CZML and MCAP; the map's own vertical datum in GeoPackage, whose coordinate system
/// says so, and CSV. Angles and speeds as in trajectory.csv. Positions are rounded to 1 mm or less.
///
/// @throws DataError  the map has no coordinate system, a geoid grid is missing.
/// @throws UserError  exit code 4: see straight_legs().
ExportedFile export_plan(const flight::Plan& plan, ExportFormat format,
                         const ExportRequest& request, const ExportOptions& options);

}  // namespace hedgehop::output
