#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "geo/map_projection.hpp"

namespace hedgehop::flight {

/// A point in the map frame with altitude [m AMSL].
struct Waypoint {
  double x_m = 0.0;
  double y_m = 0.0;
  double altitude_m = 0.0;

  [[nodiscard]] geo::MapPoint point() const { return {x_m, y_m}; }
  bool operator==(const Waypoint&) const = default;
};

/// What a route costs [m], weights applied: the four terms of eq. (1), and those beyond it, which
/// are 0 unless the config gives them a weight.
struct RouteCost {
  double length_m = 0.0;
  double visibility_m = 0.0;
  double semantics_m = 0.0;
  double height_m = 0.0;
  double soft_ceiling_m = 0.0;    // above the soft ceiling
  double threats_m = 0.0;         // seen by named observers
  double wire_crossings_m = 0.0;  // away from poles
  double slope_m = 0.0;           // up and down hillsides

  [[nodiscard]] double total_m() const {
    return length_m + visibility_m + semantics_m + height_m + soft_ceiling_m + threats_m +
           wire_crossings_m + slope_m;
  }
  bool operator==(const RouteCost&) const = default;
};

/// A term of a cost, as files call it and as people do.
struct CostTerm {
  const char* name;
  const char* words;
  double RouteCost::*value_m;
};
/// All of them, those of eq. (1) first.
inline constexpr std::array<CostTerm, 8> kCostTerms = {
    {{"length_m", "length", &RouteCost::length_m},
     {"visibility_m", "visibility", &RouteCost::visibility_m},
     {"semantics_m", "land use", &RouteCost::semantics_m},
     {"height_m", "height", &RouteCost::height_m},
     {"soft_ceiling_m", "above the soft ceiling", &RouteCost::soft_ceiling_m},
     {"threats_m", "named observers", &RouteCost::threats_m},
     {"wire_crossings_m", "wires", &RouteCost::wire_crossings_m},
     {"slope_m", "slope", &RouteCost::slope_m}}};
inline constexpr std::size_t kPaperCostTerms = 4;  // of these are those of eq. (1)

/// Adds a cost, each term `factor` times.
void add(RouteCost& sum, const RouteCost& cost, double factor = 1.0);

/// What the global planner found: straight legs between waypoints.
struct Route {
  std::vector<Waypoint> waypoints;  // as planned, at least 2, start and goal included
  std::vector<Waypoint> guide;      // the same polyline at equal spacing, for the local planner
  double guide_spacing_m = 0.0;
  RouteCost cost;               // integrated at the final, fine step
  double lower_bound_m = 0.0;   // no route can cost less; 0 if none was computed
  std::int64_t work_units = 0;  // edge evaluations spent
  std::int64_t samples = 0;     // states drawn
  std::int64_t batches = 0;
};

/// Length along the legs [m].
double length_m(const std::vector<Waypoint>& waypoints);

}  // namespace hedgehop::flight
