#include "global_planning/route_line.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace hedgehop::global_planning {
namespace {

// Turns below this are straight: it moves the end of a leg of 10 km by a millimetre.
constexpr double kStraight_rad = 1e-7;
constexpr double kSamePlace_m = 1.0;  // corners so near to the ends of a part are left out

bool is_straight(const flight::Waypoint& a, const flight::Waypoint& b, const flight::Waypoint& c) {
  const double first_x_m = b.x_m - a.x_m;
  const double first_y_m = b.y_m - a.y_m;
  const double second_x_m = c.x_m - b.x_m;
  const double second_y_m = c.y_m - b.y_m;
  const double along = first_x_m * second_x_m + first_y_m * second_y_m;
  return along > 0.0 &&
         std::fabs(first_x_m * second_y_m - first_y_m * second_x_m) <= kStraight_rad * along;
}

}  // namespace

std::vector<flight::Waypoint> corners_of(const std::vector<flight::Waypoint>& route) {
  std::vector<flight::Waypoint> corners;
  for (const flight::Waypoint& waypoint : route) {
    while (corners.size() >= 2 &&
           is_straight(corners[corners.size() - 2], corners.back(), waypoint)) {
      corners.pop_back();
    }
    corners.push_back(waypoint);
  }
  return corners;
}

double plan_distance_m(const geo::MapPoint& a, const geo::MapPoint& b) {
  const double dx_m = b.x_m - a.x_m;
  const double dy_m = b.y_m - a.y_m;
  return std::sqrt(dx_m * dx_m + dy_m * dy_m);
}

RouteLine::RouteLine(std::vector<flight::Waypoint> points)
    : points_(std::move(points)), along_m_{0.0} {
  for (std::size_t i = 1; i < points_.size(); ++i) {
    along_m_.push_back(along_m_.back() +
                       plan_distance_m(points_[i - 1].point(), points_[i].point()));
  }
}

flight::Waypoint RouteLine::at(double along_m) const {
  const auto after = std::lower_bound(along_m_.begin() + 1, along_m_.end() - 1, along_m);
  const auto leg = static_cast<std::size_t>(after - along_m_.begin());
  const double leg_m = along_m_[leg] - along_m_[leg - 1];
  const double t = leg_m > 0.0 ? std::clamp((along_m - along_m_[leg - 1]) / leg_m, 0.0, 1.0) : 0.0;
  const flight::Waypoint& a = points_[leg - 1];
  const flight::Waypoint& b = points_[leg];
  if (t >= 1.0) {
    return b;  // to the last bit
  }
  return {a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m),
          a.altitude_m + t * (b.altitude_m - a.altitude_m)};
}

std::vector<flight::Waypoint> RouteLine::part(double from_m, double to_m) const {
  std::vector<flight::Waypoint> part = {at(from_m)};
  for (std::size_t i = 0; i < points_.size(); ++i) {
    if (along_m_[i] > from_m + kSamePlace_m && along_m_[i] < to_m - kSamePlace_m) {
      part.push_back(points_[i]);
    }
  }
  part.push_back(at(to_m));
  return part;
}

RouteLine::Nearest RouteLine::nearest(const geo::MapPoint& point) const {
  Nearest nearest;
  for (std::size_t i = 1; i < points_.size(); ++i) {
    const flight::Waypoint& a = points_[i - 1];
    const double dx_m = points_[i].x_m - a.x_m;
    const double dy_m = points_[i].y_m - a.y_m;
    const double square_m2 = dx_m * dx_m + dy_m * dy_m;
    const double t =
        square_m2 > 0.0
            ? std::clamp(((point.x_m - a.x_m) * dx_m + (point.y_m - a.y_m) * dy_m) / square_m2, 0.0,
                         1.0)
            : 0.0;
    const double distance_m = plan_distance_m(point, {a.x_m + t * dx_m, a.y_m + t * dy_m});
    if (distance_m < nearest.distance_m) {
      nearest = {along_m_[i - 1] + t * std::sqrt(square_m2), distance_m};
    }
  }
  return nearest;
}

}  // namespace hedgehop::global_planning
