#pragma once

#include <cstdint>
#include <functional>
#include <variant>
#include <vector>

#include "base/config_reader.hpp"
#include "base/observer.hpp"
#include "command_model/command_model.hpp"
#include "flight/plan_request.hpp"
#include "flight/route.hpp"
#include "risk/cost_model.hpp"

namespace hedgehop::local_planning {

/// Section `local` of the planning config. The room's author completes it; config/planning.yaml is
/// the single home of the values.
struct LocalOptions {
  double step_s = 0.0;           // of the command model and of the decisions
  double window_m = 0.0;         // w, radius of the active window
  int sectors = 0;               // K
  double safety_radius_m = 0.0;  // lateral margin; half a cell diagonal is added
  double safety_height_m = 0.0;  // h_s, what the flight aims for above the surface
  double look_ahead_m = 0.0;
};
LocalOptions read_local_options(ConfigReader& reader);

/// One step as flown: the model's state and what it was told for the next step.
struct FlownStep {
  command_model::ModelState state;
  double target_heading_math_rad = 0.0;  // direction of the chosen sector
  command_model::Command command;
  double commanded_climb_angle_rad = 0.0;
};

struct Flight {
  double step_s = 0.0;
  std::vector<FlownStep> steps;
  std::int64_t decisions = 0;
  std::int64_t infeasible_decisions = 0;  // no sector was feasible: climbed and slowed down
};

/// How a commanded step is flown: in process, or by the command_model process in lockstep.
using StepModel = std::function<command_model::ModelState(
    const command_model::ModelState& state, const command_model::Command& command, double step_s)>;

/// Flies the command model along a guide of equally spaced waypoints (all passes).
///
/// `initial` is the state at the first waypoint. A function of its arguments alone. Returns NoPlan
/// with kLocalPlannerStuck and the place when the goal is not reached, kStopped when the observer
/// says so.
std::variant<Flight, flight::NoPlan> fly_along(const risk::CostModel& costs,
                                               const command_model::Vehicle& vehicle,
                                               const LocalOptions& options,
                                               const std::vector<flight::Waypoint>& guide,
                                               const command_model::ModelState& initial,
                                               double speed_mps, const StepModel& step_model,
                                               Observer& observer);

}  // namespace hedgehop::local_planning
