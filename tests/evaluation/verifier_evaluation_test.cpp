#include "evaluation/verifier_evaluation.hpp"

#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <oneapi/tbb/global_control.h>

#include "evaluation/brute_force_judge.hpp"
#include "support/fresh_seed.hpp"
#include "support/shipped_options.hpp"
#include "support/test_map.hpp"
#include "support/utm_map.hpp"
#include "verification/perfect_flight.hpp"

namespace hedgehop::evaluation {
namespace {

using ::testing::ElementsAre;

// 9 x 9 km of hills with a power line, in UTM zone 32.
map::Map hills() {
  map::Map map = test::make_map(300, 300, 30.0, [](double x_m, double y_m) {
    return 400.0 + 30.0 * std::sin(x_m / 500.0) + 30.0 * std::cos(y_m / 400.0);
  });
  test::place_in_utm(map);
  map.visibility = raster::Grid<std::uint16_t>(map.geometry, test::stored_visibility(0.1));
  map::OverheadLine line;
  line.supports = {{{test::kUtmWest_m + 4500.0, test::kUtmSouth_m + 1.0}, 12.0},
                   {{test::kUtmWest_m + 4600.0, test::kUtmSouth_m + 4500.0}, 12.0},
                   {{test::kUtmWest_m + 4500.0, test::kUtmSouth_m + 8999.0}, 12.0}};
  map.overhead_lines = {line};
  test::finish_map(map);
  return map;
}

VerifierOptions test_options(std::int64_t plans) {
  VerifierOptions options = test::shipped_evaluation("verifier", read_verifier_options);
  options.plans = plans;
  return options;
}

std::variant<flight::Plan, flight::NoPlan> real_plan(const map::Map& map,
                                                     const flight::PlanRequest& request,
                                                     const planning::PlanningConfig& config,
                                                     Observer& observer) {
  return planning::plan(map, request, config, {}, observer);
}

TEST(EvaluateVerifier, FindsNoFalseAlarmAndNothingAcceptedWronglyOverRealPlans) {
  const map::Map map = hills();
  const planning::PlanningConfig config = test::shipped_planning();
  SilentObserver observer;
  const std::uint64_t seed = test::fresh_seed();
  const VerifierResult result =
      evaluate_verifier(map, config, test_options(5), seed, real_plan, observer);
  EXPECT_TRUE(result.errors.empty());
  EXPECT_EQ(result.plans + result.no_plan, 5);
  EXPECT_EQ(result.judgements, 2 * result.plans);
  EXPECT_EQ(result.false_alarms, result.between_samples) << verifier_result_json(result);
  EXPECT_EQ(result.accepted_wrongly, 0) << verifier_result_json(result);
  EXPECT_EQ(result.sharp_false_alarms, 0);
  EXPECT_EQ(result.sharp_accepted_wrongly, 0);
  // What lies between two samples may be nearer than both, never farther than the nearer one.
  EXPECT_GE(result.ground.least_m, -1e-6);
  EXPECT_LE(result.ground.greatest_m, 0.3);
  const auto json = nlohmann::json::parse(verifier_result_json(result));
  EXPECT_EQ(json["seed"], seed);
  EXPECT_EQ(json["plans"], result.plans);
}

TEST(EvaluateVerifier, CountsWhereTheTwoDisagree) {
  map::Map map = hills();
  map.overhead_lines.clear();  // planners would see it in the surface
  test::finish_map(map);
  const planning::PlanningConfig config = test::shipped_planning();
  SilentObserver observer;
  VerifierOptions options = test_options(2);
  options.masts = 0;
  options.areas = 0;
  // Too small a teleport for the rough check, not for the verifier.
  const auto teleporting = [](const map::Map& on, const flight::PlanRequest& request,
                              const planning::PlanningConfig& with, Observer& watcher) {
    auto answer = real_plan(on, request, with, watcher);
    if (auto* plan = std::get_if<flight::Plan>(&answer)) {
      auto& states = plan->trajectory.states;
      for (std::size_t i = states.size() / 2; i < states.size(); ++i) {
        states[i].x_m += 0.02;
        states[i].surface_m = raster::sample_bilinear(on.surface_m, states[i].point());
        states[i].terrain_m = raster::sample_bilinear(on.terrain_m, states[i].point());
      }
    }
    return answer;
  };
  const VerifierResult alarmed =
      evaluate_verifier(map, config, options, test::fresh_seed(), teleporting, observer);
  EXPECT_EQ(alarmed.false_alarms, alarmed.plans);
  EXPECT_EQ(alarmed.between_samples, 0);
  ASSERT_EQ(alarmed.disagreements.size(), static_cast<std::size_t>(alarmed.plans));
  // A planner that fails, and one that finds nothing.
  const auto failing = [](const map::Map&, const flight::PlanRequest& request,
                          const planning::PlanningConfig&,
                          Observer&) -> std::variant<flight::Plan, flight::NoPlan> {
    if (request.seed % 2 == 0) {
      throw DataError("broken", "");
    }
    return flight::NoPlan{flight::NoPlanCause::kBudgetExhausted, std::nullopt, "nothing"};
  };
  const VerifierResult failed = evaluate_verifier(map, config, options, 4, failing, observer);
  EXPECT_EQ(failed.plans, 0);
  EXPECT_EQ(failed.no_plan, 1);
  EXPECT_THAT(failed.errors, ElementsAre(::testing::HasSubstr("broken")));
}

TEST(EvaluateVerifier, ResultDoesNotDependOnTheNumberOfThreads) {
  const map::Map map = hills();
  const planning::PlanningConfig config = test::shipped_planning();
  SilentObserver observer;
  const std::uint64_t seed = test::fresh_seed();
  const auto json_with = [&](std::size_t threads) {
    const oneapi::tbb::global_control control(oneapi::tbb::global_control::max_allowed_parallelism,
                                              threads);
    return verifier_result_json(
        evaluate_verifier(map, config, test_options(2), seed, real_plan, observer));
  };
  EXPECT_EQ(json_with(1), json_with(3));
}

// To the north over flat ground of 100 m, at 40 m/s and 150 m, from (3000, 1000).
class BruteForce : public testing::Test {
 protected:
  BruteForce() : map_(test::make_map(200, 200, 30.0, [](double, double) { return 100.0; })) {
    test::Manoeuvre manoeuvre;
    manoeuvre.x_m = 3000.0;
    manoeuvre.y_m = 1000.0;
    manoeuvre.altitude_m = 150.0;
    manoeuvre.duration_s = 60.0;
    flight_ = test::fly(manoeuvre, map_);
    demands_.required_clearance_m = 10.0;
    demands_.ceiling_height_m = 120.0;
    demands_.goal_radius_m = 60.0;
    demands_.start_radius_m = 1.0;
    demands_.via_radius_m = 250.0;
  }
  BruteForceVerdict judged(const std::vector<geo::MapPoint>& via = {}) const {
    const auto place = [](const flight::FlightState& s) {
      return flight::Waypoint{s.x_m, s.y_m, s.altitude_m};
    };
    return judge_by_brute_force(map_, flight_, place(flight_.states.front()), via,
                                place(flight_.states.back()), test::test_limits(), demands_, 0.5);
  }

