#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/observer.hpp"
#include "geo/geodetic_box.hpp"
#include "geo/map_projection.hpp"
#include "map_sources/land_use_source.hpp"

namespace hedgehop::map_sources {

/// One entry of an obstacle file, in metres.
struct ObstacleRecord {
  std::int64_t line = 0;  // where it begins in its file, from 1
  StructureKind kind = StructureKind::kOther;
  std::string name;  // may be empty
  geo::GeodeticPosition position;
  std::optional<double> height_m;            // above the ground; it or top_m is there
  std::optional<double> top_m;               // AMSL
  double radius_m = 0.0;                     // own extent
  std::optional<double> horizontal_error_m;  // nothing: unknown
  std::optional<double> vertical_error_m;
  bool is_verified = true;
};

/// Entries of an obstacle file.
///
/// Three forms, told apart by the beginning of the text:
/// - the FAA's Digital Obstacle File in fixed columns (DOF.DAT), with or without its header;
/// - the same as CSV (header OAS, VERIFIED STATUS, ..., AGL and AMSL in feet);
/// - plain CSV with a header. Columns, in any order and case: latitude and longitude in degrees
///   (latitude_deg, latitude, lat; longitude_deg, longitude, lon), height_m or height_ft above the
///   ground (also agl_m, agl_ft), top_amsl_m or top_amsl_ft (also amsl_m, amsl_ft), and if wanted
///   radius_m, horizontal_error_m, vertical_error_m, accuracy (code of the FAA, "1A"), type, name.
///   Others are passed over; a height without a unit in its name is refused. Separated by comma,
///   semicolon (then decimal commas are allowed) or tab; quoted as usual.
///
/// The FAA's accuracy codes: 1 to 8 horizontally are 20, 50, 100, 250, 500, 1000 ft, 1/2 and 1 NM,
/// A to H vertically 3, 10, 20, 50, 125, 250, 500, 1000 ft; 9 and I are unknown. Entries with the
/// action D (dismantled) are left out.
///
/// Nothing is passed over in silence: a line that cannot be read is an error, since it stands for
/// something to collide with.
///
/// @param name  what errors call the file.
/// @throws DataError  what() begins with name:line.
std::vector<ObstacleRecord> parse_obstacles(std::string_view text, const std::string& name);

struct ObstacleObject {
  ObstacleRecord record;
  geo::MapPoint point;
};

struct ObstacleList {
  std::vector<ObstacleObject> obstacles;  // those that may touch the region, in the order of files
  std::int64_t record_count = 0;          // of the files, all over the world
  std::int64_t unverified_count = 0;      // in `obstacles`
  std::int64_t unknown_accuracy_count = 0;
};

/// Reads obstacle files. `reach_m` is how far an obstacle may count beyond its own radius and
/// error. Throws DataError, Interrupted.
ObstacleList read_obstacle_files(const std::vector<std::filesystem::path>& files,
                                 const geo::MapProjection& projection,
                                 const geo::GeodeticBox& region, double reach_m,
                                 Observer& observer);

}  // namespace hedgehop::map_sources
