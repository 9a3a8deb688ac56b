#include "verification/cylinder_distance.hpp"

#include <algorithm>
#include <cmath>

namespace hedgehop::verification {

double distance_to_cylinder_m(const PathPoint& from, const PathPoint& to,
                              const Cylinder& cylinder) {
  const double dx_m = to.x_m - from.x_m;
  const double dy_m = to.y_m - from.y_m;
  const double dz_m = to.altitude_m - from.altitude_m;
  const auto distance_m = [&](double t) {
    const double x_m = from.x_m + t * dx_m - cylinder.x_m;
    const double y_m = from.y_m + t * dy_m - cylinder.y_m;
    const double outside_m = std::max(std::sqrt(x_m * x_m + y_m * y_m) - cylinder.radius_m, 0.0);
    const double above_m = std::max(from.altitude_m + t * dz_m - cylinder.top_m, 0.0);
    return std::sqrt(outside_m * outside_m + above_m * above_m);
  };
  constexpr double kGolden = 0.6180339887498949;
  constexpr double kBracket_m = 1e-6;
  const double length_m = std::sqrt(dx_m * dx_m + dy_m * dy_m + dz_m * dz_m);
  double low = 0.0;
  double high = 1.0;
  double first = high - kGolden * (high - low);
  double second = low + kGolden * (high - low);
  double at_first_m = distance_m(first);
  double at_second_m = distance_m(second);
  double least_m = std::min({distance_m(0.0), distance_m(1.0), at_first_m, at_second_m});
  while ((high - low) * length_m > kBracket_m) {
    if (at_first_m <= at_second_m) {
      high = second;
      second = first;
      at_second_m = at_first_m;
      first = high - kGolden * (high - low);
      at_first_m = distance_m(first);
    } else {
      low = first;
      first = second;
      at_first_m = at_second_m;
      second = low + kGolden * (high - low);
      at_second_m = distance_m(second);
    }
    least_m = std::min({least_m, at_first_m, at_second_m});
  }
  // The distance changes by at most the length flown.
  return std::max(least_m - (high - low) * length_m, 0.0);
}

}  // namespace hedgehop::verification
