#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "flight/wind.hpp"

namespace hedgehop::global_planning {

/// How steeply a straight leg may climb and sink, as tangents, by the altitude of its highest
/// point. Neither grows with that altitude, so what holds there holds for the whole leg. A negative
/// tangent is a climb that must be a sink.
///
/// In wind the tangents are those through still air. Over the ground a leg keeps the same rates, so
/// its tangents are those times airspeed / ground speed in its direction.
class SlopeLimits {
 public:
  struct Tangents {
    double up = 0.0;
    double down = 0.0;
  };

  /// The same at all altitudes.
  SlopeLimits(double up, double down) : in_air_{up, down}, greatest_{up, down} {}
  /// At most these, and at most what `at` says of each altitude from -500 m to 9000 m, 25 m apart,
  /// or of a lower one; straight lines between them, the last one beyond.
  SlopeLimits(double up, double down, const std::function<Tangents(double altitude_m)>& at);

  /// The same for flights at this airspeed, which must be greater than the wind.
  [[nodiscard]] SlopeLimits in_wind(const flight::Wind& wind, double airspeed_mps) const;

  /// Over the ground of a leg that is flown towards (dx, dy) of any length; with the wind if 0.
  [[nodiscard]] Tangents at(double altitude_m, double dx_m, double dy_m) const {
    const Tangents in_air = table_ == nullptr ? in_air_ : interpolated(altitude_m);
    if (wind_.is_calm()) {
      return in_air;
    }
    const double share = factor(dx_m, dy_m);
    return {in_air.up * share, in_air.down * share};
  }
  /// No leg at this altitude or above may climb or sink more steeply, in whatever direction.
  [[nodiscard]] Tangents at_most(double altitude_m) const {
    const Tangents in_air = table_ == nullptr ? in_air_ : interpolated(altitude_m);
    return wind_.is_calm() ? in_air : in_best_direction(in_air);
  }
  /// Whether each leg may be flown both ways or neither.
  [[nodiscard]] bool is_symmetric() const {
    return table_ == nullptr && in_air_.up == in_air_.down && wind_.is_calm();
  }
  /// Whether it depends on altitude.
  [[nodiscard]] bool has_table() const { return table_ != nullptr; }
  [[nodiscard]] const flight::Wind& wind() const { return wind_; }
  /// Not below any other, whatever altitude and direction.
  [[nodiscard]] const Tangents& greatest() const { return greatest_; }

 private:
  [[nodiscard]] Tangents interpolated(double altitude_m) const;
  /// Airspeed over ground speed.
  [[nodiscard]] double factor(double dx_m, double dy_m) const;
  [[nodiscard]] Tangents in_best_direction(const Tangents& in_air) const;

  Tangents in_air_;  // at the lowest altitude
  Tangents greatest_;
  flight::Wind wind_;
  double airspeed_mps_ = 0.0;
  std::shared_ptr<const std::vector<Tangents>> table_;  // null: in_air_
};

}  // namespace hedgehop::global_planning
