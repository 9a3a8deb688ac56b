#include "command_model/planned_state.hpp"

#include "base/angles.hpp"
#include "base/elementary.hpp"

namespace hedgehop::command_model {
namespace {

double math_rad(double true_rad, const flight::FlightState& state) {
  return math_angle_from_azimuth_rad(grid_from_true_azimuth_rad(true_rad, state.convergence_rad));
}

}  // namespace

ModelState model_state_of(const flight::FlightState& state, const flight::Wind& wind) {
  const flight::Motion motion =
      flight::through_air(wind, {state.speed_mps, math_rad(state.heading_true_rad, state)});
  ModelState model = trimmed_state(state.x_m, state.y_m, state.altitude_m, motion.speed_mps,
                                   motion.direction_math_rad, state.climb_rate_mps);
  model.bank_left_rad = -state.bank_rad;
  model.roll_rate_left_radps = -state.roll_rate_radps;
  model.pitch_rad = state.pitch_rad;
  model.pitch_rate_radps = state.pitch_rate_radps;
  model.vertical_acceleration_mps2 = state.vertical_acceleration_mps2;
  return model;
}

Command command_of(const flight::FlightState& state) {
  return {state.commanded_speed_mps, math_rad(state.commanded_heading_true_rad, state),
          state.speed_mps * elementary::tan(state.commanded_climb_angle_rad)};
}

}  // namespace hedgehop::command_model
