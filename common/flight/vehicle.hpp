#pragma once

#include <string>

#include "base/config_reader.hpp"

namespace hedgehop::flight {

/// What a vehicle may do. Every number is a magnitude, except where said.
struct Limits {
  double speed_min_mps = 0.0;
  double speed_max_mps = 0.0;
  double bank_max_rad = 0.0;
  double roll_rate_max_radps = 0.0;
  double pitch_max_rad = 0.0;  // relative to trim
  double climb_rate_max_mps = 0.0;
  double descent_rate_max_mps = 0.0;
  double vertical_acceleration_max_mps2 = 0.0;
  double load_factor_max = 0.0;  // thrust over weight [-]

  bool operator==(const Limits&) const = default;
};

/// Reads the section `limits` of a vehicle file; every key is required.
Limits read_limits(ConfigReader& reader);

/// Least radius of a coordinated turn, v^2 / (g tan bank) [m].
double turn_radius_min_m(double speed_mps, double bank_max_rad);

}  // namespace hedgehop::flight
