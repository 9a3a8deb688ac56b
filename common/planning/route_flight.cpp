#include "planning/route_flight.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "base/angles.hpp"
#include "local_planning/flight_cost.hpp"
#include "local_planning/vertical_pass.hpp"

namespace hedgehop::planning {

flight::Trajectory trajectory_of(const local_planning::Flight& flight, const map::Map& map,
                                 const geo::MapProjection& projection) {
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
    state.speed_mps = model.speed_mps;
    state.heading_true_rad = true_azimuth_rad(model.heading_math_rad);
    state.convergence_rad = convergence_rad;
    state.bank_rad = -model.bank_left_rad;
    state.roll_rate_radps = -model.roll_rate_left_radps;
    state.pitch_rad = model.pitch_rad;
    state.pitch_rate_radps = model.pitch_rate_radps;
    state.climb_rate_mps = model.climb_rate_mps;
    state.vertical_acceleration_mps2 = model.vertical_acceleration_mps2;
    state.target_heading_true_rad = true_azimuth_rad(step.target_heading_math_rad);
    state.commanded_heading_true_rad = true_azimuth_rad(step.command.heading_math_rad);
    state.commanded_climb_angle_rad = step.commanded_climb_angle_rad;
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
    double speed_mps, const risk::CostModel& costs, const PlanningConfig& config,
    const RouteTask& task, const local_planning::StepModel& step_model, Observer& observer,
    const local_planning::DecisionWatch& watch) {
  const local_planning::LocalOptions& local = config.local;
  const command_model::CommandModel model(config.vehicle);
  std::vector<Candidate> candidates;
  std::optional<NoPlan> no_plan;
  const auto fly = [&](const local_planning::LocalOptions& options, bool is_following) {
    auto flown = local_planning::fly_along(costs, config.vehicle, options, task.guide, task.initial,
                                           speed_mps, step_model, observer,
                                           local_planning::Kernel::kBest, watch);
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

}  // namespace

std::variant<RouteFlight, NoPlan> fly_route(const risk::CostModel& costs,
                                            const PlanningConfig& config, const RouteTask& task,
                                            const local_planning::StepModel& step_model,
                                            Observer& observer,
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
    auto flown = flown_at(speed_mps, costs, config, task, step_model, observer, watch);
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
      checked.trajectory = trajectory_of(candidate.flight, costs.map(), projection);
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

}  // namespace hedgehop::planning
