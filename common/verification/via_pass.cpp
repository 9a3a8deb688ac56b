#include "verification/via_pass.hpp"

#include <algorithm>
#include <limits>

#include "verification/path_pieces.hpp"

namespace hedgehop::verification {

Pass first_pass(const std::vector<flight::FlightState>& states, std::size_t begin,
                const geo::MapPoint& point, double radius_m) {
  Pass nearest{begin, begin, std::numeric_limits<double>::quiet_NaN()};
  for (std::size_t i = begin; i + 1 < states.size(); ++i) {
    if (!is_finite(states[i]) || !is_finite(states[i + 1])) {
      continue;
    }
    const double dx_m = states[i + 1].x_m - states[i].x_m;
    const double dy_m = states[i + 1].y_m - states[i].y_m;
    const double square_m2 = dx_m * dx_m + dy_m * dy_m;
    const double along_m2 = (point.x_m - states[i].x_m) * dx_m + (point.y_m - states[i].y_m) * dy_m;
    const double t = square_m2 > 0.0 ? std::clamp(along_m2 / square_m2, 0.0, 1.0) : 0.0;
    const double here_m = distance_m({states[i].x_m + t * dx_m, states[i].y_m + t * dy_m}, point);
    if (nearest.distance_m <= radius_m && here_m > radius_m) {
      break;  // out again
    }
    if (!(here_m >= nearest.distance_m)) {
      nearest = {nearest.distance_m <= radius_m ? nearest.entry : i, i, here_m};
    }
  }
  return nearest;
}

}  // namespace hedgehop::verification
