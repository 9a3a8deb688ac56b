#include "local_planning/rollout.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <numbers>
#include <optional>
#include <random>
#include <vector>

#include "local_planning/local_planning_setup.hpp"
#include "local_planning/vertical_pass.hpp"
#include "support/fresh_seed.hpp"
#include "support/test_map.hpp"

namespace hedgehop::local_planning {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kTube_m = 46.8;
constexpr double kSafetyHeight_m = 18.0;
constexpr ProfileOptions kProfile{true, 12.0, 0.75, 0.4, 0.8, 5.0};
constexpr RolloutOptions kOptions{12.0, 0.5, 120.0 * kPi / 180.0, 1.2, 4.0, 0.05};

DirectionWeights weights() { return {GoalCost::kQuadratic, 1.0, 0.0, 0.4, 0.15}; }

TEST(PackedGround, IsTheGreatestSurfaceWithinTheTubeOfAnywhereInTheCell) {
  std::mt19937_64 random(test::fresh_seed());
  for (const double cell_m : {30.0, 10.0, 5.0}) {
    map::Map map = test::make_map(40, 30, cell_m, [&](double, double) {
      return std::uniform_real_distribution<double>(-50.0, 900.0)(random);
    });
    map.surface_m.at(20, 11) = std::numeric_limits<float>::quiet_NaN();
    const risk::CostModel costs = test::test_costs(map);
    Surroundings surroundings(costs, 200.0, 45.0, 1.0, 1.0);
    surroundings.pack(kTube_m);
    const raster::GridGeometry& g = surroundings.geometry();
    const int reach = static_cast<int>(kTube_m / cell_m) + 2;
    int inner = 0;
    for (int row = reach; row + reach < g.rows; ++row) {
      for (int column = reach; column + reach < g.columns; ++column) {
        float greatest = -1e9F;
        for (int up = -reach; up <= reach; ++up) {
          for (int right = -reach; right <= reach; ++right) {
            const double dx = std::max(0.0, std::fabs(right) * cell_m - 0.5 * cell_m);
            const double dy = std::max(0.0, std::fabs(up) * cell_m - 0.5 * cell_m);
            if (std::hypot(dx, dy) <= kTube_m) {
              greatest = std::max(greatest, surroundings.surface_m().at(column + right, row + up));
            }
          }
        }
        const std::uint32_t word = surroundings.packed().at(column, row);
        const double packed_m =
            static_cast<double>(word >> PackedGround::kRiskBits) / PackedGround::kStepsPerMetre +
            static_cast<double>(PackedGround::kLowest_m);
        ASSERT_GE(packed_m, static_cast<double>(greatest) - 1e-6) << column << " " << row;
        ASSERT_LE(packed_m, static_cast<double>(greatest) + 1.0 / 64.0 + 1e-3);
        ASSERT_NEAR(static_cast<double>(word & PackedGround::kRiskMax) / PackedGround::kRiskMax *
                        surroundings.risk_max(),
                    static_cast<double>(surroundings.risk().at(column, row)),
                    0.51 * surroundings.risk_max() / PackedGround::kRiskMax);
        ++inner;
      }
    }
    EXPECT_GT(inner, 500);
  }
}

TEST(PackedGround, WhatIsSurelyAboveIsAboveTheSurfaceBeside) {
  std::mt19937_64 random(test::fresh_seed());
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (const double cell_m : {30.0, 20.0, 10.0, 5.0}) {
    const map::Map map =
        test::make_map(static_cast<int>(1000.0 / cell_m), static_cast<int>(1000.0 / cell_m), cell_m,
                       [&](double, double) { return uniform(0.0, 100.0); });
    const risk::CostModel costs = test::test_costs(map);
    const double disc_m = 24.0 + 0.5 * std::numbers::sqrt2 * cell_m;
    Surroundings surroundings(costs, 200.0, disc_m, 1.0, 1.0);
    surroundings.pack(std::sqrt(disc_m * disc_m + 144.0));
    int sure = 0;
    for (int i = 0; i < 20000; ++i) {
      const geo::MapPoint to{uniform(0.0, 1000.0), uniform(0.0, 1000.0)};
      const double way_m = uniform(0.0, 15.0);
      const double course_rad = uniform(-kPi, kPi);
      const geo::MapPoint from{to.x_m - way_m * std::cos(course_rad),
                               to.y_m - way_m * std::sin(course_rad)};
      const double margin_m = uniform(0.0, 8.0);
      const double altitude_m = uniform(60.0, 105.0);
      if (surroundings.is_surely_above(to, std::hypot(way_m, margin_m), altitude_m)) {
        ++sure;
        ASSERT_GT(altitude_m, highest_beside_m(surroundings.surface_m(), from, to, margin_m));
      }
    }
    EXPECT_GT(sure, 200);
    EXPECT_FALSE(surroundings.is_surely_above({500.0, 500.0}, 100.0, 1e4));
  }
}

class RolloutOverLevelGround : public ::testing::Test {
 protected:
  // Towards the east over ground at 0 m, at 40 m/s, from (x_m, 1500).
  RolloutChoice choose(const map::Map& map, double altitude_m, double x_m = 900.0,
                       double share = 1.0, double semantics_weight = 1.0, double before_rad = 0.0) {
    const risk::CostModel costs = test::test_costs(map);
    Surroundings surroundings(costs, 350.0, 45.0, semantics_weight, 0.0);
    surroundings.pack(kTube_m);
    const Guide guide({{0, 1500, 0}, {3000, 1500, 0}});
    Rollout rollout(surroundings, guide, model_, 300.0, kSafetyHeight_m, kProfile, kOptions,
                    weights(), 40.0, Kernel::kBest);
    const auto state = command_model::trimmed_state(x_m, 1500.0, altitude_m, 40.0, 0.0, 0.0);
    DirectionQuestion question{0.0, 0.0, 0.0, std::tan(-10.0 * kPi / 180.0), 0.18, share};
    const RolloutView view{
        question, {x_m, 0.0, 300.0, model_.vehicle().vertical_rates(40.0, altitude_m)}, 1e9};
    return rollout.choose(state, command_model::trigonometry_of(state), view, 0.0, before_rad);
  }

