#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/angles.hpp"
#include "flight/plan.hpp"
#include "geo/map_projection.hpp"
#include "map/map.hpp"
#include "raster/grid.hpp"
#include "support/test_map.hpp"
#include "support/utm_map.hpp"

namespace hedgehop::test {

/// Hills of 12 km x 9 km with a CRS, a few patches of each class and a power line.
inline map::Map make_sample_map() {
  constexpr double kWest_m = 700000.0;
  constexpr double kSouth_m = 5530000.0;
  map::Map map = make_map(400, 300, 30.0, [](double x_m, double y_m) {
    return 480.0 + 110.0 * std::sin(x_m / 900.0) * std::cos(y_m / 1100.0) +
           60.0 * std::sin((x_m + 2.0 * y_m) / 2100.0) + 8.0 * std::sin(x_m / 170.0);
  });
  place_in_utm(map, kWest_m, kSouth_m);
  map.vertical_datum = "EGM96";
  map.label = "SYNTHETIC REGION";
  map.attributions = {"Hills made of sines, not a real place"};
  const auto bit = [](map::SemanticClass c) { return static_cast<std::uint16_t>(c); };
  for (int row = 0; row < map.geometry.rows; ++row) {
    for (int column = 0; column < map.geometry.columns; ++column) {
      const double u = column / 400.0;
      const double v = row / 300.0;
      const double town = std::hypot(column - 210.0, row - 120.0);
      std::uint16_t bits = 0;
      if (std::sin(9.0 * u) * std::sin(11.0 * v) > 0.35) {
        bits |= bit(map::SemanticClass::kForest);
        map.surface_m.at(column, row) += 18.0F;
      }
      if (town < 35.0) {
        bits |= bit(map::SemanticClass::kSettlementDesired);
      }
      if (town < 28.0) {
        bits |= bit(map::SemanticClass::kSettlementAdequate);
      }
      if (town < 21.0) {
        bits |= bit(map::SemanticClass::kSettlement);
        bits |= bit(map::SemanticClass::kBuiltUpArea);
        map.surface_m.at(column, row) += 8.0F;
      }
      if (std::abs(row - 240) < 3) {
        bits |= bit(map::SemanticClass::kWater);
      }
      map.semantics.at(column, row) = bits;
      map.visibility.at(column, row) =
          column < 3 ? map::kVisibilityUnknown
                     : stored_visibility(std::clamp(
                           (static_cast<double>(map.terrain_m.at(column, row)) - 330.0) / 700.0,
                           0.0, 1.0));
    }
  }
  map.overhead_lines.push_back({17,
                                {{{kWest_m + 3000.0, kSouth_m + 500.0}, 40.0},
                                 {{kWest_m + 4200.0, kSouth_m + 4500.0}, 45.0},
                                 {{kWest_m + 4500.0, kSouth_m + 8500.0}, 42.0}}});
  finish_map(map);
  return map;
}

/// A made-up but plausible flight across a map, from 8 % to 92 % of its width: route along a sine,
/// flown a little smoother, with each field of a plan set.
inline flight::Plan make_sample_plan(const map::Map& map) {
  const raster::GridGeometry& g = map.geometry;
  const double width_m = g.columns * g.cell_m;
  const double height_m = g.rows * g.cell_m;
  const geo::MapProjection projection(map.crs_wkt);
  const auto y_at = [&](double t) {
    return g.south_m + height_m * (0.45 + 0.22 * std::sin(7.0 * t) + 0.06 * std::sin(19.0 * t));
  };
  const auto x_at = [&](double t) { return g.west_m + width_m * (0.08 + 0.84 * t); };

  flight::Plan plan;
  flight::RoutePlan& route_plan = plan.route_plan;
  for (int i = 0; i <= 24; ++i) {
    const double t = i / 24.0;
    const geo::MapPoint point{x_at(t), y_at(t)};
    route_plan.route.waypoints.push_back(
        {point.x_m, point.y_m, raster::max_within(map.surface_m, point, 120.0) + 30.0});
  }
  const auto& waypoints = route_plan.route.waypoints;
  for (std::size_t i = 1; i < waypoints.size(); ++i) {
    for (int k = 0; k < 10; ++k) {
      const double t = k / 10.0;
      const auto mix = [t](double a, double b) { return a + t * (b - a); };
      route_plan.route.guide.push_back({mix(waypoints[i - 1].x_m, waypoints[i].x_m),
                                        mix(waypoints[i - 1].y_m, waypoints[i].y_m),
                                        mix(waypoints[i - 1].altitude_m, waypoints[i].altitude_m)});
    }
  }
  route_plan.route.guide.push_back(waypoints.back());
  route_plan.route.guide_spacing_m = 50.25;
  route_plan.route.cost = {12345.678, 2345.5, 345.25, 45.125};
  route_plan.route.lower_bound_m = 11111.25;
  route_plan.route.work_units = 400001;
  route_plan.route.samples = 12001;
  route_plan.route.batches = 12;
  route_plan.start = waypoints.front();
  route_plan.goal = waypoints.back();

  constexpr double kStep_s = 0.05;
  constexpr double kSpeed_mps = 40.0;
  double t = 0.0;
  double before_rad = std::numeric_limits<double>::quiet_NaN();
  double altitude_m = waypoints.front().altitude_m;
  for (int i = 0; t < 1.0; ++i) {
    const geo::MapPoint point{x_at(t), y_at(t) + 60.0 * std::sin(31.0 * t) * std::sin(3.0 * t)};
    const double next = t + 1e-5;
    const geo::MapPoint ahead{x_at(next),
                              y_at(next) + 60.0 * std::sin(31.0 * next) * std::sin(3.0 * next)};
    const double dx_m = ahead.x_m - point.x_m;
    const double dy_m = ahead.y_m - point.y_m;
    flight::FlightState state;
    state.time_s = i * kStep_s;
    state.x_m = point.x_m;
    state.y_m = point.y_m;
    state.surface_m = raster::sample_bilinear(map.surface_m, point);
    state.terrain_m = raster::sample_bilinear(map.terrain_m, point);
    const double wanted_m =
        raster::max_within(map.surface_m, {ahead.x_m + dx_m * 2e5 * 0.012, ahead.y_m}, 90.0) + 22.0;
    const double climb_mps = std::clamp(0.35 * (wanted_m - altitude_m), -6.0, 7.0);
    altitude_m = std::max(altitude_m + climb_mps * kStep_s, state.surface_m + 12.0);
    state.altitude_m = altitude_m;
    state.speed_mps = kSpeed_mps;
    state.convergence_rad = projection.convergence_rad(point);
    state.heading_true_rad = true_from_grid_azimuth_rad(
        azimuth_from_math_angle_rad(std::atan2(dy_m, dx_m)), state.convergence_rad);
    const double turn_radps =
        std::isnan(before_rad) ? 0.0 : wrap_to_pi(state.heading_true_rad - before_rad) / kStep_s;
    before_rad = state.heading_true_rad;
    state.bank_rad = std::atan(kSpeed_mps * turn_radps / kGravity_mps2);
    state.roll_rate_radps = 0.01 * std::sin(0.1 * i);
    state.pitch_rad = 0.02 * std::sin(0.02 * i);
    state.pitch_rate_radps = 0.003 * std::cos(0.02 * i);
    state.climb_rate_mps = climb_mps;
    state.vertical_acceleration_mps2 = 0.1 * std::sin(0.05 * i);
    state.target_heading_true_rad =
        wrap_to_two_pi(state.heading_true_rad + 0.25 * std::sin(0.013 * i));
    state.commanded_heading_true_rad =
        wrap_to_two_pi(state.heading_true_rad + 0.1 * std::sin(0.013 * i + 0.3));
    state.commanded_climb_angle_rad = std::atan(climb_mps / kSpeed_mps);
    state.commanded_speed_mps = 40.5;
    plan.trajectory.states.push_back(state);
    t += 1e-5 * kSpeed_mps * kStep_s / std::hypot(dx_m, dy_m);
  }
  plan.trajectory.step_s = kStep_s;

  const auto position = [&](const flight::Waypoint& waypoint) {
    return projection.to_geodetic(waypoint.point());
  };
  route_plan.request.start = {position(route_plan.start), 31.5};
  route_plan.request.goal = {position(route_plan.goal), std::nullopt};
  route_plan.request.via = {{position(waypoints[7]), 40.0}, {position(waypoints[11]), {}}};
  route_plan.request.start_heading_true_rad = 1.2345678901234567;
  route_plan.request.speed_mps = 41.0;
  route_plan.request.seed = 18446744073709551615ULL;
  route_plan.request.work_budget = 123456789012345;
  route_plan.config_text = "speed_mps: 40\nweights: {visibility: 25, \"quote\": '\xc3\xa4'}\n";
  route_plan.map = {map.hash, 7, map.crs_wkt, map.vertical_datum, map.label, map.attributions};
  route_plan.request_id =
      flight::plan_request_id(route_plan.request, map.hash, route_plan.config_text);

  plan.measures = {12001.5, 300.05, 2001.25, 333.125, 1234.5, 31.0625, 97.5, 0.9875};
  plan.decisions = 6001;
  plan.infeasible_decisions = 3;
  plan.verdict.is_verified = false;
  plan.verdict.violation_count = 2;
  plan.verdict.violations = {{"clearance", 12.35, {700123.5, 5530456.25}, 9.5, 10.0},
                             {"bank", 77.05, {700999.5, 5530999.25}, 0.61, 0.6}};
  plan.verdict.clearance_min_m = 9.5;
  plan.verdict.clearance_min_place = {700123.5, 5530456.25};
  plan.verdict.bank_max_rad = 0.61;
  plan.verdict.roll_rate_max_radps = 0.31;
  plan.verdict.climb_rate_max_mps = 6.9;
  plan.verdict.descent_rate_max_mps = 5.9;
  plan.verdict.speed_min_mps = 39.5;
  plan.verdict.speed_max_mps = 40.75;
  plan.verdict.share_under_ceiling = 0.96875;
  plan.verdict.goal_distance_m = 12.125;
  plan.warnings = {"one warning", "another <one> & \"quoted\""};
  return plan;
}

}  // namespace hedgehop::test
