#include "briefing/manoeuvres.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "briefing/flight_legs.hpp"
#include "raster/grid.hpp"

namespace hedgehop::briefing {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// What all kinds need.
struct Flight {
  const flight::Trajectory* trajectory;
  std::vector<double> along_m;
  const ManoeuvreOptions* options;

  [[nodiscard]] const std::vector<flight::FlightState>& states() const {
    return trajectory->states;
  }

  [[nodiscard]] double along_at_m(double time_s) const {
    const auto after = std::lower_bound(
        states().begin(), states().end(), time_s,
        [](const flight::FlightState& state, double time) { return state.time_s < time; });
    if (after == states().begin()) {
      return along_m.front();
    }
    if (after == states().end()) {
      return along_m.back();
    }
    const auto i = static_cast<std::size_t>(after - states().begin());
    const double step_s = states()[i].time_s - states()[i - 1].time_s;
    const double t = step_s > 0.0 ? (time_s - states()[i - 1].time_s) / step_s : 0.0;
    return along_m[i - 1] + t * (along_m[i] - along_m[i - 1]);
  }

  [[nodiscard]] Manoeuvre at(ManoeuvreKind kind, double time_s, double along,
                             const geo::MapPoint& place) const {
    Manoeuvre m;
    m.kind = kind;
    m.time_s = time_s;
    m.along_m = along;
    m.place = place;
    m.announced_time_s = std::max(states().front().time_s, time_s - options->announce_ahead_s);
    m.announced_distance_m = std::max(0.0, along - along_at_m(m.announced_time_s));
    for (double Manoeuvre::*member :
         {&Manoeuvre::heading_change_rad, &Manoeuvre::heading_to_rad, &Manoeuvre::bank_max_rad,
          &Manoeuvre::altitude_from_m, &Manoeuvre::altitude_to_m, &Manoeuvre::rate_max_mps,
          &Manoeuvre::top_m, &Manoeuvre::above_m, &Manoeuvre::support_m, &Manoeuvre::bearing_rad,
          &Manoeuvre::distance_m}) {
      m.*member = kNan;
    }
    return m;
  }
  [[nodiscard]] Manoeuvre at(ManoeuvreKind kind, std::size_t i) const {
    return at(kind, states()[i].time_s, along_m[i], states()[i].point());
  }
};

/// Calls `found(first, last, sign)` for each run of states with `value` at least `least` to one
/// side, last one included.
void for_each_run(const Flight& flight, const std::function<double(std::size_t)>& value,
                  double least, const std::function<void(std::size_t, std::size_t, int)>& found) {
  const auto& states = flight.states();
  int sign = 0;
  std::size_t first = 0;
  std::size_t last = 0;
  for (std::size_t i = 0; i < states.size(); ++i) {
    const double v = value(i);
    const int side = v >= least ? 1 : v <= -least ? -1 : 0;
    const bool is_over =
        sign != 0 && (side == -sign || (side == 0 && states[i].time_s - states[last].time_s >
                                                         flight.options->gap_s));
    if (is_over) {
      found(first, last, sign);
      sign = 0;
    }
    if (side != 0) {
      if (sign == 0) {
        sign = side;
        first = i;
      }
      last = i;
    }
  }
  if (sign != 0) {
    found(first, last, sign);
  }
}

void add_turns(const Flight& flight, std::vector<Manoeuvre>& found) {
  const auto& states = flight.states();
  for_each_run(
      flight, [&](std::size_t i) { return states[i].bank_rad; }, flight.options->bank_min_rad,
      [&](std::size_t first, std::size_t last, int sign) {
        double change_rad = 0.0;
        double bank_rad = 0.0;
        for (std::size_t i = first; i <= last; ++i) {
          if (i > first) {
            change_rad += wrap_to_pi(states[i].heading_true_rad - states[i - 1].heading_true_rad);
          }
          bank_rad = std::fmax(bank_rad, std::fabs(states[i].bank_rad));
        }
        if (!(sign * change_rad >= flight.options->turn_min_rad)) {
          return;
        }
        Manoeuvre m = flight.at(ManoeuvreKind::kTurn, first);
        m.duration_s = states[last].time_s - states[first].time_s;
        m.heading_change_rad = change_rad;
        m.heading_to_rad = wrap_to_two_pi(states[last].heading_true_rad);
        m.bank_max_rad = bank_rad;
        found.push_back(m);
      });
}

void add_climbs(const Flight& flight, std::vector<Manoeuvre>& found) {
  const auto& states = flight.states();
  for_each_run(
      flight,
      [&](std::size_t i) {
        return elementary::atan2(states[i].climb_rate_mps, states[i].speed_mps);
      },
      flight.options->climb_angle_min_rad,
      [&](std::size_t first, std::size_t last, int sign) {
        const double change_m = states[last].altitude_m - states[first].altitude_m;
        if (!(sign * change_m >= flight.options->climb_min_m)) {
          return;
        }
        Manoeuvre m = flight.at(sign > 0 ? ManoeuvreKind::kClimb : ManoeuvreKind::kDescent, first);
        m.duration_s = states[last].time_s - states[first].time_s;
        m.altitude_from_m = states[first].altitude_m;
        m.altitude_to_m = states[last].altitude_m;
        m.rate_max_mps = 0.0;
        for (std::size_t i = first; i <= last; ++i) {
          m.rate_max_mps = std::fmax(m.rate_max_mps, sign * states[i].climb_rate_mps);
        }
        found.push_back(m);
      });
}

/// Rectangle around the whole flight.
struct Bounds {
  double west_m = std::numeric_limits<double>::infinity();
  double south_m = west_m;
  double east_m = -west_m;
  double north_m = -west_m;

