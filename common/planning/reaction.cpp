#include "planning/reaction.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "command_model/planned_state.hpp"
#include "local_planning/escape.hpp"
#include "local_planning/flight_cost.hpp"
#include "local_planning/vertical_pass.hpp"
#include "planning/route_flight.hpp"

namespace hedgehop::planning {
namespace {

using command_model::Command;
using command_model::CommandModel;
using command_model::ModelState;
using local_planning::EscapeOptions;
using local_planning::FlownStep;
using local_planning::HeadingCommand;
using local_planning::LocalGround;
using local_planning::LocalOptions;

constexpr double kAround_m = 1500.0;
constexpr double kGuideSpacing_m = 50.0;
constexpr double kGuideMin_m = 400.0;  // a shorter way along the plan is not flown again
constexpr double kCutBack_s = 2.0;
constexpr double kCirclingBankShare = 0.7;  // of the tangent of the steepest bank
constexpr double kSaving = 0.02;
constexpr double kLastClimb_s = 20.0;

double distance_m(double dx_m, double dy_m) { return std::sqrt(dx_m * dx_m + dy_m * dy_m); }

std::size_t last_step(const ReactionOptions& options, const FlightUnderPlan& flight) {
  const auto steps = static_cast<std::size_t>(options.horizon_s / flight.plan->step_s);
  return std::min(flight.step + steps, flight.plan->states.size() - 1);
}

// What the model takes: another plant may be a little beyond its limits.
ModelState within_limits(ModelState state, const command_model::Vehicle& vehicle) {
  const flight::Limits& limits = vehicle.limits;
  const auto hold = [](double& value, double limit) { value = std::clamp(value, -limit, limit); };
  state.speed_mps = std::clamp(state.speed_mps, limits.speed_min_mps, limits.speed_max_mps);
  const flight::VerticalRates rates = vehicle.vertical_rates(state.speed_mps, state.altitude_m);
  state.climb_rate_mps = std::clamp(state.climb_rate_mps, -rates.descent_mps, rates.climb_mps);
  hold(state.bank_left_rad, limits.bank_max_rad);
  hold(state.roll_rate_left_radps, limits.roll_rate_max_radps);
  hold(state.pitch_rad, limits.pitch_max_rad);
  hold(state.vertical_acceleration_mps2, limits.vertical_acceleration_max_mps2);
  return state;
}

class Reactor {
 public:
  Reactor(const map::Map& ground, const PlanningConfig& config, const ReactionOptions& options,
          const FlightUnderPlan& flight)
      : map_(ground),
        config_(config),
        options_(options),
        flight_(flight),
        local_(options_of(config)),
        model_(config.vehicle),
        projection_(ground.crs_wkt),
        from_(within_limits(flight.state, config.vehicle)),
        last_(last_step(options, flight)) {}

  Reaction reaction(bool is_seen_from) {
    Reaction none;
    none.verdict = verdict_of(plan_ahead());
    none.is_plan_verified = none.verdict.is_verified;
    if (none.is_plan_verified && !is_seen_from) {
      return none;
    }
    make_ground();  // much work, and in vain where the plan stands
    std::optional<double> cost_max_m;
    if (none.is_plan_verified) {
      cost_max_m = (1.0 - kSaving) * cost_of_plan_m();
    }
    std::optional<Reaction> reaction = flown_around(cost_max_m);
    if (!reaction) {
      reaction = none.is_plan_verified ? none : way_out();
    }
    reaction->is_plan_verified = none.is_plan_verified;
    return *reaction;
  }

  Reaction only_way_out() {
    make_ground();
    return way_out();
  }

 private:
  static LocalOptions options_of(const PlanningConfig& config) {
    LocalOptions options = config.local;
    options.mode = local_planning::LocalMode::kRollout;
    options.passes = 1;
    options.rollout_escape.is_used = true;
    return options;
  }

  void make_ground() {
    costs_.emplace(cost_model(map_, config_));
    ground_.emplace(local_planning::local_ground(*costs_, local_));
  }

  [[nodiscard]] HeadingCommand heading_after(double commanded_rad) const {
    return {commanded_rad, options_.heading_rate_max_radps};
  }

  [[nodiscard]] double speed_mps() const {
    double speed_mps = config_.vehicle.limits.speed_min_mps;
    for (std::size_t i = flight_.step; i <= last_; ++i) {
      speed_mps = std::max(speed_mps, flight_.plan->states[i].commanded_speed_mps);
    }
    return std::min(speed_mps, config_.vehicle.limits.speed_max_mps);
  }

