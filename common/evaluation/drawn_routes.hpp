#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <variant>
#include <vector>

#include "base/config_reader.hpp"
#include "base/observer.hpp"
#include "evaluation/problem_drawing.hpp"
#include "flight/plan.hpp"
#include "map/map.hpp"
#include "planning/planning.hpp"

namespace hedgehop::evaluation {

/// Section `routes` of the evaluation config: the problems that the evaluations of local planning
/// share.
DrawingRules read_route_rules(ConfigReader& reader);

/// A global route of a drawn problem.
struct DrawnRoute {
  std::int64_t problem = 0;  // in the order of drawing
  flight::Waypoint start;
  flight::Waypoint goal;
  std::vector<flight::Waypoint> guide;
  double cost_m = 0.0;  // eq. (1)
};

struct DrawnRoutes {
  std::vector<DrawnRoute> routes;
  std::int64_t problems = 0;  // drawn until there were enough routes
  std::int64_t from_cache = 0;
};

/// Plans a route; planning::plan_route outside tests. Called from several threads at once.
using RouteFunction = std::function<std::variant<flight::RoutePlan, flight::NoPlan>(
    const map::Map& map, const flight::PlanRequest& request, const planning::PlanningConfig& config,
    Observer& observer)>;

/// Global routes of drawn problems: the first `count` problems that have one, at most three times
/// as many being tried.
///
/// With a cache folder, each answer is kept there in a file of its own, under a folder named by
/// map, config (all but its section `local`, which routes do not depend on), rules and seed; it is
/// written whole or not at all. So an interrupted run goes on where it was, and a file that cannot
/// be read, or that belongs to another question, is planned anew and replaced.
///
/// @param cache_folder  empty: nothing is kept
/// @throws DataError    if the map is too small, or too few problems have a route.
/// @throws Interrupted  if the observer says so; what is finished is in the cache.
/// @note  On all threads that oneTBB may use; the result does not depend on how many those are.
DrawnRoutes draw_routes(const map::Map& map, const planning::PlanningConfig& config,
                        const DrawingRules& rules, std::int64_t count, std::uint64_t seed,
                        const std::filesystem::path& cache_folder, const RouteFunction& plan,
                        Observer& observer);

}  // namespace hedgehop::evaluation
