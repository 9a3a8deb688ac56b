#include "global_planning/turn_limit.hpp"

#include <algorithm>
#include <cmath>

namespace hedgehop::global_planning {

TurnLimit::TurnLimit(double radius_m, const flight::Wind& wind, double airspeed_mps)
    : radius_m_(radius_m),
      wind_(wind),
      airspeed_mps_(airspeed_mps),
      least_m_(radius_m),
      greatest_m_(radius_m) {
  if (!wind.is_calm()) {
    least_m_ = radius_along_m(-wind.speed_mps());
    greatest_m_ = radius_along_m(wind.speed_mps());
  }
}

double TurnLimit::radius_along_m(double along_mps) const {
  const double wind_mps = wind_.speed_mps();
  const double through_mps =
      std::sqrt(airspeed_mps_ * airspeed_mps_ - wind_mps * wind_mps + along_mps * along_mps);
  const double ground_mps = along_mps + through_mps;
  return radius_m_ * ground_mps * ground_mps / (airspeed_mps_ * through_mps);
}

double TurnLimit::radius_in_wind_m(double first_x, double first_y, double second_x,
                                   double second_y) const {
  const double wx = wind_.east_mps;
  const double wy = wind_.north_mps;
  const double turn = first_x * second_y - first_y * second_x;
  const double from_first = first_x * wy - first_y * wx;
  const double to_second = wx * second_y - wy * second_x;
  const double first = std::sqrt(first_x * first_x + first_y * first_y);
  const double second = std::sqrt(second_x * second_x + second_y * second_y);
  const double along_first = (first_x * wx + first_y * wy) / first;
  const double along_second = (second_x * wx + second_y * wy) / second;
  // The turn passes the direction of the wind where that lies between both courses.
  const bool is_left = turn >= 0.0 && from_first >= 0.0 && to_second >= 0.0;
  const bool is_right = turn <= 0.0 && from_first <= 0.0 && to_second <= 0.0;
  if ((is_left || is_right) && along_first + along_second > 0.0) {
    return greatest_m_;
  }
  return radius_along_m(std::max(along_first, along_second));
}

}  // namespace hedgehop::global_planning