  [[nodiscard]] flight::Trajectory plan_ahead() const {
    const auto& states = flight_.plan->states;
    flight::Trajectory ahead;
    ahead.step_s = flight_.plan->step_s;
    ahead.states.assign(states.begin() + static_cast<std::ptrdiff_t>(flight_.step),
                        states.begin() + static_cast<std::ptrdiff_t>(last_) + 1);
    const double begin_s = ahead.states.front().time_s;
    for (flight::FlightState& state : ahead.states) {
      state.time_s -= begin_s;
      state.surface_m = raster::sample_bilinear(map_.surface_m, state.point());
      state.terrain_m = raster::sample_bilinear(map_.terrain_m, state.point());
    }
    return ahead;
  }

  [[nodiscard]] flight::Verdict verdict_of(const flight::Trajectory& trajectory) const {
    const auto place_of = [](const flight::FlightState& state) {
      return flight::Waypoint{state.x_m, state.y_m, state.altitude_m};
    };
    verification::Demands demands = config_.demands;
    demands.share_under_ceiling_min = 0.0;
    return verification::verify(map_, trajectory, place_of(trajectory.states.front()), {},
                                place_of(trajectory.states.back()), config_.vehicle.limits,
                                demands);
  }

  [[nodiscard]] double cost_m(const local_planning::Flight& flight) const {
    return local_planning::flight_cost_m(*costs_, flight, local_.bank_weight_1prad);
  }

  // Steps of the plan ahead, the first one as the vehicle is.
  [[nodiscard]] std::vector<FlownStep> planned_steps() const {
    std::vector<FlownStep> steps;
    for (std::size_t i = flight_.step; i <= last_; ++i) {
      const flight::FlightState& state = flight_.plan->states[i];
      const auto math_rad = [&](double true_rad) {
        return math_angle_from_azimuth_rad(
            grid_from_true_azimuth_rad(true_rad, state.convergence_rad));
      };
      FlownStep& step = steps.emplace_back();
      step.state.x_m = state.x_m;
      step.state.y_m = state.y_m;
      step.state.altitude_m = state.altitude_m;
      step.state.speed_mps = state.speed_mps;
      step.state.heading_math_rad = math_rad(state.heading_true_rad);
      step.state = command_model::through_air(step.state, config_.vehicle.wind);
      step.state.bank_left_rad = -state.bank_rad;
      step.command = command_model::command_of(state);
    }
    steps.front().state = from_;
    return steps;
  }

  [[nodiscard]] double cost_of_plan_m() const {
    local_planning::Flight plan;
    plan.step_s = flight_.plan->step_s;
    plan.steps = planned_steps();
    return cost_m(plan);
  }

  // The way along the plan, as far as one can come to; true if that is its end.
  [[nodiscard]] std::pair<std::vector<flight::Waypoint>, bool> guide() const {
    std::vector<flight::Waypoint> points{{from_.x_m, from_.y_m, from_.altitude_m}};
    const auto& states = flight_.plan->states;
    for (std::size_t i = flight_.step + 1; i <= last_; ++i) {
      const flight::FlightState& state = states[i];
      const double way_m = distance_m(state.x_m - points.back().x_m, state.y_m - points.back().y_m);
      if (way_m >= kGuideSpacing_m || (i == last_ && way_m > 0.0)) {
        points.push_back({state.x_m, state.y_m, state.altitude_m});
      }
    }
    bool is_to_end = last_ + 1 == states.size();
    const auto is_blocked = [&](const flight::Waypoint& point) {
      const geo::MapPoint place{point.x_m, point.y_m};
      return !(point.altitude_m -
                   local_planning::highest_beside_m(ground_->surroundings.surface_m(), place, place,
                                                    local_.safety_radius_m) >=
               config_.demands.required_clearance_m);
    };
    while (points.size() > 1 && is_blocked(points.back())) {
      points.pop_back();
      is_to_end = false;
    }
    return {points, is_to_end};
  }

  [[nodiscard]] EscapeOptions escape_options(double commanded_rad) const {
    return {local_.slow_speed_mps, local_.rollout_escape.clearance_m,
            local_.rollout_escape.lateral_margin_m, local_.rollout_escape.time_max_s,
            heading_after(commanded_rad)};
  }

