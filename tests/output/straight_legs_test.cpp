#include "output/straight_legs.hpp"

#include <algorithm>
#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>

#include "base/errors.hpp"
#include "raster/grid.hpp"
#include "support/fresh_seed.hpp"
#include "support/test_map.hpp"

namespace hedgehop::output {
namespace {

using testing::HasSubstr;

constexpr LegOptions kOptions{10.0, 3.0};

/// A flight to the east at 40 m/s and y = 1500 m from x = 200 m on, whose sideways offset and
/// altitude follow from x.
template <typename Offset, typename Altitude>
flight::Trajectory flight_east(double length_m, Offset offset_m, Altitude altitude_m) {
  flight::Trajectory trajectory;
  trajectory.step_s = 0.05;
  for (int i = 0; 2.0 * i <= length_m; ++i) {
    flight::FlightState state;
    state.time_s = 0.05 * i;
    state.x_m = 200.0 + 2.0 * i;
    state.y_m = 1500.0 + offset_m(state.x_m);
    state.altitude_m = altitude_m(state.x_m);
    trajectory.states.push_back(state);
  }
  return trajectory;
}

double straight(double) { return 0.0; }

/// Least height of the legs above the surface, by steps of a metre and another interpolation than
/// the code's.
double sampled_clearance_m(const flight::Trajectory& trajectory, const StraightLegs& legs,
                           const map::Map& map) {
  double least_m = 1e9;
  for (std::size_t k = 1; k < legs.states.size(); ++k) {
    const flight::FlightState& a = trajectory.states[legs.states[k - 1]];
    const flight::FlightState& b = trajectory.states[legs.states[k]];
    const int steps = 1 + static_cast<int>(std::hypot(b.x_m - a.x_m, b.y_m - a.y_m));
    for (int i = 0; i <= steps; ++i) {
      const double t = static_cast<double>(i) / steps;
      const geo::MapPoint point{a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m)};
      least_m = std::min(least_m, a.altitude_m + t * (b.altitude_m - a.altitude_m) -
                                      raster::sample_bilinear(map.surface_m, point));
    }
  }
  return least_m;
}

TEST(StraightLegs, LevelStraightFlightNeedsItsTwoEndsAlone) {
  const map::Map map = test::make_map(120, 100, 30.0, [](double, double) { return 100.0; });
  const auto flight = flight_east(2000.0, straight, [](double) { return 125.0; });
  const StraightLegs legs = straight_legs(flight, map, 10.0, kOptions);
  EXPECT_EQ(legs.states, (std::vector<std::size_t>{0, 1000}));
  EXPECT_EQ(legs.added, 0U);
  EXPECT_NEAR(legs.clearance_min_m, 25.0, 1e-9);
  EXPECT_NEAR(legs.lateral_max_m, 0.0, 1e-9);
}

TEST(StraightLegs, HumpWithinTheToleranceIsFlownWhenTheGroundBelowAsksForIt) {
  // A ridge 2.5 m high, and a flight that keeps 10 m above it by climbing as much: the straight leg
  // strays by less than 3 m and would pass 7.5 m above the top.
  const auto hump_m = [](double x_m) {
    return 2.5 * std::max(0.0, 1.0 - std::fabs(x_m - 1215.0) / 300.0);
  };
  const map::Map map =
      test::make_map(120, 100, 30.0, [&](double x_m, double) { return 100.0 + hump_m(x_m); });
  const auto flight =
      flight_east(2000.0, straight, [&](double x_m) { return 110.02 + hump_m(x_m); });
  const StraightLegs careless = straight_legs(flight, map, 7.0, kOptions);
  EXPECT_EQ(careless.states.size(), 2U);
  EXPECT_NEAR(careless.clearance_min_m, 7.52, 1e-3);  // the top is a cell's centre

  const StraightLegs legs = straight_legs(flight, map, 10.0, kOptions);
  EXPECT_GE(legs.added, 1U);
  EXPECT_EQ(legs.states.size(), 2U + legs.added);
  EXPECT_GE(legs.clearance_min_m, 10.0);
  EXPECT_GE(sampled_clearance_m(flight, legs, map), 10.0 - 1e-6);
}

TEST(StraightLegs, FlightThatDoesNotHoldTheClearanceItselfIsRefusedWithThePlace) {
  const map::Map map = test::make_map(120, 100, 30.0, [](double, double) { return 100.0; });
  const auto flight = flight_east(2000.0, straight, [](double) { return 109.5; });
  try {
    straight_legs(flight, map, 10.0, kOptions);
    FAIL();
  } catch (const UserError& error) {
    EXPECT_EQ(error.code(), ExitCode::kNotVerified);
    EXPECT_THAT(error.what(), HasSubstr("passes 9.50 m above the surface"));
    EXPECT_THAT(error.what(), HasSubstr("y 1500 m"));
    EXPECT_THAT(error.hint(), HasSubstr("--clearance-m"));
  }
}

TEST(StraightLegs, BulgeAroundAMastIsNotCutOff) {
  map::Map map = test::make_map(120, 100, 30.0, [](double, double) { return 100.0; });
  // The flight swings out by 8 m and passes 12 m from the mast's edge; straight on it would be 4 m.
  map.obstacles.push_back(
      {1, map::ObstacleKind::kMast, "mast", {1200.0, 1494.0}, 2.0, 200.0, 300.0});
  test::finish_map(map);
  const auto bulge_m = [](double x_m) {
    return 8.0 * std::max(0.0, 1.0 - std::pow((x_m - 1200.0) / 300.0, 2));
  };
  const auto flight = flight_east(2000.0, bulge_m, [](double) { return 150.0; });
  const StraightLegs legs = straight_legs(flight, map, 10.0, kOptions);
  EXPECT_GE(legs.added, 1U);
  for (std::size_t k = 1; k < legs.states.size(); ++k) {
    const flight::FlightState& a = flight.states[legs.states[k - 1]];
    const flight::FlightState& b = flight.states[legs.states[k]];
    for (int i = 0; i <= 1000; ++i) {
      const double t = i / 1000.0;
      EXPECT_GE(
          std::hypot(a.x_m + t * (b.x_m - a.x_m) - 1200.0, a.y_m + t * (b.y_m - a.y_m) - 1494.0),
          12.0 - 1e-3);
    }
  }
  map.obstacles.clear();
  EXPECT_EQ(straight_legs(flight, map, 10.0, kOptions).states.size(), 2U);
}

TEST(StraightLegs, WireBesideABulgeAndAreaUnderAHumpAddPoints) {
  map::Map map = test::make_map(120, 100, 30.0, [](double, double) { return 100.0; });
  const auto bulge_m = [](double x_m) {
    return 8.0 * std::max(0.0, 1.0 - std::pow((x_m - 1200.0) / 300.0, 2));
  };
  const auto around = flight_east(2000.0, bulge_m, [](double) { return 135.0; });
  // A span 40 m high that ends at the apex, 12 m from it and 4 m from the chord.
  map.overhead_lines.push_back({5, {{{1200.0, 1300.0}, 40.0}, {{1200.0, 1496.0}, 40.0}}});
  EXPECT_GE(straight_legs(around, map, 10.0, kOptions).added, 1U);
  map.overhead_lines.clear();

  // A hard area up to 127 m; the flight climbs from 125 m to 127.9 m over it, straight legs do not.
  map::Area area;
  area.name = "ED-R 1";
  area.floor = {-std::numeric_limits<double>::infinity(), map::AreaLimit::Reference::kAmsl};
  area.ceiling = {127.0, map::AreaLimit::Reference::kAmsl};
  area.polygons.push_back(
      {{{1150.0, 1400.0}, {1250.0, 1400.0}, {1250.0, 1600.0}, {1150.0, 1600.0}, {1150.0, 1400.0}},
       {}});
  map.areas = {area};
  const auto over = flight_east(2000.0, straight, [](double x_m) {
    return 125.0 + 2.9 * std::min(1.0, std::max(0.0, 2.0 - std::fabs(x_m - 1200.0) / 150.0));
  });
  const StraightLegs legs = straight_legs(over, map, 10.0, kOptions);
  EXPECT_GE(legs.added, 1U);
  for (std::size_t k = 1; k < legs.states.size(); ++k) {
    const flight::FlightState& a = over.states[legs.states[k - 1]];
    const flight::FlightState& b = over.states[legs.states[k]];
    for (double x_m = std::max(a.x_m, 1150.0); x_m <= std::min(b.x_m, 1250.0); x_m += 0.5) {
      EXPECT_GT(a.altitude_m + (x_m - a.x_m) / (b.x_m - a.x_m) * (b.altitude_m - a.altitude_m),
                127.0);
    }
  }
  // The same in heights above the ground, which is 100 m.
  map.areas[0].ceiling = {27.0, map::AreaLimit::Reference::kAboveGround};
  EXPECT_GE(straight_legs(over, map, 10.0, kOptions).added, 1U);
}

TEST(StraightLegs, VoidBelowALegIsRefused) {
  map::Map map = test::make_map(120, 100, 30.0, [](double, double) { return 100.0; });
  map.surface_m.at(40, 50) = std::nanf("");
  EXPECT_THROW(straight_legs(flight_east(2000.0, straight, [](double) { return 125.0; }), map, 10.0,
                             kOptions),
               UserError);
}

TEST(StraightLegs, RandomWindingFlightsStayWithinTolerancesAndClearance) {
  std::mt19937_64 generator(test::fresh_seed());
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  for (int attempt = 0; attempt < 10; ++attempt) {
    const double a = 300.0 + 100.0 * unit(generator);
    const double b = 20.0 + 20.0 * unit(generator);
    const double phase = 3.0 * unit(generator);
    const map::Map map = test::make_map(120, 100, 30.0, [&](double x_m, double y_m) {
      return 100.0 + b * std::sin(x_m / a + phase) * std::cos(y_m / 200.0);
    });
    auto flight = flight_east(
        3000.0, [&](double x_m) { return a * std::sin(x_m / 500.0 + phase); },
        [](double) { return 0.0; });
    for (flight::FlightState& state : flight.states) {
      state.altitude_m = raster::sample_bilinear(map.surface_m, state.point()) + 15.0;
    }
    const StraightLegs legs = straight_legs(flight, map, 14.5, kOptions);
    EXPECT_LE(legs.lateral_max_m, 10.0);
    EXPECT_LE(legs.vertical_max_m, 3.0);
    EXPECT_LT(legs.states.size(), flight.states.size() / 4);
    EXPECT_TRUE(std::is_sorted(legs.states.begin(), legs.states.end()));
    EXPECT_EQ(legs.states.front(), 0U);
    EXPECT_EQ(legs.states.back(), flight.states.size() - 1);
    const double sampled_m = sampled_clearance_m(flight, legs, map);
    EXPECT_GE(sampled_m, 14.5 - 1e-6);
    // The closed form finds what sampling finds, or less.
    EXPECT_LE(legs.clearance_min_m, sampled_m + 1e-9);
    EXPECT_NEAR(legs.clearance_min_m, sampled_m, 0.2);
  }
}

}  // namespace
}  // namespace hedgehop::output
