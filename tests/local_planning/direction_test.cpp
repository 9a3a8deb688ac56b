#include "local_planning/direction.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <numbers>
#include <vector>

#include "base/angles.hpp"

namespace hedgehop::local_planning {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr int kCount = 64;

// Level ground, no risk.
PolarHistogram open_country(double risk = 0.0) {
  PolarHistogram histogram;
  histogram.tan_climb.assign(kCount, -0.1);
  histogram.tan_masked.assign(kCount, -0.1);
  histogram.tan_mask.assign(kCount, -0.1);
  histogram.risk.assign(kCount, risk);
  histogram.risk_weight.assign(kCount, 5.0);
  return histogram;
}

DirectionWeights plain_weights(GoalCost goal_cost = GoalCost::kQuadratic) {
  return {goal_cost, 1.0, 0.0, 0.0, 0.15};
}

DirectionQuestion towards(double goal_rad, double heading_rad) {
  return {heading_rad, goal_rad, 0.0, -0.17, 0.18, 1.0};
}

class Direction : public ::testing::Test {
 protected:
  Sectors sectors_{kCount};
  std::vector<double> scratch_;
};

TEST_F(Direction, FeasibleGoalDirectionIsTakenExactly) {
  const auto direction = cheapest_direction_rad(open_country(), sectors_, plain_weights(),
                                                towards(0.123, -0.4), scratch_);
  EXPECT_EQ(direction, 0.123);
}

TEST_F(Direction, EqualRiskEverywhereChangesNothing) {
  for (const double risk : {0.1, 1.0, 100.0}) {
    for (const double goal_rad : {-2.5, 0.05, 1.4}) {
      const auto direction = cheapest_direction_rad(open_country(risk), sectors_, plain_weights(),
                                                    towards(goal_rad, 0.0), scratch_);
      EXPECT_EQ(direction, goal_rad);
    }
  }
}

TEST_F(Direction, RiskOnTheLeftPullsToTheRight) {
  PolarHistogram histogram = open_country();
  for (std::size_t k = 0; k < kCount; ++k) {
    histogram.risk[k] = 0.2 * std::sin(static_cast<double>(k) * 2.0 * kPi / kCount);
  }
  const auto direction =
      cheapest_direction_rad(histogram, sectors_, plain_weights(), towards(0.0, 0.0), scratch_);
  ASSERT_TRUE(direction);
  EXPECT_LT(*direction, -0.05);
  EXPECT_GT(*direction, -0.8);
}

TEST_F(Direction, WeakRiskMovesTheQuadraticGoalCostButNotTheAbsoluteOne) {
  // Slope of the risk gain at the goal: 0.004 / 0.15 per radian; a sector is 0.098 rad wide.
  PolarHistogram histogram = open_country();
  for (std::size_t k = 0; k < kCount; ++k) {
    histogram.risk[k] = 0.04 * std::sin(static_cast<double>(k) * 2.0 * kPi / kCount);
  }
  const auto quadratic =
      cheapest_direction_rad(histogram, sectors_, plain_weights(), towards(0.0, 0.0), scratch_);
  const auto absolute = cheapest_direction_rad(
      histogram, sectors_, plain_weights(GoalCost::kAbsolute), towards(0.0, 0.0), scratch_);
  EXPECT_LT(*quadratic, 0.0);
  EXPECT_EQ(*absolute, 0.0);
}

TEST_F(Direction, ClimbAboveTheGuideIsAvoidedWhenItCosts) {
  PolarHistogram histogram = open_country();
  for (const int k : {-1, 0, 1}) {
    histogram.tan_masked[static_cast<std::size_t>((k + kCount) % kCount)] = 0.15;
  }
  DirectionWeights weights = plain_weights();
  EXPECT_EQ(cheapest_direction_rad(histogram, sectors_, weights, towards(0.0, 0.0), scratch_), 0.0);
  weights.climb_relative = 1.0;
  const auto direction =
      cheapest_direction_rad(histogram, sectors_, weights, towards(0.0, 0.0), scratch_);
  EXPECT_NEAR(std::fabs(*direction), 2.0 * 2.0 * kPi / kCount, 1e-12);
}

TEST_F(Direction, NearTheGoalOnlyItsDirectionCounts) {
  PolarHistogram histogram = open_country();
  for (std::size_t k = 0; k < kCount; ++k) {
    histogram.risk[k] = 5.0 * std::sin(static_cast<double>(k) * 2.0 * kPi / kCount);
  }
  DirectionQuestion question = towards(0.7, 0.0);
  question.polar_share = 0.0;
  EXPECT_EQ(cheapest_direction_rad(histogram, sectors_, plain_weights(), question, scratch_), 0.7);
}

TEST_F(Direction, BlockedGoalGivesTheNearestOpenSide) {
  PolarHistogram histogram = open_country();
  for (int k = -5; k <= 3; ++k) {
    histogram.tan_masked[static_cast<std::size_t>((k + kCount) % kCount)] = 0.181;
  }
  const auto direction =
      cheapest_direction_rad(histogram, sectors_, plain_weights(), towards(0.0, 0.0), scratch_);
  EXPECT_NEAR(*direction, 4.0 * 2.0 * kPi / kCount, 1e-12);
  EXPECT_NEAR(*nearest_feasible_rad(histogram, sectors_, -0.3, 0.18), -6.0 * 2.0 * kPi / kCount,
              1e-12);
}

TEST_F(Direction, ClimbOfExactlyTheLimitIsFeasible) {
  PolarHistogram histogram = open_country();
  histogram.tan_masked.assign(kCount, 0.18);
  EXPECT_EQ(
      cheapest_direction_rad(histogram, sectors_, plain_weights(), towards(1.0, 0.0), scratch_),
      1.0);
  histogram.tan_masked.assign(kCount, std::nextafter(0.18, 1.0));
  EXPECT_FALSE(
      cheapest_direction_rad(histogram, sectors_, plain_weights(), towards(1.0, 0.0), scratch_));
  EXPECT_FALSE(nearest_feasible_rad(histogram, sectors_, 0.0, 0.18));
}

TEST_F(Direction, WithoutAWayOutTheLeastClimbWithinReachIsTaken) {
  PolarHistogram histogram = open_country();
  histogram.tan_masked.assign(kCount, 3.0);
  histogram.tan_masked[10] = 1.0;
  histogram.tan_masked[32] = 0.5;  // behind
  EXPECT_NEAR(least_climb_direction_rad(histogram, sectors_, 0.0, 0.0, 108.0 * kDegree_rad),
              10.0 * 2.0 * kPi / kCount, 1e-12);
  histogram.tan_masked.assign(kCount, 3.0);
  EXPECT_NEAR(least_climb_direction_rad(histogram, sectors_, 0.0, -0.5, 108.0 * kDegree_rad),
              -5.0 * 2.0 * kPi / kCount, 1e-12)
      << "equal everywhere: the preferred direction";
}

}  // namespace
}  // namespace hedgehop::local_planning
