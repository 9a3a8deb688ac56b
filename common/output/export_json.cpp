// Formats that are or hold JSON: GeoJSON, CZML, the plans of QGroundControl, MCAP.
#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "base/utc_time.hpp"
#include "output/export_writers.hpp"
#include "output/json_document.hpp"
#include "output/mcap_file.hpp"
#include "output/rounding.hpp"
#include "output/trajectory_columns.hpp"

namespace hedgehop::output {
namespace {

using Json = nlohmann::ordered_json;
using Vector = std::array<double, 3>;

Vector sum(double a, const Vector& v, double b, const Vector& w) {
  return {a * v[0] + b * w[0], a * v[1] + b * w[1], a * v[2] + b * w[2]};
}

Vector cross(const Vector& v, const Vector& w) {
  return {v[1] * w[2] - v[2] * w[1], v[2] * w[0] - v[0] * w[2], v[0] * w[1] - v[1] * w[0]};
}

// Unit quaternion (x, y, z, w) of the rotation whose columns are given: the largest component is
// taken from the trace, the others from differences and sums of elements.
std::array<double, 4> quaternion(const Vector& x, const Vector& y, const Vector& z) {
  const std::array<double, 4> squares = {1.0 + x[0] - y[1] - z[2], 1.0 - x[0] + y[1] - z[2],
                                         1.0 - x[0] - y[1] + z[2], 1.0 + x[0] + y[1] + z[2]};
  const std::size_t largest =
      static_cast<std::size_t>(std::max_element(squares.begin(), squares.end()) - squares.begin());
  std::array<double, 4> q{};
  const double root = std::sqrt(squares[largest]);
  q[largest] = 0.5 * root;
  const double f = 0.5 / root;
  switch (largest) {
    case 0:
      q[1] = f * (x[1] + y[0]);
      q[2] = f * (x[2] + z[0]);
      q[3] = f * (y[2] - z[1]);
      break;
    case 1:
      q[0] = f * (x[1] + y[0]);
      q[2] = f * (y[2] + z[1]);
      q[3] = f * (z[0] - x[2]);
      break;
    case 2:
      q[0] = f * (x[2] + z[0]);
      q[1] = f * (y[2] + z[1]);
      q[3] = f * (x[1] - y[0]);
      break;
    default:
      q[0] = f * (y[2] - z[1]);
      q[1] = f * (z[0] - x[2]);
      q[2] = f * (x[1] - y[0]);
  }
  return q;
}

// From the axes of the helicopter (forward, left, up) to those of the earth (EPSG:4978).
std::array<double, 4> orientation(const flight::FlightState& state, const Places::Degrees& place) {
  const double latitude = radians_from_degrees(place.latitude_deg);
  const double longitude = radians_from_degrees(place.longitude_deg);
  const double sin_lat = elementary::sin(latitude);
  const double cos_lat = elementary::cos(latitude);
  const double sin_lon = elementary::sin(longitude);
  const double cos_lon = elementary::cos(longitude);
  const Vector east = {-sin_lon, cos_lon, 0.0};
  const Vector north = {-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat};
  const Vector up = {cos_lat * cos_lon, cos_lat * sin_lon, sin_lat};
  const double sin_heading = elementary::sin(state.heading_true_rad);
  const double cos_heading = elementary::cos(state.heading_true_rad);
  const Vector ahead = sum(sin_heading, east, cos_heading, north);
  const Vector level_right = sum(cos_heading, east, -sin_heading, north);
  const Vector forward =
      sum(elementary::cos(state.pitch_rad), ahead, elementary::sin(state.pitch_rad), up);
  const Vector level_up = cross(level_right, forward);
  const double sin_bank = elementary::sin(state.bank_rad);
  const double cos_bank = elementary::cos(state.bank_rad);
  const Vector body_up = sum(cos_bank, level_up, sin_bank, level_right);
  const Vector left = sum(-cos_bank, level_right, sin_bank, level_up);
  return quaternion(forward, left, body_up);
}

}  // namespace

std::string geojson_text(const flight::Plan& plan, Places& places, const ExportRequest& request,
                         const ExportOptions& options) {
  const auto position = [&](double x_m, double y_m, double altitude_m) {
    const Places::Degrees p = places.degrees({x_m, y_m});
    return Json::array(
        {p.longitude_deg, p.latitude_deg, places.ellipsoid_m({x_m, y_m}, altitude_m)});
  };
  const auto line = [&](const auto& points) {
    Json coordinates = Json::array();
    for (const auto& point : points) {
      coordinates.push_back(position(point.x_m, point.y_m, point.altitude_m));
    }
    return Json{{"type", "LineString"}, {"coordinates", std::move(coordinates)}};
  };
  Json features = Json::array();
  const auto add = [&](Json geometry, Json properties) {
    features.push_back({{"type", "Feature"},
                        {"geometry", std::move(geometry)},
                        {"properties", std::move(properties)}});
  };

  const auto& waypoints = plan.route_plan.route.waypoints;
  add(line(waypoints), {{"kind", "route"},
                        {"length_m", flight::length_m(waypoints)},
                        {"cost_m", plan.route_plan.route.cost.total_m()}});
  const std::vector<flight::FlightState> track = thinned(plan.trajectory, options.track_step_s);
  Json flown = {{"kind", "flight"},
                {"length_m", plan.measures.length_m},
                {"duration_s", plan.measures.duration_s},
                {"clearance_min_m", plan.verdict.clearance_min_m},
                {"is_verified", plan.verdict.is_verified}};
  Json seconds = Json::array();
  Json times = Json::array();
  for (const flight::FlightState& state : track) {
    seconds.push_back(rounded(state.time_s, 1e6));
    times.push_back(time_text(request.start_time, state.time_s));
  }
  flown["times_s"] = std::move(seconds);  // one for each position, since the start
  if (request.start_time) {
    flown["coordTimes"] = std::move(times);
  }
  add(line(track), std::move(flown));
  for (std::size_t i = 0; i < waypoints.size(); ++i) {
    const flight::Waypoint& waypoint = waypoints[i];
    add({{"type", "Point"},
         {"coordinates", position(waypoint.x_m, waypoint.y_m, waypoint.altitude_m)}},
        {{"kind", "waypoint"}, {"number", i}, {"altitude_m", rounded(waypoint.altitude_m, 1e3)}});
  }

  Json json;
  json["type"] = "FeatureCollection";
  json["lines"] = product_lines(plan);
  json["heights"] = std::string(entry_of(ExportFormat::kGeoJson).heights);
  json["vertical_datum_of_altitude_m"] = plan.route_plan.map.vertical_datum;
  json["features"] = std::move(features);
  return dumped(json);
}

std::string czml_text(const flight::Plan& plan, Places& places, const ExportRequest& request,
                      const ExportOptions& options) {
  // A scene without a clock does not move; without a date the millennium serves.
  constexpr Time kMillennium{946'684'800'000'000};
  const Time start = request.start_time.value_or(kMillennium);
  const std::vector<flight::FlightState> track = thinned(plan.trajectory, options.track_step_s);
  const std::string epoch = utc_text(start);
  const std::string interval = epoch + "/" + time_text(start, track.back().time_s);

  Json positions = Json::array();
  Json orientations = Json::array();
  std::array<double, 4> before{};
  for (const flight::FlightState& state : track) {
    const Places::Degrees p = places.degrees(state.point());
    for (const double value : {rounded(state.time_s, 1e6), p.longitude_deg, p.latitude_deg,
                               places.ellipsoid_m(state.point(), state.altitude_m)}) {
      positions.push_back(value);
    }
    std::array<double, 4> q = orientation(state, p);
    // Both signs mean the same; readers that interpolate want the nearer one.
    const double agreement =
        q[0] * before[0] + q[1] * before[1] + q[2] * before[2] + q[3] * before[3];
    const double sign = agreement < 0.0 ? -1.0 : 1.0;
    orientations.push_back(rounded(state.time_s, 1e6));
    for (double& component : q) {
      component *= sign;
      orientations.push_back(rounded(component, 1e12));
    }
    before = q;
  }
  Json route = Json::array();
  for (const flight::Waypoint& waypoint : plan.route_plan.route.waypoints) {
    const Places::Degrees p = places.degrees(waypoint.point());
    for (const double value : {p.longitude_deg, p.latitude_deg,
                               places.ellipsoid_m(waypoint.point(), waypoint.altitude_m)}) {
      route.push_back(value);
    }
  }
  std::string description;
  for (const std::string& line : product_lines(plan)) {
    for (const char c : line) {
      // Descriptions are read as HTML.
      description += c == '<' ? "&lt;" : c == '&' ? "&amp;" : std::string(1, c);
    }
    description += "<br>";
  }
  const auto color = [](int red, int green, int blue, int alpha) {
    return Json{{"solidColor", {{"color", {{"rgba", {red, green, blue, alpha}}}}}}};
  };
  const Json json = {
      {{"id", "document"},
       {"name", "hedgehop flight"},
       {"version", "1.0"},
       {"clock",
        {{"interval", interval}, {"currentTime", epoch}, {"multiplier", 1}, {"range", "CLAMPED"}}}},
      {{"id", "flight"},
       {"name", "Flight"},
       {"description", description},
       {"availability", interval},
       {"position",
        {{"epoch", epoch},
         {"interpolationAlgorithm", "LINEAR"},
         {"cartographicDegrees", std::move(positions)}}},
       {"orientation",
        {{"epoch", epoch},
         {"interpolationAlgorithm", "LINEAR"},
         {"unitQuaternion", std::move(orientations)}}},
       {"point", {{"pixelSize", 10}, {"color", {{"rgba", {0, 85, 255, 255}}}}}},
       {"path", {{"width", 2}, {"material", color(0, 85, 255, 255)}}}},
      {{"id", "route"},
       {"name", "Planned route"},
       {"polyline",
        {{"positions", {{"cartographicDegrees", std::move(route)}}},
         {"arcType", "NONE"},
         {"width", 2},
         {"material", color(255, 165, 0, 255)}}}}};
  return dumped(json);
}

std::string qgc_plan_text(const WaypointList& list) {
  constexpr int kGlobalAmsl = 0;     // MAV_FRAME_GLOBAL
  constexpr int kNoPlace = 2;        // MAV_FRAME_MISSION
  constexpr int kWaypoint = 16;      // MAV_CMD_NAV_WAYPOINT
  constexpr int kChangeSpeed = 178;  // MAV_CMD_DO_CHANGE_SPEED: 1 = ground speed, m/s, throttle
  constexpr int kAltitudeAmsl = 2;   // AltitudeMode of QGroundControl: absolute
  constexpr int kArduPilot = 3;      // MAV_AUTOPILOT_ARDUPILOTMEGA, which flies helicopters
  constexpr int kHelicopter = 4;     // MAV_TYPE_HELICOPTER
  Json items = Json::array();
  for (const MissionItem& item : list.items) {
    Json json;
    if (!item.is_speed) {
      json["AMSLAltAboveTerrain"] = nullptr;
      json["Altitude"] = item.amsl_m;
      json["AltitudeMode"] = kAltitudeAmsl;
    }
    json["autoContinue"] = true;
    json["command"] = item.is_speed ? kChangeSpeed : kWaypoint;
    json["doJumpId"] = items.size() + 1;
    json["frame"] = item.is_speed ? kNoPlace : kGlobalAmsl;
    json["params"] = item.is_speed ? Json::array({1, item.speed_mps, -1, 0, 0, 0, 0})
                                   : Json::array({0, 0, 0, nullptr, item.place.latitude_deg,
                                                  item.place.longitude_deg, item.amsl_m});
    json["type"] = "SimpleItem";
    items.push_back(std::move(json));
  }
  Json json;
  json["fileType"] = "Plan";
  json["geoFence"] = {{"circles", Json::array()}, {"polygons", Json::array()}, {"version", 2}};
  json["groundStation"] = "hedgehop";
  json["mission"] = {
      {"cruiseSpeed", list.cruise_speed_mps},
      {"firmwareType", kArduPilot},
      {"globalPlanAltitudeMode", kAltitudeAmsl},
      {"hoverSpeed", list.cruise_speed_mps},
      {"items", std::move(items)},
      {"plannedHomePosition", {list.home.latitude_deg, list.home.longitude_deg, list.home_amsl_m}},
      {"vehicleType", kHelicopter},
      {"version", 2}};
  json["rallyPoints"] = {{"points", Json::array()}, {"version", 2}};
  json["version"] = 1;
  return dumped(json);
}

std::string mcap_bytes(const flight::Plan& plan, Places& places, const ExportRequest& request,
                       const ExportOptions& options) {
  const auto compact = [](const Json& json) {
    return json.dump(-1, ' ', false, Json::error_handler_t::replace);
  };
  const auto object = [](Json properties) {
    return Json{{"type", "object"}, {"properties", std::move(properties)}};
  };
  const Json number = {{"type", "number"}};
  const Json text = {{"type", "string"}};
  const Json timestamp = object({{"sec", {{"type", "integer"}}}, {"nsec", {{"type", "integer"}}}});

  McapFile file("hedgehop");
  Json columns;
  for (const TrajectoryColumn& column : kTrajectoryColumns) {
    columns[column.name] = {{"type", {"number", "null"}}};
  }
  const auto state_channel =
      file.add_channel("/flight/state", "hedgehop.FlightState", compact(object(columns)));
  const auto location_channel = file.add_channel(
      "/flight/location", "foxglove.LocationFix",
      compact(object({{"timestamp", timestamp},
                      {"frame_id", text},
                      {"latitude", number},
                      {"longitude", number},
                      {"altitude", number},
                      {"position_covariance",
                       {{"type", "array"}, {"items", number}, {"minItems", 9}, {"maxItems", 9}}},
                      {"position_covariance_type", {{"type", "integer"}}}})));
  const auto route_channel =
      file.add_channel("/flight/route", "foxglove.GeoJSON", compact(object({{"geojson", text}})));

  McapFile::Entries about = {{"request_id", plan.route_plan.request_id.hex()},
                             {"map_hash", plan.route_plan.map.hash.hex()},
                             {"vertical_datum_of_altitude_m", plan.route_plan.map.vertical_datum},
                             {"altitude_of_location", entry_of(ExportFormat::kMcap).heights},
                             {"is_verified", plan.verdict.is_verified ? "true" : "false"}};
  const std::vector<std::string> lines = product_lines(plan);
  for (std::size_t i = 0; i < lines.size(); ++i) {
    // Through JSON and back, so that it is UTF-8 whatever the map's files held.
    about.emplace_back("line_" + std::to_string(i),
                       Json::parse(compact(lines[i])).get<std::string>());
  }
  file.add_metadata("hedgehop", about);

  const std::int64_t start_us = request.start_time.value_or(Time{0}).utime_us;
  const auto time_ns = [&](double time_s) {
    return static_cast<std::uint64_t>(start_us * 1000 +
                                      static_cast<std::int64_t>(std::round(time_s * 1e9)));
  };
  Json route = Json::array();
  for (const flight::Waypoint& waypoint : plan.route_plan.route.waypoints) {
    const Places::Degrees p = places.degrees(waypoint.point());
    route.push_back({p.longitude_deg, p.latitude_deg,
                     places.ellipsoid_m(waypoint.point(), waypoint.altitude_m)});
  }
  const Json feature = {{"type", "Feature"},
                        {"properties", {{"name", "Planned route"}}},
                        {"geometry", {{"type", "LineString"}, {"coordinates", std::move(route)}}}};
  file.add_message(route_channel, time_ns(0.0), compact({{"geojson", compact(feature)}}));

  double next_location_s = 0.0;
  const double last_s = plan.trajectory.states.back().time_s;
  for (const flight::FlightState& state : plan.trajectory.states) {
    const std::uint64_t now_ns = time_ns(state.time_s);
    const Places::Degrees p = places.degrees(state.point());
    Json values;
    for (const TrajectoryColumn& column : kTrajectoryColumns) {
      values[column.name] = column.member != nullptr ? Json(state.*column.member) : Json();
    }
    values["latitude_deg"] = p.latitude_deg;
    values["longitude_deg"] = p.longitude_deg;
    values["height_above_surface_m"] = state.altitude_m - state.surface_m;
    values["heading_grid_rad"] =
        grid_from_true_azimuth_rad(state.heading_true_rad, state.convergence_rad);
    file.add_message(state_channel, now_ns, compact(values));
    if (state.time_s >= next_location_s - 1e-9 || state.time_s == last_s) {
      next_location_s = state.time_s + options.track_step_s;
      file.add_message(
          location_channel, now_ns,
          compact(
              {{"timestamp", {{"sec", now_ns / 1'000'000'000}, {"nsec", now_ns % 1'000'000'000}}},
               {"frame_id", "aircraft"},
               {"latitude", p.latitude_deg},
               {"longitude", p.longitude_deg},
               {"altitude", places.ellipsoid_m(state.point(), state.altitude_m)},
               {"position_covariance", Json::array({0, 0, 0, 0, 0, 0, 0, 0, 0})},
               {"position_covariance_type", 0}}));
    }
  }
  return file.finish();
}

}  // namespace hedgehop::output
