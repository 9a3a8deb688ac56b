#include "local_planning/direction.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <numbers>
#include <optional>
#include <random>
#include <vector>

#include "base/angles.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::local_planning {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr int kCount = 64;
constexpr double kWide_rad = 80.0 * kDegree_rad;  // 14 of 64 sectors

// Level ground, no risk.
PolarHistogram open_country(float risk = 0.0F) {
  PolarHistogram histogram;
  histogram.tan_climb.assign(kCount, -0.1F);
  histogram.tan_masked.assign(kCount, -0.1F);
  histogram.tan_mask.assign(kCount, -0.1F);
  histogram.risk.assign(kCount, risk);
  histogram.risk_weight.assign(kCount, 5.0F);
  return histogram;
}

float sine_of_sector(std::size_t k) {
  return static_cast<float>(std::sin(static_cast<double>(k) * 2.0 * kPi / kCount));
}

DirectionWeights plain_weights(GoalCost goal_cost = GoalCost::kQuadratic) {
  return {goal_cost, 1.0, 0.0, 0.0, 0.15};
}

DirectionQuestion towards(double goal_rad, double heading_rad) {
  return {heading_rad, goal_rad, 0.0, -0.17, 0.18, 1.0};
}

class Direction : public ::testing::Test {
 protected:
  // The same by the plain form and by all instructions that there are.
  std::optional<double> cheapest(const PolarHistogram& histogram, const DirectionWeights& weights,
                                 const DirectionQuestion& question) {
    const auto plain =
        cheapest_direction_rad(histogram, sectors_, weights, question, scratch_, &plain_cheapest);
    for (const Kernel kernel : {Kernel::kBest, Kernel::kAvx2, Kernel::kAvx512}) {
      if (is_available(kernel)) {
        EXPECT_EQ(cheapest_direction_rad(histogram, sectors_, weights, question, scratch_,
                                         step_kernels(kernel).cheapest),
                  plain)
            << name_of_kernel(kernel);
      }
    }
    return plain;
  }
  std::optional<double> cheapest_opening(const PolarHistogram& histogram,
                                         const DirectionWeights& weights,
                                         const DirectionQuestion& question) {
    return cheapest_opening_rad(histogram, sectors_, weights, kWide_rad, question, scratch_,
                                &plain_cheapest);
  }
  static double centre_rad(int k) { return wrap_to_pi(k * 2.0 * kPi / kCount); }

  Sectors sectors_{kCount};
  DirectionScratch scratch_;
};

TEST_F(Direction, FeasibleGoalDirectionIsTakenExactly) {
  const auto direction = cheapest(open_country(), plain_weights(), towards(0.123, -0.4));
  EXPECT_EQ(direction, 0.123);
}

TEST_F(Direction, CostsThatAreShownAreSquaredAnglesToTheGoalWhereRiskIsEqual) {
  PolarHistogram histogram = open_country(3.0F);
  histogram.tan_masked[9] = 0.5F;
  const auto costs = direction_costs(histogram, sectors_, plain_weights(), towards(0.3, 2.0));
  ASSERT_EQ(costs.size(), static_cast<std::size_t>(kCount));
  for (int k = 0; k < kCount; ++k) {
    const double off_rad = std::remainder(k * 2.0 * kPi / kCount - 0.3, 2.0 * kPi);
    const float cost = costs[static_cast<std::size_t>(k)];
    if (k == 9) {
      EXPECT_TRUE(std::isnan(cost));
    } else {
      EXPECT_NEAR(cost, off_rad * off_rad, 1e-4) << k;
    }
  }
}

TEST_F(Direction, EqualRiskEverywhereChangesNothing) {
  for (const float risk : {0.1F, 1.0F, 100.0F}) {
    for (const double goal_rad : {-2.5, 0.05, 1.4}) {
      const auto direction = cheapest(open_country(risk), plain_weights(), towards(goal_rad, 0.0));
      EXPECT_EQ(direction, goal_rad);
    }
  }
}