  command_model::CommandModel model_{test::shipped_vehicle()};
};

TEST_F(RolloutOverLevelGround, GoalDirectionIsTakenExactlyWhereNothingSpeaksAgainstIt) {
  const auto map = test::make_map(100, 100, 30.0, [](double, double) { return 0.0; });
  const RolloutChoice choice = choose(map, 30.0);
  EXPECT_EQ(choice.direction_rad, 0.0);
  // 12 m above the safety height; the farthest place looked at lies 480 m ahead, 48 m of lag.
  EXPECT_NEAR(choice.needed_commanded, -12.0 / 528.0, 1e-4);
}

TEST_F(RolloutOverLevelGround, WallAcrossThePathIsWalkedAroundOnItsNearerSide) {
  // 200 m high, 300 m ahead, from 60 m south of the line to 400 m north of it.
  const auto map = test::make_map(100, 100, 30.0, [](double x_m, double y_m) {
    return x_m > 1200.0 && x_m < 1290.0 && y_m > 1440.0 && y_m < 1900.0 ? 200.0 : 0.0;
  });
  const RolloutChoice choice = choose(map, 30.0);
  ASSERT_TRUE(choice.direction_rad);
  EXPECT_LT(*choice.direction_rad, -0.2);
  EXPECT_GT(*choice.direction_rad, -1.2);
  // Commanded straight at it: 188 m to climb; it begins within the tube 45 to 75 m before its edge.
  EXPECT_GT(choice.needed_commanded, 188.0 / (300.0 - 48.0));
  EXPECT_LT(choice.needed_commanded, 188.0 / (300.0 - 100.0 - 48.0));
}

TEST_F(RolloutOverLevelGround, WithoutAWayOutTheLeastClimbIsNamed) {
  const auto map = test::make_map(100, 100, 30.0, [](double x_m, double y_m) {
    const double far_m = std::hypot(x_m - 900.0, y_m - 1500.0);
    return far_m < 250.0 ? 0.0 : (y_m < 1300.0 ? 300.0 : 1500.0);
  });
  const RolloutChoice choice = choose(map, 30.0);
  EXPECT_FALSE(choice.direction_rad);
  EXPECT_LT(choice.least_climb_rad, -0.5) << "the lower wall is to the right";
}

TEST_F(RolloutOverLevelGround, CostlyGroundAheadIsAvoidedOnTheSideThatEndsSooner) {
  map::Map map = test::make_map(100, 100, 30.0, [](double, double) { return 0.0; });
  for (int row = 49; row < 60; ++row) {  // y from 1470 to 1800 m: the south side is near
    for (int column = 34; column < 60; ++column) {
      map.semantics.at(column, row) = static_cast<std::uint16_t>(map::SemanticClass::kSettlement);
    }
  }
  test::finish_map(map);
  const RolloutChoice choice = choose(map, 30.0);
  ASSERT_TRUE(choice.direction_rad);
  EXPECT_LT(*choice.direction_rad, 0.0);
  // No risk counts far off the guide.
  EXPECT_EQ(choose(map, 30.0, 900.0, 0.0).direction_rad, 0.0);
}

// Towards the east along y = 1500 m, and as the Decider sees later places of such a flight.
class RolloutTree : public ::testing::Test {
 protected:
  [[nodiscard]] RolloutView view(const command_model::ModelState& state, double along_m) const {
    RolloutView view;
    const double east_m = along_m + 300.0 - state.x_m;
    const double north_m = 1500.0 - state.y_m;
    view.guide = {along_m, std::atan2(north_m, east_m), std::hypot(east_m, north_m),
                  model_.vehicle().vertical_rates(state.speed_mps, state.altitude_m)};
    view.question = {
        state.heading_math_rad, view.guide.target_math_rad, 0.0, kTangentMin, kTangentMax, share_};
    view.reach_m = reach_m_;
    return view;
  }
  // From (900, 1500) at 40 m/s, with so many decisions, 6 s apart.
  [[nodiscard]] std::optional<double> direction_rad(const map::Map& map, int depth,
                                                    double semantics_weight = 0.0) const {
    const risk::CostModel costs = test::test_costs(map);
    Surroundings surroundings(costs, 350.0, 45.0, semantics_weight, 0.0);
    surroundings.pack(kTube_m);
    const Guide guide({{0, 1500, 0}, {5000, 1500, 0}});
    RolloutOptions options = kOptions;
    options.tree_depth = depth;
    options.branch_s = 6.0;
    options.later_weight = 1.0;
    Rollout rollout(surroundings, guide, model_, 300.0, kSafetyHeight_m, kProfile, options,
                    weights(), 40.0, Kernel::kBest);
    const auto state = command_model::trimmed_state(900.0, 1500.0, 30.0, 40.0, 0.0, 0.0);
    const RolloutView here = view(state, 900.0);
    return rollout
        .choose(
            state, command_model::trigonometry_of(state), here, 0.0, 0.0,
            [this](const command_model::ModelState& later, const command_model::StateTrigonometry&,
                   double along_m, double run_m) { return view(later, along_m + run_m); })
        .direction_rad;
  }

