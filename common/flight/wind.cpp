#include "flight/wind.hpp"

#include <cmath>

#include "base/angles.hpp"
#include "base/elementary.hpp"

namespace hedgehop::flight {
namespace {

Motion sum(const Motion& a, double east_mps, double north_mps) {
  const elementary::SineCosine direction = elementary::sine_cosine(a.direction_math_rad);
  const double x_mps = a.speed_mps * direction.cosine + east_mps;
  const double y_mps = a.speed_mps * direction.sine + north_mps;
  return {std::sqrt(x_mps * x_mps + y_mps * y_mps), elementary::atan2(y_mps, x_mps)};
}

}  // namespace

double Wind::speed_mps() const { return std::sqrt(east_mps * east_mps + north_mps * north_mps); }

Wind wind_from(double speed_mps, double from_true_rad, double convergence_rad) {
  if (speed_mps == 0.0) {
    return {};
  }
  const elementary::SineCosine from =
      elementary::sine_cosine(grid_from_true_azimuth_rad(from_true_rad, convergence_rad));
  return {-speed_mps * from.sine, -speed_mps * from.cosine};
}

double ground_speed_mps(const Wind& wind, double airspeed_mps, double course_cosine,
                        double course_sine) {
  if (wind.is_calm()) {
    return airspeed_mps;
  }
  const double along_mps = wind.east_mps * course_cosine + wind.north_mps * course_sine;
  const double across_mps = wind.north_mps * course_cosine - wind.east_mps * course_sine;
  return along_mps + std::sqrt(airspeed_mps * airspeed_mps - across_mps * across_mps);
}

double heading_for_course_rad(const Wind& wind, double airspeed_mps, double course_math_rad) {
  if (wind.is_calm()) {
    return course_math_rad;
  }
  const elementary::SineCosine course = elementary::sine_cosine(course_math_rad);
  const double across_mps = wind.north_mps * course.cosine - wind.east_mps * course.sine;
  return wrap_to_pi(course_math_rad - elementary::asin(across_mps / airspeed_mps));
}

Motion over_ground(const Wind& wind, const Motion& through_air) {
  return wind.is_calm() ? through_air : sum(through_air, wind.east_mps, wind.north_mps);
}

Motion through_air(const Wind& wind, const Motion& over_ground) {
  return wind.is_calm() ? over_ground : sum(over_ground, -wind.east_mps, -wind.north_mps);
}

}  // namespace hedgehop::flight
