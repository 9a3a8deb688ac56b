#include "local_planning/guide.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "base/elementary.hpp"

namespace hedgehop::local_planning {

Guide::Guide(const std::vector<flight::Waypoint>& waypoints) {
  for (const flight::Waypoint& waypoint : waypoints) {
    if (!std::isfinite(waypoint.x_m) || !std::isfinite(waypoint.y_m) ||
        !std::isfinite(waypoint.altitude_m)) {
      throw std::invalid_argument("a guide's waypoints must be finite");
    }
    if (points_.empty()) {
      points_.push_back(waypoint);
      along_m_.push_back(0.0);
      continue;
    }
    const double dx_m = waypoint.x_m - points_.back().x_m;
    const double dy_m = waypoint.y_m - points_.back().y_m;
    const double step_m = std::sqrt(dx_m * dx_m + dy_m * dy_m);
    if (step_m < 1e-3) {
      points_.back().altitude_m = std::max(points_.back().altitude_m, waypoint.altitude_m);
      continue;
    }
    points_.push_back(waypoint);
    along_m_.push_back(along_m_.back() + step_m);
  }
  if (points_.size() < 2) {
    throw std::invalid_argument("a guide needs two different places");
  }
  for (std::size_t leg = 0; leg + 1 < points_.size(); ++leg) {
    const flight::Waypoint& a = points_[leg];
    const flight::Waypoint& b = points_[leg + 1];
    const double leg_m = along_m_[leg + 1] - along_m_[leg];
    legs_.push_back(
        {(b.x_m - a.x_m) / leg_m, (b.y_m - a.y_m) / leg_m, (b.altitude_m - a.altitude_m) / leg_m});
  }
  for (std::size_t first = 0; first < legs_.size(); first += kLegsPerBox) {
    const std::size_t last = std::min(first + kLegsPerBox, legs_.size());
    Box box{points_[first].x_m, points_[first].y_m, points_[first].x_m, points_[first].y_m};
    for (std::size_t i = first + 1; i <= last; ++i) {
      box = {std::min(box.west_m, points_[i].x_m), std::min(box.south_m, points_[i].y_m),
             std::max(box.east_m, points_[i].x_m), std::max(box.north_m, points_[i].y_m)};
    }
    boxes_.push_back(box);
  }
  const std::size_t parts = 2 * legs_.size();
  parts_per_m_ = static_cast<double>(parts) / length_m();
  std::size_t leg = 0;
  for (std::size_t part = 0; part < parts; ++part) {
    while (leg + 1 < legs_.size() &&
           along_m_[leg + 1] * parts_per_m_ <= static_cast<double>(part)) {
      ++leg;
    }
    // One earlier: leg_at() rounds differently.
    first_leg_.push_back(static_cast<std::uint32_t>(leg > 0 ? leg - 1 : 0));
  }
}

std::size_t Guide::leg_at(double along_m) const {
  const double part = std::max(0.0, along_m * parts_per_m_);
  std::size_t leg = first_leg_[std::min(static_cast<std::size_t>(part), first_leg_.size() - 1)];
  while (leg + 1 < legs_.size() && along_m_[leg + 1] <= along_m) {
    ++leg;
  }
  return leg;
}

double Guide::heading_math_rad(double along_m) const {
  const std::size_t leg = leg_at(along_m);
  return elementary::atan2(points_[leg + 1].y_m - points_[leg].y_m,
                           points_[leg + 1].x_m - points_[leg].x_m);
}

double Guide::slope(double along_m) const { return legs_[leg_at(along_m)].slope; }

flight::Waypoint Guide::at(double along_m) const {
  const std::size_t leg = leg_at(along_m);
  const flight::Waypoint& a = points_[leg];
  const double on_leg_m = along_m - along_m_[leg];
  if (!(on_leg_m > 0.0)) {
    return a;
  }
  if (!(along_m < along_m_[leg + 1])) {
    return points_[leg + 1];
  }
  return {a.x_m + on_leg_m * legs_[leg].east, a.y_m + on_leg_m * legs_[leg].north,
          a.altitude_m + on_leg_m * legs_[leg].slope};
}

double Guide::project(const geo::MapPoint& point, double from_m, double to_m) const {
  return project_within(point, from_m, to_m, std::numeric_limits<double>::infinity());
}

double Guide::project(const geo::MapPoint& point, double from_m, double to_m,
                      double guess_m) const {
  const flight::Waypoint guess = at(guess_m);
  const double dx_m = guess.x_m - point.x_m;
  const double dy_m = guess.y_m - point.y_m;
  // A little more than that: no leg is lost to rounding.
  return project_within(point, from_m, to_m, 1.000001 * (dx_m * dx_m + dy_m * dy_m) + 1e-3);
}

double Guide::project_within(const geo::MapPoint& point, double from_m, double to_m,
                             double reach_m2) const {
  from_m = std::clamp(from_m, 0.0, length_m());
  to_m = std::clamp(to_m, from_m, length_m());
  double best_m2 = std::numeric_limits<double>::infinity();
  double best_along_m = from_m;
  for (std::size_t leg = leg_at(from_m); leg < legs_.size() && along_m_[leg] <= to_m; ++leg) {
    const Box& box = boxes_[leg / kLegsPerBox];
    const double aside_m = std::max(0.0, std::max(box.west_m - point.x_m, point.x_m - box.east_m));
    const double ahead_m =
        std::max(0.0, std::max(box.south_m - point.y_m, point.y_m - box.north_m));
    if (aside_m * aside_m + ahead_m * ahead_m > reach_m2) {
      leg |= kLegsPerBox - 1;
      continue;
    }
    const flight::Waypoint& a = points_[leg];
    const double leg_m = along_m_[leg + 1] - along_m_[leg];
    const double ux = legs_[leg].east;
    const double uy = legs_[leg].north;
    const double low_m = std::max(0.0, from_m - along_m_[leg]);
    const double high_m = std::min(leg_m, to_m - along_m_[leg]);
    const double on_leg_m =
        std::clamp((point.x_m - a.x_m) * ux + (point.y_m - a.y_m) * uy, low_m, high_m);
    const double dx_m = a.x_m + on_leg_m * ux - point.x_m;
    const double dy_m = a.y_m + on_leg_m * uy - point.y_m;
    const double distance_m2 = dx_m * dx_m + dy_m * dy_m;
    if (distance_m2 < best_m2) {
      best_m2 = distance_m2;
      best_along_m = along_m_[leg] + on_leg_m;
    }
  }
  return best_along_m;
}

}  // namespace hedgehop::local_planning