  // Of a bank that is needed downwind, for a circle over the ground.
  [[nodiscard]] double bank_share(const ModelState& state) const {
    const flight::Wind& wind = config_.vehicle.wind;
    if (wind.is_calm()) {
      return 1.0;
    }
    const flight::Motion motion =
        flight::over_ground(wind, {state.speed_mps, state.heading_math_rad});
    const double cos_crab = elementary::cos(motion.direction_math_rad - state.heading_math_rad);
    const double share = motion.speed_mps / (state.speed_mps + wind.speed_mps());
    return share * share / cos_crab;
  }

  // Level circles from the last state on, in the direction in which it banks.
  void circle(std::vector<FlownStep>& steps, double commanded_rad) const {
    ModelState state = steps.back().state;
    steps.pop_back();
    const command_model::ModelParameters& model = config_.vehicle.model;
    const double step_s = flight_.plan->step_s;
    const double side = state.bank_left_rad < 0.0 ? -1.0 : 1.0;
    const double tan_bank = kCirclingBankShare * elementary::tan(model_.bank_command_max_rad());
    const HeadingCommand heading = heading_after(commanded_rad);
    const auto count = static_cast<std::size_t>(kCircling_s / step_s);
    for (std::size_t i = 0; i <= count; ++i) {
      // The error that the heading controller answers with that bank.
      const double rate_radps = kGravity_mps2 * tan_bank / state.speed_mps * bank_share(state);
      const double error_rad =
          rate_radps * (1.0 + model.heading_rate_damping) / model.heading_gain_1ps;
      FlownStep& step = steps.emplace_back();
      step.state = state;
      step.target_heading_math_rad = wrap_to_pi(state.heading_math_rad + side * error_rad);
      commanded_rad = heading.limited_rad(commanded_rad, step.target_heading_math_rad, step_s);
      step.command = {local_.slow_speed_mps, commanded_rad, 0.0};
      state = model_.step(state, step.command, step_s);
    }
  }

  // Cut where there is a way out, which follows; none: there is no such place.
  [[nodiscard]] std::optional<std::size_t> end_in_way_out(std::vector<FlownStep>& steps) const {
    const auto back = static_cast<std::size_t>(kCutBack_s / flight_.plan->step_s);
    for (std::size_t cut = steps.size() - 1; cut > back; cut -= back) {
      const double commanded_rad = steps[cut - 2].command.heading_math_rad;
      const auto escape = local_planning::escape_from(
          ground_->surroundings.surface_m(), model_, escape_options(commanded_rad),
          std::span(steps).subspan(cut - 1), flight_.plan->step_s);
      if (escape) {
        steps.resize(cut - 1);
        const double before_rad = steps.empty() ? flight_.commanded_heading_math_rad
                                                : steps.back().command.heading_math_rad;
        append(steps, escape->steps, before_rad);
        return cut - 1;
      }
    }
    return std::nullopt;
  }

  void append(std::vector<FlownStep>& steps, const std::vector<FlownStep>& escape,
              double before_rad) const {
    steps.insert(steps.end(), escape.begin(), escape.end());
    circle(steps,
           escape.size() > 1 ? escape[escape.size() - 2].command.heading_math_rad : before_rad);
  }

  [[nodiscard]] Reaction made(ReactionKind kind, const local_planning::Flight& flight,
                              std::size_t way_out_step) const {
    Reaction reaction;
    reaction.kind = kind;
    reaction.trajectory = trajectory_of(flight, map_, projection_, config_.vehicle.wind);
    reaction.way_out_step = way_out_step;
    reaction.verdict = verdict_of(reaction.trajectory);
    return reaction;
  }

  std::optional<Reaction> flown_around(std::optional<double> cost_max_m) const {
    const auto [points, is_to_end] = guide();
    if (static_cast<double>(points.size()) * kGuideSpacing_m < kGuideMin_m) {
      return std::nullopt;
    }
    SilentObserver observer;
    auto flown = local_planning::fly_along(*ground_, config_.vehicle, local_, points, from_,
                                           speed_mps(), {}, observer, local_planning::Kernel::kBest,
                                           {}, heading_after(flight_.commanded_heading_math_rad));
    auto* flight = std::get_if<local_planning::Flight>(&flown);
    if (flight == nullptr || flight->steps.size() < 2) {
      return std::nullopt;
    }
    std::vector<local_planning::Flight> candidates;
    if (local_.vertical_pass.is_used) {
      std::vector<flight::Waypoint> held;
      if (is_to_end) {
        held.push_back(points.back());
      }
      if (auto lowered = local_planning::lowered_flight(map_.surface_m, model_,
                                                        local_.vertical_pass, *flight, held, {})) {
        candidates.push_back(std::move(*lowered));
      }
    }
    candidates.push_back(std::move(*flight));
    for (local_planning::Flight& candidate : candidates) {
      if (cost_max_m && !(cost_m(candidate) < *cost_max_m)) {
        continue;
      }
      std::optional<std::size_t> way_out_step = candidate.steps.size();
      if (!is_to_end) {
        way_out_step = end_in_way_out(candidate.steps);
      }
      if (!way_out_step) {
        continue;
      }
      Reaction reaction = made(ReactionKind::kAround, candidate, *way_out_step);
      if (reaction.verdict.is_verified) {
        return reaction;
      }
    }
    return std::nullopt;
  }

