#include "output/plan_bundle.hpp"

#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "base/files.hpp"
#include "base/utc_time.hpp"
#include "geo/map_projection.hpp"
#include "output/json_document.hpp"
#include "output/rounding.hpp"
#include "output/route_cost_json.hpp"
#include "output/trajectory_columns.hpp"

namespace hedgehop::output {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using Field = JsonDocument::Field;

constexpr char kSchemaName[] = "hedgehop plan";
constexpr char kHint[] = "plan again, or restore the file from where it was written";
constexpr char kFolderHint[] = "give the folder that 'hedgehop plan --out' wrote";
constexpr std::uintmax_t kPlanBytesMax = 256U << 20U;
constexpr std::uintmax_t kTrajectoryBytesMax = 2048U << 20U;
constexpr std::size_t kWaypointsMax = 1'000'000;
constexpr std::size_t kViolationsMax = 100'000;
constexpr std::size_t kLinesMax = 10'000;
constexpr std::size_t kAreasMax = 10'000;
constexpr std::size_t kCornersMax = 1'000'000;
constexpr char kAboveGround[] = "above_ground";
constexpr char kAmsl[] = "amsl";
constexpr std::int64_t kTime_us_max = 7'258'118'400'000'000;  // 2200
constexpr std::int64_t kCountMax = std::numeric_limits<std::int64_t>::max();
constexpr double kPosition_m_max = 1e8;
constexpr double kAltitude_m_max = 1e6;
constexpr double kTrackStep_s = 1.0;

Json optional_json(const std::optional<double>& value) { return value ? Json(*value) : Json(); }

// ---- writing plan.json

Json json_of(const flight::RequestPoint& point) {
  const geo::GeodeticPosition& p = point.position;
  return {{"latitude_deg", rounded(degrees_from_radians(p.latitude_rad), 1e10)},
          {"longitude_deg", rounded(degrees_from_radians(p.longitude_rad), 1e10)},
          {"latitude_rad", p.latitude_rad},
          {"longitude_rad", p.longitude_rad},
          {"height_m", optional_json(point.height_m)}};
}

Json json_of(const flight::RequestAreaEnd& end) {
  return {{"value_m", std::isfinite(end.value_m) ? Json(end.value_m) : Json()},
          {"reference", end.is_above_ground ? kAboveGround : kAmsl}};
}

Json json_of(const flight::RequestArea& area) {
  const auto ring_of = [](const flight::RequestArea::Ring& ring) {
    Json list = Json::array();
    for (const geo::GeodeticPosition& corner : ring) {
      list.push_back({corner.latitude_rad, corner.longitude_rad});
    }
    return list;
  };
  Json polygons = Json::array();
  for (const flight::RequestArea::Polygon& polygon : area.polygons) {
    Json rings = Json::array({ring_of(polygon.outer)});
    for (const flight::RequestArea::Ring& hole : polygon.holes) {
      rings.push_back(ring_of(hole));
    }
    polygons.push_back(std::move(rings));
  }
  return {{"name", area.name},
          {"kind", area.kind},
          {"is_hard", area.is_hard},
          {"floor", json_of(area.floor)},
          {"ceiling", json_of(area.ceiling)},
          {"polygons_latitude_longitude_rad", std::move(polygons)}};
}

Json json_of(const flight::PlanRequest& request) {
  Json via = Json::array();
  for (const flight::RequestPoint& point : request.via) {
    via.push_back(json_of(point));
  }
  Json json = {{"start", json_of(request.start)},
               {"goal", json_of(request.goal)},
               {"via", std::move(via)},
               {"start_heading_true_rad", optional_json(request.start_heading_true_rad)},
               {"speed_mps", optional_json(request.speed_mps)},
               {"seed", request.seed},
               {"work_budget", request.work_budget}};
  if (!request.areas.empty()) {
    Json areas = Json::array();
    for (const flight::RequestArea& area : request.areas) {
      areas.push_back(json_of(area));
    }
    json["areas"] = std::move(areas);
  }
  return json;
}

Json json_of(const flight::Timetable& table) {
  Json places = Json::array();
  for (const flight::Timetable::Entry& entry : table.entries) {
    places.push_back({{"place", entry.place},
                      {"expected", utc_text(entry.expected)},
                      {"expected_utime_us", entry.expected.utime_us},
                      {"wanted", entry.wanted ? Json(utc_text(*entry.wanted)) : Json()},
                      {"wanted_utime_us", entry.wanted ? Json(entry.wanted->utime_us) : Json()}});
  }
  return {{"tolerance_s", table.tolerance_s}, {"places", std::move(places)}};
}

Json json_of(const flight::Waypoint& waypoint) {
  return {{"x_m", waypoint.x_m}, {"y_m", waypoint.y_m}, {"altitude_m", waypoint.altitude_m}};
}

Json json_of(const std::vector<flight::Waypoint>& waypoints) {
  Json list = Json::array();
  for (const flight::Waypoint& waypoint : waypoints) {
    list.push_back(json_of(waypoint));
  }
  return list;
}

Json json_of(const geo::MapPoint& point) { return {{"x_m", point.x_m}, {"y_m", point.y_m}}; }

Json json_of(const flight::RoutePlan& plan) {
  const flight::Route& route = plan.route;
  const double total_m = route.cost.total_m();
  const bool has_bound = route.lower_bound_m > 0.0 && total_m > 0.0;
  return {{"start", json_of(plan.start)},
          {"goal", json_of(plan.goal)},
          {"cost", cost_json(route.cost)},
          {"lower_bound_m", has_bound ? Json(route.lower_bound_m) : Json()},
          {"gap", has_bound ? Json((total_m - route.lower_bound_m) / total_m) : Json()},
          {"work_units", route.work_units},
          {"samples", route.samples},
          {"batches", route.batches},
          {"guide_spacing_m", route.guide_spacing_m},
          {"waypoints", json_of(route.waypoints)},
          {"guide", json_of(route.guide)}};
}

Json json_of(const flight::PathMeasures& measures) {
  return {{"length_m", measures.length_m},
          {"duration_s", measures.duration_s},
          {"visibility_m", measures.visibility_m},
          {"semantics_m", measures.semantics_m},
          {"bank_rad_m", measures.bank_rad_m},
          {"mean_height_m", measures.mean_height_m},
          {"max_height_m", measures.max_height_m},
          {"share_under_ceiling", measures.share_under_ceiling}};
}

Json json_of(const flight::Verdict& verdict) {
  Json violations = Json::array();
  for (const flight::Violation& violation : verdict.violations) {
    violations.push_back({{"rule", violation.rule},
                          {"time_s", violation.time_s},
                          {"place", json_of(violation.place)},
                          {"value", violation.value},
                          {"limit", violation.limit}});
  }
  return {{"is_verified", verdict.is_verified},
          {"violation_count", verdict.violation_count},
          {"violations", std::move(violations)},
          {"clearance_min_m", verdict.clearance_min_m},
          {"clearance_min_place", json_of(verdict.clearance_min_place)},
          {"bank_max_rad", verdict.bank_max_rad},
          {"roll_rate_max_radps", verdict.roll_rate_max_radps},
          {"climb_rate_max_mps", verdict.climb_rate_max_mps},
          {"descent_rate_max_mps", verdict.descent_rate_max_mps},
          {"speed_min_mps", verdict.speed_min_mps},
          {"speed_max_mps", verdict.speed_max_mps},
          {"share_under_ceiling", verdict.share_under_ceiling},
          {"goal_distance_m", verdict.goal_distance_m}};
}

// ---- reading plan.json

double bounded_or_nan(const Field& field, double magnitude_max) {
  return field.is_null() ? std::numeric_limits<double>::quiet_NaN()
                         : field.number_within(magnitude_max);
}

std::optional<double> optional_number(const Field& field) {
  return field.is_null() ? std::nullopt : std::optional<double>(field.number());
}

Hash128 hash_of(const Field& field) {
  try {
    return hash128_from_hex(field.text());
  } catch (const std::invalid_argument&) {
    field.refuse("must be 32 hexadecimal digits");
  }
}

double angle_of(const Field& parent, const char* key_rad, const char* key_deg, double max_rad) {
  const double angle_rad = parent.at(key_rad).number_within(max_rad);
  const double angle_deg = parent.at(key_deg).number();
  if (std::fabs(degrees_from_radians(angle_rad) - angle_deg) > 1e-9) {
    parent.at(key_deg).refuse("and '" + std::string(key_rad) + "' are different angles");
  }
  return angle_rad;
}

flight::RequestPoint request_point_of(const Field& field) {
  return {{angle_of(field, "latitude_rad", "latitude_deg", 0.5 * std::numbers::pi + 1e-12),
           angle_of(field, "longitude_rad", "longitude_deg", std::numbers::pi + 1e-12)},
          optional_number(field.at("height_m"))};
}

flight::RequestAreaEnd area_end_of(const Field& field, double without_end_m) {
  const std::string reference = field.at("reference").text();
  if (reference != kAboveGround && reference != kAmsl) {
    field.at("reference").refuse("must be 'above_ground' or 'amsl'");
  }
  const Field value = field.at("value_m");
  return {value.is_null() ? without_end_m : value.number_within(kPosition_m_max),
          reference == kAboveGround};
}

flight::RequestArea::Ring ring_of(const Field& field) {
  flight::RequestArea::Ring ring;
  for (const Field& corner : field.entries(kCornersMax)) {
    const std::vector<Field> numbers = corner.entries(2);
    if (numbers.size() != 2) {
      corner.refuse("must hold latitude and longitude");
    }
    ring.push_back({numbers[0].number_within(0.5 * std::numbers::pi + 1e-12),
                    numbers[1].number_within(std::numbers::pi + 1e-12)});
  }
  if (ring.size() < 4) {
    field.refuse("needs three corners and the first one again");
  }
  return ring;
}

flight::RequestArea area_of(const Field& field) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  flight::RequestArea area;
  area.name = field.at("name").text();
  area.kind = field.at("kind").text();
  area.is_hard = field.at("is_hard").boolean();
  area.floor = area_end_of(field.at("floor"), -kInfinity);
  area.ceiling = area_end_of(field.at("ceiling"), kInfinity);
  for (const Field& rings : field.at("polygons_latitude_longitude_rad").entries(kCornersMax)) {
    flight::RequestArea::Polygon polygon;
    for (const Field& ring : rings.entries(kCornersMax)) {
      auto& into = polygon.outer.empty() ? polygon.outer : polygon.holes.emplace_back();
      into = ring_of(ring);
    }
    if (polygon.outer.empty()) {
      rings.refuse("has no ring");
    }
    area.polygons.push_back(std::move(polygon));
  }
  return area;
}

