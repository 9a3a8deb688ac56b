#include "output/exports.hpp"

#include <algorithm>
#include <cmath>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "base/utc_time.hpp"
#include "output/export_writers.hpp"
#include "output/rounding.hpp"
#include "raster/grid.hpp"

namespace hedgehop::output {
namespace {

constexpr char kAmsl[] = "above mean sea level (EGM96)";
constexpr char kEllipsoid[] = "above the WGS 84 ellipsoid";
constexpr char kMapDatum[] = "above mean sea level, in the map's vertical datum";

// What surrounds all places of a plan, with room for rounding.
geo::GeodeticBox area_of(const flight::Plan& plan, const geo::MapProjection& projection) {
  geo::GeodeticBox area{10.0, 10.0, -10.0, -10.0};
  const auto add = [&](const geo::MapPoint& point) {
    const geo::GeodeticPosition p = projection.to_geodetic(point);
    constexpr double kMargin_rad = 1e-4;
    area.west_rad = std::min(area.west_rad, p.longitude_rad - kMargin_rad);
    area.east_rad = std::max(area.east_rad, p.longitude_rad + kMargin_rad);
    area.south_rad = std::min(area.south_rad, p.latitude_rad - kMargin_rad);
    area.north_rad = std::max(area.north_rad, p.latitude_rad + kMargin_rad);
  };
  for (const flight::Waypoint& waypoint : plan.route_plan.route.waypoints) {
    add(waypoint.point());
  }
  for (const flight::FlightState& state : thinned(plan.trajectory, 10.0)) {
    add(state.point());
  }
  return area;
}

geo::MapProjection projection_of(const flight::Plan& plan) {
  const std::string& wkt = plan.route_plan.map.crs_wkt;
  if (wkt.empty()) {
    throw DataError("the plan's map has no coordinate system, so it has no place on the earth",
                    "prepare a map with one, or export csv");
  }
  return geo::MapProjection(wkt);
}

}  // namespace

const std::vector<ExportFormatEntry>& export_formats() {
  static const std::vector<ExportFormatEntry> entries = {
      {ExportFormat::kKml, "kml", ".kml", kAmsl, false},
      {ExportFormat::kKmz, "kmz", ".kmz", kAmsl, false},
      {ExportFormat::kGeoJson, "geojson", ".geojson", kEllipsoid, false},
      {ExportFormat::kGpkg, "gpkg", ".gpkg", kMapDatum, false},
      {ExportFormat::kGpx, "gpx", ".gpx", kAmsl, false},
      {ExportFormat::kCsv, "csv", ".csv", kMapDatum, false},
      {ExportFormat::kQgcPlan, "qgc", ".plan", kAmsl, true},
      {ExportFormat::kWaypoints, "waypoints", ".waypoints", kAmsl, true},
      {ExportFormat::kCzml, "czml", ".czml", kEllipsoid, false},
      {ExportFormat::kMcap, "mcap", ".mcap", kEllipsoid, false},
  };
  return entries;
}

const ExportFormatEntry& entry_of(ExportFormat format) {
  const auto& entries = export_formats();
  const auto found = std::find_if(entries.begin(), entries.end(),
                                  [&](const ExportFormatEntry& e) { return e.format == format; });
  HEDGEHOP_ASSERT(found != entries.end());
  return *found;
}

ExportFormat export_format(std::string_view name) {
  std::vector<std::string> known;
  std::string list;
  for (const ExportFormatEntry& entry : export_formats()) {
    if (name == entry.name) {
      return entry.format;
    }
    known.emplace_back(entry.name);
    list += (list.empty() ? "" : ", ") + known.back();
  }
  const auto nearest = nearest_word(name, known);
  throw UsageError("export format '" + std::string(name.substr(0, 60)) + "' is not known",
                   (nearest ? "did you mean '" + *nearest + "'? Formats: " : "formats: ") + list);
}

ExportOptions read_export_options(ConfigReader& reader) {
  ExportOptions options;
  options.track_step_s = reader.required_double("track_step_s");
  options.speed_step_mps = reader.required_double("speed_step_mps");
  reader.require(options.track_step_s >= 0.01 && options.track_step_s <= 60.0, "track_step_s",
                 "must lie in [0.01, 60]");
  reader.require(options.speed_step_mps >= 0.0 && options.speed_step_mps <= 100.0, "speed_step_mps",
                 "must lie in [0, 100]");
  ConfigReader legs = reader.required_section("legs");
  options.legs = read_leg_options(legs);
  reader.finish();
  return options;
}

Places::Places(const flight::Plan& plan)
    : projection_(projection_of(plan)),
      datum_(plan.route_plan.map.vertical_datum),
      area_(area_of(plan, projection_)) {}

Places::Degrees Places::degrees(const geo::MapPoint& point) const {
  const geo::GeodeticPosition p = projection_.to_geodetic(point);
  return {rounded(degrees_from_radians(p.latitude_rad), 1e9),
          rounded(degrees_from_radians(p.longitude_rad), 1e9)};
}

double Places::shifted_m(std::optional<geo::VerticalShift>& shift, const char* to,
                         const geo::MapPoint& point, double altitude_m) {
  const geo::VerticalDatum from = [&] {
    try {
      return geo::VerticalDatum::parse(datum_);
    } catch (const UsageError& error) {
      throw DataError("the plan's map: " + std::string(error.what()),
                      "prepare the map again with a known --vertical-datum");
    }
  }();
  const geo::VerticalDatum target = geo::VerticalDatum::parse(to);
  if (from == target) {
    return rounded(altitude_m, 1e3);
  }
  if (!shift) {
    shift.emplace(from, target, area_);
  }
  const double shift_m = shift->at_m(projection_.to_geodetic(point));
  if (std::isnan(shift_m)) {
    throw DataError("the geoid grid between " + from.name + " and " + target.name +
                        " knows nothing at one of the plan's places",
                    "install a grid that covers the region, or export csv");
  }
  return rounded(altitude_m + shift_m, 1e3);
}

double Places::amsl_m(const geo::MapPoint& point, double altitude_m) {
  return shifted_m(to_amsl_, "EGM96", point, altitude_m);
}

double Places::ellipsoid_m(const geo::MapPoint& point, double altitude_m) {
  return shifted_m(to_ellipsoid_, "ellipsoid", point, altitude_m);
}

std::vector<flight::FlightState> thinned(const flight::Trajectory& trajectory, double step_s) {
  std::vector<flight::FlightState> track;
  for (const flight::FlightState& state : trajectory.states) {
    if (track.empty() || state.time_s - track.back().time_s >= step_s - 1e-9) {
      track.push_back(state);
    }
  }
  if (!track.empty() && track.back().time_s != trajectory.states.back().time_s) {
    track.push_back(trajectory.states.back());
  }
  return track;
}

WaypointList waypoint_list(const flight::Plan& plan, Places& places, const ExportRequest& request,
                           const ExportOptions& options) {
  HEDGEHOP_ASSERT(request.map != nullptr);
  WaypointList list;
  list.legs = straight_legs(plan.trajectory, *request.map, request.clearance_m, options.legs);
  const auto& states = plan.trajectory.states;
  const std::vector<std::size_t>& corners = list.legs.states;

  // Ground speed of a leg: the way flown over the time taken.
  const auto speed_of = [&](std::size_t from, std::size_t to) {
    double way_m = 0.0;
    for (std::size_t i = from + 1; i <= to; ++i) {
      const double dx_m = states[i].x_m - states[i - 1].x_m;
      const double dy_m = states[i].y_m - states[i - 1].y_m;
      way_m += std::sqrt(dx_m * dx_m + dy_m * dy_m);
    }
    return rounded(way_m / (states[to].time_s - states[from].time_s), 10.0);
  };
  list.cruise_speed_mps = speed_of(0, states.size() - 1);
  double commanded_mps = std::nan("");
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (i + 1 < corners.size()) {
      const double speed_mps = speed_of(corners[i], corners[i + 1]);
      if (!(std::fabs(speed_mps - commanded_mps) <= options.speed_step_mps)) {
        commanded_mps = speed_mps;
        list.items.push_back({true, speed_mps, {}, 0.0});
      }
    }
    const flight::FlightState& state = states[corners[i]];
    // Rounded up, so that a leg as written is never lower than the leg that was checked.
    const double altitude_m = std::ceil(state.altitude_m * 1e3) / 1e3;
    list.items.push_back(
        {false, 0.0, places.degrees(state.point()), places.amsl_m(state.point(), altitude_m)});
  }
  const flight::FlightState& first = states.front();
  list.home = places.degrees(first.point());
  const double ground_m = raster::sample_bilinear(request.map->terrain_m, first.point());
  list.home_amsl_m = places.amsl_m(first.point(), ground_m);
  return list;
}

