#include "evaluation/optimality_evaluation.hpp"

#include <atomic>
#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <limits>
#include <nlohmann/json.hpp>

#include "evaluation/contestants.hpp"
#include "support/fresh_seed.hpp"
#include "support/shipped_options.hpp"
#include "support/test_map.hpp"
#include "support/utm_map.hpp"

namespace hedgehop::evaluation {
namespace {

using flight::Waypoint;
using ::testing::HasSubstr;

// 12 x 9 km, flat at 200 m and unseen: eq. (1) is length plus 0.01 a metre of height off reference.
map::Map flat_map() {
  map::Map map = test::make_map(400, 300, 30.0, [](double, double) { return 200.0; });
  test::place_in_utm(map);
  test::finish_map(map);
  return map;
}

// The envelope begins below the reference height, so that a level flight is a route.
planning::PlanningConfig level_planning() {
  return test::shipped_planning({"global.envelope_floor_m=10"});
}

OptimalityConfig shipped() {
  return test::shipped_evaluation("optimality", read_optimality_config);
}

OptimalityOptions test_options(std::int64_t problems, std::vector<double> budgets_s) {
  OptimalityOptions options = shipped().options;
  options.problems = problems;
  options.drawing.distance_min_m = 5000.0;
  options.budgets_s = std::move(budgets_s);
  options.polish_s = 0.0;
  return options;
}

// A detour over one corner that makes the way `factor` times as long, at the altitude of the ends.
std::vector<Waypoint> detour(const OptimalityTask& task, double factor) {
  const double dx_m = task.goal.x_m - task.start.x_m;
  const double dy_m = task.goal.y_m - task.start.y_m;
  const double aside = 0.5 * std::sqrt(factor * factor - 1.0);
  const auto corner = [&](double side) {
    return Waypoint{0.5 * (task.start.x_m + task.goal.x_m) - side * aside * dy_m,
                    0.5 * (task.start.y_m + task.goal.y_m) + side * aside * dx_m,
                    task.start.altitude_m};
  };
  // On the side of the middle of the map.
  const bool is_left = dx_m * (5504500.0 - task.start.y_m) - dy_m * (606000.0 - task.start.x_m) > 0;
  return {task.start, corner(is_left ? 1.0 : -1.0), task.goal};
}

Contestant fake(const std::string& name, bool is_late,
                std::function<Attempt(const OptimalityTask&)> run) {
  return {
      name, "none", is_late,
      [run = std::move(run)](const OptimalityTask& task, const Observer&) { return run(task); }};
}

TEST(EvaluateOptimality, GivesTheRatiosThatTheRoutesHave) {
  const map::Map map = flat_map();
  SilentObserver observer;
  const std::vector<Contestant> contestants = {
      fake("ours", false,
           [](const OptimalityTask& task) {
             Attempt attempt;
             attempt.routes = {
                 {0.1, detour(task, 1.2)}, {0.6, detour(task, 1.1)}, {3.0, detour(task, 1.0)}};
             attempt.marks = {{0.5, 100}, {1.0, 300}};
             attempt.lower_bound_m = flight::length_m({task.start, task.goal});
             return attempt;
           }),
      fake("theirs", true, [](const OptimalityTask& task) {
        Attempt attempt;
        attempt.routes = {{0.7, detour(task, 1.3)}, {1.5, detour(task, 1.21)}};
        attempt.marks = {{0.75, 1000}, {1.5, 4000}};
        return attempt;
      })};
  const OptimalityResult result =
      evaluate_optimality(map, level_planning(), test_options(6, {0.5, 1.0}), test::fresh_seed(),
                          contestants, {}, observer);
  ASSERT_EQ(result.rows.size(), 4U);
  // Every metre costs the same, so costs go as lengths; the route told at 3 s is the best known.
  const OptimalityRow& ours_early = result.rows[0];
  EXPECT_EQ(ours_early.planner, "ours");
  EXPECT_EQ(ours_early.budget_s, 0.5);
  EXPECT_NEAR(ours_early.first_route_s_median, 0.1, 1e-12);
  EXPECT_NEAR(ours_early.first_route_over_best_median, 1.2, 1e-6);
  EXPECT_NEAR(ours_early.cost_over_best_median, 1.2, 1e-6);
  EXPECT_NEAR(ours_early.cost_over_best_p95, 1.2, 1e-6);
  EXPECT_NEAR(result.rows[1].cost_over_best_median, 1.1, 1e-6);
  EXPECT_EQ(ours_early.success, 1.0);
  EXPECT_NEAR(ours_early.edges_per_s, 200.0, 1e-9);
  EXPECT_NEAR(result.rows[1].edges_per_s, 300.0, 1e-9);
  EXPECT_EQ(ours_early.overshoot_s_max, 0.0);
  // Late planners are given what they had when they had stopped.
  EXPECT_NEAR(result.rows[2].cost_over_best_median, 1.3, 1e-6);
  EXPECT_NEAR(result.rows[2].overshoot_s_median, 0.25, 1e-12);
  EXPECT_NEAR(result.rows[3].cost_over_best_median, 1.21, 1e-6);
  EXPECT_NEAR(result.rows[3].overshoot_s_max, 0.5, 1e-12);
  for (const OptimalityProblem& problem : result.problems) {
    EXPECT_EQ(problem.best_known_by, "ours");
    // Flat ground: the reference height costs nothing, visibility is 0.
    EXPECT_NEAR(problem.best_known_m, problem.distance_m, 1e-6 * problem.distance_m);
    EXPECT_NEAR(problem.lower_bound_m, problem.distance_m, 1e-4);
    EXPECT_GE(problem.distance_m, 5000.0);
  }
  EXPECT_NEAR(result.rows[1].cost_over_bound_median, 1.1, 1e-6);
  // ours at 1 s against theirs at 0.5 s
  bool is_found = false;
  for (const CostRatio& ratio : result.ratios) {
    EXPECT_EQ(ratio.planner, "ours");
    if (ratio.budget_s == 1.0 && ratio.against_budget_s == 0.5) {
      is_found = true;
      EXPECT_NEAR(ratio.median, 1.1 / 1.3, 1e-6);
      EXPECT_EQ(ratio.problems, 6);
    }
  }
  EXPECT_TRUE(is_found);
}

TEST(EvaluateOptimality, CountsNoRouteThatDoesNotFlyOrDoesNotArrive) {
  const map::Map map = flat_map();
  SilentObserver observer;
  const auto with = [](const char* name, std::function<void(std::vector<Waypoint>&)> spoil) {
    return fake(name, false, [spoil = std::move(spoil)](const OptimalityTask& task) {
      Attempt attempt;
      std::vector<Waypoint> bad = detour(task, 1.0);
      spoil(bad);
      attempt.routes = {{0.1, detour(task, 1.05)}, {0.2, bad}};
      attempt.marks = {{0.5, 1}};
      return attempt;
    });
  };
  const std::vector<Contestant> contestants = {
      with("low", [](auto& route) { route[1].altitude_m = 201.0; }),
      with("steep",
           [](auto& route) {
             route[1] = {route[0].x_m + 1.0, route[0].y_m, 300.0};
           }),
      with("elsewhere", [](auto& route) { route.back().x_m += 1.0; }),
      with("nowhere", [](auto& route) { route.clear(); }),
      with("unknown", [](auto& route) { route[1].x_m = std::nan(""); })};
  const OptimalityResult result = evaluate_optimality(
      map, level_planning(), test_options(3, {0.5}), test::fresh_seed(), contestants, {}, observer);
  for (const OptimalityProblem& problem : result.problems) {
    for (const JudgedAttempt& attempt : problem.attempts) {
      EXPECT_EQ(attempt.refused_routes, 1);
      EXPECT_NEAR(attempt.costs_m[0], 1.05 * problem.distance_m, 1e-6 * problem.distance_m);
    }
  }
}

TEST(EvaluateOptimality, CountsMissesFailuresAndCausesOnce) {
  const map::Map map = flat_map();
  SilentObserver observer;
  int asked = 0;
  const std::vector<Contestant> contestants = {
      fake("moody", true, [&asked](const OptimalityTask& task) -> Attempt {
        Attempt attempt;
        switch (asked++) {
          case 0:
            throw std::runtime_error("broken \xff");
          case 1:
            attempt.no_route_cause = "climb_limit: too steep";
            attempt.marks = {{0.5, 10}};
            return attempt;
          case 2:
            attempt.failure = "aborted: Aborted";
            attempt.routes = {{0.1, detour(task, 1.0)}};
            return attempt;
          default:
            attempt.routes = {{0.7, detour(task, 1.0)}};  // after the budget, and it had stopped
            attempt.marks = {{0.6, 10}};
            return attempt;
        }
      })};
  const OptimalityResult result = evaluate_optimality(
      map, level_planning(), test_options(4, {0.5}), test::fresh_seed(), contestants, {}, observer);
  const OptimalityRow& row = result.rows.at(0);
  EXPECT_EQ(row.solved, 1);
  EXPECT_EQ(row.success, 0.25);
  EXPECT_EQ(row.failures, 2);
  EXPECT_EQ(row.no_route_causes, 1);
  EXPECT_TRUE(std::isnan(result.problems[0].best_known_m));
  EXPECT_FALSE(std::isnan(result.problems[3].best_known_m));

  const auto json =
      nlohmann::json::parse(optimality_result_json(result, {"a processor", "avx2", "1.0"}));
  EXPECT_EQ(json.at("rows").at(0).at("failures"), 2);
  EXPECT_EQ(json.at("seed"), result.seed);
  EXPECT_EQ(json.at("map_hash"), map.hash.hex());
  EXPECT_EQ(json.at("machine").at("simd"), "avx2");
  EXPECT_TRUE(json.at("problems").at(0).at("best_known_m").is_null());
  EXPECT_TRUE(json.at("problems").at(3).at("runs").at(0).at("cost_m").at(0).is_null());
  EXPECT_THAT(json.at("problems").at(0).at("runs").at(0).at("failure").get<std::string>(),
              HasSubstr("broken"));
}

TEST(EvaluateOptimality, BestKnownIsThePolishedRouteWhenThatIsCheaper) {
  const map::Map map = flat_map();
  SilentObserver observer;
  OptimalityOptions options = test_options(3, {0.5});
  options.polish_s = 1.0;
  const std::vector<Contestant> contestants = {fake("ours", false, [](const OptimalityTask& task) {
    Attempt attempt;
    attempt.routes = {{0.1, detour(task, 1.02)}};
    attempt.marks = {{0.5, 1}};
    return attempt;
  })};
  int polished = 0;
  const Polish polish = [&](const OptimalityTask& task,
                            const std::vector<std::vector<Waypoint>>& candidates, double seconds,
                            const Observer&) {
    EXPECT_EQ(candidates.size(), 1U);
    EXPECT_EQ(seconds, 1.0);
    ++polished;
    return detour(task, polished == 1 ? 1.05 : 1.0);
  };
  const OptimalityResult result = evaluate_optimality(
      map, level_planning(), options, test::fresh_seed(), contestants, polish, observer);
  EXPECT_EQ(result.problems[0].best_known_by, "ours");
  EXPECT_EQ(result.problems[1].best_known_by, "polish");
  EXPECT_NEAR(result.rows[0].cost_over_best_p95, 1.02, 1e-6);
}

TEST(EvaluateOptimality, NoRouteThatBreaksTheTurnRuleIsTheBestKnown) {
  const map::Map map = flat_map();
  SilentObserver observer;
  const auto attempt_with = [](std::vector<Waypoint> route) {
    Attempt attempt;
    attempt.routes = {{0.1, std::move(route)}};
    attempt.marks = {{0.2, 1}};
    return attempt;
  };
  const std::vector<Contestant> contestants = {
      // One turn of 2 acos(1 / 1.1) = 49 degrees.
      fake("gentle", false,
           [&](const OptimalityTask& task) { return attempt_with(detour(task, 1.1)); }),
      // Straight on but for a jog of 50 m aside and back in the middle: four right angles.
      fake("sharp", false, [&](const OptimalityTask& task) {
        const double length_m = flight::length_m({task.start, task.goal});
        const double east = (task.goal.x_m - task.start.x_m) / length_m;
        const double north = (task.goal.y_m - task.start.y_m) / length_m;
        const auto at = [&](double along_m, double aside_m) {
          return Waypoint{task.start.x_m + along_m * east - aside_m * north,
                          task.start.y_m + along_m * north + aside_m * east, task.start.altitude_m};
        };
        const double middle_m = 0.5 * length_m;
        return attempt_with({task.start, at(middle_m - 50.0, 0.0), at(middle_m - 50.0, 50.0),
                             at(middle_m + 50.0, 50.0), at(middle_m + 50.0, 0.0), task.goal});
      })};
  const OptimalityResult result = evaluate_optimality(
      map, level_planning(), test_options(2, {0.5}), test::fresh_seed(), contestants, {}, observer);
  for (const OptimalityProblem& problem : result.problems) {
    EXPECT_EQ(problem.best_known_by, "gentle");
    EXPECT_NEAR(problem.best_known_m, 1.1 * problem.distance_m, 0.01);
    EXPECT_NEAR(problem.attempts[1].costs_m[0], problem.distance_m + 100.0, 0.01);
  }
  EXPECT_EQ(result.rows[0].turns_kept, 1.0);
  EXPECT_EQ(result.rows[1].turns_kept, 0.0);
  EXPECT_EQ(result.rows[1].success, 1.0);
  EXPECT_LT(result.rows[1].cost_over_best_median, 1.0);
}

TEST(EvaluateOptimality, GivesTheSameProblemsForTheSameSeed) {
  const map::Map map = flat_map();
  SilentObserver observer;
  const std::uint64_t seed = test::fresh_seed();
  const auto run = [&](std::int64_t problems) {
    return evaluate_optimality(
        map, level_planning(), test_options(problems, {1.0}), seed,
        {fake("none", false, [](const OptimalityTask&) { return Attempt{}; })}, {}, observer);
  };
  const OptimalityResult few = run(2);
  const OptimalityResult many = run(5);
  for (std::size_t i = 0; i < few.problems.size(); ++i) {
    EXPECT_EQ(few.problems[i].from, many.problems[i].from);
    EXPECT_EQ(few.problems[i].to, many.problems[i].to);
  }
}

// A clock that goes on by itself: each reading is a millisecond later, whatever happens.
ProcessClock counting_clock() {
  return [readings = std::make_shared<std::atomic<int>>(0)] { return 0.001 * ++*readings; };
}

// ompl_prmstar is left out: its two threads race.
TEST(Contestants, GiveTheSameRoutesUnderTheSameReadings) {
  const map::Map map = flat_map();
  SilentObserver observer;
  const planning::PlanningConfig config = test::shipped_planning({"global.work_budget=20000"});
  const risk::CostModel costs = planning::cost_model(map, config);
  const std::uint64_t seed = test::fresh_seed();
  const auto run = [&] {
    const auto contestants =
        make_contestants({"recommended", "bitstar", "ompl_bitstar", "ompl_rrtstar", "dubins"},
                         costs, config, 30.0, counting_clock());
    return optimality_result_json(evaluate_optimality(map, config, test_options(1, {0.1, 0.2}),
                                                      seed, contestants, {}, observer),
                                  {});
  };
  EXPECT_EQ(run(), run());
}

TEST(Contestants, OnFlatGroundEachFindsTheStraightWay) {
  const map::Map map = flat_map();
  SilentObserver observer;
  const planning::PlanningConfig config = test::shipped_planning({"global.work_budget=20000"});
  const risk::CostModel costs = planning::cost_model(map, config);
  std::vector<std::string> names = contestant_names();
  const auto contestants = make_contestants(names, costs, config, 5.0, counting_clock());
  OptimalityOptions options = test_options(1, {0.4});
  options.polish_s = 0.1;
  const OptimalityResult result =
      evaluate_optimality(map, config, options, test::fresh_seed(), contestants,
                          make_polish(costs, config, counting_clock()), observer);
  ASSERT_EQ(result.rows.size(), names.size());
  for (std::size_t i = 0; i < names.size(); ++i) {
    EXPECT_EQ(result.rows[i].planner, names[i]);
    EXPECT_EQ(result.rows[i].failures, 0) << result.problems[0].attempts[i].failure;
  }
  // From reference height up to the floor of the envelope and down again: not much above straight.
  EXPECT_LT(result.problems[0].best_known_m, 1.15 * result.problems[0].distance_m);
  EXPECT_GE(result.problems[0].best_known_m, result.problems[0].distance_m);
  EXPECT_EQ(result.rows[0].success, 1.0);
  EXPECT_GT(result.rows[0].edges_per_s, 0.0);
}

TEST(Contestants, RefuseANameThatNoneHasAndOneThatStandsTwice) {
  const map::Map map = flat_map();
  const planning::PlanningConfig config = level_planning();
  const risk::CostModel costs = planning::cost_model(map, config);
  EXPECT_THROW(make_contestants({"bitstar", "ompl_magic"}, costs, config, 1.0, counting_clock()),
               UsageError);
  EXPECT_THROW(
      make_contestants({"bitstar", "dubins", "bitstar"}, costs, config, 1.0, counting_clock()),
      UsageError);
}

TEST(ReadOptimalityConfig, ReadsWhatShipsAndRefusesNonsense) {
  const OptimalityConfig config = shipped();
  EXPECT_EQ(config.options.drawing.distance_min_m, 15000.0);
  EXPECT_EQ(polish_s_of(config, {1.0, 40.0}), config.polish_max_s);
  EXPECT_EQ(polish_s_of(config, {0.5}), 0.5 * config.polish_share);
  const auto read = [](const std::string& budgets) {
    ConfigReader reader = ConfigReader::from_text(
        "{problems: 2, margin_m: 1, distance_min_m: 8, draws_max: 9, planners: [bitstar], "
        "polish_share: 1, polish_max_s: 1, overrun_s: 1, budgets_s: " +
            budgets + "}",
        "bad.yaml");
    return read_optimality_config(reader);
  };
  EXPECT_NO_THROW(read("[0.5, 1]"));
  EXPECT_THROW(read("[1, 0.5]"), ConfigError);
  EXPECT_THROW(read("[]"), ConfigError);
  EXPECT_THROW(read("[0, 1]"), ConfigError);
}

}  // namespace
}  // namespace hedgehop::evaluation