flight::Timetable timetable_of(const Field& field) {
  flight::Timetable table;
  table.tolerance_s = field.at("tolerance_s").number();
  const auto time_of = [](const Field& entry, const char* key_us, const char* key_text) {
    const Time time{entry.at(key_us).integer(0, kTime_us_max)};
    if (entry.at(key_text).text() != utc_text(time)) {
      entry.at(key_text).refuse("and '" + std::string(key_us) + "' are different times");
    }
    return time;
  };
  for (const Field& place : field.at("places").entries(kWaypointsMax)) {
    flight::Timetable::Entry entry;
    entry.place = static_cast<std::size_t>(
        place.at("place").integer(static_cast<std::int64_t>(table.entries.size()),
                                  static_cast<std::int64_t>(table.entries.size())));
    entry.expected = time_of(place, "expected_utime_us", "expected");
    if (!place.at("wanted_utime_us").is_null()) {
      entry.wanted = time_of(place, "wanted_utime_us", "wanted");
    }
    table.entries.push_back(entry);
  }
  if (table.entries.size() < 2) {
    field.at("places").refuse("must hold start and goal");
  }
  return table;
}

flight::PlanRequest request_of(const Field& field) {
  flight::PlanRequest request;
  request.start = request_point_of(field.at("start"));
  request.goal = request_point_of(field.at("goal"));
  for (const Field& point : field.at("via").entries(kWaypointsMax)) {
    request.via.push_back(request_point_of(point));
  }
  request.start_heading_true_rad = optional_number(field.at("start_heading_true_rad"));
  request.speed_mps = optional_number(field.at("speed_mps"));
  request.seed = field.at("seed").unsigned_integer();
  request.work_budget = field.at("work_budget").integer(0, kCountMax);
  if (field.has("areas")) {
    for (const Field& area : field.at("areas").entries(kAreasMax)) {
      request.areas.push_back(area_of(area));
    }
  }
  return request;
}

