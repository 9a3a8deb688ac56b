#include "verification/wire_distance.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <random>

#include "support/fresh_seed.hpp"

namespace hedgehop::verification {
namespace {

TEST(DistanceToSpan, IsTheHeightAboveTheConductorForAPathThatCrossesOverIt) {
  EXPECT_NEAR(distance_to_span_m({0.0, -50.0, 62.0}, {0.0, 50.0, 62.0}, {-100.0, 0.0, 50.0},
                                 {100.0, 0.0, 50.0}),
              12.0, 1e-12);
}

TEST(DistanceToSpan, IsZeroForAPathThatPassesUnderTheConductor) {
  EXPECT_EQ(distance_to_span_m({0.0, -50.0, 20.0}, {0.0, 50.0, 20.0}, {-100.0, 0.0, 50.0},
                               {100.0, 0.0, 50.0}),
            0.0);
}

TEST(DistanceToSpan, IsHorizontalBesideTheConductorAndBelowIt) {
  EXPECT_NEAR(distance_to_span_m({-80.0, 7.0, 30.0}, {80.0, 7.0, 30.0}, {-100.0, 0.0, 50.0},
                                 {100.0, 0.0, 50.0}),
              7.0, 1e-12);
}

TEST(DistanceToSpan, IsSlantedAboveAndBesideTheConductor) {
  EXPECT_NEAR(distance_to_span_m({-80.0, 3.0, 54.0}, {80.0, 3.0, 54.0}, {-100.0, 0.0, 50.0},
                                 {100.0, 0.0, 50.0}),
              5.0, 1e-12);
}

TEST(DistanceToSpan, IsHorizontalWhenTheUnknownTopIsInfinitelyHigh) {
  const double high = std::numeric_limits<double>::infinity();
  EXPECT_NEAR(distance_to_span_m({-80.0, 9.0, 900.0}, {80.0, 9.0, 900.0}, {-100.0, 0.0, high},
                                 {100.0, 0.0, high}),
              9.0, 1e-12);
}

TEST(DistanceToSpan, FindsThatAParallelPathDipsBelowOnlyAtItsEnd) {
  // Straight above the span, 5 m above at one end and 5 m below at the other: it passes through.
  EXPECT_NEAR(distance_to_span_m({-80.0, 4.0, 55.0}, {80.0, 4.0, 45.0}, {-100.0, 0.0, 50.0},
                                 {100.0, 0.0, 50.0}),
              4.0, 1e-12);
}

TEST(DistanceToSpan, IsThatToThePoleForASpanWithoutLength) {
  EXPECT_NEAR(
      distance_to_span_m({-80.0, 6.0, 40.0}, {80.0, 6.0, 40.0}, {0.0, 0.0, 50.0}, {0.0, 0.0, 50.0}),
      6.0, 1e-12);
}

TEST(DistanceToSpan, AgreesWithADenseSearchOverPathAndCurtain) {
  std::mt19937_64 random(test::fresh_seed());
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (int round = 0; round < 400; ++round) {
    PathPoint from{uniform(-20.0, 20.0), uniform(-20.0, 20.0), uniform(-15.0, 15.0)};
    PathPoint to{uniform(-20.0, 20.0), uniform(-20.0, 20.0), uniform(-15.0, 15.0)};
    const PathPoint a{uniform(-20.0, 20.0), uniform(-20.0, 20.0), uniform(-15.0, 15.0)};
    PathPoint b{uniform(-20.0, 20.0), uniform(-20.0, 20.0), uniform(-15.0, 15.0)};
    if (round % 4 == 0) {  // parallel in the plane, as along a line
      b.x_m = a.x_m + 0.7 * (to.x_m - from.x_m);
      b.y_m = a.y_m + 0.7 * (to.y_m - from.y_m);
    }
    double least_m = 1e9;
    constexpr int kSamples = 400;
    for (int i = 0; i <= kSamples; ++i) {
      const double t = static_cast<double>(i) / kSamples;
      for (int k = 0; k <= kSamples; ++k) {
        const double s = static_cast<double>(k) / kSamples;
        const double dx = from.x_m + t * (to.x_m - from.x_m) - a.x_m - s * (b.x_m - a.x_m);
        const double dy = from.y_m + t * (to.y_m - from.y_m) - a.y_m - s * (b.y_m - a.y_m);
        const double above = from.altitude_m + t * (to.altitude_m - from.altitude_m) -
                             a.altitude_m - s * (b.altitude_m - a.altitude_m);
        const double dz = std::max(above, 0.0);
        least_m = std::min(least_m, std::sqrt(dx * dx + dy * dy + dz * dz));
      }
    }
    const double found_m = distance_to_span_m(from, to, a, b);
    // A sample is up to half a spacing of both pieces away from the nearest pair.
    const double slack_m = 2.0 * 0.5 * 65.0 / kSamples;
    ASSERT_LE(found_m, least_m + 1e-9);
    ASSERT_GE(found_m, least_m - slack_m);
  }
}

}  // namespace
}  // namespace hedgehop::verification
