#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "flight/route.hpp"

namespace hedgehop::local_planning {

/// A polyline to follow, measured by horizontal distance from its start.
class Guide {
 public:
  /// Points nearer than 1 mm (horizontally) to the one before are merged with it, the higher
  /// altitude wins. @throws std::invalid_argument unless two different places remain and all are
  /// finite.
  explicit Guide(const std::vector<flight::Waypoint>& waypoints);

  [[nodiscard]] double length_m() const { return along_m_.back(); }
  [[nodiscard]] const flight::Waypoint& goal() const { return points_.back(); }
  /// Azimuth of the leg that holds the place `along_m`, counter-clockwise from east.
  [[nodiscard]] double heading_math_rad(double along_m) const;
  /// Slope of that leg, rise over horizontal run.
  [[nodiscard]] double slope(double along_m) const;
  /// Place and altitude at a distance from the start, held within the ends.
  [[nodiscard]] flight::Waypoint at(double along_m) const;

  /// Distance along the guide of its nearest place to `point`, looked for in [from_m, to_m] only: a
  /// guide that passes nearby twice does not make the flight jump from one leg to the other.
  [[nodiscard]] double project(const geo::MapPoint& point, double from_m, double to_m) const;
  /// The same, faster where the place at `guess_m`, in [from_m, to_m], is near to `point`.
  [[nodiscard]] double project(const geo::MapPoint& point, double from_m, double to_m,
                               double guess_m) const;

 private:
  struct Leg {
    double east;  // unit vector
    double north;
    double slope;
  };

  // What a few legs lie within.
  struct Box {
    double west_m;
    double south_m;
    double east_m;
    double north_m;
  };
  static constexpr std::size_t kLegsPerBox = 4;

  [[nodiscard]] std::size_t leg_at(double along_m) const;
  // Legs further away than `reach_m2` are passed over.
  [[nodiscard]] double project_within(const geo::MapPoint& point, double from_m, double to_m,
                                      double reach_m2) const;

  std::vector<flight::Waypoint> points_;
  std::vector<double> along_m_;
  std::vector<Leg> legs_;
  std::vector<Box> boxes_;
  std::vector<std::uint32_t> first_leg_;  // at the start of each of many equal parts
  double parts_per_m_ = 0.0;
};

}  // namespace hedgehop::local_planning
