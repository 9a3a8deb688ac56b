#include "flight/route.hpp"

#include <cmath>

namespace hedgehop::flight {

void add(RouteCost& sum, const RouteCost& cost, double factor) {
  for (const CostTerm& term : kCostTerms) {
    sum.*term.value_m += factor * cost.*term.value_m;
  }
}

double length_m(const std::vector<Waypoint>& waypoints) {
  double sum_m = 0.0;
  for (std::size_t i = 1; i < waypoints.size(); ++i) {
    const double dx_m = waypoints[i].x_m - waypoints[i - 1].x_m;
    const double dy_m = waypoints[i].y_m - waypoints[i - 1].y_m;
    const double dz_m = waypoints[i].altitude_m - waypoints[i - 1].altitude_m;
    sum_m += std::sqrt(dx_m * dx_m + dy_m * dy_m + dz_m * dz_m);
  }
  return sum_m;
}

}  // namespace hedgehop::flight