flight::Waypoint waypoint_of(const Field& field) {
  return {field.at("x_m").number_within(kPosition_m_max),
          field.at("y_m").number_within(kPosition_m_max),
          field.at("altitude_m").number_within(kAltitude_m_max)};
}

std::vector<flight::Waypoint> waypoints_of(const Field& field) {
  std::vector<flight::Waypoint> waypoints;
  for (const Field& entry : field.entries(kWaypointsMax)) {
    waypoints.push_back(waypoint_of(entry));
  }
  return waypoints;
}

geo::MapPoint place_of(const Field& field) {
  return {bounded_or_nan(field.at("x_m"), kPosition_m_max),
          bounded_or_nan(field.at("y_m"), kPosition_m_max)};
}

flight::Route route_of(const Field& field) {
  flight::Route route;
  const Field cost = field.at("cost");
  for (std::size_t i = 0; i < flight::kCostTerms.size(); ++i) {
    const flight::CostTerm& term = flight::kCostTerms[i];
    // Plans of earlier versions have the terms of eq. (1) alone.
    if (i < flight::kPaperCostTerms || cost.has(term.name)) {
      route.cost.*term.value_m = cost.at(term.name).number_or_nan();
    }
  }
  const Field bound = field.at("lower_bound_m");
  route.lower_bound_m = bound.is_null() ? 0.0 : bound.number();
  // Figures that follow from others stand there for people; they must not say anything else.
  const double total_m = route.cost.total_m();
  const auto require_equal = [](const Field& written, double value) {
    if (!written.is_null() && std::isfinite(value) && std::fabs(written.number() - value) > 1e-6) {
      written.refuse("does not follow from the terms of the cost and the lower bound");
    }
  };
  require_equal(cost.at("total_m"), total_m);
  require_equal(field.at("gap"), (total_m - route.lower_bound_m) / total_m);
  route.work_units = field.at("work_units").integer(0, kCountMax);
  route.samples = field.at("samples").integer(0, kCountMax);
  route.batches = field.at("batches").integer(0, kCountMax);
  route.guide_spacing_m = field.at("guide_spacing_m").number();
  route.waypoints = waypoints_of(field.at("waypoints"));
  route.guide = waypoints_of(field.at("guide"));
  if (route.waypoints.size() < 2) {
    field.at("waypoints").refuse("must have at least 2 entries");
  }
  return route;
}

