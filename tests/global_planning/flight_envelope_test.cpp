#include "global_planning/flight_envelope.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <random>

#include "base/angles.hpp"
#include "global_planning/planning_case.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::global_planning {
namespace {

using flight::Waypoint;
using test::PlanningCase;
using test::shipped_global_options;

using test::kWeights;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Options with numbers that are easy to reckon with.
GlobalOptions plain_options() {
  GlobalOptions options = shipped_global_options();
  options.envelope_floor_m = 20.0;
  options.envelope_ceiling_m = 120.0;
  options.lateral_margin_m = 30.0;
  options.end_funnel_m = 400.0;
  options.climb_angle_max_rad = 8.0 * kDegree_rad;
  options.descent_angle_max_rad = 8.0 * kDegree_rad;
  options.turn_angle_max_rad = 60.0 * kDegree_rad;
  options.turn_radius_m = 0.0;
  return options;
}

// Ends far from what a test looks at, so that no funnel is near.
FlightEnvelope envelope_of(const PlanningCase& in, const GlobalOptions& options) {
  const double far_m = in.map.geometry.columns * in.map.geometry.cell_m - 100.0;
  return {in.costs, options, in.above(100.0, 100.0, 30.0), in.above(far_m, far_m, 30.0)};
}

TEST(DilatedSurface, OneHighCellRaisesItsEightNeighboursForAMarginOfOneCell) {
  raster::Grid<float> surface({0.0, 0.0, 30.0, 9, 9}, 10.0F);
  surface.at(4, 4) = 100.0F;
  const raster::Grid<float> dilated = dilated_surface(surface, 30.0);
  for (int row = 1; row < 8; ++row) {
    for (int column = 1; column < 8; ++column) {
      const bool is_near = std::abs(row - 4) <= 1 && std::abs(column - 4) <= 1;
      EXPECT_EQ(dilated.at(column, row), is_near ? 100.0F : 10.0F) << column << " " << row;
    }
  }
}

TEST(DilatedSurface, UnknownCellsAndTheEdgeMakeTheirSurroundingsUnknown) {
  raster::Grid<float> surface({0.0, 0.0, 30.0, 9, 9}, 10.0F);
  surface.at(4, 4) = std::numeric_limits<float>::quiet_NaN();
  const raster::Grid<float> dilated = dilated_surface(surface, 30.0);
  EXPECT_TRUE(std::isnan(dilated.at(3, 5)));
  EXPECT_FALSE(std::isnan(dilated.at(2, 5)));
  EXPECT_TRUE(std::isnan(dilated.at(0, 5)));
  EXPECT_TRUE(std::isnan(dilated.at(7, 8)));
}

TEST(DilatedSurface, EachCellIsTheGreatestOfItsNeighbourhoodOrUnknownWithOneOfThem) {
  const std::uint64_t seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const double margin_m : {5.0, 30.0, 47.0, 100.0}) {
    const int columns = 12 + static_cast<int>(random() % 40);
    const int rows = 12 + static_cast<int>(random() % 20);
    raster::Grid<float> surface({0.0, 0.0, 30.0, columns, rows}, 0.0F);
    for (float& value : surface.values()) {
      value = random() % 200 == 0 ? nan : static_cast<float>(random() % 1000) - 500.0F;
    }
    const raster::Grid<float> dilated = dilated_surface(surface, margin_m);
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        float greatest = -std::numeric_limits<float>::infinity();
        for (int by = -8; by <= 8; ++by) {
          for (int bx = -8; bx <= 8; ++bx) {
            const double dx_m = 30.0 * std::max(std::abs(bx) - 1, 0);
            const double dy_m = 30.0 * std::max(std::abs(by) - 1, 0);
            if (dx_m * dx_m + dy_m * dy_m >= margin_m * margin_m) {
              continue;
            }
            const raster::CellIndex at{column + bx, row + by};
            const float value = surface.geometry().contains(at) ? surface.at(at) : nan;
            greatest = std::isnan(value) || std::isnan(greatest) ? nan : std::max(greatest, value);
          }
        }
        const float found = dilated.at(column, row);
        ASSERT_TRUE(found == greatest || (std::isnan(found) && std::isnan(greatest)))
            << found << " for " << greatest << " at " << column << " " << row << " margin "
            << margin_m;
      }
    }
  }
}

