#include "evaluation/random_evaluation.hpp"

#include <atomic>
#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <oneapi/tbb/global_control.h>

#include "support/fresh_seed.hpp"
#include "support/shipped_options.hpp"
#include "support/test_map.hpp"
#include "support/utm_map.hpp"

namespace hedgehop::evaluation {
namespace {

using ::testing::HasSubstr;

// 15 x 12 km in UTM zone 32, flat; the western half is seen by a fifth of its surroundings, the
// eastern by half.
map::Map two_halves() {
  map::Map map = test::make_map(500, 400, 30.0, [](double, double) { return 200.0; });
  test::place_in_utm(map);
  for (int row = 0; row < 400; ++row) {
    for (int column = 0; column < 500; ++column) {
      map.visibility.at(column, row) = test::stored_visibility(column < 250 ? 0.2 : 0.5);
    }
  }
  test::finish_map(map);
  return map;
}

RandomOptions test_options(std::int64_t problems) {
  RandomOptions options = test::shipped_evaluation("random", read_random_options);
  options.problems = problems;
  return options;
}

// A planner that flies 1000 m at a height above the ground: on the west side when asked to avoid
// being seen, on the east side otherwise.
std::variant<flight::Plan, flight::NoPlan> fake_plan(const map::Map& map,
                                                     const planning::PlanningConfig& config,
                                                     double height_m) {
  flight::Plan plan;
  plan.verdict.is_verified = true;
  plan.trajectory.step_s = 0.05;
  const bool is_hidden = config.weights.visibility > 0.0;
  for (int i = 0; i <= 500; ++i) {
    flight::FlightState state;
    state.time_s = 0.05 * i;
    state.x_m = map.geometry.west_m + (is_hidden ? 3000.0 : 10000.0);
    state.y_m = map.geometry.south_m + 3000.0 + 2.0 * i;
    state.surface_m = 200.0;
    state.terrain_m = 200.0;
    state.altitude_m = 200.0 + height_m;
    plan.trajectory.states.push_back(state);
  }
  return plan;
}

TEST(EvaluateRandom, ComparesBothRunsByTheSameHeightRule) {
  const map::Map map = two_halves();
  const planning::PlanningConfig config = test::shipped_planning();
  SilentObserver observer;
  // 50 m above the reference height: the default weights make a point that much more visible.
  const double height_m = map.reference_height_m + 50.0;
  const RandomResult result = evaluate_random(
      map, config, test_options(6), test::fresh_seed(),
      [&](const map::Map& on, const flight::PlanRequest&, const planning::PlanningConfig& with,
          Observer&) { return fake_plan(on, with, height_m); },
      {}, observer);
  EXPECT_EQ(result.verified, 6);
  EXPECT_EQ(result.baseline_verified, 6);
  EXPECT_EQ(result.compared, 6);
  // 0.2 against 0.5, the same factor for the height in both.
  EXPECT_NEAR(result.visibility_change, -0.6, 1e-4);
  EXPECT_NEAR(result.length_change, 0.0, 1e-12);
  ASSERT_GT(config.weights.visibility_per_height_1pm, 0.0);
  const double factor = 1.0 + 50.0 * config.weights.visibility_per_height_1pm;
  for (const ProblemResult& problem : result.problems) {
    EXPECT_NEAR(problem.with_weights.measures.visibility_m, 1000.0 * 0.2 * factor, 0.1);
    EXPECT_NEAR(problem.baseline.measures.visibility_m, 1000.0 * 0.5 * factor, 0.1);
    EXPECT_NEAR(problem.visibility_change, -0.6, 1e-4);
  }
}

TEST(EvaluateRandom, AsksTheBaselineForNothingButLength) {
  const map::Map map = two_halves();
  const planning::PlanningConfig config = test::shipped_planning();
  SilentObserver observer;
  std::atomic<int> with_weights{0};
  std::atomic<int> without{0};
  evaluate_random(
      map, config, test_options(4), test::fresh_seed(),
      [&](const map::Map& on, const flight::PlanRequest& request,
          const planning::PlanningConfig& with, Observer&) {
        EXPECT_FALSE(request.start.height_m.has_value());
        EXPECT_FALSE(request.goal.height_m.has_value());
        const risk::CostWeights& w = with.weights;
        const double sum = w.visibility + w.visibility_per_height_1pm + w.semantics + w.height_1pm;
        sum > 0.0 ? ++with_weights : ++without;
        // The text says what the numbers are.
        EXPECT_EQ(planning::read_planning_config(with.text, "text").weights.visibility,
                  w.visibility);
        return fake_plan(on, with, 20.0);
      },
      {}, observer);
  EXPECT_EQ(with_weights, 4);
  EXPECT_EQ(without, 4);
}

TEST(EvaluateRandom, CountsEachOutcomeOnceAndComparesOnlyWhatBothSolved) {
  const map::Map map = two_halves();
  const planning::PlanningConfig config = test::shipped_planning();
  SilentObserver observer;
  const std::uint64_t seed = test::fresh_seed() % 1000000;
  // The request's seed tells which problem it is.
  const RandomResult result = evaluate_random(
      map, config, test_options(6), seed,
      [&](const map::Map& on, const flight::PlanRequest& request,
          const planning::PlanningConfig& with,
          Observer&) -> std::variant<flight::Plan, flight::NoPlan> {
        const std::uint64_t index = request.seed - seed;
        const bool is_baseline = with.weights.visibility == 0.0;
        auto plan = std::get<flight::Plan>(fake_plan(on, with, 20.0));
        if (index == 1) {
          return flight::NoPlan{flight::NoPlanCause::kStartBelowEnvelope, std::nullopt, "low"};
        }
        if (index == 2) {
          return flight::NoPlan{flight::NoPlanCause::kBudgetExhausted, std::nullopt, "long"};
        }
        if (index == 3) {
          plan.verdict.is_verified = false;
          plan.verdict.violation_count = 7;
          plan.verdict.violations = {{"clearance", 1.0, {}, 3.0, 10.0}};
        }
        if (index == 4) {
          throw std::logic_error("broken");
        }
        if (index == 5 && is_baseline) {
          return flight::NoPlan{flight::NoPlanCause::kLocalPlannerStuck, std::nullopt, "stuck"};
        }
        return plan;
      },
      {}, observer);
  EXPECT_EQ(result.problems.size(), 6U);
  EXPECT_EQ(result.verified, 2);
  EXPECT_EQ(result.named_cause, 1);
  EXPECT_EQ(result.not_found, 1);
  EXPECT_EQ(result.not_verified, 1);
  EXPECT_EQ(result.errors, 1);
  EXPECT_EQ(result.baseline_verified, 1);
  EXPECT_EQ(result.compared, 1);
  EXPECT_NEAR(result.visibility_change, -0.6, 1e-4);
  EXPECT_TRUE(std::isnan(result.problems[5].visibility_change));
  EXPECT_THAT(result.problems[3].with_weights.explanation, HasSubstr("clearance"));
  EXPECT_THAT(result.problems[4].with_weights.explanation, HasSubstr("broken"));

  const auto json = nlohmann::json::parse(random_result_json(result));
  EXPECT_EQ(json.at("drawn"), 6);
  EXPECT_EQ(json.at("verified"), 2);
  EXPECT_EQ(json.at("named_cause"), 1);
  EXPECT_EQ(json.at("not_found"), 1);
  EXPECT_EQ(json.at("not_verified"), 1);
  EXPECT_EQ(json.at("errors"), 1);
  EXPECT_EQ(json.at("seed"), seed);
  EXPECT_EQ(json.at("rejected_draws"), result.rejected_near + result.rejected_unknown);
  EXPECT_TRUE(json.at("problems").at(5).at("visibility_change").is_null());
  EXPECT_FALSE(json.at("problems").at(2).at("with_weights").contains("length_m"));
}

TEST(EvaluateRandom, GivesTheSameBytesForAnyNumberOfThreads) {
  const map::Map map = two_halves();
  const planning::PlanningConfig config = test::shipped_planning();
  SilentObserver observer;
  const std::uint64_t seed = test::fresh_seed();
  const auto run = [&](std::size_t threads) {
    const oneapi::tbb::global_control control(oneapi::tbb::global_control::max_allowed_parallelism,
                                              threads);
    double reading_s = 0.0;
    return random_result_json(evaluate_random(
        map, config, test_options(8), seed,
        [](const map::Map& on, const flight::PlanRequest& request,
           const planning::PlanningConfig& with,
           Observer&) { return fake_plan(on, with, 20.0 + static_cast<double>(request.seed % 7)); },
        threads == 1 ? Clock([&] { return reading_s += 1.0; }) : Clock{}, observer));
  };
  const std::string alone = run(1);
  EXPECT_EQ(run(2), alone);
  EXPECT_EQ(run(5), alone);
}

TEST(EvaluateRandom, KeepsClockReadingsApart) {
  const map::Map map = two_halves();
  SilentObserver observer;
  const oneapi::tbb::global_control control(oneapi::tbb::global_control::max_allowed_parallelism,
                                            1);
  double reading_s = 0.0;
  const RandomResult result = evaluate_random(
      map, test::shipped_planning(), test_options(3), 7,
      [](const map::Map& on, const flight::PlanRequest&, const planning::PlanningConfig& with,
         Observer&) { return fake_plan(on, with, 20.0); },
      [&] { return reading_s += 2.5; }, observer);
  const auto timings = nlohmann::json::parse(random_timings_json(result));
  EXPECT_EQ(timings.at("with_weights_s"), 7.5);
  EXPECT_EQ(timings.at("baseline_s"), 7.5);
  EXPECT_EQ(random_result_json(result).find("clock"), std::string::npos);
}

class StoppingObserver final : public Observer {
 public:
  void progress(std::string_view, double, double) override {}
  void note(std::string_view) override {}
  [[nodiscard]] bool stop_requested() const override { return is_stopped.load(); }
  std::atomic<bool> is_stopped{false};
};

TEST(EvaluateRandom, KeepsTheProblemsThatWereFinishedWhenItIsStopped) {
  const map::Map map = two_halves();
  StoppingObserver observer;
  std::atomic<int> planned{0};
  const RandomResult result = evaluate_random(
      map, test::shipped_planning(), test_options(50), 7,
      [&](const map::Map& on, const flight::PlanRequest&, const planning::PlanningConfig& with,
          Observer&) {
        observer.is_stopped = ++planned > 60;  // of 100
        return fake_plan(on, with, 20.0);
      },
      {}, observer);
  EXPECT_TRUE(result.is_stopped);
  // At most 60 runs count, two for each problem.
  EXPECT_GE(result.problems.size(), 1U);
  EXPECT_LE(result.problems.size(), 30U);
  for (const ProblemResult& problem : result.problems) {
    EXPECT_EQ(problem.with_weights.outcome, Outcome::kVerified);
    EXPECT_EQ(problem.baseline.outcome, Outcome::kVerified);
  }
  EXPECT_EQ(result.verified, static_cast<std::int64_t>(result.problems.size()));
}

TEST(EvaluateRandom, EndsWhenAskedToAndPassesTheWishOn) {
  const map::Map map = two_halves();
  StoppingObserver observer;
  EXPECT_THROW(evaluate_random(
                   map, test::shipped_planning(), test_options(50), 7,
                   [&](const map::Map& on, const flight::PlanRequest&,
                       const planning::PlanningConfig& with, Observer& inner) {
                     EXPECT_FALSE(inner.stop_requested() && !observer.is_stopped);
                     observer.is_stopped = true;
                     EXPECT_TRUE(inner.stop_requested());
                     return fake_plan(on, with, 20.0);
                   },
                   {}, observer),
               Interrupted);
}

TEST(ReadRandomOptions, ReadsTheShippedConfigAsTheTaskSays) {
  const RandomOptions options = test_options(20);
  EXPECT_EQ(options.drawing.margin_m, 1500.0);
  EXPECT_EQ(options.drawing.distance_min_m, 8000.0);
}

TEST(ReadRandomOptions, RefusesAMisspeltKeyAndNonsense) {
  ConfigReader misspelt = ConfigReader::from_text(
      "{problems: 2, margin: 1, margin_m: 1, distance_min_m: 8, draws_max: 9, work_budget: 0, "
      "baseline_settings: []}",
      "bad.yaml");
  EXPECT_THROW(read_random_options(misspelt), ConfigError);
  ConfigReader negative = ConfigReader::from_text(
      "{problems: 2, margin_m: -1, distance_min_m: 8, draws_max: 9, work_budget: 0, "
      "baseline_settings: []}",
      "bad.yaml");
  EXPECT_THROW(read_random_options(negative), ConfigError);
}

}  // namespace
}  // namespace hedgehop::evaluation
