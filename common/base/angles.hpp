#pragma once

#include <cmath>
#include <numbers>

/// Angle conventions. The mathematics of planning uses angles counter-clockwise from +x (grid
/// east); everything public uses azimuths, clockwise from north. These functions are the only
/// border.
namespace hedgehop {

inline constexpr double kDegree_rad = std::numbers::pi / 180.0;
inline constexpr double kTwoPi = 2.0 * std::numbers::pi;
/// Standard gravity [m/s^2].
inline constexpr double kGravity_mps2 = 9.80665;

constexpr double radians_from_degrees(double angle_deg) { return angle_deg * kDegree_rad; }
constexpr double degrees_from_radians(double angle_rad) { return angle_rad / kDegree_rad; }

/// The same angle in [-pi, pi).
inline double wrap_to_pi(double angle_rad) {
  // Most angles: the same bits without a division.
  if (std::fabs(angle_rad) <= 3.0) {
    return angle_rad;
  }
  return angle_rad - kTwoPi * std::floor((angle_rad + std::numbers::pi) / kTwoPi);
}

/// The same angle in [0, 2 pi).
inline double wrap_to_two_pi(double angle_rad) {
  if (angle_rad > 0.0 && angle_rad <= 6.0) {
    return angle_rad;
  }
  const double wrapped = angle_rad - kTwoPi * std::floor(angle_rad / kTwoPi);
  return wrapped >= kTwoPi ? 0.0 : wrapped;
}

/// Counter-clockwise from grid east <-> azimuth, clockwise from grid north; its own inverse.
inline double azimuth_from_math_angle_rad(double angle_rad) {
  return wrap_to_two_pi(0.5 * std::numbers::pi - angle_rad);
}
inline double math_angle_from_azimuth_rad(double azimuth_rad) {
  return wrap_to_pi(0.5 * std::numbers::pi - azimuth_rad);
}

/// Grid azimuth <-> true azimuth. The convergence is the true azimuth of grid north.
inline double true_from_grid_azimuth_rad(double azimuth_grid_rad, double convergence_rad) {
  return wrap_to_two_pi(azimuth_grid_rad + convergence_rad);
}
inline double grid_from_true_azimuth_rad(double azimuth_true_rad, double convergence_rad) {
  return wrap_to_two_pi(azimuth_true_rad - convergence_rad);
}

}  // namespace hedgehop