TEST(DilatedSurface, InterpolatedItIsNowhereLowerThanTheSurfaceWithinTheMargin) {
  const std::uint64_t seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  for (const double cell_m : {30.0, 10.0}) {
    for (const double margin_m : {12.0, 30.0, 47.0}) {
      // White noise is the worst terrain there is.
      raster::Grid<float> surface({500.0, -300.0, cell_m, 40, 40}, 0.0F);
      for (float& value : surface.values()) {
        value = static_cast<float>(100.0 * unit(random));
      }
      const raster::Grid<float> dilated = dilated_surface(surface, margin_m);
      for (int k = 0; k < 4000; ++k) {
        const geo::MapPoint p{500.0 + 40.0 * cell_m * unit(random),
                              -300.0 + 40.0 * cell_m * unit(random)};
        const double angle = kTwoPi * unit(random);
        const double distance_m = margin_m * std::sqrt(unit(random));
        const geo::MapPoint q{p.x_m + distance_m * std::cos(angle),
                              p.y_m + distance_m * std::sin(angle)};
        const double kept_m = raster::sample_bilinear(dilated, p);
        if (!std::isnan(kept_m)) {
          ASSERT_GE(kept_m + 1e-9, raster::sample_bilinear(surface, q))
              << "cell " << cell_m << " margin " << margin_m;
        }
      }
    }
  }
}

TEST(FlightEnvelope, OnAPlaneTheBandIsFloorAndCeilingAboveItsHighestNeighbourhood) {
  // Slope 0.2 to the east: the dilated surface lies one cell, 6 m, higher.
  const PlanningCase in(
      test::make_map(100, 100, 30.0, [](double x_m, double) { return 0.2 * x_m; }), kWeights);
  const FlightEnvelope envelope = envelope_of(in, plain_options());
  const AltitudeBand band = envelope.band_at({1500.0, 1234.0});
  EXPECT_NEAR(band.low_m, 300.0 + 6.0 + 20.0, 1e-3);
  EXPECT_NEAR(band.high_m, 300.0 + 120.0, 1e-3);
  EXPECT_TRUE(envelope.contains({1500.0, 1234.0, 326.01}));
  EXPECT_FALSE(envelope.contains({1500.0, 1234.0, 325.99}));
  EXPECT_FALSE(envelope.contains({1500.0, 1234.0, 420.01}));
}

TEST(FlightEnvelope, TheFloorSinksToTheHeightOfAnEndLinearly) {
  const PlanningCase in(test::make_map(100, 100, 30.0, [](double, double) { return 50.0; }),
                        kWeights);
  const FlightEnvelope envelope(in.costs, plain_options(), in.above(1000.0, 1500.0, 10.0),
                                in.above(2500.0, 1500.0, 60.0));
  EXPECT_TRUE(envelope.contains(envelope.start()));
  EXPECT_NEAR(envelope.band_at({1000.0, 1500.0}).low_m, 60.0, 1e-5);
  EXPECT_NEAR(envelope.band_at({1100.0, 1500.0}).low_m, 62.5, 1e-5);
  EXPECT_NEAR(envelope.band_at({1000.0, 1700.0}).low_m, 65.0, 1e-5);
  EXPECT_NEAR(envelope.band_at({1401.0, 1500.0}).low_m, 70.0, 1e-5);
  // An end above the floor does not lift it.
  EXPECT_NEAR(envelope.band_at({2500.0, 1500.0}).low_m, 70.0, 1e-5);
}

TEST(FlightEnvelope, UnknownGroundIsNotFlyable) {
  map::Map map = test::make_map(100, 100, 30.0, [](double, double) { return 50.0; });
  map.terrain_m.at(50, 50) = std::numeric_limits<float>::quiet_NaN();
  map.surface_m = map.terrain_m;
  test::finish_map(map);
  const PlanningCase in(std::move(map), kWeights);
  const FlightEnvelope envelope = envelope_of(in, plain_options());
  EXPECT_FALSE(envelope.band_at({1515.0, 1515.0}).is_flyable());
  EXPECT_FALSE(envelope.contains({1515.0, 1515.0, 100.0}));
  EXPECT_EQ(envelope.leg_cost_m({1000.0, 1515.0, 100.0}, {2000.0, 1515.0, 100.0}), kInfinity);
  EXPECT_FALSE(envelope.is_clear({1000.0, 1515.0, 100.0}, {2000.0, 1515.0, 100.0}));
  EXPECT_TRUE(envelope.is_clear({1000.0, 1000.0, 100.0}, {2000.0, 1000.0, 100.0}));
  EXPECT_FALSE(envelope.band_at({-5.0, 100.0}).is_flyable());
}

