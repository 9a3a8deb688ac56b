#include "verification/margins.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "verification/area_entry.hpp"
#include "verification/cylinder_distance.hpp"
#include "verification/path_pieces.hpp"
#include "verification/surface_sweep.hpp"
#include "verification/via_pass.hpp"
#include "verification/wire_distance.hpp"

namespace hedgehop::verification {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
// Things farther off are not looked for: nobody asks how far away the next mast is.
constexpr double kReach_m = 2000.0;

struct Weighted {
  double clearance_m = 0.0;
  double length_m = 0.0;
};

// The least clearance that at least `share` of the length does not exceed.
double quantile(const std::vector<Weighted>& sorted, double total_m, double share) {
  double passed_m = 0.0;
  for (const Weighted& piece : sorted) {
    passed_m += piece.length_m;
    if (passed_m >= share * total_m) {
      return piece.clearance_m;
    }
  }
  return sorted.empty() ? kNan : sorted.back().clearance_m;
}

class Nearest {
 public:
  Nearest(Hazard hazard, double required_m, const std::vector<flight::FlightState>& states)
      : states_(states) {
    miss_.hazard = hazard;
    miss_.required_m = required_m;
    miss_.distance_m = kReach_m;
  }
  [[nodiscard]] double distance_m() const { return miss_.distance_m; }
  void add(std::size_t piece, double distance_m, const std::string& name) {
    distance_m = std::max(distance_m, 0.0);
    if (distance_m < miss_.distance_m) {
      miss_.distance_m = distance_m;
      miss_.name = name;
      miss_.time_s = states_[piece].time_s;
      miss_.place = states_[piece].point();
      miss_.altitude_m = states_[piece].altitude_m;
    }
  }
  void tell(std::vector<NearMiss>& nearest) const {
    if (miss_.distance_m < kReach_m) {
      nearest.push_back(miss_);
    }
  }

 private:
  const std::vector<flight::FlightState>& states_;
  NearMiss miss_;
};

void measure_wires(const map::Map& map, const PieceBlocks& pieces, Nearest& nearest) {
  for (const map::OverheadLine& line : map.overhead_lines) {
    for (std::size_t end = 1; end < line.supports.size(); ++end) {
      const Span span = span_of(map, line, end);
      pieces.visit_near(
          span.box, nearest.distance_m(),
          [&](std::size_t i, const PathPoint& from, const PathPoint& to, const Sagitta& stray) {
            nearest.add(i,
                        distance_to_span_m(from, to, span.top_a, span.top_b) - stray.across_m -
                            stray.vertical_m,
                        std::to_string(line.source_id));
          });
    }
  }
}

void measure_obstacles(const map::Map& map, const PieceBlocks& pieces, Nearest& nearest) {
  for (const map::Obstacle& obstacle : map.obstacles) {
    const Cylinder cylinder = cylinder_of(map, obstacle);
    Box box;
    box.add(obstacle.point);
    pieces.visit_near(
        box, obstacle.radius_m + nearest.distance_m(),
        [&](std::size_t i, const PathPoint& from, const PathPoint& to, const Sagitta& stray) {
          nearest.add(
              i, distance_to_cylinder_m(from, to, cylinder) - stray.across_m - stray.vertical_m,
              obstacle.name.empty() ? std::to_string(obstacle.source_id) : obstacle.name);
        });
  }
}

void measure_areas(const map::Map& map, const PieceBlocks& pieces, Nearest& nearest) {
  std::optional<raster::Grid<float>> turned_terrain_m;
  for (const map::Area& area : map.areas) {
    if (!area.is_hard) {
      continue;
    }
    const bool is_ground_needed = needs_ground(area);
    if (is_ground_needed && !turned_terrain_m) {
      turned_terrain_m = turned(map.terrain_m);
    }
    pieces.visit_near(
        box_of(area), nearest.distance_m(),
        [&](std::size_t i, const PathPoint& from, const PathPoint& to, const Sagitta& stray) {
          const double aside_m =
              std::max(distance_to_polygons_m(area, from, to) - stray.across_m, 0.0);
          if (!(aside_m < nearest.distance_m())) {
            return;
          }
          const HeightRange altitude{std::min(from.altitude_m, to.altitude_m) - stray.vertical_m,
                                     std::max(from.altitude_m, to.altitude_m) + stray.vertical_m};
          const HeightRange height =
              is_ground_needed
                  ? heights_over(map.terrain_m, *turned_terrain_m, from, to, stray.vertical_m)
                  : HeightRange{kNan, kNan};
          const double off_m = distance_to_band_m(area, altitude, height);
          nearest.add(i, std::sqrt(aside_m * aside_m + off_m * off_m), area.name);
        });
  }
}

}  // namespace