TEST_F(Direction, RiskOnTheLeftPullsToTheRight) {
  PolarHistogram histogram = open_country();
  for (std::size_t k = 0; k < kCount; ++k) {
    histogram.risk[k] = 0.2F * sine_of_sector(k);
  }
  const auto direction = cheapest(histogram, plain_weights(), towards(0.0, 0.0));
  ASSERT_TRUE(direction);
  EXPECT_LT(*direction, -0.05);
  EXPECT_GT(*direction, -0.8);
}

TEST_F(Direction, WeakRiskMovesTheQuadraticGoalCostButNotTheAbsoluteOne) {
  // Slope of the risk gain at the goal: 0.004 / 0.15 per radian; a sector is 0.098 rad wide.
  PolarHistogram histogram = open_country();
  for (std::size_t k = 0; k < kCount; ++k) {
    histogram.risk[k] = 0.04F * sine_of_sector(k);
  }
  const auto quadratic = cheapest(histogram, plain_weights(), towards(0.0, 0.0));
  const auto absolute = cheapest(histogram, plain_weights(GoalCost::kAbsolute), towards(0.0, 0.0));
  EXPECT_LT(*quadratic, 0.0);
  EXPECT_EQ(*absolute, 0.0);
}

TEST_F(Direction, ClimbAboveTheGuideIsAvoidedWhenItCosts) {
  PolarHistogram histogram = open_country();
  for (const int k : {-1, 0, 1}) {
    histogram.tan_masked[static_cast<std::size_t>((k + kCount) % kCount)] = 0.15F;
  }
  DirectionWeights weights = plain_weights();
  EXPECT_EQ(cheapest(histogram, weights, towards(0.0, 0.0)), 0.0);
  weights.climb_relative = 1.0;
  const auto direction = cheapest(histogram, weights, towards(0.0, 0.0));
  EXPECT_NEAR(std::fabs(*direction), 2.0 * 2.0 * kPi / kCount, 1e-12);
}

TEST_F(Direction, NearTheGoalOnlyItsDirectionCounts) {
  PolarHistogram histogram = open_country();
  for (std::size_t k = 0; k < kCount; ++k) {
    histogram.risk[k] = 5.0F * sine_of_sector(k);
  }
  DirectionQuestion question = towards(0.7, 0.0);
  question.polar_share = 0.0;
  EXPECT_EQ(cheapest(histogram, plain_weights(), question), 0.7);
}

TEST_F(Direction, BlockedGoalGivesTheNearestOpenSide) {
  PolarHistogram histogram = open_country();
  for (int k = -5; k <= 3; ++k) {
    histogram.tan_masked[static_cast<std::size_t>((k + kCount) % kCount)] = 0.181F;
  }
  const auto direction = cheapest(histogram, plain_weights(), towards(0.0, 0.0));
  EXPECT_NEAR(*direction, 4.0 * 2.0 * kPi / kCount, 1e-12);
  EXPECT_NEAR(*nearest_feasible_rad(histogram, sectors_, -0.3, 0.18F), -6.0 * 2.0 * kPi / kCount,
              1e-12);
}

TEST_F(Direction, ClimbOfExactlyTheLimitIsFeasible) {
  PolarHistogram histogram = open_country();
  histogram.tan_masked.assign(kCount, 0.18F);
  EXPECT_EQ(cheapest(histogram, plain_weights(), towards(1.0, 0.0)), 1.0);
  histogram.tan_masked.assign(kCount, std::nextafter(0.18F, 1.0F));
  EXPECT_FALSE(cheapest(histogram, plain_weights(), towards(1.0, 0.0)));
  EXPECT_FALSE(nearest_feasible_rad(histogram, sectors_, 0.0, 0.18F));
}

TEST_F(Direction, WithoutAWayOutTheLeastClimbWithinReachIsTaken) {
  PolarHistogram histogram = open_country();
  histogram.tan_masked.assign(kCount, 3.0F);
  histogram.tan_masked[10] = 1.0F;
  histogram.tan_masked[32] = 0.5F;  // behind
  EXPECT_NEAR(least_climb_direction_rad(histogram, sectors_, 0.0, 0.0, 108.0 * kDegree_rad),
              10.0 * 2.0 * kPi / kCount, 1e-12);
  histogram.tan_masked.assign(kCount, 3.0F);
  EXPECT_NEAR(least_climb_direction_rad(histogram, sectors_, 0.0, -0.5, 108.0 * kDegree_rad),
              -5.0 * 2.0 * kPi / kCount, 1e-12)
      << "equal everywhere: the preferred direction";
}

