#pragma once

#include <cstdint>
#include <optional>

#include "base/observer.hpp"
#include "bus/bus.hpp"
#include "messages/vehicle_messages.hpp"
#include "services/shared/planner_desk.hpp"

namespace hedgehop::services {

/// The command model of another process, one step a question: VEHICLE_TARGET brings all that a step
/// depends on, VEHICLE_STATE the state after it, so the result is that of a step in this process,
/// bit for bit. What is lost is asked for again. While nobody answers it says so within a second,
/// and goes on when somebody does.
class LockstepModel {
 public:
  LockstepModel(bus::Bus& bus, PlannerDesk& desk);

  /// Polls the bus. Throws Interrupted when the observer wants to stop.
  command_model::ModelState step(const Hash128& request_id, const command_model::ModelState& state,
                                 const command_model::Command& command, double step_s,
                                 const Observer& observer);

 private:
  bus::Bus& bus_;
  PlannerDesk& desk_;
  messages::VehicleTarget target_;  // the question that is open
  std::optional<command_model::ModelState> answer_;
};

}  // namespace hedgehop::services
