#pragma once

namespace hedgehop::flight {

/// Air over the ground, steady and the same everywhere, horizontal [m/s].
struct Wind {
  double east_mps = 0.0;  // grid east, towards
  double north_mps = 0.0;

  [[nodiscard]] bool is_calm() const { return east_mps == 0.0 && north_mps == 0.0; }
  [[nodiscard]] double speed_mps() const;
  bool operator==(const Wind&) const = default;
};

/// A wind of so many m/s that comes from a true azimuth, in the grid of a place with this
/// convergence (true azimuth of grid north).
Wind wind_from(double speed_mps, double from_true_rad, double convergence_rad);

/// Winds of more than this share of the airspeed are not planned for: at half of it a vehicle crabs
/// by up to 30 degrees and is three times as fast over the ground with the wind as against it.
inline constexpr double kWindShareMax = 0.5;

/// Speed and direction of a horizontal velocity; counter-clockwise from grid east.
struct Motion {
  double speed_mps = 0.0;
  double direction_math_rad = 0.0;
};

/// The wind triangle: velocity over ground = velocity through the air + wind. All angles are
/// counter-clockwise from grid east. Without wind each of these returns what it is given, to the
/// last bit.
///
/// Along a course with the unit vector c, w the wind, V the airspeed:
///
///     V_g = w . c + sqrt(V^2 - (c x w)^2),   heading = course - asin((c x w) / V)
///
/// Both need |w| < V.
double ground_speed_mps(const Wind& wind, double airspeed_mps, double course_cosine,
                        double course_sine);
double heading_for_course_rad(const Wind& wind, double airspeed_mps, double course_math_rad);
/// Speed over ground and course of an airspeed and a heading.
Motion over_ground(const Wind& wind, const Motion& through_air);
/// Airspeed and heading of a speed over ground and a course.
Motion through_air(const Wind& wind, const Motion& over_ground);

}  // namespace hedgehop::flight