  // The first that verifies, or the one that keeps most.
  [[nodiscard]] Reaction way_out() const {
    const std::vector<FlownStep> ahead = planned_steps();
    const double required_m = config_.demands.required_clearance_m;
    struct Margins {
      double clearance_m;
      double lateral_m;
    };
    const std::array<Margins, 4> tries{
        {{local_.rollout_escape.clearance_m, local_.rollout_escape.lateral_margin_m},
         {required_m, 0.0},
         {0.5 * required_m, 0.0},
         {0.0, 0.0}}};
    std::optional<Reaction> best;
    const auto take = [&](const std::vector<FlownStep>& steps) {
      local_planning::Flight flight;
      flight.step_s = flight_.plan->step_s;
      append(flight.steps, steps, flight_.commanded_heading_math_rad);
      Reaction reaction = made(ReactionKind::kLastResort, flight, 0);
      if (reaction.verdict.is_verified) {
        reaction.kind = ReactionKind::kWayOut;
      }
      if (!best || reaction.verdict.is_verified ||
          reaction.verdict.clearance_min_m > best->verdict.clearance_min_m) {
        best = std::move(reaction);
      }
    };
    for (const Margins& margins : tries) {
      if (ahead.size() < 2) {
        break;
      }
      EscapeOptions options = escape_options(flight_.commanded_heading_math_rad);
      options.clearance_m = margins.clearance_m;
      options.lateral_margin_m = margins.lateral_m;
      if (const auto escape = local_planning::escape_from(ground_->surroundings.surface_m(), model_,
                                                          options, ahead, flight_.plan->step_s)) {
        take(escape->steps);
        if (best->kind == ReactionKind::kWayOut) {
          return *best;
        }
      }
    }
    take(climb_turning(0.0));
    take(climb_turning(0.5));
    take(climb_turning(-0.5));
    return *best;
  }

  // Without a look at the ground.
  [[nodiscard]] std::vector<FlownStep> climb_turning(double turn_left_rad) const {
    const double step_s = flight_.plan->step_s;
    const HeadingCommand heading = heading_after(flight_.commanded_heading_math_rad);
    const double wanted_rad = wrap_to_pi(from_.heading_math_rad + turn_left_rad);
    double commanded_rad = flight_.commanded_heading_math_rad;
    ModelState state = from_;
    std::vector<FlownStep> steps;
    const auto count = static_cast<std::size_t>(kLastClimb_s / step_s);
    for (std::size_t i = 0; i <= count; ++i) {
      FlownStep& step = steps.emplace_back();
      commanded_rad = heading.limited_rad(commanded_rad, wanted_rad, step_s);
      step.state = state;
      step.target_heading_math_rad = wanted_rad;
      step.command = {local_.slow_speed_mps, commanded_rad,
                      config_.vehicle.limits.climb_rate_max_mps};
      step.commanded_climb_angle_rad =
          elementary::atan(step.command.climb_rate_mps / state.speed_mps);
      state = model_.step(state, step.command, step_s);
    }
    return steps;
  }

