#include "evaluation/sensitivity.hpp"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <oneapi/tbb/global_control.h>

#include "base/errors.hpp"
#include "support/fresh_seed.hpp"
#include "support/shipped_options.hpp"
#include "support/test_map.hpp"
#include "support/utm_map.hpp"

namespace hedgehop::evaluation {
namespace {

class Sensitivity : public ::testing::Test {
 protected:
  Sensitivity() {
    test::place_in_utm(map_);
    test::finish_map(map_);
    options_.runs = 2;
    options_.bootstrap_draws = 100;
  }
  // Straight, 20 m above the floor of the envelope.
  SensitivityResult evaluate() {
    const auto plan = [](const map::Map& map, const flight::PlanRequest& request,
                         const planning::PlanningConfig& config,
                         Observer&) -> std::variant<flight::RoutePlan, flight::NoPlan> {
      const geo::MapProjection projection(map.crs_wkt);
      const geo::MapPoint start = projection.to_map(request.start.position);
      const geo::MapPoint goal = projection.to_map(request.goal.position);
      const double altitude_m = 200.0 + config.global.envelope_floor_m + 20.0;
      flight::RoutePlan found;
      found.start = {start.x_m, start.y_m, altitude_m};
      found.goal = {goal.x_m, goal.y_m, altitude_m};
      for (int i = 0; i <= 100; ++i) {
        found.route.guide.push_back({start.x_m + 0.01 * i * (goal.x_m - start.x_m),
                                     start.y_m + 0.01 * i * (goal.y_m - start.y_m), altitude_m});
      }
      return found;
    };
    SilentObserver observer;
    return evaluate_sensitivity(map_, test::shipped_planning(), options_, {1500.0, 5000.0, 100000},
                                seed_, {}, plan, observer);
  }
  map::Map map_ = test::make_map(400, 300, 30.0, [](double, double) { return 200.0; });
  SensitivityOptions options_ = test::shipped_evaluation("sensitivity", read_sensitivity_options);
  std::uint64_t seed_ = test::fresh_seed();
};

TEST_F(Sensitivity, AWeightOfTheGlobalPlannerChangesTheRoutes) {
  // Flown 20 + 20 m high, and 40 + 20 m high.
  options_.parameters = {{"global.envelope_floor_m", "floor", true, {20.0, 40.0}}};
  const SensitivityResult result = evaluate();
  ASSERT_EQ(result.rows.size(), 2U);
  EXPECT_TRUE(result.rows[0].is_base);
  EXPECT_FALSE(result.rows[1].is_base);
  EXPECT_EQ(result.rows[1].pairs, 2);
  EXPECT_EQ(result.rows[0].height->change, 0.0);
  EXPECT_NEAR(result.rows[1].height->change, 0.5, 0.05);
  EXPECT_NEAR(result.rows[1].length->change, 0.0, 0.01);
}

TEST_F(Sensitivity, FlightsThatDoNotArriveAreCountedAndNotCompared) {
  options_.parameters = {{"local.length_factor_max", "length", false, {1.0, 3.0}},
                         {"verification.required_clearance_m", "clearance", false, {60.0}}};
  const SensitivityResult result = evaluate();
  ASSERT_EQ(result.rows.size(), 3U);
  EXPECT_EQ(result.rows[1].reached, 2);
  EXPECT_EQ(result.rows[1].violations, 0);
  // The demand changes no flight, and is not what flights are counted by: the base config's is.
  EXPECT_EQ(result.rows[2].violations, 0);
  EXPECT_EQ(result.rows[2].height->change, 0.0);
  const auto json = nlohmann::json::parse(sensitivity_result_json(result, {"cpu", "none", "1"}));
  EXPECT_EQ(json.at("rows").at(2).at("parameter"), "verification.required_clearance_m");
  EXPECT_TRUE(json.at("rows").at(2).at("visibility").at("change").is_null()) << "nothing is seen";
}

TEST_F(Sensitivity, ThreadsDoNotMatter) {
  options_.parameters = {{"local.look_ahead_m", "look-ahead", false, {150.0}}};
  const std::string two = sensitivity_result_json(evaluate(), {});
  const oneapi::tbb::global_control control(oneapi::tbb::global_control::max_allowed_parallelism,
                                            1);
  EXPECT_EQ(sensitivity_result_json(evaluate(), {}), two);
}

TEST_F(Sensitivity, ASettingThatDoesNotExistIsRefused) {
  options_.parameters = {{"local.no_such_key", "x", false, {1.0}}};
  EXPECT_THROW(evaluate(), ConfigError);
}

}  // namespace
}  // namespace hedgehop::evaluation