  static constexpr double kTangentMin = -0.176;
  static constexpr double kTangentMax = 0.18;
  command_model::CommandModel model_{test::shipped_vehicle()};
  double share_ = 1.0;
  double reach_m_ = 1e9;
};

// Ahead, 400 m on, stands a block from 40 m south to 100 m north of the line: the way around its
// south is shorter. But that leads into a pocket: walls to the block's east side, along the south,
// and across its end, 660 m ahead. Flights of 12 s see 480 m. The pocket is 400 m wide, less the
// tube 306 m: too narrow to turn around in, at 40 m/s and 30 deg of bank, 564 m.
map::Map pocket_in_the_south() {
  return test::make_map(170, 100, 30.0, [](double x_m, double y_m) {
    const auto within = [&](double west_m, double east_m, double south_m, double north_m) {
      return x_m > west_m && x_m < east_m && y_m > south_m && y_m < north_m;
    };
    const bool is_block = within(1300.0, 1400.0, 1460.0, 1600.0);
    const bool is_wall_of_pocket = within(1300.0, 1620.0, 1430.0, 1460.0) ||
                                   within(1000.0, 1620.0, 1000.0, 1030.0) ||
                                   within(1560.0, 1620.0, 1000.0, 1460.0);
    return is_block || is_wall_of_pocket ? 300.0 : 0.0;
  });
}

TEST_F(RolloutTree, OneDecisionChoosesTheArmThatIsAPocketAndTwoTheOther) {
  const map::Map map = pocket_in_the_south();
  const auto one = direction_rad(map, 1);
  ASSERT_TRUE(one);
  EXPECT_LT(*one, -0.15) << "the way around the south is the shorter one";
  for (const int depth : {2, 3}) {
    const auto more = direction_rad(map, depth);
    ASSERT_TRUE(more);
    EXPECT_GT(*more, 0.15) << depth;
  }
}

TEST_F(RolloutTree, ItsMirrorImageChoosesTheMirroredArm) {
  const map::Map map = pocket_in_the_south();
  map::Map mirrored = map;
  for (int row = 0; row < 100; ++row) {
    for (int column = 0; column < 170; ++column) {
      mirrored.surface_m.at(column, row) = map.surface_m.at(column, 99 - row);
    }
  }
  test::finish_map(mirrored);
  for (const int depth : {1, 2, 3}) {
    EXPECT_NEAR(*direction_rad(mirrored, depth), -*direction_rad(map, depth), 1e-5) << depth;
  }
}

TEST_F(RolloutTree, WhereEveryBranchEndsTheOneDecisionStands) {
  // A valley as wide as the pocket that ends 600 m ahead: 12 s are free, 18 s are not.
  const auto map = test::make_map(170, 100, 30.0, [](double x_m, double y_m) {
    return x_m < 1500.0 && std::fabs(y_m - 1500.0) < 200.0 ? 0.0 : 900.0;
  });
  EXPECT_EQ(direction_rad(map, 1), 0.0);
  EXPECT_EQ(direction_rad(map, 2), 0.0);
}

TEST_F(RolloutTree, OverLevelGroundWithoutRiskItGoesStraightToTheGoal) {
  const auto map = test::make_map(170, 100, 30.0, [](double, double) { return 0.0; });
  for (const int depth : {1, 2, 3, 4}) {
    EXPECT_EQ(direction_rad(map, depth), 0.0) << depth;
  }
}

TEST_F(RolloutTree, CostlyGroundBeyondTheFirstFlightDecidesTheSide) {
  // A costly patch 300 m ahead ends sooner in the south. But 540 m ahead the costly ground goes on
  // there, 600 m wide and 600 m long, and not in the north.
  map::Map map = test::make_map(170, 100, 30.0, [](double, double) { return 0.0; });
  for (int row = 0; row < 100; ++row) {
    for (int column = 0; column < 170; ++column) {
      const geo::MapPoint centre = map.geometry.centre({column, row});
      const bool is_near =
          centre.x_m > 1200.0 && centre.x_m < 1440.0 && centre.y_m > 1440.0 && centre.y_m < 1590.0;
      const bool is_beyond =
          centre.x_m > 1440.0 && centre.x_m < 2040.0 && centre.y_m > 930.0 && centre.y_m < 1530.0;
      if (is_near || is_beyond) {
        map.semantics.at(column, row) = static_cast<std::uint16_t>(map::SemanticClass::kSettlement);
      }
    }
  }
  test::finish_map(map);
  EXPECT_LT(*direction_rad(map, 1, 0.5), -0.01);
  EXPECT_GT(*direction_rad(map, 3, 0.5), 0.01);
  share_ = 0.0;
  EXPECT_EQ(direction_rad(map, 3, 0.5), 0.0) << "no risk counts far off the guide";
}

TEST_F(RolloutTree, ADecisionThatWouldLieBeyondTheReachIsNotLookedAt) {
  const map::Map map = pocket_in_the_south();
  reach_m_ = 40.0 * 18.0 - 1.0;
  EXPECT_EQ(direction_rad(map, 2), direction_rad(map, 1));
  reach_m_ += 2.0;
  EXPECT_GT(*direction_rad(map, 2), 0.15);
}

// What the kernels must agree on, over random ground, states and options.
TEST(RolloutKernels, AllInstructionSetsGiveTheBitsOfThePlainForm) {
  std::mt19937_64 random(test::fresh_seed());
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  int chosen = 0;
  int none = 0;
  for (int trial = 0; trial < 40; ++trial) {
    command_model::Vehicle vehicle = test::shipped_vehicle();
    if (trial % 2 == 1) {
      vehicle.wind = {uniform(-7.0, 7.0), uniform(-7.0, 7.0)};
    }
    const command_model::CommandModel model(vehicle);
    const double cell_m = std::vector<double>{30.0, 10.0, 5.0}[random() % 3];
    const int size = static_cast<int>(1500.0 / cell_m);
    const double relief_m = uniform(10.0, 200.0);
    map::Map map =
        test::make_map(size, size, cell_m, [&](double, double) { return uniform(0.0, relief_m); });
    for (auto& value : map.visibility.values()) {
      value = static_cast<std::uint16_t>(random() % 65535);
    }
    const risk::CostModel costs = test::test_costs(map);
    Surroundings surroundings(costs, 350.0, 45.0, 0.5, uniform(0.0, 2.0));
    surroundings.pack(uniform(10.0, 60.0));
    const Guide guide({{100, 300, 50}, {700, 750, uniform(20.0, 150.0)}, {1400, 1000, 80}});
    RolloutOptions options = kOptions;
    options.horizon_s = uniform(4.0, 20.0);
    options.sample_s = uniform(0.2, 0.5);
    options.gain = uniform(0.0, 6.0);
    DirectionWeights cost = weights();
    cost.goal_cost = random() % 2 == 0 ? GoalCost::kQuadratic : GoalCost::kAbsolute;
    cost.climb = uniform(0.0, 1.0);
    options.tree_depth = 1 + trial % 3;
    options.branch_s = uniform(0.5, options.horizon_s);
    options.later_weight = uniform(0.3, 2.0);
    const auto with = [&](Kernel kernel) {
      return Rollout(surroundings, guide, model, 300.0, kSafetyHeight_m, kProfile, options, cost,
                     40.0, kernel);
    };
    Rollout plain = with(Kernel::kPlain);
    for (const Kernel kernel : {Kernel::kBest, Kernel::kAvx2, Kernel::kAvx512}) {
      if (!is_available(kernel)) {
        continue;
      }
      Rollout fast = with(kernel);
      for (int place = 0; place < 20; ++place) {
        auto state = command_model::trimmed_state(
            uniform(1.0, 1499.0), uniform(1.0, 1499.0), relief_m + uniform(-20.0, 80.0),
            uniform(20.0, 60.0), uniform(-kPi, kPi), uniform(-5.0, 5.0));
        state.bank_left_rad = uniform(-0.5, 0.5);
        const auto trigonometry = command_model::trigonometry_of(state);
        const DirectionQuestion question{
            state.heading_math_rad, uniform(-kPi, kPi), uniform(-0.1, 0.1), -0.17, 0.18,
            uniform(0.0, 1.0)};
        const GuideView on_guide{uniform(0.0, guide.length_m()), uniform(-kPi, kPi),
                                 uniform(0.0, 400.0),
                                 model.vehicle().vertical_rates(state.speed_mps, state.altitude_m)};
        const double commanded_rad = uniform(-kPi, kPi);
        const double before_rad = uniform(-kPi, kPi);
        const RolloutView view{question, on_guide, place % 3 == 0 ? uniform(20.0, 600.0) : 1e9};
        const ViewAt view_at = [&](const command_model::ModelState& later,
                                   const command_model::StateTrigonometry&, double from_m,
                                   double run_m) {
          RolloutView there = view;
          there.guide.along_m = std::min(from_m + run_m, guide.length_m());
          there.reach_m = 1e9;
          there.question.heading_math_rad = later.heading_math_rad;
          return there;
        };
        const RolloutChoice a =
            plain.choose(state, trigonometry, view, commanded_rad, before_rad, view_at);
        const RolloutChoice b =
            fast.choose(state, trigonometry, view, commanded_rad, before_rad, view_at);
        ASSERT_EQ(a.direction_rad, b.direction_rad) << name_of_kernel(kernel);
        ASSERT_EQ(a.least_climb_rad, b.least_climb_rad) << name_of_kernel(kernel);
        ASSERT_EQ(a.needed_commanded, b.needed_commanded) << name_of_kernel(kernel);
        ASSERT_EQ(a.needed_near, b.needed_near) << name_of_kernel(kernel);
        ASSERT_EQ(a.ahead.climb_rate_mps, b.ahead.climb_rate_mps) << name_of_kernel(kernel);
        ASSERT_EQ(a.ahead.shortfall_rate_mps, b.ahead.shortfall_rate_mps) << name_of_kernel(kernel);
        (a.direction_rad ? chosen : none) += 1;
      }
    }
  }
  EXPECT_GT(chosen, 100);
  EXPECT_GT(none, 100);
}

}  // namespace
}  // namespace hedgehop::local_planning
