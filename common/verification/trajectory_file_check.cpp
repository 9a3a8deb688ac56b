#include "verification/trajectory_file_check.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <string_view>

#include "base/angles.hpp"
#include "verification/path_pieces.hpp"

namespace hedgehop::verification {
namespace {

constexpr double kPlace_m = 0.01;
constexpr double kHeight_m = 1e-6;
constexpr double kHeading_rad = 1e-9;

std::string_view next(std::string_view& text, char end) {
  const std::size_t length = std::min(text.find(end), text.size());
  const std::string_view part = text.substr(0, length);
  text.remove_prefix(std::min(length + 1, text.size()));
  return part;
}

double number_of(std::string_view text) {
  double value = std::numeric_limits<double>::quiet_NaN();
  const auto read = std::from_chars(text.data(), text.data() + text.size(), value);
  return read.ec == std::errc() && read.ptr == text.data() + text.size()
             ? value
             : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace

void check_trajectory_file(const std::string& csv, const geo::MapProjection* projection,
                           const std::vector<flight::FlightState>& states, Findings& findings) {
  constexpr std::array<std::string_view, 4> kNames = {"latitude_deg", "longitude_deg",
                                                      "height_above_surface_m", "heading_grid_rad"};
  constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();
  const auto refuse_file = [&](double value, double limit) {
    findings.add(
        "trajectory_file", std::numeric_limits<double>::quiet_NaN(),
        {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::quiet_NaN()}, value,
        limit);
  };
  std::string_view rest = csv;
  std::string_view header = next(rest, '\n');
  std::array<std::size_t, kNames.size()> columns{kNone, kNone, kNone, kNone};
  for (std::size_t column = 0; !header.empty(); ++column) {
    const std::string_view name = next(header, ',');
    for (std::size_t k = 0; k < kNames.size(); ++k) {
      columns[k] = name == kNames[k] ? column : columns[k];
    }
  }
  const auto found = std::count_if(columns.begin(), columns.end(),
                                   [](std::size_t column) { return column != kNone; });
  if (found != static_cast<std::ptrdiff_t>(kNames.size())) {
    refuse_file(static_cast<double>(found), static_cast<double>(kNames.size()));
    return;
  }
  const auto lines = static_cast<std::size_t>(std::count(rest.begin(), rest.end(), '\n'));
  if (lines != states.size()) {
    refuse_file(static_cast<double>(lines), static_cast<double>(states.size()));
    return;
  }
  for (const flight::FlightState& state : states) {
    std::string_view line = next(rest, '\n');
    std::array<double, kNames.size()> values{};
    values.fill(std::numeric_limits<double>::quiet_NaN());
    for (std::size_t column = 0; !line.empty(); ++column) {
      const std::string_view cell = next(line, ',');
      for (std::size_t k = 0; k < kNames.size(); ++k) {
        values[k] = column == columns[k] ? number_of(cell) : values[k];
      }
    }
    if (!is_finite(state)) {
      continue;  // found as such
    }
    const auto [latitude_deg, longitude_deg, height_m, heading_rad] = values;
    if (projection != nullptr) {
      double off_m = std::numeric_limits<double>::quiet_NaN();
      if (std::fabs(latitude_deg) <= 90.0 && std::fabs(longitude_deg) <= 180.0) {
        off_m = distance_m(projection->to_map({radians_from_degrees(latitude_deg),
                                               radians_from_degrees(longitude_deg)}),
                           state.point());
      }
      if (!(off_m <= kPlace_m)) {
        findings.add("position_columns", state, off_m, kPlace_m);
      }
    }
    const double expected_m = state.altitude_m - state.surface_m;
    if (!(std::fabs(height_m - expected_m) <= kHeight_m)) {
      findings.add("height_column", state, height_m, expected_m);
    }
    const double expected_rad =
        grid_from_true_azimuth_rad(state.heading_true_rad, state.convergence_rad);
    if (!(std::fabs(wrap_to_pi(heading_rad - expected_rad)) <= kHeading_rad)) {
      findings.add("heading_grid_column", state, heading_rad, expected_rad);
    }
  }
}

}  // namespace hedgehop::verification
