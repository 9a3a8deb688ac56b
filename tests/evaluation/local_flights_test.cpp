#include "evaluation/local_flights.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <oneapi/tbb/global_control.h>

#include "support/fresh_seed.hpp"
#include "support/shipped_options.hpp"
#include "support/test_map.hpp"
#include "support/utm_map.hpp"

namespace hedgehop::evaluation {
namespace {

// 9 x 6 km of low hills in UTM zone 32, seen in stripes.
map::Map striped_hills() {
  map::Map map = test::make_map(300, 200, 30.0, [](double x_m, double y_m) {
    return 400.0 + 12.0 * (std::sin(x_m / 400.0) + std::cos(y_m / 300.0));
  });
  test::place_in_utm(map);
  for (int row = 0; row < 200; ++row) {
    for (int column = 0; column < 300; ++column) {
      map.visibility.at(column, row) =
          test::stored_visibility((row / 7 + column / 30) % 2 == 0 ? 0.1 : 0.5);
    }
  }
  test::finish_map(map);
  return map;
}

DrawnRoutes straight_routes(const map::Map& map) {
  DrawnRoutes drawn;
  for (int i = 0; i < 2; ++i) {
    DrawnRoute route;
    route.problem = 10 + i;
    for (double x_m = 1500.0; x_m <= 7500.0; x_m += 50.0) {
      const geo::MapPoint point{test::kUtmWest_m + x_m, test::kUtmSouth_m + 2000.0 + 800.0 * i};
      route.guide.push_back(
          {point.x_m, point.y_m, raster::sample_bilinear(map.surface_m, point) + 35.0});
    }
    route.start = route.guide.front();
    route.goal = route.guide.back();
    drawn.routes.push_back(route);
  }
  drawn.problems = 13;
  return drawn;
}

Table2Options shipped_table2() { return test::shipped_evaluation("table2", read_table2_options); }
LocalSafetyOptions shipped_safety() {
  return test::shipped_evaluation("local_safety", read_local_safety_options);
}

TEST(EvaluateTable2, ComparesWithPlainFollowingAndFindsNoRegression) {
  const map::Map map = striped_hills();
  SilentObserver observer;
  const Table2Result result = evaluate_table2(map, test::shipped_planning(), shipped_table2(),
                                              straight_routes(map), test::fresh_seed(), observer);
  EXPECT_EQ(result.runs, 2);
  EXPECT_EQ(result.plain_not_reached, 0);
  ASSERT_EQ(result.comparisons.size(), 2U);
  const Table2Comparison& optimised = result.comparisons[0];
  const Table2Comparison& lateral = result.comparisons[1];
  for (const Table2Comparison* comparison : {&optimised, &lateral}) {
    EXPECT_EQ(comparison->pairs, 2);
    EXPECT_EQ(comparison->regressions, 0);
    EXPECT_EQ(comparison->not_verified, 0);
    // Two straight lines of 6 km.
    EXPECT_NEAR(comparison->length.baseline_sum, 12000.0, 150.0);
    EXPECT_LE(comparison->cost.change, 0.0);
  }
  EXPECT_EQ(optimised.length.baseline_sum, lateral.length.baseline_sum);
  EXPECT_LT(optimised.height.change, -0.2) << "flown 35 m high over hills of 12 m";
  EXPECT_GT(lateral.height.change, -0.2);
  EXPECT_LT(optimised.visibility.change, lateral.visibility.change) << "height is seen";

  const auto json = nlohmann::json::parse(table2_result_json(result));
  EXPECT_EQ(json.at("comparisons").at(0).at("name"), "optimised");
  EXPECT_EQ(json.at("comparisons").at(0).at("pairs"), 2);
  EXPECT_EQ(json.at("paper").at("bank").at(0), 0.45);
  EXPECT_TRUE(json.at("comparisons").at(1).at("semantics").at("change").is_null())
      << "no land use, no change";
}

TEST(EvaluateLocalSafety, CountsWhatTheVerifierSaysOfTheSameFlightsInEveryRow) {
  const map::Map map = striped_hills();
  SilentObserver observer;
  LocalSafetyOptions options = shipped_safety();
  const std::string text = test::shipped_planning().text;
  options.rows = {{"plain", false, {"local.vertical_pass.use=false"}},
                  {"low", false, {}},
                  {"demanding", false, {"verification.required_clearance_m=60"}},
                  {"towers", true, {}}};
  const std::uint64_t seed = test::fresh_seed();
  const auto run = [&](std::size_t threads) {
    const oneapi::tbb::global_control control(oneapi::tbb::global_control::max_allowed_parallelism,
                                              threads);
    return evaluate_local_safety(map, text, options, {60.0, 0.35}, straight_routes(map), seed,
                                 observer);
  };
  const LocalSafetyResult result = run(1);
  ASSERT_EQ(result.rows.size(), 4U);
  for (const LocalSafetyRow& row : result.rows) {
    EXPECT_EQ(row.flights, 2);
  }
  const LocalSafetyRow& plain = result.rows[0];
  EXPECT_EQ(plain.reached, 2);
  EXPECT_EQ(plain.collisions, 0);
  EXPECT_EQ(plain.clearance_violations, 0);
  EXPECT_TRUE(plain.unsafe_problems.empty());
  EXPECT_EQ(plain.ways_out, 2) << "cut off anywhere over hills of 24 m";
  EXPECT_GE(plain.min_clearance_m, 10.0);
  EXPECT_NEAR(plain.mean_height_m, 35.0, 6.0);
  EXPECT_EQ(plain.share_under_ceiling, 1.0);
  EXPECT_NEAR(plain.length_m, 12000.0, 600.0);
  EXPECT_LT(result.rows[1].mean_height_m, plain.mean_height_m - 5.0);
  EXPECT_EQ(result.rows[2].clearance_violations, 2) << "nothing flies 60 m high here";
  EXPECT_EQ(result.rows[2].collisions, 0);
  EXPECT_EQ(result.rows[2].ways_out, 0) << "they begin too low";
  EXPECT_EQ(result.rows[2].unsafe_problems, (std::vector<std::int64_t>{10, 11}));
  EXPECT_EQ(run(4).rows[3].min_clearance_m, result.rows[3].min_clearance_m);

  const auto json = nlohmann::json::parse(local_safety_result_json(result));
  EXPECT_EQ(json.at("rows").at(3).at("towers"), true);
  EXPECT_EQ(json.at("rows").at(0).at("planner"), "plain");
  EXPECT_EQ(json.at("rows").at(0).at("seed"), seed);
}

TEST(AddTowers, StandsTheAskedNumberAndNoneNearTheEnds) {
  const map::Map bare = striped_hills();
  const DrawnRoute route = straight_routes(bare).routes[1];
  LocalSafetyOptions options = shipped_safety();
  map::Map map = bare;
  const std::uint64_t seed = test::fresh_seed();
  const auto towers = add_towers(map, options, route, seed);
  // 54 square kilometres with 3 each, less those within 500 m of two ends (1.57 of them: 5 towers
  // are expected there).
  EXPECT_LE(towers.size(), 162U);
  EXPECT_GE(towers.size(), 162U - 25U);
  std::size_t raised = 0;
  for (int row = 0; row < 200; ++row) {
    for (int column = 0; column < 300; ++column) {
      const double rise_m = map.surface_m.at(column, row) - bare.surface_m.at(column, row);
      if (rise_m == 0.0) {
        continue;
      }
      ++raised;
      EXPECT_GE(rise_m, options.tower_height_min_m - 0.01);
      EXPECT_LE(rise_m, options.tower_height_max_m + 0.01);
      const geo::MapPoint place = map.geometry.centre({column, row});
      EXPECT_GE(std::hypot(place.x_m - route.start.x_m, place.y_m - route.start.y_m), 500.0);
      EXPECT_GE(std::hypot(place.x_m - route.goal.x_m, place.y_m - route.goal.y_m), 500.0);
    }
  }
  EXPECT_LE(raised, towers.size()) << "two may share a cell";
  EXPECT_GE(raised + 10, towers.size());
  map::Map again = bare;
  add_towers(again, options, route, seed);
  EXPECT_EQ(again.surface_m.values(), map.surface_m.values());
}

TEST(ReadLocalEvaluationOptions, RefuseAMisspeltKeyAndNonsense) {
  ConfigReader misspelt = ConfigReader::from_text(
      "{runs: 2, bootstrap_draws: 100, plain_settings: [], lateral_settings: [], run: 3}", "bad");
  EXPECT_THROW(read_table2_options(misspelt), ConfigError);
  ConfigReader none = ConfigReader::from_text(
      "{runs: 0, bootstrap_draws: 100, plain_settings: [], lateral_settings: []}", "bad");
  EXPECT_THROW(read_table2_options(none), ConfigError);
  ConfigReader low = ConfigReader::from_text(
      "{flights: 2, towers_per_km2: 3, tower_height_min_m: 70, tower_height_max_m: 60, "
      "tower_free_radius_m: 5, tower_near_m: 5, rows: [{planner: a, towers: no, settings: []}]}",
      "bad");
  EXPECT_THROW(read_local_safety_options(low), ConfigError);
}

}  // namespace
}  // namespace hedgehop::evaluation
