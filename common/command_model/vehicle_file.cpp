#include <algorithm>

#include "base/angles.hpp"
#include "command_model/command_model.hpp"

namespace hedgehop::command_model {

ModelParameters read_model_parameters(ConfigReader& reader) {
  ModelParameters parameters;
  const auto positive = [&](const char* key) {
    const double value = reader.required_double(key);
    reader.require(value > 0.0, key, "must be above 0");
    return value;
  };
  const auto not_negative = [&](const char* key) {
    const double value = reader.required_double(key);
    reader.require(value >= 0.0, key, "must not be negative");
    return value;
  };
  parameters.attitude_frequency_radps = positive("attitude_frequency_radps");
  parameters.attitude_damping = positive("attitude_damping");
  parameters.pitch_rate_max_radps = radians_from_degrees(positive("pitch_rate_max_degps"));
  parameters.heave_time_constant_s = positive("heave_time_constant_s");
  parameters.speed_gain_radpmps = positive("speed_gain_radpmps");
  parameters.heading_gain_1ps = positive("heading_gain_1ps");
  parameters.heading_rate_damping = not_negative("heading_rate_damping");
  parameters.climb_gain = positive("climb_gain");
  parameters.climb_integral_gain_1ps = not_negative("climb_integral_gain_1ps");
  parameters.climb_derivative_gain_s = not_negative("climb_derivative_gain_s");
  reader.require(parameters.attitude_frequency_radps <= 10.0, "attitude_frequency_radps",
                 "must be at most 10");
  reader.require(parameters.attitude_damping >= 0.5 && parameters.attitude_damping <= 1.0,
                 "attitude_damping", "must lie between 0.5 and 1");
  reader.require(parameters.heave_time_constant_s >= 0.1, "heave_time_constant_s",
                 "must be at least 0.1");
  reader.require(2.0 * parameters.attitude_damping * parameters.attitude_frequency_radps *
                         (1.0 + parameters.heading_rate_damping) >
                     parameters.heading_gain_1ps,
                 "heading_gain_1ps",
                 "makes the heading loop unstable: it must be below 2 attitude_damping "
                 "attitude_frequency_radps (1 + heading_rate_damping)");
  reader.finish();
  return parameters;
}

Vehicle read_vehicle(ConfigReader& reader) {
  Vehicle vehicle;
  vehicle.name = reader.required_string("name");
  ConfigReader limits = reader.required_section("limits");
  vehicle.limits = flight::read_limits(limits);
  ConfigReader model = reader.required_section("command_model");
  vehicle.model = read_model_parameters(model);
  if (reader.has("power")) {
    ConfigReader power = reader.required_section("power");
    vehicle.power = flight::read_power_curve(power);
  }
  reader.finish();
  return vehicle;
}

flight::VerticalRates Vehicle::vertical_rates(double airspeed_mps, double altitude_m) const {
  flight::VerticalRates rates{limits.climb_rate_max_mps, limits.descent_rate_max_mps};
  if (power_limits) {
    constexpr double kSpare_mps = 0.02;
    const flight::VerticalRates admitted = power_limits->rates(airspeed_mps, altitude_m);
    rates.descent_mps =
        std::min(rates.descent_mps, std::max(admitted.descent_mps - kSpare_mps, kSpare_mps));
    rates.climb_mps =
        std::clamp(admitted.climb_mps - kSpare_mps, -rates.descent_mps, rates.climb_mps);
  }
  return rates;
}

}  // namespace hedgehop::command_model
