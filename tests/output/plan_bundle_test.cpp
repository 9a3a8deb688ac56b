#include "output/plan_bundle.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <limits>
#include <nlohmann/json.hpp>
#include <ogr_spatialref.h>
#include <random>
#include <string>

#include "base/errors.hpp"
#include "base/files.hpp"
#include "output/trajectory_columns.hpp"
#include "sample_plan.hpp"
#include "support/fresh_seed.hpp"
#include "support/temporary_folder.hpp"

namespace hedgehop::output {
namespace {

using testing::HasSubstr;
using Json = nlohmann::json;

const flight::Plan& sample() {
  static const flight::Plan kPlan = test::make_sample_plan(test::make_sample_map());
  return kPlan;
}

void expect_same(double a, double b) {
  EXPECT_TRUE(a == b || (std::isnan(a) && std::isnan(b))) << a << " and " << b;
}

void expect_same(const geo::MapPoint& a, const geo::MapPoint& b) {
  expect_same(a.x_m, b.x_m);
  expect_same(a.y_m, b.y_m);
}

void expect_same(const flight::RequestPoint& a, const flight::RequestPoint& b) {
  EXPECT_EQ(a.position.latitude_rad, b.position.latitude_rad);
  EXPECT_EQ(a.position.longitude_rad, b.position.longitude_rad);
  EXPECT_EQ(a.height_m, b.height_m);
}

void expect_same(const flight::Plan& a, const flight::Plan& b) {
  const flight::RoutePlan& r = a.route_plan;
  const flight::RoutePlan& s = b.route_plan;
  EXPECT_EQ(r.request_id, s.request_id);
  expect_same(r.request.start, s.request.start);
  expect_same(r.request.goal, s.request.goal);
  ASSERT_EQ(r.request.via.size(), s.request.via.size());
  for (std::size_t i = 0; i < r.request.via.size(); ++i) {
    expect_same(r.request.via[i], s.request.via[i]);
  }
  EXPECT_EQ(r.request.start_heading_true_rad, s.request.start_heading_true_rad);
  EXPECT_EQ(r.request.speed_mps, s.request.speed_mps);
  EXPECT_EQ(r.request.seed, s.request.seed);
  EXPECT_EQ(r.request.work_budget, s.request.work_budget);
  EXPECT_EQ(r.config_text, s.config_text);
  EXPECT_EQ(r.map.hash, s.map.hash);
  EXPECT_EQ(r.map.crs_wkt, s.map.crs_wkt);
  EXPECT_EQ(r.map.vertical_datum, s.map.vertical_datum);
  EXPECT_EQ(r.map.label, s.map.label);
  EXPECT_EQ(r.map.attributions, s.map.attributions);
  EXPECT_EQ(r.start, s.start);
  EXPECT_EQ(r.goal, s.goal);
  EXPECT_EQ(r.route.waypoints, s.route.waypoints);
  EXPECT_EQ(r.route.guide, s.route.guide);
  EXPECT_EQ(r.route.guide_spacing_m, s.route.guide_spacing_m);
  EXPECT_EQ(r.route.cost, s.route.cost);
  EXPECT_EQ(r.route.lower_bound_m, s.route.lower_bound_m);
  EXPECT_EQ(r.route.work_units, s.route.work_units);
  EXPECT_EQ(r.route.samples, s.route.samples);
  EXPECT_EQ(r.route.batches, s.route.batches);
  EXPECT_EQ(a.trajectory.step_s, b.trajectory.step_s);
  ASSERT_EQ(a.trajectory.states.size(), b.trajectory.states.size());
  for (std::size_t i = 0; i < a.trajectory.states.size(); ++i) {
    const flight::FlightState& p = a.trajectory.states[i];
    const flight::FlightState& q = b.trajectory.states[i];
    expect_same(p.time_s, q.time_s);
    expect_same(p.point(), q.point());
    expect_same(p.altitude_m, q.altitude_m);
    expect_same(p.speed_mps, q.speed_mps);
    expect_same(p.heading_true_rad, q.heading_true_rad);
    expect_same(p.convergence_rad, q.convergence_rad);
    expect_same(p.bank_rad, q.bank_rad);
    expect_same(p.roll_rate_radps, q.roll_rate_radps);
    expect_same(p.pitch_rad, q.pitch_rad);
    expect_same(p.pitch_rate_radps, q.pitch_rate_radps);
    expect_same(p.climb_rate_mps, q.climb_rate_mps);
    expect_same(p.vertical_acceleration_mps2, q.vertical_acceleration_mps2);
    expect_same(p.target_heading_true_rad, q.target_heading_true_rad);
    expect_same(p.commanded_heading_true_rad, q.commanded_heading_true_rad);
    expect_same(p.commanded_climb_angle_rad, q.commanded_climb_angle_rad);
    expect_same(p.commanded_speed_mps, q.commanded_speed_mps);
    expect_same(p.surface_m, q.surface_m);
    expect_same(p.terrain_m, q.terrain_m);
  }
  expect_same(a.measures.length_m, b.measures.length_m);
  expect_same(a.measures.duration_s, b.measures.duration_s);
  expect_same(a.measures.visibility_m, b.measures.visibility_m);
  expect_same(a.measures.semantics_m, b.measures.semantics_m);
  expect_same(a.measures.bank_rad_m, b.measures.bank_rad_m);
  expect_same(a.measures.mean_height_m, b.measures.mean_height_m);
  expect_same(a.measures.max_height_m, b.measures.max_height_m);
  expect_same(a.measures.share_under_ceiling, b.measures.share_under_ceiling);
  EXPECT_EQ(a.decisions, b.decisions);
  EXPECT_EQ(a.infeasible_decisions, b.infeasible_decisions);
  const flight::Verdict& v = a.verdict;
  const flight::Verdict& w = b.verdict;
  EXPECT_EQ(v.is_verified, w.is_verified);
  EXPECT_EQ(v.violation_count, w.violation_count);
  ASSERT_EQ(v.violations.size(), w.violations.size());
  for (std::size_t i = 0; i < v.violations.size(); ++i) {
    EXPECT_EQ(v.violations[i].rule, w.violations[i].rule);
    expect_same(v.violations[i].time_s, w.violations[i].time_s);
    expect_same(v.violations[i].place, w.violations[i].place);
    expect_same(v.violations[i].value, w.violations[i].value);
    expect_same(v.violations[i].limit, w.violations[i].limit);
  }
  expect_same(v.clearance_min_m, w.clearance_min_m);
  expect_same(v.clearance_min_place, w.clearance_min_place);
  expect_same(v.bank_max_rad, w.bank_max_rad);
  expect_same(v.roll_rate_max_radps, w.roll_rate_max_radps);
  expect_same(v.climb_rate_max_mps, w.climb_rate_max_mps);
  expect_same(v.descent_rate_max_mps, w.descent_rate_max_mps);
  expect_same(v.speed_min_mps, w.speed_min_mps);
  expect_same(v.speed_max_mps, w.speed_max_mps);
  expect_same(v.share_under_ceiling, w.share_under_ceiling);
  expect_same(v.goal_distance_m, w.goal_distance_m);
  EXPECT_EQ(a.warnings, b.warnings);
}

flight::Plan written_and_read(const flight::Plan& plan) {
  const test::TemporaryFolder folder;
  write_plan_bundle(plan, folder.path());
  return read_plan_bundle(folder.path());
}

/// A bundle on disk whose files are damaged one at a time.
class DamagedBundle {
 public:
  explicit DamagedBundle(const flight::Plan& plan)
      : json_(plan_json(plan)), csv_(trajectory_csv(plan)) {
    write_plan_bundle(plan, folder_.path());
  }

