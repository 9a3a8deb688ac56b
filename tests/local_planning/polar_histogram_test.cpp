#include "local_planning/polar_histogram.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <gtest/gtest.h>
#include <limits>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "local_planning/histogram_table.hpp"
#include "local_planning/local_planning_setup.hpp"
#include "support/fresh_seed.hpp"
#include "support/test_map.hpp"

namespace hedgehop::local_planning {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kNothing = -std::numeric_limits<double>::infinity();

HistogramOptions usual_options() {
  return {350.0, 64, 45.0, 18.0, 1.0, 75.0 * kPi / 180.0, 140.0, 4.0, false};
}

double remainder_angle(double angle) { return std::remainder(angle, 2.0 * kPi); }

struct Oracle {
  std::vector<double> climb, mask, masked, risk, weight;
  std::vector<int> cells;  // that count in risk and weight
  double near = kNothing;
};

// Side of the squares that places are told apart by: an equal part of the cell, at most 4 m.
double subcell_m(double cell_m) { return cell_m / std::ceil(cell_m / 4.0); }

geo::MapPoint centre_of_part(const geo::MapPoint& p, double cell_m, double side_max_m) {
  const double side_m = cell_m / std::ceil(cell_m / side_max_m);
  return {(std::floor(p.x_m / side_m) + 0.5) * side_m, (std::floor(p.y_m / side_m) + 0.5) * side_m};
}

HistogramOptions with_larger_disc(HistogramOptions options, double by_m) {
  options.disc_radius_m += by_m;
  return options;
}

// From the definition, cell by cell and sector by sector, with libm in double precision. Every edge
// is moved by `grown`: what lies within rounding of an edge may be counted or not.
Oracle brute_force(const map::Map& map, const risk::CostModel& costs, const HistogramOptions& o,
                   double c_sem, double c_vis, const geo::MapPoint& p, double z, double chi,
                   double r_min, double grown) {
  const auto count = static_cast<std::size_t>(o.sectors);
  const double alpha = 2.0 * kPi / o.sectors;
  Oracle result;
  result.climb.assign(count, kNothing);
  result.mask.assign(count, kNothing);
  result.risk.assign(count, 0.0);
  result.weight.assign(count, 0.0);
  result.cells.assign(count, 0);
  const auto tangent = [&](double n, double distance) {
    return n > 0.0 ? n / std::max(distance - o.disc_radius_m, o.near_distance_m)
                   : n / (distance + o.disc_radius_m);
  };
  const int padding = static_cast<int>(std::ceil(o.window_m / map.geometry.cell_m)) + 1;
  for (int row = -padding; row < map.geometry.rows + padding; ++row) {
    for (int column = -padding; column < map.geometry.columns + padding; ++column) {
      const geo::MapPoint c = map.geometry.centre({column, row});
      const double d = std::hypot(c.x_m - p.x_m, c.y_m - p.y_m);
      if (d > o.window_m + grown) {
        continue;
      }
      const bool is_known = map.geometry.contains(raster::CellIndex{column, row}) &&
                            !std::isnan(map.surface_m.at(column, row));
      const double h = is_known ? static_cast<double>(map.surface_m.at(column, row)) : 9000.0;
      const double n = h + o.safety_height_m - z;
      const double risk_here = is_known
                                   ? static_cast<double>(static_cast<float>(
                                         c_sem * costs.semantics(c) + c_vis * costs.visibility(c)))
                                   : c_sem + c_vis;
      const double w = 1.0 - d * d / (o.window_m * o.window_m);
      if (d <= o.disc_radius_m - grown) {
        result.near =
            std::max(result.near, n > 0.0 ? n / o.near_distance_m : n / (d + o.disc_radius_m));
        for (std::size_t k = 0; k < count; ++k) {
          result.risk[k] += w * risk_here;
          result.weight[k] += w;
          ++result.cells[k];
        }
        continue;
      }
      const double beta = std::atan2(c.y_m - p.y_m, c.x_m - p.x_m);
      const double delta = remainder_angle(beta - chi);
      if (std::fabs(delta) > o.truncation_angle_rad + grown && d < o.truncation_distance_m) {
        continue;
      }
      const double bs = std::asin(std::min(1.0, o.disc_radius_m / d));
      for (std::size_t k = 0; k < count; ++k) {
        const double apart = std::fabs(remainder_angle(static_cast<double>(k) * alpha - beta));
        if (apart <= bs + 0.5 * alpha + grown) {
          result.climb[k] = std::max(result.climb[k], tangent(n, d));
          result.risk[k] += w * risk_here;
          result.weight[k] += w;
          ++result.cells[k];
        }
      }
      const double arc_angle = 2.0 * std::fabs(delta);
      if (arc_angle >= 0.5 * kPi + grown || std::fabs(delta) < 1e-6 - grown) {
        continue;
      }
      const double radius = d / std::sqrt(2.0 * (1.0 - std::cos(arc_angle)));
      const double widened = o.is_arc_widened ? o.disc_radius_m : 0.0;
      const double radius_max =
          (o.arc_radius_max_factor * r_min - r_min) * (1.0 - arc_angle / (0.5 * kPi)) + r_min;
      if (radius < r_min - widened - 1e3 * grown || radius > radius_max + widened + 1e3 * grown) {
        continue;
      }
      for (std::size_t k = 0; k < count; ++k) {
        const double apart =
            std::fabs(remainder_angle(static_cast<double>(k) * alpha - (chi + 2.0 * delta)));
        if (apart <= 0.5 * alpha + grown) {
          result.mask[k] = std::max(result.mask[k], tangent(n, arc_angle * radius));
        }
      }
    }
  }
  for (std::size_t k = 0; k < count; ++k) {
    result.risk[k] = result.weight[k] > 0.0 ? result.risk[k] / result.weight[k] : 0.0;
  }
  // A sector's masked angle: its own, and the masks of all sectors between it and the heading; the
  // opposite sector can be reached either way.
  result.masked = result.climb;
  const auto k_chi = static_cast<int>(std::floor(chi / alpha + 0.5));
  for (int i = 1; i < o.sectors; ++i) {
    double by_left = kNothing;
    double by_right = kNothing;
    for (int j = 1; j <= i; ++j) {
      by_left = std::max(
          by_left,
          result.mask[static_cast<std::size_t>(((k_chi + j) % o.sectors + o.sectors) % o.sectors)]);
    }
    for (int j = 1; j <= o.sectors - i; ++j) {
      by_right = std::max(
          by_right,
          result.mask[static_cast<std::size_t>(((k_chi - j) % o.sectors + o.sectors) % o.sectors)]);
    }
    const auto k = static_cast<std::size_t>(((k_chi + i) % o.sectors + o.sectors) % o.sectors);
    const int half = o.sectors / 2;
    // The opposite sector has no mask of its own: masks reach less than 90 degrees.
    const bool is_left = i < half || (o.sectors % 2 == 1 && i == half);
    const double mask = is_left ? by_left : (i > half ? by_right : std::min(by_left, by_right));
    result.masked[k] = std::max(result.masked[k], mask);
  }
  return result;
}

TEST(PolarHistogram, EqualsTheDefinitionCellByCell) {
  const auto seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  // Single precision: 350 m are known to 3e-5 m, which matters where the least distance of 5 m
  // divides.
  constexpr double kRounding = 5e-5;
  constexpr double kEdge = 4e-6;
  // Of the share of a cell: sums are whole multiples of 2^-17 at most, and 1 - (d/w)^2 is of single
  // precision. From a cell's middle, the shares around it are alike and their errors add up.
  constexpr double kShareRounding = 0.5 / 131072.0 + 4e-7;
  int compared = 0;
  int undecided = 0;
  int risks = 0;
  for (int trial = 0; trial < 25; ++trial) {
    const double cell_m = trial % 3 == 0 ? 10.0 : 30.0;
    const int size = static_cast<int>(1200.0 / cell_m);
    map::Map map =
        test::make_map(size, size, cell_m, [&](double, double) { return uniform(0.0, 120.0); });
    for (auto& value : map.visibility.values()) {
      value = static_cast<std::uint16_t>(uniform(0.0, 65534.0));
    }
    for (auto& value : map.semantics.values()) {
      value = uniform(0.0, 1.0) < 0.3 ? static_cast<std::uint16_t>(map::SemanticClass::kSettlement)
                                      : std::uint16_t{0};
    }
    map.surface_m.at(size / 2, size / 3) = std::numeric_limits<float>::quiet_NaN();
    const risk::CostModel costs = test::test_costs(map);
    HistogramOptions options = usual_options();
    options.sectors = std::vector<int>{8, 31, 64, 90}[static_cast<std::size_t>(trial % 4)];
    options.window_m = uniform(150.0, 350.0);
    options.disc_radius_m = uniform(5.0, 60.0);
    options.near_distance_m = uniform(5.0, 30.0);
    options.is_arc_widened = trial % 2 == 0;
    const Surroundings surroundings(costs, options.window_m, options.disc_radius_m, 0.7, 0.4);
    HistogramKernel kernel(surroundings, options);
    PolarHistogram histogram;
    for (int place = 0; place < 4; ++place) {
      const geo::MapPoint p{uniform(30.0, 1170.0), uniform(30.0, 1170.0)};
      const double z = uniform(40.0, 160.0);
      const double chi = uniform(-kPi, kPi);
      const double r_min = uniform(40.0, 300.0);
      kernel.compute(p, z, chi, r_min, histogram);
      const geo::MapPoint seen_from = centre_of_part(p, cell_m, 4.0);
      const HistogramOptions seen =
          with_larger_disc(options, 0.5 * std::numbers::sqrt2 * subcell_m(cell_m));
      const Oracle less = brute_force(map, costs, seen, 0.7, 0.4, seen_from, z, chi, r_min, -kEdge);
      const Oracle more = brute_force(map, costs, seen, 0.7, 0.4, seen_from, z, chi, r_min, kEdge);
      // Risks are seen from the centre of a larger square, with the disc as it is; nothing is
      // truncated.
      HistogramOptions of_risk = options;
      of_risk.truncation_distance_m = 0.0;
      const geo::MapPoint risk_from = centre_of_part(p, cell_m, 16.0);
      const Oracle less_risk =
          brute_force(map, costs, of_risk, 0.7, 0.4, risk_from, z, chi, r_min, -kEdge);
      const Oracle more_risk =
          brute_force(map, costs, of_risk, 0.7, 0.4, risk_from, z, chi, r_min, kEdge);
      EXPECT_TRUE(static_cast<double>(histogram.tan_climb_near) == less.near ||
                  std::fabs(histogram.tan_climb_near - less.near) <
                      kRounding * (1.0 + std::fabs(less.near)));
      for (std::size_t k = 0; k < less.climb.size(); ++k) {
        SCOPED_TRACE("sector " + std::to_string(k) + " of " + std::to_string(less.climb.size()));
        const auto expect_between = [&](float single, double low, double high) {
          const auto value = static_cast<double>(single);
          const double rounding = kRounding * (1.0 + std::fabs(value));
          EXPECT_TRUE(value == low || value == high ||
                      (value >= low - rounding && value <= high + rounding))
              << value << " not in [" << low << ", " << high << "]";
          undecided += low != high ? 1 : 0;
          ++compared;
        };
        expect_between(histogram.tan_climb[k], less.climb[k], more.climb[k]);
        expect_between(histogram.tan_mask[k], less.mask[k], more.mask[k]);
        expect_between(histogram.tan_masked[k], less.masked[k], more.masked[k]);
        if (less_risk.weight[k] == more_risk.weight[k]) {
          const double rounding = less_risk.cells[k] * kShareRounding;
          EXPECT_NEAR(histogram.risk_weight[k], less_risk.weight[k], rounding);
          if (less_risk.weight[k] > 0.0) {
            EXPECT_NEAR(histogram.risk[k], less_risk.risk[k],
                        1e-6 + 2.0 * (0.7 + 0.4) * rounding / less_risk.weight[k]);
          }
          ++risks;
        }
      }
    }
  }
  EXPECT_GT(compared, 10000);
  EXPECT_GT(risks, 3000);
  // One cell on an edge leaves all sectors undecided that its mask lies before.
  EXPECT_LT(undecided, compared / 100);
}

TEST(PolarHistogram, QuarterTurnOfTheTerrainTurnsTheHistogramByAQuarter) {
  const auto seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  constexpr int kSize = 40;
  map::Map map = test::make_map(kSize, kSize, 30.0, [&](double, double) {
    return std::uniform_real_distribution<double>(0.0, 100.0)(random);
  });
  for (auto& value : map.visibility.values()) {
    value = static_cast<std::uint16_t>(random() % 65535);
  }
  map::Map turned = map;
  for (int row = 0; row < kSize; ++row) {
    for (int column = 0; column < kSize; ++column) {
      turned.surface_m.at(kSize - 1 - row, column) = map.surface_m.at(column, row);
      turned.visibility.at(kSize - 1 - row, column) = map.visibility.at(column, row);
    }
  }
  const double half_m = 15.0 * kSize;
  const geo::MapPoint p{half_m + 37.0, half_m - 11.0};
  const geo::MapPoint turned_p{half_m + 11.0, half_m + 37.0};
  const risk::CostModel costs = test::test_costs(map);
  const risk::CostModel turned_costs = test::test_costs(turned);
  const Surroundings around(costs, 350.0, 45.0, 1.0, 1.0);
  const Surroundings turned_around(turned_costs, 350.0, 45.0, 1.0, 1.0);
  HistogramKernel kernel(around, usual_options());
  HistogramKernel turned_kernel(turned_around, usual_options());
  PolarHistogram before;
  PolarHistogram after;
  kernel.compute(p, 90.0, 0.3, 282.0, before);
  turned_kernel.compute(turned_p, 90.0, 0.3 + 0.5 * kPi, 282.0, after);
  for (std::size_t k = 0; k < 64; ++k) {
    EXPECT_NEAR(after.tan_masked[(k + 16) % 64], before.tan_masked[k], 1e-4) << k;
    EXPECT_NEAR(after.risk[(k + 16) % 64], before.risk[k], 1e-5) << k;
  }
}

TEST(PolarHistogram, PeakToTheNorthNeedsTheClimbOfItsTopPlusClearance) {
  // One cell of 100 m, 210 m north of the helicopter over ground at 0 m.
  const auto map = test::make_map(41, 41, 30.0, [](double x_m, double y_m) {
    return std::fabs(x_m - 615.0) < 1.0 && std::fabs(y_m - 825.0) < 1.0 ? 100.0 : 0.0;
  });
  const risk::CostModel costs = test::test_costs(map);
  const Surroundings surroundings(costs, 350.0, 45.0, 0.0, 0.0);
  HistogramKernel kernel(surroundings, usual_options());
  PolarHistogram histogram;
  kernel.compute({615.0, 615.0}, 80.0, 0.5 * kPi, 282.0, histogram);
  // 100 + 18 - 80 m higher, 210 - 45 m away; 16 sectors of 5.625 degrees make the quarter to north.
  // The place is told apart by squares of 3.75 m: seen from the centre of its square, 1.875 m
  // further north and east, the disc is half a diagonal larger.
  const double disc_m = 45.0 + 0.5 * std::numbers::sqrt2 * 3.75;
  const double peak = 38.0 / (std::hypot(1.875, 208.125) - disc_m);
  EXPECT_NEAR(histogram.tan_climb[16], peak, 1e-6);
  EXPECT_GT(peak, 38.0 / 165.0);
  EXPECT_LT(peak, 38.0 / 160.0);
  // Ground passes 62 m below; the far edge of the disc at the window's edge binds.
  EXPECT_LT(histogram.tan_climb[0], 0.0);
  EXPECT_GE(histogram.tan_climb[0], -62.0 / (328.125 + disc_m));
  EXPECT_LT(histogram.tan_climb[48], 0.0);
  // asin(47.7 / 208) = 13.2 degrees: the disc covers sectors 14 to 18 and no more.
  for (const std::size_t k : {14U, 15U, 17U, 18U}) {
    EXPECT_NEAR(histogram.tan_climb[k], peak, 1e-6);
  }
  EXPECT_LT(histogram.tan_climb[13], 0.0);
  EXPECT_LT(histogram.tan_climb[19], 0.0);
}

TEST(PolarHistogram, LowGroundLimitsTheDescentAtTheFarEdgeOfItsDisc) {
  const auto map = test::make_map(41, 41, 30.0, [](double, double) { return 0.0; });
  const risk::CostModel costs = test::test_costs(map);
  const Surroundings surroundings(costs, 100.0, 45.0, 0.0, 0.0);
  HistogramOptions options = usual_options();
  options.window_m = 100.0;
  options.truncation_distance_m = 0.0;
  HistogramKernel kernel(surroundings, options);
  PolarHistogram histogram;
  kernel.compute({615.0, 615.0}, 118.0, 0.0, 282.0, histogram);
  // East: the furthest cells whose discs the line meets lie at (90, +-30) m; the line may be 100 m
  // lower where it leaves the furthest point of the disc, 45 m beyond the cell; seen from the
  // centre of the sub-cell, 1.875 m to the north-east.
  const double disc_m = 45.0 + 0.5 * std::numbers::sqrt2 * 3.75;
  EXPECT_NEAR(histogram.tan_climb[0], -100.0 / (std::hypot(88.125, 31.875) + disc_m), 1e-6);
}

TEST(PolarHistogram, WallOnTheArcMasksTheDirectionsBehindIt) {
  // A cell at (210, 90) m: delta = atan(90 / 210) = 23.2 degrees; its arc leads to 46.4 degrees.
  const auto map = test::make_map(61, 61, 30.0, [](double x_m, double y_m) {
    return std::fabs(x_m - 1125.0) < 1.0 && std::fabs(y_m - 1005.0) < 1.0 ? 500.0 : 0.0;
  });
  const risk::CostModel costs = test::test_costs(map);
  const Surroundings surroundings(costs, 350.0, 45.0, 0.0, 0.0);
  HistogramKernel kernel(surroundings, usual_options());
  PolarHistogram histogram;
  kernel.compute({915.0, 915.0}, 100.0, 0.0, 282.0, histogram);
  EXPECT_GT(histogram.tan_climb[4], 1.0) << "the wall itself, at 22.5 degrees";
  EXPECT_LT(histogram.tan_climb[8], 0.0) << "45 degrees are free on a straight line";
  EXPECT_GT(histogram.tan_masked[8], 1.0) << "but the arc to them leads through the wall";
  EXPECT_GT(histogram.tan_masked[16], 1.0) << "and so do those further round";
  EXPECT_LT(histogram.tan_masked[64 - 8], 0.0) << "the right is free";
  EXPECT_LT(histogram.tan_masked[0], 0.0) << "straight ahead as well";
  EXPECT_LT(histogram.tan_masked[32], 0.0) << "the rear can be reached by the right";
}

TEST(PolarHistogram, MapEdgeAndVoidsAreWalls) {
  map::Map map = test::make_map(41, 41, 30.0, [](double, double) { return 0.0; });
  map.surface_m.at(20, 26) = std::numeric_limits<float>::quiet_NaN();
  const risk::CostModel costs = test::test_costs(map);
  const Surroundings surroundings(costs, 350.0, 45.0, 0.0, 0.0);
  HistogramKernel kernel(surroundings, usual_options());
  PolarHistogram histogram;
  kernel.compute({615.0, 615.0}, 100.0, 0.5 * kPi, 282.0, histogram);
  EXPECT_GT(histogram.tan_climb[16], 10.0) << "the void 180 m north";
  EXPECT_LT(histogram.tan_climb[0], 0.0);
  kernel.compute({1200.0, 615.0}, 100.0, 0.0, 282.0, histogram);
  EXPECT_GT(histogram.tan_climb[0], 10.0) << "the edge 30 m east";
  EXPECT_LT(histogram.tan_climb[32], 0.0);
}

TEST(PolarHistogram, AsksForEnoughWhereverInItsSquareTheHelicopterIs) {
  const auto seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (int trial = 0; trial < 12; ++trial) {
    const double cell_m = trial % 2 == 0 ? 10.0 : 30.0;
    const int size = static_cast<int>(900.0 / cell_m);
    const auto map =
        test::make_map(size, size, cell_m, [&](double, double) { return uniform(0.0, 120.0); });
    const risk::CostModel costs = test::test_costs(map);
    HistogramOptions options = usual_options();
    options.window_m = 300.0;
    options.near_distance_m = 10.0;
    options.truncation_distance_m = 0.0;
    const Surroundings surroundings(costs, options.window_m, options.disc_radius_m, 0.0, 0.0);
    HistogramKernel kernel(surroundings, options);
    PolarHistogram histogram;
    for (int place = 0; place < 6; ++place) {
      const geo::MapPoint p{uniform(30.0, 870.0), uniform(30.0, 870.0)};
      const double z = uniform(40.0, 160.0);
      kernel.compute(p, z, 0.0, 282.0, histogram);
      HistogramOptions nearer = options;
      nearer.window_m -= 3.0;
      const Oracle exact = brute_force(map, costs, nearer, 0.0, 0.0, p, z, 0.0, 282.0, 0.0);
      for (std::size_t k = 0; k < exact.climb.size(); ++k) {
        const auto asked =
            static_cast<double>(std::max(histogram.tan_climb[k], histogram.tan_climb_near));
        EXPECT_GE(asked, exact.climb[k] - 5e-5 * (1.0 + std::fabs(asked))) << k;
      }
    }
  }
}

// One kernel against the plain form, bit by bit.
::testing::AssertionResult is_same(const PolarHistogram& a, const PolarHistogram& b, int sectors) {
  const auto size = static_cast<std::size_t>(sectors) * sizeof(float);
  const auto differs = [&](const std::vector<float>& left, const std::vector<float>& right) {
    return std::memcmp(left.data(), right.data(), size) != 0;
  };
  if (std::memcmp(&a.tan_climb_near, &b.tan_climb_near, sizeof(float)) != 0) {
    return ::testing::AssertionFailure() << "near";
  }
  for (const auto& [name, member] : {std::pair{"climb", &PolarHistogram::tan_climb},
                                     {"mask", &PolarHistogram::tan_mask},
                                     {"masked", &PolarHistogram::tan_masked},
                                     {"risk", &PolarHistogram::risk},
                                     {"risk weight", &PolarHistogram::risk_weight}}) {
    if (differs(a.*member, b.*member)) {
      return ::testing::AssertionFailure() << name;
    }
  }
  return ::testing::AssertionSuccess();
}

TEST(PolarHistogram, AllInstructionSetsGiveTheBitsOfThePlainForm) {
  const auto seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  std::vector<Kernel> kernels;
  for (const Kernel kernel : {Kernel::kBest, Kernel::kAvx2, Kernel::kAvx512}) {
    if (is_available(kernel)) {
      kernels.push_back(kernel);
    }
  }
  std::int64_t masked = 0;
  std::int64_t compared = 0;
  for (int trial = 0; trial < 60; ++trial) {
    const double cell_m = std::vector<double>{30.0, 10.0, 5.0, 24.3}[random() % 4];
    const int size = static_cast<int>(1200.0 / cell_m);
    // Whole metres: level ground at the very height that is aimed for comes up as well.
    map::Map map = test::make_map(size, size, cell_m,
                                  [&](double, double) { return std::floor(uniform(0.0, 120.0)); });
    for (auto& value : map.visibility.values()) {
      value = static_cast<std::uint16_t>(random() % 65535);
    }
    for (int i = 0; i < 5; ++i) {
      map.surface_m.at(static_cast<int>(random() % static_cast<std::uint64_t>(size)),
                       static_cast<int>(random() % static_cast<std::uint64_t>(size))) =
          std::numeric_limits<float>::quiet_NaN();
    }
    const risk::CostModel costs = test::test_costs(map);
    HistogramOptions options;
    options.window_m = uniform(100.0, 600.0);
    options.sectors = std::vector<int>{8, 16, 31, 32, 64, 90, 128, 256, 1024}[random() % 9];
    options.disc_radius_m = uniform(5.0, 60.0);
    options.safety_height_m = std::floor(uniform(0.0, 30.0));
    options.near_distance_m = uniform(1.0, 30.0);
    options.truncation_angle_rad = uniform(60.0, 180.0) * kPi / 180.0;
    options.truncation_distance_m = uniform(0.0, 200.0);
    options.arc_radius_max_factor = uniform(1.0, 8.0);
    options.is_arc_widened = random() % 2 == 0;
    const double c_vis = random() % 5 == 0 ? 0.0 : uniform(0.0, 30.0);
    const Surroundings surroundings(costs, options.window_m, options.disc_radius_m, 0.7 * c_vis,
                                    c_vis);
    HistogramKernel plain(surroundings, options);
    PolarHistogram expected;
    for (const Kernel kernel : kernels) {
      HistogramTable table(surroundings, options, histogram_tables(surroundings, options), kernel);
      PolarHistogram histogram;
      for (int place = 0; place < 12; ++place) {
        // Sub-cells and their edges, all over the map; some places outside it.
        geo::MapPoint p{uniform(-20.0, 1220.0), uniform(-20.0, 1220.0)};
        if (place % 4 == 0) {
          p = {std::floor(p.x_m / 7.5) * 7.5, std::floor(p.y_m / 7.5) * 7.5};
        }
        const double z = std::floor(uniform(10.0, 160.0));
        const double chi =
            place % 5 == 0 ? 0.5 * kPi * std::floor(uniform(-2.0, 2.0)) : uniform(-kPi, kPi);
        const double r_min = uniform(40.0, 300.0);
        const double reach_m =
            place % 3 == 0 ? uniform(50.0, 700.0) : std::numeric_limits<double>::infinity();
        plain.compute(p, z, chi, r_min, expected, reach_m);
        table.compute(p, z, chi, r_min, histogram, reach_m);
        ASSERT_TRUE(is_same(histogram, expected, options.sectors))
            << name_of_kernel(kernel) << ", cells of " << cell_m << " m, " << options.sectors
            << " sectors, place " << p.x_m << ", " << p.y_m;
        for (int k = 0; k < options.sectors; ++k) {
          masked += expected.tan_mask[static_cast<std::size_t>(k)] > kNothing ? 1 : 0;
          ++compared;
        }
      }
    }
  }
  EXPECT_GT(masked, compared / 20);
}

TEST(Sectors, DirectionAndAngleNameTheSameSector) {
  const auto seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  for (const int count : {8, 9, 32, 64, 100, 1024}) {
    const Sectors sectors(count);
    for (int i = 0; i < 20000; ++i) {
      const double angle = std::uniform_real_distribution<double>(-kPi, kPi)(random);
      const double length = std::exp(std::uniform_real_distribution<double>(-9.0, 9.0)(random));
      const double in_sectors = angle / (2.0 * kPi / count);
      const double to_edge = std::fabs(in_sectors - std::floor(in_sectors) - 0.5);
      if (to_edge < 1e-9) {
        continue;
      }
      const int expected = (static_cast<int>(std::lround(in_sectors)) + count) % count;
      ASSERT_EQ(sectors.of_direction(length * std::cos(angle), length * std::sin(angle)), expected);
      ASSERT_EQ(sectors.of_angle(angle + 4.0 * kPi), expected);
    }
    EXPECT_EQ(sectors.of_direction(1.0, 0.0), 0);
    EXPECT_EQ(sectors.of_direction(1.0, -0.0), 0);
    EXPECT_EQ(sectors.of_direction(1.0, -1e-300), 0);
    EXPECT_EQ(sectors.of_direction(0.0, 0.0), 0);
  }
  EXPECT_THROW(Sectors(7), std::invalid_argument);
  EXPECT_THROW(Sectors(1025), std::invalid_argument);
}

}  // namespace
}  // namespace hedgehop::local_planning
