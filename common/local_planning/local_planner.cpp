#include "local_planning/local_planner.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "local_planning/guide.hpp"
#include "local_planning/polar_histogram.hpp"
#include "local_planning/surroundings.hpp"

namespace hedgehop::local_planning {
namespace {

using command_model::Command;
using command_model::CommandModel;
using command_model::ModelState;

constexpr double kGoalDistanceMin_m = 50.0;  // in the climb towards the target
constexpr double kReachMin_m =
    100.0;  // the histogram looks at least this far when the goal is near
constexpr double kGoAroundRadii =
    3.5;  // of the turning circle, before the flight turns back to a goal
constexpr double kFallbackReach_rad = 108.0 * kDegree_rad;
constexpr double kExtraTime_s = 60.0;
constexpr double kPassSpacing_m = 50.0;  // of the guide that a pass leaves to the next one
constexpr int kStepsBetweenReports = 64;

double distance_m(double dx_m, double dy_m) { return std::sqrt(dx_m * dx_m + dy_m * dy_m); }

bool is_finite(const ModelState& state) {
  return std::isfinite(state.x_m) && std::isfinite(state.y_m) && std::isfinite(state.altitude_m) &&
         std::isfinite(state.speed_mps) && std::isfinite(state.heading_math_rad) &&
         std::isfinite(state.bank_left_rad) && std::isfinite(state.roll_rate_left_radps) &&
         std::isfinite(state.pitch_rad) && std::isfinite(state.pitch_rate_radps) &&
         std::isfinite(state.climb_rate_mps) && std::isfinite(state.vertical_acceleration_mps2) &&
         std::isfinite(state.climb_integral_mps);
}

flight::NoPlan stuck(const ModelState& state, const std::string& what) {
  const auto whole = [](double value) {
    return std::to_string(static_cast<long long>(std::floor(value + 0.5)));
  };
  return {flight::NoPlanCause::kLocalPlannerStuck, geo::MapPoint{state.x_m, state.y_m},
          "The local planner got stuck at map place (" + whole(state.x_m) + ", " +
              whole(state.y_m) + "), altitude " + whole(state.altitude_m) + " m: " + what +
              ". Try another seed, a lower speed or a wider look-ahead."};
}

// Decides the command of each step of one pass.
class Decider {
 public:
  Decider(const Surroundings& surroundings, const Guide& guide, const CommandModel& model,
          const LocalOptions& options, const HistogramOptions& histogram_options, double speed_mps,
          const ModelState& initial)
      : surroundings_(surroundings),
        guide_(guide),
        model_(model),
        options_(options),
        kernel_(surroundings, histogram_options),
        speed_mps_(speed_mps),
        disc_radius_m_(histogram_options.disc_radius_m),
        tangent_min_(elementary::tan(options.climb_angle_min_rad)) {
    heading_.reset(initial.heading_math_rad);
    climb_.reset(elementary::atan(initial.climb_rate_mps / initial.speed_mps));
  }

  [[nodiscard]] double along_m() const { return along_m_; }
  [[nodiscard]] std::int64_t infeasible_decisions() const { return infeasible_decisions_; }

