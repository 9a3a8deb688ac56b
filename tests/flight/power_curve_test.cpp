#include "flight/power_curve.hpp"

#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <random>
#include <string>

#include "base/errors.hpp"
#include "base/shipped_config.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::flight {
namespace {

constexpr double kG_mps2 = 9.80665;

PowerCurve shipped_curve() {
  auto reader = ConfigReader::from_text(shipped_config("vehicles/ec135.yaml"), "ec135.yaml");
  auto section = reader.required_section("power");
  return read_power_curve(section);
}

TEST(AirDensity, IsThatOfTheStandardAtmosphereTables) {
  EXPECT_NEAR(air_density_kgpm3(0.0), 1.2250, 1e-4);
  EXPECT_NEAR(air_density_kgpm3(1000.0), 1.1116, 1e-4);
  EXPECT_NEAR(air_density_kgpm3(3000.0), 0.9091, 2e-4);
}

TEST(AirDensity, OfWarmerAirIsLessInTheRatioOfTheTemperatures) {
  EXPECT_NEAR(air_density_kgpm3(0.0, 20.0), 1.225 * 288.15 / 308.15, 1e-6);
  // 2000 m: 275.15 K
  EXPECT_NEAR(air_density_kgpm3(2000.0, -10.0) / air_density_kgpm3(2000.0), 275.15 / 265.15, 1e-4);
}

TEST(PowerLimits, InTheHoverAskForTheIdealPowerTimesItsFactorAndTheBladeDrag) {
  const PowerCurve curve = shipped_curve();
  const PowerLimits power(curve, {true, 2500.0, 0.0, 0.0});
  const double weight_n = 2500.0 * kG_mps2;
  const double area_m2 = std::numbers::pi * curve.rotor_radius_m * curve.rotor_radius_m;
  const double ideal_w = weight_n * std::sqrt(weight_n / (2.0 * 1.225 * area_m2));
  const double blades_w = curve.solidity * curve.profile_drag / 8.0 * 1.225 * area_m2 *
                          std::pow(curve.tip_speed_mps, 3.0);
  EXPECT_NEAR(power.required_w(0.0, 0.0), curve.induced_factor * ideal_w + blades_w, 1.0);
}

TEST(PowerLimits, FarAboveTheInducedVelocityInducedPowerIsThatOfAWing) {
  // v_i = v_h^2 / V: W^2 kappa / (2 rho A V), left when all drag is gone.
  PowerCurve curve = shipped_curve();
  curve.profile_drag = 1e-12;
  curve.flat_plate_m2 = 1e-12;
  const double weight_n = curve.mass_kg * kG_mps2;
  const double area_m2 = std::numbers::pi * curve.rotor_radius_m * curve.rotor_radius_m;
  const double wing_w =
      curve.induced_factor * weight_n * weight_n / (2.0 * 1.225 * area_m2 * 200.0);
  EXPECT_NEAR(PowerLimits(curve, {true, 0.0, 0.0, 0.0}).required_w(200.0, 0.0) / wing_w, 1.0, 1e-4);
}

TEST(PowerLimits, ClimbAndDescentTogetherAreThePowerAvailableOverTheWeight) {
  const PowerCurve curve = shipped_curve();
  std::mt19937_64 random(test::fresh_seed());
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (int k = 0; k < 200; ++k) {
    const Conditions conditions{true, uniform(1800.0, 2910.0), uniform(-30.0, 40.0),
                                uniform(0.0, 0.3)};
    const PowerLimits power(curve, conditions);
    const double altitude_m = uniform(-200.0, 6000.0);
    const VerticalRates rates = power.rates(uniform(40.0, 62.0), altitude_m);
    EXPECT_NEAR((rates.climb_mps + rates.descent_mps) * conditions.mass_kg * kG_mps2,
                power.available_w(altitude_m), 1e-6);
  }
}

TEST(PowerLimits, TheGearsBindBelowAndTheDensityAbove) {
  PowerCurve curve = shipped_curve();
  curve.gears_w = 500e3;
  curve.engines_w = 600e3;
  curve.engine_density_power = 1.0;
  curve.share_of_rotor = 0.8;
  const PowerLimits power(curve, {true, 0.0, 0.0, 0.25});
  EXPECT_NEAR(power.available_w(0.0), 0.8 * 0.75 * 500e3, 1e-6);
  EXPECT_NEAR(power.available_w(1000.0), 0.8 * 0.75 * 500e3, 1e-6);  // 600 * 0.907 > 500
  EXPECT_NEAR(power.available_w(3000.0), 0.8 * 0.75 * 600e3 * 0.9091 / 1.225, 100.0);
}

TEST(PowerLimits, AHeavierHotterOrHigherHelicopterClimbsLess) {
  const PowerCurve curve = shipped_curve();
  for (const double speed_mps : {20.0, 40.0, 60.0}) {
    const auto climb_mps = [&](double mass_kg, double deviation_k, double altitude_m) {
      return PowerLimits(curve, {true, mass_kg, deviation_k, 0.1})
          .rates(speed_mps, altitude_m)
          .climb_mps;
    };
    EXPECT_LT(climb_mps(2900.0, 0.0, 4500.0), climb_mps(2400.0, 0.0, 4500.0) - 1.0);
    EXPECT_LT(climb_mps(2700.0, 25.0, 4500.0), climb_mps(2700.0, 0.0, 4500.0) - 0.3);
    EXPECT_LT(climb_mps(2700.0, 0.0, 5500.0), climb_mps(2700.0, 0.0, 4500.0) - 0.5);
  }
}

TEST(PowerLimits, TheShippedHelicopterClimbsAsItsTypeIsSaidTo) {
  // Published for the EC135: 1653 ft/min at 2720 kg, 8.4 m/s; at its best speed at sea level.
  const PowerLimits power(shipped_curve(), {true, 2720.0, 0.0, 0.0});
  double best_mps = 0.0;
  for (double speed_mps = 15.0; speed_mps <= 62.0; speed_mps += 1.0) {
    best_mps = std::max(best_mps, power.rates(speed_mps, 0.0).climb_mps);
  }
  EXPECT_NEAR(best_mps, 8.4, 0.15 * 8.4);
}

TEST(PowerLimits, SlowFlightSinksNoFasterThanTheVortexRingAllows) {
  const PowerCurve curve = shipped_curve();
  const PowerLimits power(curve, {true, 0.0, 0.0, 0.0});
  EXPECT_DOUBLE_EQ(power.rates(0.0, 0.0).descent_mps, curve.vortex_descent_mps);
  EXPECT_DOUBLE_EQ(power.rates(curve.vortex_speed_mps, 0.0).descent_mps, curve.vortex_descent_mps);
  EXPECT_NEAR(power.rates(curve.vortex_speed_mps + 5.0, 0.0).descent_mps,
              curve.vortex_descent_mps + 5.0 * curve.vortex_descent_slope, 1e-9);
  EXPECT_NEAR(power.rates(40.0, 0.0).descent_mps,
              power.required_w(40.0, 0.0) / (curve.mass_kg * kG_mps2), 1e-9);
}

TEST(PowerLimits, AMassThatTheVehicleMayNotHaveIsRefused) {
  try {
    PowerLimits(shipped_curve(), {true, 2911.0, 0.0, 0.0});
    FAIL() << "accepted 2911 kg";
  } catch (const ConfigError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("mass_max_kg"));
  }
}

}  // namespace
}  // namespace hedgehop::flight