TEST_F(Direction, OpeningsArePassedInTheMiddleOrHalfAWideOneFromTheirEdges) {
  const auto open = [](std::vector<std::pair<int, int>> openings) {
    PolarHistogram histogram = open_country();
    histogram.tan_masked.assign(kCount, 3.0F);
    for (const auto& [first, last] : openings) {
      for (int k = first; k <= last; ++k) {
        histogram.tan_masked[static_cast<std::size_t>(k)] = -0.1F;
      }
    }
    return histogram;
  };
  const auto weights = plain_weights();
  const DirectionQuestion east = towards(0.0, 0.0);
  // Five sectors: the middle one. All directions: the nearest.
  EXPECT_EQ(cheapest_opening(open({{10, 14}}), weights, east), centre_rad(12));
  EXPECT_EQ(cheapest(open({{10, 14}}), weights, east), centre_rad(10));
  // Four: the cheaper of both middle ones. 14 are narrow still, 15 are wide.
  EXPECT_EQ(cheapest_opening(open({{10, 13}}), weights, east), centre_rad(11));
  EXPECT_EQ(cheapest_opening(open({{5, 18}}), weights, east), centre_rad(11));
  EXPECT_EQ(cheapest_opening(open({{5, 19}}), weights, east), centre_rad(12));
  EXPECT_EQ(cheapest_opening(open({{5, 40}}), weights, east), centre_rad(12));
  EXPECT_EQ(cheapest_opening(open({{5, 40}}), weights, towards(-2.0, 0.0)), centre_rad(33));
  // Several: the cheapest, here that on the right, where the one sector is its own middle.
  EXPECT_EQ(cheapest_opening(open({{10, 14}, {54, 54}}), weights, east), centre_rad(54));
  // Across the first sector.
  EXPECT_EQ(cheapest_opening(open({{0, 2}, {61, 63}}), weights, towards(1.0, 0.0)), centre_rad(0));
  EXPECT_FALSE(cheapest_opening(open({}), weights, east));
}

TEST_F(Direction, AnOpenGoalDirectionIsTheCandidateOfVfhPlusWhateverItCosts) {
  PolarHistogram histogram = open_country();
  histogram.tan_masked[20] = 3.0F;
  for (std::size_t k = 0; k < kCount; ++k) {
    histogram.risk[k] = 2.0F * sine_of_sector(k);
  }
  EXPECT_EQ(cheapest_opening(histogram, plain_weights(), towards(0.123, 0.0)), 0.123);
  EXPECT_LT(*cheapest(histogram, plain_weights(), towards(0.123, 0.0)), 0.0);
}