TEST(FlightEnvelope, ClimbLimitHoldsUpAndDown) {
  const PlanningCase in(test::make_map(100, 100, 30.0, [](double, double) { return 0.0; }),
                        kWeights);
  const FlightEnvelope envelope = envelope_of(in, plain_options());
  const double run_m = 300.0;
  const double rise_m = run_m * std::tan(8.0 * kDegree_rad);
  const Waypoint low{1200.0, 1200.0, 40.0};
  EXPECT_TRUE(envelope.is_climb_allowed(low, {1200.0 + run_m, 1200.0, 40.0 + 0.999 * rise_m}));
  EXPECT_FALSE(envelope.is_climb_allowed(low, {1200.0 + run_m, 1200.0, 40.0 + 1.001 * rise_m}));
  EXPECT_FALSE(envelope.is_climb_allowed({1200.0 + run_m, 1200.0, 40.0 + 1.001 * rise_m}, low));
  EXPECT_FALSE(envelope.is_climb_allowed(low, {1200.0, 1200.0, 50.0}));
}

TEST(FlightEnvelope, ClimbsThatATrackRunsIntoCostTheTriangleOfTheEarlierClimb) {
  // 300 m of ground that rises by 40 %, level before and behind.
  const double rise_m = 120.0;
  const PlanningCase in(test::make_map(400, 60, 30.0,
                                       [&](double x_m, double) {
                                         return 100.0 +
                                                std::clamp(0.4 * (x_m - 7005.0), 0.0, rise_m);
                                       }),
                        {0.0, 0.0, 0.0, 0.01});
  GlobalOptions options = plain_options();
  options.envelope_ceiling_m = 300.0;
  options.lateral_margin_m = 0.0;
  const FlightEnvelope envelope = envelope_of(in, options);
  const double tangent = std::tan(options.climb_angle_max_rad);
  const geo::MapPoint a{2000.0, 900.0};
  const geo::MapPoint b{9000.0, 900.0};
  const AltitudeBand any = envelope.band_at(a);
  FlightEnvelope::FollowRules rules{5.0, 0.0, 1.0};
  const FlightEnvelope::Arrival low = envelope.follow(a, b, any, rules);
  rules.counts_climbs = true;
  const FlightEnvelope::Arrival whole = envelope.follow(a, b, any, rules);
  EXPECT_EQ(low.altitudes.low_m, whole.altitudes.low_m);
  EXPECT_EQ(low.altitudes.high_m, whole.altitudes.high_m);
  // A climb that ends at the top of the rise is so much above its foot.
  const double foot_m = rise_m - tangent * 300.0;
  EXPECT_NEAR(whole.cost_m - low.cost_m,
              0.01 * (0.5 * foot_m * 300.0 + 0.5 * foot_m * foot_m / tangent), 5.0);
  // 1600 m of level ground behind it are enough for what is owed to be forgotten.
  EXPECT_EQ(whole.owed_m, 0.0);
  // In two parts it is the same.
  const geo::MapPoint middle{7200.0, 900.0};
  const FlightEnvelope::Arrival first = envelope.follow(a, middle, any, rules);
  EXPECT_NEAR(first.owed_m, (0.4 - tangent) * 195.0, 1.0);
  const FlightEnvelope::Arrival second =
      envelope.follow(middle, b, first.altitudes, rules, first.owed_m);
  EXPECT_NEAR(first.cost_m + second.cost_m, whole.cost_m, 5.0);
  // Flown the other way the rise is a descent, which altitudes follow without owing anything.
  const FlightEnvelope::Arrival down = envelope.follow(b, a, envelope.band_at(b), rules);
  EXPECT_EQ(down.owed_m, 0.0);
}

