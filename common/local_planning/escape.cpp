#include "local_planning/escape.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <stdexcept>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "local_planning/vertical_pass.hpp"

namespace hedgehop::local_planning {
namespace {

using command_model::Command;
using command_model::CommandModel;
using command_model::ModelState;

constexpr int kStepsPerCheck = 5;
constexpr double kRollIn_s = 2.0;
constexpr double kLevelOff_s = 10.0;
constexpr double kAim_s = 4.0;  // of the place on the guide that is headed for
constexpr double kAimMin_m = 60.0;
constexpr double kProjectionAhead_m = 60.0;  // more than a step, less than a bend
constexpr std::array<double, 10> kTurns_deg{0.0,  30.0,  -30.0, 60.0,   -60.0,
                                            90.0, -90.0, 135.0, -135.0, 180.0};

class Attempt {
 public:
  Attempt(const raster::Grid<float>& surface_m, const CommandModel& model,
          const EscapeOptions& options, double step_s)
      : surface_m_(surface_m), model_(model), options_(options), step_s_(step_s) {}

  // Flies until it is high enough; `command` gives the command of step i, or nothing at the end of
  // the plan. Empty if the clearance is not kept, or the time is over.
  std::vector<FlownStep> flown(
      const ModelState& from,
      const std::function<std::optional<Command>(std::size_t, const ModelState&)>& command) const {
    std::vector<FlownStep> steps;
    ModelState state = from;
    double commanded_rad = std::isnan(options_.heading.before_rad) ? from.heading_math_rad
                                                                   : options_.heading.before_rad;
    std::size_t checked = 0;
    const auto add = [&](const Command& with) {
      FlownStep step;
      step.state = state;
      step.command = with;
      step.target_heading_math_rad = with.heading_math_rad;
      step.commanded_climb_angle_rad = elementary::atan(with.climb_rate_mps / state.speed_mps);
      steps.push_back(step);
    };
    const auto steps_max = static_cast<std::size_t>(options_.time_max_s / step_s_);
    for (std::size_t i = 0; i <= steps_max; ++i) {
      std::optional<Command> next = command(i, state);
      if (next) {
        next->heading_math_rad =
            options_.heading.limited_rad(commanded_rad, next->heading_math_rad, step_s_);
        commanded_rad = next->heading_math_rad;
      }
      add(next             ? *next
          : !steps.empty() ? steps.back().command
                           : Command{from.speed_mps, from.heading_math_rad, 0.0});
      const bool is_end = !next || (i % kStepsPerCheck == 0 && is_high(state));
      if (is_end || i - checked == kStepsPerCheck) {
        if (!keeps_clearance(surface_m_, std::span(steps).subspan(checked), options_.clearance_m,
                             options_.lateral_margin_m)) {
          return {};
        }
        checked = i;
      }
      if (is_end) {
        return steps;
      }
      state = model_.step(state, *next, step_s_);
    }
    return {};
  }

 private:
  [[nodiscard]] bool is_high(const ModelState& state) const {
    // Circles over the ground are flown at the speed that they have downwind.
    const double speed_max_mps = state.speed_mps + model_.vehicle().wind.speed_mps();
    const double radius_m =
        2.0 * flight::turn_radius_min_m(speed_max_mps, model_.bank_command_max_rad()) +
        kRollIn_s * speed_max_mps + options_.lateral_margin_m;
    const double lowest_m =
        raster::max_within(surface_m_, {state.x_m, state.y_m}, radius_m) + options_.clearance_m;
    return state.climb_rate_mps >= 0.0 && state.altitude_m >= lowest_m &&  // false for NaN
           stays_above(lowest_m, state);
  }

  // Whether levelling off ends no lower: the climb rate's controller may still hold a descent.
  [[nodiscard]] bool stays_above(double lowest_m, ModelState state) const {
    const Command level{state.speed_mps, state.heading_math_rad, 0.0};
    const auto steps = static_cast<int>(kLevelOff_s / step_s_);
    for (int i = 0; i < steps; ++i) {
      state = model_.step(state, level, step_s_);
      if (state.altitude_m < lowest_m) {
        return false;
      }
    }
    return true;
  }