TEST_F(Direction, TheOpeningChosenIsThatOfACheckOfEachSector) {
  std::mt19937_64 random(test::fresh_seed());
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  int compared = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    PolarHistogram histogram = open_country();
    const double share_open = uniform(0.2, 0.95);
    for (std::size_t k = 0; k < kCount; ++k) {
      const std::size_t before = (k + kCount - 1) % kCount;
      const bool is_like_before = k > 0 && uniform(0.0, 1.0) < 0.7;
      histogram.tan_masked[k] = is_like_before                   ? histogram.tan_masked[before]
                                : uniform(0.0, 1.0) < share_open ? 0.0F
                                                                 : 3.0F;
      histogram.risk[k] = static_cast<float>(uniform(0.0, 2.0));
    }
    const DirectionQuestion question = towards(uniform(-kPi, kPi), uniform(-kPi, kPi));
    const auto is_open = [&](int k) {
      return histogram.tan_masked[static_cast<std::size_t>((k + 4 * kCount) % kCount)] <= 0.18F;
    };
    const auto costs = direction_costs(histogram, sectors_, plain_weights(), question);
    std::optional<double> expected;
    float best = std::numeric_limits<float>::infinity();
    for (int k = 0; k < kCount; ++k) {
      int right = 0;
      int left = 0;
      while (right < kCount && is_open(k - right)) {
        ++right;
      }
      while (left < kCount && is_open(k + left)) {
        ++left;
      }
      const int width = right + left - 1;
      const int from_edge = std::min(right, left) - 1;
      const bool is_candidate = right > 0 && from_edge == (width > 14 ? 7 : (width - 1) / 2);
      if (is_candidate && costs[static_cast<std::size_t>(k)] < best) {
        best = costs[static_cast<std::size_t>(k)];
        expected = centre_rad(k);
      }
    }
    if (is_open(sectors_.of_angle(question.goal_math_rad))) {
      expected = question.goal_math_rad;
    } else {
      ++compared;
    }
    for (const Kernel kernel : {Kernel::kBest, Kernel::kAvx2, Kernel::kAvx512}) {
      if (is_available(kernel)) {
        ASSERT_EQ(cheapest_opening_rad(histogram, sectors_, plain_weights(), kWide_rad, question,
                                       scratch_, step_kernels(kernel).cheapest),
                  expected)
            << name_of_kernel(kernel);
      }
    }
    ASSERT_EQ(cheapest_opening(histogram, plain_weights(), question), expected);
  }
  EXPECT_GT(compared, 200);
}

TEST_F(Direction, CheapDirectionsPullTheIndicatorAndDearOnesRepelIt) {
  const auto torque_rad = [&](const PolarHistogram& histogram, double indicator_rad) {
    return cost_torque_rad(histogram, sectors_, plain_weights(), towards(0.0, 0.0), indicator_rad,
                           30.0 * kDegree_rad, scratch_, &plain_torque);
  };
  EXPECT_NEAR(torque_rad(open_country(0.7F), 0.3), 0.0, 1e-5) << "equal risk turns nothing";
  PolarHistogram cheap = open_country(1.0F);
  cheap.risk[4] = 0.0F;  // 22.5 degrees to the left
  EXPECT_GT(torque_rad(cheap, 0.0), 0.01);
  EXPECT_LT(torque_rad(cheap, 45.0 * kDegree_rad), -0.01);
  // One dear direction; without it, all others are cheaper than the mean by as much.
  PolarHistogram dear = open_country(0.0F);
  dear.risk[4] = 1.0F;
  PolarHistogram others = dear;
  others.tan_masked[4] = 3.0F;
  const double off_rad = centre_rad(4);
  const double cost = (1.0 - 1.0 / kCount) / (off_rad * off_rad * off_rad + 0.15);
  for (const double indicator_deg : {-40.0, 0.0, 22.5, 45.0, 90.0}) {
    const double u_rad = off_rad - indicator_deg * kDegree_rad;
    const double width_rad = 30.0 * kDegree_rad;
    EXPECT_NEAR(
        torque_rad(dear, indicator_deg * kDegree_rad) -
            torque_rad(others, indicator_deg * kDegree_rad),
        -2.0 * kPi / kCount * cost * u_rad / std::pow(1.0 + std::pow(u_rad / width_rad, 2.0), 2.0),
        1e-6)
        << indicator_deg;
  }
}

