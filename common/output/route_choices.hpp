#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "flight/plan.hpp"
#include "flight/route_choice.hpp"

namespace hedgehop::output {

inline constexpr char kChoicesFile[] = "alternatives.json";
inline constexpr char kChoicesRoutesFile[] = "alternatives.geojson";
inline constexpr char kChoicesFolder[] = "alternatives";  // a plan bundle for each that was flown

/// A flight along one of the routes to choose from, by its place in RouteChoices::routes.
struct FlownChoice {
  std::size_t route = 0;
  const flight::Plan* plan = nullptr;  // null: no flight along it arrives
  const flight::NoPlan* no_plan = nullptr;
};

/// alternatives.json: measures, costs and waypoints of each route, which share of them run
/// together, and why there are not more. `flown` may lack routes: those were not flown.
std::string route_choices_json(const flight::RouteChoices& choices,
                               const std::vector<FlownChoice>& flown);

/// The same routes as lines after RFC 7946; altitudes as in route_geojson().
std::string route_choices_geojson(const flight::RouteChoices& choices);

/// A route as alternatives.json tells it.
struct ListedRoute {
  std::string name;
  flight::RouteMeasures measures;
  double cost_m = 0.0;        // under its own weights
  double shared_share = 0.0;  // greatest of its shares along the others
  bool is_flown = false;      // kChoicesFolder/name is its plan bundle
  std::vector<flight::Waypoint> waypoints;
};
struct RouteList {
  Hash128 request_id;  // of the plan that they are alternatives to
  std::vector<ListedRoute> routes;
  std::string why_no_more;
};

/// Reads alternatives.json of a plan bundle; nothing if it has none. Throws DataError naming file,
/// line and field.
std::optional<RouteList> read_route_choices(const std::filesystem::path& plan_folder);

}  // namespace hedgehop::output
