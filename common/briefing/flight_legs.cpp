#include "briefing/flight_legs.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/angles.hpp"
#include "base/elementary.hpp"

namespace hedgehop::briefing {
namespace {

double horizontal_m(const flight::FlightState& a, const flight::FlightState& b) {
  const double dx_m = b.x_m - a.x_m;
  const double dy_m = b.y_m - a.y_m;
  return std::sqrt(dx_m * dx_m + dy_m * dy_m);
}

/// Distance of a place from a straight piece, seen from above.
double off_m(const flight::FlightState& p, const flight::FlightState& a,
             const flight::FlightState& b) {
  const double dx_m = b.x_m - a.x_m;
  const double dy_m = b.y_m - a.y_m;
  const double square_m2 = dx_m * dx_m + dy_m * dy_m;
  const double t =
      square_m2 > 0.0
          ? std::clamp(((p.x_m - a.x_m) * dx_m + (p.y_m - a.y_m) * dy_m) / square_m2, 0.0, 1.0)
          : 0.0;
  const double ex_m = p.x_m - a.x_m - t * dx_m;
  const double ey_m = p.y_m - a.y_m - t * dy_m;
  return std::sqrt(ex_m * ex_m + ey_m * ey_m);
}

FlightLeg leg_between(const flight::Trajectory& trajectory, const std::vector<double>& along_m,
                      std::size_t first, std::size_t last) {
  const flight::FlightState& a = trajectory.states[first];
  const flight::FlightState& b = trajectory.states[last];
  FlightLeg leg;
  leg.first = first;
  leg.last = last;
  leg.start_time_s = a.time_s;
  leg.duration_s = b.time_s - a.time_s;
  leg.start_along_m = along_m[first];
  leg.length_m = horizontal_m(a, b);
  leg.course_grid_rad =
      azimuth_from_math_angle_rad(elementary::atan2(b.y_m - a.y_m, b.x_m - a.x_m));
  leg.course_true_rad = true_from_grid_azimuth_rad(
      leg.course_grid_rad, trajectory.states[(first + last) / 2].convergence_rad);
  leg.speed_mps =
      leg.duration_s > 0.0 ? (along_m[last] - along_m[first]) / leg.duration_s : a.speed_mps;
  leg.altitude_from_m = a.altitude_m;
  leg.altitude_to_m = b.altitude_m;
  leg.height_min_m = std::numeric_limits<double>::quiet_NaN();
  leg.height_max_m = leg.height_min_m;
  for (std::size_t i = first; i <= last; ++i) {
    const double height_m = trajectory.states[i].altitude_m - trajectory.states[i].surface_m;
    leg.height_min_m = std::fmin(leg.height_min_m, height_m);
    leg.height_max_m = std::fmax(leg.height_max_m, height_m);
  }
  return leg;
}

}  // namespace

LegOptions read_leg_options(ConfigReader& reader) {
  LegOptions options;
  options.tolerance_m = reader.required_double("tolerance_m");
  reader.require(options.tolerance_m > 0.0, "tolerance_m", "must be above 0");
  reader.finish();
  return options;
}

std::vector<double> distances_m(const flight::Trajectory& trajectory) {
  std::vector<double> along_m;
  along_m.reserve(trajectory.states.size());
  for (std::size_t i = 0; i < trajectory.states.size(); ++i) {
    along_m.push_back(i == 0 ? 0.0
                             : along_m.back() +
                                   horizontal_m(trajectory.states[i - 1], trajectory.states[i]));
  }
  return along_m;
}

std::vector<FlightLeg> flight_legs(const flight::Trajectory& trajectory,
                                   const std::vector<std::size_t>& via, const LegOptions& options) {
  const auto& states = trajectory.states;
  if (states.size() < 2) {
    return {};
  }
  std::vector<std::size_t> ends = {0};
  for (const std::size_t i : via) {
    if (i > ends.back() && i + 1 < states.size()) {
      ends.push_back(i);
    }
  }
  ends.push_back(states.size() - 1);

  std::vector<char> is_kept(states.size(), 0);
  std::vector<std::pair<std::size_t, std::size_t>> open;
  for (std::size_t i = 1; i < ends.size(); ++i) {
    is_kept[ends[i - 1]] = is_kept[ends[i]] = 1;
    open.emplace_back(ends[i - 1], ends[i]);
  }
  while (!open.empty()) {
    const auto [first, last] = open.back();
    open.pop_back();
    double farthest_m = options.tolerance_m;
    std::size_t farthest = 0;
    for (std::size_t i = first + 1; i < last; ++i) {
      const double distance_m = off_m(states[i], states[first], states[last]);
      if (distance_m > farthest_m) {
        farthest_m = distance_m;
        farthest = i;
      }
    }
    if (farthest != 0) {
      is_kept[farthest] = 1;
      open.emplace_back(first, farthest);
      open.emplace_back(farthest, last);
    }
  }

  const std::vector<double> along_m = distances_m(trajectory);
  std::vector<FlightLeg> legs;
  std::size_t first = 0;
  for (std::size_t i = 1; i < states.size(); ++i) {
    if (is_kept[i] != 0) {
      legs.push_back(leg_between(trajectory, along_m, first, i));
      first = i;
    }
  }
  return legs;
}

}  // namespace hedgehop::briefing
