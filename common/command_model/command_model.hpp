#pragma once

#include <optional>
#include <string>

#include "base/config_reader.hpp"
#include "flight/power_curve.hpp"
#include "flight/vehicle.hpp"
#include "flight/wind.hpp"

namespace hedgehop::command_model {

/// Constants of the closed-loop response and of its controllers; section `command_model` of a
/// vehicle file.
struct ModelParameters {
  double attitude_frequency_radps = 0.0;  // natural frequency of roll and pitch response
  double attitude_damping = 0.0;          // damping ratio
  double pitch_rate_max_radps = 0.0;
  double heave_time_constant_s = 0.0;
  double speed_gain_radpmps = 0.0;  // commanded pitch per speed error
  double heading_gain_1ps = 0.0;
  double heading_rate_damping = 0.0;
  double climb_gain = 0.0;  // PID of the climb rate
  double climb_integral_gain_1ps = 0.0;
  double climb_derivative_gain_s = 0.0;
};
/// Throws ConfigError; constants that make the heading loop unstable are refused, see CommandModel.
ModelParameters read_model_parameters(ConfigReader& reader);

/// A vehicle file: name, `limits`, `command_model`, and perhaps `power`.
struct Vehicle {
  std::string name;
  flight::Limits limits;
  ModelParameters model;
  std::optional<flight::PowerCurve> power;
  /// Not of the file: what `power` admits in the conditions of a flight that keeps it.
  std::optional<flight::PowerLimits> power_limits = std::nullopt;
  flight::Wind wind = {};  // not of the file either: what a flight is made in

  /// The climb and descent rates of `limits`, and where there are power_limits, those too, with
  /// 0.02 m/s to spare, as a step takes them where it begins. A descent stays a descent.
  [[nodiscard]] flight::VerticalRates vertical_rates(double airspeed_mps, double altitude_m) const;
};
Vehicle read_vehicle(ConfigReader& reader);

/// State of the closed-loop model. Angles counter-clockwise from grid east, bank positive to the
/// LEFT (it turns the heading counter-clockwise): this is the frame of the mathematics, not of the
/// outputs.
///
/// Speed and heading are those through the air; without wind, those over ground.
struct ModelState {
  double x_m = 0.0;
  double y_m = 0.0;
  double altitude_m = 0.0;
  double speed_mps = 0.0;
  double heading_math_rad = 0.0;
  double bank_left_rad = 0.0;
  double roll_rate_left_radps = 0.0;
  double pitch_rad = 0.0;
  double pitch_rate_radps = 0.0;
  double climb_rate_mps = 0.0;
  double vertical_acceleration_mps2 = 0.0;
  double climb_integral_mps = 0.0;  // integrator of the climb-rate controller
};

struct Command {
  double speed_mps = 0.0;
  double heading_math_rad = 0.0;
  double climb_rate_mps = 0.0;
};

/// `wanted_rad`, or as far towards it from `before_rad` as the change may be.
double limited_heading_rad(double before_rad, double wanted_rad, double change_max_rad);

/// Functions of a state's angles that a step needs and leaves behind for the next one.
struct StateTrigonometry {
  double tan_bank = 0.0;
  double tan_pitch = 0.0;
  double cos_heading = 1.0;
  double sin_heading = 0.0;
};
StateTrigonometry trigonometry_of(const ModelState& state);

/// The same state with speed and heading over ground, and back.
ModelState over_ground(ModelState state, const flight::Wind& wind);
ModelState through_air(ModelState over_ground, const flight::Wind& wind);

/// Trimmed flight on a straight line: wings level, climbing steadily with the integrator settled.
ModelState trimmed_state(double x_m, double y_m, double altitude_m, double speed_mps,
                         double heading_math_rad, double climb_rate_mps);

/// The helicopter as its pilot feels it: attitude command with attitude hold, coordinated turns,
/// rate command with height hold, and the three controllers that follow heading, speed and climb
/// rate.
///
///     roll     phi'' = w^2 (phi_c - phi) - 2 zeta w phi'
///     pitch    the same with theta
///     turn     chi'  = g / V tan phi
///     speed    V'    = -g tan theta
///     heave    h''   = clamp((u - h') / T, +- a_max)
///
///     heading  phi_c = clamp(atan(V / g (k_chi wrap(chi_c - chi) - k_r chi')), +- bank limit)
///     speed    theta_c = clamp(-k_V (V_c - V), +- pitch limit)
///     climb    u = K_p e + I - K_d h'',  e = h'_c - h',  I' = K_i e unless u or h'' is saturated
///              and e drives it further
///
/// phi    bank, left positive; w, zeta: attitude_frequency_radps, attitude_damping
/// theta  pitch relative to trim, nose up positive
/// V      airspeed, horizontal; chi: heading, counter-clockwise from east. Flight is coordinated:
///        the vehicle moves through the air to where it heads. The place moves by that and by the
///        wind of the vehicle
/// T, K   heave_time_constant_s and the climb gains
///
/// Attitude and heave are stepped by their exact solution for a command held over the step;
/// heading, speed, place and altitude by the trapezoidal rule, so that neighbouring states agree
/// with each other to second order in the step. Stable for steps up to 0.2 s.
/// vertical_acceleration_mps2 is the mean over the step that led to the state.
///
/// Commands are limited to what the vehicle may do. States that start within the limits stay within
/// them: bank and its rate (also as a difference quotient), pitch and its rate, speed, climb rate
/// (Vehicle::vertical_rates), vertical acceleration. To that end attitude commands stop short of
/// the limit by the worst overshoot that any command sequence can cause, (1 + o) / (1 - o) with o =
/// exp(-pi zeta / sqrt(1
/// - zeta^2)).
///
/// The heading loop is stable while 2 zeta w (1 + k_r) > k_chi (Routh).
class CommandModel {
 public:
  explicit CommandModel(const Vehicle& vehicle);

  /// State after `step_s`; the command is held over the step. Pure.
  ///
  /// @param step_s  in (0, 0.2]
  /// @throws std::invalid_argument  if the step is out of range.
  [[nodiscard]] ModelState step(const ModelState& state, const Command& command,
                                double step_s) const;

  /// What depends on the step alone.
  struct StepConstants {
    double step_s = 0.0;
    double cosine = 0.0;  // of the attitude response, see command_model.cpp
    double sine_s = 0.0;
    double heave_share = 0.0;
  };
  /// @throws std::invalid_argument  if the step is out of range.
  [[nodiscard]] StepConstants step_constants(double step_s) const;
  /// The same bits as above for many steps of one length.
  ///
  /// @param trigonometry  of `state`; becomes that of the state returned
  [[nodiscard]] ModelState step(const ModelState& state, const Command& command,
                                const StepConstants& constants,
                                StateTrigonometry& trigonometry) const;

  [[nodiscard]] const Vehicle& vehicle() const { return vehicle_; }

  /// Steepest bank that the heading controller asks for [rad], a little less than the limit.
  [[nodiscard]] double bank_command_max_rad() const { return bank_command_max_rad_; }

 private:
  Vehicle vehicle_;
  double bank_command_max_rad_;
  double pitch_command_max_rad_;
};

}  // namespace hedgehop::command_model
