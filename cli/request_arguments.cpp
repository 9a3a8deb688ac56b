#include "request_arguments.hpp"

#include <CLI/CLI.hpp>
#include <charconv>
#include <cmath>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "base/utc_time.hpp"
#include "effective_config.hpp"
#include "geo/vertical_datum.hpp"
#include "planning/request_areas.hpp"
#include "preparation/areas.hpp"
#include "raster/grid.hpp"

namespace hedgehop::cli {
namespace {

using Reference = map_sources::MissionPoint::Reference;

map_sources::MissionPoint point_of(const std::string& text, const std::string& option) {
  const flight::RequestPoint point = parse_request_point(text, option);
  map_sources::MissionPoint mission_point;
  mission_point.position = point.position;
  mission_point.height_m = point.height_m;
  mission_point.place = option;
  return mission_point;
}

// The areas of a mission, as its map places them.
std::vector<flight::RequestArea> areas_of(const map_sources::Mission& mission, const map::Map& map,
                                          Observer& observer) {
  ConfigReader config = effective_config("prepare.yaml", "", {});
  const preparation::AreaOptions options = preparation::PrepareOptions::read(config).areas;
  const geo::MapProjection projection(map.crs_wkt);
  const preparation::Areas areas = preparation::read_areas(
      mission.areas, mission.fences, projection, map.geometry, options, observer);
  for (const auto& [kind, count] : areas.left_out) {
    observer.note(std::to_string(count) + " area(s) of the kind '" + kind +
                  "' are left out: neither hard nor soft by areas in prepare.yaml; give them an "
                  "attribute hard");
  }
  return planning::request_areas_of(areas.areas, projection);
}

// A height as planners count them: above the surface model. Nothing where the map knows none, for
// planners to say so.
std::optional<double> height_above_surface_m(const map_sources::MissionPoint& point,
                                             const map::Map& map) {
  const geo::MapPoint place = geo::MapProjection(map.crs_wkt).to_map(point.position);
  if (!map.geometry.contains(place)) {
    return std::nullopt;
  }
  double altitude_m = *point.height_m;
  if (point.reference == Reference::kGround) {
    altitude_m += raster::sample_bilinear(map.terrain_m, place);
  } else if (point.reference != Reference::kMapDatum) {
    const auto from =
        geo::VerticalDatum::parse(point.reference == Reference::kEllipsoid ? "ellipsoid" : "EGM96");
    const auto to = geo::VerticalDatum::parse(map.vertical_datum);
    if (!(from == to)) {
      constexpr double kMargin_rad = 1e-4;
      const geo::GeodeticPosition& p = point.position;
      altitude_m +=
          geo::VerticalShift(from, to,
                             {p.longitude_rad - kMargin_rad, p.latitude_rad - kMargin_rad,
                              p.longitude_rad + kMargin_rad, p.latitude_rad + kMargin_rad})
              .at_m(p);
    }
  }
  const double height_m = altitude_m - raster::sample_bilinear(map.surface_m, place);
  return std::isnan(height_m) ? std::nullopt : std::optional(height_m);
}

}  // namespace

Time parse_time(const std::string& text, const std::string& option) {
  const auto time = parse_utc(text);
  if (!time) {
    throw UsageError(option + " '" + text + "' is no ISO 8601 time with a zone",
                     "write for example 2026-05-01T06:30:00Z or 2026-05-01T08:30+02:00");
  }
  return *time;
}

flight::RequestPoint parse_request_point(const std::string& text, const std::string& option) {
  const auto refuse = [&](const std::string& why) {
    throw UsageError(option + " '" + text + "' " + why,
                     "write latitude,longitude[,height above the surface in metres], for example "
                     "49.987,11.542 or 49.987,11.542,30");
  };
  std::vector<double> numbers;
  const char* cursor = text.data();
  const char* const end = text.data() + text.size();
  while (true) {
    double number = 0.0;
    const auto [next, error] = std::from_chars(cursor, end, number);
    if (error != std::errc() || !std::isfinite(number)) {
      refuse("is not a list of numbers");
    }
    numbers.push_back(number);
    if (next == end) {
      break;
    }
    if (*next != ',') {
      refuse("is not a list of numbers");
    }
    cursor = next + 1;
  }
  if (numbers.size() < 2 || numbers.size() > 3) {
    refuse("has " + std::to_string(numbers.size()) + " numbers, 2 or 3 are needed");
  }
  if (std::fabs(numbers[0]) > 90.0) {
    refuse("has a latitude beyond 90 degrees");
  }
  if (std::fabs(numbers[1]) > 180.0) {
    refuse("has a longitude beyond 180 degrees");
  }
  flight::RequestPoint point;
  point.position = {radians_from_degrees(numbers[0]), radians_from_degrees(numbers[1])};
  if (numbers.size() == 3) {
    point.height_m = numbers[2];
  }
  return point;
}

void RequestArguments::add_to(CLI::App& verb) {
  auto* start_option =
      verb.add_option("--start", start, "Where it begins: LAT,LON[,HEIGHT_M above the surface]");
  auto* goal_option = verb.add_option("--goal", goal, "Where it ends: LAT,LON[,HEIGHT_M]");
  auto* via_option =
      verb.add_option("--via", via,
                      "A place to pass: LAT,LON[,HEIGHT_M]; may be given several times")
          ->allow_extra_args(false);
  verb.add_option("--mission", mission_file,
                  "All of these from a file: YAML, GeoJSON, KML, GPX, .plan or .waypoints")
      ->excludes(start_option)
      ->excludes(goal_option)
      ->excludes(via_option);
  verb.add_flag("--ignore-heights", ignores_heights,
                "Take places of the mission file alone; heights as without any");
  verb.add_option_function<double>(
          "--start-heading-deg",
          [this](double value) {
            start_heading_deg = value;
            has_start_heading = true;
          },
          "From true north, clockwise (default: towards the first waypoint)")
      ->check(CLI::Range(-360.0, 360.0));
  verb.add_option("--speed-mps", speed_mps, "Airspeed (default: speed_mps of the config)")
      ->check(CLI::PositiveNumber);
  verb.add_option("--departure", departure,
                  "When it begins, as 2026-05-01T06:30Z; with an arrival, the speed follows");
  verb.add_option("--arrival", arrival, "When to be at the goal; alone, the departure follows");
  verb.add_option("--seed", seed, "Seed of the global planner (default 1)");
  verb.add_option("--work", work,
                  "Work budget of the global planner in legs evaluated (default: config)")
      ->check(CLI::PositiveNumber);
  verb.add_option("--config", config_file,
                  "YAML file whose keys replace those of the shipped planning.yaml");
  verb.add_option("--set", settings,
                  "One setting, key=value, as weights.visibility=10; may be repeated")
      ->allow_extra_args(false);
}

map_sources::Mission RequestArguments::mission(const Console& console) const {
  if (mission_file.empty()) {
    if (start.empty() || goal.empty()) {
      throw UsageError(std::string(start.empty() ? "--start" : "--goal") + " is missing",
                       "give --start and --goal, or --mission with a file that holds them");
    }
    if (ignores_heights) {
      throw UsageError("--ignore-heights is for heights of a file",
                       "leave the heights out of --start, --goal and --via");
    }
    map_sources::Mission mission;
    mission.start = point_of(start, "--start");
    mission.goal = point_of(goal, "--goal");
    for (const std::string& point : via) {
      mission.via.push_back(point_of(point, "--via"));
    }
    return mission;
  }
  map_sources::Mission mission = map_sources::read_mission(mission_file);
  for (const std::string& remark : mission.remarks) {
    console.say("note: " + remark);
  }
  if (ignores_heights) {
    mission.start.height_m.reset();
    mission.goal.height_m.reset();
    for (map_sources::MissionPoint& point : mission.via) {
      point.height_m.reset();
    }
  }
  return mission;
}

flight::PlanRequest RequestArguments::plan_request(const map_sources::Mission& mission,
                                                   const map::Map* map, Observer& observer) const {
  const auto request_point = [&](const map_sources::MissionPoint& point) {
    flight::RequestPoint request{point.position, point.height_m};
    if (point.height_m && point.reference != Reference::kSurface) {
      if (map == nullptr) {
        throw UsageError(point.place +
                             " has a height that is not counted from the surface, which takes the "
                             "map to convert",
                         "give height_m, plan with hedgehop plan, or add --ignore-heights");
      }
      request.height_m = height_above_surface_m(point, *map);
    }
    return request;
  };
  flight::PlanRequest request;
  if (!mission.areas.empty() || !mission.fences.empty()) {
    if (map == nullptr) {
      throw UsageError("the mission has areas of its own, which take the map to place",
                       "plan with hedgehop plan, or put them on the map of the services: hedgehop "
                       "patch add area");
    }
    request.areas = areas_of(mission, *map, observer);
  }
  request.start = request_point(mission.start);
  request.goal = request_point(mission.goal);
  for (const map_sources::MissionPoint& point : mission.via) {
    request.via.push_back(request_point(point));
  }
  // The command line stands above the file.
  request.start_heading_true_rad =
      has_start_heading ? std::optional(wrap_to_two_pi(radians_from_degrees(start_heading_deg)))
                        : mission.start.heading_true_rad;
  request.speed_mps = speed_mps > 0.0 ? std::optional(speed_mps) : mission.speed_mps;
  request.seed = seed;
  request.work_budget = work;
  return request;
}

std::optional<planning::TimeDemand> RequestArguments::time_demand(
    const map_sources::Mission& mission) const {
  planning::TimeDemand demand;
  const auto add = [&](std::size_t place, const std::optional<Time>& time) {
    if (time) {
      demand.targets.push_back({place, *time});
    }
  };
  // The command line stands above the file.
  add(0, departure.empty() ? mission.start.time : parse_time(departure, "--departure"));
  for (std::size_t i = 0; i < mission.via.size(); ++i) {
    add(i + 1, mission.via[i].time);
  }
  add(mission.via.size() + 1,
      arrival.empty() ? mission.goal.time : parse_time(arrival, "--arrival"));
  if (demand.targets.empty()) {
    return std::nullopt;
  }
  if (demand.targets.size() > 1 && (speed_mps > 0.0 || mission.speed_mps)) {
    throw UsageError("times at two places fix the speed, which is given too",
                     "leave out the speed, or all times but one");
  }
  demand.tolerance_s = mission.time_tolerance_s;
  return demand;
}

}  // namespace hedgehop::cli