const char* name_of(Hazard hazard) {
  switch (hazard) {
    case Hazard::kGround:
      return "ground";
    case Hazard::kWire:
      return "wire";
    case Hazard::kObstacle:
      return "obstacle";
    case Hazard::kArea:
      return "area";
  }
  return "";
}

const NearMiss* Margins::nearest_miss() const {
  const auto least = std::min_element(
      nearest.begin(), nearest.end(),
      [](const NearMiss& a, const NearMiss& b) { return a.spare_m() < b.spare_m(); });
  return least == nearest.end() ? nullptr : &*least;
}

Margins measure_margins(const map::Map& map, const flight::Trajectory& trajectory,
                        const std::vector<geo::MapPoint>& via, const flight::Limits& limits,
                        const Demands& demands) {
  const std::vector<flight::FlightState>& states = trajectory.states;
  Margins margins;
  margins.clearance_min_m = kNan;
  margins.height_max_m = kNan;
  margins.load_factor_max = kNan;
  margins.load_factor_limit = limits.load_factor_max;
  const raster::Grid<float> turned_surface_m = turned(map.surface_m);
  std::vector<Weighted> clearances;
  double known_m = 0.0;
  double unknown_m = 0.0;
  NearMiss ground;
  ground.required_m = demands.required_clearance_m;
  for (std::size_t i = 1; i < states.size(); ++i) {
    const flight::FlightState& a = states[i - 1];
    const flight::FlightState& b = states[i];
    if (!is_finite(a) || !is_finite(b)) {
      continue;
    }
    margins.load_factor_max =
        std::fmax(margins.load_factor_max, std::max(load_factor_of(a), load_factor_of(b)));
    const double length_m = distance_m(a.point(), b.point());
    const Sagitta stray = sagitta_of(a, b, trajectory.step_s);
    const Sweep sweep = sweep_surface(map.surface_m, path_point(a), path_point(b), 0.0);
    const PieceClearance clearance = piece_clearance(map.surface_m, sweep, stray);
    if (std::isnan(clearance.least_m) || !std::isnan(sweep.unknown_at) ||
        !std::isnan(sweep.outside_at)) {
      unknown_m += length_m;
      continue;
    }
    known_m += length_m;
    clearances.push_back({clearance.least_m, length_m});
    if (!(clearance.least_m >= margins.clearance_min_m)) {
      margins.clearance_min_m = clearance.least_m;
      const double t = clearance.at;
      ground.distance_m = clearance.least_m;
      ground.time_s = a.time_s + t * (b.time_s - a.time_s);
      ground.place = {a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m)};
      ground.altitude_m = a.altitude_m + t * (b.altitude_m - a.altitude_m);
    }
    const HeightRange heights = heights_over(
        map.surface_m, turned_surface_m, path_point(a), path_point(b),
        stray.vertical_m + sweep.gradient_max * std::min(stray.across_m, map.geometry.cell_m));
    margins.height_max_m = std::fmax(margins.height_max_m, heights.high_m);
  }
  margins.ceiling_margin_m = demands.ceiling_height_m - margins.height_max_m;
  margins.unknown_share = known_m + unknown_m > 0.0 ? unknown_m / (known_m + unknown_m) : kNan;
  std::sort(clearances.begin(), clearances.end(),
            [](const Weighted& a, const Weighted& b) { return a.clearance_m < b.clearance_m; });
  margins.clearance_p01_m = quantile(clearances, known_m, 0.01);
  margins.clearance_p05_m = quantile(clearances, known_m, 0.05);
  margins.clearance_median_m = quantile(clearances, known_m, 0.5);
  if (!clearances.empty()) {
    margins.nearest.push_back(ground);
  }
  const PieceBlocks pieces(states, trajectory.step_s);
  Nearest wire(Hazard::kWire, demands.required_clearance_m, states);
  measure_wires(map, pieces, wire);
  wire.tell(margins.nearest);
  Nearest obstacle(Hazard::kObstacle, demands.required_clearance_m, states);
  measure_obstacles(map, pieces, obstacle);
  obstacle.tell(margins.nearest);
  Nearest area(Hazard::kArea, 0.0, states);
  measure_areas(map, pieces, area);
  area.tell(margins.nearest);

  std::size_t begin = 0;
  for (const geo::MapPoint& point : via) {
    const Pass pass = first_pass(states, begin, point, demands.via_radius_m);
    margins.via.push_back({pass.distance_m, states[pass.piece].time_s});
    if (pass.distance_m <= demands.via_radius_m) {
      begin = pass.entry;
    }
  }
  return margins;
}

}  // namespace hedgehop::verification
