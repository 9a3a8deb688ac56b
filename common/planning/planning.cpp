#include "planning/planning.hpp"

#include <cmath>

#include "base/angles.hpp"
#include "planning/map_for_plan.hpp"
#include "planning/roadmap_store.hpp"
#include "planning/route_flight.hpp"
#include "planning/route_parts.hpp"

namespace hedgehop::planning {
namespace {

using flight::NoPlan;
using flight::NoPlanCause;

flight::MapIdentity identity_of(const map::Map& map) {
  return {map.hash, 0, map.crs_wkt, map.vertical_datum, map.label, map.attributions};
}

// "15.24", or "15.24 to 150.00" with an exposure volume.
std::string heights_text(const map::Map& map) {
  double low_m = map.reference_height_m;
  double high_m = map.reference_height_m;
  for (const map::VisibilityBand& band : map.further_visibility) {
    low_m = std::min(low_m, band.height_m);
    high_m = std::max(high_m, band.height_m);
  }
  return low_m == high_m ? text_of(low_m, 2) : text_of(low_m, 2) + " to " + text_of(high_m, 2);
}

// Whether the power available does not keep the vehicle up there, by how much.
std::optional<NoPlan> no_power_at(const flight::Waypoint& place, double speed_mps,
                                  const PlanningConfig& config) {
  if (!config.vehicle.power_limits) {
    return std::nullopt;
  }
  const flight::PowerLimits& power = *config.vehicle.power_limits;
  if (config.vehicle.vertical_rates(speed_mps, place.altitude_m).climb_mps >= 0.0) {
    return std::nullopt;
  }
  const double short_w =
      power.required_w(speed_mps, place.altitude_m) - power.available_w(place.altitude_m);
  return NoPlan{NoPlanCause::kClimbLimit, place.point(),
                "no power to fly there: at " + text_of(place.altitude_m, 0) + " m, " +
                    text_of(speed_mps, 1) + " m/s and " + text_of(power.mass_kg(), 0) +
                    " kg level flight needs " + text_of(short_w / 1000.0, 1) +
                    " kW more at the rotor than conditions.power_reserve leaves of the power "
                    "available. Choose a lower place, a lighter flight or another speed"};
}

}  // namespace

risk::CostModel cost_model(const map::Map& map, const PlanningConfig& config) {
  require_threats(map, config);
  return {map,
          config.weights,
          config.semantics,
          config.unknown_visibility,
          config.reference_height_m,
          config.small_patch_m};
}

std::variant<flight::RoutePlan, NoPlan> plan_route(const map::Map& map,
                                                   const flight::PlanRequest& request,
                                                   const PlanningConfig& config,
                                                   const global_planning::OnProgress& on_progress,
                                                   Observer& observer) {
  if (!map::covers_height(map, config.reference_height_m)) {
    return NoPlan{NoPlanCause::kReferenceHeightMismatch, std::nullopt,
                  "the map's visibility was computed for " + heights_text(map) +
                      " m above the surface, the config asks for reference_height_m " +
                      text_of(config.reference_height_m, 2) +
                      "; prepare the map for that height, or change the config"};
  }
  const flight::Limits& limits = config.vehicle.limits;
  if (const double asked_mps = request.speed_mps.value_or(config.speed_mps);
      !(asked_mps >= limits.speed_min_mps && asked_mps <= limits.speed_max_mps)) {
    throw UsageError("a speed of " + text_of(asked_mps, 1) +
                         " m/s lies outside what the vehicle '" + config.vehicle.name +
                         "' flies, " + text_of(limits.speed_min_mps, 1) + " to " +
                         text_of(limits.speed_max_mps, 1) + " m/s",
                     "choose a speed within these limits, or another vehicle_file");
  } else if (const double wind_mps = config.conditions.wind_mps;
             wind_mps > flight::kWindShareMax * asked_mps) {
    throw UsageError("a wind of " + text_of(wind_mps, 1) +
                         " m/s (conditions.wind_mps) is more than half of the airspeed of " +
                         text_of(asked_mps, 1) + " m/s",
                     "fly at " + text_of(wind_mps / flight::kWindShareMax, 1) +
                         " m/s or faster, or wait for less wind");
  }
  const risk::CostModel costs = cost_model(map, config);
  auto placed = place_stops(costs, request, config);
  if (auto* no_plan = std::get_if<NoPlan>(&placed)) {
    return std::move(*no_plan);
  }
  const auto& stops = std::get<std::vector<flight::Waypoint>>(placed);

  flight::RoutePlan plan;
  plan.request_id = flight::plan_request_id(request, map.hash, config.text);
  plan.request = request;
  plan.config_text = config.text;
  plan.map = identity_of(map);
  plan.start = stops.front();
  plan.goal = stops.back();

  const double speed_mps = request.speed_mps.value_or(config.speed_mps);
  for (const flight::Waypoint& stop : stops) {
    if (auto no_plan = no_power_at(stop, speed_mps, config)) {
      return *std::move(no_plan);
    }
  }
  const global_planning::GlobalOptions global =
      global_options(in_wind(config, map.crs_wkt, plan.start.point()), speed_mps);
  const std::int64_t budget =
      request.work_budget > 0 ? request.work_budget : config.global.work_budget;
  KeptRoadmap roadmap;
  if (config.global.use_roadmap) {
    roadmap = config.roadmap;
    if (!roadmap.roadmap || roadmap.key != roadmap_key(map, config)) {
      const ReadyRoadmap ready = ready_roadmap(map, config, {}, observer);
      roadmap = {ready.roadmap, ready.key};
    }
  }
  const auto legs = static_cast<std::int64_t>(stops.size()) - 1;
  for (std::int64_t leg = 0; leg < legs; ++leg) {
    global_planning::RouteProblem problem = leg_problem(map, stops, request, config, leg);
    problem.roadmap = roadmap.roadmap.get();
    const double dx_m = problem.goal.x_m - problem.start.x_m;
    const double dy_m = problem.goal.y_m - problem.start.y_m;
    if (std::sqrt(dx_m * dx_m + dy_m * dy_m) < config.demands.goal_radius_m) {
      return NoPlan{
          NoPlanCause::kGoalEqualsStart, problem.goal.point(),
          "goal " + text_of(request.goal.position) + " lies within " +
              text_of(config.demands.goal_radius_m, 0) +
              " m of where the leg starts, which counts as having arrived; choose another goal"};
    }
    const auto report = [&](const global_planning::RouteProgress& progress) {
      global_planning::RouteProgress whole = progress;
      whole.work_units += plan.route.work_units;
      whole.work_budget = budget;
      if (legs > 1) {
        whole.best_route = nullptr;  // that of one leg
      }
      if (on_progress) {
        on_progress(whole);
      }
    };
    auto found = global_planning::plan_leg(costs, global, problem, report, observer);
    if (const auto* none = std::get_if<NoPlan>(&found);
        none != nullptr && problem.lead_in && none->cause != NoPlanCause::kStopped) {
      // With a corner that is flown as well as it goes; what that comes to, the flight's check
      // says.
      problem.lead_in.reset();
      found = global_planning::plan_leg(costs, global, problem, report, observer);
    }
    if (auto* no_plan = std::get_if<NoPlan>(&found)) {
      return std::move(*no_plan);
    }
    append_leg(plan.route, std::get<flight::Route>(found));
  }
  return plan;
}

std::variant<flight::Plan, NoPlan> plan_flight(const map::Map& map,
                                               const flight::RoutePlan& route_plan,
                                               const PlanningConfig& whole_config,
                                               const local_planning::StepModel& step_model,
                                               Observer& observer,
                                               const local_planning::DecisionWatch& watch) {
  if (route_plan.map.hash != map.hash) {
    throw DataError("the route was planned on map " + route_plan.map.hash.hex() +
                        ", the map at hand is " + map.hash.hex(),
                    "use the map that the route was planned on");
  }
  HEDGEHOP_ASSERT(route_plan.config_text == whole_config.text);
  HEDGEHOP_ASSERT(route_plan.route.guide.size() >= 2);
  const PlanningConfig config = in_wind(whole_config, map.crs_wkt, route_plan.start.point());
  const geo::MapProjection projection(map.crs_wkt);
  const risk::CostModel costs = cost_model(map, config);

  RouteTask task;
  task.start = route_plan.start;
  task.goal = route_plan.goal;
  task.guide = route_plan.route.guide;
  task.speed_mps = route_plan.request.speed_mps.value_or(config.speed_mps);
  task.initial = local_planning::state_at_start(task.guide, task.speed_mps, config.vehicle);
  if (route_plan.request.start_heading_true_rad) {
    task.initial.heading_math_rad = flight::heading_for_course_rad(
        config.vehicle.wind, task.speed_mps,
        math_angle_from_azimuth_rad(grid_from_true_azimuth_rad(
            *route_plan.request.start_heading_true_rad,
            projection.convergence_rad({task.initial.x_m, task.initial.y_m}))));
  }
  task.held = {route_plan.goal};
  for (const flight::RequestPoint& via : route_plan.request.via) {
    const geo::MapPoint point = projection.to_map(via.position);
    task.via.push_back(point);
    if (via.height_m) {
      task.held.push_back(
          {point.x_m, point.y_m, raster::sample_bilinear(map.surface_m, point) + *via.height_m});
    }
  }
  auto flown = fly_route(costs, config, task, step_model, observer, watch);
  if (auto* no_plan = std::get_if<NoPlan>(&flown)) {
    return std::move(*no_plan);
  }
  auto& flight = std::get<RouteFlight>(flown);

  flight::Plan plan;
  plan.route_plan = route_plan;
  plan.trajectory = std::move(flight.trajectory);
  plan.measures = flight.measures;
  plan.decisions = flight.decisions;
  plan.infeasible_decisions = flight.infeasible_decisions;
  plan.verdict = std::move(flight.verdict);
  if (flight.speed_mps < task.speed_mps) {
    plan.warnings.push_back("flown at " + text_of(flight.speed_mps, 1) + " m/s: at " +
                            text_of(task.speed_mps, 1) + " m/s no flight along the route verifies");
  }
  if (plan.infeasible_decisions > 0) {
    plan.warnings.push_back("in " + std::to_string(plan.infeasible_decisions) + " of " +
                            std::to_string(plan.decisions) +
                            " decisions no direction could be flown within the climb limit; the "
                            "model climbed and slowed "
                            "down");
  }
  return plan;
}

std::variant<flight::Plan, NoPlan> plan(const map::Map& map, const flight::PlanRequest& request,
                                        const PlanningConfig& config,
                                        const global_planning::OnProgress& on_progress,
                                        Observer& observer) {
  auto route = plan_route(map, request, config, on_progress, observer);
  if (auto* no_plan = std::get_if<NoPlan>(&route)) {
    return std::move(*no_plan);
  }
  return plan_flight(map, std::get<flight::RoutePlan>(route), config, {}, observer);
}

}  // namespace hedgehop::planning
