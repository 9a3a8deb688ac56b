#include "command_model/turbulence.hpp"

#include <array>
#include <cmath>
#include <gtest/gtest.h>
#include <vector>

#include "support/fresh_seed.hpp"

namespace hedgehop::command_model {
namespace {

TEST(DrydenParameters, AreThoseOfTheStandardAt100And1000Feet) {
  // 30 kt at 20 ft, the standard's moderate turbulence: sigma_w = 3 kt.
  const double wind_mps = 30.0 * 1852.0 / 3600.0;
  const DrydenParameters low = dryden_parameters(wind_mps, 100.0 * 0.3048);
  EXPECT_NEAR(low.sigma_up_mps, 1.5433, 1e-4);
  // 0.177 + 0.0823 = 0.2593; 0.2593^0.4 = 0.58280, 0.2593^1.2 = 0.19795
  EXPECT_NEAR(low.sigma_along_mps, 1.5433 / 0.58280, 1e-3);
  EXPECT_NEAR(low.scale_up_m, 30.48, 1e-9);
  EXPECT_NEAR(low.scale_along_m, 30.48 / 0.19795, 0.05);
  // At 1000 ft 0.177 + 0.823 = 1: the same in all directions, and so above.
  const DrydenParameters high = dryden_parameters(wind_mps, 2000.0);
  EXPECT_NEAR(high.sigma_along_mps, high.sigma_up_mps, 1e-9);
  EXPECT_NEAR(high.scale_along_m, 304.8, 1e-6);
  EXPECT_NEAR(high.scale_up_m, 304.8, 1e-6);
  EXPECT_NEAR(dryden_parameters(wind_mps, 0.0).scale_up_m, 3.048, 1e-9);
}

struct Statistics {
  std::array<double, 3> variance{};     // over sigma^2
  std::array<double, 3> correlation{};  // at the lag
};

// Over `ways` steps of `way_m`, at a lag of so many steps.
Statistics measured(std::uint64_t seed, double way_m, int ways, int lag, double height_m) {
  const DrydenParameters of = dryden_parameters(10.0, height_m);
  Turbulence turbulence({10.0, seed});
  std::vector<std::array<double, 3>> gusts;
  for (int i = 0; i < ways; ++i) {
    const Gust gust = turbulence.next(way_m, height_m);
    gusts.push_back({gust.along_mps / of.sigma_along_mps, gust.left_mps / of.sigma_along_mps,
                     gust.up_mps / of.sigma_up_mps});
  }
  Statistics result;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    double square = 0.0;
    double product = 0.0;
    for (std::size_t i = 0; i + static_cast<std::size_t>(lag) < gusts.size(); ++i) {
      square += gusts[i][axis] * gusts[i][axis];
      product += gusts[i][axis] * gusts[i + static_cast<std::size_t>(lag)][axis];
    }
    const double count = static_cast<double>(gusts.size() - static_cast<std::size_t>(lag));
    result.variance[axis] = square / count;
    result.correlation[axis] = product / count;
  }
  return result;
}

// A mean of squares over n scales of a process with correlation r(x) has the variance
// 2 (2 / n) integral of r^2 = 2 / n for exp(-x), and less for (1 - x / 2) exp(-x), whose
// integral of r^2 is 5 / 16. Five standard deviations of the former are allowed.
TEST(Turbulence, HasTheVarianceAndTheCorrelationOfTheModelWhateverTheStep) {
  const std::uint64_t seed = test::fresh_seed();
  constexpr double kHeight_m = 60.96;  // 200 ft
  const DrydenParameters of = dryden_parameters(10.0, kHeight_m);
  for (const double way_m : {0.5, 2.0, 20.0}) {
    const int ways = static_cast<int>(4000.0 * of.scale_along_m / way_m / 4.0);
    const double scales = ways * way_m / of.scale_along_m;
    const double bound = 5.0 * std::sqrt(2.0 / scales);
    const int lag = static_cast<int>(40.0 / way_m);
    const Statistics found = measured(seed, way_m, ways, lag, kHeight_m);
    const double along = 40.0 / of.scale_along_m;
    const double up = 40.0 / of.scale_up_m;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      EXPECT_NEAR(found.variance[axis], 1.0, bound) << seed << ' ' << way_m << ' ' << axis;
    }
    EXPECT_NEAR(found.correlation[0], std::exp(-along), bound) << seed << ' ' << way_m;
    EXPECT_NEAR(found.correlation[1], (1.0 - 0.5 * along) * std::exp(-along), bound)
        << seed << ' ' << way_m;
    EXPECT_NEAR(found.correlation[2], (1.0 - 0.5 * up) * std::exp(-up), bound)
        << seed << ' ' << way_m;
  }
}

TEST(Turbulence, GrowsWithTheWindIsRepeatedByItsSeedAndIsNoneWithoutWind) {
  Turbulence one({5.0, 7});
  Turbulence again({5.0, 7});
  Turbulence twice({10.0, 7});
  Turbulence none({0.0, 7});
  Turbulence other({5.0, 8});
  bool differs = false;
  for (int i = 0; i < 100; ++i) {
    const Gust gust = one.next(2.0, 40.0);
    const Gust same = again.next(2.0, 40.0);
    EXPECT_EQ(gust.along_mps, same.along_mps);
    EXPECT_EQ(gust.left_mps, same.left_mps);
    EXPECT_EQ(gust.up_mps, same.up_mps);
    EXPECT_NEAR(twice.next(2.0, 40.0).up_mps, 2.0 * gust.up_mps, 1e-12);
    EXPECT_EQ(none.next(2.0, 40.0).left_mps, 0.0);
    differs = differs || other.next(2.0, 40.0).up_mps != gust.up_mps;
  }
  EXPECT_TRUE(differs);
}

}  // namespace
}  // namespace hedgehop::command_model
