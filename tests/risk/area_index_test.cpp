#include "risk/area_index.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <random>

#include "support/fresh_seed.hpp"
#include "support/test_map.hpp"

namespace hedgehop::risk {
namespace {

using Reference = map::AreaLimit::Reference;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr map::AreaLimit kGround{-kInfinity, Reference::kAboveGround};
constexpr map::AreaLimit kNoEnd{kInfinity, Reference::kAmsl};

map::Area rectangle(double west_m, double south_m, double east_m, double north_m) {
  map::Area area;
  area.floor = kGround;
  area.ceiling = kNoEnd;
  area.polygons = {{{{west_m, south_m},
                     {east_m, south_m},
                     {east_m, north_m},
                     {west_m, north_m},
                     {west_m, south_m}},
                    {}}};
  return area;
}

map::Map slope_with(std::vector<map::Area> areas) {
  map::Map map = test::make_map(60, 50, 30.0, [](double x_m, double) { return 100.0 + 0.1 * x_m; });
  map.areas = std::move(areas);
  test::finish_map(map);
  return map;
}

TEST(AreaIndex, PointsInsideOnAndOutsideTheEdgesAndInAHole) {
  map::Area area = rectangle(300.0, 300.0, 900.0, 900.0);
  area.polygons[0].holes = {{{500, 500}, {600, 500}, {600, 600}, {500, 600}, {500, 500}}};
  const map::Map map = slope_with({area});
  const AreaIndex index(map);
  const auto is_in = [&](double x_m, double y_m) {
    return index.hard_area_at({x_m, y_m}, 200.0) != nullptr;
  };
  EXPECT_TRUE(is_in(301.0, 301.0));
  EXPECT_TRUE(is_in(300.0, 450.0));
  EXPECT_TRUE(is_in(900.0, 900.0));
  EXPECT_FALSE(is_in(299.9, 450.0));
  EXPECT_FALSE(is_in(900.1, 450.0));
  EXPECT_FALSE(is_in(550.0, 550.0));
  EXPECT_TRUE(is_in(500.0, 550.0));  // the edge of the hole belongs to the area
  EXPECT_FALSE(is_in(-5.0, 450.0));
  EXPECT_EQ(index.list_at({0, 0}), 0U);
  EXPECT_NE(index.list_at({12, 12}), 0U);
}

TEST(AreaIndex, LimitsCountFromTheSeaOrFromTheGroundBelow) {
  map::Area area = rectangle(300.0, 300.0, 900.0, 900.0);
  area.floor = {50.0, Reference::kAboveGround};
  area.ceiling = {300.0, Reference::kAmsl};
  const map::Map map = slope_with({area});
  const AreaIndex index(map);
  // The ground at x = 600 lies at 160 m.
  EXPECT_EQ(index.hard_area_at({600.0, 600.0}, 209.0), nullptr);
  EXPECT_EQ(index.hard_area_at({600.0, 600.0}, 211.0), &map.areas[0]);
  EXPECT_EQ(index.hard_area_at({600.0, 600.0}, 299.0), &map.areas[0]);
  EXPECT_EQ(index.hard_area_at({600.0, 600.0}, 301.0), nullptr);
  // A leg above the rising ground meets the floor where 205 m are 50 m above it: never; at 210:
  // yes.
  EXPECT_EQ(index.hard_area_on({100.0, 600.0, 175.0}, {1100.0, 600.0, 175.0}), nullptr);
  EXPECT_NE(index.hard_area_on({100.0, 600.0, 185.0}, {1100.0, 600.0, 185.0}), nullptr);
}

TEST(AreaIndex, SoftAndHardAreasAreToldApartAndTheFirstOneCounts) {
  map::Area soft = rectangle(300.0, 300.0, 900.0, 900.0);
  soft.is_hard = false;
  const map::Area first = rectangle(600.0, 300.0, 900.0, 900.0);
  const map::Area second = rectangle(750.0, 300.0, 1200.0, 900.0);
  const map::Map map = slope_with({soft, first, second});
  const AreaIndex index(map);
  EXPECT_TRUE(index.is_in_soft_area({400.0, 400.0}, 200.0));
  EXPECT_EQ(index.hard_area_at({400.0, 400.0}, 200.0), nullptr);
  EXPECT_EQ(index.hard_area_at({800.0, 400.0}, 200.0), &map.areas[1]);
  EXPECT_EQ(index.hard_area_at({1000.0, 400.0}, 200.0), &map.areas[2]);
  EXPECT_FALSE(index.is_in_soft_area({1000.0, 400.0}, 200.0));
  EXPECT_EQ(index.hard_area_on({400.0, 400.0, 200.0}, {580.0, 400.0, 200.0}), nullptr);
  EXPECT_EQ(index.hard_area_on({400.0, 400.0, 200.0}, {1500.0, 400.0, 200.0}), &map.areas[1]);
}

TEST(AreaIndex, ALegThatCutsACornerOfLessThanAMetreIsFound) {
  const map::Map map = slope_with({rectangle(300.0, 300.0, 900.0, 900.0)});
  const AreaIndex index(map);
  EXPECT_NE(index.hard_area_on({299.5, 200.0, 200.0}, {300.5, 1000.0, 200.0}), nullptr);
  EXPECT_NE(index.hard_area_on({100.0, 500.2, 200.0}, {500.2, 100.0, 200.0}), nullptr);  // corner
  EXPECT_EQ(index.hard_area_on({100.0, 499.8, 200.0}, {499.8, 100.0, 200.0}), nullptr);
  EXPECT_NE(index.hard_area_on({100.0, 900.0, 200.0}, {1000.0, 900.0, 200.0}), nullptr);  // edge
  EXPECT_NE(index.hard_area_on({500.0, 500.0, 200.0}, {510.0, 500.0, 200.0}), nullptr);
}

TEST(AreaIndex, LegsAgreeWithADenseRowOfPoints) {
  std::mt19937_64 random(test::fresh_seed());
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  int entered = 0;
  for (int round = 0; round < 400; ++round) {
    // GIVEN a star-shaped area with a hole, its limits of any reference
    map::Area area;
    const geo::MapPoint centre{uniform(400.0, 1400.0), uniform(400.0, 1100.0)};
    std::vector<geo::MapPoint> outer;
    std::vector<geo::MapPoint> hole;
    for (int i = 0; i < 9; ++i) {
      const double angle = 2.0 * 3.14159265358979 * i / 9.0;
      const double radius_m = uniform(60.0, 350.0);
      outer.push_back(
          {centre.x_m + radius_m * std::cos(angle), centre.y_m + radius_m * std::sin(angle)});
      hole.push_back({centre.x_m + 40.0 * std::cos(angle), centre.y_m + 40.0 * std::sin(angle)});
    }
    outer.push_back(outer.front());
    hole.push_back(hole.front());
    area.polygons = {{outer, {hole}}};
    const auto reference = round % 2 == 0 ? Reference::kAmsl : Reference::kAboveGround;
    const double shift_m = reference == Reference::kAmsl ? 150.0 : 0.0;
    area.floor = {shift_m + uniform(20.0, 60.0), reference};
    area.ceiling = {area.floor.value_m + uniform(5.0, 60.0), reference};
    const map::Map map = slope_with({area});
    const AreaIndex index(map);
    const auto end = [&] {
      return flight::Waypoint{uniform(50.0, 1750.0), uniform(50.0, 1450.0), uniform(150.0, 320.0)};
    };
    const flight::Waypoint a = end();
    const flight::Waypoint b = end();
    // WHEN the leg is asked as a whole and point by point
    const bool whole = index.hard_area_on(a, b) != nullptr;
    bool points = false;
    for (int k = 0; k <= 4000 && !points; ++k) {
      const double t = k / 4000.0;
      points = index.hard_area_at({a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m)},
                                  a.altitude_m + t * (b.altitude_m - a.altitude_m)) != nullptr;
    }
    // THEN no point is inside without the leg; a leg alone may be a graze between two points
    if (points) {
      EXPECT_TRUE(whole) << round;
    } else if (whole) {
      const auto grown = [&](double by_m) {
        map::Map wider = map;
        wider.areas[0].floor.value_m -= by_m;
        wider.areas[0].ceiling.value_m += by_m;
        const AreaIndex wider_index(wider);
        for (int k = 0; k <= 4000; ++k) {
          const double t = k / 4000.0;
          for (const auto& [dx_m, dy_m] :
               {std::pair(0.0, 0.0), {by_m, 0.0}, {-by_m, 0.0}, {0.0, by_m}, {0.0, -by_m}}) {
            if (wider_index.hard_area_at(
                    {a.x_m + t * (b.x_m - a.x_m) + dx_m, a.y_m + t * (b.y_m - a.y_m) + dy_m},
                    a.altitude_m + t * (b.altitude_m - a.altitude_m)) != nullptr) {
              return true;
            }
          }
        }
        return false;
      };
      EXPECT_TRUE(grown(0.5)) << round;
    }
    entered += whole ? 1 : 0;
  }
  EXPECT_GT(entered, 20);
}

TEST(AreaIndex, EveryCellWithAPointOfAnAreaKnowsIt) {
  std::mt19937_64 random(test::fresh_seed());
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (int round = 0; round < 30; ++round) {
    map::Area area = rectangle(0, 0, 0, 0);
    const geo::MapPoint a{uniform(-100.0, 1900.0), uniform(-100.0, 1600.0)};
    const geo::MapPoint b{uniform(-100.0, 1900.0), uniform(-100.0, 1600.0)};
    const geo::MapPoint c{uniform(-100.0, 1900.0), uniform(-100.0, 1600.0)};
    area.polygons = {{{a, b, c, a}, {}}};
    const map::Map map = slope_with({area});
    const AreaIndex index(map);
    for (int k = 0; k < 500; ++k) {
      double u = uniform(0.0, 1.0);
      double v = uniform(0.0, 1.0);
      if (u + v > 1.0) {
        u = 1.0 - u;
        v = 1.0 - v;
      }
      const geo::MapPoint p{a.x_m + u * (b.x_m - a.x_m) + v * (c.x_m - a.x_m),
                            a.y_m + u * (b.y_m - a.y_m) + v * (c.y_m - a.y_m)};
      if (map.geometry.contains(p)) {
        ASSERT_NE(index.list_at(map.geometry.cell_at(p)), 0U) << p.x_m << " " << p.y_m;
      }
    }
  }
}

TEST(AreaIndex, FreeAirOverACellEndsBelowTheNextAreaAndBeginsAboveThoseThatReachUp) {
  map::Area low = rectangle(300.0, 300.0, 900.0, 900.0);
  low.ceiling = {220.0, Reference::kAmsl};
  map::Area middle = low;
  middle.floor = {215.0, Reference::kAmsl};
  middle.ceiling = {250.0, Reference::kAmsl};
  map::Area high = low;
  high.floor = {150.0, Reference::kAboveGround};
  high.ceiling = kNoEnd;
  map::Area soft = rectangle(0.0, 0.0, 1800.0, 1500.0);
  soft.is_hard = false;
  const map::Map map = slope_with({high, middle, low, soft});
  const AreaIndex index(map);
  // Column 20: ground 161.5 m at the centre, 158.5 m at the centre of the cell to the west.
  const AreaIndex::Span free = index.free_over({20, 20}, 180.0);
  EXPECT_GT(free.low_m, 250.0);
  EXPECT_NEAR(free.low_m, 250.0, 1e-6);
  EXPECT_NEAR(free.high_m, 158.5 + 150.0, 1e-4);
  EXPECT_NEAR(index.free_over({20, 20}, 260.0).low_m, 260.0, 0.0);
  EXPECT_EQ(index.free_over({20, 20}, 320.0).low_m, kInfinity);
  EXPECT_EQ(index.free_over({2, 2}, 120.0).low_m, 120.0);
  EXPECT_EQ(index.free_over({2, 2}, 120.0).high_m, kInfinity);
}

TEST(AreaIndex, ACellIsClosedOnlyIfOneAreaHoldsAllOfIt) {
  map::Area area = rectangle(300.0, 300.0, 905.0, 900.0);
  area.ceiling = {100.0, Reference::kAboveGround};
  const map::Map map = slope_with({area});
  const AreaIndex index(map);
  EXPECT_EQ(index.closing({20, 20}, {165.0, 250.0}), &map.areas[0]);
  // 100 m above the lower neighbour's ground of 158.5 m.
  EXPECT_EQ(index.closing({20, 20}, {165.0, 258.0}), &map.areas[0]);
  EXPECT_EQ(index.closing({20, 20}, {165.0, 259.0}), nullptr);
  EXPECT_EQ(index.closing({30, 20}, {165.0, 200.0}), nullptr);  // its east is free
  EXPECT_EQ(index.closing({2, 20}, {105.0, 120.0}), nullptr);
}

TEST(AreaIndex, UnknownGroundHoldsNothingBack) {
  map::Area area = rectangle(300.0, 300.0, 900.0, 900.0);
  area.floor = {500.0, Reference::kAboveGround};
  map::Map map = slope_with({area});
  map.terrain_m.at(20, 20) = std::numeric_limits<float>::quiet_NaN();
  const AreaIndex index(map);
  EXPECT_NE(index.hard_area_at({615.0, 615.0}, 200.0), nullptr);
  EXPECT_EQ(index.hard_area_at({400.0, 400.0}, 200.0), nullptr);
  EXPECT_NE(index.hard_area_on({560.0, 615.0, 200.0}, {700.0, 615.0, 200.0}), nullptr);
}

TEST(AreaIndex, WallsAreTheAreasThatBeginLow) {
  map::Area low = rectangle(300.0, 300.0, 900.0, 900.0);
  low.ceiling = {400.0, Reference::kAmsl};
  map::Area high = rectangle(900.0, 300.0, 1500.0, 900.0);
  high.floor = {200.0, Reference::kAboveGround};
  const map::Map map = slope_with({low, high});
  const AreaIndex index(map);
  EXPECT_EQ(index.wall_top_m({15, 15}, 40.0), 400.0);
  EXPECT_EQ(index.wall_top_m({40, 15}, 40.0), -kInfinity);
  EXPECT_EQ(index.wall_top_m({40, 15}, 220.0), kInfinity);
  EXPECT_EQ(index.wall_top_m({2, 2}, 40.0), -kInfinity);
}

TEST(AreaIndex, AMapWithoutAreasHasNone) {
  const map::Map map = slope_with({});
  const AreaIndex index(map);
  EXPECT_TRUE(index.is_empty());
  EXPECT_EQ(index.list_at({3, 3}), 0U);
  EXPECT_EQ(index.hard_area_at({100.0, 100.0}, 0.0), nullptr);
  EXPECT_EQ(index.hard_area_on({100.0, 100.0, 0.0}, {900.0, 100.0, 0.0}), nullptr);
}

}  // namespace
}  // namespace hedgehop::risk
