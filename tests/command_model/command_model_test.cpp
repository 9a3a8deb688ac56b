#include "command_model/command_model.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstdint>
#include <gtest/gtest.h>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "base/angles.hpp"
#include "base/shipped_config.hpp"

namespace hedgehop::command_model {
namespace {

constexpr double kPi = std::numbers::pi;

Vehicle shipped_vehicle() {
  ConfigReader reader =
      ConfigReader::from_text(shipped_config("vehicles/ec135.yaml"), "vehicles/ec135.yaml");
  return read_vehicle(reader);
}

ModelState level_flight(double speed_mps) {
  return trimmed_state(0.0, 0.0, 100.0, speed_mps, 0.0, 0.0);
}

TEST(CommandModel, TrimmedFlightStaysOnAStraightLine) {
  const CommandModel model(shipped_vehicle());
  ModelState state = trimmed_state(10.0, -20.0, 300.0, 40.0, 0.5 * kPi, 3.0);
  for (int i = 0; i < 200; ++i) {
    state = model.step(state, {40.0, 0.5 * kPi, 3.0}, 0.05);
  }
  EXPECT_NEAR(state.x_m, 10.0, 1e-9);
  EXPECT_NEAR(state.y_m, -20.0 + 40.0 * 10.0, 1e-9);
  EXPECT_NEAR(state.altitude_m, 300.0 + 3.0 * 10.0, 1e-9);
  EXPECT_EQ(state.bank_left_rad, 0.0);
  EXPECT_NEAR(state.climb_rate_mps, 3.0, 1e-12);
}

// A turn at constant bank is a circle in the air; over the ground it is the trochoid
// x(t) = r sin(V t / r) + w_x t, y(t) = r (1 - cos(V t / r)) + w_y t.
TEST(CommandModel, AConstantBankInWindFliesTheTrochoid) {
  Vehicle vehicle = shipped_vehicle();
  vehicle.wind = {-9.0, 5.0};
  const CommandModel model(vehicle);
  ModelState state = level_flight(40.0);
  state.bank_left_rad = model.bank_command_max_rad();
  const double radius_m = 40.0 * 40.0 / (9.80665 * std::tan(state.bank_left_rad));
  for (int i = 1; i <= 1200; ++i) {
    state = model.step(state, {40.0, state.heading_math_rad + 3.0, 0.0}, 0.05);
    const double t = 0.05 * i;
    const double turned_rad = 40.0 * t / radius_m;
    EXPECT_NEAR(state.x_m, radius_m * std::sin(turned_rad) - 9.0 * t, 0.01);
    EXPECT_NEAR(state.y_m, radius_m * (1.0 - std::cos(turned_rad)) + 5.0 * t, 0.01);
    EXPECT_EQ(state.speed_mps, 40.0);
  }
}

TEST(CommandModel, WindOnlyCarriesTheFlightAlong) {
  Vehicle vehicle = shipped_vehicle();
  const CommandModel calm(vehicle);
  vehicle.wind = {4.0, -11.0};
  const CommandModel windy(vehicle);
  ModelState a = level_flight(40.0);
  ModelState b = a;
  for (int i = 1; i <= 400; ++i) {
    const Command command{35.0 + 5.0 * std::sin(0.03 * i), std::sin(0.02 * i),
                          4.0 * std::sin(0.05 * i)};
    a = calm.step(a, command, 0.05);
    b = windy.step(b, command, 0.05);
    EXPECT_NEAR(b.x_m - a.x_m, 4.0 * 0.05 * i, 1e-9);
    EXPECT_NEAR(b.y_m - a.y_m, -11.0 * 0.05 * i, 1e-9);
    EXPECT_EQ(b.heading_math_rad, a.heading_math_rad);
    EXPECT_EQ(b.speed_mps, a.speed_mps);
    EXPECT_EQ(b.altitude_m, a.altitude_m);
  }
}

TEST(CommandModel, RollInFollowsTheSecondOrderStepResponse) {
  Vehicle vehicle = shipped_vehicle();
  vehicle.limits.roll_rate_max_radps = 100.0;
  const CommandModel model(vehicle);
  const double target_rad = model.bank_command_max_rad();
  const double w = vehicle.model.attitude_frequency_radps;
  const double zeta = vehicle.model.attitude_damping;
  const double wd = w * std::sqrt(1.0 - zeta * zeta);
  for (const double step_s : {0.01, 0.05, 0.2}) {
    ModelState state = level_flight(40.0);
    for (int i = 1; i * step_s <= 2.0; ++i) {
      // A heading error of nearly pi saturates the bank command for as long as it lasts.
      state = model.step(state, {40.0, state.heading_math_rad + 3.0, 0.0}, step_s);
      const double t = i * step_s;
      const double closed_form_rad =
          target_rad *
          (1.0 - std::exp(-zeta * w * t) * (std::cos(wd * t) + zeta * w / wd * std::sin(wd * t)));
      EXPECT_NEAR(state.bank_left_rad, closed_form_rad, 1e-12) << "step " << step_s << " t " << t;
      const double closed_form_rate_radps =
          target_rad * w * w / wd * std::exp(-zeta * w * t) * std::sin(wd * t);
      EXPECT_NEAR(state.roll_rate_left_radps, closed_form_rate_radps, 1e-12);
    }
  }
}

TEST(CommandModel, SteadyTurnHasTheCoordinatedRadius) {
  const Vehicle vehicle = shipped_vehicle();
  const CommandModel model(vehicle);
  for (const double speed_mps : {20.0, 40.0, 60.0}) {
    ModelState state = level_flight(speed_mps);
    const auto turn_left = [&] {
      state = model.step(state, {speed_mps, state.heading_math_rad + 2.5, 0.0}, 0.05);
    };
    for (int i = 0; i < 200; ++i) {
      turn_left();
    }
    // Three points of a circle give its centre.
    std::vector<ModelState> points;
    for (int i = 0; i < 3; ++i) {
      points.push_back(state);
      for (int j = 0; j < 60; ++j) {
        turn_left();
      }
    }
    const double ax = points[0].x_m, ay = points[0].y_m;
    const double bx = points[1].x_m - ax, by = points[1].y_m - ay;
    const double cx = points[2].x_m - ax, cy = points[2].y_m - ay;
    const double d = 2.0 * (bx * cy - by * cx);
    const double ux = (cy * (bx * bx + by * by) - by * (cx * cx + cy * cy)) / d;
    const double uy = (bx * (cx * cx + cy * cy) - cx * (bx * bx + by * by)) / d;
    const double expected_m =
        speed_mps * speed_mps / (9.80665 * std::tan(model.bank_command_max_rad()));
    EXPECT_NEAR(std::hypot(ux, uy), expected_m, 1e-4 * expected_m);
    EXPECT_GT(d, 0.0) << "the turn goes to the left";
  }
}

TEST(CommandModel, HeaveFollowsTheFirstOrderStepResponse) {
  // With P control alone: T h'' = K (c - h') - h', so h' = c K / (1 + K) (1 - exp(-(1 + K) t / T)).
  Vehicle vehicle = shipped_vehicle();
  vehicle.model.climb_integral_gain_1ps = 0.0;
  vehicle.model.climb_derivative_gain_s = 0.0;
  vehicle.limits.vertical_acceleration_max_mps2 = 1000.0;
  const CommandModel model(vehicle);
  const double gain = vehicle.model.climb_gain;
  const double step_s = 0.0005;
  ModelState state = level_flight(40.0);
  double altitude_m = state.altitude_m;
  const double rate = (1.0 + gain) / vehicle.model.heave_time_constant_s;
  for (int i = 1; i <= 4000; ++i) {
    state = model.step(state, {40.0, 0.0, 5.0}, step_s);
    const double t = i * step_s;
    const double steady_mps = 5.0 * gain / (1.0 + gain);
    EXPECT_NEAR(state.climb_rate_mps, steady_mps * (1.0 - std::exp(-rate * t)), 2e-3);
    altitude_m = 100.0 + steady_mps * (t - (1.0 - std::exp(-rate * t)) / rate);
  }
  EXPECT_NEAR(state.altitude_m, altitude_m, 2e-3);
}

TEST(CommandModel, PitchFollowsTheSecondOrderStepResponse) {
  Vehicle vehicle = shipped_vehicle();
  vehicle.model.pitch_rate_max_radps = 100.0;
  const CommandModel model(vehicle);
  const double w = vehicle.model.attitude_frequency_radps;
  const double zeta = vehicle.model.attitude_damping;
  const double wd = w * std::sqrt(1.0 - zeta * zeta);
  // A great speed error holds the command where its worst overshoot still keeps the limit.
  const double overshoot = std::exp(-kPi * zeta * w / wd);
  const double target_rad = -vehicle.limits.pitch_max_rad * (1.0 - overshoot) / (1.0 + overshoot);
  for (const double step_s : {0.01, 0.05, 0.2}) {
    ModelState state = level_flight(20.0);
    for (int i = 1; i * step_s <= 2.0; ++i) {
      state = model.step(state, {60.0, 0.0, 0.0}, step_s);
      const double t = i * step_s;
      EXPECT_NEAR(state.pitch_rad,
                  target_rad * (1.0 - std::exp(-zeta * w * t) *
                                          (std::cos(wd * t) + zeta * w / wd * std::sin(wd * t))),
                  1e-12)
          << "step " << step_s << " t " << t;
      EXPECT_NEAR(state.pitch_rate_radps,
                  target_rad * w * w / wd * std::exp(-zeta * w * t) * std::sin(wd * t), 1e-12);
    }
  }
}

// e''' + a e'' + b e' + c e = 0 from e = 1, e' = e'' = 0: a sum of three exponentials whose rates
// are the roots of the polynomial, found by the iteration of Durand and Kerner.
class ThirdOrderError {
 public:
  ThirdOrderError(double a, double b, double c) {
    for (int i = 0; i < 200; ++i) {
      for (std::size_t k = 0; k < 3; ++k) {
        const Complex s = roots_[k];
        roots_[k] -=
            (((s + a) * s + b) * s + c) / ((s - roots_[(k + 1) % 3]) * (s - roots_[(k + 2) % 3]));
      }
    }
  }
  [[nodiscard]] double at(double t) const {
    Complex sum = 0.0;
    for (std::size_t k = 0; k < 3; ++k) {
      const Complex s1 = roots_[(k + 1) % 3];
      const Complex s2 = roots_[(k + 2) % 3];
      sum += s1 * s2 / ((s1 - roots_[k]) * (s2 - roots_[k])) * std::exp(roots_[k] * t);
    }
    EXPECT_NEAR(sum.imag(), 0.0, 1e-9);
    return sum.real();
  }

