#pragma once

#include <filesystem>
#include <string>

#include "flight/plan.hpp"

namespace hedgehop::output {

inline constexpr int kPlanSchemaVersion = 1;
inline constexpr char kPlanFile[] = "plan.json";
inline constexpr char kRouteFile[] = "route.geojson";
inline constexpr char kTrajectoryFile[] = "trajectory.csv";

/// Writes plan.json, route.geojson and trajectory.csv into an existing, empty folder. Same plan,
/// same bytes. Throws SystemFailure.
void write_plan_bundle(const flight::Plan& plan, const std::filesystem::path& folder);

/// Reads a bundle back: plan.json and trajectory.csv; the route's GeoJSON is for others. Throws
/// DataError naming file, line and field.
flight::Plan read_plan_bundle(const std::filesystem::path& folder);

/// plan.json: request, map, config, route, costs, measures, verdict and warnings.
///
/// SI units and radians; positions in latitude and longitude stand there twice, in degrees for
/// people and in radians, exact, for reading back. What is unknown or not finite is null. No run
/// times, and no times of day but those of the timetable: the same plan is the same text.
std::string plan_json(const flight::Plan& plan);

/// The route as GeoJSON after RFC 7946: the planned line, its waypoints, start and goal, and the
/// flown track, one position for each second.
///
/// Longitude and latitude in WGS 84; the third number is the altitude above mean sea level in the
/// map's vertical datum, not above the ellipsoid as the RFC says, which the properties state. A map
/// without coordinate system gives features without geometry.
std::string route_geojson(const flight::Plan& plan);

/// The trajectory, one state a line, names with units in the first line.
///
/// Every number of the state is written so that it reads back as the same number. Beside them stand
/// latitude and longitude (8 decimals, 1 mm), heading from grid north and height above the surface,
/// which follow from the others and are not read back. Unknown is `nan`.
std::string trajectory_csv(const flight::Plan& plan);

}  // namespace hedgehop::output
