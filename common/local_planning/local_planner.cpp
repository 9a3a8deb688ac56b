#include "local_planning/local_planner.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "local_planning/decider.hpp"
#include "local_planning/escape.hpp"
#include "local_planning/guide.hpp"
#include "local_planning/surroundings.hpp"
#include "local_planning/vertical_pass.hpp"

namespace hedgehop::local_planning {
namespace {

using command_model::Command;
using command_model::CommandModel;
using command_model::ModelState;
using command_model::StateTrigonometry;

constexpr double kExtraTime_s = 60.0;
constexpr double kPassSpacing_m = 50.0;  // of the guide that a pass leaves to the next one
constexpr double kHalfSample_m = 12.0;   // of a rollout: between its places, at up to 48 m/s
constexpr int kStepsBetweenReports = 64;

double disc_radius_m(const LocalOptions& options, double cell_m) {
  return options.safety_radius_m + 0.5 * std::numbers::sqrt2 * cell_m;
}

HistogramOptions histogram_options(const LocalOptions& options, int pass, double cell_m) {
  return {options.window_m - pass * options.window_shrink_m,
          options.sectors,
          disc_radius_m(options, cell_m),
          options.safety_height_m,
          options.near_distance_m,
          options.truncation_angle_rad,
          options.truncation_distance_m,
          options.arc_radius_max_factor,
          options.is_arc_widened};
}

std::vector<std::shared_ptr<const HistogramTables>> tables_of(const Surroundings& surroundings,
                                                              const LocalOptions& options) {
  std::vector<std::shared_ptr<const HistogramTables>> tables;
  for (int pass = 0; pass < options.passes; ++pass) {
    tables.push_back(histogram_tables(
        surroundings, histogram_options(options, pass, surroundings.geometry().cell_m)));
  }
  return tables;
}

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

// Watches the approach to the goal.
class GoalWatch {
 public:
  GoalWatch(const Guide& guide, double radius_m, const flight::Wind& wind)
      : goal_(guide.goal()), radius_m_(radius_m), wind_(wind) {}

  // True at the nearest approach, or at the goal itself; not where the guide only comes by.
  bool is_reached(const ModelState& state, const StateTrigonometry& trigonometry,
                  bool is_on_final_part) {
    if (!is_on_final_part) {
      return false;
    }
    const double dx_m = goal_.x_m - state.x_m;
    const double dy_m = goal_.y_m - state.y_m;
    // Along the motion over ground.
    const double ahead_m = dx_m * (trigonometry.cos_heading + wind_.east_mps / state.speed_mps) +
                           dy_m * (trigonometry.sin_heading + wind_.north_mps / state.speed_mps);
    return distance_m(dx_m, dy_m) <= radius_m_ && ahead_m <= 0.0;
  }

 private:
  flight::Waypoint goal_;
  double radius_m_;
  flight::Wind wind_;
};

// Takes a flight of rollouts back to a moment from which there is a way out, where it came too near
// to the ground.
class Keeper {
 public:
  Keeper(const Surroundings& surroundings, const CommandModel& model, const LocalOptions& options,
         const Guide& guide, const HeadingCommand& heading)
      : surroundings_(surroundings),
        surface_m_(surroundings.surface_m()),
        model_(model),
        options_(options),
        guide_(guide),
        heading_(heading),
        stride_(
            std::max<std::size_t>(1, static_cast<std::size_t>(kMoment_s / options.step_s + 0.5))),
        check_stride_(
            std::max<std::size_t>(1, static_cast<std::size_t>(kCheck_s / options.step_s + 0.5))),
        start_clearance_m_(clearance_of(guide.at(0.0))),
        goal_clearance_m_(clearance_of(guide.goal())) {}

  // Where a flight goes on, and the commands of the way out.
  struct Turn {
    std::size_t step = 0;
    ModelState state;
    Decider::Memory memory;
    std::vector<FlownStep> way_out;
  };

