#pragma once

#include <string>
#include <vector>

#include "flight/plan.hpp"
#include "flight/route.hpp"

namespace hedgehop::flight {

/// What a person chooses a route by: integrals along its legs, no weights.
struct RouteMeasures {
  double length_m = 0.0;      // short ones are fast
  double visibility_m = 0.0;  // of the square of the visibility: small ones are hidden
  double semantics_m = 0.0;   // of the cost of land use: small ones are quiet
};

/// One of several routes for the same request.
struct RouteChoice {
  std::string name;  // "main", or that of its weighting
  RoutePlan plan;    // its config text holds its own weights
  RouteMeasures measures;
  double visibility_weight = 0.0;  // of eq. (1), as in the config text
  double semantics_weight = 0.0;
  double avoidance = 0.0;  // what a metre near to a route before it cost the search
};

/// Routes to choose from. None is better than another in nothing, and no two run together for more
/// than a share of their lengths.
struct RouteChoices {
  double shared_within_m = 0.0;  // what counts as running together, seen from above
  double shared_share_max = 0.0;
  std::vector<RouteChoice> routes;          // the plan's own is the first
  std::vector<std::vector<double>> shared;  // [i][j]: share of route i that runs along route j
  std::string why_no_more;                  // why there are not as many as wanted; else empty
};

/// Share of a route's length, seen from above, that lies within a distance of another; in [0, 1].
/// Judged in the middle of pieces of at most 10 m. O(length * legs of the other).
double shared_share(const std::vector<Waypoint>& route, const std::vector<Waypoint>& other,
                    double within_m);

/// The middle of the longest stretch that shared_share() counts; the first point without one.
geo::MapPoint longest_shared_stretch(const std::vector<Waypoint>& route,
                                     const std::vector<Waypoint>& other, double within_m);

/// Whether a route is better than another by at least this share of the other's value in one of
/// the measures.
bool is_better_in_something(const RouteMeasures& route, const RouteMeasures& other, double gain);

}  // namespace hedgehop::flight