  FlownStep decide(const ModelState& state) {
    const flight::Limits& limits = model_.vehicle().limits;
    const geo::MapPoint place{state.x_m, state.y_m};
    const double speed_mps = state.speed_mps;
    along_m_ = guide_.project(place, along_m_ - options_.projection_back_m,
                              along_m_ + options_.projection_ahead_m);
    const flight::Waypoint target = guide_.at(along_m_ + options_.look_ahead_m);
    const double target_dx_m = target.x_m - state.x_m;
    const double target_dy_m = target.y_m - state.y_m;
    const double target_m = distance_m(target_dx_m, target_dy_m);
    const double limit_tangent = limits.climb_rate_max_mps / speed_mps;
    const double tangent_max = options_.climb_share * limit_tangent;

    DirectionQuestion question;
    question.heading_math_rad = state.heading_math_rad;
    const double turn_radius_m =
        flight::turn_radius_min_m(speed_mps, model_.bank_command_max_rad());
    question.goal_math_rad =
        target_m > 0.0 ? elementary::atan2(target_dy_m, target_dx_m) : state.heading_math_rad;
    if (is_going_around(state, turn_radius_m)) {
      question.goal_math_rad = outbound_rad_;
    }
    question.goal_tangent =
        std::clamp((target.altitude_m - state.altitude_m) / std::max(target_m, kGoalDistanceMin_m),
                   tangent_min_, tangent_max);
    question.tangent_min = tangent_min_;
    question.tangent_max = tangent_max;
    const flight::Waypoint nearest = guide_.at(along_m_);
    const double offset =
        distance_m(nearest.x_m - state.x_m, nearest.y_m - state.y_m) / options_.corridor_m;
    const double to_goal_m =
        distance_m(guide_.goal().x_m - state.x_m, guide_.goal().y_m - state.y_m);
    question.polar_share =
        to_goal_m < options_.goal_only_distance_m ? 0.0 : std::max(0.0, 1.0 - offset * offset);

    // Ground beyond the goal is never flown over.
    const double reach_m = is_outbound_ ? std::numeric_limits<double>::infinity()
                                        : std::max(to_goal_m, kReachMin_m) + disc_radius_m_;
    kernel_.compute(place, state.altitude_m, state.heading_math_rad, turn_radius_m, histogram_,
                    reach_m);
    const std::optional<double> chosen_rad =
        cheapest_direction_rad(histogram_, kernel_.sectors(), options_.weights, question, scratch_);

    FlownStep step;
    step.state = state;
    double needed = std::max({tangent_min_, histogram_.tan_climb_near,
                              std::min(needed_towards(state.heading_math_rad), tangent_max)});
    step.command.speed_mps = speed_mps_;
    if (chosen_rad) {
      step.target_heading_math_rad = *chosen_rad;
      step.command.heading_math_rad = followed_heading_rad(*chosen_rad, state, tangent_max);
      needed = std::max(needed, needed_towards(step.command.heading_math_rad));
    } else {
      ++infeasible_decisions_;
      step.target_heading_math_rad =
          least_climb_direction_rad(histogram_, kernel_.sectors(), state.heading_math_rad,
                                    question.goal_math_rad, kFallbackReach_rad);
      step.command.heading_math_rad = step.target_heading_math_rad;
      heading_.reset(state.heading_math_rad);
      needed = limit_tangent;
      step.command.speed_mps = std::min(speed_mps_, options_.slow_speed_mps);
    }
    if (options_.climb_ahead.is_used) {
      const ClimbAhead ahead = climb_ahead(surroundings_, guide_, along_m_, state,
                                           step.command.heading_math_rad, options_.look_ahead_m,
                                           options_.safety_height_m, model_, options_.climb_ahead);
      needed = std::max(needed, ahead.climb_rate_mps / speed_mps);
      if (ahead.shortfall_rate_mps > limits.climb_rate_max_mps) {
        step.command.speed_mps = std::clamp(
            speed_mps * limits.climb_rate_max_mps / ahead.shortfall_rate_mps,
            std::min(options_.slow_speed_mps, step.command.speed_mps), step.command.speed_mps);
      }
    }
    needed = std::clamp(needed, tangent_min_, limit_tangent);

    climb_.step(elementary::atan(std::max(question.goal_tangent, needed)),
                elementary::atan(state.climb_rate_mps / speed_mps),
                state.vertical_acceleration_mps2 / speed_mps, options_.climb_indicator,
                options_.step_s);
    const double followed = elementary::tan(
        std::clamp(climb_.angle_rad, options_.climb_angle_min_rad, 0.25 * std::numbers::pi));
    const double tangent = std::clamp(std::max(followed, needed), tangent_min_, limit_tangent);
    step.commanded_climb_angle_rad = elementary::atan(tangent);
    step.command.climb_rate_mps = speed_mps * tangent;
    return step;
  }

