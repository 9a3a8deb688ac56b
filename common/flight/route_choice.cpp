#include "flight/route_choice.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace hedgehop::flight {
namespace {

constexpr double kPiece_m = 10.0;

double square_to_m2(const geo::MapPoint& point, const std::vector<Waypoint>& route) {
  double least_m2 = std::numeric_limits<double>::infinity();
  for (std::size_t leg = 1; leg < route.size(); ++leg) {
    const Waypoint& a = route[leg - 1];
    const Waypoint& b = route[leg];
    const double dx_m = b.x_m - a.x_m;
    const double dy_m = b.y_m - a.y_m;
    const double square_m2 = dx_m * dx_m + dy_m * dy_m;
    const double along =
        square_m2 > 0.0
            ? std::clamp(((point.x_m - a.x_m) * dx_m + (point.y_m - a.y_m) * dy_m) / square_m2, 0.0,
                         1.0)
            : 0.0;
    const double off_x_m = point.x_m - (a.x_m + along * dx_m);
    const double off_y_m = point.y_m - (a.y_m + along * dy_m);
    least_m2 = std::min(least_m2, off_x_m * off_x_m + off_y_m * off_y_m);
  }
  return least_m2;
}

/// Calls visit(middle, length_m, is_shared) for pieces of the route, in its order.
template <typename Visit>
void for_each_piece(const std::vector<Waypoint>& route, const std::vector<Waypoint>& other,
                    double within_m, const Visit& visit) {
  for (std::size_t leg = 1; leg < route.size(); ++leg) {
    const Waypoint& a = route[leg - 1];
    const Waypoint& b = route[leg];
    const double dx_m = b.x_m - a.x_m;
    const double dy_m = b.y_m - a.y_m;
    const double leg_m = std::sqrt(dx_m * dx_m + dy_m * dy_m);
    const int pieces = std::max(1, static_cast<int>(std::ceil(leg_m / kPiece_m)));
    for (int k = 0; k < pieces; ++k) {
      const double t = (k + 0.5) / pieces;
      const geo::MapPoint middle{a.x_m + t * dx_m, a.y_m + t * dy_m};
      visit(middle, leg_m / pieces, square_to_m2(middle, other) <= within_m * within_m);
    }
  }
}

}  // namespace

double shared_share(const std::vector<Waypoint>& route, const std::vector<Waypoint>& other,
                    double within_m) {
  double all_m = 0.0;
  double shared_m = 0.0;
  for_each_piece(route, other, within_m, [&](const geo::MapPoint&, double piece_m, bool is_shared) {
    all_m += piece_m;
    shared_m += is_shared ? piece_m : 0.0;
  });
  return all_m > 0.0 ? shared_m / all_m : 0.0;
}

geo::MapPoint longest_shared_stretch(const std::vector<Waypoint>& route,
                                     const std::vector<Waypoint>& other, double within_m) {
  std::vector<geo::MapPoint> stretch;
  std::vector<geo::MapPoint> longest = {route.front().point()};
  double stretch_m = 0.0;
  double longest_m = 0.0;
  for_each_piece(route, other, within_m,
                 [&](const geo::MapPoint& middle, double piece_m, bool is_shared) {
                   if (!is_shared) {
                     stretch.clear();
                     stretch_m = 0.0;
                     return;
                   }
                   stretch.push_back(middle);
                   stretch_m += piece_m;
                   if (stretch_m > longest_m) {
                     longest_m = stretch_m;
                     longest = stretch;
                   }
                 });
  return longest[longest.size() / 2];
}

bool is_better_in_something(const RouteMeasures& route, const RouteMeasures& other, double gain) {
  const auto is_better = [gain](double value, double than) {
    return value < than && value <= (1.0 - gain) * than;
  };
  return is_better(route.length_m, other.length_m) ||
         is_better(route.visibility_m, other.visibility_m) ||
         is_better(route.semantics_m, other.semantics_m);
}

}  // namespace hedgehop::flight