  void include(const geo::MapPoint& p) {
    west_m = std::min(west_m, p.x_m);
    east_m = std::max(east_m, p.x_m);
    south_m = std::min(south_m, p.y_m);
    north_m = std::max(north_m, p.y_m);
  }
  [[nodiscard]] bool meets(const Bounds& other) const {
    return west_m <= other.east_m && other.west_m <= east_m && south_m <= other.north_m &&
           other.south_m <= north_m;
  }
  [[nodiscard]] Bounds grown(double margin_m) const {
    Bounds b = *this;
    b.west_m -= margin_m;
    b.south_m -= margin_m;
    b.east_m += margin_m;
    b.north_m += margin_m;
    return b;
  }
};

Bounds bounds_of(const geo::MapPoint& a, const geo::MapPoint& b) {
  Bounds bounds;
  bounds.include(a);
  bounds.include(b);
  return bounds;
}

std::string spoken(const char* kind) {
  std::string text = kind;
  std::replace(text.begin(), text.end(), '_', ' ');
  return text;
}

/// Where a step from `a` to `b` and a span from `c` to `d` meet, as shares of both.
struct Meeting {
  double step_share;
  double span_share;
};
std::optional<Meeting> meeting_of(const geo::MapPoint& a, const geo::MapPoint& b,
                                  const geo::MapPoint& c, const geo::MapPoint& d) {
  const double rx = b.x_m - a.x_m;
  const double ry = b.y_m - a.y_m;
  const double sx = d.x_m - c.x_m;
  const double sy = d.y_m - c.y_m;
  const double cross = rx * sy - ry * sx;
  if (cross == 0.0) {
    return std::nullopt;  // along the wire, not across
  }
  return Meeting{((c.x_m - a.x_m) * sy - (c.y_m - a.y_m) * sx) / cross,
                 ((c.x_m - a.x_m) * ry - (c.y_m - a.y_m) * rx) / cross};
}

/// Ends belong to the step or span that begins there, so that a crossing counts once; the last end
/// of all belongs to the last one.
bool is_within(double share, bool is_last) {
  return share >= 0.0 && (share < 1.0 || (is_last && share <= 1.0));
}

void add_wires(const map::Map& map, const Flight& flight, const Bounds& whole,
               std::vector<Manoeuvre>& found) {
  const auto& states = flight.states();
  for (const map::OverheadLine& line : map.overhead_lines) {
    for (std::size_t k = 1; k < line.supports.size(); ++k) {
      const auto& from = line.supports[k - 1];
      const auto& to = line.supports[k];
      const Bounds span = bounds_of(from.point, to.point);
      if (!span.meets(whole)) {
        continue;
      }
      for (std::size_t i = 1; i < states.size(); ++i) {
        if (!span.meets(bounds_of(states[i - 1].point(), states[i].point()))) {
          continue;
        }
        const auto meeting =
            meeting_of(states[i - 1].point(), states[i].point(), from.point, to.point);
        if (!meeting || !is_within(meeting->step_share, i + 1 == states.size()) ||
            !is_within(meeting->span_share, k + 1 == line.supports.size())) {
          continue;
        }
        const flight::FlightState& a = states[i - 1];
        const flight::FlightState& b = states[i];
        const double t = meeting->step_share;
        const auto top_m = [&](const map::OverheadLine::Support& support) {
          return raster::sample_bilinear(map.terrain_m, support.point) + support.height_m;
        };
        Manoeuvre m =
            flight.at(ManoeuvreKind::kWireCrossing, a.time_s + t * (b.time_s - a.time_s),
                      flight.along_m[i - 1] + t * (flight.along_m[i] - flight.along_m[i - 1]),
                      {a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m)});
        m.name = spoken(map::name_of(line.kind));
        if (line.source_id != 0) {
          m.name += " " + std::to_string(line.source_id);
        }
        const double from_top_m = top_m(from);
        m.top_m = from_top_m + meeting->span_share * (top_m(to) - from_top_m);
        m.above_m = a.altitude_m + t * (b.altitude_m - a.altitude_m) - m.top_m;
        const double dx_m = to.point.x_m - from.point.x_m;
        const double dy_m = to.point.y_m - from.point.y_m;
        m.support_m = std::sqrt(dx_m * dx_m + dy_m * dy_m) *
                      std::min(meeting->span_share, 1.0 - meeting->span_share);
        found.push_back(m);
      }
    }
  }
}