std::vector<std::string> texts_of(const Field& field) {
  std::vector<std::string> texts;
  for (const Field& entry : field.entries(kLinesMax)) {
    texts.push_back(entry.text());
  }
  return texts;
}

flight::PathMeasures measures_of(const Field& field) {
  flight::PathMeasures measures;
  measures.length_m = field.at("length_m").number_or_nan();
  measures.duration_s = field.at("duration_s").number_or_nan();
  measures.visibility_m = field.at("visibility_m").number_or_nan();
  measures.semantics_m = field.at("semantics_m").number_or_nan();
  measures.bank_rad_m = field.at("bank_rad_m").number_or_nan();
  measures.mean_height_m = field.at("mean_height_m").number_or_nan();
  measures.max_height_m = field.at("max_height_m").number_or_nan();
  measures.share_under_ceiling = field.at("share_under_ceiling").number_or_nan();
  return measures;
}

flight::Verdict verdict_of(const Field& field) {
  flight::Verdict verdict;
  verdict.is_verified = field.at("is_verified").boolean();
  verdict.violation_count = field.at("violation_count").integer(0, kCountMax);
  for (const Field& entry : field.at("violations").entries(kViolationsMax)) {
    verdict.violations.push_back({entry.at("rule").text(), entry.at("time_s").number_or_nan(),
                                  place_of(entry.at("place")), entry.at("value").number_or_nan(),
                                  entry.at("limit").number_or_nan()});
  }
  verdict.clearance_min_m = field.at("clearance_min_m").number_or_nan();
  verdict.clearance_min_place = place_of(field.at("clearance_min_place"));
  verdict.bank_max_rad = field.at("bank_max_rad").number_or_nan();
  verdict.roll_rate_max_radps = field.at("roll_rate_max_radps").number_or_nan();
  verdict.climb_rate_max_mps = field.at("climb_rate_max_mps").number_or_nan();
  verdict.descent_rate_max_mps = field.at("descent_rate_max_mps").number_or_nan();
  verdict.speed_min_mps = field.at("speed_min_mps").number_or_nan();
  verdict.speed_max_mps = field.at("speed_max_mps").number_or_nan();
  verdict.share_under_ceiling = field.at("share_under_ceiling").number_or_nan();
  verdict.goal_distance_m = field.at("goal_distance_m").number_or_nan();
  if (verdict.is_verified && verdict.violation_count > 0) {
    field.at("is_verified").refuse("is true beside violations");
  }
  return verdict;
}

