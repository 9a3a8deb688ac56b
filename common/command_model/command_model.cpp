#include "command_model/command_model.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "base/angles.hpp"
#include "base/elementary.hpp"

namespace hedgehop::command_model {
namespace {

constexpr double kStepMax_s = 0.2;
constexpr double kClimbAuthority =
    1.2;  // the controller's output may exceed the climb limits by this

double worst_overshoot(double damping) {
  if (damping >= 1.0) {
    return 1.0;
  }
  const double overshoot =
      elementary::exp(-std::numbers::pi * damping / std::sqrt(1.0 - damping * damping));
  return (1.0 + overshoot) / (1.0 - overshoot);
}

struct Attitude {
  double angle_rad;
  double rate_radps;
};

// Fundamental solutions of e'' + 2 zeta w e' + w^2 e = 0 after a step:
//   e1 = cosine e0 + sine e0',  e1' = -w^2 sine e0 + (cosine - 2 zeta w sine) e0'.
struct Transition {
  double cosine;
  double sine_s;
};

Transition transition(double frequency_radps, double damping, double step_s) {
  const double decay_1ps = damping * frequency_radps;
  const double decay = elementary::exp(-decay_1ps * step_s);
  const double damped_radps = frequency_radps * std::sqrt(std::max(0.0, 1.0 - damping * damping));
  const double angle = damped_radps * step_s;
  const double sine_s =
      angle > 1e-9 ? decay * elementary::sin(angle) / damped_radps : decay * step_s;
  return {decay * elementary::cos(angle) + decay_1ps * sine_s, sine_s};
}

Attitude stepped(const Attitude& from, double target_rad, double rate_max_radps, double limit_rad,
                 const ModelParameters& model, const Transition& over, double step_s) {
  const double w = model.attitude_frequency_radps;
  const double error_rad = from.angle_rad - target_rad;
  double angle_rad = target_rad + over.cosine * error_rad + over.sine_s * from.rate_radps;
  double rate_radps =
      -w * w * over.sine_s * error_rad +
      (over.cosine - 2.0 * model.attitude_damping * w * over.sine_s) * from.rate_radps;
  if (std::fabs(rate_radps) > rate_max_radps) {
    rate_radps = std::copysign(rate_max_radps, rate_radps);
    angle_rad = from.angle_rad + 0.5 * step_s * (from.rate_radps + rate_radps);
  }
  angle_rad = std::clamp(angle_rad, from.angle_rad - rate_max_radps * step_s,
                         from.angle_rad + rate_max_radps * step_s);
  // Only states that began outside, or rounding, get here.
  if (std::fabs(angle_rad) > limit_rad) {
    angle_rad = std::copysign(limit_rad, angle_rad);
    rate_radps = 0.0;
  }
  return {angle_rad, rate_radps};
}

}  // namespace

ModelState trimmed_state(double x_m, double y_m, double altitude_m, double speed_mps,
                         double heading_math_rad, double climb_rate_mps) {
  ModelState state;
  state.x_m = x_m;
  state.y_m = y_m;
  state.altitude_m = altitude_m;
  state.speed_mps = speed_mps;
  state.heading_math_rad = wrap_to_pi(heading_math_rad);
  state.climb_rate_mps = climb_rate_mps;
  state.climb_integral_mps = climb_rate_mps;
  return state;
}

ModelState over_ground(ModelState state, const flight::Wind& wind) {
  const flight::Motion motion =
      flight::over_ground(wind, {state.speed_mps, state.heading_math_rad});
  state.speed_mps = motion.speed_mps;
  state.heading_math_rad = motion.direction_math_rad;
  return state;
}

ModelState through_air(ModelState over_ground, const flight::Wind& wind) {
  const flight::Motion motion =
      flight::through_air(wind, {over_ground.speed_mps, over_ground.heading_math_rad});
  over_ground.speed_mps = motion.speed_mps;
  over_ground.heading_math_rad = motion.direction_math_rad;
  return over_ground;
}

CommandModel::CommandModel(const Vehicle& vehicle)
    : vehicle_(vehicle),
      bank_command_max_rad_(vehicle.limits.bank_max_rad /
                            worst_overshoot(vehicle.model.attitude_damping)),
      pitch_command_max_rad_(vehicle.limits.pitch_max_rad /
                             worst_overshoot(vehicle.model.attitude_damping)) {}

double limited_heading_rad(double before_rad, double wanted_rad, double change_max_rad) {
  if (change_max_rad >= kTwoPi) {
    return wanted_rad;
  }
  const double change_rad = wrap_to_pi(wanted_rad - before_rad);
  return std::fabs(change_rad) <= change_max_rad
             ? wanted_rad
             : wrap_to_pi(before_rad + std::copysign(change_max_rad, change_rad));
}

StateTrigonometry trigonometry_of(const ModelState& state) {
  const elementary::SineCosine heading = elementary::sine_cosine(state.heading_math_rad);
  return {elementary::tan(state.bank_left_rad), elementary::tan(state.pitch_rad), heading.cosine,
          heading.sine};
}

ModelState CommandModel::step(const ModelState& state, const Command& command,
                              double step_s) const {
  StateTrigonometry trigonometry = trigonometry_of(state);
  return step(state, command, step_constants(step_s), trigonometry);
}

CommandModel::StepConstants CommandModel::step_constants(double step_s) const {
  if (!(step_s > 0.0 && step_s <= kStepMax_s)) {
    throw std::invalid_argument("the command model is stepped by 0 to 0.2 s, not by " +
                                std::to_string(step_s));
  }
  const ModelParameters& model = vehicle_.model;
  const Transition over =
      transition(model.attitude_frequency_radps, model.attitude_damping, step_s);
  return {step_s, over.cosine, over.sine_s,
          1.0 - elementary::exp(-step_s / model.heave_time_constant_s)};
}

ModelState CommandModel::step(const ModelState& state, const Command& command,
                              const StepConstants& constants,
                              StateTrigonometry& trigonometry) const {
  const flight::Limits& limits = vehicle_.limits;
  const ModelParameters& model = vehicle_.model;
  const double step_s = constants.step_s;
  const Transition over{constants.cosine, constants.sine_s};
  const StateTrigonometry from = trigonometry;
  ModelState next;

  const double turn_rate_radps = kGravity_mps2 * from.tan_bank / state.speed_mps;
  const double wanted_turn_radps =
      model.heading_gain_1ps * wrap_to_pi(command.heading_math_rad - state.heading_math_rad) -
      model.heading_rate_damping * turn_rate_radps;
  const double bank_command_rad =
      std::clamp(elementary::atan(state.speed_mps / kGravity_mps2 * wanted_turn_radps),
                 -bank_command_max_rad_, bank_command_max_rad_);
  const Attitude roll =
      stepped({state.bank_left_rad, state.roll_rate_left_radps}, bank_command_rad,
              limits.roll_rate_max_radps, limits.bank_max_rad, model, over, step_s);
  next.bank_left_rad = roll.angle_rad;
  next.roll_rate_left_radps = roll.rate_radps;

  const double speed_command_mps =
      std::clamp(command.speed_mps, limits.speed_min_mps, limits.speed_max_mps);
  const double pitch_command_rad =
      std::clamp(-model.speed_gain_radpmps * (speed_command_mps - state.speed_mps),
                 -pitch_command_max_rad_, pitch_command_max_rad_);
  const Attitude pitch =
      stepped({state.pitch_rad, state.pitch_rate_radps}, pitch_command_rad,
              model.pitch_rate_max_radps, limits.pitch_max_rad, model, over, step_s);
  next.pitch_rad = pitch.angle_rad;
  next.pitch_rate_radps = pitch.rate_radps;

  trigonometry.tan_bank = elementary::tan(next.bank_left_rad);
  trigonometry.tan_pitch = elementary::tan(next.pitch_rad);
  next.speed_mps = std::clamp(
      state.speed_mps - 0.5 * step_s * kGravity_mps2 * (from.tan_pitch + trigonometry.tan_pitch),
      limits.speed_min_mps, limits.speed_max_mps);

  const double next_turn_rate_radps = kGravity_mps2 * trigonometry.tan_bank / next.speed_mps;
  next.heading_math_rad =
      wrap_to_pi(state.heading_math_rad + 0.5 * step_s * (turn_rate_radps + next_turn_rate_radps));

  const elementary::SineCosine heading = elementary::sine_cosine(next.heading_math_rad);
  trigonometry.cos_heading = heading.cosine;
  trigonometry.sin_heading = heading.sine;
  next.x_m = state.x_m +
             0.5 * step_s * (state.speed_mps * from.cos_heading + next.speed_mps * heading.cosine) +
             step_s * vehicle_.wind.east_mps;
  next.y_m = state.y_m +
             0.5 * step_s * (state.speed_mps * from.sin_heading + next.speed_mps * heading.sine) +
             step_s * vehicle_.wind.north_mps;

  const flight::VerticalRates rates = vehicle_.vertical_rates(next.speed_mps, state.altitude_m);
  const double error_mps = std::clamp(command.climb_rate_mps, -rates.descent_mps, rates.climb_mps) -
                           state.climb_rate_mps;
  const double wanted_mps = model.climb_gain * error_mps + state.climb_integral_mps -
                            model.climb_derivative_gain_s * state.vertical_acceleration_mps2;
  const double collective_mps =
      std::clamp(wanted_mps, -kClimbAuthority * limits.descent_rate_max_mps,
                 kClimbAuthority * limits.climb_rate_max_mps);
  const double free_change_mps = (collective_mps - state.climb_rate_mps) * constants.heave_share;
  const double change_max_mps = limits.vertical_acceleration_max_mps2 * step_s;
  const double change_mps = std::clamp(free_change_mps, -change_max_mps, change_max_mps);
  next.climb_rate_mps =
      std::clamp(state.climb_rate_mps + change_mps, -rates.descent_mps, rates.climb_mps);
  next.vertical_acceleration_mps2 = (next.climb_rate_mps - state.climb_rate_mps) / step_s;
  next.altitude_m = state.altitude_m + 0.5 * step_s * (state.climb_rate_mps + next.climb_rate_mps);
  const bool is_pushed_up = wanted_mps > collective_mps || free_change_mps > change_max_mps;
  const bool is_pushed_down = wanted_mps < collective_mps || free_change_mps < -change_max_mps;
  const bool is_held = (is_pushed_up && error_mps > 0.0) || (is_pushed_down && error_mps < 0.0);
  next.climb_integral_mps = state.climb_integral_mps +
                            (is_held ? 0.0 : model.climb_integral_gain_1ps * error_mps * step_s);
  return next;
}

}  // namespace hedgehop::command_model
