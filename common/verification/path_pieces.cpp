#include "verification/path_pieces.hpp"

#include <cmath>

#include "base/angles.hpp"
#include "base/elementary.hpp"

namespace hedgehop::verification {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

}  // namespace

bool is_finite(const flight::FlightState& s) {
  for (const double value :
       {s.time_s, s.x_m, s.y_m, s.altitude_m, s.speed_mps, s.heading_true_rad, s.convergence_rad,
        s.bank_rad, s.roll_rate_radps, s.pitch_rad, s.pitch_rate_radps, s.climb_rate_mps,
        s.vertical_acceleration_mps2, s.target_heading_true_rad, s.commanded_heading_true_rad,
        s.commanded_climb_angle_rad, s.commanded_speed_mps, s.surface_m, s.terrain_m}) {
    if (!std::isfinite(value)) {
      return false;
    }
  }
  return true;
}

double distance_m(const geo::MapPoint& a, const geo::MapPoint& b) {
  const double dx_m = a.x_m - b.x_m;
  const double dy_m = a.y_m - b.y_m;
  return std::sqrt(dx_m * dx_m + dy_m * dy_m);
}

Velocity velocity_of(const flight::FlightState& state) {
  const double azimuth_rad =
      grid_from_true_azimuth_rad(state.heading_true_rad, state.convergence_rad);
  return {state.speed_mps * elementary::sin(azimuth_rad),
          state.speed_mps * elementary::cos(azimuth_rad)};
}

double length_of(const Velocity& velocity) {
  return std::sqrt(velocity.x_mps * velocity.x_mps + velocity.y_mps * velocity.y_mps);
}

Sagitta sagitta_of(const flight::FlightState& a, const flight::FlightState& b, double step_s) {
  const Velocity chord{(b.x_m - a.x_m) / step_s, (b.y_m - a.y_m) / step_s};
  const double chord_climb_mps = (b.altitude_m - a.altitude_m) / step_s;
  const auto off_chord_mps = [&](const flight::FlightState& state) {
    const Velocity velocity = velocity_of(state);
    return length_of({velocity.x_mps - chord.x_mps, velocity.y_mps - chord.y_mps});
  };
  return {0.25 * step_s * std::max(off_chord_mps(a), off_chord_mps(b)),
          0.25 * step_s *
              std::max(std::fabs(a.climb_rate_mps - chord_climb_mps),
                       std::fabs(b.climb_rate_mps - chord_climb_mps))};
}

PieceClearance piece_clearance(const raster::Grid<float>& surface_m, const Sweep& sweep,
                               const Sagitta& stray) {
  // The gradient holds up to one cell off the chord; a path that strays farther breaks continuity.
  return {sweep.clearance_min_m - stray.vertical_m -
              sweep.gradient_max * std::min(stray.across_m, surface_m.geometry().cell_m),
          sweep.clearance_min_at};
}

Span span_of(const map::Map& map, const map::OverheadLine& line, std::size_t end) {
  const auto top_of = [&](const map::OverheadLine::Support& support) {
    return PathPoint{support.point.x_m, support.point.y_m,
                     interpolated_height_m(map.terrain_m, support.point) + support.height_m};
  };
  Span span{top_of(line.supports[end - 1]), top_of(line.supports[end]), {}};
  if (!std::isfinite(span.top_a.altitude_m) || !std::isfinite(span.top_b.altitude_m)) {
    span.top_a.altitude_m = kInfinity;  // unknown: as high as may be
    span.top_b.altitude_m = kInfinity;
  }
  span.box.add(line.supports[end - 1].point);
  span.box.add(line.supports[end].point);
  return span;
}

Cylinder cylinder_of(const map::Map& map, const map::Obstacle& obstacle) {
  const double top_m = std::fmax(
      obstacle.top_m, interpolated_height_m(map.terrain_m, obstacle.point) + obstacle.height_m);
  return {obstacle.point.x_m, obstacle.point.y_m, obstacle.radius_m,
          std::isnan(top_m) ? kInfinity : top_m};
}

Box box_of(const map::Area& area) {
  Box box;
  for (const map::Area::Polygon& polygon : area.polygons) {
    for (const geo::MapPoint& corner : polygon.outer) {
      box.add(corner);
    }
  }
  return box;
}

bool needs_ground(const map::Area& area) {
  const auto is_above_ground = [](const map::AreaLimit& limit) {
    return limit.reference == map::AreaLimit::Reference::kAboveGround &&
           std::isfinite(limit.value_m);
  };
  return is_above_ground(area.floor) || is_above_ground(area.ceiling);
}

raster::Grid<float> turned(const raster::Grid<float>& heights_m) {
  raster::Grid<float> turned_m = heights_m;
  for (float& value : turned_m.values()) {
    value = -value;
  }
  return turned_m;
}

HeightRange heights_over(const raster::Grid<float>& surface_m,
                         const raster::Grid<float>& turned_surface_m, const PathPoint& from,
                         const PathPoint& to, double stray_vertical_m) {
  const Sweep low = sweep_surface(surface_m, from, to, 0.0);
  PathPoint turned_from = from;
  PathPoint turned_to = to;
  turned_from.altitude_m = -from.altitude_m;
  turned_to.altitude_m = -to.altitude_m;
  const Sweep high = sweep_surface(turned_surface_m, turned_from, turned_to, 0.0);
  if (!std::isnan(low.unknown_at) || !std::isnan(low.outside_at)) {
    return {kNan, kNan};
  }
  return {low.clearance_min_m - stray_vertical_m, -high.clearance_min_m + stray_vertical_m};
}

}  // namespace hedgehop::verification
