#include "lockstep_model.hpp"

#include <chrono>

#include "base/errors.hpp"

namespace hedgehop::services {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kRepeat{20};
constexpr std::chrono::milliseconds kSilence{600};  // with the time to tell it: a second

}  // namespace

LockstepModel::LockstepModel(bus::Bus& bus, PlannerDesk& desk) : bus_(bus), desk_(desk) {
  bus.subscribe<messages::VehicleState>(
      messages::kVehicleStateChannel,
      [this](const messages::VehicleState& state, const messages::Stamp&) {
        if (state.is_lockstep && state.request_id == target_.request_id &&
            state.step_number == target_.step_number) {
          answer_ = state.state;
        }
      });
}

command_model::ModelState LockstepModel::step(const Hash128& request_id,
                                              const command_model::ModelState& state,
                                              const command_model::Command& command, double step_s,
                                              const Observer& observer) {
  target_.request_id = request_id;
  // Never the same number twice: a late answer belongs to no other question.
  ++target_.step_number;
  target_.is_lockstep = true;
  target_.step_s = step_s;
  target_.state = state;
  target_.command = command;
  answer_.reset();
  const Clock::time_point begin = Clock::now();
  bool is_told = false;
  while (!answer_) {
    bus_.publish(messages::kVehicleTargetChannel, target_, bus_.message_time());
    const Clock::time_point repeat = Clock::now() + kRepeat;
    while (!answer_ && Clock::now() < repeat) {
      bus_.poll(std::chrono::duration<double>(repeat - Clock::now()).count());
    }
    if (answer_) {
      break;
    }
    if (!is_told && Clock::now() - begin >= kSilence) {
      desk_.hold_up("waiting for: command_model, which does not answer VEHICLE_TARGET");
      is_told = true;
    }
    if (observer.stop_requested()) {
      throw Interrupted();
    }
  }
  if (is_told) {
    desk_.hold_up({});
  }
  return *answer_;
}

}  // namespace hedgehop::services
