#include "evaluation/clearance_risk.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>

#include "base/shipped_config.hpp"
#include "support/fresh_seed.hpp"
#include "support/test_map.hpp"
#include "verification/perfect_flight.hpp"

namespace hedgehop::evaluation {
namespace {

double normal_cdf(double z) { return 0.5 * std::erfc(-z / std::sqrt(2.0)); }

UncertaintyOptions shipped_options(std::int64_t draws) {
  ConfigReader reader = ConfigReader::from_text(shipped_config("uncertainty.yaml"), "uncertainty");
  UncertaintyOptions options = read_uncertainty_options(reader);
  options.draws = draws;
  return options;
}

// A plane that rises to the east with this gradient, flown to the north along a contour line,
// 20 m above it, at 40 m/s.
struct ContourFlight {
  map::Map map;
  flight::Trajectory flight;

  ContourFlight(double gradient, double duration_s)
      : map(test::make_map(200, 200, 30.0,
                           [=](double x_m, double) { return gradient * (x_m - 3000.0); })) {
    test::Manoeuvre manoeuvre;
    manoeuvre.x_m = 3000.0;
    manoeuvre.y_m = 1000.0;
    manoeuvre.altitude_m = 20.0;
    manoeuvre.duration_s = duration_s;
    flight = test::fly(manoeuvre, map);
  }
};

// Within five standard deviations of the count, and the count belongs to its interval.
void expect_probability(const ClearanceRisk& risk, double expected) {
  const double n = static_cast<double>(risk.draws);
  EXPECT_NEAR(risk.probability, expected, 5.0 * std::sqrt(expected * (1.0 - expected) / n) + 1e-9);
  EXPECT_LE(risk.low, risk.probability);
  EXPECT_GE(risk.high, risk.probability);
}

TEST(ClearanceRisk, OfErrorsThatDoNotChangeIsThatOfOneNormalNumber) {
  // Surface, up, and east times the gradient go together: sigma^2 = 3^2 + 2^2 (1 + 0.5^2) = 14.
  const ContourFlight contour(0.5, 2.0);
  UncertaintyOptions options = shipped_options(20000);
  options.dem_correlation_m = 1e12;
  options.navigation_correlation_s = 1e12;
  const std::uint64_t seed = test::fresh_seed();
  for (const double clearance_m : {15.0, 18.0, 20.0, 22.0}) {
    const ClearanceRisk risk =
        clearance_risk(contour.map, contour.flight, {3.0, 2.0}, clearance_m, options, seed);
    expect_probability(risk, normal_cdf((clearance_m - 20.0) / std::sqrt(14.0)));
  }
}

TEST(ClearanceRisk, OfErrorsWithoutMemoryIsThatOfAsManyNumbersAsNodes) {
  const ContourFlight contour(0.0, 10.0);
  UncertaintyOptions options = shipped_options(20000);
  options.dem_correlation_m = 1e-3;
  const ClearanceRisk risk =
      clearance_risk(contour.map, contour.flight, {2.0, 0.0}, 15.0, options, test::fresh_seed());
  // 400 m in steps of 2 m, every third one, the first included.
  ASSERT_EQ(risk.nodes, 67);
  const double expected = 1.0 - std::pow(1.0 - normal_cdf(-2.5), 67.0);
  expect_probability(risk, expected);
  // The median of the least of 67 normal numbers.
  const double median = 1.0 - std::pow(0.5, 1.0 / 67.0);
  EXPECT_NEAR(normal_cdf((risk.clearance_median_m - 20.0) / 2.0), median, 0.1 * median);
}

// Probability that a stationary process with correlation `kept` from node to node stays above
// -bound at all nodes: the density of those that did is carried on from node to node, on a grid.
double staying_probability(double bound, double kept, int nodes) {
  constexpr int kCells = 800;
  const double low = -bound;
  const double width = (6.0 - low) / kCells;
  const auto at = [&](int i) { return low + (i + 0.5) * width; };
  std::vector<double> weight(kCells);
  for (int i = 0; i < kCells; ++i) {
    weight[static_cast<std::size_t>(i)] =
        normal_cdf(low + (i + 1) * width) - normal_cdf(low + i * width);
  }
  const double fresh = std::sqrt(1.0 - kept * kept);
  for (int node = 1; node < nodes; ++node) {
    std::vector<double> next(kCells, 0.0);
    for (int i = 0; i < kCells; ++i) {
      double before = normal_cdf((low - kept * at(i)) / fresh);
      for (int j = 0; j < kCells; ++j) {
        const double upto = normal_cdf((low + (j + 1) * width - kept * at(i)) / fresh);
        next[static_cast<std::size_t>(j)] += weight[static_cast<std::size_t>(i)] * (upto - before);
        before = upto;
      }
    }
    weight = next;
  }
  double sum = 0.0;
  for (const double share : weight) {
    sum += share;
  }
  return sum;
}

TEST(ClearanceRisk, OfErrorsThatFadeIsThatOfAChainOfNodes) {
  const ContourFlight contour(0.0, 2.0);
  UncertaintyOptions options = shipped_options(20000);
  options.dem_correlation_m = 30.0;
  const ClearanceRisk dem =
      clearance_risk(contour.map, contour.flight, {4.0, 0.0}, 15.0, options, test::fresh_seed());
  ASSERT_EQ(dem.nodes, 14);  // 6 m apart
  expect_probability(dem, 1.0 - staying_probability(5.0 / 4.0, std::exp(-6.0 / 30.0), 14));
  // The same of the altitude, by time: 0.15 s apart.
  options.navigation_correlation_s = 0.75;
  const ClearanceRisk navigation =
      clearance_risk(contour.map, contour.flight, {0.0, 4.0}, 15.0, options, test::fresh_seed());
  expect_probability(navigation, 1.0 - staying_probability(5.0 / 4.0, std::exp(-0.2), 14));
}

TEST(ClearanceRisk, WithoutErrorsIsCertain) {
  const ContourFlight contour(0.3, 20.0);
  const UncertaintyOptions options = shipped_options(1000);
  const ClearanceRisk kept = clearance_risk(contour.map, contour.flight, {}, 19.9, options, 1);
  EXPECT_EQ(kept.violations, 0);
  EXPECT_EQ(kept.low, 0.0);
  // 1 - 0.025^(1/1000), the rule for none in a thousand.
  EXPECT_NEAR(kept.high, 1.0 - std::pow(0.025, 1e-3), 1e-9);
  EXPECT_NEAR(kept.clearance_p01_m, 20.0, 1e-4);
  EXPECT_TRUE(std::isnan(kept.worst_time_s));
  const ClearanceRisk broken = clearance_risk(contour.map, contour.flight, {}, 20.1, options, 1);
  EXPECT_EQ(broken.violations, 1000);
  EXPECT_EQ(broken.high, 1.0);
  EXPECT_NEAR(broken.low, std::pow(0.025, 1e-3), 1e-9);
}

TEST(ClearanceRisk, SeesTheRidgeBetweenTwoNodesAndNamesIt) {
  // One row of half-metre cells across the path, 5 m high: no node lies on it.
  const map::Map map = test::make_map(
      400, 400, 0.5, [](double, double y_m) { return std::fabs(y_m - 151.25) < 0.1 ? 5.0 : 0.0; });
  test::Manoeuvre manoeuvre;
  manoeuvre.x_m = 100.0;
  manoeuvre.y_m = 100.0;
  manoeuvre.altitude_m = 20.0;
  manoeuvre.duration_s = 2.0;
  const flight::Trajectory flight = test::fly(manoeuvre, map);
  const ClearanceRisk risk =
      clearance_risk(map, flight, {}, 15.1, shipped_options(10), test::fresh_seed());
  EXPECT_EQ(risk.violations, 10);
  EXPECT_NEAR(risk.clearance_median_m, 15.0, 1e-6);
  EXPECT_NEAR(risk.worst_place.y_m, 151.25, 6.0);
}

TEST(ClearanceRisk, IsTheSameForASeedAndAnyNumberOfThreads) {
  const ContourFlight contour(0.2, 20.0);
  const UncertaintyOptions options = shipped_options(300);
  const std::uint64_t seed = test::fresh_seed();
  const auto drawn = [&](std::size_t threads, std::uint64_t with) {
    const oneapi::tbb::global_control control(oneapi::tbb::global_control::max_allowed_parallelism,
                                              threads);
    return clearance_risk(contour.map, contour.flight, {3.0, 3.0}, 10.0, options, with)
        .least_clearances_m;
  };
  EXPECT_EQ(drawn(1, seed), drawn(3, seed));
  EXPECT_NE(drawn(1, seed), drawn(1, seed + 1));
}

TEST(ClearanceRisk, UnknownGroundIsAViolationAndNonsenseIsRefused) {
  ContourFlight contour(0.0, 20.0);
  const UncertaintyOptions options = shipped_options(10);
  EXPECT_THROW(clearance_risk(contour.map, contour.flight, {-1.0, 0.0}, 10.0, options, 1),
               std::invalid_argument);
  EXPECT_THROW(clearance_risk(contour.map, {}, {1.0, 0.0}, 10.0, options, 1),
               std::invalid_argument);
  contour.map.surface_m.at(100, 50) = std::nanf("");
  contour.map.surface_m.at(99, 50) = std::nanf("");
  EXPECT_EQ(clearance_risk(contour.map, contour.flight, {}, 10.0, options, 1).violations, 10);
}

}  // namespace
}  // namespace hedgehop::evaluation
