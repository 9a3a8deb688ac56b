#include "base/angles.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

#include "support/fresh_seed.hpp"

namespace hedgehop {
namespace {

constexpr double kPi = std::numbers::pi;

TEST(Angles, CompassPointsAreWhereTheCompassHasThem) {
  EXPECT_NEAR(azimuth_from_math_angle_rad(0.0), 0.5 * kPi, 1e-15);   // east
  EXPECT_NEAR(azimuth_from_math_angle_rad(0.5 * kPi), 0.0, 1e-15);   // north
  EXPECT_NEAR(azimuth_from_math_angle_rad(-0.5 * kPi), kPi, 1e-15);  // south
  EXPECT_NEAR(azimuth_from_math_angle_rad(kPi), 1.5 * kPi, 1e-15);   // west
  EXPECT_NEAR(math_angle_from_azimuth_rad(1.5 * kPi), -kPi, 1e-15);  // west, in [-pi, pi)
}

TEST(Angles, WrappedAnglesLieInTheirIntervalsAndDifferByWholeTurns) {
  std::mt19937_64 random(test::fresh_seed());
  for (int i = 0; i < 100000; ++i) {
    const double angle = std::uniform_real_distribution<double>(-100.0, 100.0)(random);
    const double a = wrap_to_pi(angle);
    const double b = wrap_to_two_pi(angle);
    ASSERT_GE(a, -kPi);
    ASSERT_LT(a, kPi);
    ASSERT_GE(b, 0.0);
    ASSERT_LT(b, 2.0 * kPi);
    ASSERT_NEAR(std::remainder(angle - a, 2.0 * kPi), 0.0, 1e-12);
    ASSERT_NEAR(std::remainder(angle - b, 2.0 * kPi), 0.0, 1e-12);
    ASSERT_NEAR(
        std::remainder(math_angle_from_azimuth_rad(azimuth_from_math_angle_rad(angle)) - angle,
                       2.0 * kPi),
        0.0, 1e-12);
  }
  EXPECT_EQ(wrap_to_two_pi(-1e-18), 0.0) << "never 2 pi itself";
  EXPECT_EQ(wrap_to_pi(kPi), -kPi);
}

TEST(Angles, TrueAzimuthIsGridAzimuthPlusConvergence) {
  // Where grid north points 2 degrees east of true north, grid azimuth 10 is true azimuth 12.
  EXPECT_NEAR(true_from_grid_azimuth_rad(10 * kDegree_rad, 2 * kDegree_rad), 12 * kDegree_rad,
              1e-15);
  EXPECT_NEAR(grid_from_true_azimuth_rad(1 * kDegree_rad, 2 * kDegree_rad), 359 * kDegree_rad,
              1e-14);
}

TEST(Angles, DegreesAreRadiansTimes180OverPi) {
  EXPECT_DOUBLE_EQ(radians_from_degrees(180.0), kPi);
  EXPECT_DOUBLE_EQ(degrees_from_radians(kPi / 6.0), 30.0);
}

}  // namespace
}  // namespace hedgehop