  // Before the step that leaves `state`: nothing if all is well or there is no way out.
  std::optional<Turn> look(const std::vector<FlownStep>& steps, const ModelState& state,
                           const Decider::Memory& memory, bool is_check_due, bool is_on_way_out) {
    if ((is_check_due || steps.size() % check_stride_ == 0) && steps.size() > checked_) {
      const std::size_t from = checked_;
      checked_ = steps.size();
      if (!is_on_way_out && !is_clear(steps, from, state)) {
        if (auto turn = turned_back(steps.size())) {
          return turn;
        }
      }
    }
    if (steps.size() % stride_ == 0) {
      moments_.push_back({steps.size(), state, memory, {}});
    }
    return std::nullopt;
  }

 private:
  static constexpr double kMoment_s = 1.0;
  static constexpr double kCheck_s = 0.25;
  static constexpr double kNearEnd_m = 400.0;
  static constexpr double kBelowEnd_m = 0.5;
  static constexpr int kTurnsMax = 200;  // of one flight: no guide makes the work endless

  [[nodiscard]] double clearance_of(const flight::Waypoint& end) const {
    const geo::MapPoint place{end.x_m, end.y_m};
    const double height_m =
        end.altitude_m -
        highest_beside_m(surface_m_, place, place, options_.rollout_escape.lateral_margin_m);
    return std::isnan(height_m) ? options_.rollout_escape.clearance_m
                                : std::max(0.0, height_m - kBelowEnd_m);
  }

  [[nodiscard]] double clearance_at(const ModelState& state) const {
    const auto is_near = [&](const flight::Waypoint& end) {
      return distance_m(end.x_m - state.x_m, end.y_m - state.y_m) < kNearEnd_m;
    };
    double clearance_m = options_.rollout_escape.clearance_m;
    if (is_near(guide_.at(0.0))) {
      clearance_m = std::min(clearance_m, start_clearance_m_);
    }
    if (is_near(guide_.goal())) {
      clearance_m = std::min(clearance_m, goal_clearance_m_);
    }
    return clearance_m;
  }

  [[nodiscard]] bool is_clear(const std::vector<FlownStep>& steps, std::size_t from,
                              const ModelState& state) const {
    const double clearance_m = clearance_at(state);
    double lowest_m = state.altitude_m;
    for (std::size_t i = from; i < steps.size(); ++i) {
      lowest_m = std::min(lowest_m, steps[i].state.altitude_m);
    }
    const ModelState& first = steps[from].state;
    const double margin_m = options_.rollout_escape.lateral_margin_m;
    const double reach_m =
        distance_m(distance_m(first.x_m - state.x_m, first.y_m - state.y_m), margin_m);
    if (surroundings_.is_surely_above({state.x_m, state.y_m}, reach_m, lowest_m - clearance_m)) {
      return true;
    }
    std::vector<FlownStep> piece(steps.begin() + static_cast<std::ptrdiff_t>(from), steps.end());
    piece.emplace_back().state = state;
    return keeps_clearance(surface_m_, piece, clearance_m, margin_m);
  }

  std::optional<Turn> turned_back(std::size_t now) {
    if (turns_ == kTurnsMax) {
      return std::nullopt;
    }
    const auto back = static_cast<std::size_t>(options_.rollout_escape.back_s / options_.step_s);
    for (const EscapeWays ways : {EscapeWays::kAlongGuide, EscapeWays::kAny}) {
      for (std::size_t i = moments_.size(); i > 0 && moments_[i - 1].step + back >= now; --i) {
        Turn& moment = moments_[i - 1];
        const EscapeOptions escape{options_.slow_speed_mps,
                                   clearance_at(moment.state),
                                   options_.rollout_escape.lateral_margin_m,
                                   options_.rollout_escape.time_max_s,
                                   {moment.memory.commanded_rad, heading_.rate_max_radps}};
        auto way_out = escape_along(surface_m_, model_, escape, ways, moment.state, guide_,
                                    moment.memory.along_m, options_.goal_radius_m, options_.step_s);
        // One step is where it is high enough already: that leads nowhere.
        if (way_out && way_out->steps.size() > 1) {
          Turn turn = moment;
          turn.way_out = std::move(way_out->steps);
          moments_.resize(i - 1);
          checked_ = turn.step;
          ++turns_;
          return turn;
        }
      }
    }
    return std::nullopt;
  }

