#pragma once

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

/// The four terms of eq. (1) [m], weights applied.
struct RouteCost {
  double length_m = 0.0;
  double visibility_m = 0.0;
  double semantics_m = 0.0;
  double height_m = 0.0;

  [[nodiscard]] double total_m() const { return length_m + visibility_m + semantics_m + height_m; }
  bool operator==(const RouteCost&) const = default;
};

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