  const map::Map& map_;
  const PlanningConfig& config_;
  const ReactionOptions& options_;
  const FlightUnderPlan& flight_;
  LocalOptions local_;
  std::optional<risk::CostModel> costs_;
  std::optional<LocalGround> ground_;
  CommandModel model_;
  geo::MapProjection projection_;
  ModelState from_;
  std::size_t last_;
};

}  // namespace

const char* name_of(ReactionKind kind) {
  switch (kind) {
    case ReactionKind::kNone:
      return "none";
    case ReactionKind::kAround:
      return "around";
    case ReactionKind::kWayOut:
      return "way_out";
    case ReactionKind::kLastResort:
      return "last_resort";
  }
  return "";
}

raster::Window window_of_reaction(const raster::GridGeometry& geometry,
                                  const ReactionOptions& options, const FlightUnderPlan& flight) {
  double west_m = flight.state.x_m, east_m = west_m;
  double south_m = flight.state.y_m, north_m = south_m;
  for (std::size_t i = flight.step; i <= last_step(options, flight); ++i) {
    const flight::FlightState& state = flight.plan->states[i];
    west_m = std::min(west_m, state.x_m);
    east_m = std::max(east_m, state.x_m);
    south_m = std::min(south_m, state.y_m);
    north_m = std::max(north_m, state.y_m);
  }
  const raster::CellIndex low = geometry.cell_at({west_m - kAround_m, south_m - kAround_m});
  const raster::CellIndex high = geometry.cell_at({east_m + kAround_m, north_m + kAround_m});
  raster::Window window;
  window.column = std::clamp(low.column, 0, geometry.columns - 1);
  window.row = std::clamp(low.row, 0, geometry.rows - 1);
  window.columns = std::clamp(high.column, window.column, geometry.columns - 1) - window.column + 1;
  window.rows = std::clamp(high.row, window.row, geometry.rows - 1) - window.row + 1;
  return window;
}

map::Map map_part(const map::Map& map, const raster::Window& window) {
  map::Map part;
  part.geometry = {map.geometry.west_m + window.column * map.geometry.cell_m,
                   map.geometry.south_m + window.row * map.geometry.cell_m, map.geometry.cell_m,
                   window.columns, window.rows};
  const auto cut = [&](const auto& grid) {
    std::remove_cvref_t<decltype(grid)> result(part.geometry, {});
    for (int row = 0; row < window.rows; ++row) {
      std::copy_n(grid.row(window.row + row) + window.column, window.columns, result.row(row));
    }
    return result;
  };
  part.crs_wkt = map.crs_wkt;
  part.vertical_datum = map.vertical_datum;
  part.terrain_m = cut(map.terrain_m);
  part.surface_m = cut(map.surface_m);
  part.semantics = cut(map.semantics);
  part.visibility = cut(map.visibility);
  part.reference_height_m = map.reference_height_m;
  for (const map::VisibilityBand& band : map.further_visibility) {
    part.further_visibility.push_back({band.height_m, cut(band.share)});
  }
  part.visibility_radius_m = map.visibility_radius_m;
  for (const map::HeightLayer& threat : map.threats) {
    part.threats.push_back({threat.name, cut(threat.height_m)});
  }
  part.label = map.label;
  // Whatever has a corner box that meets the part's.
  struct Box {
    double west_m = 1e300, east_m = -1e300, south_m = 1e300, north_m = -1e300;
    void add(const geo::MapPoint& point) {
      west_m = std::min(west_m, point.x_m);
      east_m = std::max(east_m, point.x_m);
      south_m = std::min(south_m, point.y_m);
      north_m = std::max(north_m, point.y_m);
    }
  };
  const auto meets = [&](const Box& box, double margin_m) {
    return box.west_m - margin_m <= part.geometry.east_m() &&
           box.east_m + margin_m >= part.geometry.west_m &&
           box.south_m - margin_m <= part.geometry.north_m() &&
           box.north_m + margin_m >= part.geometry.south_m;
  };
  for (const map::OverheadLine& line : map.overhead_lines) {
    Box box;
    for (const map::OverheadLine::Support& support : line.supports) {
      box.add(support.point);
    }
    if (meets(box, 0.0)) {
      part.overhead_lines.push_back(line);
    }
  }
  for (const map::Obstacle& obstacle : map.obstacles) {
    Box box;
    box.add(obstacle.point);
    if (meets(box, obstacle.radius_m)) {
      part.obstacles.push_back(obstacle);
    }
  }
  for (const map::Area& area : map.areas) {
    Box box;
    for (const map::Area::Polygon& polygon : area.polygons) {
      for (const geo::MapPoint& point : polygon.outer) {
        box.add(point);
      }
    }
    if (meets(box, 0.0)) {
      part.areas.push_back(area);
    }
  }
  return part;
}

Reaction reaction_to(const map::Map& ground, const PlanningConfig& config,
                     const ReactionOptions& options, const FlightUnderPlan& flight,
                     bool is_seen_from) {
  return Reactor(ground, config, options, flight).reaction(is_seen_from);
}

Reaction way_out_from(const map::Map& ground, const PlanningConfig& config,
                      const ReactionOptions& options, const FlightUnderPlan& flight) {
  return Reactor(ground, config, options, flight).only_way_out();
}

}  // namespace hedgehop::planning
