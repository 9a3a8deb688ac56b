#include "evaluation/brute_force_judge.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "base/angles.hpp"

namespace hedgehop::evaluation {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kReach_m = 300.0;
constexpr std::size_t kChunk = 50;  // states that share a choice of what is near
constexpr double kRounding = 1e-6;

struct Point {
  double x_m, y_m, z_m;
};

// Weighted mean of the four cells around; the outermost cells go on beyond their centres.
double height_at(const raster::Grid<float>& grid, double x_m, double y_m) {
  const raster::GridGeometry& g = grid.geometry();
  if (!(x_m >= g.west_m && x_m < g.east_m() && y_m >= g.south_m && y_m < g.north_m())) {
    return std::nan("");
  }
  const double u = std::clamp((x_m - g.west_m) / g.cell_m - 0.5, 0.0, g.columns - 1.0);
  const double v = std::clamp((y_m - g.south_m) / g.cell_m - 0.5, 0.0, g.rows - 1.0);
  double sum = 0.0;
  for (int row = static_cast<int>(v); row <= std::min(static_cast<int>(v) + 1, g.rows - 1); ++row) {
    for (int column = static_cast<int>(u);
         column <= std::min(static_cast<int>(u) + 1, g.columns - 1); ++column) {
      const double weight = (1.0 - std::fabs(u - column)) * (1.0 - std::fabs(v - row));
      if (weight > 0.0) {
        sum += weight * static_cast<double>(grid.at(column, row));
      }
    }
  }
  return sum;
}

struct Wire {
  Point a, b;
};

double distance_to_wire_m(const Point& p, const Wire& wire) {
  const double dx = wire.b.x_m - wire.a.x_m;
  const double dy = wire.b.y_m - wire.a.y_m;
  const double dz = wire.b.z_m - wire.a.z_m;
  const double px = p.x_m - wire.a.x_m;
  const double py = p.y_m - wire.a.y_m;
  const double pz = p.z_m - wire.a.z_m;
  const double flat2 = dx * dx + dy * dy;
  const double s = flat2 > 0.0 ? std::clamp((px * dx + py * dy) / flat2, 0.0, 1.0) : 0.0;
  const double aside_m = std::hypot(px - s * dx, py - s * dy);
  if (!std::isfinite(wire.a.z_m) || !(pz > s * dz)) {
    return aside_m;  // at or below the conductor
  }
  const double square = flat2 + dz * dz;
  const double t =
      square > 0.0 ? std::clamp((px * dx + py * dy + pz * dz) / square, 0.0, 1.0) : 0.0;
  return std::hypot(px - t * dx, py - t * dy, pz - t * dz);
}

double distance_to_edge_m(const Point& p, const geo::MapPoint& a, const geo::MapPoint& b) {
  return distance_to_wire_m({p.x_m, p.y_m, 0.0}, {{a.x_m, a.y_m, 0.0}, {b.x_m, b.y_m, 0.0}});
}

// A ray to the east crosses the ring an odd number of times.
bool is_in_ring(const std::vector<geo::MapPoint>& ring, const Point& p) {
  bool is_inside = false;
  for (std::size_t i = 1; i < ring.size(); ++i) {
    const geo::MapPoint& a = ring[i - 1];
    const geo::MapPoint& b = ring[i];
    if ((a.y_m > p.y_m) != (b.y_m > p.y_m) &&
        p.x_m < a.x_m + (p.y_m - a.y_m) / (b.y_m - a.y_m) * (b.x_m - a.x_m)) {
      is_inside = !is_inside;
    }
  }
  return is_inside;
}

double distance_to_area_m(const map::Map& map, const map::Area& area, const Point& p) {
  bool is_inside = false;
  double edge_m = kInfinity;
  for (const map::Area::Polygon& polygon : area.polygons) {
    bool is_in_this = is_in_ring(polygon.outer, p);
    std::vector<const std::vector<geo::MapPoint>*> rings = {&polygon.outer};
    for (const auto& hole : polygon.holes) {
      is_in_this = is_in_this && !is_in_ring(hole, p);
      rings.push_back(&hole);
    }
    is_inside = is_inside || is_in_this;
    for (const auto* ring : rings) {
      for (std::size_t i = 1; i < ring->size(); ++i) {
        edge_m = std::min(edge_m, distance_to_edge_m(p, (*ring)[i - 1], (*ring)[i]));
      }
    }
  }
  const double aside_m = is_inside ? 0.0 : edge_m;
  const double ground_m = height_at(map.terrain_m, p.x_m, p.y_m);
  const double floor_m = area.floor.altitude_m(ground_m);
  const double ceiling_m = area.ceiling.altitude_m(ground_m);
  double off_m = 0.0;  // stays 0 over unknown ground
  off_m = std::fmax(off_m, floor_m - p.z_m);
  off_m = std::fmax(off_m, p.z_m - ceiling_m);
  return std::hypot(aside_m, off_m);
}

double velocity_azimuth_rad(const flight::FlightState& state) {
  return state.heading_true_rad - state.convergence_rad;
}

// The cubic through the places and velocities of two states.
Point between(const flight::FlightState& a, const flight::FlightState& b, double step_s, double t) {
  const double h00 = (1.0 + 2.0 * t) * (1.0 - t) * (1.0 - t);
  const double h10 = t * (1.0 - t) * (1.0 - t) * step_s;
  const double h01 = t * t * (3.0 - 2.0 * t);
  const double h11 = t * t * (t - 1.0) * step_s;
  const double azimuth_a = velocity_azimuth_rad(a);
  const double azimuth_b = velocity_azimuth_rad(b);
  return {
      h00 * a.x_m + h10 * a.speed_mps * std::sin(azimuth_a) + h01 * b.x_m +
          h11 * b.speed_mps * std::sin(azimuth_b),
      h00 * a.y_m + h10 * a.speed_mps * std::cos(azimuth_a) + h01 * b.y_m +
          h11 * b.speed_mps * std::cos(azimuth_b),
      h00 * a.altitude_m + h10 * a.climb_rate_mps + h01 * b.altitude_m + h11 * b.climb_rate_mps};
}

void check_state(const flight::FlightState& s, const flight::Limits& limits,
                 std::set<std::string>& broken) {
  const auto over = [&](const char* name, double value, double limit) {
    if (!(value <= limit * (1.0 + kRounding))) {
      broken.insert(name);
    }
  };
  over("bank", std::fabs(s.bank_rad), limits.bank_max_rad);
  over("roll_rate", std::fabs(s.roll_rate_radps), limits.roll_rate_max_radps);
  over("pitch", std::fabs(s.pitch_rad), limits.pitch_max_rad);
  over("climb_rate", s.climb_rate_mps, limits.climb_rate_max_mps);
  over("descent_rate", -s.climb_rate_mps, limits.descent_rate_max_mps);
  over("vertical_acceleration", std::fabs(s.vertical_acceleration_mps2),
       limits.vertical_acceleration_max_mps2);
  over("load_factor",
       std::hypot(1.0 + s.vertical_acceleration_mps2 / kGravity_mps2, std::tan(s.bank_rad),
                  std::tan(s.pitch_rad)),
       limits.load_factor_max);
  over("speed_max", s.speed_mps, limits.speed_max_mps);
  over("speed_min", -s.speed_mps, -limits.speed_min_mps * (1.0 - 2.0 * kRounding));
}

// What the air feels of a state.
flight::FlightState in_air(flight::FlightState state, const flight::Wind& wind) {
  if (wind.is_calm()) {
    return state;
  }
  const double azimuth_rad = velocity_azimuth_rad(state);
  const double east_mps = state.speed_mps * std::sin(azimuth_rad) - wind.east_mps;
  const double north_mps = state.speed_mps * std::cos(azimuth_rad) - wind.north_mps;
  state.speed_mps = std::hypot(east_mps, north_mps);
  state.heading_true_rad = std::atan2(east_mps, north_mps) + state.convergence_rad;
  return state;
}

bool is_one_flight(const flight::FlightState& a, const flight::FlightState& b,
                   const flight::Wind& wind, double step_s) {
  const flight::FlightState air_a = in_air(a, wind);
  const flight::FlightState air_b = in_air(b, wind);
  const double turn_radps =
      0.5 * kGravity_mps2 *
      (std::tan(a.bank_rad) / air_a.speed_mps + std::tan(b.bank_rad) / air_b.speed_mps);
  const double speed_mps = std::hypot(b.x_m - a.x_m, b.y_m - a.y_m) / step_s;
  const double climb_mps = (b.altitude_m - a.altitude_m) / step_s;
  const double turned_radps =
      std::remainder(velocity_azimuth_rad(air_b) - velocity_azimuth_rad(air_a), kTwoPi) / step_s;
  const double rolled_radps = (b.bank_rad - a.bank_rad) / step_s;
  return std::fabs(speed_mps - 0.5 * (a.speed_mps + b.speed_mps)) <= 0.5 &&
         std::fabs(climb_mps - 0.5 * (a.climb_rate_mps + b.climb_rate_mps)) <= 0.3 &&
         std::fabs(turned_radps - turn_radps) <= 0.05 &&
         std::fabs(rolled_radps - 0.5 * (a.roll_rate_radps + b.roll_rate_radps)) <= 0.1 &&
         std::fabs(b.time_s - a.time_s - step_s) <= 1e-3 * step_s;
}

struct Reach {
  double west_m = kInfinity, east_m = -kInfinity, south_m = kInfinity, north_m = -kInfinity;
  void add(double x_m, double y_m) {
    west_m = std::min(west_m, x_m);
    east_m = std::max(east_m, x_m);
    south_m = std::min(south_m, y_m);
    north_m = std::max(north_m, y_m);
  }
  [[nodiscard]] bool is_near(const Reach& other, double reach_m) const {
    return west_m - reach_m <= other.east_m && other.west_m - reach_m <= east_m &&
           south_m - reach_m <= other.north_m && other.south_m - reach_m <= north_m;
  }
};

}  // namespace