TEST(FlightEnvelope, LegCostIsTheIntegralOfEquationOne) {
  const std::uint64_t seed = test::fresh_seed();
  const PlanningCase in(test::make_fractal_map(seed, 150, 30.0, 3000.0, 120.0), kWeights);
  GlobalOptions options = plain_options();
  options.envelope_ceiling_m = 400.0;
  options.check_step_m = 1.0;
  const FlightEnvelope envelope = envelope_of(in, options);
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> place_m(600.0, 3900.0);
  int compared = 0;
  for (int k = 0; k < 200; ++k) {
    const Waypoint a{place_m(random), place_m(random), 180.0};
    const Waypoint b{place_m(random), place_m(random), 190.0};
    const double cost_m = envelope.leg_cost_m(a, b);
    if (cost_m < kInfinity) {
      EXPECT_NEAR(cost_m, in.costs.route_cost({a, b}, 1.0).total_m(), 1e-6 * cost_m);
      EXPECT_EQ(envelope.leg_cost_m(b, a) < kInfinity, true);
      ++compared;
    }
  }
  EXPECT_GT(compared, 100);
}

TEST(FlightEnvelope, LegsBetweenTwoPlacesCostTogetherWhatEachDoesAlone) {
  const std::uint64_t seed = test::fresh_seed();
  const PlanningCase in(test::make_fractal_map(seed, 100, 30.0, 900.0, 120.0), kWeights);
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> place(400.0, 2600.0);
  std::uniform_real_distribution<double> height(15.0, 160.0);
  const FlightEnvelope envelope(in.costs, shipped_global_options(), in.above(600.0, 600.0),
                                in.above(2400.0, 2400.0));
  int finite = 0;
  std::vector<double> costs_m;
  for (int i = 0; i < 200; ++i) {
    const geo::MapPoint a{place(random), place(random)};
    const geo::MapPoint b{place(random), place(random)};
    std::vector<double> from_m;
    std::vector<double> to_m;
    for (int k = 0; k < 4; ++k) {
      from_m.push_back(in.above(a.x_m, a.y_m, height(random)).altitude_m);
      to_m.push_back(in.above(b.x_m, b.y_m, height(random)).altitude_m);
    }
    envelope.leg_costs_m(a, from_m, b, to_m, costs_m);
    ASSERT_EQ(costs_m.size(), 16U);
    for (std::size_t k = 0; k < 16; ++k) {
      const double alone_m =
          envelope.leg_cost_m({a.x_m, a.y_m, from_m[k / 4]}, {b.x_m, b.y_m, to_m[k % 4]});
      EXPECT_EQ(costs_m[k], alone_m) << seed;
      finite += alone_m < kInfinity ? 1 : 0;
    }
  }
  EXPECT_GT(finite, 50) << seed;
}

TEST(FlightEnvelope, AClearLegIsClearAtEveryTwentyCentimetresAndAFailingOneIsNot) {
  const std::uint64_t seed = test::fresh_seed();
  const PlanningCase in(test::make_fractal_map(seed, 150, 30.0, 2000.0, 500.0), kWeights);
  const GlobalOptions options = plain_options();
  const FlightEnvelope envelope = envelope_of(in, options);
  const raster::Grid<float> dilated = dilated_surface(in.map.surface_m, options.lateral_margin_m);
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  int clear = 0;
  int blocked = 0;
  for (int k = 0; k < 3000; ++k) {
    const geo::MapPoint p{700.0 + 3000.0 * unit(random), 700.0 + 3000.0 * unit(random)};
    const geo::MapPoint q{p.x_m + 800.0 * (unit(random) - 0.5),
                          p.y_m + 800.0 * (unit(random) - 0.5)};
    const Waypoint a{p.x_m, p.y_m, envelope.band_at(p).low_m + 20.0 * unit(random)};
    const Waypoint b{q.x_m, q.y_m, envelope.band_at(q).low_m + 20.0 * unit(random)};
    if (!envelope.is_climb_allowed(a, b) || !envelope.contains(a) || !envelope.contains(b)) {
      continue;
    }
    double least_m = kInfinity;  // distance to floor and ceiling, every 20 cm, without the funnels
    const int steps = static_cast<int>(std::hypot(b.x_m - a.x_m, b.y_m - a.y_m) / 0.2) + 1;
    for (int i = 0; i <= steps; ++i) {
      const double t = static_cast<double>(i) / steps;
      const geo::MapPoint at{a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m)};
      const double altitude_m = a.altitude_m + t * (b.altitude_m - a.altitude_m);
      least_m = std::min(
          {least_m, altitude_m - raster::sample_bilinear(dilated, at) - options.envelope_floor_m,
           raster::sample_bilinear(in.map.surface_m, at) + options.envelope_ceiling_m -
               altitude_m});
    }
    const bool is_clear = envelope.is_clear(a, b);
    (is_clear ? clear : blocked) += 1;
    if (is_clear) {
      EXPECT_GE(least_m, -1e-6);
    } else {
      EXPECT_LT(least_m, 0.02);  // between two of our samples it may be a little lower
    }
  }
  EXPECT_GT(clear, 100);
  EXPECT_GT(blocked, 100);
}

