#include "local_planning/lowest_profile.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <map>
#include <random>
#include <stdexcept>

#include "support/fresh_seed.hpp"

namespace hedgehop::local_planning {
namespace {

constexpr double kRounding_m = 2e-3;

// Sum of the altitudes after the first, and whether all demands hold.
struct Judged {
  double sum_m = 0.0;
  bool is_allowed = true;
};

Judged judged(const std::vector<double>& x, const std::vector<double>& floor_m,
              double start_rate_mps, double knot_s, const ProfileLimits& limits) {
  Judged result;
  double rate_before = start_rate_mps;
  for (std::size_t k = 0; k + 1 < x.size(); ++k) {
    const double rate = (x[k + 1] - x[k]) / knot_s;
    const double acceleration = (rate - rate_before) / knot_s;
    const double share = k == 0 ? 0.5 : 1.0;
    const double led = rate + limits.command_lead_s * acceleration;
    const double slack = kRounding_m / knot_s;
    result.is_allowed =
        result.is_allowed &&
        std::fabs(acceleration) <= share * limits.acceleration_mps2 + slack / knot_s &&
        rate <= limits.climb_rate_mps + slack && rate >= -limits.descent_rate_mps - slack &&
        led <= limits.climb_rate_mps + 5 * slack && led >= -limits.descent_rate_mps - 5 * slack &&
        x[k + 1] >= floor_m[k + 1] - kRounding_m;
    result.sum_m += x[k + 1];
    rate_before = rate;
  }
  return result;
}

TEST(LowestProfile, LevelFloorUnderTheStartIsFollowed) {
  const std::vector<double> floor_m(50, 100.0);
  const auto x =
      lowest_profile(floor_m, std::vector<double>(50, 1.0), 100.0, 0.0, 0.25, {8.0, 8.0, 2.0, 0.0});
  ASSERT_TRUE(x);
  for (const double altitude_m : *x) {
    EXPECT_NEAR(altitude_m, 100.0, 0.05);
  }
}

TEST(LowestProfile, DescentTakesTheTimeOfTheClosedForm) {
  // From rest, 50 m down with 2 m/s^2 and at most 5 m/s: 2.5 s to gain the rate and as long to lose
  // it, 6.25 m each, 37.5 m in between in 7.5 s. The sum of the altitudes is that of the path.
  const double knot_s = 0.05;
  const std::size_t knots = 401;
  const auto x = lowest_profile(std::vector<double>(knots, 0.0), std::vector<double>(knots, 1.0),
                                50.0, 0.0, knot_s, {5.0, 5.0, 2.0, 0.0});
  ASSERT_TRUE(x);
  EXPECT_NEAR((*x)[50], 50.0 - 6.25, 0.2);
  EXPECT_NEAR((*x)[125], 25.0, 0.3);
  EXPECT_NEAR((*x)[200], 6.25, 0.4);
  EXPECT_NEAR((*x)[255], 0.0, 0.1);
  EXPECT_NEAR(x->back(), 0.0, 0.05);
}

TEST(LowestProfile, IsNoHigherThanTheBestOfADynamicProgramme) {
  // The same demands on a lattice: altitudes and their differences in whole metres, 1 s apart, so
  // that a difference changes by at most 2. Every lattice path is allowed, so the profile's sum is
  // at most that of the best; and since altitudes are a metre apart, it is not far below.
  std::mt19937_64 random(test::fresh_seed());
  const ProfileLimits limits{6.0, 5.0, 2.0, 0.0};
  for (int repeat = 0; repeat < 20; ++repeat) {
    const int knots = 30;
    std::vector<double> floor_m(static_cast<std::size_t>(knots));
    int level = 0;
    for (int k = 0; k < knots; ++k) {
      if (random() % 4 == 0) {
        level = static_cast<int>(random() % 25);
      }
      floor_m[static_cast<std::size_t>(k)] = level;
    }
    const double start_m = 30.0;
    // (altitude, difference) -> least sum
    std::map<std::pair<int, int>, double> best{{{30, 0}, 0.0}};
    for (int k = 1; k < knots; ++k) {
      std::map<std::pair<int, int>, double> next;
      for (const auto& [state, sum] : best) {
        const int change_max = k == 1 ? 1 : 2;
        for (int change = -change_max; change <= change_max; ++change) {
          const int difference = state.second + change;
          const int altitude = state.first + difference;
          if (difference > 6 || difference < -5 ||
              altitude < floor_m[static_cast<std::size_t>(k)]) {
            continue;
          }
          auto [entry, is_new] = next.try_emplace({altitude, difference}, sum + altitude);
          entry->second = std::min(entry->second, sum + altitude);
        }
      }
      best = std::move(next);
    }
    double least_sum_m = std::numeric_limits<double>::infinity();
    for (const auto& [state, sum] : best) {
      least_sum_m = std::min(least_sum_m, sum);
    }
    const auto x = lowest_profile(floor_m, std::vector<double>(floor_m.size(), 1.0), start_m, 0.0,
                                  1.0, limits);
    ASSERT_TRUE(x);
    const Judged result = judged(*x, floor_m, 0.0, 1.0, limits);
    EXPECT_TRUE(result.is_allowed);
    EXPECT_LE(result.sum_m, least_sum_m + knots * 0.02);
    EXPECT_GE(result.sum_m, least_sum_m - knots * 1.0);
  }
}

TEST(LowestProfile, HoldsEveryDemandOnRoughFloors) {
  std::mt19937_64 random(test::fresh_seed());
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (int repeat = 0; repeat < 20; ++repeat) {
    const std::size_t knots = 20 + random() % 600;
    std::vector<double> floor_m;
    double level_m = 0.0;
    for (std::size_t k = 0; k < knots; ++k) {
      level_m += uniform(-2.0, 2.0);
      floor_m.push_back(level_m + (random() % 40 == 0 ? uniform(0.0, 60.0) : 0.0));
    }
    const ProfileLimits limits{uniform(3.0, 9.0), uniform(3.0, 9.0), uniform(0.5, 3.0),
                               uniform(0.0, 1.0)};
    const double start_rate_mps = uniform(-2.0, 2.0);
    const auto x = lowest_profile(floor_m, std::vector<double>(knots, 1.0), level_m + 400.0,
                                  start_rate_mps, 0.25, limits);
    ASSERT_TRUE(x) << repeat;
    EXPECT_TRUE(judged(*x, floor_m, start_rate_mps, 0.25, limits).is_allowed) << repeat;
  }
}

TEST(LowestProfile, StartTooLowForTheFloorClimbsAsSteeplyAsItCan) {
  // 60 m are missing: 2 m/s^2 up to 6 m/s.
  const auto x = lowest_profile(std::vector<double>(41, 60.0), std::vector<double>(41, 1.0), 0.0,
                                0.0, 0.25, {6.0, 6.0, 2.0, 0.0});
  ASSERT_TRUE(x);
  EXPECT_NEAR((*x)[4], 1.0, 0.3) << "a t^2 / 2 after 1 s";
  EXPECT_NEAR((*x)[12], 9.0, 0.5) << "and after 3 s";
  EXPECT_NEAR((*x)[32], 9.0 + 5.0 * 6.0, 0.7) << "then 6 m/s";
}

TEST(LowestProfile, WeightsDecideWhereItIsLow) {
  // Between two equal walls the way down and up is the same for all weights but zero; over a wall
  // the rate at which it is passed depends on which side counts more.
  std::vector<double> floor_m(81, 0.0);
  floor_m[40] = 40.0;
  const auto passed_at = [&](double before, double after) {
    std::vector<double> weights(81, before);
    std::fill(weights.begin() + 41, weights.end(), after);
    const auto x = lowest_profile(floor_m, weights, 20.0, 0.0, 0.25, {8.0, 8.0, 2.0, 0.0});
    return (*x)[41] - (*x)[39];
  };
  EXPECT_GT(passed_at(1.0, 0.1), 0.5) << "late and steep up to it, over it, and slowly down";
  EXPECT_LT(passed_at(0.1, 1.0), -0.5) << "early up to it, so that it is passed in descent";
}

TEST(LowestProfile, BrokenPreconditionsAreRefused) {
  const ProfileLimits limits{8.0, 8.0, 2.0, 0.0};
  EXPECT_THROW(lowest_profile({1.0}, {1.0}, 0.0, 0.0, 0.25, limits), std::invalid_argument);
  EXPECT_THROW(lowest_profile({1.0, 2.0}, {1.0}, 0.0, 0.0, 0.25, limits), std::invalid_argument);
  EXPECT_THROW(lowest_profile({1.0, 2.0}, {1.0, 1.0}, 0.0, 0.0, 0.0, limits),
               std::invalid_argument);
  EXPECT_THROW(lowest_profile({1.0, 2.0}, {1.0, 1.0}, 0.0, 0.0, 0.25, {0.0, 8.0, 2.0, 0.0}),
               std::invalid_argument);
}

}  // namespace
}  // namespace hedgehop::local_planning
