#pragma once

#include "base/config_reader.hpp"
#include "flight/vehicle.hpp"

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
ModelParameters read_model_parameters(ConfigReader& reader);

/// A vehicle file: name, `limits`, `command_model`.
struct Vehicle {
  std::string name;
  flight::Limits limits;
  ModelParameters model;
};
Vehicle read_vehicle(ConfigReader& reader);

/// State of the closed-loop model. Angles counter-clockwise from grid east, bank positive to the
/// LEFT (it turns the heading counter-clockwise): this is the frame of the mathematics, not of the
/// outputs.
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

/// The helicopter as its pilot feels it: attitude command with attitude hold, coordinated turns,
/// rate command with height hold, and the three controllers that follow heading, speed and climb
/// rate.
class CommandModel {
 public:
  explicit CommandModel(const Vehicle& vehicle);

  /// State after `step_s`; the command is held over the step. Pure.
  [[nodiscard]] ModelState step(const ModelState& state, const Command& command,
                                double step_s) const;

  [[nodiscard]] const Vehicle& vehicle() const { return vehicle_; }

 private:
  Vehicle vehicle_;
};

}  // namespace hedgehop::command_model
