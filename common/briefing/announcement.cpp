#include "briefing/announcement.hpp"

#include <array>
#include <cmath>
#include <cstdarg>
#include <cstdio>

#include "base/angles.hpp"

namespace hedgehop::briefing {
namespace {

[[gnu::format(printf, 1, 2)]] std::string text_of(const char* format, ...) {
  std::array<char, 256> buffer{};
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(buffer.data(), buffer.size(), format, arguments);
  va_end(arguments);
  return buffer.data();
}

std::string metres(double value_m) {
  return std::isfinite(value_m) ? text_of("%.0f m", value_m) : "unknown";
}

std::string distance(double value_m) {
  return value_m < 995.0 ? text_of("%.0f m", 10.0 * std::round(value_m / 10.0))
                         : text_of("%.1f km", value_m / 1000.0);
}

std::string headings(double azimuth_true_rad, std::optional<double> declination_rad) {
  std::string text = heading_text(azimuth_true_rad) + " true";
  if (declination_rad) {
    text += ", " +
            heading_text(magnetic_from_true_azimuth_rad(azimuth_true_rad, *declination_rad)) +
            " magnetic";
  }
  return text;
}

std::string where(double bearing_rad) {
  const double bearing_deg = degrees_from_radians(bearing_rad);
  if (!std::isfinite(bearing_deg)) {
    return "near";
  }
  return std::fabs(bearing_deg) < 20.0    ? "ahead"
         : std::fabs(bearing_deg) > 160.0 ? "behind"
         : bearing_deg > 0.0              ? "on the right"
                                          : "on the left";
}

std::string above(double above_m, const char* under) {
  if (!std::isfinite(above_m)) {
    return std::string("height of ") + under + " unknown";
  }
  return above_m >= 0.0 ? metres(above_m) + " above " + under
                        : metres(-above_m) + " BELOW " + under;
}

std::string what_of(const Manoeuvre& m, std::optional<double> declination_rad) {
  switch (m.kind) {
    case ManoeuvreKind::kTurn:
      return std::string("turn ") + (m.heading_change_rad > 0.0 ? "right" : "left") + " to " +
             headings(m.heading_to_rad, declination_rad) +
             text_of("; bank %.0f°, %.0f s", degrees_from_radians(m.bank_max_rad), m.duration_s);
    case ManoeuvreKind::kClimb:
    case ManoeuvreKind::kDescent:
      return std::string(m.kind == ManoeuvreKind::kClimb ? "climb" : "descend") + " from " +
             metres(m.altitude_from_m) + " to " + metres(m.altitude_to_m) +
             text_of("; up to %.1f m/s, %.0f s", m.rate_max_mps, m.duration_s);
    case ManoeuvreKind::kWireCrossing:
      return "cross " + m.name + ", " + above(m.above_m, "the wire") + "; nearest support " +
             metres(m.support_m) + " away";
    case ManoeuvreKind::kObstacle:
      return m.name + " " + where(m.bearing_rad) + ", " + metres(m.distance_m) + " off, " +
             above(m.above_m, "its top");
    case ManoeuvreKind::kVia:
      return "via point " + std::to_string(m.number) + ", passed " + metres(m.distance_m) + " off";
  }
  return "";
}

}  // namespace

double magnetic_from_true_azimuth_rad(double azimuth_true_rad, double declination_rad) {
  return wrap_to_two_pi(azimuth_true_rad - declination_rad);
}

std::string heading_text(double azimuth_rad) {
  if (!std::isfinite(azimuth_rad)) {
    return "unknown";
  }
  const long degrees = std::lround(degrees_from_radians(wrap_to_two_pi(azimuth_rad))) % 360;
  return text_of("%03ld°", degrees);
}

std::string announcement_text(const Manoeuvre& manoeuvre, std::optional<double> declination_rad) {
  const double ahead_s = manoeuvre.time_s - manoeuvre.announced_time_s;
  const std::string when =
      ahead_s < 0.5 ? std::string("now")
                    : text_of("in %.0f s, ", ahead_s) + distance(manoeuvre.announced_distance_m);
  return when + ": " + what_of(manoeuvre, declination_rad);
}

}  // namespace hedgehop::briefing