void add_obstacles(const map::Map& map, const Flight& flight, const Bounds& whole,
                   std::vector<Manoeuvre>& found) {
  const auto& states = flight.states();
  for (const map::Obstacle& obstacle : map.obstacles) {
    const double reach_m = flight.options->obstacle_distance_m + obstacle.radius_m;
    if (!bounds_of(obstacle.point, obstacle.point).grown(reach_m).meets(whole)) {
      continue;
    }
    std::size_t nearest = 0;
    double nearest_m = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < states.size(); ++i) {
      const double dx_m = obstacle.point.x_m - states[i].x_m;
      const double dy_m = obstacle.point.y_m - states[i].y_m;
      const double distance_m = std::sqrt(dx_m * dx_m + dy_m * dy_m);
      if (distance_m < nearest_m) {
        nearest_m = distance_m;
        nearest = i;
      }
    }
    const flight::FlightState& state = states[nearest];
    // An unknown top may be any.
    if (nearest_m > reach_m ||
        obstacle.top_m < state.altitude_m - flight.options->obstacle_height_m) {
      continue;
    }
    Manoeuvre m = flight.at(ManoeuvreKind::kObstacle, nearest);
    m.name = spoken(map::name_of(obstacle.kind));
    if (!obstacle.name.empty()) {
      m.name += " " + obstacle.name;
    }
    m.top_m = obstacle.top_m;
    m.above_m = state.altitude_m - obstacle.top_m;
    m.distance_m = std::max(0.0, nearest_m - obstacle.radius_m);
    const double azimuth_rad = true_from_grid_azimuth_rad(
        azimuth_from_math_angle_rad(
            elementary::atan2(obstacle.point.y_m - state.y_m, obstacle.point.x_m - state.x_m)),
        state.convergence_rad);
    m.bearing_rad = wrap_to_pi(azimuth_rad - state.heading_true_rad);
    found.push_back(m);
  }
}

}  // namespace

ManoeuvreOptions read_manoeuvre_options(ConfigReader& reader) {
  ManoeuvreOptions options;
  const auto not_negative = [&](const char* key, double& value) {
    value = reader.required_double(key);
    reader.require(value >= 0.0, key, "must not be negative");
  };
  const auto positive_angle = [&](const char* key, double& value) {
    value = reader.required_angle(key);
    reader.require(value > 0.0, key, "must be above 0");
  };
  not_negative("announce_ahead_s", options.announce_ahead_s);
  positive_angle("bank_min_deg", options.bank_min_rad);
  options.turn_min_rad = reader.required_angle("turn_min_deg");
  reader.require(options.turn_min_rad >= 0.0, "turn_min_deg", "must not be negative");
  positive_angle("climb_angle_min_deg", options.climb_angle_min_rad);
  not_negative("climb_min_m", options.climb_min_m);
  not_negative("gap_s", options.gap_s);
  not_negative("obstacle_distance_m", options.obstacle_distance_m);
  not_negative("obstacle_height_m", options.obstacle_height_m);
  reader.finish();
  return options;
}

const char* name_of(ManoeuvreKind kind) {
  switch (kind) {
    case ManoeuvreKind::kTurn:
      return "turn";
    case ManoeuvreKind::kClimb:
      return "climb";
    case ManoeuvreKind::kDescent:
      return "descent";
    case ManoeuvreKind::kWireCrossing:
      return "wire_crossing";
    case ManoeuvreKind::kObstacle:
      return "obstacle";
    case ManoeuvreKind::kVia:
      return "via";
  }
  return "";
}

std::vector<Manoeuvre> manoeuvres(const map::Map& map, const flight::Trajectory& trajectory,
                                  const std::vector<std::size_t>& via,
                                  const std::vector<double>& via_distance_m,
                                  const ManoeuvreOptions& options) {
  std::vector<Manoeuvre> found;
  if (trajectory.states.size() < 2) {
    return found;
  }
  const Flight flight{&trajectory, distances_m(trajectory), &options};
  Bounds whole;
  for (const flight::FlightState& state : trajectory.states) {
    whole.include(state.point());
  }
  add_turns(flight, found);
  add_climbs(flight, found);
  add_wires(map, flight, whole, found);
  add_obstacles(map, flight, whole, found);
  for (std::size_t i = 0; i < std::min(via.size(), via_distance_m.size()); ++i) {
    if (via[i] < trajectory.states.size()) {
      Manoeuvre m = flight.at(ManoeuvreKind::kVia, via[i]);
      m.distance_m = via_distance_m[i];
      m.number = i + 1;
      found.push_back(m);
    }
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const Manoeuvre& a, const Manoeuvre& b) { return a.time_s < b.time_s; });
  return found;
}

}  // namespace hedgehop::briefing
