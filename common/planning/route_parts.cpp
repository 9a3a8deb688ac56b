#include "planning/route_parts.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "base/angles.hpp"
#include "base/elementary.hpp"

namespace hedgehop::planning {
namespace {

using flight::NoPlan;
using flight::NoPlanCause;

// Turns by less at the start move the flight aside by some metres.
constexpr double kHeadingTolerance_rad = 12.0 * kDegree_rad;

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

}  // namespace

std::string text_of(double value, int decimals) {
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, "%.*f", decimals, value);
  return buffer;
}

std::string text_of(const geo::GeodeticPosition& position) {
  return text_of(degrees_from_radians(position.latitude_rad), 5) + "," +
         text_of(degrees_from_radians(position.longitude_rad), 5);
}

std::variant<std::vector<flight::Waypoint>, NoPlan> place_stops(const risk::CostModel& costs,
                                                                const flight::PlanRequest& request,
                                                                const PlanningConfig& config) {
  const map::Map& map = costs.map();
  const geo::MapProjection projection(map.crs_wkt);
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
    return *std::move(no_plan);
  }
  for (const flight::RequestPoint& via : request.via) {
    if (auto no_plan = place(via, kGoal)) {
      no_plan->explanation = "via point: " + no_plan->explanation;
      return *std::move(no_plan);
    }
  }
  if (auto no_plan = place(request.goal, kGoal)) {
    return *std::move(no_plan);
  }
  return stops;
}

global_planning::RouteProblem leg_problem(const map::Map& map,
                                          const std::vector<flight::Waypoint>& stops,
                                          const flight::PlanRequest& request,
                                          const PlanningConfig& config, std::int64_t leg) {
  const std::int64_t budget =
      request.work_budget > 0 ? request.work_budget : config.global.work_budget;
  const auto legs = static_cast<std::int64_t>(stops.size()) - 1;
  global_planning::RouteProblem problem;
  problem.start = stops[static_cast<std::size_t>(leg)];
  problem.goal = stops[static_cast<std::size_t>(leg + 1)];
  problem.seed = request.seed + static_cast<std::uint64_t>(leg);
  problem.work_budget = budget * (leg + 1) / legs - budget * leg / legs;
  if (leg == 0 && request.start_heading_true_rad) {
    const double math_rad = math_angle_from_azimuth_rad(grid_from_true_azimuth_rad(
        *request.start_heading_true_rad,
        geo::MapProjection(map.crs_wkt).convergence_rad(problem.start.point())));
    // The arc of a corner begins before it; a leg this long holds that of the tolerance.
    const double length_m = std::max(
        1.0, 2.0 * config.global.turn_radius_m * elementary::tan(0.5 * kHeadingTolerance_rad));
    problem.lead_in = global_planning::LeadIn{length_m * elementary::cos(math_rad),
                                              length_m * elementary::sin(math_rad)};
  }
  return problem;
}

void append_leg(flight::Route& route, const flight::Route& leg) {
  const auto append = [](std::vector<flight::Waypoint>& to,
                         const std::vector<flight::Waypoint>& from) {
    to.insert(to.end(), from.begin() + (to.empty() ? 0 : 1), from.end());
  };
  append(route.waypoints, leg.waypoints);
  append(route.guide, leg.guide);
  route.guide_spacing_m = leg.guide_spacing_m;
  flight::add(route.cost, leg.cost);
  route.lower_bound_m += leg.lower_bound_m;
  route.work_units += leg.work_units;
  route.samples += leg.samples;
  route.batches += leg.batches;
}

}  // namespace hedgehop::planning