/// Reads plan.json into a plan without states; returns how many states there should be.
std::size_t read_plan_file(const fs::path& file, flight::Plan& plan) {
  const JsonDocument document(read_file(file), file.string());
  const Field root = document.root();
  if (root.at("schema").text() != kSchemaName) {
    root.at("schema").refuse(std::string("must be '") + kSchemaName + "'");
  }
  const std::int64_t version = root.at("schema_version").integer(0, kCountMax);
  if (version != kPlanSchemaVersion) {
    root.at("schema_version")
        .refuse("is " + std::to_string(version) + ", this program reads " +
                std::to_string(kPlanSchemaVersion));
  }
  flight::RoutePlan& route_plan = plan.route_plan;
  route_plan.request_id = hash_of(root.at("request_id"));
  route_plan.request = request_of(root.at("request"));
  const Field map = root.at("map");
  route_plan.map.hash = hash_of(map.at("hash"));
  if (map.has("patch_number")) {  // older plans have none
    route_plan.map.patch_number = map.at("patch_number").integer(0, kCountMax);
  }
  route_plan.map.label = map.at("label").text();
  route_plan.map.attributions = texts_of(map.at("attributions"));
  route_plan.map.vertical_datum = map.at("vertical_datum").text();
  route_plan.map.crs_wkt = map.at("crs_wkt").text();
  const Field config = root.at("config");
  route_plan.config_text = config.at("text").text();
  if (hash_of(config.at("hash")) != hash128(route_plan.config_text)) {
    config.at("hash").refuse("does not belong to the config's text");
  }
  if (route_plan.request_id !=
      flight::plan_request_id(route_plan.request, route_plan.map.hash, route_plan.config_text)) {
    root.at("request_id").refuse("does not belong to this map, request and config");
  }
  const Field route = root.at("route");
  route_plan.start = waypoint_of(route.at("start"));
  route_plan.goal = waypoint_of(route.at("goal"));
  route_plan.route = route_of(route);
  const Field trajectory = root.at("trajectory");
  plan.trajectory.step_s = trajectory.at("step_s").number();
  const auto states = trajectory.at("states").integer(0, 1'000'000'000);
  plan.measures = measures_of(root.at("measures"));
  const Field local = root.at("local_planner");
  plan.decisions = local.at("decisions").integer(0, kCountMax);
  plan.infeasible_decisions = local.at("infeasible_decisions").integer(0, kCountMax);
  plan.verdict = verdict_of(root.at("verification"));
  if (root.has("timetable")) {
    plan.timetable = timetable_of(root.at("timetable"));
    if (plan.timetable->entries.size() != route_plan.request.via.size() + 2) {
      root.at("timetable").refuse("does not hold each place of the request");
    }
  }
  plan.warnings = texts_of(root.at("warnings"));
  return static_cast<std::size_t>(states);
}

// ---- trajectory.csv

void append_number(std::string& text, double value) {
  std::array<char, 32> buffer{};
  if (std::isnan(value)) {
    text += "nan";
    return;
  }
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value).ptr;
  text.append(buffer.data(), end);
}

