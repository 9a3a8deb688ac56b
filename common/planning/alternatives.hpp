#pragma once

#include <string>
#include <vector>

#include "base/config_reader.hpp"
#include "base/observer.hpp"
#include "flight/route_choice.hpp"
#include "map/map.hpp"
#include "planning/planning.hpp"

namespace hedgehop::planning {

/// Weights of eq. (1) that look for a route of another kind.
struct RouteWeighting {
  std::string name;  // also of a folder
  double visibility = 0.0;
  double semantics = 0.0;
};

/// config/alternatives.yaml
struct AlternativeOptions {
  std::size_t routes_max = 0;
  double shared_within_m = 0.0;
  double shared_share_max = 0.0;
  double gain_min = 0.0;
  double length_factor_max = 0.0;
  double avoidance_width_m = 0.0;
  std::vector<double> avoidances;  // [-] beside eq. (1), ascending
  std::vector<RouteWeighting> weightings;
};
AlternativeOptions read_alternative_options(ConfigReader& reader);

/// Further routes beside the one of a plan, so that a person can choose.
///
/// Each weighting searches the ground of the plan for its own best route, by the lattice search of
/// plan_leg(). If that runs along a route found before for more than `shared_share_max` of either
/// length, or is better in nothing, the search is repeated with a cost on what lies near to all
/// routes found before, and again with the next greater cost. The first one that may stay is
/// refined, judged again, and kept. Heights, limits and areas of the envelope are computed once for
/// all; layers are shared; the field that leads a search depends on its costs and is made for each.
///
/// Every pair of the result keeps the limits of RouteChoices, the plan's own route included; where
/// there are less than `routes_max`, it says why. An observer that asks to stop ends the search
/// with the routes so far. Same arguments, same routes.
///
/// @param main    as plan_route() gave it for this map and config.
/// @note  About as long as planning the route for each weighting, and a fifth of it for each
///        repeated search.
flight::RouteChoices plan_alternatives(const map::Map& map, const flight::RoutePlan& main,
                                       const PlanningConfig& config,
                                       const AlternativeOptions& options, Observer& observer);

}  // namespace hedgehop::planning