  const raster::Grid<float>& surface_m_;
  const CommandModel& model_;
  const EscapeOptions& options_;
  double step_s_;
};

std::optional<Escape> turned(const Attempt& attempt, const CommandModel& model,
                             const EscapeOptions& options, const ModelState& from) {
  const double climb_rate_mps = model.vehicle().limits.climb_rate_max_mps;
  for (const double turn_deg : kTurns_deg) {
    const double turn_rad = radians_from_degrees(turn_deg);
    const double heading_rad = wrap_to_pi(from.heading_math_rad + turn_rad);
    std::vector<FlownStep> steps =
        attempt.flown(from, [&](std::size_t, const ModelState&) -> std::optional<Command> {
          return Command{options.speed_mps, heading_rad, climb_rate_mps};
        });
    if (!steps.empty()) {
      return Escape{turn_rad, false, std::move(steps)};
    }
  }
  return std::nullopt;
}

}  // namespace

bool keeps_clearance(const raster::Grid<float>& surface_m, std::span<const FlownStep> steps,
                     double clearance_m, double lateral_margin_m) {
  const ModelState& a = steps.front().state;
  const ModelState& b = steps.back().state;
  double lowest_m = a.altitude_m;
  for (const FlownStep& step : steps) {
    lowest_m = std::min(lowest_m, step.state.altitude_m);
  }
  return lowest_m >= highest_beside_m(surface_m, {a.x_m, a.y_m}, {b.x_m, b.y_m}, lateral_margin_m) +
                         clearance_m;  // false for NaN
}

std::optional<Escape> escape_from(const raster::Grid<float>& surface_m, const CommandModel& model,
                                  const EscapeOptions& options, std::span<const FlownStep> ahead,
                                  double step_s) {
  if (ahead.size() < 2) {
    throw std::invalid_argument("an escape needs two planned steps");
  }
  const ModelState& from = ahead.front().state;
  const double climb_rate_mps = model.vehicle().limits.climb_rate_max_mps;
  const Attempt attempt(surface_m, model, options, step_s);
  if (auto escape = turned(attempt, model, options, from)) {
    return escape;
  }
  std::vector<FlownStep> steps =
      attempt.flown(from, [&](std::size_t i, const ModelState&) -> std::optional<Command> {
        if (i + 1 >= ahead.size()) {
          return std::nullopt;
        }
        Command command = ahead[i].command;
        command.climb_rate_mps = climb_rate_mps;
        return command;
      });
  if (!steps.empty()) {
    return Escape{0.0, true, std::move(steps)};
  }
  return std::nullopt;
}

std::optional<Escape> escape_along(const raster::Grid<float>& surface_m, const CommandModel& model,
                                   const EscapeOptions& options, EscapeWays ways,
                                   const ModelState& from, const Guide& guide, double along_m,
                                   double goal_radius_m, double step_s) {
  const Attempt attempt(surface_m, model, options, step_s);
  double at_m = along_m;
  std::vector<FlownStep> steps =
      attempt.flown(from, [&](std::size_t, const ModelState& state) -> std::optional<Command> {
        const double goal_dx_m = guide.goal().x_m - state.x_m;
        const double goal_dy_m = guide.goal().y_m - state.y_m;
        if (goal_dx_m * goal_dx_m + goal_dy_m * goal_dy_m <= goal_radius_m * goal_radius_m) {
          return std::nullopt;
        }
        at_m = guide.project({state.x_m, state.y_m}, at_m, at_m + kProjectionAhead_m);
        const flight::Waypoint target =
            guide.at(at_m + std::max(kAimMin_m, kAim_s * state.speed_mps));
        const double course_rad = elementary::atan2(target.y_m - state.y_m, target.x_m - state.x_m);
        return Command{
            options.speed_mps,
            flight::heading_for_course_rad(model.vehicle().wind, state.speed_mps, course_rad),
            model.vehicle().limits.climb_rate_max_mps};
      });
  if (!steps.empty()) {
    return Escape{0.0, true, std::move(steps)};
  }
  return ways == EscapeWays::kAny ? turned(attempt, model, options, from) : std::nullopt;
}

}  // namespace hedgehop::local_planning