  /// The error that reading gives after `file` holds `text`; empty if it is read without one.
  std::string error_after(const char* file, const std::string& text) const {
    std::ofstream(folder_.path() / file, std::ios::binary) << text;
    std::string error;
    try {
      read_plan_bundle(folder_.path());
    } catch (const DataError& refusal) {
      error = refusal.what();
    }
    std::ofstream(folder_.path() / file, std::ios::binary)
        << (std::string(file) == kPlanFile ? json_ : csv_);
    return error;
  }

 private:
  test::TemporaryFolder folder_;
  std::string json_;
  std::string csv_;
};

std::string error_after(const flight::Plan& plan, const char* file, const std::string& text) {
  return DamagedBundle(plan).error_after(file, text);
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return at == std::string::npos ? text : text.replace(at, from.size(), to);
}

int line_of(const std::string& text, const std::string& part) {
  return 1 + static_cast<int>(std::count(
                 text.begin(), text.begin() + static_cast<std::ptrdiff_t>(text.find(part)), '\n'));
}

TEST(PlanBundle, PlanReadsBackAsItWasWrittenFieldByField) {
  expect_same(written_and_read(sample()), sample());
}

flight::Plan sample_with_areas_and_times() {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  flight::Plan plan = sample();
  flight::RequestArea area;
  area.name = "fair";
  area.kind = "no_fly";
  area.is_hard = false;
  area.floor = {-kInfinity, true};
  area.ceiling = {1234.5, false};
  area.polygons.push_back({{{0.87, 0.2}, {0.87, 0.21}, {0.88, 0.2}, {0.87, 0.2}},
                           {{{0.871, 0.201}, {0.871, 0.202}, {0.872, 0.201}, {0.871, 0.201}}}});
  plan.route_plan.request.areas = {area, area};
  plan.route_plan.request.areas[1].is_hard = true;
  plan.route_plan.request.areas[1].floor = {30.0, true};
  plan.route_plan.request.areas[1].ceiling = {kInfinity, false};
  flight::Timetable table;
  table.tolerance_s = 5.0;
  for (std::size_t place = 0; place < plan.route_plan.request.via.size() + 2; ++place) {
    table.entries.push_back(
        {place, Time{1'777'617'000'123'456 + 60'000'000 * static_cast<std::int64_t>(place)},
         std::nullopt});
  }
  table.entries.back().wanted = Time{1'777'617'500'000'000};
  plan.timetable = table;
  return plan;
}

TEST(PlanBundle, AreasAndTimesOfTheRequestReadBackAsTheyWere) {
  const flight::Plan plan = sample_with_areas_and_times();
  const flight::Plan read = written_and_read(plan);
  expect_same(read, plan);
  ASSERT_EQ(read.route_plan.request.areas.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    const flight::RequestArea& a = plan.route_plan.request.areas[i];
    const flight::RequestArea& b = read.route_plan.request.areas[i];
    EXPECT_EQ(a.name, b.name);
    EXPECT_EQ(a.kind, b.kind);
    EXPECT_EQ(a.is_hard, b.is_hard);
    EXPECT_EQ(a.floor, b.floor);
    EXPECT_EQ(a.ceiling, b.ceiling);
    ASSERT_EQ(b.polygons.size(), 1U);
    ASSERT_EQ(b.polygons[0].outer.size(), 4U);
    EXPECT_EQ(b.polygons[0].outer[2].latitude_rad, 0.88);
    ASSERT_EQ(b.polygons[0].holes.size(), 1U);
    EXPECT_EQ(b.polygons[0].holes[0][1].longitude_rad, 0.202);
  }
  ASSERT_TRUE(read.timetable);
  EXPECT_EQ(read.timetable->tolerance_s, 5.0);
  ASSERT_EQ(read.timetable->entries.size(), plan.timetable->entries.size());
  for (std::size_t i = 0; i < read.timetable->entries.size(); ++i) {
    EXPECT_EQ(read.timetable->entries[i].place, i);
    EXPECT_EQ(read.timetable->entries[i].expected, plan.timetable->entries[i].expected);
    EXPECT_EQ(read.timetable->entries[i].wanted, plan.timetable->entries[i].wanted);
  }
}

TEST(PlanBundle, WrongAreasAndTimesAreNamed) {
  const flight::Plan plan = sample_with_areas_and_times();
  const std::string text = plan_json(plan);
  const DamagedBundle bundle(plan);
  struct Case {
    const char* from;
    const char* to;
    const char* field;
  };
  for (const Case& fault :
       {Case{"\"reference\": \"amsl\"", "\"reference\": \"sea\"",
             "must be 'above_ground' or 'amsl'"},
        Case{"\"is_hard\": false", "\"is_hard\": 3", "field 'request/areas/0/is_hard'"},
        Case{"0.88", "8.8", "is out of range"},
        Case{"\"expected_utime_us\": 1777617000123456", "\"expected_utime_us\": 1777617900123456",
             "are different times"},
        Case{"\"place\": 1", "\"place\": 2", "field 'timetable/places/1/place'"}}) {
    EXPECT_THAT(bundle.error_after(kPlanFile, replaced(text, fault.from, fault.to)),
                HasSubstr(fault.field))
        << fault.to;
  }
}

TEST(PlanBundle, UnknownNumbersAreNullAndNanAndReadBackAsNan) {
  flight::Plan plan = sample();
  plan.measures.mean_height_m = std::nan("");
  plan.verdict.clearance_min_m = std::nan("");
  plan.verdict.clearance_min_place.x_m = std::nan("");
  plan.trajectory.states[3].surface_m = std::nan("");
  EXPECT_TRUE(Json::parse(plan_json(plan))["measures"]["mean_height_m"].is_null());
  expect_same(written_and_read(plan), plan);
}

TEST(PlanBundle, RandomNumbersOfAnyMagnitudeReadBackExactly) {
  std::mt19937_64 generator(test::fresh_seed());
  std::uniform_real_distribution<double> mantissa(-1.0, 1.0);
  std::uniform_int_distribution<int> exponent(-60, 20);
  flight::Plan plan = sample();
  for (std::size_t i = 0; i < plan.trajectory.states.size(); ++i) {
    for (const TrajectoryColumn& column : kTrajectoryColumns) {
      if (column.member != nullptr && column.member != &flight::FlightState::time_s &&
          column.member != &flight::FlightState::x_m &&
          column.member != &flight::FlightState::y_m) {
        plan.trajectory.states[i].*column.member =
            std::ldexp(mantissa(generator), exponent(generator));
      }
    }
  }
  for (flight::Waypoint& waypoint : plan.route_plan.route.guide) {
    waypoint.altitude_m = std::ldexp(mantissa(generator), exponent(generator) / 2);
  }
  expect_same(written_and_read(plan), plan);
}

TEST(PlanBundle, SamePlanGivesTheSameTexts) {
  const flight::Plan again = test::make_sample_plan(test::make_sample_map());
  EXPECT_TRUE(plan_json(again) == plan_json(sample()));
  EXPECT_TRUE(route_geojson(again) == route_geojson(sample()));
  EXPECT_TRUE(trajectory_csv(again) == trajectory_csv(sample()));
}

TEST(PlanBundle, PlanJsonSaysWhatWasAskedAndWhatCameOut) {
  const Json json = Json::parse(plan_json(sample()));
  EXPECT_EQ(json["schema_version"], 1);
  EXPECT_EQ(json["map"]["label"], "SYNTHETIC REGION");
  EXPECT_EQ(json["map"]["attributions"][0], "Hills made of sines, not a real place");
  EXPECT_EQ(json["request"]["seed"].get<std::uint64_t>(), 18446744073709551615ULL);
  EXPECT_TRUE(json["request"]["goal"]["height_m"].is_null());
  // 12345.678 + 2345.5 + 345.25 + 45.125
  EXPECT_NEAR(json["route"]["cost"]["total_m"].get<double>(), 15081.553, 1e-9);
  EXPECT_NEAR(json["route"]["gap"].get<double>(), (15081.553 - 11111.25) / 15081.553, 1e-12);
  EXPECT_EQ(json["config"]["hash"], hash128(sample().route_plan.config_text).hex());
  EXPECT_EQ(json["verification"]["violations"][1]["rule"], "bank");
  EXPECT_EQ(json["warnings"].size(), 2U);
}

TEST(PlanBundle, RouteWithoutABoundHasNoGap) {
  flight::Plan plan = sample();
  plan.route_plan.route.lower_bound_m = 0.0;
  const Json json = Json::parse(plan_json(plan));
  EXPECT_TRUE(json["route"]["lower_bound_m"].is_null());
  EXPECT_TRUE(json["route"]["gap"].is_null());
  EXPECT_EQ(written_and_read(plan).route_plan.route.lower_bound_m, 0.0);
}

TEST(PlanBundle, GeoJsonHoldsLongitudeLatitudeAltitudeWhereGdalPutsThem) {
  const Json json = Json::parse(route_geojson(sample()));
  EXPECT_EQ(json["type"], "FeatureCollection");
  EXPECT_EQ(json["label"], "SYNTHETIC REGION");
  EXPECT_EQ(json["attributions"].size(), 1U);
  const Json& planned = json["features"][0];
  EXPECT_EQ(planned["properties"]["kind"], "planned_route");
  EXPECT_EQ(planned["geometry"]["type"], "LineString");
  const auto& waypoints = sample().route_plan.route.waypoints;
  ASSERT_EQ(planned["geometry"]["coordinates"].size(), waypoints.size());
  OGRSpatialReference utm;
  utm.importFromEPSG(32632);
  OGRSpatialReference geodetic;
  geodetic.importFromEPSG(4326);
  geodetic.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  const std::unique_ptr<OGRCoordinateTransformation> transformation(
      OGRCreateCoordinateTransformation(&utm, &geodetic));
  for (std::size_t i = 0; i < waypoints.size(); ++i) {
    double x = waypoints[i].x_m;
    double y = waypoints[i].y_m;
    ASSERT_TRUE(transformation->Transform(1, &x, &y));
    const Json& position = planned["geometry"]["coordinates"][i];
    EXPECT_NEAR(position[0].get<double>(), x, 1e-8);  // 8 decimals are written
    EXPECT_NEAR(position[1].get<double>(), y, 1e-8);
    EXPECT_NEAR(position[2].get<double>(), waypoints[i].altitude_m, 5.1e-4);
  }
  const Json& flown = json["features"][1];
  EXPECT_EQ(flown["properties"]["kind"], "flown_track");
  const double duration_s = sample().trajectory.states.back().time_s;
  // One position a second, first and last included.
  EXPECT_NEAR(static_cast<double>(flown["geometry"]["coordinates"].size()), duration_s + 1.5, 1.0);
  EXPECT_EQ(json["features"].size(), 4 + waypoints.size());
}

TEST(PlanBundle, CsvHasUnitsInItsHeaderAndEightDecimalsInDegrees) {
  const std::string text = trajectory_csv(sample());
  const std::string header = text.substr(0, text.find('\n'));
  for (const char* name : {"time_s", "altitude_m", "latitude_deg", "longitude_deg",
                           "heading_true_rad", "heading_grid_rad", "height_above_surface_m"}) {
    EXPECT_THAT("," + header + ",", HasSubstr("," + std::string(name) + ","));
  }
  const std::string first =
      text.substr(header.size() + 1, text.find('\n', header.size() + 1) - header.size() - 1);
  EXPECT_THAT(first, testing::MatchesRegex("0,49\\.[0-9]{8},11\\.[0-9]{8},[0-9.]+,.*"));
}

TEST(PlanBundle, MapWithoutCoordinateSystemGivesPlanWithoutGeodeticPositions) {
  flight::Plan plan = sample();
  plan.route_plan.map.crs_wkt.clear();
  EXPECT_TRUE(Json::parse(route_geojson(plan))["features"][0]["geometry"].is_null());
  expect_same(written_and_read(plan), plan);
}

TEST(PlanBundle, WrongFieldIsNamedWithFileLineAndField) {
  const std::string text = plan_json(sample());
  const DamagedBundle bundle(sample());
  struct Case {
    const char* from;
    const char* to;
    const char* field;
  };
  for (const Case& fault :
       {Case{"\"decisions\": 6001", "\"decisions\": \"many\"",
             "field 'local_planner/decisions' must be a whole number"},
        Case{"\"batches\": 12", "\"batches\": -1", "field 'route/batches'"},
        Case{"\"samples\": 12001", "\"samples\": 1e300",
             "field 'route/samples' must be a whole number"},
        Case{"\"is_verified\": false", "\"is_verified\": true",
             "field 'verification/is_verified' is true beside violations"},
        Case{"\"rule\": \"bank\"", "\"rule\": 7",
             "field 'verification/violations/1/rule' must be a text"},
        Case{"\"seed\": 18446744073709551615", "\"seed\": -3", "field 'request/seed'"},
        Case{"\"guide_spacing_m\": 50.25", "\"guide_spacing_m\": null",
             "field 'route/guide_spacing_m' must be a number"},
        Case{"\"schema_version\": 1", "\"schema_version\": 2",
             "field 'schema_version' is 2, this program reads 1"},
        Case{"\"schema\": \"hedgehop plan\"", "\"schema\": \"other\"",
             "field 'schema' must be 'hedgehop plan'"},
        Case{"\"text\": \"speed_mps: 40", "\"text\": \"speed_mps: 41",
             "field 'config/hash' does not belong"}}) {
    const std::string wrong = replaced(text, fault.from, fault.to);
    const std::string error = bundle.error_after(kPlanFile, wrong);
    EXPECT_THAT(error, HasSubstr(fault.field));
    const bool is_hash = std::string(fault.field).find("hash") != std::string::npos;
    const int line = is_hash ? line_of(wrong, "\"config\"") + 1 : line_of(wrong, fault.to);
    EXPECT_THAT(error, HasSubstr(std::string(kPlanFile) + ":" + std::to_string(line) + ":"));
  }
}

TEST(PlanBundle, RequestThatDoesNotBelongToItsIdIsRefused) {
  const std::string error = error_after(
      sample(), kPlanFile,
      replaced(plan_json(sample()), "\"work_budget\": 123456789012345", "\"work_budget\": 5"));
  EXPECT_THAT(error, HasSubstr("field 'request_id' does not belong"));
}

TEST(PlanBundle, KeyThatStandsTwiceAndDeepNestingAreRefused) {
  EXPECT_THAT(error_after(sample(), kPlanFile,
                          replaced(plan_json(sample()), "\"samples\": 12001",
                                   "\"samples\": 12001, \"samples\": 12001")),
              HasSubstr("the key 'samples' stands there twice"));
  EXPECT_THAT(error_after(sample(), kPlanFile, std::string(1'000'000, '[')),
              HasSubstr("nested too deeply"));
}

TEST(PlanBundle, WrongTrajectoryIsNamedWithFileLineAndColumn) {
  const std::string text = trajectory_csv(sample());
  const std::size_t second = text.find('\n', text.find('\n') + 1) + 1;
  const std::size_t third = text.find('\n', second) + 1;
  const DamagedBundle bundle(sample());
  const std::string line = text.substr(second, third - second);
  const auto with = [&](const std::string& other) {
    return text.substr(0, second) + other + text.substr(third);
  };
  EXPECT_THAT(bundle.error_after(kTrajectoryFile, with(replaced(line, "0.05", "0.0x"))),
              HasSubstr("trajectory.csv:3: column 'time_s' holds '0.0x', which is no number"));
  EXPECT_THAT(bundle.error_after(kTrajectoryFile, with(replaced(line, "0.05", "nan"))),
              HasSubstr("trajectory.csv:3: column 'time_s' must be known"));
  EXPECT_THAT(bundle.error_after(kTrajectoryFile, with(replaced(line, "0.05", "0"))),
              HasSubstr("trajectory.csv:3: column 'time_s' must grow"));
  EXPECT_THAT(bundle.error_after(kTrajectoryFile, with(replaced(line, "0.05", "1e99"))),
              HasSubstr("trajectory.csv:3: column 'time_s' is out of range"));
  EXPECT_THAT(bundle.error_after(kTrajectoryFile, with("1,2,3\n")),
              HasSubstr("trajectory.csv:3: the line must have 23 columns"));
  EXPECT_THAT(bundle.error_after(kTrajectoryFile, with("")), HasSubstr("states, plan.json says"));
  EXPECT_THAT(bundle.error_after(kTrajectoryFile, "time_s,x\n"),
              HasSubstr("trajectory.csv:1: the first line must be"));
  EXPECT_THAT(bundle.error_after(kTrajectoryFile, text.substr(0, text.size() - 5)),
              HasSubstr("cut off"));
}

TEST(PlanBundle, FolderWithoutABundleIsRefusedWithAHint) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(read_plan_bundle(folder.path()), DataError);
  EXPECT_THROW(read_plan_bundle(folder.path() / "nothing"), DataError);
  write_plan_bundle(sample(), folder.path());
  std::filesystem::remove(folder.path() / kTrajectoryFile);
  try {
    read_plan_bundle(folder.path());
    FAIL();
  } catch (const DataError& error) {
    EXPECT_THAT(error.what(), HasSubstr("holds no trajectory.csv"));
    EXPECT_FALSE(error.hint().empty());
  }
}

/// A short plan, so that many damaged copies are read quickly.
flight::Plan short_plan() {
  flight::Plan plan = sample();
  plan.trajectory.states.resize(20);
  plan.route_plan.route.guide.resize(5);
  return plan;
}

TEST(PlanBundle, TruncatedFilesAreRefused) {
  const flight::Plan plan = short_plan();
  std::mt19937_64 generator(test::fresh_seed());
  const std::string json = plan_json(plan);
  const std::string csv = trajectory_csv(plan);
  const DamagedBundle bundle(plan);
  for (int attempt = 0; attempt < 40; ++attempt) {
    // The closing line feed alone is no loss in JSON.
    const auto cut = [&](const std::string& text) {
      return text.substr(0,
                         std::uniform_int_distribution<std::size_t>(0, text.size() - 2)(generator));
    };
    EXPECT_THAT(bundle.error_after(kPlanFile, cut(json)), HasSubstr("plan.json:"));
    EXPECT_THAT(bundle.error_after(kTrajectoryFile, cut(csv)), HasSubstr("trajectory.csv:"));
  }
}

TEST(PlanBundle, GarbledFilesAreReadOrRefusedButNothingElse) {
  const flight::Plan plan = short_plan();
  std::mt19937_64 generator(test::fresh_seed());
  const DamagedBundle bundle(plan);
  int refused = 0;
  for (int attempt = 0; attempt < 120; ++attempt) {
    const char* file = attempt % 2 == 0 ? kPlanFile : kTrajectoryFile;
    std::string text = attempt % 2 == 0 ? plan_json(plan) : trajectory_csv(plan);
    const int changes = std::uniform_int_distribution<int>(1, 4)(generator);
    for (int change = 0; change < changes; ++change) {
      const auto at = std::uniform_int_distribution<std::size_t>(0, text.size() - 1)(generator);
      switch (generator() % 3) {
        case 0:
          text[at] = static_cast<char>(generator());
          break;
        case 1:
          text.erase(at, 1 + generator() % 30);
          break;
        default:
          text.insert(at, text.substr(generator() % text.size(), generator() % 40));
      }
    }
    refused += bundle.error_after(file, text).empty() ? 0 : 1;
  }
  EXPECT_GT(refused, 40);
}

}  // namespace
}  // namespace hedgehop::output