  const Surroundings& surroundings_;
  const raster::Grid<float>& surface_m_;
  const CommandModel& model_;
  const LocalOptions& options_;
  const Guide& guide_;
  HeadingCommand heading_;
  std::size_t stride_;
  std::size_t check_stride_;
  double start_clearance_m_;
  double goal_clearance_m_;
  std::vector<Turn> moments_;
  std::size_t checked_ = 0;
  int turns_ = 0;
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

command_model::ModelState state_at_start(const std::vector<flight::Waypoint>& guide,
                                         double speed_mps, const command_model::Vehicle& vehicle) {
  if (!vehicle.wind.is_calm()) {
    const Guide line(guide);
    const double course_rad = line.heading_math_rad(0.0);
    const elementary::SineCosine course = elementary::sine_cosine(course_rad);
    const flight::VerticalRates rates = vehicle.vertical_rates(speed_mps, guide.front().altitude_m);
    const double rate_mps = line.slope(0.0) * flight::ground_speed_mps(vehicle.wind, speed_mps,
                                                                       course.cosine, course.sine);
    return command_model::trimmed_state(
        guide.front().x_m, guide.front().y_m, guide.front().altitude_m, speed_mps,
        flight::heading_for_course_rad(vehicle.wind, speed_mps, course_rad),
        std::clamp(rate_mps, -rates.descent_mps, rates.climb_mps));
  }
  flight::Limits limits = vehicle.limits;
  const flight::VerticalRates rates = vehicle.vertical_rates(speed_mps, guide.front().altitude_m);
  limits.climb_rate_max_mps = rates.climb_mps;
  limits.descent_rate_max_mps = rates.descent_mps;
  return state_at_start(guide, speed_mps, limits);
}

LocalGround local_ground(const risk::CostModel& costs, const LocalOptions& options) {
  const double cell_m = costs.map().geometry.cell_m;
  LocalGround ground{{costs, options.window_m, disc_radius_m(options, cell_m),
                      options.semantics_weight, options.visibility_weight},
                     {}};
  if (options.mode == LocalMode::kRollout) {
    const double disc_m = disc_radius_m(options, cell_m);
    ground.surroundings.pack(std::sqrt(disc_m * disc_m + kHalfSample_m * kHalfSample_m));
    return ground;
  }
  ground.tables = tables_of(ground.surroundings, options);
  return ground;
}

void surface_changed(LocalGround& ground, const risk::CostModel& costs, const LocalOptions& options,
                     const std::vector<raster::CellIndex>& cells) {
  const double risk_max = ground.surroundings.risk_max();
  ground.surroundings.surface_changed(costs, cells);
  if (ground.surroundings.risk_max() != risk_max && options.mode != LocalMode::kRollout) {
    ground.tables = tables_of(ground.surroundings, options);
  }
}

std::variant<Flight, flight::NoPlan> fly_along(
    const risk::CostModel& costs, const command_model::Vehicle& vehicle,
    const LocalOptions& options, const std::vector<flight::Waypoint>& guide,
    const command_model::ModelState& initial, double speed_mps, const StepModel& step_model,
    Observer& observer, Kernel kernel, const DecisionWatch& watch) {
  return fly_along(local_ground(costs, options), vehicle, options, guide, initial, speed_mps,
                   step_model, observer, kernel, watch);
}

std::variant<Flight, flight::NoPlan> fly_along(
    const LocalGround& ground, const command_model::Vehicle& vehicle, const LocalOptions& options,
    const std::vector<flight::Waypoint>& guide, const command_model::ModelState& initial,
    double speed_mps, const StepModel& step_model, Observer& observer, Kernel kernel,
    const DecisionWatch& watch, const HeadingCommand& heading) {
  const flight::Limits& limits = vehicle.limits;
  if (!is_finite(initial)) {
    throw std::invalid_argument("the state at the start must be finite");
  }
  if (!(speed_mps >= limits.speed_min_mps && speed_mps <= limits.speed_max_mps) ||
      !(initial.speed_mps >= limits.speed_min_mps && initial.speed_mps <= limits.speed_max_mps)) {
    throw std::invalid_argument("speed " + std::to_string(speed_mps) +
                                " m/s is outside the vehicle's limits");
  }
  if (!(vehicle.wind.speed_mps() <=
        flight::kWindShareMax * std::min(speed_mps, options.slow_speed_mps)) ||
      !(vehicle.wind.speed_mps() < initial.speed_mps)) {
    throw std::invalid_argument("a wind of " + std::to_string(vehicle.wind.speed_mps()) +
                                " m/s is more than half of a speed that is to be flown");
  }
  const Surroundings& surroundings = ground.surroundings;
  const CommandModel model(vehicle);
  const CommandModel::StepConstants step_constants = model.step_constants(options.step_s);
  Flight flight;
  flight.step_s = options.step_s;
  std::vector<flight::Waypoint> points = guide;
  for (int pass = 0; pass < options.passes; ++pass) {
    const Guide line(points);
    const HistogramOptions histogram =
        histogram_options(options, pass, surroundings.geometry().cell_m);
    const auto tables = options.mode != LocalMode::kRollout
                            ? ground.tables.at(static_cast<std::size_t>(pass))
                            : nullptr;
    Decider decider(surroundings, tables, line, model, options, histogram, speed_mps, initial,
                    heading, kernel);
    GoalWatch goal(line, options.goal_radius_m, vehicle.wind);
    std::optional<Keeper> keeper;
    if (options.mode == LocalMode::kRollout && options.rollout_escape.is_used) {
      keeper.emplace(surroundings, model, options, line, heading);
    }
    std::vector<FlownStep> way_out;
    std::size_t out_step = 0;
    const auto steps_max = static_cast<std::int64_t>(
        (options.length_factor_max * line.length_m() / (speed_mps - vehicle.wind.speed_mps()) +
         kExtraTime_s) /
        options.step_s);
    flight.steps.clear();
    flight.steps.reserve(
        static_cast<std::size_t>(1.2 * line.length_m() / (speed_mps * options.step_s) + 100.0));

    ModelState state = initial;
    StateTrigonometry trigonometry = command_model::trigonometry_of(state);
    for (std::int64_t i = 0; !goal.is_reached(state, trigonometry, decider.is_on_final_part());
         ++i) {
      if (i % kStepsBetweenReports == 0) {
        observer.progress("local", pass + decider.along_m() / line.length_m(), options.passes);
        if (observer.stop_requested()) {
          return flight::NoPlan{flight::NoPlanCause::kStopped, geo::MapPoint{state.x_m, state.y_m},
                                "Stopped while flying along the route."};
        }
      }
      if (i >= steps_max) {
        return stuck(state, "the goal was not reached within " +
                                std::to_string(options.length_factor_max).substr(0, 4) +
                                " times the length of the route");
      }
      if (keeper) {
        const bool is_outside = !surroundings.is_on_map({state.x_m, state.y_m});
        if (auto turn = keeper->look(flight.steps, state, decider.memory(), is_outside,
                                     out_step < way_out.size())) {
          flight.steps.resize(turn->step);
          state = turn->state;
          trigonometry = command_model::trigonometry_of(state);
          decider.restore(turn->memory);
          way_out = std::move(turn->way_out);
          out_step = 0;
          ++flight.escapes;
        }
      }
      if (!surroundings.is_on_map({state.x_m, state.y_m})) {
        return stuck(state, "it left the map");
      }
      if (out_step < way_out.size()) {
        FlownStep& step = way_out[out_step++];
        step.state = state;
        decider.follow(state, step.command);
        flight.steps.push_back(step);
      } else {
        flight.steps.push_back(decider.decide(state, trigonometry));
        if (watch.is_wanted && watch.is_wanted()) {
          Decision decision = decider.last_decision();
          decision.number = flight.decisions;
          decision.state = state;
          watch.show(decision);
        }
        ++flight.decisions;
      }
      const Command& command = flight.steps.back().command;
      if (step_model) {
        state = step_model(state, command, options.step_s);
        trigonometry = command_model::trigonometry_of(state);
      } else {
        state = model.step(state, command, step_constants, trigonometry);
      }
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