 private:
  using Complex = std::complex<double>;
  std::array<Complex, 3> roots_{Complex(1.0, 0.0), Complex(0.4, 0.9), Complex(-0.65, 0.72)};
};

TEST(CommandModel, SmallHeadingStepsFollowTheThirdOrderLoop) {
  // psi = chi_c - chi: psi''' + 2 zeta w psi'' + w^2 (1 + k_r) psi' + w^2 k_chi psi = 0, at each
  // speed.
  const Vehicle vehicle = shipped_vehicle();
  const CommandModel model(vehicle);
  const double w = vehicle.model.attitude_frequency_radps;
  const ThirdOrderError closed_form(2.0 * vehicle.model.attitude_damping * w,
                                    w * w * (1.0 + vehicle.model.heading_rate_damping),
                                    w * w * vehicle.model.heading_gain_1ps);
  constexpr double kTurn_rad = 0.01;
  for (const double speed_mps : {20.0, 40.0, 60.0}) {
    // The command is held over a step, which is a lag of half a step.
    for (const auto& [step_s, tolerance] : {std::pair(0.002, 2e-3), std::pair(0.05, 0.03)}) {
      ModelState state = level_flight(speed_mps);
      for (int i = 1; i * step_s <= 8.0; ++i) {
        state = model.step(state, {speed_mps, kTurn_rad, 0.0}, step_s);
        ASSERT_NEAR(1.0 - state.heading_math_rad / kTurn_rad, closed_form.at(i * step_s), tolerance)
            << speed_mps << " m/s, step " << step_s << " t " << i * step_s;
      }
    }
  }
}

TEST(CommandModel, SmallSpeedStepsFollowTheThirdOrderLoop) {
  // e = V_c - V: e''' + 2 zeta w e'' + w^2 e' + w^2 g k_V e = 0
  const Vehicle vehicle = shipped_vehicle();
  const CommandModel model(vehicle);
  const double w = vehicle.model.attitude_frequency_radps;
  const ThirdOrderError closed_form(2.0 * vehicle.model.attitude_damping * w, w * w,
                                    w * w * 9.80665 * vehicle.model.speed_gain_radpmps);
  for (const double speed_mps : {20.0, 40.0, 60.0}) {
    for (const auto& [step_s, tolerance] : {std::pair(0.002, 2e-3), std::pair(0.05, 0.02)}) {
      ModelState state = level_flight(speed_mps);
      for (int i = 1; i * step_s <= 15.0; ++i) {
        state = model.step(state, {speed_mps + 0.1, 0.0, 0.0}, step_s);
        ASSERT_NEAR((speed_mps + 0.1 - state.speed_mps) / 0.1, closed_form.at(i * step_s),
                    tolerance)
            << speed_mps << " m/s, step " << step_s << " t " << i * step_s;
      }
    }
  }
}

TEST(CommandModel, SmallClimbStepsFollowTheSecondOrderLoop) {
  // (T + K_d) v'' + (1 + K_p) v' + K_i v = K_i c from v = 0, v' = K_p c / (T + K_d)
  using Complex = std::complex<double>;
  const Vehicle vehicle = shipped_vehicle();
  const CommandModel model(vehicle);
  const double lead_s = vehicle.model.heave_time_constant_s + vehicle.model.climb_derivative_gain_s;
  const double middle = 1.0 + vehicle.model.climb_gain;
  const Complex root = std::sqrt(
      Complex(middle * middle - 4.0 * lead_s * vehicle.model.climb_integral_gain_1ps, 0.0));
  const Complex s1 = (-middle + root) / (2.0 * lead_s);
  const Complex s2 = (-middle - root) / (2.0 * lead_s);
  const Complex first = (vehicle.model.climb_gain / lead_s + s2) / (s1 - s2);
  const Complex second = -1.0 - first;
  for (const auto& [step_s, tolerance] : {std::pair(0.001, 2e-3), std::pair(0.05, 0.06)}) {
    ModelState state = level_flight(40.0);
    for (int i = 1; i * step_s <= 8.0; ++i) {
      state = model.step(state, {40.0, 0.0, 1.0}, step_s);
      const double t = i * step_s;
      const double closed_form_mps =
          1.0 + (first * std::exp(s1 * t) + second * std::exp(s2 * t)).real();
      ASSERT_NEAR(state.climb_rate_mps, closed_form_mps, tolerance)
          << "step " << step_s << " t " << t;
    }
  }
}

TEST(CommandModel, ControllersLeaveNoSteadyError) {
  const CommandModel model(shipped_vehicle());
  ModelState state = level_flight(40.0);
  for (int i = 0; i < 1200; ++i) {
    state = model.step(state, {46.0, -2.0, -4.0}, 0.05);
  }
  EXPECT_NEAR(state.speed_mps, 46.0, 1e-6);
  EXPECT_NEAR(state.heading_math_rad, -2.0, 1e-6);
  EXPECT_NEAR(state.climb_rate_mps, -4.0, 1e-6);
  EXPECT_NEAR(state.bank_left_rad, 0.0, 1e-6);
  EXPECT_NEAR(state.pitch_rad, 0.0, 1e-6);
}

TEST(CommandModel, HeadingStepDoesNotOvershootByMoreThanOnePercent) {
  const CommandModel model(shipped_vehicle());
  for (const double speed_mps : {20.0, 40.0, 60.0}) {
    ModelState state = level_flight(speed_mps);
    double greatest_rad = 0.0;
    for (int i = 0; i < 800; ++i) {
      state = model.step(state, {speed_mps, 0.5, 0.0}, 0.05);
      greatest_rad = std::max(greatest_rad, state.heading_math_rad);
    }
    EXPECT_LE(greatest_rad, 0.5 * 1.01);
  }
}

TEST(CommandModel, RandomCommandsNeverTakeMorePowerThanThereIs) {
  Vehicle vehicle = shipped_vehicle();
  const flight::Conditions heavy_and_hot{true, 2900.0, 25.0, 0.1};
  vehicle.power_limits.emplace(*vehicle.power, heavy_and_hot);
  const CommandModel model(vehicle);
  const std::uint64_t seed = std::random_device{}();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937_64 random(seed);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  int at_limit = 0;
  for (int flight = 0; flight < 20; ++flight) {
    const double step_s = flight % 4 == 0 ? 0.2 : uniform(0.01, 0.2);
    ModelState state = level_flight(35.0);  // where there is power to climb
    state.altitude_m = uniform(1000.0, 3500.0);
    Command command{40.0, 0.0, 0.0};
    for (int i = 0; i < 1000; ++i) {
      if (uniform(0.0, 1.0) < 0.02) {
        command.speed_mps = uniform(-50.0, 150.0);
        command.climb_rate_mps = uniform(-30.0, 30.0);
      }
      state = model.step(state, command, step_s);
      const flight::VerticalRates rates =
          vehicle.power_limits->rates(state.speed_mps, state.altitude_m);
      ASSERT_LE(state.climb_rate_mps, std::min(rates.climb_mps, 8.0));
      ASSERT_LE(-state.climb_rate_mps, std::min(rates.descent_mps, 8.0));
      ASSERT_LE(std::fabs(state.vertical_acceleration_mps2),
                vehicle.limits.vertical_acceleration_max_mps2 * (1.0 + 1e-9));
      at_limit += state.climb_rate_mps > rates.climb_mps - 0.1 ? 1 : 0;
    }
  }
  EXPECT_GT(at_limit, 100);
}

TEST(CommandModel, RandomCommandsNeverBreakALimit) {
  const Vehicle vehicle = shipped_vehicle();
  const CommandModel model(vehicle);
  const flight::Limits& limits = vehicle.limits;
  const auto seed = std::random_device{}();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937_64 random(seed);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  const double rounding = 1.0 + 1e-9;
  for (int flight = 0; flight < 40; ++flight) {
    const double step_s = flight % 4 == 0 ? 0.2 : uniform(0.01, 0.2);
    ModelState state = level_flight(uniform(limits.speed_min_mps, limits.speed_max_mps));
    Command command{40.0, 0.0, 0.0};
    // Bang-bang commands at every pace, the resonant one included, and far beyond what is allowed.
    const double change_share = uniform(0.005, 0.5);
    for (int i = 0; i < 2000; ++i) {
      if (uniform(0.0, 1.0) < change_share) {
        command.speed_mps = uniform(-50.0, 150.0);
        command.climb_rate_mps = uniform(-30.0, 30.0);
      }
      if (uniform(0.0, 1.0) < change_share) {
        command.heading_math_rad = uniform(-10.0, 10.0);
      }
      const ModelState next = model.step(state, command, step_s);
      ASSERT_LE(std::fabs(next.bank_left_rad), limits.bank_max_rad * rounding);
      ASSERT_LE(std::fabs(next.roll_rate_left_radps), limits.roll_rate_max_radps * rounding);
      ASSERT_LE(std::fabs(next.bank_left_rad - state.bank_left_rad),
                limits.roll_rate_max_radps * step_s * rounding);
      ASSERT_LE(std::fabs(next.pitch_rad), limits.pitch_max_rad * rounding);
      ASSERT_LE(std::fabs(next.pitch_rate_radps), vehicle.model.pitch_rate_max_radps * rounding);
      ASSERT_GE(next.speed_mps, limits.speed_min_mps);
      ASSERT_LE(next.speed_mps, limits.speed_max_mps);
      ASSERT_LE(next.climb_rate_mps, limits.climb_rate_max_mps);
      ASSERT_GE(next.climb_rate_mps, -limits.descent_rate_max_mps);
      ASSERT_LE(std::fabs(next.vertical_acceleration_mps2),
                limits.vertical_acceleration_max_mps2 * rounding);
      ASSERT_LE(std::fabs(next.climb_rate_mps - state.climb_rate_mps),
                limits.vertical_acceleration_max_mps2 * step_s * rounding);
      // Neighbouring states agree: speed with pitch, whether or not a limit was met.
      const double speed_change_mps =
          -9.80665 * step_s * 0.5 * (std::tan(state.pitch_rad) + std::tan(next.pitch_rad));
      if (next.speed_mps > limits.speed_min_mps && next.speed_mps < limits.speed_max_mps) {
        ASSERT_NEAR(next.speed_mps - state.speed_mps, speed_change_mps, 1e-9);
      }
      const double turn_rad = step_s * 9.80665 * 0.5 *
                              (std::tan(state.bank_left_rad) / state.speed_mps +
                               std::tan(next.bank_left_rad) / next.speed_mps);
      ASSERT_NEAR(wrap_to_pi(next.heading_math_rad - state.heading_math_rad - turn_rad), 0.0, 1e-9);
      state = next;
    }
  }
}

TEST(CommandModel, PositionAgreesWithTheVelocityToSecondOrderOfTheStep) {
  // The chord between two states against the arc of mean speed and mean heading.
  const CommandModel model(shipped_vehicle());
  double residual_m[2] = {0.0, 0.0};
  for (const int halvings : {0, 1}) {
    const double step_s = 0.1 / (1 << halvings);
    ModelState state = level_flight(40.0);
    for (int i = 0; i < static_cast<int>(12.0 / step_s + 0.5); ++i) {
      const ModelState next = model.step(state, {45.0, 2.0, 4.0}, step_s);
      const double turn_rad = wrap_to_pi(next.heading_math_rad - state.heading_math_rad);
      const double middle_rad = state.heading_math_rad + 0.5 * turn_rad;
      const double arc_m = 0.5 * (state.speed_mps + next.speed_mps) * step_s;
      residual_m[halvings] = std::max(
          residual_m[halvings], std::hypot(next.x_m - state.x_m - arc_m * std::cos(middle_rad),
                                           next.y_m - state.y_m - arc_m * std::sin(middle_rad)));
      EXPECT_NEAR(next.altitude_m - state.altitude_m,
                  0.5 * step_s * (state.climb_rate_mps + next.climb_rate_mps), 1e-9);
      state = next;
    }
  }
  EXPECT_LT(residual_m[0], 1e-3);
  EXPECT_LT(residual_m[1], residual_m[0] / 6.0) << "third order for one step";
}

TEST(CommandModel, FlightDependsLittleOnTheStep) {
  const CommandModel model(shipped_vehicle());
  const auto flown = [&](double step_s) {
    ModelState state = level_flight(40.0);
    for (int i = 0; i < static_cast<int>(40.0 / step_s + 0.5); ++i) {
      const double t = i * step_s;
      state = model.step(
          state, {t < 20.0 ? 40.0 : 30.0, t < 10.0 ? 1.0 : -0.5, t < 16.0 ? 6.0 : -3.0}, step_s);
    }
    return state;
  };
  const ModelState fine = flown(0.001);
  const auto distance_m = [&](const ModelState& state) {
    return std::hypot(state.x_m - fine.x_m, state.y_m - fine.y_m);
  };
  // 40 s of flight are about 1,400 m.
  EXPECT_LT(distance_m(flown(0.05)), 5.0);
  EXPECT_LT(distance_m(flown(0.2)), 20.0);
  EXPECT_LT(distance_m(flown(0.05)), distance_m(flown(0.2)));
  EXPECT_NEAR(flown(0.05).altitude_m, fine.altitude_m, 1.0);
  EXPECT_NEAR(flown(0.2).altitude_m, fine.altitude_m, 4.0);
}

TEST(CommandModel, EveryLoopSettlesFromTwentyToSixtyMetresPerSecondForStepsUpToAFifthOfASecond) {
  const CommandModel model(shipped_vehicle());
  for (const double speed_mps : {20.0, 30.0, 40.0, 50.0, 60.0}) {
    for (const double step_s : {0.01, 0.05, 0.1, 0.15, 0.2}) {
      const Command command{speed_mps + (speed_mps < 40.0 ? 5.0 : -5.0), 1.0, 5.0};
      ModelState state = level_flight(speed_mps);
      double late_rates = 0.0;
      for (int i = 0; i * step_s < 90.0; ++i) {
        state = model.step(state, command, step_s);
        if (i * step_s >= 60.0) {
          late_rates = std::max({late_rates, std::fabs(state.roll_rate_left_radps),
                                 std::fabs(state.pitch_rate_radps),
                                 std::fabs(state.vertical_acceleration_mps2)});
        }
      }
      EXPECT_LT(late_rates, 1e-6) << speed_mps << " m/s, step " << step_s;
      EXPECT_NEAR(state.speed_mps, command.speed_mps, 1e-6);
      EXPECT_NEAR(state.heading_math_rad, 1.0, 1e-6);
      EXPECT_NEAR(state.climb_rate_mps, 5.0, 1e-6);
    }
  }
}

TEST(CommandModel, MirroredCommandsGiveTheMirroredFlight) {
  const CommandModel model(shipped_vehicle());
  ModelState left = level_flight(40.0);
  ModelState right = level_flight(40.0);
  for (int i = 0; i < 400; ++i) {
    const double heading_rad = 1.5 * std::sin(0.02 * i);
    left = model.step(left, {40.0, heading_rad, 1.0}, 0.05);
    right = model.step(right, {40.0, -heading_rad, 1.0}, 0.05);
  }
  EXPECT_NEAR(left.x_m, right.x_m, 1e-9);
  EXPECT_NEAR(left.y_m, -right.y_m, 1e-9);
  EXPECT_NEAR(left.bank_left_rad, -right.bank_left_rad, 1e-12);
  EXPECT_GT(std::fabs(left.y_m), 10.0);
}

TEST(CommandModel, StepOutsideItsRangeIsRefused) {
  const CommandModel model(shipped_vehicle());
  EXPECT_THROW((void)model.step(level_flight(40.0), {}, 0.0), std::invalid_argument);
  EXPECT_THROW((void)model.step(level_flight(40.0), {}, 0.21), std::invalid_argument);
  EXPECT_THROW((void)model.step(level_flight(40.0), {}, std::nan("")), std::invalid_argument);
}

}  // namespace
}  // namespace hedgehop::command_model
