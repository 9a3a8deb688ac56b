#include "flight/wind.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

#include "base/config_reader.hpp"
#include "base/errors.hpp"
#include "base/shipped_config.hpp"
#include "flight/power_curve.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::flight {
namespace {

constexpr double kPi = std::numbers::pi;

double ground_mps(const Wind& wind, double airspeed_mps, double course_rad) {
  return ground_speed_mps(wind, airspeed_mps, std::cos(course_rad), std::sin(course_rad));
}

TEST(Wind, TakesFromASpeedAgainstItAndAddsToOneWithItAndAcrossItIsPythagoras) {
  const Wind from_west{12.0, 0.0};
  EXPECT_NEAR(ground_mps(from_west, 40.0, 0.0), 52.0, 1e-12);
  EXPECT_NEAR(ground_mps(from_west, 40.0, kPi), 28.0, 1e-12);
  EXPECT_NEAR(ground_mps({15.0, 0.0}, 25.0, 0.5 * kPi), 20.0, 1e-12);  // 15, 20, 25
  // Northwards in a wind to the east the nose points left of north, by asin(15 / 25) = 36.87 deg.
  EXPECT_NEAR(heading_for_course_rad({15.0, 0.0}, 25.0, 0.5 * kPi),
              0.5 * kPi + std::asin(15.0 / 25.0), 1e-12);
}

TEST(Wind, VelocityOverGroundIsThatThroughTheAirAndTheWind) {
  std::mt19937_64 random(test::fresh_seed());
  for (int i = 0; i < 1000; ++i) {
    const auto uniform = [&](double from, double to) {
      return std::uniform_real_distribution<double>(from, to)(random);
    };
    const double airspeed_mps = uniform(20.0, 60.0);
    const double to_rad = uniform(-kPi, kPi);
    const double wind_mps = uniform(0.0, 0.5) * airspeed_mps;
    const Wind wind{wind_mps * std::cos(to_rad), wind_mps * std::sin(to_rad)};
    const double course_rad = uniform(-kPi, kPi);
    const double heading_rad = heading_for_course_rad(wind, airspeed_mps, course_rad);
    const double speed_mps = ground_mps(wind, airspeed_mps, course_rad);

    // The triangle closes.
    EXPECT_NEAR(airspeed_mps * std::cos(heading_rad) + wind.east_mps,
                speed_mps * std::cos(course_rad), 1e-9);
    EXPECT_NEAR(airspeed_mps * std::sin(heading_rad) + wind.north_mps,
                speed_mps * std::sin(course_rad), 1e-9);
    const Motion ground = over_ground(wind, {airspeed_mps, heading_rad});
    EXPECT_NEAR(ground.speed_mps, speed_mps, 1e-9);
    EXPECT_NEAR(std::remainder(ground.direction_math_rad - course_rad, 2.0 * kPi), 0.0, 1e-9);
    const Motion air = through_air(wind, ground);
    EXPECT_NEAR(air.speed_mps, airspeed_mps, 1e-9);
    EXPECT_NEAR(std::remainder(air.direction_math_rad - heading_rad, 2.0 * kPi), 0.0, 1e-9);
  }
}

TEST(Wind, CalmAirChangesNoBit) {
  const Motion motion{39.7, 1.234567890123};
  EXPECT_EQ(over_ground({}, motion).direction_math_rad, motion.direction_math_rad);
  EXPECT_EQ(through_air({}, motion).speed_mps, motion.speed_mps);
  EXPECT_EQ(heading_for_course_rad({}, 40.0, 2.5), 2.5);
  EXPECT_EQ(ground_speed_mps({}, 40.1, 0.6, 0.8), 40.1);
  EXPECT_TRUE(wind_from(0.0, 1.0, 0.1).is_calm());
}

TEST(Wind, IsToldByWhereItComesFromAndTurnedIntoTheGrid) {
  const Wind west = wind_from(10.0, 1.5 * kPi, 0.0);
  EXPECT_NEAR(west.east_mps, 10.0, 1e-12);
  EXPECT_NEAR(west.north_mps, 0.0, 1e-12);
  // Grid north points 30 degrees east of true north: a wind from true 30 degrees comes down the
  // grid from its north.
  const Wind down = wind_from(10.0, kPi / 6.0, kPi / 6.0);
  EXPECT_NEAR(down.east_mps, 0.0, 1e-12);
  EXPECT_NEAR(down.north_mps, -10.0, 1e-12);
}

TEST(Wind, OfAPlanThatKnowsNoneIsCalmAndANewConfigMustSayWhatItIs) {
  const std::string old =
      "use_power_curve: false\nmass_kg: 0\nisa_deviation_k: 0\npower_reserve: 0.1\n";
  ConfigReader recorded = ConfigReader::from_text(old, "old");
  EXPECT_EQ(read_recorded_conditions(recorded).wind_mps, 0.0);
  ConfigReader strict = ConfigReader::from_text(old, "old");
  EXPECT_THROW(read_conditions(strict), ConfigError);
  for (const char* wrong : {"wind_mps: -1\nwind_from_deg: 0\n", "wind_mps: 31\nwind_from_deg: 0\n",
                            "wind_mps: 5\nwind_from_deg: 361\n"}) {
    ConfigReader reader = ConfigReader::from_text(old + wrong, "wrong");
    EXPECT_THROW(read_conditions(reader), ConfigError) << wrong;
  }
  ConfigReader right = ConfigReader::from_text(old + "wind_mps: 5\nwind_from_deg: 90\n", "right");
  EXPECT_NEAR(read_conditions(right).wind_from_true_rad, 0.5 * kPi, 1e-12);
}

}  // namespace
}  // namespace hedgehop::flight
