#pragma once

#include "base/angles.hpp"

namespace hedgehop::local_planning {

/// Constants of a target indicator, see Indicator.
struct IndicatorOptions {
  double inertia = 0.0;               // I [-]
  double spring_1ps2 = 0.0;           // C, towards the target
  double damping_1ps = 0.0;           // D
  double relative_damping_1ps = 0.0;  // D_chi, of the rate relative to the vehicle's
  double relative_spring_1ps2 = 0.0;  // C_chi, back towards the vehicle
};

/// The target that the controllers are given: a mass on a torsional spring that follows what the
/// histogram chose without its steps.
///
///     I a'' = C wrap(a_t - a) - D a' - D_chi (a' - chi') - C_chi wrap(a - chi)            (7)
///
/// a indicator, a_t target, chi the vehicle's own angle. The last term pulls back to the vehicle:
/// with the opposite sign the indicator runs away from it.
struct Indicator {
  double angle_rad = 0.0;
  double rate_radps = 0.0;

  /// One step towards a target; damping is taken implicitly, so that any step is stable.
  void step(double target_rad, double vehicle_rad, double vehicle_rate_radps,
            const IndicatorOptions& options, double step_s) {
    turn(options.spring_1ps2 * wrap_to_pi(target_rad - angle_rad), vehicle_rad, vehicle_rate_radps,
         options, step_s);
  }

  /// The same with another torque [rad/s^2] in place of the target's.
  void turn(double torque_radps2, double vehicle_rad, double vehicle_rate_radps,
            const IndicatorOptions& options, double step_s) {
    const double torque = torque_radps2 + options.relative_damping_1ps * vehicle_rate_radps -
                          options.relative_spring_1ps2 * wrap_to_pi(angle_rad - vehicle_rad);
    const double share_s = step_s / options.inertia;
    rate_radps = (rate_radps + share_s * torque) /
                 (1.0 + share_s * (options.damping_1ps + options.relative_damping_1ps));
    angle_rad = wrap_to_pi(angle_rad + step_s * rate_radps);
  }

  /// Back to the vehicle's own angle, at rest.
  void reset(double vehicle_rad) {
    angle_rad = vehicle_rad;
    rate_radps = 0.0;
  }
};

}  // namespace hedgehop::local_planning