TEST(FlightEnvelope, TheFineCheckSeesATowerThatTheCoarseStepsMiss) {
  map::Map map = test::make_map(100, 100, 10.0, [](double, double) { return 0.0; });
  map.terrain_m.at(50, 50) = 60.0F;  // one cell of 10 m, at (505, 505)
  map.surface_m = map.terrain_m;
  test::finish_map(map);
  const PlanningCase in(std::move(map), kWeights);
  GlobalOptions options = plain_options();
  options.lateral_margin_m = 0.0;
  options.check_step_m = 60.0;
  options.end_funnel_m = 10.0;
  const FlightEnvelope envelope(in.costs, options, in.above(100, 505, 30.0),
                                in.above(900, 505, 30.0));
  // Midpoints of the two steps lie 30 m from the tower, which stands at the middle.
  const Waypoint a{445.0, 505.0, 30.0};
  const Waypoint b{565.0, 505.0, 30.0};
  EXPECT_LT(envelope.leg_cost_m(a, b), kInfinity);
  EXPECT_FALSE(envelope.is_clear(a, b));
}

TEST(FlightEnvelope, TurnsAreLimitedByAngleAndByTheRoomForTheArc) {
  const PlanningCase in(test::make_map(50, 50, 30.0, [](double, double) { return 0.0; }), kWeights);
  GlobalOptions options = plain_options();
  const auto turn = [](const FlightEnvelope& envelope, double angle_deg, double first_m,
                       double second_m) {
    return envelope.is_turn_allowed(first_m, 0.0, second_m * std::cos(angle_deg * kDegree_rad),
                                    second_m * std::sin(angle_deg * kDegree_rad));
  };
  const FlightEnvelope by_angle = envelope_of(in, options);
  EXPECT_TRUE(turn(by_angle, 59.9, 10.0, 1.0));
  EXPECT_TRUE(turn(by_angle, -59.9, 10.0, 1.0));
  EXPECT_FALSE(turn(by_angle, 60.1, 500.0, 500.0));
  EXPECT_FALSE(turn(by_angle, 180.0, 500.0, 500.0));
  // 282 m tan 30 deg = 162.8 m must fit half of the shorter leg.
  options.turn_radius_m = 282.0;
  const FlightEnvelope by_radius = envelope_of(in, options);
  EXPECT_TRUE(turn(by_radius, 59.99, 326.0, 900.0));
  EXPECT_FALSE(turn(by_radius, 59.99, 325.0, 900.0));
  EXPECT_FALSE(turn(by_radius, 59.99, 900.0, 325.0));
  EXPECT_TRUE(turn(by_radius, 10.0, 50.0, 50.0));
  EXPECT_TRUE(turn(by_radius, 0.0, 1.0, 1.0));
}

TEST(FlightEnvelope, OnTheSameGroundOtherCostsAreThoseOfAnEnvelopeOfTheirOwn) {
  const std::uint64_t seed = test::fresh_seed();
  const PlanningCase in(test::make_fractal_map(seed, 100, 30.0, 1500.0, 60.0), kWeights);
  const GlobalOptions options = plain_options();
  FlightEnvelope ground = envelope_of(in, options);
  ground.avoid({{500.0, 500.0, 0.0}, {2500.0, 2000.0, 0.0}}, 400.0, 5.0);
  const risk::CostModel costs = in.costs.reweighted(3.0, 1.0);
  const FlightEnvelope found(ground, costs);
  const FlightEnvelope wanted(costs, options, in.above(100.0, 100.0, 30.0),
                              in.above(2900.0, 2900.0, 30.0));
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> place(200.0, 2800.0);
  int flyable = 0;
  for (int i = 0; i < 300; ++i) {
    const Waypoint a = in.above(place(random), place(random), 60.0);
    const Waypoint b = in.above(a.x_m + 60.0, a.y_m + 40.0, 60.0);
    EXPECT_EQ(found.leg_cost_m(a, b), wanted.leg_cost_m(a, b)) << seed;
    EXPECT_EQ(found.route_cost_m({a, b}, 1.0), costs.route_cost({a, b}, 1.0).total_m()) << seed;
    EXPECT_EQ(found.is_clear(a, b), wanted.is_clear(a, b)) << seed;
    flyable += found.is_clear(a, b) ? 1 : 0;
  }
  EXPECT_GT(flyable, 50) << seed;
}