void append_degrees(std::string& text, double angle_rad) {
  std::array<char, 32> buffer{};
  if (std::isnan(angle_rad)) {
    text += "nan";
    return;
  }
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(),
                                 degrees_from_radians(angle_rad), std::chars_format::fixed, 8)
                       .ptr;
  text.append(buffer.data(), end);
}

std::optional<geo::MapProjection> projection_of(const flight::Plan& plan) {
  const std::string& wkt = plan.route_plan.map.crs_wkt;
  return wkt.empty() ? std::nullopt : std::optional<geo::MapProjection>(wkt);
}

class TrajectoryReader {
 public:
  TrajectoryReader(const std::string& text, std::string name)
      : rest_(text), name_(std::move(name)) {}

  std::vector<flight::FlightState> read(std::size_t count) {
    read_header();
    std::vector<flight::FlightState> states;
    while (!rest_.empty()) {
      states.push_back(read_state());
      if (states.size() > 1 && !(states.back().time_s > states[states.size() - 2].time_s)) {
        refuse("column 'time_s' must grow from line to line");
      }
    }
    if (states.size() != count) {
      refuse("the file has " + std::to_string(states.size()) + " states, " +
             std::string(kPlanFile) + " says " + std::to_string(count));
    }
    return states;
  }

 private:
  [[noreturn]] void refuse(const std::string& why) const {
    throw DataError(name_ + ":" + std::to_string(line_) + ": " + why, kHint);
  }

  std::string_view next_line() {
    ++line_;
    const std::size_t end = rest_.find('\n');
    if (end == std::string_view::npos) {
      refuse("the last line is cut off");
    }
    const std::string_view line = rest_.substr(0, end);
    rest_.remove_prefix(end + 1);
    return line;
  }

  void read_header() {
    std::string expected;
    for (const TrajectoryColumn& column : kTrajectoryColumns) {
      expected += expected.empty() ? "" : ",";
      expected += column.name;
    }
    if (next_line() != expected) {
      refuse("the first line must be '" + expected + "'");
    }
  }

  flight::FlightState read_state() {
    std::string_view line = next_line();
    flight::FlightState state;
    for (std::size_t i = 0; i < kTrajectoryColumns.size(); ++i) {
      const TrajectoryColumn& column = kTrajectoryColumns[i];
      const std::size_t comma = line.find(',');
      if ((comma == std::string_view::npos) != (i + 1 == kTrajectoryColumns.size())) {
        refuse("the line must have " + std::to_string(kTrajectoryColumns.size()) + " columns");
      }
      const double value = number_of(line.substr(0, comma), column);
      if (column.member != nullptr) {
        state.*column.member = value;
      }
      line.remove_prefix(comma == std::string_view::npos ? line.size() : comma + 1);
    }
    return state;
  }

  double number_of(std::string_view text, const TrajectoryColumn& column) const {
    if (text == "nan") {
      if (column.member == &flight::FlightState::time_s ||
          column.member == &flight::FlightState::x_m ||
          column.member == &flight::FlightState::y_m ||
          column.member == &flight::FlightState::altitude_m) {
        refuse("column '" + std::string(column.name) + "' must be known");
      }
      return std::numeric_limits<double>::quiet_NaN();
    }
    double value = 0.0;
    const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
    if (result.ec != std::errc() || result.ptr != text.data() + text.size() ||
        !std::isfinite(value)) {
      refuse("column '" + std::string(column.name) + "' holds '" + std::string(text.substr(0, 40)) +
             "', which is no number");
    }
    if (std::fabs(value) > kPosition_m_max) {
      refuse("column '" + std::string(column.name) + "' is out of range");
    }
    return value;
  }

