#include "planning/route_flight.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "base/errors.hpp"
#include "local_planning/flight_cost.hpp"
#include "local_planning/vertical_pass.hpp"

namespace hedgehop::planning {

flight::Trajectory trajectory_of(const local_planning::Flight& flight, const map::Map& map,
                                 const geo::MapProjection& projection, const flight::Wind& wind) {
  flight::Trajectory trajectory;
  trajectory.step_s = flight.step_s;
  trajectory.states.reserve(flight.steps.size());
  for (std::size_t i = 0; i < flight.steps.size(); ++i) {
    const local_planning::FlownStep& step = flight.steps[i];
    const command_model::ModelState& model = step.state;
    const geo::MapPoint point{model.x_m, model.y_m};
    const double convergence_rad = projection.convergence_rad(point);
    const auto true_azimuth_rad = [&](double math_rad) {
      return true_from_grid_azimuth_rad(azimuth_from_math_angle_rad(math_rad), convergence_rad);
    };
    flight::FlightState state;
    state.time_s = static_cast<double>(i) * flight.step_s;
    state.x_m = model.x_m;
    state.y_m = model.y_m;
    state.altitude_m = model.altitude_m;
    const flight::Motion motion =
        flight::over_ground(wind, {model.speed_mps, model.heading_math_rad});
    state.speed_mps = motion.speed_mps;
    state.heading_true_rad = true_azimuth_rad(motion.direction_math_rad);
    state.convergence_rad = convergence_rad;
    state.bank_rad = -model.bank_left_rad;
    state.roll_rate_radps = -model.roll_rate_left_radps;
    state.pitch_rad = model.pitch_rad;
    state.pitch_rate_radps = model.pitch_rate_radps;
    state.climb_rate_mps = model.climb_rate_mps;
    state.vertical_acceleration_mps2 = model.vertical_acceleration_mps2;
    state.target_heading_true_rad =
        true_azimuth_rad(flight::over_ground(wind, {model.speed_mps, step.target_heading_math_rad})
                             .direction_math_rad);
    state.commanded_heading_true_rad = true_azimuth_rad(step.command.heading_math_rad);
    state.commanded_climb_angle_rad =
        wind.is_calm() ? step.commanded_climb_angle_rad
                       : elementary::atan(elementary::tan(step.commanded_climb_angle_rad) *
                                          model.speed_mps / motion.speed_mps);
    state.commanded_speed_mps = step.command.speed_mps;
    state.surface_m = raster::sample_bilinear(map.surface_m, point);
    state.terrain_m = raster::sample_bilinear(map.terrain_m, point);
    trajectory.states.push_back(state);
  }
  return trajectory;
}

namespace {

using flight::NoPlan;

struct Candidate {
  local_planning::Flight flight;
  double cost_m = 0.0;
  bool is_following = false;
  bool is_lowered = false;
};

// Costs that are not known come last.
bool is_cheaper(const Candidate& a, const Candidate& b) {
  return std::isnan(b.cost_m) ? !std::isnan(a.cost_m) : a.cost_m < b.cost_m;
}

// Flies the route at one speed in each way that the config allows, cheapest first. Nothing but the
// reason if none arrives or the observer stops it.
std::variant<std::vector<Candidate>, NoPlan> flown_at(
    double speed_mps, const risk::CostModel& costs, const RouteGrounds* grounds,
    const PlanningConfig& config, const RouteTask& task,
    const local_planning::StepModel& step_model, Observer& observer,
    const local_planning::DecisionWatch& watch) {
  const local_planning::LocalOptions& local = config.local;
  const command_model::CommandModel model(config.vehicle);
  std::vector<Candidate> candidates;
  std::optional<NoPlan> no_plan;
  const auto fly = [&](const local_planning::LocalOptions& options, bool is_following) {
    const auto fly_on = [&](const auto& ground) {
      return local_planning::fly_along(ground, config.vehicle, options, task.guide, task.initial,
                                       speed_mps, step_model, observer,
                                       local_planning::Kernel::kBest, watch);
    };
    auto flown = grounds != nullptr ? fly_on(grounds->of(options)) : fly_on(costs);
    if (auto* stuck = std::get_if<NoPlan>(&flown)) {
      if (!no_plan || stuck->cause == flight::NoPlanCause::kStopped) {
        no_plan = std::move(*stuck);
      }
      return;
    }
    auto& flight = std::get<local_planning::Flight>(flown);
    if (local.vertical_pass.is_used && flight.steps.size() >= 2) {
      if (auto lowered = local_planning::lowered_flight(
              costs.map().surface_m, model, local.vertical_pass, flight, task.held, step_model)) {
        candidates.push_back({std::move(*lowered), 0.0, is_following, true});
      }
    }
    candidates.push_back({std::move(flight), 0.0, is_following, false});
  };
  fly(local, false);
  if (local.is_compared_with_following) {
    fly(local_planning::following_options(local), true);
  }
  if (candidates.empty() || (no_plan && no_plan->cause == flight::NoPlanCause::kStopped)) {
    return *no_plan;
  }
  for (Candidate& candidate : candidates) {
    candidate.cost_m =
        local_planning::flight_cost_m(costs, candidate.flight, local.bank_weight_1prad);
  }
  std::stable_sort(candidates.begin(), candidates.end(), is_cheaper);
  return candidates;
}

std::variant<RouteFlight, NoPlan> flown_and_checked(
    const risk::CostModel& costs, const RouteGrounds* grounds, const PlanningConfig& config,
    const RouteTask& task, const local_planning::StepModel& step_model, Observer& observer,
    const local_planning::DecisionWatch& watch) {
  const geo::MapProjection projection(costs.map().crs_wkt);
  std::vector<double> speeds_mps{task.speed_mps};
  for (const double speed_mps : config.local.retry_speeds_mps) {
    if (speed_mps < speeds_mps.back() && speed_mps >= config.vehicle.limits.speed_min_mps) {
      speeds_mps.push_back(speed_mps);
    }
  }
  std::optional<RouteFlight> best;
  std::optional<NoPlan> no_plan;
  for (const double speed_mps : speeds_mps) {
    auto flown = flown_at(speed_mps, costs, grounds, config, task, step_model, observer, watch);
    if (auto* none = std::get_if<NoPlan>(&flown)) {
      if (none->cause == flight::NoPlanCause::kStopped) {
        return std::move(*none);
      }
      if (!no_plan) {
        no_plan = std::move(*none);
      }
      continue;
    }
    for (const Candidate& candidate : std::get<std::vector<Candidate>>(flown)) {
      RouteFlight checked;
      checked.trajectory =
          trajectory_of(candidate.flight, costs.map(), projection, config.vehicle.wind);
      checked.verdict = verification::verify(costs.map(), checked.trajectory, task.start, task.via,
                                             task.goal, config.vehicle.limits, config.demands);
      checked.cost_m = candidate.cost_m;
      checked.speed_mps = speed_mps;
      checked.is_following = candidate.is_following;
      checked.is_lowered = candidate.is_lowered;
      checked.decisions = candidate.flight.decisions;
      checked.infeasible_decisions = candidate.flight.infeasible_decisions;
      if (!best || checked.verdict.is_verified ||
          checked.verdict.clearance_min_m > best->verdict.clearance_min_m) {
        best = std::move(checked);
      }
      if (best->verdict.is_verified) {
        break;
      }
    }
    if (best && best->verdict.is_verified) {
      break;
    }
  }
  if (!best) {
    return *no_plan;
  }
  best->measures = costs.measures(best->trajectory, config.demands.ceiling_height_m);
  return std::move(*best);
}

// Whether local_ground() of both is the same.
bool has_same_ground(const local_planning::LocalOptions& a, const local_planning::LocalOptions& b) {
  const auto is_rollout = [](const local_planning::LocalOptions& options) {
    return options.mode == local_planning::LocalMode::kRollout;
  };
  const bool has_same_layers = a.window_m == b.window_m && a.safety_radius_m == b.safety_radius_m &&
                               a.semantics_weight == b.semantics_weight &&
                               a.visibility_weight == b.visibility_weight;
  if (is_rollout(a) || is_rollout(b)) {
    return has_same_layers && is_rollout(a) && is_rollout(b);
  }
  return has_same_layers && a.passes == b.passes && a.window_shrink_m == b.window_shrink_m &&
         a.sectors == b.sectors && a.safety_height_m == b.safety_height_m &&
         a.near_distance_m == b.near_distance_m &&
         a.truncation_angle_rad == b.truncation_angle_rad &&
         a.truncation_distance_m == b.truncation_distance_m &&
         a.arc_radius_max_factor == b.arc_radius_max_factor && a.is_arc_widened == b.is_arc_widened;
}

}  // namespace

const RouteGrounds::Made* RouteGrounds::find(const local_planning::LocalOptions& options) const {
  for (const auto& made : made_) {
    if (has_same_ground(made->options, options)) {
      return made.get();
    }
  }
  return nullptr;
}

void RouteGrounds::make(const local_planning::LocalOptions& options) {
  const auto make_one = [this](const local_planning::LocalOptions& of) {
    if (find(of) == nullptr) {
      made_.push_back(std::make_unique<Made>(Made{of, local_planning::local_ground(*costs_, of)}));
    }
  };
  make_one(options);
  if (options.is_compared_with_following) {
    make_one(local_planning::following_options(options));
  }
}

void RouteGrounds::surface_changed(const std::vector<raster::CellIndex>& cells) {
  for (const std::unique_ptr<Made>& made : made_) {
    local_planning::surface_changed(made->ground, *costs_, made->options, cells);
  }
}

const local_planning::LocalGround& RouteGrounds::of(
    const local_planning::LocalOptions& options) const {
  const Made* made = find(options);
  HEDGEHOP_ASSERT(made != nullptr);
  return made->ground;
}

std::variant<RouteFlight, NoPlan> fly_route(const risk::CostModel& costs,
                                            const PlanningConfig& config, const RouteTask& task,
                                            const local_planning::StepModel& step_model,
                                            Observer& observer,
                                            const local_planning::DecisionWatch& watch) {
  return flown_and_checked(costs, nullptr, config, task, step_model, observer, watch);
}

std::variant<RouteFlight, NoPlan> fly_route(const RouteGrounds& grounds,
                                            const PlanningConfig& config, const RouteTask& task,
                                            Observer& observer) {
  return flown_and_checked(grounds.costs(), &grounds, config, task, {}, observer, {});
}

}  // namespace hedgehop::planning