std::vector<std::string> product_lines(const flight::Plan& plan) {
  std::vector<std::string> lines;
  const flight::MapIdentity& map = plan.route_plan.map;
  if (!map.label.empty()) {
    lines.push_back(map.label);
  }
  lines.push_back(plan.verdict.is_verified
                      ? "Verified flight of hedgehop. Not for navigation."
                      : "NOT VERIFIED flight of hedgehop. Not for navigation.");
  lines.insert(lines.end(), map.attributions.begin(), map.attributions.end());
  return lines;
}

std::string time_text(const std::optional<Time>& start, double time_s) {
  return start ? utc_text(*start + (time_s + 1e-7)) : std::string();
}

ExportedFile export_plan(const flight::Plan& plan, ExportFormat format,
                         const ExportRequest& request, const ExportOptions& options) {
  ExportedFile file;
  file.format = format;
  if (plan.trajectory.states.size() < 2) {
    throw DataError("the plan has fewer than 2 states, so there is no flight to export",
                    "plan again, or restore the plan");
  }
  if (format == ExportFormat::kCsv) {
    file.content = csv_text(plan, request);
    return file;
  }
  Places places(plan);
  switch (format) {
    case ExportFormat::kKml:
      file.content = kml_text(plan, places, request, options);
      break;
    case ExportFormat::kKmz:
      file.content = kmz_bytes(kml_text(plan, places, request, options));
      break;
    case ExportFormat::kGeoJson:
      file.content = geojson_text(plan, places, request, options);
      break;
    case ExportFormat::kGpkg:
      file.content = gpkg_bytes(plan, places, request);
      break;
    case ExportFormat::kGpx:
      file.content = gpx_text(plan, places, request, options);
      break;
    case ExportFormat::kCzml:
      file.content = czml_text(plan, places, request, options);
      if (!request.start_time) {
        file.remarks.emplace_back(
            "CZML knows no flight without a date: it begins at 2000-01-01T00:00:00Z; --start-time "
            "sets another");
      }
      break;
    case ExportFormat::kMcap:
      file.content = mcap_bytes(plan, places, request, options);
      if (!request.start_time) {
        file.remarks.emplace_back(
            "without --start-time the times of the recording count from the start of the flight");
      }
      break;
    case ExportFormat::kQgcPlan:
    case ExportFormat::kWaypoints: {
      const WaypointList list = waypoint_list(plan, places, request, options);
      file.content = format == ExportFormat::kQgcPlan ? qgc_plan_text(list) : wpl_text(list);
      file.legs = list.legs;
      break;
    }
    case ExportFormat::kCsv:
      break;
  }
  return file;
}

}  // namespace hedgehop::output
