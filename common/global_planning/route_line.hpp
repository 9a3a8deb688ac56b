#pragma once

#include <limits>
#include <vector>

#include "flight/route.hpp"
#include "geo/map_projection.hpp"

namespace hedgehop::global_planning {

/// A polyline of at least two points that is asked for places by their distance along it, all seen
/// from above [m].
class RouteLine {
 public:
  explicit RouteLine(std::vector<flight::Waypoint> points);

  [[nodiscard]] const std::vector<flight::Waypoint>& points() const { return points_; }
  /// Of each of points().
  [[nodiscard]] const std::vector<double>& along_m() const { return along_m_; }
  [[nodiscard]] double length_m() const { return along_m_.back(); }

  /// The place so far along, altitude interpolated; the nearer end for what lies beyond.
  [[nodiscard]] flight::Waypoint at(double along_m) const;

  /// From one place to another, corners between them included.
  [[nodiscard]] std::vector<flight::Waypoint> part(double from_m, double to_m) const;

  struct Nearest {
    double along_m = 0.0;
    double distance_m = std::numeric_limits<double>::infinity();
  };
  /// The place of the line that is nearest to a point; the first one of several.
  [[nodiscard]] Nearest nearest(const geo::MapPoint& point) const;

 private:
  std::vector<flight::Waypoint> points_;
  std::vector<double> along_m_;
};

/// The waypoints at which a route turns, seen from above, and its ends: those on a straight run
/// change the climb alone.
std::vector<flight::Waypoint> corners_of(const std::vector<flight::Waypoint>& route);

/// Distance in plan view [m].
double plan_distance_m(const geo::MapPoint& a, const geo::MapPoint& b);

}  // namespace hedgehop::global_planning
