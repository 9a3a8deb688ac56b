#pragma once

#include "flight/wind.hpp"

namespace hedgehop::global_planning {

/// Least radius over the ground of a turn with constant bank, in wind.
///
/// Where the course has the component u along the wind,
///
///     R = R_0 V_g^2 / (V S),   S = sqrt(V^2 - w^2 + u^2),   V_g = u + S
///
/// R_0 is the radius in still air, V the airspeed, w the wind; S / V is the cosine of the angle
/// between heading and course. R grows with u, so that of a turn counts where it comes nearest to
/// flying with the wind.
class TurnLimit {
 public:
  TurnLimit() = default;
  /// @param radius_m  in still air; 0: no limit
  TurnLimit(double radius_m, const flight::Wind& wind, double airspeed_mps);

  /// Of the turn, by the shorter way, between two courses with vectors of any length but 0.
  [[nodiscard]] double radius_m(double first_x, double first_y, double second_x,
                                double second_y) const {
    return wind_.is_calm() ? radius_m_ : radius_in_wind_m(first_x, first_y, second_x, second_y);
  }
  /// No turn is tighter, none needs more.
  [[nodiscard]] double least_m() const { return least_m_; }
  [[nodiscard]] double greatest_m() const { return greatest_m_; }

 private:
  [[nodiscard]] double radius_in_wind_m(double first_x, double first_y, double second_x,
                                        double second_y) const;
  [[nodiscard]] double radius_along_m(double along_mps) const;

  double radius_m_ = 0.0;
  flight::Wind wind_;
  double airspeed_mps_ = 0.0;
  double least_m_ = 0.0;
  double greatest_m_ = 0.0;
};

}  // namespace hedgehop::global_planning
