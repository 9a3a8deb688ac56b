#pragma once

#include "command_model/command_model.hpp"
#include "flight/trajectory.hpp"

namespace hedgehop::command_model {

/// The model at a state of a trajectory, its integrator settled.
///
/// @param wind  that the trajectory was planned for
ModelState model_state_of(const flight::FlightState& state, const flight::Wind& wind = {});

/// What the local planner told the model there.
Command command_of(const flight::FlightState& state);

}  // namespace hedgehop::command_model
