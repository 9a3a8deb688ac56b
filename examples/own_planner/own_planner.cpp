// A global planner of one's own: the straight line to the goal, level and well above the highest
// ground on the way. docs/replace_a_stage.md tells how to put it in the place of the shipped one.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "services/global_planner/global_planner_service.hpp"
#include "services/shared/service_start.hpp"

using namespace hedgehop;

// The planner knows nothing of the bus: map, request and config in, route out.
std::variant<flight::RoutePlan, flight::NoPlan> straight_route(
    const map::Map& map, const flight::PlanRequest& request, const planning::PlanningConfig& config,
    const global_planning::OnProgress&, Observer&) {
  const geo::MapProjection projection(map.crs_wkt);
  const geo::MapPoint from = projection.to_map(request.start.position);
  const geo::MapPoint to = projection.to_map(request.goal.position);
  const double length_m = std::hypot(to.x_m - from.x_m, to.y_m - from.y_m);
  const int pieces = std::max(2, static_cast<int>(length_m / config.global.guide_spacing_m));
  flight::Route route;
  double altitude_m = 0.0;
  for (int i = 0; i <= pieces; ++i) {
    const double t = static_cast<double>(i) / pieces;
    const geo::MapPoint p{from.x_m + t * (to.x_m - from.x_m), from.y_m + t * (to.y_m - from.y_m)};
    const double highest_m = raster::max_within(map.surface_m, p, config.global.lateral_margin_m);
    if (std::isnan(highest_m)) {
      return flight::NoPlan{flight::NoPlanCause::kBudgetExhausted, p, "unknown ground on the line"};
    }
    altitude_m = std::max(altitude_m, highest_m + config.global.envelope_floor_m);
    route.guide.push_back({p.x_m, p.y_m, 0.0});
  }
  for (flight::Waypoint& point : route.guide) {
    point.altitude_m = altitude_m;
  }
  route.guide_spacing_m = length_m / pieces;
  route.waypoints = {route.guide.front(), route.guide.back()};
  route.cost = planning::cost_model(map, config).route_cost(route.waypoints, 5.0);
  std::printf("straight route of %.2f km, cost %.0f m\n", length_m / 1000.0, route.cost.total_m());
  return flight::RoutePlan{flight::plan_request_id(request, map.hash, config.text),
                           request,
                           config.text,
                           {.hash = map.hash,
                            .crs_wkt = map.crs_wkt,
                            .vertical_datum = map.vertical_datum,
                            .label = map.label,
                            .attributions = map.attributions},
                           route.waypoints.front(),
                           route.waypoints.back(),
                           route};
}

int main(int argc, char** argv) {
  return bus::run_main("own_planner", [&] {
    const auto arguments =
        bus::parse_service_arguments(argc, argv, "own_planner", "Straight lines", {});
    const auto config = services::load_config("", "global_planner.yaml");
    const auto options = services::read_planner_options(config.reader());
    bus::install_stop_signals();
    bus::Bus bus(arguments.value().bus);
    bus::BlobExchange exchange({}, bus);
    bus::ServiceLoop loop(bus, exchange, "own_planner", config.hash());
    services::GlobalPlannerService service(options, bus, exchange, loop, straight_route,
                                           "own_planner");
    loop.run(options.tick_period_s, [&](Time now) { service.tick(now); });
    for (int i = 0; i < 16; ++i) {
      service.tick(bus.now());  // at the end of a log: what has come together by now
    }
    return 0;
  });
}
