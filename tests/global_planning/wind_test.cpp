#include <algorithm>
#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

#include "global_planning/flight_envelope.hpp"
#include "global_planning/planning_case.hpp"
#include "global_planning/route_finish.hpp"
#include "global_planning/slope_limits.hpp"
#include "global_planning/turn_limit.hpp"
#include "support/fresh_seed.hpp"
#include "support/rough_terrain.hpp"

namespace hedgehop::global_planning {
namespace {

using flight::Waypoint;
using flight::Wind;
using test::PlanningCase;
using ::testing::HasSubstr;

constexpr double kPi = std::numbers::pi;
constexpr double kSpeed_mps = 40.0;
using test::kWeights;

GlobalOptions options_in(const Wind& wind) {
  GlobalOptions options = test::shipped_global_options();
  options.wind = wind;
  options.airspeed_mps = kSpeed_mps;
  return options;
}

TEST(SlopeLimitsInWind, OverGroundAClimbIsTheSameRateOverAnotherSpeed) {
  const SlopeLimits limits = SlopeLimits(0.15, 0.12).in_wind({10.0, 0.0}, kSpeed_mps);
  EXPECT_FALSE(limits.is_symmetric());
  EXPECT_NEAR(limits.at(500.0, -3.0, 0.0).up, 0.15 * 40.0 / 30.0, 1e-12);  // against the wind
  EXPECT_NEAR(limits.at(500.0, 3.0, 0.0).up, 0.15 * 40.0 / 50.0, 1e-12);   // with it
  EXPECT_NEAR(limits.at(500.0, 0.0, 3.0).down, 0.12 * 40.0 / std::sqrt(1500.0), 1e-12);
  EXPECT_NEAR(limits.greatest().up, 0.2, 1e-12);
  std::mt19937_64 random(test::fresh_seed());
  for (int i = 0; i < 200; ++i) {
    const double course_rad = std::uniform_real_distribution<double>(0.0, 2.0 * kPi)(random);
    const auto here = limits.at(500.0, std::cos(course_rad), std::sin(course_rad));
    EXPECT_LE(here.up, limits.at_most(500.0).up * (1.0 + 1e-12));
    EXPECT_LE(here.down, limits.at_most(500.0).down * (1.0 + 1e-12));
  }
}

TEST(TurnLimitInWind, IsTheSquareOfTheGroundSpeedAlongTheWindAndTheCosineOfTheCrabAcross) {
  const TurnLimit turns(282.0, {0.0, 10.0}, kSpeed_mps);
  EXPECT_NEAR(turns.greatest_m(), 282.0 * 1.25 * 1.25, 1e-9);
  EXPECT_NEAR(turns.least_m(), 282.0 * 0.75 * 0.75, 1e-9);
  // Hardly any turn on a course across the wind: V_g^2 / (V S) = S / V.
  EXPECT_NEAR(turns.radius_m(1.0, 0.0, 1.0, 1e-9), 282.0 * std::sqrt(1.0 - 1.0 / 16.0), 1e-5);
  // From one side of the wind to the other, over it and against it.
  EXPECT_EQ(turns.radius_m(1.0, 3.0, -1.0, 3.0), turns.greatest_m());
  EXPECT_LT(turns.radius_m(1.0, -3.0, -1.0, -3.0), 282.0);
}

// A turn with constant bank in still air, carried along: radius of curvature of its ground track.
TEST(TurnLimitInWind, NoPartOfATurnWithConstantBankIsWiderThanItSays) {
  std::mt19937_64 random(test::fresh_seed());
  const auto uniform = [&](double from, double to) {
    return std::uniform_real_distribution<double>(from, to)(random);
  };
  for (int i = 0; i < 300; ++i) {
    const double wind_mps = uniform(0.5, 20.0);
    const double to_rad = uniform(0.0, 2.0 * kPi);
    const Wind wind{wind_mps * std::cos(to_rad), wind_mps * std::sin(to_rad)};
    const double first_rad = uniform(0.0, 2.0 * kPi);
    const double second_rad = first_rad + uniform(-1.2, 1.2);
    double widest_m = 0.0;
    for (int k = 0; k <= 2000; ++k) {
      const double course_rad = first_rad + (second_rad - first_rad) * k / 2000.0;
      const double across =
          wind.north_mps * std::cos(course_rad) - wind.east_mps * std::sin(course_rad);
      const double heading_rad = course_rad - std::asin(across / kSpeed_mps);
      // Velocity and acceleration over the ground, turning left at V / R_0.
      const double vx = kSpeed_mps * std::cos(heading_rad) + wind.east_mps;
      const double vy = kSpeed_mps * std::sin(heading_rad) + wind.north_mps;
      const double rate = kSpeed_mps / 282.0;
      const double ax = -kSpeed_mps * rate * std::sin(heading_rad);
      const double ay = kSpeed_mps * rate * std::cos(heading_rad);
      widest_m = std::max(widest_m, std::pow(std::hypot(vx, vy), 3.0) / (vx * ay - vy * ax));
    }
    const double said_m = TurnLimit(282.0, wind, kSpeed_mps)
                              .radius_m(std::cos(first_rad), std::sin(first_rad),
                                        std::cos(second_rad), std::sin(second_rad));
    EXPECT_NEAR(widest_m, said_m, 2e-3 * said_m) << i;
  }
}

TEST(PlanLegInWind, EachLegIsClimbedWithinTheRateOfStillAirAndEachTurnFits) {
  const std::uint64_t seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  int found = 0;
  for (int i = 0; i < 4; ++i) {
    const PlanningCase in(
        test::make_rough_map(260, 260, 30.0, seed + static_cast<unsigned>(i), 9.0), kWeights);
    const double to_rad = std::uniform_real_distribution<double>(0.0, 2.0 * kPi)(random);
    const Wind wind{15.0 * std::cos(to_rad), 15.0 * std::sin(to_rad)};
    const GlobalOptions options = options_in(wind);
    const auto answer = test::plan(in, options, in.above(1500, 1500), in.above(6000, 6300));
    const auto* route = std::get_if<flight::Route>(&answer);
    if (route == nullptr) {
      continue;
    }
    ++found;
    const double rate_mps = kSpeed_mps * std::tan(options.climb_angle_max_rad);
    for (std::size_t k = 1; k < route->waypoints.size(); ++k) {
      const Waypoint& a = route->waypoints[k - 1];
      const Waypoint& b = route->waypoints[k];
      const double run_m = std::hypot(b.x_m - a.x_m, b.y_m - a.y_m);
      // Over the ground in this direction: from the triangle of velocities, by the law of cosines.
      const double angle_rad = std::atan2(b.y_m - a.y_m, b.x_m - a.x_m) - to_rad;
      const double ground_mps =
          15.0 * std::cos(angle_rad) +
          std::sqrt(kSpeed_mps * kSpeed_mps - std::pow(15.0 * std::sin(angle_rad), 2.0));
      EXPECT_LE(std::fabs(b.altitude_m - a.altitude_m) / run_m * ground_mps,
                rate_mps * (1.0 + 1e-9));
    }
    const FlightEnvelope envelope(in.costs, options, in.above(1500, 1500), in.above(6000, 6300));
    EXPECT_TRUE(are_turns_allowed(envelope, route->waypoints));
    EXPECT_GE(route->cost.total_m(), route->lower_bound_m);
  }
  EXPECT_GE(found, 3) << seed;
}

map::Map turned_left(const map::Map& map) {
  const int side = map.geometry.columns;
  map::Map result = map;
  for (int row = 0; row < side; ++row) {
    for (int column = 0; column < side; ++column) {
      // (x, y) goes to (-y, x) around the middle.
      result.terrain_m.at(side - 1 - row, column) = map.terrain_m.at(column, row);
    }
  }
  result.surface_m = result.terrain_m;
  test::finish_map(result);
  return result;
}

TEST(PlanLegInWind, MapWindAndProblemTurnedByAQuarterGiveTheSameCost) {
  const map::Map map = test::make_rough_map(220, 220, 30.0, test::fresh_seed(), 8.0);
  const double side_m = 220 * 30.0;
  const PlanningCase here(map, kWeights);
  const PlanningCase there(turned_left(map), kWeights);
  const auto turned = [&](double x_m, double y_m) { return there.above(side_m - y_m, x_m); };
  const auto one =
      test::plan(here, options_in({12.0, -5.0}), here.above(1410, 1515), here.above(5100, 5005));
  const auto other =
      test::plan(there, options_in({5.0, 12.0}), turned(1410, 1515), turned(5100, 5005));
  ASSERT_EQ(one.index(), other.index());
  if (const auto* route = std::get_if<flight::Route>(&one)) {
    EXPECT_NEAR(std::get<flight::Route>(other).cost.total_m() / route->cost.total_m(), 1.0, 0.01);
  }
}

TEST(PlanLegInWind, APassThatIsClimbedAgainstTheWindIsNotClimbedWithIt) {
  // 600 m of height at 11 degrees, in a strip of known ground too narrow to circle in. 8 degrees
  // through the air are 12.7 over the ground against 15 m/s, and 5.8 with them: of the 3.1 km that
  // leaves 290 m to the envelope of 130 m.
  const double tangent = std::tan(11.0 * kPi / 180.0);
  const PlanningCase in(test::make_map(400, 200, 30.0,
                                       [=](double x_m, double y_m) {
                                         return std::fabs(y_m - 3000.0) > 150.0
                                                    ? std::nan("")
                                                    : 300.0 + std::clamp((x_m - 4000.0) * tangent,
                                                                         0.0, 600.0);
                                       }),
                        kWeights);
  const auto climbed = [&](const Wind& wind) {
    return test::plan(in, options_in(wind), in.above(3000, 3000), in.above(10000, 3000));
  };
  EXPECT_TRUE(std::holds_alternative<flight::Route>(climbed({-15.0, 0.0})));
  EXPECT_FALSE(std::holds_alternative<flight::Route>(climbed({15.0, 0.0})));
}

TEST(PlanLegInWind, WhatCannotBeClimbedIsToldWithTheAngleAndWhatTheWindMakesOfIt) {
  // A hollow with walls of 40 %, 40 m deep, 145 m around the goal at 15 m. Even against the wind,
  // at 22 %, a route is at most 35 m higher where the walls end, and the envelope begins 20 m
  // above.
  const PlanningCase in(test::make_map(200, 200, 30.0,
                                       [](double x_m, double y_m) {
                                         const double from_m =
                                             std::hypot(x_m - 3015.0, y_m - 3015.0);
                                         return std::clamp(0.4 * (from_m - 45.0), 0.0, 40.0);
                                       }),
                        kWeights);
  GlobalOptions options = options_in({15.0, 0.0});
  options.turn_radius_m = 600.0;
  const auto answer = test::plan(in, options, in.above(900, 900), in.above(3015, 3015));
  const auto* none = std::get_if<flight::NoPlan>(&answer);
  ASSERT_NE(none, nullptr);
  EXPECT_EQ(none->cause, flight::NoPlanCause::kClimbLimit) << none->explanation;
  EXPECT_THAT(
      none->explanation,
      HasSubstr("climbs of at most 8.0 degrees through the air, which at 40.0 m/s in a wind "
                "of 15.0 m/s are 12.7 degrees over the ground against the wind and 5.8 "
                "with it"));
}

}  // namespace
}  // namespace hedgehop::global_planning
