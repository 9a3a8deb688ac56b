#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "flight/plan.hpp"
#include "map/map.hpp"
#include "verification/findings.hpp"
#include "verification/path_pieces.hpp"
#include "verification/verifier.hpp"

namespace hedgehop::verification {

/// What a metre of path costs, as the config of a plan says; read without the planners' code.
struct CostRules {
  double visibility = 0.0;                 // c_vis [-]
  double visibility_per_height_1pm = 0.0;  // c_vis,h
  double semantics = 0.0;                  // c_sem [-]
  double height_1pm = 0.0;                 // c_height
  // Beyond eq. (1), 0 in configs that do not know of them
  double soft_ceiling_m = 0.0;
  double soft_ceiling_1pm = 0.0;
  double threats = 0.0;
  double wire_crossing_m = 0.0;
  double slope_along = 0.0;
  double reference_height_m = 0.0;
  double unknown_visibility = 0.0;
  double small_patch_m = 0.0;
  double lateral_margin_m = 0.0;  // around start and goal, whose altitude may follow from it
  struct Rule {
    std::uint16_t all_of = 0;
    double cost = 0.0;
  };
  std::vector<Rule> rules;
  double otherwise = 0.0;
  double soft_area = 0.0;
};
/// Throws ConfigError.
CostRules read_cost_rules(const std::string& config_text, const std::string& name);

/// What a route costs, term by term, and by how much sums in steps of a metre scatter about them.
struct RouteSum {
  flight::RouteCost cost;
  flight::RouteCost deviation;  // standard deviation of each term
};

/// Sums over paths, from the map alone.
class PathSums {
 public:
  /// Keeps references to both.
  PathSums(const map::Map& map, const CostRules& rules);

  /// Along straight legs: each leg is cut at the edges of the cells and into pieces of at most 0.5
  /// m, over which the integrand is summed by Simpson's rule.
  ///
  /// Planners sum in steps of h = 1 m. At an edge where the integrand jumps by j, that misses up to
  /// h j / 2, evenly distributed: a variance of (h j)^2 / 12 for each edge.
  ///
  /// Each span of each overhead line is tried with each leg.
  RouteSum route_cost(const std::vector<flight::Waypoint>& waypoints);

  /// The measures of a flight, by the trapezoidal rule between its states.
  flight::PathMeasures measures(const flight::Trajectory& trajectory, double ceiling_height_m);

  /// Visibility of a cell as planners see it: a dark patch stays only where a straight row of
  /// cells, as long as `small_patch_m`, is as dark.
  double seen_by_planners(std::size_t band, raster::CellIndex cell);

 private:
  struct Band {
    double height_m = 0.0;
    const raster::Grid<std::uint16_t>* share = nullptr;
    std::vector<float> without_patches;  // NaN: not asked for yet
  };

  double share_of(const Band& band, raster::CellIndex cell) const;
  double seen(const geo::MapPoint& point, double height_m, bool is_by_planners);
  double semantics(const geo::MapPoint& point, double altitude_m) const;
  double threats(raster::CellIndex cell, double height_m) const;
  // Square of the hillside's slope in a direction, a unit vector.
  double square_of_slope(raster::CellIndex cell, double east, double north);
  double wire_crossings(const geo::MapPoint& a, const geo::MapPoint& b) const;

  const map::Map& map_;
  const CostRules& rules_;
  std::vector<Band> bands_;  // ascending
  std::vector<std::pair<const map::Area*, Box>> soft_areas_;
  raster::CellIndex slope_cell_{-1, -1};  // of the last slope
  std::array<double, 2> slope_{};
};

/// Compares what plan.json says with what follows from its route, its trajectory, its request and
/// the map. A rule is the path of the field: `route.cost.visibility_m`, `measures.length_m`,
/// `verification.clearance_min_m`, ...; besides, `request.start` and `request.goal` (the ends of
/// the route are the places asked for), `request.start_heading_true_rad` (as flown),
/// `route.waypoints` (the route begins and ends there), `route.lower_bound_m` (no more than the
/// route costs; what it is cannot be said from here), and of a timetable its places, the time to
/// the goal and `timetable.via` (how far from a via point the flight is when it should be there).
///
/// Tolerances: costs eight standard deviations (see PathSums::route_cost()), 1e-4 of their value
/// and 0.1 m, which together come to 0.2 % in most plans; measures 1e-5 of the value and 1 mm;
/// shares and angles 1e-6; altitudes and places of the ends 1 cm.
/// @param verdict  of the same plan, found here
void check_figures(const map::Map& map, const flight::Plan& plan, const CostRules& rules,
                   const std::vector<geo::MapPoint>& via, const Demands& demands,
                   const flight::Verdict& verdict, Findings& findings);

}  // namespace hedgehop::verification
