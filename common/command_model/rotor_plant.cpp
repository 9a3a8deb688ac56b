#include "command_model/rotor_plant.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "flight/power_curve.hpp"

namespace hedgehop::command_model {
namespace {

using flight::air_density_kgpm3;

constexpr double kPart_s = 0.01;
constexpr double kAirspeedMin_mps = 3.0;  // below, the nose keeps its direction

struct Vector {
  double x = 0.0;
  double y = 0.0;
  double z = 0.0;
};
double dot(const Vector& a, const Vector& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

// Unit vector of the thrust: forward by the tilt, to the left by the bank.
Vector thrust_direction(const RotorState& state) {
  const elementary::SineCosine heading = elementary::sine_cosine(state.heading_math_rad);
  const elementary::SineCosine bank = elementary::sine_cosine(state.bank_left_rad);
  const elementary::SineCosine tilt = elementary::sine_cosine(state.tilt_rad);
  const double left = tilt.cosine * bank.sine;
  return {tilt.sine * heading.cosine - left * heading.sine,
          tilt.sine * heading.sine + left * heading.cosine, tilt.cosine * bank.cosine};
}

Vector air_velocity(const RotorState& state, const Wind& wind, double updraft_mps) {
  return {state.east_mps - wind.east_mps, state.north_mps - wind.north_mps,
          state.climb_rate_mps - updraft_mps};
}

struct Lag {
  double angle_rad;
  double rate_radps;
};
// Semi-implicit, for parts much shorter than the response.
Lag followed(double angle_rad, double rate_radps, double target_rad, double frequency_radps,
             double damping, double rate_max_radps, double angle_max_rad, double step_s) {
  const double acceleration = frequency_radps * frequency_radps * (target_rad - angle_rad) -
                              2.0 * damping * frequency_radps * rate_radps;
  const double rate =
      std::clamp(rate_radps + step_s * acceleration, -rate_max_radps, rate_max_radps);
  const double angle = angle_rad + step_s * rate;
  if (std::fabs(angle) > angle_max_rad) {
    return {std::copysign(angle_max_rad, angle), 0.0};
  }
  return {angle, rate};
}

}  // namespace

RotorParameters read_rotor_parameters(ConfigReader& reader) {
  RotorParameters p;
  const auto positive = [&](const char* key) {
    const double value = reader.required_double(key);
    reader.require(value > 0.0 && value < 1e9, key, "must be above 0");
    return value;
  };
  const auto not_negative = [&](const char* key) {
    const double value = reader.required_double(key);
    reader.require(value >= 0.0 && value < 1e9, key, "must not be negative");
    return value;
  };
  const auto angle = [&](const char* key) {
    const double value_rad = reader.required_angle(key);
    reader.require(value_rad > 0.0 && value_rad < 1.2, key, "must lie in 0 to 68");
    return value_rad;
  };
  p.mass_kg = positive("mass_kg");
  p.rotor_radius_m = positive("rotor_radius_m");
  p.solidity = positive("solidity");
  p.tip_speed_mps = positive("tip_speed_mps");
  p.profile_drag = positive("profile_drag");
  p.profile_advance = not_negative("profile_advance");
  p.lift_slope_1prad = positive("lift_slope_1prad");
  p.induced_factor = positive("induced_factor");
  p.flat_plate_m2 = positive("flat_plate_m2");
  p.power_available_w = 1000.0 * positive("power_available_kw");
  p.power_share_of_rotor = positive("power_share_of_rotor");
  reader.require(p.power_share_of_rotor <= 1.0, "power_share_of_rotor", "must be at most 1");
  p.thrust_lag_s = positive("thrust_lag_s");
  reader.require(p.thrust_lag_s >= 0.05, "thrust_lag_s", "must be at least 0.05");
  p.thrust_rate_max_nps = 1000.0 * positive("thrust_rate_max_knps");
  p.attitude_frequency_radps = positive("attitude_frequency_radps");
  reader.require(p.attitude_frequency_radps <= 10.0, "attitude_frequency_radps",
                 "must be at most 10");
  p.attitude_damping = positive("attitude_damping");
  p.bank_max_rad = angle("bank_max_deg");
  p.roll_rate_max_radps = radians_from_degrees(positive("roll_rate_max_degps"));
  p.tilt_max_rad = angle("tilt_max_deg");
  p.pitch_rate_max_radps = radians_from_degrees(positive("pitch_rate_max_degps"));
  p.speed_gain_1ps = positive("speed_gain_1ps");
  p.speed_integral_gain_1ps2 = not_negative("speed_integral_gain_1ps2");
  p.acceleration_max_mps2 = positive("acceleration_max_mps2");
  p.heading_gain_1ps = positive("heading_gain_1ps");
  p.heading_rate_damping = not_negative("heading_rate_damping");
  p.climb_gain_1ps = positive("climb_gain_1ps");
  p.climb_integral_gain_1ps2 = not_negative("climb_integral_gain_1ps2");
  reader.finish();
  return p;
}

double induced_velocity_mps(double thrust_n, double disc_area_m2, double density_kgpm3,
                            double in_plane_mps, double axial_mps) {
  if (!(thrust_n > 0.0)) {
    return 0.0;
  }
  const double hover_squared = thrust_n / (2.0 * density_kgpm3 * disc_area_m2);
  const double hover_mps = std::sqrt(hover_squared);
  const double axial = std::max(axial_mps, -0.5 * hover_mps);
  // v sqrt(u^2 + (w + v)^2) grows with v from 0 on for w >= -v_h / 2, up to beyond v_h^2 at the
  // upper end: bisection cannot fail, and costs the same each time.
  double low = 0.0;
  double high = 2.0 * hover_mps;
  for (int i = 0; i < 50; ++i) {
    const double v = 0.5 * (low + high);
    const double through = axial + v;
    if (v * std::sqrt(in_plane_mps * in_plane_mps + through * through) < hover_squared) {
      low = v;
    } else {
      high = v;
    }
  }
  return 0.5 * (low + high);
}

RotorPlant::RotorPlant(const RotorParameters& parameters) : parameters_(parameters) {}

double RotorPlant::disc_area_m2() const {
  return std::numbers::pi * parameters_.rotor_radius_m * parameters_.rotor_radius_m;
}

RotorPower RotorPlant::power(const RotorState& state, const Wind& wind, double updraft_mps) const {
  const RotorParameters& p = parameters_;
  const double density = air_density_kgpm3(state.altitude_m);
  const Vector air = air_velocity(state, wind, updraft_mps);
  const double axial_mps = dot(air, thrust_direction(state));
  const double squared = dot(air, air);
  const double in_plane_mps = std::sqrt(std::max(squared - axial_mps * axial_mps, 0.0));
  const double advance = in_plane_mps / p.tip_speed_mps;
  RotorPower power;
  power.induced_w =
      p.induced_factor * state.thrust_n *
      induced_velocity_mps(state.thrust_n, disc_area_m2(), density, in_plane_mps, axial_mps);
  power.profile_w = p.solidity * p.profile_drag / 8.0 * density * disc_area_m2() * p.tip_speed_mps *
                    p.tip_speed_mps * p.tip_speed_mps *
                    (1.0 + p.profile_advance * advance * advance);
  power.parasite_w = 0.5 * density * p.flat_plate_m2 * squared * std::sqrt(squared);
  power.climb_w = state.thrust_n * axial_mps - power.parasite_w;
  return power;
}

RotorState RotorPlant::trimmed(double x_m, double y_m, double altitude_m, double airspeed_mps,
                               double heading_math_rad, double climb_rate_mps,
                               const Wind& wind) const {
  const RotorParameters& p = parameters_;
  const elementary::SineCosine heading = elementary::sine_cosine(heading_math_rad);
  RotorState state;
  state.x_m = x_m;
  state.y_m = y_m;
  state.altitude_m = altitude_m;
  state.east_mps = airspeed_mps * heading.cosine + wind.east_mps;
  state.north_mps = airspeed_mps * heading.sine + wind.north_mps;
  state.climb_rate_mps = climb_rate_mps;
  state.heading_math_rad = wrap_to_pi(heading_math_rad);
  const double air_mps = std::sqrt(airspeed_mps * airspeed_mps + climb_rate_mps * climb_rate_mps);
  const double drag_per_mps = 0.5 * air_density_kgpm3(altitude_m) * p.flat_plate_m2 * air_mps;
  const double forward_n = drag_per_mps * airspeed_mps;
  const double up_n = p.mass_kg * kGravity_mps2 + drag_per_mps * climb_rate_mps;
  state.tilt_rad = elementary::atan2(forward_n, up_n);
  state.thrust_n = std::sqrt(forward_n * forward_n + up_n * up_n);
  state.collective_n = state.thrust_n;
  state.power_w = power(state, wind).total_w();
  return state;
}

RotorState RotorPlant::step(const RotorState& state, const Command& command, const Wind& wind,
                            double step_s, double updraft_mps) const {
  if (!(step_s > 0.0 && step_s <= 0.2)) {
    throw std::invalid_argument("the rotor plant is stepped by 0 to 0.2 s, not by " +
                                std::to_string(step_s));
  }
  const int parts = static_cast<int>(std::ceil(step_s / kPart_s - 1e-9));
  RotorState next = state;
  bool is_power_limited = false;
  for (int i = 0; i < parts; ++i) {
    next = part(next, command, wind, step_s / parts, updraft_mps);
    is_power_limited = is_power_limited || next.is_power_limited;
  }
  next.power_w = power(next, wind, updraft_mps).total_w();
  next.is_power_limited = is_power_limited;
  return next;
}

RotorState RotorPlant::part(const RotorState& state, const Command& command, const Wind& wind,
                            double step_s, double updraft_mps) const {
  const RotorParameters& p = parameters_;
  const Vector air = air_velocity(state, wind, updraft_mps);
  const double airspeed_mps = std::sqrt(air.x * air.x + air.y * air.y);
  const double density = air_density_kgpm3(state.altitude_m);
  const double drag_per_mps = 0.5 * density * p.flat_plate_m2 * std::sqrt(dot(air, air));
  RotorState next = state;

  // Controllers.
  const elementary::SineCosine bank = elementary::sine_cosine(state.bank_left_rad);
  const double turn_rate_radps =
      kGravity_mps2 * bank.sine / bank.cosine / std::max(airspeed_mps, kAirspeedMin_mps);
  const double wanted_turn_radps =
      p.heading_gain_1ps * wrap_to_pi(command.heading_math_rad - state.heading_math_rad) -
      p.heading_rate_damping * turn_rate_radps;
  const double bank_command_rad =
      std::clamp(elementary::atan(airspeed_mps / kGravity_mps2 * wanted_turn_radps),
                 -p.bank_max_rad, p.bank_max_rad);

  const double speed_error_mps = command.speed_mps - airspeed_mps;
  const double wanted_mps2 = p.speed_gain_1ps * speed_error_mps + state.speed_integral_mps2;
  const double forward_mps2 =
      std::clamp(wanted_mps2, -p.acceleration_max_mps2, p.acceleration_max_mps2);
  const double wanted_forward_n = p.mass_kg * forward_mps2 + drag_per_mps * airspeed_mps;
  const double climb_error_mps = command.climb_rate_mps - state.climb_rate_mps;
  const double wanted_up_n =
      p.mass_kg * (kGravity_mps2 + p.climb_gain_1ps * climb_error_mps + state.climb_integral_mps2) +
      drag_per_mps * state.climb_rate_mps;
  const double lift_n = std::max(wanted_up_n, 0.2 * p.mass_kg * kGravity_mps2);
  const double wanted_tilt_rad = elementary::atan(wanted_forward_n / lift_n * bank.cosine);
  const double tilt_command_rad = std::clamp(wanted_tilt_rad, -p.tilt_max_rad, p.tilt_max_rad);
  const elementary::SineCosine tilt = elementary::sine_cosine(state.tilt_rad);
  double wanted_thrust_n = lift_n / (bank.cosine * tilt.cosine);

  // What the gears carry. The power grows with the thrust, so its bound is found by bisection.
  RotorState trial = state;
  const auto power_at = [&](double thrust_n) {
    trial.thrust_n = thrust_n;
    return power(trial, wind, updraft_mps).total_w();
  };
  next.is_power_limited = power_at(wanted_thrust_n) > power_max_w();
  if (next.is_power_limited) {
    double low = 0.0;
    double high = wanted_thrust_n;
    for (int i = 0; i < 30; ++i) {
      const double middle = 0.5 * (low + high);
      (power_at(middle) > power_max_w() ? high : low) = middle;
    }
    wanted_thrust_n = low;
  }
  const double change_max_n = p.thrust_rate_max_nps * step_s;
  next.collective_n = state.collective_n +
                      std::clamp(wanted_thrust_n - state.collective_n, -change_max_n, change_max_n);
  next.thrust_n = state.thrust_n + (1.0 - elementary::exp(-step_s / p.thrust_lag_s)) *
                                       (next.collective_n - state.thrust_n);
  if (tilt_command_rad == wanted_tilt_rad && forward_mps2 == wanted_mps2) {
    next.speed_integral_mps2 += p.speed_integral_gain_1ps2 * speed_error_mps * step_s;
  }
  if (!(next.is_power_limited && climb_error_mps > 0.0)) {
    next.climb_integral_mps2 += p.climb_integral_gain_1ps2 * climb_error_mps * step_s;
  }

  const Lag roll = followed(state.bank_left_rad, state.roll_rate_left_radps, bank_command_rad,
                            p.attitude_frequency_radps, p.attitude_damping, p.roll_rate_max_radps,
                            p.bank_max_rad * 1.2, step_s);
  next.bank_left_rad = roll.angle_rad;
  next.roll_rate_left_radps = roll.rate_radps;
  const Lag pitch =
      followed(state.tilt_rad, state.tilt_rate_radps, tilt_command_rad, p.attitude_frequency_radps,
               p.attitude_damping, p.pitch_rate_max_radps, p.tilt_max_rad * 1.2, step_s);
  next.tilt_rad = pitch.angle_rad;
  next.tilt_rate_radps = pitch.rate_radps;

  // Motion, velocity by the forces in the middle of the part.
  RotorState middle = state;
  middle.bank_left_rad = 0.5 * (state.bank_left_rad + next.bank_left_rad);
  middle.tilt_rad = 0.5 * (state.tilt_rad + next.tilt_rad);
  const double advance = std::max(airspeed_mps, kAirspeedMin_mps) / p.tip_speed_mps;
  const double gust_n = density * p.solidity * disc_area_m2() * p.tip_speed_mps *
                        p.lift_slope_1prad * 2.0 * advance /
                        (8.0 * advance + p.lift_slope_1prad * p.solidity) * updraft_mps;
  const double thrust_n = 0.5 * (state.thrust_n + next.thrust_n) + gust_n;
  const Vector n = thrust_direction(middle);
  const double east = (thrust_n * n.x - drag_per_mps * air.x) / p.mass_kg;
  const double north = (thrust_n * n.y - drag_per_mps * air.y) / p.mass_kg;
  const double up = (thrust_n * n.z - drag_per_mps * air.z) / p.mass_kg - kGravity_mps2;
  next.east_mps = state.east_mps + step_s * east;
  next.north_mps = state.north_mps + step_s * north;
  next.climb_rate_mps = state.climb_rate_mps + step_s * up;
  next.x_m = state.x_m + 0.5 * step_s * (state.east_mps + next.east_mps);
  next.y_m = state.y_m + 0.5 * step_s * (state.north_mps + next.north_mps);
  next.altitude_m = state.altitude_m + 0.5 * step_s * (state.climb_rate_mps + next.climb_rate_mps);
  const Vector after = air_velocity(next, wind, updraft_mps);
  if (after.x * after.x + after.y * after.y > kAirspeedMin_mps * kAirspeedMin_mps) {
    next.heading_math_rad = elementary::atan2(after.y, after.x);
  }
  return next;
}

}  // namespace hedgehop::command_model
