#include "evaluation/tuning.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <oneapi/tbb/global_control.h>

#include "base/errors.hpp"
#include "base/shipped_config.hpp"
#include "support/fresh_seed.hpp"
#include "support/shipped_options.hpp"
#include "support/test_map.hpp"
#include "support/utm_map.hpp"

namespace hedgehop::evaluation {
namespace {

TuneOptions options_for(const std::vector<std::string>& parameters, std::int64_t evaluations) {
  TuneOptions options = test::shipped_evaluation("tune", read_tune_options);
  options.search.evaluations_max = evaluations;
  options.parameters.clear();
  for (const std::string& text : parameters) {
    options.parameters.push_back(tuned_parameter(text));
  }
  return options;
}

// Flights that are made up: `change` of the cost that each would have, by the config.
using Change = std::function<double(const planning::PlanningConfig& config, std::int64_t problem)>;
FlyProblems made_up(
    const Change& change,
    const std::function<void(TuneFlight&, double)>& mishap = [](TuneFlight&, double) {}) {
  return [=](const planning::PlanningConfig& config, const Observer&) {
    std::vector<TuneFlight> flights(10);
    for (std::size_t i = 0; i < flights.size(); ++i) {
      TuneFlight& flight = flights[i];
      flight.map = i / 5;
      flight.problem = static_cast<std::int64_t>(i);
      flight.is_reached = flight.is_verified = true;
      flight.clearance_m = 12.0;
      flight.speed_mps = 40.0;
      flight.cost_m = 1000.0 * static_cast<double>(i + 1) * (1.0 + change(config, flight.problem));
      flight.measures.length_m = 100.0;
      flight.measures.mean_height_m = 50.0;
      mishap(flight, config.local.look_ahead_m);
    }
    return flights;
  };
}

// Least at a look-ahead of 600 m: a tenth below what 300 m costs.
double cheapest_at_600(const planning::PlanningConfig& config, std::int64_t /*problem*/) {
  const double off = std::log(config.local.look_ahead_m / 600.0) / std::log(2.0);
  return 0.1 * (off * off - 1.0);
}

class Tune : public ::testing::Test {
 protected:
  TuneResult tuned(const FlyProblems& training, const FlyProblems& held_out) {
    TuneResult result = tune(config_, options_, training, 7, 2, observer_);
    check_held_out(config_, options_, held_out, 7, 2, result, observer_);
    return result;
  }
  SilentObserver observer_;
  planning::PlanningConfig config_ = test::shipped_planning();
  TuneOptions options_ = options_for({"local.look_ahead_m=100:1200:log"}, 60);
};

TEST_F(Tune, FindsTheValueThatMakesFlightsCheapestAndSaysHowMuch) {
  const FlyProblems flights = made_up(cheapest_at_600);
  const TuneResult result = tuned(flights, flights);
  ASSERT_EQ(result.parameters.size(), 1U);
  EXPECT_EQ(result.parameters[0].given, 300.0);
  EXPECT_NEAR(result.parameters[0].tuned, 600.0, 15.0);
  for (const auto& comparison : {*result.training, *result.held_out}) {
    EXPECT_EQ(comparison.pairs, 10);
    EXPECT_NEAR(comparison.flight_cost->change, -0.1, 1e-3);
    EXPECT_NEAR(comparison.cost->change, -0.1, 1e-3);
    ASSERT_EQ(comparison.by_map.size(), 2U);
    EXPECT_EQ(comparison.by_map[1]->pairs, 5);
    EXPECT_EQ(comparison.length->change, 0.0);
    EXPECT_EQ(comparison.tuned.reached, 10);
  }
  EXPECT_TRUE(result.is_better) << result.verdict;
  EXPECT_LE(result.evaluations, 60);
}

TEST_F(Tune, EachFlightCountsTheSameHoweverLongItIs) {
  // The last and longest flight wants 150 m, the nine others 600 m.
  const auto change = [](const planning::PlanningConfig& config, std::int64_t problem) {
    const double best_m = problem == 9 ? 150.0 : 600.0;
    return 0.1 * std::abs(std::log(config.local.look_ahead_m / best_m));
  };
  const TuneResult result = tuned(made_up(change), made_up(change));
  EXPECT_NEAR(result.parameters[0].tuned, 600.0, 15.0);
}

TEST_F(Tune, KeepsTheGivenWhereHeldOutFlightsDoNotGain) {
  const auto scattered = [](const planning::PlanningConfig& config, std::int64_t problem) {
    return config.local.look_ahead_m == 300.0 ? 0.0 : problem % 2 == 0 ? -0.05 : 0.05;
  };
  const TuneResult result = tuned(made_up(cheapest_at_600), made_up(scattered));
  EXPECT_LT(result.training->flight_cost->high, 0.0);
  EXPECT_FALSE(result.is_better);
  EXPECT_TRUE(result.verdict.starts_with("keep the given")) << result.verdict;
}

TEST_F(Tune, NothingCheapBuysAFlightThatIsUnsafe) {
  struct Mishap {
    const char* name;
    std::function<void(TuneFlight&)> happen;
  };
  // One of the ten flights, beyond 450 m.
  for (const Mishap& mishap :
       {Mishap{"not reached",
               [](TuneFlight& flight) { flight = {0, 3, false, false, 0.0, 0.0, 0.0, {}}; }},
        Mishap{"collides",
               [](TuneFlight& flight) { flight.is_verified = false, flight.clearance_m = -1.0; }},
        Mishap{"slowed", [](TuneFlight& flight) { flight.speed_mps = 30.0; }}}) {
    SCOPED_TRACE(mishap.name);
    const FlyProblems flights =
        made_up(cheapest_at_600, [&](TuneFlight& flight, double look_ahead_m) {
          if (flight.problem == 3 && look_ahead_m > 450.0) {
            mishap.happen(flight);
          }
        });
    const TuneResult result = tuned(flights, flights);
    EXPECT_LE(result.parameters[0].tuned, 450.0);
    EXPECT_GT(result.parameters[0].tuned, 400.0);
    EXPECT_TRUE(result.is_better);
    // Where only held-out flights meet it, it is not taken.
    const TuneResult refused = tuned(made_up(cheapest_at_600), flights);
    EXPECT_FALSE(refused.is_better);
    EXPECT_NE(refused.verdict.find("less safe"), std::string::npos) << refused.verdict;
  }
}

TEST_F(Tune, FlightsThatTheGivenParametersDoNotFlyAskForNothing) {
  const FlyProblems flights = made_up(cheapest_at_600, [](TuneFlight& flight, double) {
    if (flight.problem < 9) {
      flight.is_reached = flight.is_verified = false;
    }
  });
  const TuneResult result = tuned(flights, flights);
  EXPECT_NEAR(result.parameters[0].tuned, 600.0, 15.0);
  EXPECT_EQ(result.held_out->pairs, 1);
  EXPECT_EQ(result.held_out->given.reached, 1);
  const FlyProblems none =
      made_up(cheapest_at_600, [](TuneFlight& flight, double) { flight.is_verified = false; });
  EXPECT_THROW(tune(config_, options_, none, 7, 2, observer_), DataError);
}

TEST_F(Tune, LeavesTheBestSoFarWhenItIsStopped) {
  class Stopping final : public Observer {
   public:
    void progress(std::string_view, double done, double) override { done_ = done; }
    void note(std::string_view) override {}
    [[nodiscard]] bool stop_requested() const override { return done_ >= 4.0; }
    double done_ = 0.0;
  } stopping;
  TuneResult result = tune(config_, options_, made_up(cheapest_at_600), 7, 2, stopping);
  EXPECT_TRUE(result.is_stopped);
  EXPECT_EQ(result.evaluations, 4);
  EXPECT_FALSE(result.is_better) << "not checked yet";
  EXPECT_LE(result.training->flight_cost->change, 0.0);
  const auto json = nlohmann::json::parse(tune_result_json(result, options_, {7, {}, {}, "f"}));
  EXPECT_EQ(json.at("is_stopped"), true);
  EXPECT_TRUE(json.at("held_out").is_null());
}

TEST_F(Tune, RefusesWhatTheFlightsAreMeasuredByAndWhatCannotBe) {
  const FlyProblems flights = made_up(cheapest_at_600);
  for (const char* text :
       {"weights.visibility=1:50", "global.lateral_margin_m=1:50", "local.bank_weight_1prad=0.5:2",
        "verification.ceiling_height_m=100:200", "local.look_ahead_m=400:900",
        "local.look_ahead_m=-100:900", "local.passes=1:3", "local.no_such_key=0:1",
        "local.compare_with_following=0:1"}) {
    SCOPED_TRACE(text);
    EXPECT_THROW(tune(config_, options_for({text}, 10), flights, 7, 2, observer_), ConfigError);
  }
}

TEST_F(Tune, TakesTheParametersOfTheModeThatFlies) {
  TuneOptions options = test::shipped_evaluation("tune", read_tune_options);
  options.search.evaluations_max = 1;
  const auto keys_of = [&](const char* mode) {
    std::string keys;
    const auto config = test::shipped_planning({std::string("local.mode=") + mode});
    for (const auto& parameter :
         tune(config, options, made_up(cheapest_at_600), 7, 2, observer_).parameters) {
      keys += parameter.range.key + " ";
    }
    return keys;
  };
  EXPECT_EQ(keys_of("tvfh").find("local.rollout."), std::string::npos);
  EXPECT_NE(keys_of("tvfh").find("polar_offset"), std::string::npos);
  EXPECT_NE(keys_of("rollout").find("local.rollout.horizon_s"), std::string::npos);
  EXPECT_EQ(keys_of("rollout").find("polar_offset"), std::string::npos);
}

TEST_F(Tune, WhatItWritesLiesOverTheShippedConfig) {
  options_ = options_for({"local.look_ahead_m=100:1200:log", "local.weights.visibility=0.1:5",
                          "local.window_m=300:600", "local.weights.climb=0:1"},
                         40);
  const FlyProblems flights = made_up(cheapest_at_600);
  const TuneResult result = tuned(flights, flights);
  const std::string text = tuned_config(result);
  const planning::PlanningConfig over = planning::read_planning_config(
      overlay_config(planning::effective_planning_config("", {}), "shipped", text, "tuned"),
      "both");
  EXPECT_EQ(over.local.look_ahead_m, result.parameters[0].tuned);
  EXPECT_EQ(over.local.visibility_weight, result.parameters[1].tuned);
  EXPECT_EQ(over.local.window_m, result.parameters[2].tuned);
  EXPECT_EQ(over.local.weights.climb, result.parameters[3].tuned);
  EXPECT_NE(text.find(result.verdict), std::string::npos);
  EXPECT_EQ(over.local.corridor_m, config_.local.corridor_m);
}

// 9 x 6 km of level ground with a lane that is seen; straight routes lead along its northern edge,
// 40 m inside.
class Lane : public ::testing::Test {
 protected:
  Lane() {
    test::place_in_utm(map_);
    for (int row = 0; row < map_.geometry.rows; ++row) {
      for (int column = 0; column < map_.geometry.columns; ++column) {
        const double y_m = map_.geometry.centre({column, row}).y_m - test::kUtmSouth_m;
        const double in_lane_m = std::fmod(y_m, 1200.0);
        map_.visibility.at(column, row) =
            test::stored_visibility(in_lane_m > 600.0 && in_lane_m < 840.0 ? 0.8 : 0.0);
      }
    }
    test::finish_map(map_);
  }
  [[nodiscard]] static DrawnRoute route(int lane) {
    DrawnRoute route;
    route.problem = lane;
    for (double x_m = 1500.0; x_m <= 7500.0; x_m += 50.0) {
      route.guide.push_back(
          {test::kUtmWest_m + x_m, test::kUtmSouth_m + 800.0 + 1200.0 * lane, 240.0});
    }
    route.start = route.guide.front();
    route.goal = route.guide.back();
    return route;
  }
  map::Map map_ = test::make_map(300, 200, 30.0, [](double, double) { return 200.0; });
};

TEST_F(Lane, AWeightThatIsTooSmallToLeaveItIsRaisedWhateverTheThreads) {
  const auto config = test::shipped_planning({"local.weights.visibility=0.2"});
  const TuneOptions options = options_for({"local.weights.visibility=0.05:5:log"}, 12);
  const risk::CostModel costs = planning::cost_model(map_, config);
  const auto run = [&](std::size_t threads) {
    const oneapi::tbb::global_control control(oneapi::tbb::global_control::max_allowed_parallelism,
                                              threads);
    SilentObserver observer;
    TuneResult result =
        tune(config, options, flights_of({{&costs, {route(1), route(2)}}}), 7, 1, observer);
    check_held_out(config, options, flights_of({{&costs, {route(0), route(3)}}}), 7, 1, result,
                   observer);
    return result;
  };
  const TuneResult result = run(1);
  EXPECT_GT(result.parameters[0].tuned, 0.4);
  // In the lane a metre costs 1 + 25 * 0.64 = 17 times as much as beside it.
  EXPECT_LT(result.training->flight_cost->change, -0.2);
  EXPECT_LT(result.held_out->visibility->change, -0.2);
  EXPECT_TRUE(result.is_better) << result.verdict;
  EXPECT_EQ(result.held_out->tuned.reached, 2);
  EXPECT_EQ(result.held_out->tuned.not_verified, 0);
  const TuneRecord record{7, {map_.hash.hex()}, {"lane"}, "tuned.yaml"};
  EXPECT_EQ(tune_result_json(run(2), options, record), tune_result_json(result, options, record));
}

TEST(TunedParameter, IsReadFromTheCommandLine) {
  const TuneOptions::Parameter parameter = tuned_parameter("local.look_ahead_m=1e2:900.5:log");
  EXPECT_EQ(parameter.range.key, "local.look_ahead_m");
  EXPECT_EQ(parameter.range.low, 100.0);
  EXPECT_EQ(parameter.range.high, 900.5);
  EXPECT_TRUE(parameter.range.is_logarithmic);
  EXPECT_FALSE(tuned_parameter("a.b=-1:1").range.is_logarithmic);
  for (const char* wrong : {"a.b", "=1:2", "a.b=1", "a.b=1:", "a.b=:2", "a.b=2:1", "a.b=1:1",
                            "a.b=0:1:log", "a.b=1:2:lin", "a.b=1:nan", "a.b=1:2 "}) {
    EXPECT_THROW(tuned_parameter(wrong), UsageError) << wrong;
  }
}

TEST(ReadTuneOptions, RefusesNonsense) {
  const auto refused = [](const std::string& parameter) {
    ConfigReader reader = ConfigReader::from_text(
        "{flights: 2, held_out: 2, evaluations: 5, first_step_share: 0.1, bootstrap_draws: 100, "
        "parameters: [{" +
            parameter + "}]}",
        "bad");
    EXPECT_THROW(read_tune_options(reader), ConfigError) << parameter;
  };
  refused("key: a, mode: any, low: 2, high: 1, logarithmic: false");
  refused("key: a, mode: any, low: 0, high: 1, logarithmic: true");
  refused("key: a, mode: best, low: 1, high: 2, logarithmic: true");
  refused("key: a, mode: any, low: 1, high: 2");
}

}  // namespace
}  // namespace hedgehop::evaluation
