#include "command_model/rotor_plant.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <numbers>
#include <vector>

#include "base/angles.hpp"
#include "base/shipped_config.hpp"
#include "command_model/path_flight.hpp"

namespace hedgehop::command_model {
namespace {

RotorParameters shipped_rotor() {
  ConfigReader reader = ConfigReader::from_text(shipped_config("rotor_plant.yaml"), "rotor");
  return read_rotor_parameters(reader);
}

FollowerOptions shipped_follower() {
  ConfigReader reader = ConfigReader::from_text(shipped_config("command_model.yaml"), "service");
  ConfigReader section = reader.required_section("path_following");
  return read_follower_options(section);
}

Vehicle shipped_vehicle() {
  ConfigReader reader = ConfigReader::from_text(shipped_config("vehicles/ec135.yaml"), "vehicle");
  return read_vehicle(reader);
}

constexpr double kSeaLevel_kgpm3 = 1.225;

TEST(InducedVelocity, InHoverIsThatOfTheDiscLoading) {
  const double thrust_n = 26478.0;
  const double area_m2 = 81.7;
  EXPECT_NEAR(induced_velocity_mps(thrust_n, area_m2, kSeaLevel_kgpm3, 0.0, 0.0),
              std::sqrt(thrust_n / (2.0 * kSeaLevel_kgpm3 * area_m2)), 1e-9);
  EXPECT_EQ(induced_velocity_mps(0.0, area_m2, kSeaLevel_kgpm3, 10.0, 0.0), 0.0);
}

// v (w + v) = v_h^2 without air along the disc.
TEST(InducedVelocity, InAVerticalClimbSolvesItsQuadraticEquation) {
  const double hover_mps = induced_velocity_mps(26478.0, 81.7, kSeaLevel_kgpm3, 0.0, 0.0);
  for (const double climb_mps : {1.0, 5.0, 12.0}) {
    EXPECT_NEAR(induced_velocity_mps(26478.0, 81.7, kSeaLevel_kgpm3, 0.0, climb_mps),
                -0.5 * climb_mps + std::sqrt(0.25 * climb_mps * climb_mps + hover_mps * hover_mps),
                1e-9);
  }
}

TEST(RotorPlant, HoverTakesTheIdealPowerTimesItsFactorAndTheProfilePower) {
  const RotorPlant plant(shipped_rotor());
  const RotorParameters& p = plant.parameters();
  const RotorPower power = plant.power(plant.trimmed(0, 0, 0, 0.0, 0.0, 0.0, {}), {});
  const double weight_n = p.mass_kg * kGravity_mps2;
  const double area_m2 = std::numbers::pi * p.rotor_radius_m * p.rotor_radius_m;
  EXPECT_NEAR(power.induced_w,
              p.induced_factor * weight_n * std::sqrt(weight_n / (2.0 * 1.225 * area_m2)), 1.0);
  EXPECT_NEAR(power.profile_w,
              p.solidity * p.profile_drag / 8.0 * 1.225 * area_m2 * std::pow(p.tip_speed_mps, 3),
              1.0);
  EXPECT_EQ(power.parasite_w, 0.0);
  EXPECT_NEAR(power.climb_w, 0.0, 1e-6);
}

TEST(RotorPlant, LevelTrimTiltsTheThrustAgainstTheDrag) {
  const RotorPlant plant(shipped_rotor());
  const RotorParameters& p = plant.parameters();
  const double speed_mps = 50.0;
  const RotorState state = plant.trimmed(0, 0, 0, speed_mps, 1.0, 0.0, {});
  const double drag_n = 0.5 * 1.225 * p.flat_plate_m2 * speed_mps * speed_mps;
  const double weight_n = p.mass_kg * kGravity_mps2;
  EXPECT_NEAR(std::tan(state.tilt_rad), drag_n / weight_n, 1e-5);
  EXPECT_NEAR(state.thrust_n, std::hypot(drag_n, weight_n), 0.5);
  const RotorPower power = plant.power(state, {});
  EXPECT_NEAR(power.parasite_w, drag_n * speed_mps, 5.0);
  EXPECT_NEAR(power.climb_w, 0.0, 5.0);
  EXPECT_NEAR(state.power_w, power.total_w(), 1e-9);
}

TEST(RotorPlant, ASteadyClimbTakesTheWeightTimesItsRate) {
  const RotorPlant plant(shipped_rotor());
  const RotorPower power = plant.power(plant.trimmed(0, 0, 0, 40.0, 0.0, 6.0, {}), {});
  EXPECT_NEAR(power.climb_w, plant.parameters().mass_kg * kGravity_mps2 * 6.0, 10.0);
}

// P(V) = kappa W^2 / (2 rho A V) + P_0 (1 + k V^2 / V_tip^2) + rho f V^3 / 2, by momentum theory
// where V is much more than the induced velocity; dP / dV = 0 is solved by bisection.
TEST(RotorPlant, LeastPowerInLevelFlightIsWhereMomentumTheoryHasIt) {
  const RotorPlant plant(shipped_rotor());
  const RotorParameters& p = plant.parameters();
  const double weight_n = p.mass_kg * kGravity_mps2;
  const double area_m2 = plant.disc_area_m2();
  const double profile_w =
      p.solidity * p.profile_drag / 8.0 * 1.225 * area_m2 * std::pow(p.tip_speed_mps, 3);
  const double induced = p.induced_factor * weight_n * weight_n / (2.0 * 1.225 * area_m2);
  const double parasite = 0.5 * 1.225 * p.flat_plate_m2;
  const double growth = p.profile_advance / (p.tip_speed_mps * p.tip_speed_mps);
  double low = 10.0;
  double high = 80.0;
  for (int i = 0; i < 60; ++i) {
    const double v = 0.5 * (low + high);
    const double slope = -induced / (v * v) + 2.0 * profile_w * growth * v + 3.0 * parasite * v * v;
    (slope < 0.0 ? low : high) = v;
  }
  const double least_w =
      induced / low + profile_w * (1.0 + growth * low * low) + parasite * low * low * low;

  double best_mps = 0.0;
  double best_w = 1e12;
  for (double v = 10.0; v <= 70.0; v += 0.1) {
    const double power_w = plant.trimmed(0, 0, 0, v, 0.0, 0.0, {}).power_w;
    if (power_w < best_w) {
      best_w = power_w;
      best_mps = v;
    }
  }
  EXPECT_NEAR(best_mps, low, 0.05 * low);
  EXPECT_NEAR(best_w, least_w, 0.02 * least_w);
  EXPECT_GT(plant.trimmed(0, 0, 0, 0.0, 0.0, 0.0, {}).power_w, 1.5 * best_w);
}

TEST(RotorPlant, TrimmedFlightStaysAsItIs) {
  const RotorPlant plant(shipped_rotor());
  for (const double climb_mps : {0.0, 4.0, -5.0}) {
    const Wind wind{5.0, -3.0};
    RotorState state = plant.trimmed(10.0, 20.0, 500.0, 40.0, 2.0, climb_mps, wind);
    const RotorState first = state;
    for (int i = 0; i < 400; ++i) {
      state = plant.step(state, {40.0, 2.0, climb_mps}, wind, 0.05);
    }
    EXPECT_NEAR(state.east_mps, first.east_mps, 0.05);
    EXPECT_NEAR(state.north_mps, first.north_mps, 0.05);
    EXPECT_NEAR(state.climb_rate_mps, climb_mps, 0.02);
    EXPECT_NEAR(state.altitude_m, 500.0 + 20.0 * climb_mps, 0.5);
    EXPECT_NEAR(state.bank_left_rad, 0.0, 1e-6);
  }
}

// The air knows nothing of the ground below.
TEST(RotorPlant, WindOnlyCarriesTheFlightAlong) {
  const RotorPlant plant(shipped_rotor());
  const Wind wind{6.0, -4.0};
  RotorState calm = plant.trimmed(0, 0, 300.0, 35.0, 0.3, 0.0, {});
  RotorState windy = plant.trimmed(0, 0, 300.0, 35.0, 0.3, 0.0, wind);
  for (int i = 0; i < 300; ++i) {
    const Command command{i < 100 ? 35.0 : 45.0, 0.3 + 0.004 * i, i < 150 ? 3.0 : -3.0};
    calm = plant.step(calm, command, {}, 0.05);
    windy = plant.step(windy, command, wind, 0.05);
  }
  EXPECT_NEAR(windy.x_m - calm.x_m, wind.east_mps * 15.0, 1e-6);
  EXPECT_NEAR(windy.y_m - calm.y_m, wind.north_mps * 15.0, 1e-6);
  EXPECT_NEAR(windy.altitude_m, calm.altitude_m, 1e-6);
  EXPECT_NEAR(windy.power_w, calm.power_w, 1e-3);
}

TEST(RotorPlant, ThrustFollowsItsCollectiveByLagAndRate) {
  RotorParameters p = shipped_rotor();
  const RotorPlant plant(p);
  RotorState state = plant.trimmed(0, 0, 0, 30.0, 0.0, 0.0, {});
  for (int i = 0; i < 100; ++i) {
    const RotorState next = plant.step(state, {30.0, 0.0, 8.0}, {}, 0.01);
    const double change_n = next.collective_n - state.collective_n;
    EXPECT_LE(std::fabs(change_n), p.thrust_rate_max_nps * 0.01 + 1e-6);
    EXPECT_NEAR(next.thrust_n - state.thrust_n,
                (1.0 - std::exp(-0.01 / p.thrust_lag_s)) * (next.collective_n - state.thrust_n),
                1e-6);
    state = next;
  }
}

TEST(RotorPlant, AskedForMoreThanItsPowerItClimbsLessAndTakesHardlyMore) {
  const RotorPlant plant(shipped_rotor());
  RotorState state = plant.trimmed(0, 0, 1500.0, 60.0, 0.0, 0.0, {});
  bool is_limited = false;
  double most = 0.0;
  for (int i = 0; i < 600; ++i) {
    state = plant.step(state, {60.0, 0.0, 15.0}, {}, 0.05);
    most = std::max(most, state.power_w / plant.power_max_w());
    is_limited = is_limited || state.is_power_limited;
  }
  EXPECT_TRUE(is_limited);
  EXPECT_LE(most, 1.06);  // thrust lags behind the collective that is held back
  // In the end all the power goes into the climb that is left.
  const RotorPower level =
      plant.power(plant.trimmed(0, 0, state.altitude_m, state.east_mps, 0, 0, {}), {});
  const double spare_mps =
      (plant.power_max_w() - level.total_w()) / (plant.parameters().mass_kg * kGravity_mps2);
  EXPECT_NEAR(state.climb_rate_mps, spare_mps, 0.5);
}

// A minute of turns to both sides, climbs and descents, as the planner's model flies it.
flight::Trajectory winding_path() {
  const CommandModel model(shipped_vehicle());
  ModelState state = trimmed_state(0, 0, 400.0, 40.0, 0.5, 0.0);
  flight::Trajectory trajectory;
  trajectory.step_s = 0.05;
  for (int i = 0; i < 1200; ++i) {
    flight::FlightState s;
    s.time_s = 0.05 * i;
    s.x_m = state.x_m;
    s.y_m = state.y_m;
    s.altitude_m = state.altitude_m;
    s.speed_mps = state.speed_mps;
    s.heading_true_rad = azimuth_from_math_angle_rad(state.heading_math_rad);
    s.climb_rate_mps = state.climb_rate_mps;
    trajectory.states.push_back(s);
    const double t = 0.05 * i;
    state = model.step(state, {40.0, 0.5 + 0.6 * std::sin(t / 6.0), 4.0 * std::sin(t / 4.0)}, 0.05);
  }
  return trajectory;
}

Plant closed_loop() { return std::make_shared<const CommandModel>(shipped_vehicle()); }
Plant rotor() { return std::make_shared<const RotorPlant>(shipped_rotor()); }

TEST(PathFlight, BothPlantsKeepAWindingPathWithFeedForwardWithAndWithoutWind) {
  const flight::Trajectory path = winding_path();
  for (const Plant& plant : {closed_loop(), rotor()}) {
    for (const Wind& wind : {Wind{}, Wind{8.0, 0.0}, Wind{-4.0, 7.0}}) {
      const PathFlight flight = flown_path(path, plant, shipped_follower(), true, wind);
      EXPECT_TRUE(flight.has_arrived());
      EXPECT_LT(flight.record().horizontal_max_m, 4.0) << plant.index() << ' ' << wind.east_mps;
      EXPECT_LT(flight.record().below_max_m, 2.0) << plant.index() << ' ' << wind.east_mps;
      EXPECT_LT(flight.record().above_max_m, 2.0) << plant.index() << ' ' << wind.east_mps;
      EXPECT_EQ(flight.record().power_limited_steps, 0);
    }
  }
}

TEST(RotorPlant, AnUpdraftLiftsByBladeElementsAndMomentumTheory) {
  const RotorPlant plant(shipped_rotor());
  const RotorParameters& p = plant.parameters();
  const RotorState state = plant.trimmed(0, 0, 0.0, 40.0, 0.0, 0.0, {});
  const Command command{40.0, 0.0, 0.0};
  const double calm_mps = plant.step(state, command, {}, 0.01).climb_rate_mps;
  const double lifted_mps = plant.step(state, command, {}, 0.01, 2.0).climb_rate_mps;
  // C_T = a s / 4 (w / V_tip - lambda), lambda = C_T / (2 mu): with 1.225 kg/m3, mu = 40 / 211,
  // a s = 5.7 * 0.072 = 0.4104, dC_T / dw = a s / 4 / (1 + a s / (8 mu)) = 0.0807, so 2 m/s give
  // 1.225 * 81.71 * 211 * 0.0807 * 2 = 3411 N, and the airframe's drag is 1.225 / 2 * 1.3 * 40 * 2
  // = 64 N upwards, of 2700 kg: 1.287 m/s2.
  EXPECT_NEAR((lifted_mps - calm_mps) / 0.01, 1.287, 0.01);
  EXPECT_EQ(p.lift_slope_1prad, 5.7);
  // The rising air does some of the work.
  EXPECT_LT(plant.power(state, {}, 2.0).total_w(), plant.power(state, {}).total_w());
}

TEST(PathFlight, TurbulenceShakesBothPlantsMoreTheStrongerItIsAndTheSameEachTime) {
  flight::Trajectory path;  // straight and level, 30 m above the ground
  path.step_s = 0.05;
  for (int i = 0; i < 2400; ++i) {
    flight::FlightState s;
    s.x_m = 2.0 * i;
    s.altitude_m = 30.0;
    s.speed_mps = 40.0;
    s.heading_true_rad = 0.5 * std::numbers::pi;
    path.states.push_back(s);
  }
  for (const Plant& plant : {closed_loop(), rotor()}) {
    const auto flown = [&](double wind_6m_mps, std::uint64_t seed) {
      return flown_path(path, plant, shipped_follower(), true, {}, {}, {wind_6m_mps, seed});
    };
    const PathRecord calm = flown(0.0, 3).record();
    const PathRecord light = flown(4.0, 3).record();
    const PathFlight strong = flown(12.0, 3);
    EXPECT_TRUE(strong.has_arrived()) << plant.index();
    EXPECT_GT(light.vertical_rms_m(), calm.vertical_rms_m()) << plant.index();
    EXPECT_GT(strong.record().vertical_rms_m(), light.vertical_rms_m()) << plant.index();
    EXPECT_GT(strong.record().horizontal_rms_m(), light.horizontal_rms_m()) << plant.index();
    EXPECT_LT(strong.record().horizontal_max_m, 30.0) << plant.index();
    EXPECT_LT(strong.record().below_max_m, 15.0) << plant.index();
    EXPECT_EQ(flown(12.0, 3).record().below_max_m, strong.record().below_max_m);
    EXPECT_NE(flown(12.0, 4).record().below_max_m, strong.record().below_max_m);
  }
}

TEST(PathFlight, AWindingPathIsKeptWithThePlansStatesAndWithItsLineAlone) {
  const flight::Trajectory path = winding_path();
  flight::Trajectory line = path;
  for (flight::FlightState& state : line.states) {
    state.climb_rate_mps = 0.0;  // nobody may look at it
  }
  FollowerOptions unled = shipped_follower();
  unled.turn_lead_s = 0.0;
  unled.climb_lead_s = 0.0;
  for (const Plant& plant : {closed_loop(), rotor()}) {
    const PathRecord with = flown_path(path, plant, shipped_follower(), true, {}).record();
    const PathRecord without = flown_path(line, plant, shipped_follower(), false, {}).record();
    const PathRecord late = flown_path(line, plant, unled, false, {}).record();
    for (const PathRecord& record : {with, without}) {
      EXPECT_LT(record.horizontal_max_m, 6.0) << plant.index();
      EXPECT_LT(record.below_max_m, 3.0) << plant.index();
      EXPECT_LT(record.above_max_m, 3.0) << plant.index();
      EXPECT_LT(record.horizontal_rms_m(), 0.7 * late.horizontal_rms_m()) << plant.index();
      EXPECT_LT(record.vertical_rms_m(), 0.7 * late.vertical_rms_m()) << plant.index();
    }
  }
}

TEST(PathFlight, AVehicleBesideAStraightPathComesBackToIt) {
  flight::Trajectory path;
  path.step_s = 0.05;
  for (int i = 0; i < 1200; ++i) {
    flight::FlightState s;
    s.x_m = 2.0 * i;
    s.altitude_m = 400.0;
    s.speed_mps = 40.0;
    s.heading_true_rad = azimuth_from_math_angle_rad(0.0);
    path.states.push_back(s);
  }
  for (const Plant& plant : {closed_loop(), rotor()}) {
    PathFlight flight(path, plant, shipped_follower(), true, {0.0, 9.0});
    for (int i = 0; i < 1000; ++i) {
      flight.step();
    }
    EXPECT_NEAR(flight.state().y_m, 0.0, 0.3) << plant.index();
    EXPECT_NEAR(flight.state().altitude_m, 400.0, 0.3) << plant.index();
  }
}

}  // namespace
}  // namespace hedgehop::command_model
