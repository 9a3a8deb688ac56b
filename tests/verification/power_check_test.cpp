#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <random>

#include "base/shipped_config.hpp"
#include "support/fresh_seed.hpp"
#include "support/test_map.hpp"
#include "verification/perfect_flight.hpp"
#include "verification/verifier.hpp"

namespace hedgehop::verification {
namespace {

flight::PowerCurve shipped_curve() {
  auto reader = ConfigReader::from_text(shipped_config("vehicles/ec135.yaml"), "ec135.yaml");
  auto section = reader.required_section("power");
  return flight::read_power_curve(section);
}

TEST(RatesByPower, AgreeWithWhatThePlannersReckonToAHundredthOfAMetrePerSecond) {
  std::mt19937_64 random(test::fresh_seed());
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (int k = 0; k < 1000; ++k) {
    const PowerDemand demand{
        shipped_curve(), {true, uniform(1600.0, 2910.0), uniform(-40.0, 40.0), uniform(0.0, 0.4)}};
    const double speed_mps = uniform(0.0, 80.0);
    const double altitude_m = uniform(-300.0, 7000.0);
    const flight::VerticalRates own = rates_by_power(demand, speed_mps, altitude_m);
    const flight::VerticalRates planned =
        flight::PowerLimits(demand.curve, demand.conditions).rates(speed_mps, altitude_m);
    ASSERT_NEAR(own.climb_mps, planned.climb_mps, 0.01) << speed_mps << " " << altitude_m;
    ASSERT_NEAR(own.descent_mps, planned.descent_mps, 0.01) << speed_mps << " " << altitude_m;
  }
}

TEST(PowerCheck, AFlightThatClimbsOrSinksBeyondItsPowerIsFoundOut) {
  const map::Map map = test::make_map(200, 200, 30.0, [](double, double) { return 4000.0; });
  Demands demands;
  demands.required_clearance_m = 10.0;
  demands.ceiling_height_m = 1000.0;
  demands.goal_radius_m = 60.0;
  demands.start_radius_m = 1.0;
  demands.power = PowerDemand{shipped_curve(), {true, 2900.0, 20.0, 0.1}};
  flight::Limits limits = test::test_limits();
  limits.climb_rate_max_mps = 20.0;
  limits.descent_rate_max_mps = 20.0;
  const auto verdict_at = [&](double climb_rate_mps, const Demands& asked) {
    test::Manoeuvre manoeuvre;
    manoeuvre.x_m = 1000.0;
    manoeuvre.y_m = 3000.0;
    manoeuvre.altitude_m = 4300.0;
    manoeuvre.duration_s = 10.0;
    manoeuvre.climb_rate_mps = test::Schedule(climb_rate_mps);
    const flight::Trajectory flight = test::fly(manoeuvre, map);
    const auto place = [](const flight::FlightState& state) {
      return flight::Waypoint{state.x_m, state.y_m, state.altitude_m};
    };
    return verify(map, flight, place(flight.states.front()), {}, place(flight.states.back()),
                  limits, asked);
  };
  // The least and the greatest limit on the way, 40 m/s fast.
  double climb_low_mps = 100.0;
  double climb_high_mps = 0.0;
  double descent_low_mps = 100.0;
  double descent_high_mps = 0.0;
  for (double altitude_m = 4100.0; altitude_m <= 4500.0; altitude_m += 1.0) {
    const flight::VerticalRates rates = rates_by_power(*demands.power, 40.0, altitude_m);
    climb_low_mps = std::min(climb_low_mps, rates.climb_mps);
    climb_high_mps = std::max(climb_high_mps, rates.climb_mps);
    descent_low_mps = std::min(descent_low_mps, rates.descent_mps);
    descent_high_mps = std::max(descent_high_mps, rates.descent_mps);
  }
  ASSERT_GT(climb_low_mps, 0.5);
  ASSERT_LT(climb_high_mps, 8.0);
  EXPECT_TRUE(verdict_at(climb_low_mps - 0.01, demands).is_verified);
  EXPECT_TRUE(verdict_at(0.01 - descent_low_mps, demands).is_verified);
  const flight::Verdict up = verdict_at(climb_high_mps + 0.01, demands);
  ASSERT_FALSE(up.violations.empty());
  EXPECT_EQ(up.violations.front().rule, "climb_power");
  EXPECT_EQ(up.violation_count, 201);  // each state of it
  const flight::Verdict down = verdict_at(-descent_high_mps - 0.01, demands);
  ASSERT_FALSE(down.violations.empty());
  EXPECT_EQ(down.violations.front().rule, "descent_power");
  EXPECT_EQ(down.violation_count, 201);
  Demands without = demands;
  without.power.reset();
  EXPECT_TRUE(verdict_at(climb_high_mps + 0.01, without).is_verified);
}

}  // namespace
}  // namespace hedgehop::verification
