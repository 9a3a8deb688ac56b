#pragma once

#include <functional>
#include <memory>
#include <vector>

namespace hedgehop::global_planning {

/// How steeply a straight leg may climb and sink, as tangents, by the altitude of its highest
/// point. Neither grows with that altitude, so what holds there holds for the whole leg. A negative
/// tangent is a climb that must be a sink.
class SlopeLimits {
 public:
  struct Tangents {
    double up = 0.0;
    double down = 0.0;
  };

  /// The same at all altitudes.
  SlopeLimits(double up, double down) : at_any_{up, down} {}
  /// At most these, and at most what `at` says of each altitude from -500 m to 9000 m, 25 m apart,
  /// or of a lower one; straight lines between them, the last one beyond.
  SlopeLimits(double up, double down, const std::function<Tangents(double altitude_m)>& at);

  [[nodiscard]] Tangents at(double altitude_m) const {
    return table_ == nullptr ? at_any_ : interpolated(altitude_m);
  }
  /// Whether each leg may be flown both ways or neither.
  [[nodiscard]] bool is_symmetric() const {
    return table_ == nullptr && at_any_.up == at_any_.down;
  }
  /// Not below any other.
  [[nodiscard]] const Tangents& greatest() const { return at_any_; }

 private:
  [[nodiscard]] Tangents interpolated(double altitude_m) const;

  Tangents at_any_;
  std::shared_ptr<const std::vector<Tangents>> table_;  // null: at_any_
};

}  // namespace hedgehop::global_planning