  std::string_view rest_;
  std::string name_;
  int line_ = 0;
};

void require_file(const fs::path& file, std::uintmax_t bytes_max) {
  std::error_code error;
  if (!fs::is_regular_file(file, error)) {
    throw DataError(file.parent_path().string() + ": is no plan bundle, it holds no " +
                        file.filename().string(),
                    kFolderHint);
  }
  if (fs::file_size(file, error) > bytes_max || error) {
    throw DataError(file.string() + ": is too large", kHint);
  }
}

}  // namespace

std::string plan_json(const flight::Plan& plan) {
  const flight::RoutePlan& route_plan = plan.route_plan;
  Json json;
  json["schema"] = kSchemaName;
  json["schema_version"] = kPlanSchemaVersion;
  json["request_id"] = route_plan.request_id.hex();
  json["map"] = {{"hash", route_plan.map.hash.hex()},
                 {"patch_number", route_plan.map.patch_number},
                 {"label", route_plan.map.label},
                 {"attributions", route_plan.map.attributions},
                 {"vertical_datum", route_plan.map.vertical_datum},
                 {"crs_wkt", route_plan.map.crs_wkt}};
  json["request"] = json_of(route_plan.request);
  json["measures"] = json_of(plan.measures);
  json["verification"] = json_of(plan.verdict);
  if (plan.timetable) {
    json["timetable"] = json_of(*plan.timetable);
  }
  json["warnings"] = plan.warnings;
  json["local_planner"] = {{"decisions", plan.decisions},
                           {"infeasible_decisions", plan.infeasible_decisions}};
  json["trajectory"] = {{"file", kTrajectoryFile},
                        {"step_s", plan.trajectory.step_s},
                        {"states", plan.trajectory.states.size()}};
  json["route"] = json_of(route_plan);
  json["config"] = {{"hash", hash128(route_plan.config_text).hex()},
                    {"text", route_plan.config_text}};
  return dumped(json);
}

std::string route_geojson(const flight::Plan& plan) {
  const flight::RoutePlan& route_plan = plan.route_plan;
  const auto projection = projection_of(plan);
  const auto position = [&](double x_m, double y_m, double altitude_m) {
    const geo::GeodeticPosition p = projection->to_geodetic({x_m, y_m});
    return Json::array({rounded(degrees_from_radians(p.longitude_rad), 1e8),
                        rounded(degrees_from_radians(p.latitude_rad), 1e8),
                        rounded(altitude_m, 1e3)});
  };
  const auto geometry = [&](const char* type, Json coordinates) -> Json {
    return projection ? Json{{"type", type}, {"coordinates", std::move(coordinates)}} : Json();
  };
  const auto line_of = [&](const auto& points) {
    Json line = Json::array();
    if (projection) {
      for (const auto& point : points) {
        line.push_back(position(point.x_m, point.y_m, point.altitude_m));
      }
    }
    return line;
  };
  const auto properties = [&](const char* kind) {
    return Json{{"kind", kind},
                {"label", route_plan.map.label},
                {"altitude_reference",
                 "above mean sea level [m], vertical datum " + route_plan.map.vertical_datum}};
  };
  Json features = Json::array();
  const auto add = [&](Json shape, Json named) {
    features.push_back(
        {{"type", "Feature"}, {"geometry", std::move(shape)}, {"properties", std::move(named)}});
  };

  Json planned = properties("planned_route");
  planned["cost_m"] = route_plan.route.cost.total_m();
  planned["length_m"] = flight::length_m(route_plan.route.waypoints);
  add(geometry("LineString", line_of(route_plan.route.waypoints)), std::move(planned));

  std::vector<flight::FlightState> track;
  const auto& states = plan.trajectory.states;
  for (const flight::FlightState& state : states) {
    if (track.empty() || state.time_s - track.back().time_s >= kTrackStep_s - 1e-9) {
      track.push_back(state);
    }
  }
  if (!states.empty() && track.back().time_s != states.back().time_s) {
    track.push_back(states.back());
  }
  Json flown = properties("flown_track");
  flown["length_m"] = plan.measures.length_m;
  flown["duration_s"] = plan.measures.duration_s;
  flown["clearance_min_m"] = plan.verdict.clearance_min_m;
  flown["is_verified"] = plan.verdict.is_verified;
  // A line has at least two positions.
  add(track.size() >= 2 ? geometry("LineString", line_of(track)) : Json(), std::move(flown));

  const auto add_point = [&](const char* kind, const flight::Waypoint& waypoint,
                             std::optional<std::size_t> number) {
    Json named = properties(kind);
    if (number) {
      named["number"] = *number;
    }
    named["altitude_m"] = waypoint.altitude_m;
    add(projection ? geometry("Point", position(waypoint.x_m, waypoint.y_m, waypoint.altitude_m))
                   : Json(),
        std::move(named));
  };
  add_point("start", route_plan.start, std::nullopt);
  add_point("goal", route_plan.goal, std::nullopt);
  for (std::size_t i = 0; i < route_plan.route.waypoints.size(); ++i) {
    add_point("waypoint", route_plan.route.waypoints[i], i);
  }

  Json json;
  json["type"] = "FeatureCollection";
  json["label"] = route_plan.map.label;
  json["attributions"] = route_plan.map.attributions;
  json["request_id"] = route_plan.request_id.hex();
  json["features"] = std::move(features);
  return dumped(json);
}

