// The terms of a cost that eq. (1) of the paper does not have.

#include <array>
#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <random>

#include "risk/cost_model.hpp"
#include "risk/ground_slope.hpp"
#include "risk/wire_crossings.hpp"
#include "support/fractal_terrain.hpp"
#include "support/fresh_seed.hpp"
#include "support/test_map.hpp"

namespace hedgehop::risk {
namespace {

using geo::MapPoint;

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
const SemanticCostTable kFree({}, 0.0);

map::Map plane(double slope_east, double slope_north = 0.0) {
  return test::make_map(100, 100, 30.0, [=](double x_m, double y_m) {
    return 100.0 + slope_east * x_m + slope_north * y_m;
  });
}

CostWeights soft_ceiling(double height_m, double weight_1pm) {
  return {.soft_ceiling_m = height_m, .soft_ceiling_1pm = weight_1pm};
}

map::OverheadLine line_of(std::initializer_list<MapPoint> supports) {
  map::OverheadLine line;
  for (const MapPoint& point : supports) {
    line.supports.push_back({point, 20.0, true});
  }
  return line;
}

TEST(SoftCeiling, EachMetreAboveItCostsItsWeightAndBelowItNothing) {
  const map::Map map = plane(0.0);
  const CostModel costs(map, soft_ceiling(60.0, 0.02), kFree, 1.0);
  // 20 m above it for 600 m; exactly at it; 40 m below it.
  const auto level = [&](double height_m) {
    return costs.route_cost({{300, 300, 100 + height_m}, {900, 300, 100 + height_m}}, 7.0);
  };
  EXPECT_NEAR(level(80.0).soft_ceiling_m, 0.02 * 20.0 * 600.0, 1e-6);
  EXPECT_EQ(level(60.0).soft_ceiling_m, 0.0);
  EXPECT_EQ(level(20.0).soft_ceiling_m, 0.0);
  EXPECT_NEAR(level(80.0).total_m(), 600.0 + 240.0, 1e-6);
  // A climb from 40 to 100 m: two thirds of it above, 20 m on average.
  const double leg_m = std::hypot(600.0, 60.0);
  EXPECT_NEAR(costs.route_cost({{300, 300, 140.0}, {900, 300, 200.0}}, 1.0).soft_ceiling_m,
              0.02 * leg_m * (2.0 / 3.0) * 20.0, 1e-3);
  const MapPoint point = map.geometry.centre({50, 50});
  EXPECT_NEAR(costs.density(point, 90.0), 1.0 + 0.02 * 30.0, 1e-12);
  EXPECT_EQ(costs.density(point, 60.0), 1.0);
}

TEST(NamedThreats, AMetreCostsForEachObserverWhoSeesItAtItsHeight) {
  map::Map map = plane(0.0);
  // One sees all that is 30 m high west of x = 900 m, and nothing east of it; another sees what is
  // 50 m high everywhere but in the north, which is out of its range.
  map::HeightLayer west{"west", raster::Grid<float>(map.geometry, kNaN)};
  map::HeightLayer high{"high", raster::Grid<float>(map.geometry, 50.0F)};
  for (int row = 0; row < 100; ++row) {
    for (int column = 0; column < 100; ++column) {
      if (column < 30) {
        west.height_m.at(column, row) = 30.0F;
      }
      if (row >= 50) {
        high.height_m.at(column, row) = kNaN;
      }
    }
  }
  map.threats = {west, high};
  test::finish_map(map);
  map::validate(map);
  const CostModel costs(map, {.threats = 3.0}, kFree, 1.0);
  const auto across = [&](double height_m, double y_m) {
    return costs.route_cost({{300, y_m, 100 + height_m}, {1500, y_m, 100 + height_m}}, 1.0)
        .threats_m;
  };
  EXPECT_EQ(across(29.9, 300.0), 0.0);
  EXPECT_NEAR(across(30.0, 300.0), 3.0 * 600.0, 1e-6);
  EXPECT_NEAR(across(50.0, 300.0), 3.0 * (600.0 + 1200.0), 1e-6);
  EXPECT_NEAR(across(50.0, 2000.0), 3.0 * 600.0, 1e-6);
  EXPECT_NEAR(costs.density({450.0, 300.0}, 55.0), 1.0 + 2.0 * 3.0, 1e-12);
  // A climb out of hiding: from 20 to 40 m, half of it seen from the west.
  EXPECT_NEAR(costs.route_cost({{150, 300, 120.0}, {750, 300, 140.0}}, 1.0).threats_m,
              3.0 * 0.5 * std::hypot(600.0, 20.0), 3.0 * 0.51);
  EXPECT_TRUE(std::isnan(costs.route_cost({{-60, 300, 120}, {60, 300, 120}}, 1.0).threats_m));
  // Without a weight nobody asks.
  EXPECT_EQ(CostModel(map, {}, kFree, 1.0).route_cost({{300, 300, 160}, {900, 300, 160}}, 1.0),
            (flight::RouteCost{600.0}));
}

TEST(NamedThreats, AModelThatTookInAChangeIsThatOfTheChangedMap) {
  const auto seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  map::Map map = plane(0.0);
  const auto fill = [&](map::HeightLayer& layer, const raster::Window& window) {
    for (int row = window.row; row < window.row + window.rows; ++row) {
      for (int column = window.column; column < window.column + window.columns; ++column) {
        layer.height_m.at(column, row) =
            random() % 3 == 0 ? kNaN : static_cast<float>(random() % 100);
      }
    }
  };
  for (const char* name : {"a", "b", "c"}) {
    map.threats.push_back({name, raster::Grid<float>(map.geometry, kNaN)});
    fill(map.threats.back(), {0, 0, 100, 100});
  }
  CostModel costs(map, {.threats = 2.0}, kFree, 1.0);
  const raster::Window changed{20, 30, 15, 9};
  fill(map.threats[1], changed);
  costs.visibility_changed(changed);
  const CostModel anew(map, {.threats = 2.0}, kFree, 1.0);
  for (std::size_t cell = 0; cell < 10000; ++cell) {
    for (const double height_m : {0.0, 17.0, 55.5, 99.0}) {
      // By definition, layer by layer.
      int seeing = 0;
      for (const map::HeightLayer& layer : map.threats) {
        seeing += static_cast<double>(layer.height_m.values()[cell]) <= height_m ? 1 : 0;
      }
      ASSERT_EQ(costs.threat_density(cell, height_m), 2.0 * seeing);
      ASSERT_EQ(anew.threat_density(cell, height_m), 2.0 * seeing);
    }
  }
}

TEST(WireCrossings, CostNothingOverAPoleAndAllInTheMiddleOfASpan) {
  const WireCrossings wires({line_of({{1000, 1000}, {1400, 1000}, {1400, 1600}})});
  const auto north = [&](double x_m) { return wires.weight({x_m, 500}, {x_m, 1300}); };
  EXPECT_NEAR(north(1200.0), 1.0, 1e-12);
  EXPECT_NEAR(north(1100.0), 0.5, 1e-12);  // a quarter of the span from its pole
  EXPECT_NEAR(north(1390.0), 0.05, 1e-12);
  EXPECT_NEAR(north(1000.0), 0.0, 1e-12);
  EXPECT_EQ(north(999.0), 0.0);
  EXPECT_EQ(wires.weight({1200, 500}, {1200, 999}), 0.0) << "ends before it";
  EXPECT_EQ(wires.weight({1200, 700}, {1200, 700}), 0.0);
  // Both spans, obliquely: the first at x = 1300, the second at y = 1100.
  EXPECT_NEAR(wires.weight({1200, 900}, {1500, 1200}), 2.0 * 100.0 / 400.0 + 2.0 * 100.0 / 600.0,
              1e-12);
  EXPECT_TRUE(WireCrossings().is_empty());
  EXPECT_EQ(WireCrossings().weight({0, 0}, {1e4, 1e4}), 0.0);
}

TEST(WireCrossings, AWireRightBelowAWaypointCountsOnce) {
  const WireCrossings wires({line_of({{1000, 1000}, {1400, 1000}})});
  const MapPoint on{1200.0, 1000.0};
  EXPECT_NEAR(wires.weight({1150, 700}, on) + wires.weight(on, {1180, 1400}), 1.0, 1e-12);
  EXPECT_NEAR(wires.weight({1180, 1400}, on) + wires.weight(on, {1150, 700}), 1.0, 1e-12);
  // A track that turns back there crosses it twice or never.
  const double back = wires.weight({1150, 700}, on) + wires.weight(on, {1250, 700});
  EXPECT_TRUE(back == 0.0 || back == 2.0) << back;
}

TEST(WireCrossings, AreThoseOfEverySpanTriedByItself) {
  const auto seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> place(-3000.0, 9000.0);
  std::uniform_real_distribution<double> step(-700.0, 700.0);
  std::vector<map::OverheadLine> lines;
  for (int i = 0; i < 60; ++i) {
    map::OverheadLine line = line_of({{place(random), place(random)}});
    for (int k = 0; k < 5; ++k) {
      const MapPoint& last = line.supports.back().point;
      line.supports.push_back({{last.x_m + step(random), last.y_m + step(random)}, 20.0, true});
    }
    lines.push_back(line);
  }
  const WireCrossings wires(lines);
  double sum = 0.0;
  for (int round = 0; round < 500; ++round) {
    const MapPoint a{place(random), place(random)};
    const double share = round % 3 == 0 ? 1.0 : 0.05;  // long tracks and short ones
    const MapPoint b{a.x_m + share * (place(random) - a.x_m),
                     a.y_m + share * (place(random) - a.y_m)};
    double expected = 0.0;
    for (const map::OverheadLine& line : lines) {
      for (std::size_t i = 1; i < line.supports.size(); ++i) {
        const MapPoint& p = line.supports[i - 1].point;
        const MapPoint& q = line.supports[i].point;
        // a + t (b - a) = p + u (q - p), by Cramer's rule.
        const double det = (b.x_m - a.x_m) * (p.y_m - q.y_m) - (b.y_m - a.y_m) * (p.x_m - q.x_m);
        const double t =
            ((p.x_m - a.x_m) * (p.y_m - q.y_m) - (p.y_m - a.y_m) * (p.x_m - q.x_m)) / det;
        const double u =
            ((b.x_m - a.x_m) * (p.y_m - a.y_m) - (b.y_m - a.y_m) * (p.x_m - a.x_m)) / det;
        if (t > 0.0 && t < 1.0 && u > 0.0 && u < 1.0) {
          expected += u < 0.5 ? 2.0 * u : 2.0 - 2.0 * u;
        }
      }
    }
    EXPECT_NEAR(wires.weight(a, b), expected, 1e-9);
    EXPECT_NEAR(wires.weight(b, a), expected, 1e-9);
    sum += expected;
  }
  EXPECT_GT(sum, 10.0);
}

TEST(WireCrossings, ARoutePaysTheWeightOfEachInMetres) {
  map::Map map = plane(0.0);
  map.overhead_lines = {line_of({{1000, 1000}, {1400, 1000}})};
  test::finish_map(map);
  const CostModel costs(map, {.wire_crossing_m = 800.0}, kFree, 1.0);
  const flight::RouteCost cost =
      costs.route_cost({{1100, 600, 150}, {1100, 1200, 150}, {1200, 600, 150}}, 10.0);
  // Over at a quarter of the span, and back where the second leg is at y = 1000: x = 1133.3.
  EXPECT_NEAR(cost.wire_crossings_m, 800.0 * (0.5 + 2.0 * (100.0 + 100.0 / 3.0) / 400.0), 1e-6);
  EXPECT_EQ(CostModel(map, {}, kFree, 1.0).has_wires(), false);
}

TEST(GroundSlopes, OfAPlaneAreItsOwnUpToItsEdgesAndBesideUnknownCells) {
  for (const double cell_m : {10.0, 30.0, 200.0}) {
    raster::Grid<float> terrain({0.0, 0.0, cell_m, 20, 15}, 0.0F);
    for (int row = 0; row < 15; ++row) {
      for (int column = 0; column < 20; ++column) {
        terrain.at(column, row) = static_cast<float>(500.0 + cell_m * (0.25 * column - 0.5 * row));
      }
    }
    terrain.at(7, 7) = kNaN;
    const auto slopes = ground_slopes(terrain);
    ASSERT_EQ(slopes.size(), 300U);
    for (std::size_t i = 0; i < slopes.size(); ++i) {
      if (i == 7 * 20 + 7) {
        EXPECT_TRUE(std::isnan(slopes[i][0]) && std::isnan(slopes[i][1]));
        continue;
      }
      EXPECT_NEAR(slopes[i][0], 0.25F, 1e-5) << i << " of " << cell_m;
      EXPECT_NEAR(slopes[i][1], -0.5F, 1e-5) << i << " of " << cell_m;
    }
  }
}

TEST(GroundSlopes, AreUnknownWhereTheCellsKnownLieInARow) {
  raster::Grid<float> terrain({0.0, 0.0, 30.0, 9, 9}, kNaN);
  for (int column = 0; column < 9; ++column) {
    terrain.at(column, 4) = static_cast<float>(column);
  }
  EXPECT_TRUE(std::isnan(ground_slopes(terrain)[4 * 9 + 4][0]));
}

TEST(Slope, ALegOverAPlaneCostsTheSquareOfItsSlopeAlongTheWay) {
  const double kSlope = 0.3;
  const map::Map map = plane(kSlope);
  const CostModel costs(map, {.slope_along = 25.0}, kFree, 1.0);
  for (const double angle_deg : {0.0, 20.0, 45.0, 73.0, 90.0, 180.0, 230.0}) {
    const double angle = angle_deg * std::acos(-1.0) / 180.0;
    // 40 m above the ground all the way; the angle is that from straight up the hill.
    const auto waypoint = [&](double along_m) {
      const double x_m = 1500.0 + along_m * std::cos(angle);
      return flight::Waypoint{x_m, 1500.0 + along_m * std::sin(angle), 140.0 + kSlope * x_m};
    };
    const double along = kSlope * std::cos(angle);
    const double length_m = 1000.0 * std::sqrt(1.0 + along * along);
    const flight::RouteCost cost = costs.route_cost({waypoint(-500.0), waypoint(500.0)}, 10.0);
    EXPECT_NEAR(cost.slope_m, 25.0 * along * along * length_m, 1e-4 * length_m) << angle_deg;
  }
}

TEST(Slope, TheCheapestWayUpAPlaneIsAsSteepAsTheWeightSaysAndNotSteeper) {
  // Up 120 m on a slope of 0.3, seen from above: the cost at an angle a from straight up is
  // (1 + c s^2 cos^2 a) / cos a per metre up, least where s cos a = 1 / sqrt(c) = 0.2.
  const map::Map map = plane(0.3);
  const CostModel costs(map, {.slope_along = 25.0}, kFree, 1.0);
  double best_m = std::numeric_limits<double>::infinity();
  double best_slope = 0.0;
  for (int k = 0; k < 75; ++k) {
    const double angle = k * std::acos(-1.0) / 180.0;
    const double aside_m = 400.0 * std::tan(angle);
    const double cost_m =
        costs.directed_cost_m({1300, 1500.0 - 0.5 * aside_m}, {1700, 1500.0 + 0.5 * aside_m}) +
        std::hypot(400.0, aside_m);
    if (cost_m < best_m) {
      best_m = cost_m;
      best_slope = 0.3 * std::cos(angle);
    }
  }
  EXPECT_NEAR(best_slope, 0.2, 0.005);
}

TEST(BeyondCosts, OfARouteAreThoseOfAPlainSumInSmallSteps) {
  const auto seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  map::Map map = test::make_fractal_map(seed, 100, 30.0, 800.0, 250.0);
  for (const char* name : {"a", "b"}) {
    map.threats.push_back({name, raster::Grid<float>(map.geometry, kNaN)});
    for (float& value : map.threats.back().height_m.values()) {
      value = random() % 4 == 0 ? kNaN : static_cast<float>(random() % 150);
    }
  }
  map.overhead_lines = {line_of({{200, 900}, {900, 1500}, {2000, 1400}, {2800, 2300}})};
  test::finish_map(map);
  const CostWeights weights{25.0, 0.02, 4.0, 0.01, 70.0, 0.03, 2.5, 600.0, 12.0};
  const CostModel costs(map, weights, kFree, 1.0);
  std::uniform_real_distribution<double> place(150.0, 2850.0);
  std::uniform_real_distribution<double> height(20.0, 140.0);
  const auto surface_m = [&](double x_m, double y_m) {
    const double u = x_m / 30.0 - 0.5;
    const double v = y_m / 30.0 - 0.5;
    const int i = static_cast<int>(u);
    const int j = static_cast<int>(v);
    const auto z = [&](int c, int r) { return static_cast<double>(map.surface_m.at(c, r)); };
    return (1 - (v - j)) * ((1 - (u - i)) * z(i, j) + (u - i) * z(i + 1, j)) +
           (v - j) * ((1 - (u - i)) * z(i, j + 1) + (u - i) * z(i + 1, j + 1));
  };
  // Central differences of means of the five rows and columns around: another way to the same
  // plane.
  const auto slope = [&](int column, int row) {
    double east = 0.0;
    double north = 0.0;
    for (int r = -2; r <= 2; ++r) {
      for (int c = -2; c <= 2; ++c) {
        const auto z = static_cast<double>(map.terrain_m.at(column + c, row + r));
        east += c * z;
        north += r * z;
      }
    }
    return std::array<double, 2>{east / 50.0 / 30.0, north / 50.0 / 30.0};
  };
  for (int round = 0; round < 10; ++round) {
    const MapPoint from{place(random), place(random)};
    const MapPoint to{place(random), place(random)};
    const flight::Waypoint a{from.x_m, from.y_m, surface_m(from.x_m, from.y_m) + height(random)};
    const flight::Waypoint b{to.x_m, to.y_m, surface_m(to.x_m, to.y_m) + height(random)};
    const double track_m = std::hypot(b.x_m - a.x_m, b.y_m - a.y_m);
    const double length_m = std::hypot(track_m, b.altitude_m - a.altitude_m);
    const int steps = static_cast<int>(length_m / 0.02);
    flight::RouteCost expected;
    for (int k = 0; k < steps; ++k) {
      const double t = (k + 0.5) / steps;
      const double x_m = a.x_m + t * (b.x_m - a.x_m);
      const double y_m = a.y_m + t * (b.y_m - a.y_m);
      const double height_m =
          a.altitude_m + t * (b.altitude_m - a.altitude_m) - surface_m(x_m, y_m);
      const int column = static_cast<int>(x_m / 30.0);
      const int row = static_cast<int>(y_m / 30.0);
      const double ds_m = length_m / steps;
      expected.soft_ceiling_m += height_m > 70.0 ? 0.03 * (height_m - 70.0) * ds_m : 0.0;
      for (const map::HeightLayer& layer : map.threats) {
        expected.threats_m +=
            height_m >= static_cast<double>(layer.height_m.at(column, row)) ? 2.5 * ds_m : 0.0;
      }
      const auto g = slope(column, row);
      const double along = (g[0] * (b.x_m - a.x_m) + g[1] * (b.y_m - a.y_m)) / track_m;
      expected.slope_m += 12.0 * along * along * ds_m;
    }
    const flight::RouteCost found = costs.route_cost({a, b}, 1.0);
    EXPECT_NEAR(found.soft_ceiling_m, expected.soft_ceiling_m, 1e-3 * length_m);
    EXPECT_NEAR(found.slope_m, expected.slope_m, 5e-3 * length_m);
    EXPECT_NEAR(found.threats_m, expected.threats_m, 0.02 * length_m + 2.0);
    EXPECT_NEAR(found.total_m(),
                found.length_m + found.visibility_m + found.height_m + found.soft_ceiling_m +
                    found.threats_m + found.wire_crossings_m + found.slope_m,
                1e-9 * found.total_m());
    EXPECT_EQ(costs.reweighted(25.0, 4.0).route_cost({a, b}, 1.0), found);
  }
}

TEST(BeyondCosts, NegativeWeightsAreRefused) {
  for (const char* key :
       {"soft_ceiling_m", "soft_ceiling_1pm", "threats", "wire_crossing_m", "slope_along"}) {
    std::string text =
        "visibility: 25\nvisibility_per_height_1pm: 0.02\nsemantics: 4\n"
        "height_1pm: 0.01\n";
    for (const char* other :
         {"soft_ceiling_m", "soft_ceiling_1pm", "threats", "wire_crossing_m", "slope_along"}) {
      text += std::string(other) + (other == std::string(key) ? ": -0.1\n" : ": 0.1\n");
    }
    auto reader = ConfigReader::from_text(text, "test.yaml");
    try {
      read_weights(reader);
      FAIL() << key;
    } catch (const ConfigError& error) {
      EXPECT_NE(std::string(error.what()).find(key), std::string::npos) << error.what();
    }
  }
}

}  // namespace
}  // namespace hedgehop::risk
