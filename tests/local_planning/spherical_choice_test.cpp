#include "local_planning/spherical_choice.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <numbers>
#include <random>

#include "base/angles.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::local_planning {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr int kCount = 64;

class Spherical : public ::testing::Test {
 protected:
  Spherical() {
    histogram_.resize(kCount);
    std::fill_n(histogram_.tan_masked.begin(), kCount, -0.2F);
    std::fill_n(histogram_.risk_weight.begin(), kCount, 1.0F);
    std::fill_n(histogram_.risk.begin(), kCount, 0.3F);
    question_.tangent_min = std::tan(-10.0 * kDegree_rad);
    question_.tangent_max = std::tan(10.0 * kDegree_rad);
  }
  [[nodiscard]] std::optional<SphericalDirection> choice() const {
    return cheapest_spherical(histogram_, sectors_, options_, 0.15, question_, now_, before_);
  }
  Sectors sectors_{kCount};
  PolarHistogram histogram_;
  SphericalOptions options_{1.0 * kDegree_rad, 5.0, 2.0, 2.0};
  DirectionQuestion question_;
  SphericalDirection now_;
  SphericalDirection before_;
};

TEST_F(Spherical, OverOpenGroundItFliesTowardsTheTargetAndItsClimb) {
  options_.heading = options_.before = 0.0;
  question_.goal_math_rad = 8 * 2.0 * kPi / kCount;  // the centre of a sector
  question_.goal_tangent = std::tan(4.0 * kDegree_rad);
  const auto found = choice();
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->azimuth_math_rad, question_.goal_math_rad, 1e-12);
  EXPECT_NEAR(found->elevation_rad, 4.0 * kDegree_rad, 1e-9);
}

TEST_F(Spherical, AWallIsCrossedOrPassedWhicheverTurnsLess) {
  // Ahead 7 degrees of climb are needed, over `wide` sectors to each side.
  const auto with_wall = [&](int wide) {
    std::fill_n(histogram_.tan_masked.begin(), kCount, -0.2F);
    for (int k = -wide; k <= wide; ++k) {
      histogram_.tan_masked[static_cast<std::size_t>((k + kCount) % kCount)] =
          static_cast<float>(std::tan(6.5 * kDegree_rad));
    }
    return choice();
  };
  // One sector: 5.6 degrees aside are less than 7 up.
  const auto aside = with_wall(0);
  ASSERT_TRUE(aside);
  EXPECT_NEAR(std::fabs(aside->azimuth_math_rad), 2.0 * kPi / kCount, 1e-12);
  EXPECT_NEAR(aside->elevation_rad, 0.0, 1e-9);
  // Three sectors: 11.2 degrees aside are more.
  const auto over = with_wall(1);
  ASSERT_TRUE(over);
  EXPECT_NEAR(over->azimuth_math_rad, 0.0, 1e-12);
  EXPECT_NEAR(over->elevation_rad, 7.0 * kDegree_rad, 1e-9);
}

TEST_F(Spherical, NothingIsChosenWhereNoCandidateIsFree) {
  std::fill_n(histogram_.tan_masked.begin(), kCount, 0.18F);
  EXPECT_FALSE(choice()) << "10.2 degrees everywhere, 10 can be climbed";
  histogram_.tan_masked[5] = static_cast<float>(question_.tangent_max);
  const auto found = choice();
  ASSERT_TRUE(found) << "the very limit is free";
  EXPECT_NEAR(found->azimuth_math_rad, 5 * 2.0 * kPi / kCount, 1e-12);
}

TEST_F(Spherical, AngleBetweenDirectionsIsThatOfTheirUnitVectors) {
  std::mt19937_64 random(test::fresh_seed());
  std::uniform_real_distribution<double> azimuth(-kPi, kPi);
  std::uniform_real_distribution<double> elevation(-1.5, 1.5);
  for (int i = 0; i < 1000; ++i) {
    const SphericalDirection a{azimuth(random), elevation(random)};
    const SphericalDirection b{azimuth(random), elevation(random)};
    const double dot = std::cos(a.elevation_rad) * std::cos(b.elevation_rad) *
                           std::cos(a.azimuth_math_rad - b.azimuth_math_rad) +
                       std::sin(a.elevation_rad) * std::sin(b.elevation_rad);
    EXPECT_NEAR(std::cos(apart_rad(a, b)), dot, 1e-9);
  }
}

TEST_F(Spherical, ChoosesWhatACheckOfAllCandidatesFinds) {
  std::mt19937_64 random(test::fresh_seed());
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  for (int round = 0; round < 100; ++round) {
    for (std::size_t k = 0; k < kCount; ++k) {
      histogram_.tan_masked[k] = static_cast<float>(-0.2 + 0.5 * unit(random));
      histogram_.risk[k] = static_cast<float>(unit(random));
      histogram_.risk_weight[k] = unit(random) < 0.9 ? 1.0F : 0.0F;
    }
    question_.heading_math_rad = kPi * (2.0 * unit(random) - 1.0);
    question_.goal_math_rad = kPi * (2.0 * unit(random) - 1.0);
    question_.goal_tangent = 0.3 * unit(random) - 0.15;
    question_.polar_share = unit(random);
    now_ = {question_.heading_math_rad, 0.1 * unit(random)};
    before_ = {kPi * (2.0 * unit(random) - 1.0), 0.1 * unit(random)};

    double mean = 0.0;
    double known = 0.0;
    for (std::size_t k = 0; k < kCount; ++k) {
      if (histogram_.risk_weight[k] > 0.0F) {
        mean += static_cast<double>(histogram_.risk[k]);
        known += 1.0;
      }
    }
    mean /= known;
    const auto cost_of = [&](const SphericalDirection& d) {
      const auto k = static_cast<std::size_t>(
          std::lround(
              (d.azimuth_math_rad < -1e-9 ? d.azimuth_math_rad + 2.0 * kPi : d.azimuth_math_rad) *
              kCount / (2.0 * kPi)) %
          kCount);
      const double off =
          std::fabs(std::remainder(d.azimuth_math_rad - now_.azimuth_math_rad, 2.0 * kPi));
      const SphericalDirection goal{question_.goal_math_rad, std::atan(question_.goal_tangent)};
      const double risk = histogram_.risk_weight[k] > 0.0F
                              ? question_.polar_share *
                                    (static_cast<double>(histogram_.risk[k]) - mean) /
                                    (off * off * off + 0.15)
                              : 0.0;
      return 5.0 * apart_rad(d, goal) + 2.0 * apart_rad(d, now_) + 2.0 * apart_rad(d, before_) +
             risk;
    };
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < kCount; ++k) {
      for (int e = -10; e <= 10; ++e) {
        const double elevation_rad = e * kDegree_rad;
        if (std::tan(elevation_rad) >= static_cast<double>(histogram_.tan_masked[k])) {
          least = std::min(
              least,
              cost_of({std::remainder(static_cast<double>(k) * 2.0 * kPi / kCount, 2.0 * kPi),
                       elevation_rad}));
        }
      }
    }
    const auto found = choice();
    ASSERT_EQ(found.has_value(), std::isfinite(least));
    if (found) {
      EXPECT_NEAR(cost_of(*found), least, 1e-9);
    }
  }
}

}  // namespace
}  // namespace hedgehop::local_planning