TEST_F(Direction, TheTorqueIsTheSumOfItsFormulaInDoublePrecision) {
  std::mt19937_64 random(test::fresh_seed());
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (int trial = 0; trial < 200; ++trial) {
    PolarHistogram histogram = open_country();
    double mean = 0.0;
    for (std::size_t k = 0; k < kCount; ++k) {
      histogram.risk[k] = static_cast<float>(uniform(0.0, 2.0));
      mean += static_cast<double>(histogram.risk[k]) / kCount;
      histogram.tan_masked[k] = random() % 3 == 0 ? 3.0F : 0.0F;
    }
    DirectionWeights weights = plain_weights();
    weights.goal = uniform(0.5, 2.0);
    DirectionQuestion question = towards(uniform(-kPi, kPi), uniform(-kPi, kPi));
    question.polar_share = uniform(0.0, 1.0);
    const double indicator_rad = uniform(-kPi, kPi);
    const double width_rad = uniform(0.1, 1.0);
    double sum_rad = 0.0;
    for (int k = 0; k < kCount; ++k) {
      const auto at = static_cast<std::size_t>(k);
      if (histogram.tan_masked[at] > 0.18F) {
        continue;
      }
      const double angle_rad = 2.0 * kPi * k / kCount;
      const double off_rad =
          std::fabs(std::remainder(angle_rad - question.heading_math_rad, 2.0 * kPi));
      const double cost = question.polar_share * (static_cast<double>(histogram.risk[at]) - mean) /
                          (std::pow(off_rad, 3.0) + 0.15);
      const double u_rad = std::remainder(angle_rad - indicator_rad, 2.0 * kPi);
      const double fall = std::pow(1.0 + std::pow(u_rad / width_rad, 2.0), 2.0);
      sum_rad += -cost * u_rad / (cost > 0.0 ? fall : 1.0);
    }
    const double expected_rad = 2.0 * kPi / kCount / weights.goal * sum_rad;
    ASSERT_NEAR(cost_torque_rad(histogram, sectors_, weights, question, indicator_rad, width_rad,
                                scratch_, &plain_torque),
                expected_rad, 1e-4);
  }
}

TEST(DirectionKernels, AllInstructionSetsChooseTheSameWhateverTheHistogram) {
  std::mt19937_64 random(test::fresh_seed());
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  int of_sector = 0;
  int none = 0;
  for (int trial = 0; trial < 3000; ++trial) {
    const int count = std::vector<int>{8, 31, 32, 64, 90, 128, 256}[random() % 7];
    const Sectors sectors(count);
    PolarHistogram histogram;
    histogram.resize(count);
    const double share_open = uniform(-0.1, 1.0);
    for (std::size_t k = 0; k < static_cast<std::size_t>(count); ++k) {
      histogram.tan_masked[k] = static_cast<float>(
          uniform(0.0, 1.0) < share_open ? uniform(-0.3, 0.18) : uniform(0.0, 9.0));
      histogram.risk[k] = static_cast<float>(uniform(0.0, 2.0));
      histogram.risk_weight[k] = uniform(0.0, 1.0) < 0.1 ? 0.0F : 3.0F;
    }
    DirectionWeights weights{random() % 2 == 0 ? GoalCost::kQuadratic : GoalCost::kAbsolute,
                             uniform(0.0, 2.0), uniform(0.0, 1.0), uniform(0.0, 1.0),
                             uniform(0.01, 0.3)};
    const DirectionQuestion question{
        uniform(-kPi, kPi), uniform(-kPi, kPi), uniform(-0.1, 0.1), -0.17, 0.18,
        uniform(-0.2, 1.0)};
    DirectionScratch scratch;
    const auto plain =
        cheapest_direction_rad(histogram, sectors, weights, question, scratch, &plain_cheapest);
    const double indicator_rad = uniform(-kPi, kPi);
    const auto torque_rad = [&](float (*torque)(const TorqueTask&)) {
      return cost_torque_rad(histogram, sectors, weights, question, indicator_rad, 0.5, scratch,
                             torque);
    };
    none += plain ? 0 : 1;
    of_sector += plain && *plain != question.goal_math_rad ? 1 : 0;
    for (const Kernel kernel : {Kernel::kBest, Kernel::kAvx2, Kernel::kAvx512}) {
      if (is_available(kernel)) {
        ASSERT_EQ(cheapest_direction_rad(histogram, sectors, weights, question, scratch,
                                         step_kernels(kernel).cheapest),
                  plain)
            << name_of_kernel(kernel) << ", " << count << " sectors";
        ASSERT_EQ(torque_rad(step_kernels(kernel).torque), torque_rad(&plain_torque))
            << name_of_kernel(kernel) << ", " << count << " sectors";
      }
    }
  }
  EXPECT_GT(of_sector, 1000);
  EXPECT_GT(none, 50);
}

}  // namespace
}  // namespace hedgehop::local_planning
