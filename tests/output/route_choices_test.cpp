#include "output/route_choices.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <string>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "base/files.hpp"
#include "geo/map_projection.hpp"
#include "sample_choices.hpp"
#include "sample_plan.hpp"
#include "support/temporary_folder.hpp"

namespace hedgehop::output {
namespace {

using testing::HasSubstr;
using Json = nlohmann::json;

class RouteChoicesFile : public testing::Test {
 protected:
  RouteChoicesFile()
      : map_(test::make_sample_map()),
        plan_(test::make_sample_plan(map_)),
        choices_(test::make_sample_choices(plan_)) {
    stuck_.cause = flight::NoPlanCause::kLocalPlannerStuck;
    stuck_.explanation = "a wall";
    flown_ = {{0, &plan_, nullptr}, {1, &plan_, nullptr}, {2, nullptr, &stuck_}};
  }

  std::optional<RouteList> read(const std::string& text) {
    write_file_atomically(folder_.path() / kChoicesFile, text);
    return read_route_choices(folder_.path());
  }
  void expect_refused(const Json& json, const std::string& field) {
    try {
      read(json.dump());
      ADD_FAILURE() << "accepted: " << field;
    } catch (const DataError& error) {
      EXPECT_THAT(std::string(error.what()), HasSubstr(field));
      EXPECT_THAT(std::string(error.what()), HasSubstr(kChoicesFile));
    }
  }

  map::Map map_;
  flight::Plan plan_;
  flight::NoPlan stuck_;
  flight::RouteChoices choices_;
  std::vector<FlownChoice> flown_;
  test::TemporaryFolder folder_;
};

TEST_F(RouteChoicesFile, ReadsBackWhatWasWritten) {
  const auto list = read(route_choices_json(choices_, flown_));
  ASSERT_TRUE(list);
  EXPECT_EQ(list->request_id, plan_.route_plan.request_id);
  EXPECT_EQ(list->why_no_more, "quiet: no <valley>");
  ASSERT_EQ(list->routes.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    const flight::RouteChoice& choice = choices_.routes[i];
    const ListedRoute& route = list->routes[i];
    EXPECT_EQ(route.name, choice.name);
    EXPECT_EQ(route.waypoints, choice.plan.route.waypoints);
    EXPECT_EQ(route.measures.length_m, choice.measures.length_m);
    EXPECT_EQ(route.measures.visibility_m, choice.measures.visibility_m);
    EXPECT_EQ(route.measures.semantics_m, choice.measures.semantics_m);
    EXPECT_EQ(route.cost_m, choice.plan.route.cost.total_m());
  }
  EXPECT_EQ(list->routes[0].shared_share, 0.375);
  EXPECT_EQ(list->routes[1].shared_share, 0.4375);
  EXPECT_TRUE(list->routes[1].is_flown);
  EXPECT_FALSE(list->routes[2].is_flown) << "no flight along it arrives";
}

TEST_F(RouteChoicesFile, SaysWhichFlightsWereMadeAndWhyOneWasNot) {
  const Json json = Json::parse(route_choices_json(choices_, flown_));
  EXPECT_EQ(json["routes"][0]["flown"]["plan"], ".");
  EXPECT_EQ(json["routes"][1]["flown"]["plan"], "alternatives/hidden");
  EXPECT_EQ(json["routes"][1]["flown"]["violation_count"], 2);
  EXPECT_EQ(json["routes"][2]["flown"]["cause"], "local_planner_stuck");
  EXPECT_EQ(json["routes"][2]["flown"]["explanation"], "a wall");
  EXPECT_EQ(json["routes"][2]["shared"]["hidden"], 0.25);
  const Json unflown = Json::parse(route_choices_json(choices_, {}));
  EXPECT_TRUE(unflown["routes"][1]["flown"].is_null());
}

TEST_F(RouteChoicesFile, APlanWithoutOneHasNoChoices) {
  EXPECT_FALSE(read_route_choices(folder_.path()));
}

TEST_F(RouteChoicesFile, WhatIsWrongIsRefusedWithItsField) {
  const Json good = Json::parse(route_choices_json(choices_, flown_));
  const auto with = [&](const char* pointer, const Json& value) {
    Json changed = good;
    changed[Json::json_pointer(std::string("/") + pointer)] = value;
    return changed;
  };
  for (const char* name : {"../evil", "a/b", "", "-rf", "Upper", "."}) {
    expect_refused(with("routes/1/name", name), "routes/1/name");
  }
  expect_refused(with("routes/1/name", "main"), "routes/0/name");
  expect_refused(with("schema", "hedgehop plan"), "schema");
  expect_refused(with("schema_version", 2), "schema_version");
  expect_refused(with("request_id", "zz"), "request_id");
  expect_refused(with("routes/0/waypoints", Json::array()), "routes/0/waypoints");
  expect_refused(with("routes/0/waypoints/1/x_m", 1e30), "routes/0/waypoints/1/x_m");
  expect_refused(with("routes/2/shared/hidden", 1.5), "routes/2/shared/hidden");
  Json missing = good;
  missing["routes"][2]["shared"].erase("hidden");
  expect_refused(missing, "hidden");
}

TEST_F(RouteChoicesFile, GeoJsonHasALineForEachRoute) {
  const Json json = Json::parse(route_choices_geojson(choices_));
  ASSERT_EQ(json["features"].size(), 3U);
  EXPECT_EQ(json["features"][1]["properties"]["name"], "hidden");
  const Json& line = json["features"][1]["geometry"]["coordinates"];
  ASSERT_EQ(line.size(), choices_.routes[1].plan.route.waypoints.size());
  const geo::GeodeticPosition wanted =
      geo::MapProjection(map_.crs_wkt)
          .to_geodetic(choices_.routes[1].plan.route.waypoints[3].point());
  EXPECT_NEAR(line[3][0].get<double>(), degrees_from_radians(wanted.longitude_rad), 1e-8);
  EXPECT_NEAR(line[3][1].get<double>(), degrees_from_radians(wanted.latitude_rad), 1e-8);
}

}  // namespace
}  // namespace hedgehop::output
