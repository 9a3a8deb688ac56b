#include "global_planning/route_finish.hpp"

#include <algorithm>
#include <cmath>

#include "global_planning/route_line.hpp"

namespace hedgehop::global_planning {
bool are_turns_allowed(const FlightEnvelope& envelope,
                       const std::vector<flight::Waypoint>& waypoints) {
  const std::vector<flight::Waypoint> corners = corners_of(waypoints);
  if (const flight::Waypoint& start = envelope.start();
      corners.size() >= 2 && corners[0].x_m == start.x_m && corners[0].y_m == start.y_m &&
      !envelope.may_leave_start(corners[1].x_m - corners[0].x_m, corners[1].y_m - corners[0].y_m)) {
    return false;
  }
  for (std::size_t i = 2; i < corners.size(); ++i) {
    if (!envelope.is_turn_allowed(
            corners[i - 1].x_m - corners[i - 2].x_m, corners[i - 1].y_m - corners[i - 2].y_m,
            corners[i].x_m - corners[i - 1].x_m, corners[i].y_m - corners[i - 1].y_m)) {
      return false;
    }
  }
  return true;
}

void cut_short(const FlightEnvelope& envelope, double step_m, std::int64_t work_budget,
               std::int64_t& work_units, std::vector<flight::Waypoint>& waypoints) {
  const auto cost_m = [&](const flight::Waypoint& a, const flight::Waypoint& b) {
    return envelope.route_cost_m({a, b}, step_m);
  };
  // Corners as far as the leg from i to j can touch them: the straight runs beside it and their
  // other ends.
  std::vector<flight::Waypoint> around;
  const auto is_turn_kept = [&](std::size_t i, std::size_t j) {
    constexpr std::size_t kAround = 40;
    around.assign(waypoints.begin() + static_cast<std::ptrdiff_t>(i - std::min(i, kAround)),
                  waypoints.begin() + static_cast<std::ptrdiff_t>(i) + 1);
    around.insert(around.end(), waypoints.begin() + static_cast<std::ptrdiff_t>(j),
                  waypoints.begin() +
                      static_cast<std::ptrdiff_t>(std::min(j + kAround, waypoints.size() - 1)) + 1);
    return are_turns_allowed(envelope, around);
  };
  bool has_changed = true;
  while (has_changed) {
    has_changed = false;
    for (std::size_t i = 0; i + 2 < waypoints.size(); ++i) {
      double along_m = cost_m(waypoints[i], waypoints[i + 1]);
      double best_saving_m = 0.0;
      std::size_t best = 0;
      for (std::size_t j = i + 2; j < waypoints.size(); ++j) {
        along_m += cost_m(waypoints[j - 1], waypoints[j]);
        const flight::Waypoint& a = waypoints[i];
        const flight::Waypoint& b = waypoints[j];
        if (!envelope.is_climb_allowed(a, b) || !is_turn_kept(i, j)) {
          continue;
        }
        if (work_units >= work_budget) {
          break;
        }
        ++work_units;
        if (!(envelope.leg_cost_m(a, b) < along_m)) {  // coarse, and infinite when not clear
          continue;
        }
        const double saving_m = along_m - cost_m(a, b);
        if (saving_m > best_saving_m && envelope.is_clear(a, b)) {
          best_saving_m = saving_m;
          best = j;
        }
      }
      // Savings of the order of rounding would never end.
      if (best > 0 && best_saving_m > 1e-6) {
        waypoints.erase(waypoints.begin() + static_cast<std::ptrdiff_t>(i) + 1,
                        waypoints.begin() + static_cast<std::ptrdiff_t>(best));
        has_changed = true;
      }
    }
  }
}

std::vector<flight::Waypoint> equidistant(const std::vector<flight::Waypoint>& waypoints,
                                          double spacing_m, double& actual_spacing_m) {
  const double all_m = flight::length_m(waypoints);
  const int parts = std::max(1, static_cast<int>(std::floor(all_m / spacing_m + 0.5)));
  actual_spacing_m = all_m / parts;
  std::vector<flight::Waypoint> points = {waypoints.front()};
  std::size_t leg = 1;
  double leg_begin_m = 0.0;
  const auto leg_length_m = [&](std::size_t k) {
    return flight::length_m({waypoints[k - 1], waypoints[k]});
  };
  double leg_m = leg_length_m(leg);
  for (int part = 1; part < parts; ++part) {
    const double at_m = all_m * part / parts;
    while (leg + 1 < waypoints.size() && at_m > leg_begin_m + leg_m) {
      leg_begin_m += leg_m;
      leg_m = leg_length_m(++leg);
    }
    const double t = leg_m > 0.0 ? std::clamp((at_m - leg_begin_m) / leg_m, 0.0, 1.0) : 0.0;
    const flight::Waypoint& a = waypoints[leg - 1];
    const flight::Waypoint& b = waypoints[leg];
    points.push_back({a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m),
                      a.altitude_m + t * (b.altitude_m - a.altitude_m)});
  }
  points.push_back(waypoints.back());
  return points;
}

}  // namespace hedgehop::global_planning