double SampledDistances::spare_m(double required_m) const {
  return std::min(std::min({ground_m, wire_m, obstacle_m}) - required_m, area_m);
}

BruteForceVerdict judge_by_brute_force(const map::Map& map, const flight::Trajectory& trajectory,
                                       const flight::Waypoint& start,
                                       const std::vector<geo::MapPoint>& via,
                                       const flight::Waypoint& goal, const flight::Limits& limits,
                                       const verification::Demands& demands, double sample_m) {
  const std::vector<flight::FlightState>& states = trajectory.states;
  BruteForceVerdict verdict;
  verdict.distances = {kInfinity, kInfinity, kInfinity, kInfinity};
  std::set<std::string> broken;
  std::vector<Point> samples;
  double low_m = 0.0;
  double length_m = 0.0;
  for (std::size_t first = 0; first + 1 < states.size(); first += kChunk) {
    const std::size_t last = std::min(first + kChunk, states.size() - 1);
    Reach here;
    for (std::size_t i = first; i <= last; ++i) {
      here.add(states[i].x_m, states[i].y_m);
    }
    std::vector<Wire> wires;
    for (const map::OverheadLine& line : map.overhead_lines) {
      for (std::size_t k = 1; k < line.supports.size(); ++k) {
        Reach span;
        Wire wire{};
        for (const auto& [support, end] :
             {std::pair{&line.supports[k - 1], &wire.a}, std::pair{&line.supports[k], &wire.b}}) {
          const geo::MapPoint& at = support->point;
          span.add(at.x_m, at.y_m);
          *end = {at.x_m, at.y_m, height_at(map.terrain_m, at.x_m, at.y_m) + support->height_m};
        }
        if (!std::isfinite(wire.a.z_m + wire.b.z_m)) {
          wire.a.z_m = wire.b.z_m = kInfinity;
        }
        if (span.is_near(here, kReach_m)) {
          wires.push_back(wire);
        }
      }
    }
    std::vector<std::pair<Point, double>> cylinders;  // foot with the top's altitude, radius
    for (const map::Obstacle& obstacle : map.obstacles) {
      Reach mast;
      mast.add(obstacle.point.x_m, obstacle.point.y_m);
      if (mast.is_near(here, kReach_m + obstacle.radius_m)) {
        double top_m = std::fmax(
            obstacle.top_m,
            height_at(map.terrain_m, obstacle.point.x_m, obstacle.point.y_m) + obstacle.height_m);
        top_m = std::isnan(top_m) ? kInfinity : top_m;
        cylinders.push_back({{obstacle.point.x_m, obstacle.point.y_m, top_m}, obstacle.radius_m});
      }
    }
    std::vector<const map::Area*> areas;
    for (const map::Area& area : map.areas) {
      Reach around;
      for (const map::Area::Polygon& polygon : area.polygons) {
        for (const geo::MapPoint& corner : polygon.outer) {
          around.add(corner.x_m, corner.y_m);
        }
      }
      if (area.is_hard && around.is_near(here, kReach_m)) {
        areas.push_back(&area);
      }
    }
    for (std::size_t i = first; i < last; ++i) {
      const flight::FlightState& a = states[i];
      const flight::FlightState& b = states[i + 1];
      if (!is_one_flight(a, b, demands.wind, trajectory.step_s)) {
        broken.insert("kinematics");
      }
      const double chord_m = std::hypot(b.x_m - a.x_m, b.y_m - a.y_m);
      const int pieces = std::max(1, static_cast<int>(std::ceil(chord_m / sample_m)));
      for (int k = i == 0 ? 0 : 1; k <= pieces; ++k) {
        const Point p = between(a, b, trajectory.step_s, static_cast<double>(k) / pieces);
        samples.push_back(p);
        SampledDistances& least = verdict.distances;
        const double height_m = p.z_m - height_at(map.surface_m, p.x_m, p.y_m);
        if (std::isnan(height_m)) {
          broken.insert("unknown_surface");
        }
        least.ground_m = std::fmin(least.ground_m, height_m);
        low_m += height_m <= demands.ceiling_height_m ? chord_m / pieces : 0.0;
        length_m += chord_m / pieces;
        for (const Wire& wire : wires) {
          least.wire_m = std::min(least.wire_m, distance_to_wire_m(p, wire));
        }
        for (const auto& [foot, radius_m] : cylinders) {
          const double aside_m =
              std::max(std::hypot(p.x_m - foot.x_m, p.y_m - foot.y_m) - radius_m, 0.0);
          least.obstacle_m =
              std::min(least.obstacle_m, std::hypot(aside_m, std::max(p.z_m - foot.z_m, 0.0)));
        }
        for (const map::Area* area : areas) {
          least.area_m = std::min(least.area_m, distance_to_area_m(map, *area, p));
        }
      }
    }
  }
  for (const flight::FlightState& state : states) {
    check_state(in_air(state, demands.wind), limits, broken);
  }
  const SampledDistances& least = verdict.distances;
  const auto under = [&](const char* name, double value, double demanded) {
    if (!(value >= demanded)) {
      broken.insert(name);
    }
  };
  under("clearance", least.ground_m, demands.required_clearance_m);
  under("wire_clearance", least.wire_m, demands.required_clearance_m);
  under("obstacle_clearance", least.obstacle_m, demands.required_clearance_m);
  if (!(least.area_m > 0.0)) {
    broken.insert("no_fly_area");
  }
  under("share_under_ceiling", low_m / length_m, demands.share_under_ceiling_min - 1e-3);
  const flight::FlightState& begin = states.front();
  const flight::FlightState& end = states.back();
  under("start", demands.start_radius_m,
        std::hypot(begin.x_m - start.x_m, begin.y_m - start.y_m,
                   begin.altitude_m - start.altitude_m));
  under("goal", demands.goal_radius_m, std::hypot(end.x_m - goal.x_m, end.y_m - goal.y_m));
  std::size_t passed = 0;
  for (const geo::MapPoint& point : via) {
    while (passed < samples.size() &&
           std::hypot(samples[passed].x_m - point.x_m, samples[passed].y_m - point.y_m) >
               demands.via_radius_m) {
      ++passed;
    }
  }
  if (!via.empty() && passed >= samples.size()) {
    broken.insert("via");
  }
  verdict.broken.assign(broken.begin(), broken.end());
  return verdict;
}

}  // namespace hedgehop::evaluation
