#include "flight/vehicle.hpp"

#include <stdexcept>

#include "base/angles.hpp"
#include "base/elementary.hpp"

namespace hedgehop::flight {

Limits read_limits(ConfigReader& reader) {
  Limits limits;
  limits.speed_min_mps = reader.required_double("speed_min_mps");
  limits.speed_max_mps = reader.required_double("speed_max_mps");
  limits.bank_max_rad = reader.required_angle("bank_max_deg");
  limits.roll_rate_max_radps = radians_from_degrees(reader.required_double("roll_rate_max_degps"));
  limits.pitch_max_rad = reader.required_angle("pitch_max_deg");
  limits.climb_rate_max_mps = reader.required_double("climb_rate_max_mps");
  limits.descent_rate_max_mps = reader.required_double("descent_rate_max_mps");
  limits.vertical_acceleration_max_mps2 = reader.required_double("vertical_acceleration_max_mps2");
  limits.load_factor_max = reader.required_double("load_factor_max");
  reader.require(limits.speed_min_mps > 0.0, "speed_min_mps", "must be above 0");
  reader.require(limits.speed_max_mps > limits.speed_min_mps, "speed_max_mps",
                 "must be above speed_min_mps");
  reader.require(limits.bank_max_rad > 0.0 && limits.bank_max_rad < 1.3, "bank_max_deg",
                 "must lie between 0 and 74");
  reader.require(limits.roll_rate_max_radps > 0.0, "roll_rate_max_degps", "must be above 0");
  reader.require(limits.pitch_max_rad > 0.0 && limits.pitch_max_rad < 1.0, "pitch_max_deg",
                 "must lie between 0 and 57");
  reader.require(limits.climb_rate_max_mps > 0.0, "climb_rate_max_mps", "must be above 0");
  reader.require(limits.descent_rate_max_mps > 0.0, "descent_rate_max_mps", "must be above 0");
  reader.require(limits.vertical_acceleration_max_mps2 > 0.0, "vertical_acceleration_max_mps2",
                 "must be above 0");
  reader.require(limits.load_factor_max > 1.0, "load_factor_max", "must be above 1");
  reader.finish();
  return limits;
}

double turn_radius_min_m(double speed_mps, double bank_max_rad) {
  if (!(speed_mps >= 0.0) || !(bank_max_rad > 0.0)) {
    throw std::invalid_argument("turn radius needs a speed >= 0 and a bank limit > 0");
  }
  return speed_mps * speed_mps / (kGravity_mps2 * elementary::tan(bank_max_rad));
}

}  // namespace hedgehop::flight
