#include "global_planning/bit_star_search.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <limits>

#include "global_planning/planning_case.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::global_planning {
namespace {

using flight::Waypoint;
using test::PlanningCase;
using test::shipped_global_options;

using test::kWeights;

const BitStarSearch::ShouldStop kNeverStop = [] { return false; };
const BitStarSearch::OnEvent kSilent = [] {};

struct Switches {
  const char* name;
  SearchHeuristic heuristic;
  SamplingRegion sampler;
  TurnRule turn_rule;
};

// Each choice of each switch, and the paper's together.
class BitStarSearchTest : public testing::TestWithParam<Switches> {
 protected:
  static GlobalOptions options() {
    GlobalOptions result = shipped_global_options();
    result.batch_size = 500;
    result.heuristic = GetParam().heuristic;
    result.sampler = GetParam().sampler;
    result.turn_rule = GetParam().turn_rule;
    return result;
  }
};

INSTANTIATE_TEST_SUITE_P(
    Switches, BitStarSearchTest,
    testing::Values(Switches{"Labels", SearchHeuristic::kLength, SamplingRegion::kEllipse,
                             TurnRule::kHeadingLabels},
                    Switches{"Paper", SearchHeuristic::kLength, SamplingRegion::kEllipse,
                             TurnRule::kInsertion},
                    Switches{"FieldsAndLabels", SearchHeuristic::kCostField,
                             SamplingRegion::kLevelSet, TurnRule::kHeadingLabels},
                    Switches{"FieldWithoutTurns", SearchHeuristic::kCostField,
                             SamplingRegion::kEllipse, TurnRule::kNone}),
    [](const auto& given) { return std::string(given.param.name); });

TEST_P(BitStarSearchTest, SpendsItsBudgetExactlyAndNeverMore) {
  const std::uint64_t seed = test::fresh_seed();
  const PlanningCase in(test::make_fractal_map(seed, 200, 30.0, 3000.0, 400.0), kWeights);
  const FlightEnvelope envelope(in.costs, options(), in.above(800, 800), in.above(5000, 5200));
  for (const std::int64_t budget : {1, 7, 499, 500, 1000, 1777, 20000}) {
    BitStarSearch search(envelope, options(), seed);
    search.run(budget, kNeverStop, kSilent);
    EXPECT_EQ(search.counts().work_units, budget);
  }
}

TEST_P(BitStarSearchTest, ADividedBudgetGivesTheSameRouteAsTheWhole) {
  const std::uint64_t seed = test::fresh_seed();
  const PlanningCase in(test::make_fractal_map(seed, 200, 30.0, 3000.0, 400.0), kWeights);
  const FlightEnvelope envelope(in.costs, options(), in.above(800, 800), in.above(5000, 5200));
  BitStarSearch whole(envelope, options(), seed);
  whole.run(15000, kNeverStop, kSilent);
  BitStarSearch divided(envelope, options(), seed);
  for (std::int64_t budget = 611; budget < 15000; budget += 611) {
    divided.run(budget, kNeverStop, kSilent);
  }
  divided.run(15000, kNeverStop, kSilent);
  EXPECT_EQ(whole.best_route(), divided.best_route());
  EXPECT_EQ(whole.best_cost_m(), divided.best_cost_m());
  EXPECT_EQ(whole.counts().samples, divided.counts().samples);
}

TEST_P(BitStarSearchTest, CostsFallWithWorkAndNeverBelowTheBound) {
  const std::uint64_t seed = test::fresh_seed();
  const PlanningCase in(test::make_fractal_map(seed, 200, 30.0, 3000.0, 400.0), kWeights);
  const FlightEnvelope envelope(in.costs, options(), in.above(800, 800), in.above(5000, 5200));
  BitStarSearch search(envelope, options(), seed);
  double before_m = std::numeric_limits<double>::infinity();
  search.run(40000, kNeverStop, [&] {
    EXPECT_LE(search.best_cost_m(), before_m);
    before_m = search.best_cost_m();
  });
  ASSERT_TRUE(search.has_route());
  EXPECT_LE(search.lower_bound_m(), search.best_cost_m());
  if (GetParam().heuristic == SearchHeuristic::kLength) {
    EXPECT_LE(search.lower_bound_m(), flight::length_m(search.best_route()));
  }
  EXPECT_LE(flight::length_m(search.best_route()), search.best_cost_m());
  const double dx_m = 5000.0 - 800.0;
  const double dy_m = 5200.0 - 800.0;
  EXPECT_GE(search.lower_bound_m(), std::sqrt(dx_m * dx_m + dy_m * dy_m) * (1.0 - 1e-6));
}

TEST_P(BitStarSearchTest, EveryEdgeOfTheTreeKeepsBandClimbAndTurns) {
  const std::uint64_t seed = test::fresh_seed();
  const PlanningCase in(test::make_fractal_map(seed, 200, 30.0, 2000.0, 500.0), kWeights);
  const FlightEnvelope envelope(in.costs, options(), in.above(800, 800), in.above(5000, 5200));
  BitStarSearch search(envelope, options(), seed);
  search.run(30000, kNeverStop, kSilent);
  int edges = 0;
  int corners = 0;
  for (std::size_t i = 0; i < search.state_count(); ++i) {
    const int parent = search.parent(i);
    if (parent < 0) {
      continue;
    }
    const Waypoint to = search.state(i);
    const Waypoint from = search.state(static_cast<std::size_t>(parent));
    EXPECT_TRUE(envelope.contains(to));
    EXPECT_LT(envelope.leg_cost_m(from, to), std::numeric_limits<double>::infinity());
    ++edges;
    const int grandparent = search.parent(static_cast<std::size_t>(parent));
    if (grandparent >= 0 && GetParam().turn_rule != TurnRule::kNone) {
      const Waypoint before = search.state(static_cast<std::size_t>(grandparent));
      EXPECT_TRUE(envelope.is_turn_allowed(from.x_m - before.x_m, from.y_m - before.y_m,
                                           to.x_m - from.x_m, to.y_m - from.y_m));
      ++corners;
    }
  }
  EXPECT_GT(edges, 100);
  EXPECT_GT(corners, GetParam().turn_rule == TurnRule::kNone ? -1 : 50);
}

TEST(BitStarSearchSwitches, TheLevelSetHoldsEveryStateOfACheaperRouteAndLittleElse) {
  // GIVEN a plain where flying over the northern half costs ten times as much
  map::Map map = test::make_map(200, 200, 30.0, [](double, double) { return 100.0; });
  for (int row = 110; row < 200; ++row) {
    for (int column = 0; column < 200; ++column) {
      map.visibility.at(column, row) = test::stored_visibility(0.6);
    }
  }
  test::finish_map(map);
  const PlanningCase in(std::move(map), kWeights);
  GlobalOptions options = shipped_global_options();
  options.batch_size = 500;
  options.sampler = SamplingRegion::kLevelSet;
  const FlightEnvelope envelope(in.costs, options, in.above(800, 2500), in.above(5200, 2500));
  BitStarSearch search(envelope, options, 1);
  search.run(3000, kNeverStop, kSilent);
  ASSERT_TRUE(search.has_route());
  const std::size_t before = search.state_count();
  const double level_m = search.best_cost_m();
  search.run(20000, kNeverStop, kSilent);
  ASSERT_GT(search.state_count(), before + 500);
  int northern = 0;
  for (std::size_t i = before + 500; i < search.state_count(); ++i) {  // later batches
    const Waypoint at = search.state(i);
    // Every metre costs at least 1.
    EXPECT_LE(
        std::hypot(at.x_m - 800.0, at.y_m - 2500.0) + std::hypot(at.x_m - 5200.0, at.y_m - 2500.0),
        level_m * (1.0 + 1e-3));
    northern += at.y_m > 3500.0 ? 1 : 0;
  }
  EXPECT_EQ(northern, 0) << "200 m there and back through the dear half costs more than is saved";
}

TEST(BitStarSearchSwitches, WithTheCostFieldItsBoundIsTheStrictOneAndMoreThanTheLength) {
  const std::uint64_t seed = test::fresh_seed();
  const PlanningCase in(test::make_fractal_map(seed, 200, 30.0, 2000.0, 60.0), kWeights);
  GlobalOptions options = shipped_global_options();
  options.batch_size = 500;
  options.heuristic = SearchHeuristic::kCostField;
  const FlightEnvelope envelope(in.costs, options, in.above(800, 800), in.above(5000, 5200));
  BitStarSearch search(envelope, options, seed);
  search.run(8000, kNeverStop, kSilent);
  const CostBound bound(envelope, envelope.goal().point(), envelope.start().point());
  const double strict_m = bound.cost_m(envelope.start().point());
  EXPECT_GE(search.lower_bound_m(), 0.999 * flight::length_m({envelope.start(), envelope.goal()}));
  EXPECT_GE(search.lower_bound_m(), strict_m * (1.0 - 1e-6));
  EXPECT_GE(search.best_cost_m(), search.lower_bound_m());
}

TEST_P(BitStarSearchTest, AStopRequestEndsItWithinAFewHundredUnits) {
  const PlanningCase in(test::make_fractal_map(3, 200, 30.0, 3000.0, 400.0), kWeights);
  const FlightEnvelope envelope(in.costs, options(), in.above(800, 800), in.above(5000, 5200));
  BitStarSearch search(envelope, options(), 1);
  std::int64_t asked_at = -1;
  search.run(
      1000000,
      [&] {
        if (search.counts().work_units > 5000 && asked_at < 0) {
          asked_at = search.counts().work_units;
        }
        return asked_at >= 0;
      },
      kSilent);
  // Asked every 64 queue entries and after each batch, so well within two batches of 500 states.
  EXPECT_LE(asked_at, 6100);
  EXPECT_EQ(search.counts().work_units, asked_at);
}

TEST_P(BitStarSearchTest, StoppingAnywhereAndGoingOnGivesTheSameRoute) {
  const std::uint64_t seed = test::fresh_seed();
  const PlanningCase in(test::make_fractal_map(seed, 200, 30.0, 3000.0, 400.0), kWeights);
  const FlightEnvelope envelope(in.costs, options(), in.above(800, 800), in.above(5000, 5200));
  BitStarSearch whole(envelope, options(), seed);
  whole.run(20000, kNeverStop, kSilent);
  BitStarSearch stopped(envelope, options(), seed);
  RandomSource random(seed);
  int runs = 0;
  for (; stopped.counts().work_units < whole.counts().work_units; ++runs) {
    // Most often soon, so that it stops in every part of the preparation of a batch.
    std::uint64_t asks = 1 + random.next() % 8;
    stopped.run(
        20000, [&] { return asks-- == 0; }, kSilent);
  }
  EXPECT_GT(runs, 20);
  EXPECT_EQ(whole.best_route(), stopped.best_route());
  EXPECT_EQ(whole.best_cost_m(), stopped.best_cost_m());
  EXPECT_EQ(whole.counts().samples, stopped.counts().samples);
  EXPECT_EQ(whole.counts().batches, stopped.counts().batches);
}

TEST(BitStarSearchStop, IsAskedManyTimesWhileABatchIsJoinedToTheGraph) {
  const PlanningCase in(test::make_fractal_map(3, 200, 30.0, 3000.0, 100.0), kWeights);
  GlobalOptions options = shipped_global_options();
  options.turn_rule = TurnRule::kInsertion;
  options.batch_size = 4000;
  const FlightEnvelope envelope(in.costs, options, in.above(800, 800), in.above(5000, 5200));
  BitStarSearch search(envelope, options, 1);
  std::int64_t asked = 0;  // of a batch that was begun, before it is searched
  std::int64_t begun = 0;
  std::int64_t searched = 0;
  search.run(
      100000,
      [&] {
        if (search.counts().batches > begun) {
          begun = search.counts().batches;
          asked = 0;
        }
        ++asked;
        return false;
      },
      [&] {
        if (search.counts().batches > searched) {
          searched = search.counts().batches;
          if (searched > 1) {
            // Joining 4000 states takes some ten milliseconds; one question for 64 of them.
            EXPECT_GE(asked, 50);
          }
        }
      });
  EXPECT_GE(searched, 3);
}

TEST(BitStarSearchLabels, TheyFindAWayThatOneParentForEachStateWouldBlock) {
  // A level plain with three states. The cheap way to C comes from the south and cannot turn east
  // to the goal; the dearer way, through D in the west, can.
  const PlanningCase in(test::make_map(200, 200, 30.0, [](double, double) { return 0.0; }),
                        risk::CostWeights{});
  GlobalOptions options = shipped_global_options();
  options.turn_radius_m = 0.0;
  options.turn_angle_max_rad = 0.9;  // 52 deg
  options.batch_size = 1;
  options.radius_max_m = 1200.0;
  options.radius_factor = 100.0;
  const Waypoint start = in.above(2000.0, 2000.0, 40.0);
  const Waypoint goal = in.above(4000.0, 3000.0, 40.0);
  for (const bool has_labels : {false, true}) {
    options.turn_rule = has_labels ? TurnRule::kHeadingLabels : TurnRule::kInsertion;
    const FlightEnvelope envelope(in.costs, options, start, goal);
    BitStarSearch search(envelope, options, 1);
    search.add_state(in.above(2400.0, 2500.0, 40.0));  // on the way that curves
    search.add_state(in.above(3000.0, 2900.0, 40.0));
    search.run(200, kNeverStop, kSilent);
    EXPECT_TRUE(search.has_route()) << has_labels;
  }
}

}  // namespace
}  // namespace hedgehop::global_planning
