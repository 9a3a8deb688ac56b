#include "evaluation/framework_comparison.hpp"

#include <chrono>
#include <cmath>
#include <ctime>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "base/errors.hpp"
#include "support/fresh_seed.hpp"
#include "support/shipped_options.hpp"
#include "support/temporary_folder.hpp"
#include "support/test_map.hpp"
#include "support/utm_map.hpp"

namespace hedgehop::evaluation {
namespace {

// 12 x 9 km, flat at 200 m and unseen: the straight line is best.
map::Map flat_map() {
  map::Map map = test::make_map(400, 300, 30.0, [](double, double) { return 200.0; });
  test::place_in_utm(map);
  test::finish_map(map);
  return map;
}

double process_s() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }
double steady_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

FrameworkOptions options_of(std::int64_t runs) {
  FrameworkOptions options = test::shipped_evaluation("table3", read_framework_options);
  options.runs = runs;
  options.drawing.distance_min_m = 5000.0;
  options.budget_s = 0.4;
  options.edge_runs = 1;
  options.bootstrap_draws = 100;
  return options;
}

class FrameworkComparison : public ::testing::Test {
 protected:
  FrameworkResult compare(const FrameworkOptions& options, std::uint64_t seed) {
    return compare_frameworks(map_, config_, options, seed, folder_.path(), process_s, steady_s,
                              observer_);
  }
  map::Map map_ = flat_map();
  planning::PlanningConfig config_ = test::shipped_planning();
  test::TemporaryFolder folder_;
  SilentObserver observer_;
};

TEST_F(FrameworkComparison, OnFlatLandAllFlyStraightAndOursLowest) {
  const FrameworkResult result = compare(options_of(3), test::fresh_seed());
  EXPECT_EQ(result.solved, 3);
  EXPECT_EQ(result.problems.size(), 3U) << "flat land has no problem without a plan";
  EXPECT_EQ(result.paper_solved, 3);
  // V^2 / (g tan 30 deg) of 40 m/s.
  EXPECT_NEAR(result.turn_radius_m, 1600.0 / (9.80665 * std::tan(std::acos(-1.0) / 6.0)), 0.1);
  for (const FrameworkProblem& problem : result.problems) {
    EXPECT_TRUE(problem.ours.is_verified);
    EXPECT_GE(problem.lower_bound_m, 5000.0 * 0.9);
    EXPECT_GE(problem.ours.route_cost_m, problem.lower_bound_m);
    EXPECT_GT(problem.wall_s, 0.0);
    if (problem.baseline.is_found) {
      EXPECT_GE(problem.baseline.measures.length_m, 5000.0);
      EXPECT_LE(problem.baseline.measures.max_height_m, 300.0 + 1e-6) << "its relaxed ceiling";
      EXPECT_GE(problem.baseline.measures.length_m, problem.ours.measures.length_m - 200.0)
          << "ours may end anywhere in the goal's circle";
    }
  }
  EXPECT_GT(result.problems[0].straight_edges, 0);
  EXPECT_EQ(result.problems[1].straight_edges, 0) << "counted on one problem";

  const auto json = nlohmann::json::parse(framework_result_json(result, {"cpu", "none", "1"}));
  EXPECT_EQ(json.at("success"), 1.0);
  EXPECT_EQ(json.at("comparisons").at(0).at("against"), "dubins");
  const double solved = json.at("baseline").at("share_solved");
  EXPECT_DOUBLE_EQ(solved, static_cast<double>(result.baseline_solved) / 3.0);
  EXPECT_DOUBLE_EQ(json.at("baseline").at("share_not_solved"), 1.0 - solved);
  EXPECT_EQ(json.at("comparisons").at(2).at("pairs"), 3);
  EXPECT_LT(json.at("comparisons").at(2).at("height").at("change"), 0.0) << "the vertical pass";
}

TEST_F(FrameworkComparison, InterruptedRunGoesOnWithTheSameNumbers) {
  const std::uint64_t seed = test::fresh_seed();
  FrameworkOptions options = options_of(1);
  options.edge_runs = 0;
  const FrameworkResult first = compare(options, seed);
  options.runs = 2;
  const FrameworkResult longer = compare(options, seed);
  EXPECT_EQ(longer.from_cache, 1);
  const FrameworkResult again = compare(options, seed);
  EXPECT_EQ(again.from_cache, 2);
  EXPECT_EQ(framework_result_json(again, {}), framework_result_json(longer, {}));
  options.budget_s = 0.2;
  EXPECT_EQ(compare(options, seed).from_cache, 0) << "another question";
}

TEST_F(FrameworkComparison, SaysHowManyWereSolvedWhenTheyAreTooFew) {
  FrameworkOptions options = options_of(1);
  config_ = test::shipped_planning({"verification.required_clearance_m=60"});
  try {
    compare(options, 1);
    FAIL() << "no flight of 18 m keeps 60 m";
  } catch (const DataError& error) {
    EXPECT_NE(std::string(error.what()).find("only 0 of 3"), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace hedgehop::evaluation
