#include "verification/cylinder_distance.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <random>

#include "support/fresh_seed.hpp"

namespace hedgehop::verification {
namespace {

constexpr double kTolerance_m = 1e-6;

TEST(DistanceToCylinder, IsTheHeightAboveTheTopForAPathThatCrossesOverIt) {
  EXPECT_NEAR(distance_to_cylinder_m({-90.0, 3.0, 62.0}, {90.0, 3.0, 62.0}, {0.0, 0.0, 20.0, 50.0}),
              12.0, kTolerance_m);
}

TEST(DistanceToCylinder, IsHorizontalBesideIt) {
  EXPECT_NEAR(
      distance_to_cylinder_m({-90.0, 27.0, 30.0}, {90.0, 27.0, 30.0}, {0.0, 0.0, 20.0, 50.0}), 7.0,
      kTolerance_m);
}

TEST(DistanceToCylinder, IsSlantedBesideAndAboveIt) {
  // 3 m outside the edge, 4 m above the top
  EXPECT_NEAR(
      distance_to_cylinder_m({-90.0, 23.0, 54.0}, {90.0, 23.0, 54.0}, {0.0, 0.0, 20.0, 50.0}), 5.0,
      kTolerance_m);
}

TEST(DistanceToCylinder, IsZeroThroughItAndHorizontalWhenItHasNoTop) {
  EXPECT_EQ(distance_to_cylinder_m({-90.0, 3.0, 30.0}, {90.0, 3.0, 30.0}, {0.0, 0.0, 20.0, 50.0}),
            0.0);
  EXPECT_NEAR(distance_to_cylinder_m({-90.0, 29.0, 9000.0}, {90.0, 29.0, 9000.0},
                                     {0.0, 0.0, 20.0, std::numeric_limits<double>::infinity()}),
              9.0, kTolerance_m);
}

TEST(DistanceToCylinder, AgreesWithADenseSearchAndIsNeverGreater) {
  std::mt19937_64 random(test::fresh_seed());
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (int round = 0; round < 500; ++round) {
    const PathPoint from{uniform(-30.0, 30.0), uniform(-30.0, 30.0), uniform(-20.0, 20.0)};
    const PathPoint to{uniform(-30.0, 30.0), uniform(-30.0, 30.0), uniform(-20.0, 20.0)};
    const Cylinder cylinder{uniform(-20.0, 20.0), uniform(-20.0, 20.0), uniform(0.0, 15.0),
                            uniform(-20.0, 20.0)};
    constexpr int kSamples = 4000;
    double least_m = 1e9;
    for (int i = 0; i <= kSamples; ++i) {
      const double t = static_cast<double>(i) / kSamples;
      const double r_m = std::hypot(from.x_m + t * (to.x_m - from.x_m) - cylinder.x_m,
                                    from.y_m + t * (to.y_m - from.y_m) - cylinder.y_m);
      const double z_m = from.altitude_m + t * (to.altitude_m - from.altitude_m);
      least_m = std::min(least_m, std::hypot(std::max(r_m - cylinder.radius_m, 0.0),
                                             std::max(z_m - cylinder.top_m, 0.0)));
    }
    const double found_m = distance_to_cylinder_m(from, to, cylinder);
    // Two samples are at most 100 m / 4000 apart.
    EXPECT_LE(found_m, least_m + 1e-12);
    EXPECT_GE(found_m, least_m - 0.025);
  }
}

}  // namespace
}  // namespace hedgehop::verification