 private:
  // A goal that was passed too far aside lies within the turning circle: flying towards it would
  // orbit it forever. Straight on until it can be reached, then back.
  bool is_going_around(const ModelState& state, double turn_radius_m) {
    const double dx_m = guide_.goal().x_m - state.x_m;
    const double dy_m = guide_.goal().y_m - state.y_m;
    const double goal_m = distance_m(dx_m, dy_m);
    const double ahead_m = dx_m * elementary::cos(state.heading_math_rad) +
                           dy_m * elementary::sin(state.heading_math_rad);
    const bool is_missed = along_m_ >= guide_.length_m() - kGoalDistanceMin_m && ahead_m <= 0.0 &&
                           goal_m > options_.goal_radius_m && goal_m < 2.0 * turn_radius_m;
    if (is_missed && !is_outbound_) {
      is_outbound_ = true;
      outbound_rad_ = state.heading_math_rad;
    } else if (is_outbound_ && goal_m > kGoAroundRadii * turn_radius_m) {
      is_outbound_ = false;
    }
    return is_outbound_;
  }

  [[nodiscard]] double needed_towards(double heading_rad) const {
    return histogram_.tan_masked[static_cast<std::size_t>(kernel_.sectors().of_angle(heading_rad))];
  }

  double followed_heading_rad(double chosen_rad, const ModelState& state, double tangent_max) {
    const double turn_rate_radps =
        kGravity_mps2 * elementary::tan(state.bank_left_rad) / state.speed_mps;
    heading_.step(chosen_rad, state.heading_math_rad, turn_rate_radps, options_.heading_indicator,
                  options_.step_s);
    if (needed_towards(heading_.angle_rad) <= tangent_max) {
      return heading_.angle_rad;
    }
    const std::optional<double> nearest_rad =
        nearest_feasible_rad(histogram_, kernel_.sectors(), heading_.angle_rad, tangent_max);
    heading_.reset(state.heading_math_rad);
    return nearest_rad.value_or(chosen_rad);
  }

  const Surroundings& surroundings_;
  const Guide& guide_;
  const CommandModel& model_;
  const LocalOptions& options_;
  HistogramKernel kernel_;
  double speed_mps_;
  double disc_radius_m_;
  double tangent_min_;
  double along_m_ = 0.0;
  Indicator heading_;
  Indicator climb_;
  PolarHistogram histogram_;
  std::vector<double> scratch_;
  std::int64_t infeasible_decisions_ = 0;
  bool is_outbound_ = false;
  double outbound_rad_ = 0.0;
};

// Watches the approach to the goal.
class GoalWatch {
 public:
  GoalWatch(const Guide& guide, double radius_m) : goal_(guide.goal()), radius_m_(radius_m) {}

  // True at the nearest approach, or at the goal itself.
  bool is_reached(const ModelState& state) {
    const double dx_m = goal_.x_m - state.x_m;
    const double dy_m = goal_.y_m - state.y_m;
    const double ahead_m = dx_m * elementary::cos(state.heading_math_rad) +
                           dy_m * elementary::sin(state.heading_math_rad);
    return distance_m(dx_m, dy_m) <= radius_m_ && ahead_m <= 0.0;
  }

