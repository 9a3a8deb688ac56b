#include <algorithm>
#include <cmath>
#include <cstring>
#include <gtest/gtest.h>
#include <numbers>
#include <random>
#include <string>

#include "local_planning/escape.hpp"
#include "local_planning/local_planner.hpp"
#include "local_planning/local_planning_setup.hpp"
#include "support/fresh_seed.hpp"
#include "support/rough_terrain.hpp"
#include "support/test_map.hpp"

namespace hedgehop::local_planning {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kSpeed_mps = 40.0;

std::variant<Flight, flight::NoPlan> flown_in(const flight::Wind& wind, const map::Map& map,
                                              const std::vector<flight::Waypoint>& guide,
                                              const LocalOptions& options,
                                              Kernel kernel = Kernel::kBest) {
  command_model::Vehicle vehicle = test::shipped_vehicle();
  vehicle.wind = wind;
  LocalOptions fast = options;
  fast.slow_speed_mps = std::max(options.slow_speed_mps, 2.0 * wind.speed_mps() * 1.000001);
  SilentObserver observer;
  return fly_along(test::test_costs(map), vehicle, fast, guide,
                   state_at_start(guide, kSpeed_mps, vehicle), kSpeed_mps, {}, observer, kernel);
}

class EachModeInWind : public ::testing::TestWithParam<const char*> {
 protected:
  LocalOptions options() const {
    return test::shipped_local_options(std::string("local.mode=") + GetParam());
  }
};
INSTANTIATE_TEST_SUITE_P(LocalPlanner, EachModeInWind,
                         ::testing::Values("tvfh", "rollout", "vfh_3d"));

TEST_P(EachModeInWind, AStraightGuideAcrossTheWindIsFlownStraightWithTheNoseInTheWind) {
  const auto map = test::make_map(240, 120, 30.0, [](double, double) { return 100.0; });
  const std::vector<flight::Waypoint> guide{{900, 1800, 130}, {6300, 1800, 130}};
  // 24 m/s would be 3-4-5; half of 40 is the most: sin(crab) = 1 / 2, 34.64 m/s over the ground.
  const auto result = flown_in({0.0, 20.0}, map, guide, options());
  ASSERT_TRUE(std::holds_alternative<Flight>(result));
  const Flight& flight = std::get<Flight>(result);
  for (std::size_t i = 1; i < flight.steps.size(); ++i) {
    const auto& state = flight.steps[i].state;
    ASSERT_NEAR(state.y_m, 1800.0, 3.0) << i;
    ASSERT_NEAR(state.heading_math_rad, -kPi / 6.0, 0.06) << i;
    ASSERT_NEAR(state.x_m - flight.steps[i - 1].state.x_m, 0.05 * 40.0 * std::cos(kPi / 6.0), 0.05);
    // vfh_3d has steps of a degree: 5.2 m over the look-ahead of 300 m.
    ASSERT_NEAR(state.altitude_m, 130.0, std::string(GetParam()) == "vfh_3d" ? 5.2 : 3.0);
  }
  EXPECT_NEAR(flight.steps.back().state.x_m, 6300.0, 3.0);
}

TEST_P(EachModeInWind, HillsAreClearedAndTheVehicleKeepsItsRatesWhateverTheWind) {
  const std::uint64_t seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  int arrived = 0;
  for (int i = 0; i < 6; ++i) {
    const auto map = test::make_rough_map(260, 260, 30.0, seed + static_cast<unsigned>(i), 9.0);
    const double to_rad = std::uniform_real_distribution<double>(0.0, 2.0 * kPi)(random);
    const flight::Wind wind{12.0 * std::cos(to_rad), 12.0 * std::sin(to_rad)};
    // As steep as 12 m/s from behind leave: 7.2 / 52.
    const auto guide = test::stand_in_guide(map, {{1500, 1500}, {4000, 2800}, {6000, 6000}}, 50.0,
                                            35.0, 60.0, 0.11, 35.0);
    const auto result = flown_in(wind, map, guide, options());
    const auto* flight = std::get_if<Flight>(&result);
    if (flight == nullptr) {
      continue;
    }
    ++arrived;
    for (std::size_t k = 1; k < flight->steps.size(); ++k) {
      const auto& a = flight->steps[k - 1].state;
      const auto& b = flight->steps[k].state;
      const double ground_m = raster::sample_bilinear(map.surface_m, {b.x_m, b.y_m});
      ASSERT_GE(b.altitude_m - ground_m, 10.0) << seed << ' ' << i;
      ASSERT_LE(std::fabs(b.climb_rate_mps), 8.0 + 1e-9);
      // Velocity over the ground is that of the nose and the wind.
      const double mean_rad =
          a.heading_math_rad +
          0.5 * std::remainder(b.heading_math_rad - a.heading_math_rad, 2 * kPi);
      const double speed_mps = 0.5 * (a.speed_mps + b.speed_mps);
      ASSERT_NEAR((b.x_m - a.x_m) / 0.05, speed_mps * std::cos(mean_rad) + wind.east_mps, 0.02);
      ASSERT_NEAR((b.y_m - a.y_m) / 0.05, speed_mps * std::sin(mean_rad) + wind.north_mps, 0.02);
    }
  }
  EXPECT_GE(arrived, 5) << seed;
}

TEST_P(EachModeInWind, AllInstructionSetsFlyTheSameBytes) {
  const std::uint64_t seed = test::fresh_seed();
  const auto map = test::make_rough_map(200, 200, 30.0, seed, 9.0);
  const auto guide =
      test::stand_in_guide(map, {{1500, 1500}, {4300, 4000}}, 50.0, 35.0, 60.0, 0.11, 35.0);
  const auto plain = flown_in({9.0, -7.0}, map, guide, options(), Kernel::kPlain);
  for (const Kernel kernel : {Kernel::kBest, Kernel::kAvx2, Kernel::kAvx512}) {
    if (!is_available(kernel)) {
      continue;
    }
    const auto fast = flown_in({9.0, -7.0}, map, guide, options(), kernel);
    ASSERT_EQ(plain.index(), fast.index()) << seed;
    if (const auto* flight = std::get_if<Flight>(&plain)) {
      const auto& other = std::get<Flight>(fast);
      ASSERT_EQ(flight->steps.size(), other.steps.size()) << seed;
      EXPECT_EQ(std::memcmp(flight->steps.data(), other.steps.data(),
                            other.steps.size() * sizeof(FlownStep)),
                0)
          << seed << ' ' << name_of_kernel(kernel);
    }
  }
}

TEST(LocalPlannerInWind, AWindOfMoreThanHalfTheSpeedIsRefused) {
  const auto map = test::make_map(100, 100, 30.0, [](double, double) { return 100.0; });
  const std::vector<flight::Waypoint> guide{{600, 1500, 130}, {2400, 1500, 130}};
  command_model::Vehicle vehicle = test::shipped_vehicle();
  vehicle.wind = {21.0, 0.0};
  LocalOptions options = test::shipped_local_options();
  options.slow_speed_mps = 42.0;
  SilentObserver observer;
  EXPECT_THROW(fly_along(test::test_costs(map), vehicle, options, guide,
                         state_at_start(guide, kSpeed_mps, vehicle), kSpeed_mps, {}, observer),
               std::invalid_argument);
}

TEST(EscapeInWind, IsHighOnlyWhereTheCircleDownwindIsClear) {
  // A wall of 300 m, 900 m beside a flight over level ground. Two radii of the turn at 40 m/s are
  // 2 * 303 m with what the controller asks for; with 20 m/s of wind they are 2.25 times as much.
  const auto map =
      test::make_map(200, 200, 30.0, [](double x_m, double) { return x_m > 3900.0 ? 300.0 : 0.0; });
  const auto steps_until_high = [&](const flight::Wind& wind) -> std::size_t {
    command_model::Vehicle vehicle = test::shipped_vehicle();
    vehicle.wind = wind;
    const command_model::CommandModel model(vehicle);
    const EscapeOptions options{40.0, 12.0, 5.0, 120.0, {}};
    const auto from = command_model::trimmed_state(3000.0, 1500.0, 20.0, 40.0, 0.5 * kPi, 0.0);
    const Guide guide({{3000, 1500, 20}, {3000, 5500, 20}});
    const auto escape = escape_along(map.surface_m, model, options, EscapeWays::kAlongGuide, from,
                                     guide, 0.0, 50.0, 0.05);
    return escape ? escape->steps.size() : 0;
  };
  const std::size_t calm = steps_until_high({});
  const std::size_t windy = steps_until_high({0.0, 15.0});
  ASSERT_GT(calm, 0U);
  ASSERT_GT(windy, 0U);
  EXPECT_LT(calm, 150U);   // 12 m at once over the ground around
  EXPECT_GT(windy, 600U);  // until it is over the wall
}

}  // namespace
}  // namespace hedgehop::local_planning