std::string trajectory_csv(const flight::Plan& plan) {
  const auto projection = projection_of(plan);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  std::string text;
  text.reserve(plan.trajectory.states.size() * 300 + 1000);
  for (std::size_t i = 0; i < kTrajectoryColumns.size(); ++i) {
    text += i == 0 ? "" : ",";
    text += kTrajectoryColumns[i].name;
  }
  text += '\n';
  for (const flight::FlightState& state : plan.trajectory.states) {
    const geo::GeodeticPosition position =
        projection ? projection->to_geodetic(state.point()) : geo::GeodeticPosition{nan, nan};
    for (std::size_t i = 0; i < kTrajectoryColumns.size(); ++i) {
      text += i == 0 ? "" : ",";
      const TrajectoryColumn& column = kTrajectoryColumns[i];
      const std::string_view name = column.name;
      if (column.member != nullptr) {
        append_number(text, state.*column.member);
      } else if (name == "latitude_deg") {
        append_degrees(text, position.latitude_rad);
      } else if (name == "longitude_deg") {
        append_degrees(text, position.longitude_rad);
      } else if (name == "height_above_surface_m") {
        append_number(text, state.altitude_m - state.surface_m);
      } else {
        append_number(text,
                      grid_from_true_azimuth_rad(state.heading_true_rad, state.convergence_rad));
      }
    }
    text += '\n';
  }
  return text;
}

void write_plan_bundle(const flight::Plan& plan, const fs::path& folder) {
  write_file_atomically(folder / kPlanFile, plan_json(plan));
  write_file_atomically(folder / kRouteFile, route_geojson(plan));
  write_file_atomically(folder / kTrajectoryFile, trajectory_csv(plan));
}

flight::Plan read_plan_bundle(const fs::path& folder) {
  std::error_code error;
  if (!fs::is_directory(folder, error)) {
    throw DataError(folder.string() + ": no such folder", kFolderHint);
  }
  require_file(folder / kPlanFile, kPlanBytesMax);
  require_file(folder / kTrajectoryFile, kTrajectoryBytesMax);
  flight::Plan plan;
  const std::size_t count = read_plan_file(folder / kPlanFile, plan);
  const fs::path file = folder / kTrajectoryFile;
  const std::string text = read_file(file);
  plan.trajectory.states = TrajectoryReader(text, file.string()).read(count);
  return plan;
}

}  // namespace hedgehop::output