 private:
  flight::Waypoint goal_;
  double radius_m_;
};

std::vector<flight::Waypoint> guide_of(const Flight& flight, double spacing_m) {
  std::vector<flight::Waypoint> points;
  double since_m = spacing_m;
  for (std::size_t i = 0; i < flight.steps.size(); ++i) {
    const ModelState& state = flight.steps[i].state;
    if (i > 0) {
      const ModelState& before = flight.steps[i - 1].state;
      since_m += distance_m(state.x_m - before.x_m, state.y_m - before.y_m);
    }
    if (since_m >= spacing_m) {
      points.push_back({state.x_m, state.y_m, state.altitude_m});
      since_m = 0.0;
    }
  }
  return points;
}

}  // namespace

command_model::ModelState state_at_start(const std::vector<flight::Waypoint>& guide,
                                         double speed_mps, const flight::Limits& limits) {
  const Guide line(guide);
  const flight::Waypoint& start = guide.front();
  return command_model::trimmed_state(
      start.x_m, start.y_m, start.altitude_m, speed_mps, line.heading_math_rad(0.0),
      std::clamp(line.slope(0.0) * speed_mps, -limits.descent_rate_max_mps,
                 limits.climb_rate_max_mps));
}

std::variant<Flight, flight::NoPlan> fly_along(const risk::CostModel& costs,
                                               const command_model::Vehicle& vehicle,
                                               const LocalOptions& options,
                                               const std::vector<flight::Waypoint>& guide,
                                               const command_model::ModelState& initial,
                                               double speed_mps, const StepModel& step_model,
                                               Observer& observer) {
  const flight::Limits& limits = vehicle.limits;
  if (!is_finite(initial)) {
    throw std::invalid_argument("the state at the start must be finite");
  }
  if (!(speed_mps >= limits.speed_min_mps && speed_mps <= limits.speed_max_mps) ||
      !(initial.speed_mps >= limits.speed_min_mps && initial.speed_mps <= limits.speed_max_mps)) {
    throw std::invalid_argument("speed " + std::to_string(speed_mps) +
                                " m/s is outside the vehicle's limits");
  }
  const CommandModel model(vehicle);
  const double disc_radius_m =
      options.safety_radius_m + 0.5 * std::numbers::sqrt2 * costs.map().geometry.cell_m;
  const Surroundings surroundings(costs, options.window_m, disc_radius_m, options.semantics_weight,
                                  options.visibility_weight);

  Flight flight;
  flight.step_s = options.step_s;
  std::vector<flight::Waypoint> points = guide;
  for (int pass = 0; pass < options.passes; ++pass) {
    const Guide line(points);
    const double window_m = options.window_m - pass * options.window_shrink_m;
    const HistogramOptions histogram{window_m,
                                     options.sectors,
                                     disc_radius_m,
                                     options.safety_height_m,
                                     options.near_distance_m,
                                     options.truncation_angle_rad,
                                     options.truncation_distance_m,
                                     options.arc_radius_max_factor,
                                     options.is_arc_widened};
    Decider decider(surroundings, line, model, options, histogram, speed_mps, initial);
    GoalWatch goal(line, options.goal_radius_m);
    const auto steps_max = static_cast<std::int64_t>(
        (options.length_factor_max * line.length_m() / speed_mps + kExtraTime_s) / options.step_s);
    flight.steps.clear();
    flight.steps.reserve(
        static_cast<std::size_t>(1.2 * line.length_m() / (speed_mps * options.step_s) + 100.0));

    ModelState state = initial;
    for (std::int64_t i = 0; !goal.is_reached(state); ++i) {
      if (i % kStepsBetweenReports == 0) {
        observer.progress("local", pass + decider.along_m() / line.length_m(), options.passes);
        if (observer.stop_requested()) {
          return flight::NoPlan{flight::NoPlanCause::kStopped, geo::MapPoint{state.x_m, state.y_m},
                                "Stopped while flying along the route."};
        }
      }
      if (!surroundings.is_on_map({state.x_m, state.y_m})) {
        return stuck(state, "it left the map");
      }
      if (i >= steps_max) {
        return stuck(state, "the goal was not reached within " +
                                std::to_string(options.length_factor_max).substr(0, 4) +
                                " times the length of the route");
      }
      flight.steps.push_back(decider.decide(state));
      ++flight.decisions;
      const Command& command = flight.steps.back().command;
      state = step_model ? step_model(state, command, options.step_s)
                         : model.step(state, command, options.step_s);
      if (!is_finite(state)) {
        throw std::invalid_argument("the step model gave a state that is not finite");
      }
    }
    flight.infeasible_decisions += decider.infeasible_decisions();
    FlownStep last = flight.steps.empty() ? FlownStep{} : flight.steps.back();
    last.state = state;
    flight.steps.push_back(last);
    // The next pass heads for the same goal, not for the place where this one missed it by a
    // little.
    points = guide_of(flight, kPassSpacing_m);
    points.push_back({line.goal().x_m, line.goal().y_m, state.altitude_m});
  }
  observer.progress("local", options.passes, options.passes);
  return flight;
}

}  // namespace hedgehop::local_planning
