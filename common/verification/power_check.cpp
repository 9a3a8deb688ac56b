#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "verification/verifier.hpp"

namespace hedgehop::verification {
namespace {

constexpr double kGas_jpkgk = 287.05287;  // of dry air
constexpr double kLapse_kpm = 0.0065;
constexpr double kGround_k = 288.15;
constexpr double kGround_pa = 101325.0;
constexpr double kStandardGravity_mps2 = 9.80665;

// Pressure of the standard atmosphere, temperature as it is.
double density_kgpm3(double altitude_m, double deviation_k) {
  const double standard_k = kGround_k - kLapse_kpm * altitude_m;
  const double exponent = kStandardGravity_mps2 / (kGas_jpkgk * kLapse_kpm);
  const double pressure_pa =
      kGround_pa * elementary::exp(exponent * elementary::log(standard_k / kGround_k));
  return pressure_pa / (kGas_jpkgk * (standard_k + deviation_k));
}

// v sqrt(V^2 + v^2) = hover^2. The left side is convex, so from above Newton comes down to the
// root.
double induced_mps(double hover_mps, double airspeed_mps) {
  double v = hover_mps;
  for (int i = 0; i < 30; ++i) {
    const double through = std::sqrt(airspeed_mps * airspeed_mps + v * v);
    v -= (v * through - hover_mps * hover_mps) / (through + v * v / through);
  }
  return v;
}

}  // namespace

flight::VerticalRates rates_by_power(const PowerDemand& power, double airspeed_mps,
                                     double altitude_m) {
  const flight::PowerCurve& curve = power.curve;
  const double mass_kg = power.conditions.mass_kg > 0.0 ? power.conditions.mass_kg : curve.mass_kg;
  const double weight_n = mass_kg * kGravity_mps2;
  const double rho = density_kgpm3(altitude_m, power.conditions.isa_deviation_k);
  const double disc_m2 = std::numbers::pi * curve.rotor_radius_m * curve.rotor_radius_m;
  const double hover_mps = std::sqrt(0.5 * weight_n / (rho * disc_m2));
  const double advance = airspeed_mps / curve.tip_speed_mps;
  // Drag of the blades [N] at the tip speed, and of the airframe.
  const double blades_n = rho * disc_m2 * curve.tip_speed_mps * curve.tip_speed_mps *
                          curve.solidity * curve.profile_drag / 8.0;
  const double airframe_n = 0.5 * rho * airspeed_mps * airspeed_mps * curve.flat_plate_m2;
  const double needed_w =
      curve.induced_factor * weight_n * induced_mps(hover_mps, airspeed_mps) +
      blades_n * curve.tip_speed_mps * (1.0 + curve.profile_advance * advance * advance) +
      airframe_n * airspeed_mps;
  const double ground_kgpm3 = kGround_pa / (kGas_jpkgk * kGround_k);
  const double thinned =
      elementary::exp(curve.engine_density_power * elementary::log(rho / ground_kgpm3));
  const double given_w = std::min(curve.gears_w, curve.engines_w * thinned) * curve.share_of_rotor *
                         (1.0 - power.conditions.power_reserve);
  flight::VerticalRates rates{(given_w - needed_w) / weight_n, needed_w / weight_n};
  const double caution_mps =
      airspeed_mps > curve.vortex_speed_mps
          ? curve.vortex_descent_mps +
                (airspeed_mps - curve.vortex_speed_mps) * curve.vortex_descent_slope
          : curve.vortex_descent_mps;
  rates.descent_mps = std::min(rates.descent_mps, caution_mps);
  return rates;
}

}  // namespace hedgehop::verification