  map::Map map_;
  flight::Trajectory flight_;
  verification::Demands demands_;
};

TEST_F(BruteForce, MeasuresWhatGeometrySays) {
  map::Obstacle mast;
  mast.point = {3060.0, 2000.0};
  mast.radius_m = 20.0;
  mast.top_m = 190.0;
  map_.obstacles = {mast};
  map::OverheadLine line;
  line.supports = {{{2500.0, 2500.0}, 30.0}, {{3500.0, 2500.0}, 30.0}};
  map_.overhead_lines = {line};
  map::Area area;
  area.floor.value_m = 190.0;
  area.ceiling.value_m = 500.0;
  area.polygons = {{{{2900, 3000}, {2970, 3000}, {2970, 3100}, {2900, 3100}, {2900, 3000}}, {}}};
  map_.areas = {area};
  const BruteForceVerdict verdict = judged({{3240.0, 2000.0}, {3000.0, 3000.0}});
  EXPECT_TRUE(verdict.accepts()) << ::testing::PrintToString(verdict.broken);
  EXPECT_NEAR(verdict.distances.ground_m, 50.0, 1e-6);
  EXPECT_NEAR(verdict.distances.obstacle_m, 40.0, 1e-3);
  EXPECT_NEAR(verdict.distances.wire_m, 20.0, 1e-6);
  EXPECT_NEAR(verdict.distances.area_m, 50.0, 1e-6);  // 30 m aside, 40 m below
  EXPECT_NEAR(verdict.distances.spare_m(10.0), 10.0, 1e-6);
}

TEST_F(BruteForce, RefusesWhatIsPlainlyWrong) {
  EXPECT_THAT(judged({{3300.0, 2000.0}}).broken, ElementsAre("via"));
  EXPECT_THAT(judged({{3000.0, 3000.0}, {3000.0, 1500.0}}).broken, ElementsAre("via"));
  flight_.states[300].bank_rad = 0.6;
  EXPECT_THAT(judged().broken, ElementsAre("bank", "kinematics"));
  flight_.states[300].bank_rad = 0.0;
  flight_.states[300].x_m += 1.0;
  EXPECT_THAT(judged().broken, ElementsAre("kinematics"));
  flight_.states[300].x_m -= 1.0;
  map::Area area;
  area.floor.value_m = 0.0;
  area.ceiling.value_m = 151.0;
  area.polygons = {{{{2990, 2000}, {3010, 2000}, {3010, 2002}, {2990, 2002}, {2990, 2000}}, {}}};
  map_.areas = {area};
  EXPECT_THAT(judged().broken, ElementsAre("no_fly_area"));
  map_.areas.clear();
  demands_.required_clearance_m = 50.1;
  EXPECT_THAT(judged().broken, ElementsAre("clearance"));
}

}  // namespace
}  // namespace hedgehop::evaluation
