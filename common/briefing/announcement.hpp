#pragma once

#include <optional>
#include <string>

#include "briefing/manoeuvres.hpp"

namespace hedgehop::briefing {

/// Azimuth from magnetic north: that from true north less the declination, which is positive where
/// magnetic north lies east of true north. [0, 2 pi).
double magnetic_from_true_azimuth_rad(double azimuth_true_rad, double declination_rad);

/// Three digits and a degree sign, "004°"; 000 rather than 360. "unknown" for NaN.
std::string heading_text(double azimuth_rad);

/// What a pilot is told `announced_time_s` into the flight:
/// "in 20 s, 800 m: turn right to 214° true, 211° magnetic; bank 25°, 9 s".
/// Without a declination the magnetic heading is left out.
std::string announcement_text(const Manoeuvre& manoeuvre, std::optional<double> declination_rad);

}  // namespace hedgehop::briefing
