#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/time.hpp"
#include "geo/map_projection.hpp"
#include "map_sources/area_source.hpp"

namespace hedgehop::map_sources {

/// A place of a mission, as its file states it.
struct MissionPoint {
  /// What a height is counted from.
  enum class Reference : std::uint8_t {
    kSurface,   // terrain plus trees and buildings
    kGround,    // terrain
    kMapDatum,  // sea level as the map's heights know it
    kEgm96,     // mean sea level of EGM96
    kEllipsoid,
  };
  geo::GeodeticPosition position;
  std::optional<double> height_m;  // without one, the planner's own choice
  Reference reference = Reference::kSurface;
  std::optional<Time> time;                // to be there; of the start: to leave
  std::optional<double> heading_true_rad;  // of the start; others become via points
  std::string place;                       // "mission.yaml:3", "route.gpx: point 2", for errors
};

/// By what a flight may miss its times, unless the mission states it. TVFH+ decides every 0.5 s and
/// flies some 20 m/s and more; a few seconds are what a crew reads off a clock.
inline constexpr double kTimeTolerance_s = 5.0;

/// How far before a place, in line with the heading that is asked for there, a flight is led: more
/// than the radius of a turn at 62 m/s and 30 degrees of bank.
inline constexpr double kApproach_m = 800.0;

/// What a mission asks for.
struct Mission {
  MissionPoint start;
  MissionPoint goal;
  std::vector<MissionPoint> via;  // in this order
  std::optional<double> speed_mps;
  double time_tolerance_s = kTimeTolerance_s;
  AreaFiles areas;                   // of this flight alone
  std::vector<Fence> fences;         // the same, as autopilots state them
  std::vector<std::string> remarks;  // what a user should know: a take-off that is not planned, ...
};

/// Most points that a mission may have; more is a recorded track.
inline constexpr std::size_t kMissionPointsMax = 200;

/// Reads a mission by the extension of its file.
///
/// - `.yaml`, `.yml`: our own form. `start`, `goal` and the entries of the list `via` hold
///   `latitude_deg` and `longitude_deg`, and perhaps `height_m` (above the surface) or `altitude_m`
///   (above mean sea level, the map's datum), `time` (ISO 8601 with a zone) and
///   `heading_true_deg`. For the whole `speed_mps`, `time_tolerance_s`, and `areas`, a list of
///   files beside the mission that read_areas() takes.
/// - `.geojson`, `.json`, `.kml`, `.kmz`: one line, from its first to its last position, or points
///   in the order of the file; of points, those whose attribute `role` (else name) is "start" and
///   "goal" are these, wherever they stand. Attributes of points: `height_m`, `altitude_m`,
///   `time` and `heading_true_deg` as in YAML, and of the start (or the line) `speed_mps`. Else the
///   third number of a position counts: above the ellipsoid in GeoJSON (RFC 7946) unless it is 0;
///   in KML as altitudeMode says. Polygons are areas, with the attributes of read_areas().
/// - `.gpx`: its one route, else its waypoints; `ele` is above mean sea level.
/// - `.plan` (QGroundControl) and `.waypoints` (QGC WPL 110): waypoints in the frames 0 (above mean
///   sea level), 3 (above home) and 10 (above ground), a take-off as start and a landing as goal,
///   both without being planned, one ground speed, and geofences.
///
/// A heading at a via point or at the goal becomes two further via points before it, in line, the
/// nearer one at `kApproach_m` and the other twice as far, with a remark.
///
/// What a flight of hedgehop cannot keep is refused, not dropped: headings in lists of autopilots,
/// several speeds, waiting, loops, other commands.
///
/// @throws UsageError   the file asks for what cannot be planned; says what, where, what to do.
/// @throws ConfigError  a YAML file is wrong.
/// @throws DataError    the file is missing, damaged or of no kind that is read.
Mission read_mission(const std::filesystem::path& file);

}  // namespace hedgehop::map_sources