TEST(FlightEnvelope, AMetreBesideAnAvoidedRouteCostsMoreAndFartherAwayNothing) {
  // GIVEN level ground where a metre at reference height costs 1
  const PlanningCase in(test::make_map(100, 100, 30.0, [](double, double) { return 100.0; }),
                        risk::CostWeights{});
  FlightEnvelope envelope = envelope_of(in, plain_options());
  const std::vector<Waypoint> route = {{600.0, 1500.0, 140.0}, {2400.0, 1500.0, 140.0}};
  const raster::CellIndex beside{50, 50};
  const double bound = envelope.least_density(beside);
  // WHEN a route is avoided, then the same one less
  envelope.avoid(route, 300.0, 2.5);
  envelope.avoid(route, 300.0, 1.0);
  // THEN 1800 m on it cost 1800 (1 + 2.5), by the search's steps and by the fine ones
  EXPECT_NEAR(envelope.leg_cost_m(route[0], route[1]), 6300.0, 1e-6);
  EXPECT_NEAR(envelope.route_cost_m(route, 1.0), 6300.0, 1e-6);
  const std::vector<Waypoint> far = {{600.0, 1840.0, 140.0}, {2400.0, 1840.0, 140.0}};
  EXPECT_NEAR(envelope.leg_cost_m(far[0], far[1]), 1800.0, 1e-6);
  EXPECT_NEAR(envelope.route_cost_m(far, 1.0), 1800.0, 1e-6);
  // A leg that comes from 900 m away has the last 300 m of them inside, by whole cells.
  EXPECT_NEAR(envelope.route_cost_m({{1500.0, 600.0, 140.0}, {1500.0, 1500.0, 140.0}}, 1.0),
              900.0 + 2.5 * 300.0, 2.5 * 30.0);
  EXPECT_EQ(envelope.least_density(beside), bound) << "bounds are those of the costs alone";
}

TEST(FlightEnvelope, TheLeastDensityOfACellIsThatOfItsLowestPlaceAndNoPlaceCostsLess) {
  const auto seed = test::fresh_seed();
  const PlanningCase in(test::make_fractal_map(seed, 60, 30.0, 1000.0, 200.0),
                        risk::CostWeights{25.0, 0.02, 4.0, 0.01});
  const GlobalOptions options = test::shipped_global_options();
  // Far from both ends, whose funnels lower the floor.
  const FlightEnvelope envelope(in.costs, options, in.above(200, 200), in.above(300, 200));
  int cells = 0;
  for (int row = 30; row < 50; ++row) {
    for (int column = 30; column < 50; ++column) {
      double sampled = std::numeric_limits<double>::infinity();
      constexpr int kSide = 16;
      for (int k = 0; k < kSide * kSide; ++k) {
        const geo::MapPoint point{30.0 * (column + (k % kSide + 0.5) / kSide),
                                  30.0 * (row + (k / kSide + 0.5) / kSide)};
        const AltitudeBand band = envelope.band_at(point);
        if (band.is_flyable()) {
          sampled = std::min(
              sampled, envelope.density_at({point.x_m, point.y_m, band.low_m + 1e-9}, 1.0, 0.0));
        }
      }
      const double least = envelope.least_density({column, row});
      EXPECT_LE(least, sampled);
      if (sampled < std::numeric_limits<double>::infinity()) {
        ++cells;
        EXPECT_GE(least, 0.93 * sampled) << "at a corner of a quarter";
      }
    }
  }
  EXPECT_GT(cells, 50);
}

}  // namespace
}  // namespace hedgehop::global_planning
