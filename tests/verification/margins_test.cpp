#include "verification/margins.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <limits>

#include "support/test_map.hpp"
#include "verification/area_entry.hpp"
#include "verification/perfect_flight.hpp"

namespace hedgehop::verification {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

Demands demands() {
  Demands demands;
  demands.required_clearance_m = 10.0;
  demands.ceiling_height_m = 120.0;
  demands.goal_radius_m = 60.0;
  demands.start_radius_m = 1.0;
  demands.via_radius_m = 250.0;
  return demands;
}

map::Map flat(double elevation_m = 100.0) {
  return test::make_map(200, 200, 30.0, [=](double, double) { return elevation_m; });
}

// To the north from (3000, 1000) at 40 m/s for 80 s, to y = 4200.
test::Manoeuvre northward(double altitude_m) {
  test::Manoeuvre manoeuvre;
  manoeuvre.x_m = 3000.0;
  manoeuvre.y_m = 1000.0;
  manoeuvre.altitude_m = altitude_m;
  manoeuvre.duration_s = 80.0;
  return manoeuvre;
}

Margins margins_of(const map::Map& map, const test::Manoeuvre& manoeuvre,
                   const std::vector<geo::MapPoint>& via = {}) {
  return measure_margins(map, test::fly(manoeuvre, map), via, test::test_limits(), demands());
}

const NearMiss* find(const Margins& margins, Hazard hazard) {
  for (const NearMiss& miss : margins.nearest) {
    if (miss.hazard == hazard) {
      return &miss;
    }
  }
  return nullptr;
}

TEST(Margins, QuantilesOfASteadyClimbFollowTheLength) {
  // 1 m/s up over flat ground: 20 m to 100 m of clearance, the same length at each of them.
  test::Manoeuvre climb = northward(120.0);
  climb.climb_rate_mps = test::Schedule(1.0);
  const Margins margins = margins_of(flat(), climb);
  const double step_m = 0.05;
  EXPECT_NEAR(margins.clearance_min_m, 20.0, 1e-6);
  EXPECT_NEAR(margins.clearance_p01_m, 20.8, step_m + 1e-6);
  EXPECT_NEAR(margins.clearance_p05_m, 24.0, step_m + 1e-6);
  EXPECT_NEAR(margins.clearance_median_m, 60.0, step_m + 1e-6);
  EXPECT_NEAR(margins.height_max_m, 100.0, 1e-6);
  EXPECT_NEAR(margins.ceiling_margin_m, 20.0, 1e-6);
  EXPECT_EQ(margins.unknown_share, 0.0);
  EXPECT_NEAR(margins.load_factor_max, 1.0, 1e-9);
}

TEST(Margins, HeightBetweenTwoStatesCounts) {
  // A ditch of one row of half-metre cells, 5 m deep, across the path; states lie 2 m apart.
  const map::Map map = test::make_map(
      400, 400, 0.5, [](double, double y_m) { return std::fabs(y_m - 101.25) < 0.1 ? -5.0 : 0.0; });
  test::Manoeuvre manoeuvre;
  manoeuvre.x_m = 100.0;
  manoeuvre.y_m = 100.25;
  manoeuvre.altitude_m = 14.0;
  manoeuvre.duration_s = 2.0;
  const Margins margins = margins_of(map, manoeuvre);
  EXPECT_NEAR(margins.height_max_m, 19.0, 1e-6);
  EXPECT_NEAR(margins.clearance_min_m, 14.0, 1e-6);
}

TEST(Margins, NearestOfEachKindIsAsFarAsGeometrySays) {
  map::Map map = flat();
  map::OverheadLine line;  // across the path at y = 2000, conductor at 130 m
  line.source_id = 42;
  line.supports = {{{2500.0, 2000.0}, 30.0}, {{3500.0, 2000.0}, 30.0}};
  map::OverheadLine far = line;  // 300 m beside it
  far.supports = {{{3300.0, 1000.0}, 80.0}, {{3300.0, 4000.0}, 80.0}};
  map.overhead_lines = {far, line};
  map::Obstacle mast;
  mast.name = "north mast";
  mast.point = {3060.0, 3000.0};
  mast.radius_m = 20.0;  // of which a part is the error of its position
  mast.height_m = 90.0;
  mast.top_m = 190.0;
  map.obstacles = {mast};
  map::Area area;  // begins 30 m west of the path and 40 m above it
  area.name = "CTR";
  area.floor = {190.0, map::AreaLimit::Reference::kAmsl};
  area.ceiling = {kInfinity, map::AreaLimit::Reference::kAmsl};
  area.polygons = {{{{2000, 3500}, {2970, 3500}, {2970, 3800}, {2000, 3800}, {2000, 3500}}, {}}};
  map.areas = {area};
  test::finish_map(map);
  const Margins margins = margins_of(map, northward(150.0));

  const NearMiss* ground = find(margins, Hazard::kGround);
  ASSERT_NE(ground, nullptr);
  EXPECT_NEAR(ground->distance_m, 50.0, 1e-6);
  const NearMiss* wire = find(margins, Hazard::kWire);
  ASSERT_NE(wire, nullptr);
  EXPECT_EQ(wire->name, "42");
  EXPECT_NEAR(wire->distance_m, 20.0, 1e-6);
  EXPECT_NEAR(wire->time_s, 25.0, 0.051);
  const NearMiss* obstacle = find(margins, Hazard::kObstacle);
  ASSERT_NE(obstacle, nullptr);
  EXPECT_EQ(obstacle->name, "north mast");
  EXPECT_NEAR(obstacle->distance_m, 40.0, 1e-5);
  EXPECT_NEAR(obstacle->time_s, 50.0, 0.051);
  const NearMiss* zone = find(margins, Hazard::kArea);
  ASSERT_NE(zone, nullptr);
  EXPECT_EQ(zone->name, "CTR");
  EXPECT_NEAR(zone->distance_m, 50.0, 1e-6);  // 30 m aside, 40 m below
  EXPECT_EQ(zone->required_m, 0.0);
  // Less the 10 m that are demanded of all but areas the wire leaves least.
  ASSERT_NE(margins.nearest_miss(), nullptr);
  EXPECT_EQ(margins.nearest_miss()->hazard, Hazard::kWire);
  EXPECT_NEAR(margins.nearest_miss()->spare_m(), 10.0, 1e-6);
}

TEST(Margins, WhatIsEnteredIsNearestWithNothing) {
  map::Map map = flat();
  map::Area area;
  area.floor = {-kInfinity, map::AreaLimit::Reference::kAmsl};
  area.ceiling = {60.0, map::AreaLimit::Reference::kAboveGround};
  area.polygons = {{{{2900, 3000}, {3100, 3000}, {3100, 3200}, {2900, 3200}, {2900, 3000}}, {}}};
  map.areas = {area};
  test::finish_map(map);
  const Margins entered = margins_of(map, northward(159.0));
  ASSERT_NE(entered.nearest_miss(), nullptr);
  EXPECT_EQ(entered.nearest_miss()->hazard, Hazard::kArea);
  EXPECT_EQ(entered.nearest_miss()->distance_m, 0.0);
  const Margins over = margins_of(map, northward(163.0));
  EXPECT_NEAR(find(over, Hazard::kArea)->distance_m, 3.0, 1e-6);
}

TEST(Margins, ViaPointsAreMeasuredWhereTheyArePassed) {
  const Margins margins =
      margins_of(flat(), northward(150.0), {{3120.0, 2000.0}, {2990.0, 4000.0}});
  ASSERT_EQ(margins.via.size(), 2U);
  EXPECT_NEAR(margins.via[0].distance_m, 120.0, 1e-6);
  EXPECT_NEAR(margins.via[0].time_s, 25.0, 0.051);
  EXPECT_NEAR(margins.via[1].distance_m, 10.0, 1e-6);
  EXPECT_NEAR(margins.via[1].time_s, 75.0, 0.051);
}

TEST(Margins, UnknownGroundIsAShareOfTheLengthAndNoClearance) {
  map::Map map = flat();
  for (int row = 70; row < 110; ++row) {
    for (int column = 99; column <= 101; ++column) {
      map.surface_m.at(column, row) = std::numeric_limits<float>::quiet_NaN();
      map.terrain_m.at(column, row) = std::numeric_limits<float>::quiet_NaN();
    }
  }
  test::finish_map(map);
  flight::Trajectory flight = test::fly(northward(150.0), map);
  for (flight::FlightState& state : flight.states) {
    state.surface_m = 100.0;
    state.terrain_m = 100.0;
  }
  const Margins margins = measure_margins(map, flight, {}, test::test_limits(), demands());
  // From the last known centre to the first: 41 cells of 30 m out of 3200 m.
  EXPECT_NEAR(margins.unknown_share, 41.0 * 30.0 / 3200.0, 2.0 * 2.0 / 3200.0);
  EXPECT_NEAR(margins.clearance_min_m, 50.0, 1e-6);
}

TEST(DistanceToPolygons, IsNothingInsideAndTheGapOutside) {
  map::Area area;
  area.polygons = {{{{0, 0}, {100, 0}, {100, 100}, {0, 100}, {0, 0}},
                    {{{40, 40}, {60, 40}, {60, 60}, {40, 60}, {40, 40}}}}};
  const auto distance_m = [&](double x_m, double y_m) {
    return distance_to_polygons_m(area, {x_m, y_m, 0.0}, {x_m + 1.0, y_m, 0.0});
  };
  EXPECT_EQ(distance_m(10.0, 10.0), 0.0);
  EXPECT_DOUBLE_EQ(distance_m(110.0, 50.0), 10.0);
  EXPECT_DOUBLE_EQ(distance_m(-4.0, -4.0), 5.0);
  EXPECT_DOUBLE_EQ(distance_m(50.0, 53.0), 7.0);  // in the hole
}

}  // namespace
}  // namespace hedgehop::verification
