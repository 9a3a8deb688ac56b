#pragma once

#include "base/config_reader.hpp"
#include "command_model/command_model.hpp"

namespace hedgehop::command_model {

/// A single main rotor and what it drives; the file config/rotor_plant.yaml.
struct RotorParameters {
  double mass_kg = 0.0;
  double rotor_radius_m = 0.0;
  double solidity = 0.0;              // blade area over disc area
  double tip_speed_mps = 0.0;         // held by the governor
  double profile_drag = 0.0;          // mean coefficient of the blades, c_d0
  double profile_advance = 0.0;       // growth with the square of the advance ratio
  double lift_slope_1prad = 0.0;      // of the blades, a_0
  double induced_factor = 0.0;        // kappa: induced power over that of a uniform inflow
  double flat_plate_m2 = 0.0;         // of the parasite drag
  double power_available_w = 0.0;     // of the engines, continuous
  double power_share_of_rotor = 0.0;  // after tail rotor, gears and accessories
  double thrust_lag_s = 0.0;          // from the collective to the thrust
  double thrust_rate_max_nps = 0.0;   // of the collective
  double attitude_frequency_radps = 0.0;
  double attitude_damping = 0.0;
  double bank_max_rad = 0.0;
  double roll_rate_max_radps = 0.0;
  double tilt_max_rad = 0.0;  // fore and aft
  double pitch_rate_max_radps = 0.0;
  double speed_gain_1ps = 0.0;  // controllers that follow a Command
  double speed_integral_gain_1ps2 = 0.0;
  double acceleration_max_mps2 = 0.0;  // that the speed controller asks for
  double heading_gain_1ps = 0.0;
  double heading_rate_damping = 0.0;
  double climb_gain_1ps = 0.0;
  double climb_integral_gain_1ps2 = 0.0;
};
RotorParameters read_rotor_parameters(ConfigReader& reader);

/// What a rotor needs; the sum is what it takes from the gears.
struct RotorPower {
  double induced_w = 0.0;
  double profile_w = 0.0;
  double parasite_w = 0.0;  // airframe drag times airspeed
  double climb_w = 0.0;     // the rest of what the thrust does to the aircraft: climb, acceleration
  [[nodiscard]] double total_w() const { return induced_w + profile_w + parasite_w + climb_w; }
};

/// Induced velocity of momentum theory [m/s]: v T = 2 rho A sqrt(u^2 + (w + v)^2) v.
///
/// @param in_plane_mps  u, air along the disc
/// @param axial_mps     w, of the disc along its thrust; descents steeper than half the hover's
///                      induced velocity, where the theory ends, are taken at that
double induced_velocity_mps(double thrust_n, double disc_area_m2, double density_kgpm3,
                            double in_plane_mps, double axial_mps);

using flight::Wind;

struct RotorState {
  double x_m = 0.0;
  double y_m = 0.0;
  double altitude_m = 0.0;
  double east_mps = 0.0;  // over ground
  double north_mps = 0.0;
  double climb_rate_mps = 0.0;
  double heading_math_rad = 0.0;  // of the airspeed: flight is coordinated
  double bank_left_rad = 0.0;
  double roll_rate_left_radps = 0.0;
  double tilt_rad = 0.0;  // of the thrust, forward positive
  double tilt_rate_radps = 0.0;
  double thrust_n = 0.0;
  double collective_n = 0.0;         // what the thrust follows
  double speed_integral_mps2 = 0.0;  // integrators of the controllers
  double climb_integral_mps2 = 0.0;
  double power_w = 0.0;           // of the rotor, at the end of the step
  bool is_power_limited = false;  // the collective was held back
};

/// A helicopter as a point mass under a rotor whose power is reckoned: induced, profile, parasite.
/// It knows nothing of CommandModel, and is to CommandModel what a flight is to its plan.
///
///     m dv/dt = T n - rho f |va| va / 2 - m g up,    va = v - wind
///     P = kappa T v_i + (sigma c_d0 / 8) rho A V_tip^3 (1 + k mu^2) + T (va . n)
///
/// In air that rises by w_g, v_a is that much less upwards, and the blades lift more than the
/// collective asked for, by blade elements with the momentum theory of forward flight:
///
///     dT = rho sigma A V_tip a_0 2 mu / (8 mu + a_0 sigma) w_g
///
/// n tilts forward by `tilt_rad` and sideways by the bank; f: flat plate, mu: advance ratio. The
/// last term holds parasite and climb power. Thrust follows the collective with a lag, and the
/// collective has a rate; it is held where P would exceed power_available_w power_share_of_rotor,
/// so that the helicopter sinks or slows down instead. Roll and tilt are second-order, with rate
/// limits.
///
/// Controllers turn a Command into bank, tilt and collective: turn rate by k_chi and damping as
/// CommandModel does, speed and climb rate by PI, with the weight, the bank and the drag of its own
/// airspeed fed forward. Command::heading_math_rad and speed_mps are those of the air.
class RotorPlant {
 public:
  explicit RotorPlant(const RotorParameters& parameters);

  /// Level, straight, unaccelerated flight in this wind, integrators settled.
  [[nodiscard]] RotorState trimmed(double x_m, double y_m, double altitude_m, double airspeed_mps,
                                   double heading_math_rad, double climb_rate_mps,
                                   const Wind& wind) const;

  /// @param step_s       in (0, 0.2]; stepped in parts of at most 10 ms
  /// @param updraft_mps  w_g
  [[nodiscard]] RotorState step(const RotorState& state, const Command& command, const Wind& wind,
                                double step_s, double updraft_mps = 0.0) const;

  [[nodiscard]] RotorPower power(const RotorState& state, const Wind& wind,
                                 double updraft_mps = 0.0) const;
  [[nodiscard]] double power_max_w() const {
    return parameters_.power_available_w * parameters_.power_share_of_rotor;
  }
  [[nodiscard]] const RotorParameters& parameters() const { return parameters_; }
  [[nodiscard]] double disc_area_m2() const;

 private:
  [[nodiscard]] RotorState part(const RotorState& state, const Command& command, const Wind& wind,
                                double step_s, double updraft_mps) const;

  RotorParameters parameters_;
};

}  // namespace hedgehop::command_model
