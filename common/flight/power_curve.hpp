#pragma once

#include "base/config_reader.hpp"
#include "flight/vehicle.hpp"
#include "flight/wind.hpp"

namespace hedgehop::flight {

/// Density of the international standard atmosphere [kg/m3], warmer by `isa_deviation_k` at the
/// same pressure.
double air_density_kgpm3(double altitude_m, double isa_deviation_k = 0.0);

/// What a helicopter needs to fly and what drives it; section `power` of a vehicle file.
struct PowerCurve {
  double mass_kg = 0.0;  // as usually flown
  double mass_max_kg = 0.0;
  double rotor_radius_m = 0.0;
  double solidity = 0.0;              // blade area over disc area
  double tip_speed_mps = 0.0;         // held by the governor
  double profile_drag = 0.0;          // mean coefficient of the blades, c_d0
  double profile_advance = 0.0;       // growth with the square of the advance ratio
  double induced_factor = 0.0;        // kappa: induced power over that of a uniform inflow
  double flat_plate_m2 = 0.0;         // of the parasite drag
  double gears_w = 0.0;               // what the gears carry, at any density
  double engines_w = 0.0;             // what the engines give at the density of sea level
  double engine_density_power = 0.0;  // their power goes with density to this
  double share_of_rotor = 0.0;        // after tail rotor, gears and accessories
  double vortex_speed_mps = 0.0;      // up to this airspeed the rotor may sink into its own wake
  double vortex_descent_mps = 0.0;    // descent rate that is safe all the same
  double vortex_descent_slope = 0.0;  // m/s more per m/s of airspeed beyond
};
PowerCurve read_power_curve(ConfigReader& reader);

/// Section `conditions` of the planning config: what the flight is made in.
struct Conditions {
  bool is_power_used = false;    // climbs and descents keep the vehicle's power curve
  double mass_kg = 0.0;          // 0: as the vehicle file says
  double isa_deviation_k = 0.0;  // of the air temperature
  double power_reserve = 0.0;    // share of the power available that is never planned with
  double wind_mps = 0.0;
  double wind_from_true_rad = 0.0;

  /// In the grid of a place with this convergence.
  [[nodiscard]] Wind wind(double convergence_rad) const {
    return wind_from(wind_mps, wind_from_true_rad, convergence_rad);
  }
};
Conditions read_conditions(ConfigReader& reader);
/// The same of a plan of an earlier version, which may know no wind.
Conditions read_recorded_conditions(ConfigReader& reader);

/// Greatest vertical rates, both magnitudes; a negative climb rate is a sink that cannot be held.
struct VerticalRates {
  double climb_mps = 0.0;
  double descent_mps = 0.0;
};

/// What power admits at one mass and temperature. With W = m g and the density rho of the altitude:
///
///     P(V)    = kappa W v_i + (sigma c_d0 / 8) rho A V_tip^3 (1 + k (V / V_tip)^2) + rho f V^3 / 2
///     v_i^2   = (sqrt(V^4 + 4 v_h^4) - V^2) / 2,   v_h^2 = W / (2 rho A)
///     P_avail = share_of_rotor (1 - reserve) min(gears, engines (rho / rho_0)^n)
///     climb   = (P_avail - P) / W,   descent = P / W
///
/// The descent is the one that needs no power: steeper, the air would drive the rotor faster than
/// its governor holds it. Nor is it above vortex_descent_mps + vortex_descent_slope (V -
/// vortex_speed_mps), or above vortex_descent_mps below that speed. Straight flight at small
/// angles; the induced velocity is that of level flight (momentum theory, as in J. G. Leishman,
/// Principles of Helicopter Aerodynamics, chapter 5).
class PowerLimits {
 public:
  /// @throws ConfigError  if the mass exceeds what the vehicle may have.
  PowerLimits(const PowerCurve& curve, const Conditions& conditions);

  [[nodiscard]] VerticalRates rates(double airspeed_mps, double altitude_m) const;
  /// Of the rotor in level flight.
  [[nodiscard]] double required_w(double airspeed_mps, double altitude_m) const;
  /// For the rotor, less the reserve.
  [[nodiscard]] double available_w(double altitude_m) const;
  [[nodiscard]] double mass_kg() const { return mass_kg_; }
  [[nodiscard]] double isa_deviation_k() const { return conditions_.isa_deviation_k; }

 private:
  [[nodiscard]] double required_at_w(double airspeed_mps, double density_kgpm3) const;
  [[nodiscard]] double available_at_w(double density_kgpm3) const;

  PowerCurve curve_;
  Conditions conditions_;
  double mass_kg_;
  double weight_n_;
  double disc_area_m2_;
};

}  // namespace hedgehop::flight
