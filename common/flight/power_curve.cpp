#include "flight/power_curve.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "base/errors.hpp"

namespace hedgehop::flight {
namespace {

constexpr double kSeaLevel_kgpm3 = 1.225;
constexpr double kSeaLevel_k = 288.15;

}  // namespace

double air_density_kgpm3(double altitude_m, double isa_deviation_k) {
  const double share = std::max(1.0 - 2.25577e-5 * altitude_m, 0.3);
  const double standard_kgpm3 = kSeaLevel_kgpm3 * elementary::exp(4.25588 * elementary::log(share));
  if (isa_deviation_k == 0.0) {
    return standard_kgpm3;
  }
  const double standard_k = kSeaLevel_k * share;
  return standard_kgpm3 * standard_k / (standard_k + isa_deviation_k);
}

PowerCurve read_power_curve(ConfigReader& reader) {
  PowerCurve curve;
  const auto positive = [&](const char* key) {
    const double value = reader.required_double(key);
    reader.require(value > 0.0 && std::isfinite(value), key, "must be above 0");
    return value;
  };
  const auto not_negative = [&](const char* key) {
    const double value = reader.required_double(key);
    reader.require(value >= 0.0 && std::isfinite(value), key, "must not be negative");
    return value;
  };
  curve.mass_kg = positive("mass_kg");
  curve.mass_max_kg = positive("mass_max_kg");
  reader.require(curve.mass_max_kg >= curve.mass_kg, "mass_max_kg", "must not be below mass_kg");
  curve.rotor_radius_m = positive("rotor_radius_m");
  curve.solidity = positive("solidity");
  curve.tip_speed_mps = positive("tip_speed_mps");
  curve.profile_drag = positive("profile_drag");
  curve.profile_advance = not_negative("profile_advance");
  curve.induced_factor = positive("induced_factor");
  reader.require(curve.induced_factor >= 1.0, "induced_factor", "must be at least 1");
  curve.flat_plate_m2 = positive("flat_plate_m2");
  curve.gears_w = 1000.0 * positive("gears_kw");
  curve.engines_w = 1000.0 * positive("engines_kw");
  curve.engine_density_power = not_negative("engine_density_power");
  curve.share_of_rotor = positive("share_of_rotor");
  reader.require(curve.share_of_rotor <= 1.0, "share_of_rotor", "must be at most 1");
  curve.vortex_speed_mps = not_negative("vortex_speed_mps");
  curve.vortex_descent_mps = positive("vortex_descent_mps");
  curve.vortex_descent_slope = positive("vortex_descent_slope");
  reader.finish();
  return curve;
}

namespace {

Conditions read_conditions(ConfigReader& reader, bool has_wind) {
  Conditions conditions;
  conditions.is_power_used = reader.required_bool("use_power_curve");
  conditions.mass_kg = reader.required_double("mass_kg");
  reader.require(conditions.mass_kg >= 0.0 && std::isfinite(conditions.mass_kg), "mass_kg",
                 "must not be negative");
  conditions.isa_deviation_k = reader.required_double("isa_deviation_k");
  reader.require(conditions.isa_deviation_k >= -60.0 && conditions.isa_deviation_k <= 60.0,
                 "isa_deviation_k", "must lie between -60 and 60");
  conditions.power_reserve = reader.required_double("power_reserve");
  reader.require(conditions.power_reserve >= 0.0 && conditions.power_reserve < 1.0, "power_reserve",
                 "must lie between 0 and 1");
  if (has_wind) {
    conditions.wind_mps = reader.required_double("wind_mps");
    reader.require(conditions.wind_mps >= 0.0 && conditions.wind_mps <= 30.0, "wind_mps",
                   "must lie between 0 and 30");
    conditions.wind_from_true_rad = reader.required_angle("wind_from_deg");
    reader.require(std::fabs(conditions.wind_from_true_rad) <= 2.0 * std::numbers::pi,
                   "wind_from_deg", "must lie between -360 and 360");
  }
  reader.finish();
  return conditions;
}

}  // namespace

Conditions read_conditions(ConfigReader& reader) { return read_conditions(reader, true); }

Conditions read_recorded_conditions(ConfigReader& reader) {
  return read_conditions(reader, reader.has("wind_mps"));
}

PowerLimits::PowerLimits(const PowerCurve& curve, const Conditions& conditions)
    : curve_(curve),
      conditions_(conditions),
      mass_kg_(conditions.mass_kg > 0.0 ? conditions.mass_kg : curve.mass_kg),
      weight_n_(mass_kg_ * kGravity_mps2),
      disc_area_m2_(std::numbers::pi * curve.rotor_radius_m * curve.rotor_radius_m) {
  if (mass_kg_ > curve.mass_max_kg) {
    throw ConfigError("conditions.mass_kg is " + std::to_string(mass_kg_) +
                          ", more than the vehicle's power.mass_max_kg, " +
                          std::to_string(curve.mass_max_kg),
                      "a lighter flight, or another vehicle_file");
  }
}

double PowerLimits::required_at_w(double airspeed_mps, double density_kgpm3) const {
  const double squared = airspeed_mps * airspeed_mps;
  const double hover_squared = weight_n_ / (2.0 * density_kgpm3 * disc_area_m2_);
  // sqrt(V^4 + 4 v_h^4) - V^2 without the difference of near equals.
  const double induced_squared =
      2.0 * hover_squared * hover_squared /
      (std::sqrt(squared * squared + 4.0 * hover_squared * hover_squared) + squared);
  const double induced_w = curve_.induced_factor * weight_n_ * std::sqrt(induced_squared);
  const double tip = curve_.tip_speed_mps;
  const double profile_w = curve_.solidity * curve_.profile_drag / 8.0 * density_kgpm3 *
                           disc_area_m2_ * tip * tip * tip *
                           (1.0 + curve_.profile_advance * squared / (tip * tip));
  const double parasite_w = 0.5 * density_kgpm3 * curve_.flat_plate_m2 * squared * airspeed_mps;
  return induced_w + profile_w + parasite_w;
}

double PowerLimits::available_at_w(double density_kgpm3) const {
  const double engines_w =
      curve_.engines_w * elementary::exp(curve_.engine_density_power *
                                         elementary::log(density_kgpm3 / kSeaLevel_kgpm3));
  return curve_.share_of_rotor * (1.0 - conditions_.power_reserve) *
         std::min(curve_.gears_w, engines_w);
}

double PowerLimits::required_w(double airspeed_mps, double altitude_m) const {
  return required_at_w(airspeed_mps, air_density_kgpm3(altitude_m, conditions_.isa_deviation_k));
}

double PowerLimits::available_w(double altitude_m) const {
  return available_at_w(air_density_kgpm3(altitude_m, conditions_.isa_deviation_k));
}

VerticalRates PowerLimits::rates(double airspeed_mps, double altitude_m) const {
  const double density = air_density_kgpm3(altitude_m, conditions_.isa_deviation_k);
  const double required_w = required_at_w(airspeed_mps, density);
  VerticalRates rates{(available_at_w(density) - required_w) / weight_n_, required_w / weight_n_};
  const double beyond_mps = std::max(airspeed_mps - curve_.vortex_speed_mps, 0.0);
  rates.descent_mps = std::min(
      rates.descent_mps, curve_.vortex_descent_mps + curve_.vortex_descent_slope * beyond_mps);
  return rates;
}

}  // namespace hedgehop::flight
