#include "planning/planning.hpp"

#include <cmath>

#include "base/angles.hpp"
#include "planning/route_flight.hpp"

namespace hedgehop::planning {
namespace {

using flight::NoPlan;
using flight::NoPlanCause;

flight::MapIdentity identity_of(const map::Map& map) {
  return {map.hash, 0, map.crs_wkt, map.vertical_datum, map.label, map.attributions};
}

std::string text_of(double value, int decimals) {
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, "%.*f", decimals, value);
  return buffer;
}

std::string text_of(const geo::GeodeticPosition& position) {
  return text_of(degrees_from_radians(position.latitude_rad), 5) + "," +
         text_of(degrees_from_radians(position.longitude_rad), 5);
}

struct EndCauses {
  const char* name;
  NoPlanCause outside, unknown, below, above, inside_area;
};
constexpr EndCauses kStart = {"start",
                              NoPlanCause::kStartOutsideMap,
                              NoPlanCause::kStartUnknownTerrain,
                              NoPlanCause::kStartBelowEnvelope,
                              NoPlanCause::kStartAboveEnvelope,
                              NoPlanCause::kStartInsideArea};
constexpr EndCauses kGoal = {"goal",
                             NoPlanCause::kGoalOutsideMap,
                             NoPlanCause::kGoalUnknownTerrain,
                             NoPlanCause::kGoalBelowEnvelope,
                             NoPlanCause::kGoalAboveEnvelope,
                             NoPlanCause::kGoalInsideArea};

// Where the ends of a route may lie: clear of the ground and within what the search may use.
std::variant<flight::Waypoint, NoPlan> place_end(const map::Map& map, const risk::AreaIndex& areas,
                                                 const geo::MapProjection& projection,
                                                 const PlanningConfig& config,
                                                 const flight::RequestPoint& request,
                                                 const EndCauses& causes) {
  const std::string who = std::string(causes.name) + " " + text_of(request.position);
  const geo::MapPoint point = projection.to_map(request.position);
  if (!map.geometry.contains(point)) {
    return NoPlan{causes.outside, point,
                  who +
                      " lies outside the map; choose a place inside (hedgehop info shows its "
                      "extent) or prepare a larger map"};
  }
  const double surface_m = raster::sample_bilinear(map.surface_m, point);
  const double highest_m = raster::max_within(map.surface_m, point, config.global.lateral_margin_m);
  if (std::isnan(surface_m) || std::isnan(highest_m)) {
    return NoPlan{causes.unknown, point,
                  who + " lies within " + text_of(config.global.lateral_margin_m, 0) +
                      " m of cells without elevation or of the map's edge; move it, or prepare the "
                      "map with a source that covers it"};
  }
  const double altitude_m =
      request.height_m ? surface_m + *request.height_m : highest_m + config.reference_height_m;
  const double height_m = altitude_m - surface_m;
  if (height_m < config.demands.required_clearance_m) {
    return NoPlan{
        causes.below, point,
        who + " at " + text_of(height_m, 1) +
            " m above the surface is inside the terrain or closer to it than the required "
            "clearance of " +
            text_of(config.demands.required_clearance_m, 1) + " m; raise it"};
  }
  if (height_m > config.global.envelope_ceiling_m && request.height_m) {
    return NoPlan{causes.above, point,
                  who + " at " + text_of(height_m, 1) +
                      " m above the surface lies above the flight envelope, which ends at " +
                      text_of(config.global.envelope_ceiling_m, 1) +
                      " m; lower it, or raise global.envelope_ceiling_m"};
  }
  if (const map::Area* area = areas.hard_area_at(point, altitude_m)) {
    return NoPlan{causes.inside_area, point,
                  who + " at altitude " + text_of(altitude_m, 0) +
                      " m lies inside the no-fly area " +
                      (area->name.empty() ? "without a name" : "'" + area->name + "'") +
                      "; move it, or prepare the map without that area"};
  }
  return flight::Waypoint{point.x_m, point.y_m, altitude_m};
}

void append_leg(flight::Route& route, const flight::Route& leg) {
  const auto append = [](std::vector<flight::Waypoint>& to,
                         const std::vector<flight::Waypoint>& from) {
    to.insert(to.end(), from.begin() + (to.empty() ? 0 : 1), from.end());
  };
  append(route.waypoints, leg.waypoints);
  append(route.guide, leg.guide);
  route.guide_spacing_m = leg.guide_spacing_m;
  route.cost.length_m += leg.cost.length_m;
  route.cost.visibility_m += leg.cost.visibility_m;
  route.cost.semantics_m += leg.cost.semantics_m;
  route.cost.height_m += leg.cost.height_m;
  route.lower_bound_m += leg.lower_bound_m;
  route.work_units += leg.work_units;
  route.samples += leg.samples;
  route.batches += leg.batches;
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

}  // namespace

risk::CostModel cost_model(const map::Map& map, const PlanningConfig& config) {
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
  if (const double speed_mps = request.speed_mps.value_or(config.speed_mps);
      !(speed_mps >= limits.speed_min_mps && speed_mps <= limits.speed_max_mps)) {
    throw UsageError("a speed of " + text_of(speed_mps, 1) +
                         " m/s lies outside what the vehicle '" + config.vehicle.name +
                         "' flies, " + text_of(limits.speed_min_mps, 1) + " to " +
                         text_of(limits.speed_max_mps, 1) + " m/s",
                     "choose a speed within these limits, or another vehicle_file");
  }
  const geo::MapProjection projection(map.crs_wkt);
  const risk::CostModel costs = cost_model(map, config);
  std::vector<flight::Waypoint> stops;
  const auto place = [&](const flight::RequestPoint& point,
                         const EndCauses& causes) -> std::optional<NoPlan> {
    auto placed = place_end(map, costs.areas(), projection, config, point, causes);
    if (auto* no_plan = std::get_if<NoPlan>(&placed)) {
      return std::move(*no_plan);
    }
    stops.push_back(std::get<flight::Waypoint>(placed));
    return std::nullopt;
  };
  if (auto no_plan = place(request.start, kStart)) {
    return *no_plan;
  }
  for (const flight::RequestPoint& via : request.via) {
    if (auto no_plan = place(via, kGoal)) {
      no_plan->explanation = "via point: " + no_plan->explanation;
      return *no_plan;
    }
  }
  if (auto no_plan = place(request.goal, kGoal)) {
    return *no_plan;
  }

  flight::RoutePlan plan;
  plan.request_id = flight::plan_request_id(request, map.hash, config.text);
  plan.request = request;
  plan.config_text = config.text;
  plan.map = identity_of(map);
  plan.start = stops.front();
  plan.goal = stops.back();

  const std::int64_t budget =
      request.work_budget > 0 ? request.work_budget : config.global.work_budget;
  const auto legs = static_cast<std::int64_t>(stops.size()) - 1;
  for (std::int64_t leg = 0; leg < legs; ++leg) {
    global_planning::RouteProblem problem;
    problem.start = stops[static_cast<std::size_t>(leg)];
    problem.goal = stops[static_cast<std::size_t>(leg + 1)];
    problem.seed = request.seed + static_cast<std::uint64_t>(leg);
    problem.work_budget = budget * (leg + 1) / legs - budget * leg / legs;
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
    auto found = global_planning::plan_leg(costs, config.global, problem, report, observer);
    if (auto* no_plan = std::get_if<NoPlan>(&found)) {
      return std::move(*no_plan);
    }
    append_leg(plan.route, std::get<flight::Route>(found));
  }
  return plan;
}

std::variant<flight::Plan, NoPlan> plan_flight(const map::Map& map,
                                               const flight::RoutePlan& route_plan,
                                               const PlanningConfig& config,
                                               const local_planning::StepModel& step_model,
                                               Observer& observer) {
  if (route_plan.map.hash != map.hash) {
    throw DataError("the route was planned on map " + route_plan.map.hash.hex() +
                        ", the map at hand is " + map.hash.hex(),
                    "use the map that the route was planned on");
  }
  HEDGEHOP_ASSERT(route_plan.config_text == config.text);
  HEDGEHOP_ASSERT(route_plan.route.guide.size() >= 2);
  const geo::MapProjection projection(map.crs_wkt);
  const risk::CostModel costs = cost_model(map, config);

  RouteTask task;
  task.start = route_plan.start;
  task.goal = route_plan.goal;
  task.guide = route_plan.route.guide;
  task.speed_mps = route_plan.request.speed_mps.value_or(config.speed_mps);
  task.initial = local_planning::state_at_start(task.guide, task.speed_mps, config.vehicle.limits);
  if (route_plan.request.start_heading_true_rad) {
    task.initial.heading_math_rad = math_angle_from_azimuth_rad(grid_from_true_azimuth_rad(
        *route_plan.request.start_heading_true_rad,
        projection.convergence_rad({task.initial.x_m, task.initial.y_m})));
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
  auto flown = fly_route(costs, config, task, step_model, observer);
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
