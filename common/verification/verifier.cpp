#include "verification/verifier.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <optional>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "geo/map_projection.hpp"
#include "verification/area_entry.hpp"
#include "verification/cylinder_distance.hpp"
#include "verification/findings.hpp"
#include "verification/path_pieces.hpp"
#include "verification/surface_sweep.hpp"
#include "verification/via_pass.hpp"
#include "verification/wire_distance.hpp"

namespace hedgehop::verification {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// Room for the rounding of numbers that went through files, relative to a limit.
constexpr double kLimitRounding = 1e-6;
constexpr double kTimeRounding_s = 1e-6;
constexpr double kColumnRounding_m = 1e-3;
constexpr double kConvergenceRounding_rad = 1e-6;

// Longer steps leave too much unsaid between two states for any check of what happens there.
constexpr double kStepMax_s = 0.25;

// How two neighbouring states must agree.
//
// A quantity q and its rate f are compared by the trapezoidal rule: dq = h (f0 + f1) / 2. Two
// things may stand between a right trajectory and that rule:
// - the integrator. Explicit or semi-implicit Euler uses f0 or f1 alone, and is off by h |f1 - f0|
// / 2.
//   So is, at most, any method as long as f is monotone within the step. In steady flight this
//   vanishes.
// - the curvature of f within the step, at most h^3 / 12 max |f''|. The bounds below are those of
// the
//   fastest closed-loop response that is worth its name for a helicopter: roll and pitch accelerate
//   with at most 10 rad/s^2 and change that within 1/4 s, climb changes its acceleration within 1/4
//   s.
// A fault larger than the sum is found. At 40 m/s and 50 ms in steady flight that is 0.14 mm of 2 m
// of way, 0.11 mm of altitude and 3e-5 rad of heading.
constexpr double kRollAcceleration_radps2 = 10.0;
constexpr double kResponseTime_s = 0.25;
constexpr double kPositionRounding_m = 1e-5;
constexpr double kAngleRounding_rad = 1e-6;
constexpr double kSpeedRounding_mps = 1e-5;
constexpr double kPowerRounding_mps = 1e-6;

void check_limits(const flight::FlightState& state, const flight::Limits& limits,
                  Findings& findings) {
  const auto at_most = [&](const char* rule, double value, double limit) {
    if (!(value <= limit * (1.0 + kLimitRounding))) {
      findings.add(rule, state, value, limit);
    }
  };
  at_most("bank", std::fabs(state.bank_rad), limits.bank_max_rad);
  at_most("roll_rate", std::fabs(state.roll_rate_radps), limits.roll_rate_max_radps);
  at_most("pitch", std::fabs(state.pitch_rad), limits.pitch_max_rad);
  at_most("climb_rate", state.climb_rate_mps, limits.climb_rate_max_mps);
  at_most("descent_rate", -state.climb_rate_mps, limits.descent_rate_max_mps);
  at_most("vertical_acceleration", std::fabs(state.vertical_acceleration_mps2),
          limits.vertical_acceleration_max_mps2);
  at_most("load_factor", load_factor_of(state), limits.load_factor_max);
  at_most("speed_max", state.speed_mps, limits.speed_max_mps);
  if (!(state.speed_mps >= limits.speed_min_mps * (1.0 - kLimitRounding))) {
    findings.add("speed_min", state, state.speed_mps, limits.speed_min_mps);
  }
}

void check_power(const flight::FlightState& state, const PowerDemand& power, Findings& findings) {
  const flight::VerticalRates rates = rates_by_power(power, state.speed_mps, state.altitude_m);
  if (!(state.climb_rate_mps <= rates.climb_mps + kPowerRounding_mps)) {
    findings.add("climb_power", state, state.climb_rate_mps, rates.climb_mps);
  }
  if (!(-state.climb_rate_mps <= rates.descent_mps + kPowerRounding_mps)) {
    findings.add("descent_power", state, -state.climb_rate_mps, rates.descent_mps);
  }
}

// Columns that say where a state is: what lies below it and where grid north points. `projection`
// may be null, for a map without a coordinate system.
void check_columns(const map::Map& map, const geo::MapProjection* projection,
                   const flight::FlightState& state, Findings& findings) {
  const double surface_m = interpolated_height_m(map.surface_m, state.point());
  const double terrain_m = interpolated_height_m(map.terrain_m, state.point());
  if (!(std::fabs(state.surface_m - surface_m) <= kColumnRounding_m)) {
    findings.add("surface_column", state, state.surface_m, surface_m);
  }
  if (!(std::fabs(state.terrain_m - terrain_m) <= kColumnRounding_m)) {
    findings.add("terrain_column", state, state.terrain_m, terrain_m);
  }
  if (projection != nullptr) {
    const double convergence_rad = projection->convergence_rad(state.point());
    if (!(std::fabs(state.convergence_rad - convergence_rad) <= kConvergenceRounding_rad)) {
      findings.add("convergence_column", state, state.convergence_rad, convergence_rad);
    }
  }
}

// One quantity over one step: its change, its rate at both ends, and the greatest second derivative
// of the rate within the step.
struct Change {
  double change = 0.0;
  double rate_before = 0.0;
  double rate_after = 0.0;
  double rate_curvature = 0.0;
  double rounding = 0.0;
};

void check_change(const char* rule, const flight::FlightState& state, double step_s,
                  const Change& c, Findings& findings) {
  const double residual = c.change - 0.5 * step_s * (c.rate_before + c.rate_after);
  const double tolerance = 0.5 * step_s * std::fabs(c.rate_after - c.rate_before) +
                           step_s * step_s * step_s / 12.0 * c.rate_curvature + c.rounding;
  if (!(std::fabs(residual) <= tolerance)) {
    findings.add(rule, state, std::fabs(residual), tolerance);
  }
}

// Whether two states a step apart belong to one flight. Findings carry the later state's place.
void check_continuity(const flight::FlightState& a, const flight::FlightState& b, double step_s,
                      const flight::Limits& limits, const flight::Wind& wind, Findings& findings) {
  const flight::FlightState air_a = through_air(a, wind);
  const flight::FlightState air_b = through_air(b, wind);
  if (!(std::fabs(b.time_s - a.time_s - step_s) <= kTimeRounding_s)) {
    findings.add("time_step", b, b.time_s - a.time_s, step_s);
  }
  const double tan_a = elementary::tan(a.bank_rad);
  const double tan_b = elementary::tan(b.bank_rad);
  const double tan_bank = std::max(std::fabs(tan_a), std::fabs(tan_b));
  const double speed_mps = std::max(std::min(air_a.speed_mps, air_b.speed_mps), 1.0);
  const double secant_squared = 1.0 + tan_bank * tan_bank;

  // Second derivative of g tan(bank), with roll rate p: g sec^2 (p' + 2 p^2 tan). Divided by speed
  // it is that of the heading rate; changes of speed are slower by an order.
  const double roll_rate_radps =
      std::max(std::fabs(a.roll_rate_radps), std::fabs(b.roll_rate_radps));
  const double turn_curvature_mps4 =
      kGravity_mps2 * secant_squared *
      (kRollAcceleration_radps2 + 2.0 * roll_rate_radps * roll_rate_radps * tan_bank);

  {
    const Velocity before = velocity_of(a);
    const Velocity after = velocity_of(b);
    const double residual_x_m = b.x_m - a.x_m - 0.5 * step_s * (before.x_mps + after.x_mps);
    const double residual_y_m = b.y_m - a.y_m - 0.5 * step_s * (before.y_mps + after.y_mps);
    const double residual_m = std::sqrt(residual_x_m * residual_x_m + residual_y_m * residual_y_m);
    // Jerk in the plane: g sec^2(bank) p across, the turn of the acceleration (g tan)^2 / V, and
    // g q along for a pitch rate q as great as the roll rate may be.
    const double jerk_mps3 = kGravity_mps2 * (secant_squared + 1.0) *
                                 std::max(limits.roll_rate_max_radps, roll_rate_radps) +
                             kGravity_mps2 * kGravity_mps2 * tan_bank * tan_bank / speed_mps;
    const double tolerance_m =
        0.5 * step_s * length_of({after.x_mps - before.x_mps, after.y_mps - before.y_mps}) +
        step_s * step_s * step_s / 12.0 * jerk_mps3 + kPositionRounding_m;
    if (!(residual_m <= tolerance_m)) {
      findings.add("continuity_position", b, residual_m, tolerance_m);
    }
  }

  const double vertical_jerk_mps3 = limits.vertical_acceleration_max_mps2 / kResponseTime_s;
  check_change("continuity_altitude", b, step_s,
               {b.altitude_m - a.altitude_m, a.climb_rate_mps, b.climb_rate_mps, vertical_jerk_mps3,
                kPositionRounding_m},
               findings);
  check_change("continuity_heading", b, step_s,
               {wrap_to_pi(grid_from_true_azimuth_rad(air_b.heading_true_rad, b.convergence_rad) -
                           grid_from_true_azimuth_rad(air_a.heading_true_rad, a.convergence_rad)),
                kGravity_mps2 * tan_a / std::max(air_a.speed_mps, 1.0),
                kGravity_mps2 * tan_b / std::max(air_b.speed_mps, 1.0),
                turn_curvature_mps4 / speed_mps, kAngleRounding_rad},
               findings);
  const double attitude_jerk_radps3 = kRollAcceleration_radps2 / kResponseTime_s;
  check_change("continuity_bank", b, step_s,
               {b.bank_rad - a.bank_rad, a.roll_rate_radps, b.roll_rate_radps, attitude_jerk_radps3,
                kAngleRounding_rad},
               findings);
  check_change("continuity_pitch", b, step_s,
               {b.pitch_rad - a.pitch_rad, a.pitch_rate_radps, b.pitch_rate_radps,
                attitude_jerk_radps3, kAngleRounding_rad},
               findings);

  // The acceleration itself may jump where the command changes, so here its rate is bounded, not
  // its curvature: within a step it leaves the span between its ends by at most h times the rate.
  {
    const double mean_mps2 = 0.5 * (a.vertical_acceleration_mps2 + b.vertical_acceleration_mps2);
    const double residual_mps = b.climb_rate_mps - a.climb_rate_mps - step_s * mean_mps2;
    const double tolerance_mps =
        0.5 * step_s * std::fabs(b.vertical_acceleration_mps2 - a.vertical_acceleration_mps2) +
        0.5 * step_s * step_s * vertical_jerk_mps3 + kSpeedRounding_mps;
    if (!(std::fabs(residual_mps) <= tolerance_mps)) {
      findings.add("continuity_climb_rate", b, std::fabs(residual_mps), tolerance_mps);
    }
  }

  // Rates change no faster than the attitude accelerates; speed no faster than pitch can make it.
  const auto at_most = [&](const char* rule, double change, double limit) {
    if (!(std::fabs(change) <= limit)) {
      findings.add(rule, b, std::fabs(change), limit);
    }
  };
  at_most("continuity_roll_rate", b.roll_rate_radps - a.roll_rate_radps,
          kRollAcceleration_radps2 * step_s + kAngleRounding_rad);
  at_most("continuity_pitch_rate", b.pitch_rate_radps - a.pitch_rate_radps,
          kRollAcceleration_radps2 * step_s + kAngleRounding_rad);
  at_most("continuity_speed", air_b.speed_mps - air_a.speed_mps,
          kGravity_mps2 * elementary::tan(limits.pitch_max_rad) * step_s * (1.0 + kLimitRounding) +
              kSpeedRounding_mps);
}

// The least value for each piece: one finding a piece, however many things meet there.
class LeastByPiece {
 public:
  void add(std::size_t piece, double value) {
    const auto [entry, is_new] = least_.try_emplace(piece, value);
    entry->second = std::min(entry->second, value);
  }
  void tell(const char* rule, const std::vector<flight::FlightState>& states, double limit,
            Findings& findings) const {
    for (const auto& [piece, value] : least_) {
      findings.add(rule, states[piece], value, limit);
    }
  }

 private:
  std::map<std::size_t, double> least_;
};

void check_wires(const map::Map& map, const std::vector<flight::FlightState>& states,
                 const PieceBlocks& pieces, double required_m, Findings& findings) {
  LeastByPiece nearest;
  for (const map::OverheadLine& line : map.overhead_lines) {
    for (std::size_t p = 1; p < line.supports.size(); ++p) {
      const Span span = span_of(map, line, p);
      pieces.visit_near(
          span.box, required_m,
          [&](std::size_t i, const PathPoint& from, const PathPoint& to, const Sagitta& stray) {
            const double clear_m = distance_to_span_m(from, to, span.top_a, span.top_b) -
                                   stray.across_m - stray.vertical_m;
            if (!(clear_m >= required_m)) {
              nearest.add(i, clear_m);
            }
          });
    }
  }
  nearest.tell("wire_clearance", states, required_m, findings);
}

void check_obstacles(const map::Map& map, const std::vector<flight::FlightState>& states,
                     const PieceBlocks& pieces, double required_m, Findings& findings) {
  LeastByPiece nearest;
  for (const map::Obstacle& obstacle : map.obstacles) {
    const Cylinder cylinder = cylinder_of(map, obstacle);
    Box box;
    box.add(obstacle.point);
    pieces.visit_near(
        box, obstacle.radius_m + required_m,
        [&](std::size_t i, const PathPoint& from, const PathPoint& to, const Sagitta& stray) {
          const double clear_m =
              distance_to_cylinder_m(from, to, cylinder) - stray.across_m - stray.vertical_m;
          if (!(clear_m >= required_m)) {
            nearest.add(i, clear_m);
          }
        });
  }
  nearest.tell("obstacle_clearance", states, required_m, findings);
}

// Hard areas that a flight enters. Each piece is asked as a whole, so that an area may be claimed
// by a piece that only comes near its floor or ceiling; pieces are two metres long.
void check_areas(const map::Map& map, const std::vector<flight::FlightState>& states,
                 const PieceBlocks& pieces, Findings& findings) {
  std::optional<raster::Grid<float>> turned_terrain_m;
  LeastByPiece depths;
  for (const map::Area& area : map.areas) {
    if (!area.is_hard) {
      continue;
    }
    const bool is_ground_needed = needs_ground(area);
    if (is_ground_needed && !turned_terrain_m) {
      turned_terrain_m = turned(map.terrain_m);
    }
    pieces.visit_near(
        box_of(area), 0.0,
        [&](std::size_t i, const PathPoint& from, const PathPoint& to, const Sagitta& stray) {
          const auto depth_m = depth_in_area_m(area, from, to, stray.across_m);
          if (!depth_m) {
            return;
          }
          HeightRange altitude{std::min(from.altitude_m, to.altitude_m) - stray.vertical_m,
                               std::max(from.altitude_m, to.altitude_m) + stray.vertical_m};
          const HeightRange height =
              is_ground_needed
                  ? heights_over(map.terrain_m, *turned_terrain_m, from, to, stray.vertical_m)
                  : HeightRange{kNan, kNan};
          if (may_lie_within(area, altitude, height)) {
            depths.add(i, -*depth_m);
          }
        });
  }
  depths.tell("no_fly_area", states, 0.0, findings);
}

// Via points in their order: each must be passed after the one before. Going on from
// where the radius is first entered leaves the most for those that follow.
void check_via(const std::vector<flight::FlightState>& states,
               const std::vector<geo::MapPoint>& via, double radius_m, Findings& findings) {
  std::size_t begin = 0;
  for (const geo::MapPoint& point : via) {
    const Pass pass = first_pass(states, begin, point, radius_m);
    if (!(pass.distance_m <= radius_m)) {
      findings.add("via", states[pass.piece], pass.distance_m, radius_m);
      continue;
    }
    begin = pass.entry;
  }
}

}  // namespace

flight::Wind wind_of(const flight::Conditions& conditions, double convergence_rad) {
  const double to_grid_rad = conditions.wind_from_true_rad - convergence_rad + std::numbers::pi;
  return conditions.wind_mps > 0.0
             ? flight::Wind{conditions.wind_mps * elementary::sin(to_grid_rad),
                            conditions.wind_mps * elementary::cos(to_grid_rad)}
             : flight::Wind{};
}

flight::FlightState through_air(const flight::FlightState& state, const flight::Wind& wind) {
  flight::FlightState result = state;
  if (wind.east_mps != 0.0 || wind.north_mps != 0.0) {
    const Velocity ground = velocity_of(state);
    const Velocity air{ground.x_mps - wind.east_mps, ground.y_mps - wind.north_mps};
    result.speed_mps = length_of(air);
    result.heading_true_rad =
        wrap_to_two_pi(elementary::atan2(air.x_mps, air.y_mps) + state.convergence_rad);
  }
  return result;
}

double load_factor_of(const flight::FlightState& state) {
  const double up = 1.0 + state.vertical_acceleration_mps2 / kGravity_mps2;
  const double across = elementary::tan(state.bank_rad);
  const double along = elementary::tan(state.pitch_rad);
  return std::sqrt(up * up + across * across + along * along);
}

Demands read_demands(ConfigReader& reader) {
  Demands demands;
  demands.required_clearance_m = reader.required_double("required_clearance_m");
  demands.ceiling_height_m = reader.required_double("ceiling_height_m");
  demands.share_under_ceiling_min = reader.required_double("share_under_ceiling_min");
  demands.goal_radius_m = reader.required_double("goal_radius_m");
  demands.start_radius_m = reader.required_double("start_radius_m");
  demands.via_radius_m = reader.required_double("via_radius_m");
  reader.require(demands.required_clearance_m >= 0.0, "required_clearance_m",
                 "must not be negative");
  reader.require(demands.ceiling_height_m > demands.required_clearance_m, "ceiling_height_m",
                 "must be above required_clearance_m");
  reader.require(demands.share_under_ceiling_min >= 0.0 && demands.share_under_ceiling_min <= 1.0,
                 "share_under_ceiling_min", "must lie between 0 and 1");
  reader.require(demands.goal_radius_m > 0.0, "goal_radius_m", "must be above 0");
  reader.require(demands.start_radius_m > 0.0, "start_radius_m", "must be above 0");
  reader.require(demands.via_radius_m > 0.0, "via_radius_m", "must be above 0");
  reader.finish();
  return demands;
}

flight::Verdict verify(const map::Map& map, const flight::Trajectory& trajectory,
                       const flight::Waypoint& start, const std::vector<geo::MapPoint>& via,
                       const flight::Waypoint& goal, const flight::Limits& limits,
                       const Demands& demands) {
  const std::vector<flight::FlightState>& states = trajectory.states;
  const double step_s = trajectory.step_s;
  Findings findings;
  flight::Verdict verdict;
  verdict.clearance_min_m = kNan;
  verdict.clearance_min_place = {kNan, kNan};
  verdict.share_under_ceiling = kNan;
  verdict.goal_distance_m = kNan;
  verdict.speed_min_mps = kNan;
  verdict.speed_max_mps = kNan;
  verdict.bank_max_rad = kNan;
  verdict.roll_rate_max_radps = kNan;
  verdict.climb_rate_max_mps = kNan;
  verdict.descent_rate_max_mps = kNan;

  if (states.size() < 2) {
    findings.add("states", 0.0, start.point(), static_cast<double>(states.size()), 2.0);
  } else if (!(step_s > 0.0 && step_s <= kStepMax_s)) {
    findings.add("time_step", states.front(), step_s, kStepMax_s);
  }
  if (findings.count() > 0) {
    verdict.violation_count = findings.count();
    verdict.violations = findings.worst();
    return verdict;
  }

  std::optional<geo::MapProjection> projection;
  if (!map.crs_wkt.empty()) {
    projection.emplace(map.crs_wkt);
  }
  for (const flight::FlightState& state : states) {
    if (!is_finite(state)) {
      findings.add("finite", state, kNan, 0.0);
      continue;
    }
    const flight::FlightState in_air = through_air(state, demands.wind);
    check_limits(in_air, limits, findings);
    if (demands.power) {
      check_power(in_air, *demands.power, findings);
    }
    if (map.geometry.contains(state.point())) {
      check_columns(map, projection ? &*projection : nullptr, state, findings);
    } else {
      findings.add("outside_map", state, kNan, 0.0);
    }
    // fmax and fmin pass over the NaN that stands for "none yet".
    verdict.bank_max_rad = std::fmax(verdict.bank_max_rad, std::fabs(state.bank_rad));
    verdict.roll_rate_max_radps =
        std::fmax(verdict.roll_rate_max_radps, std::fabs(state.roll_rate_radps));
    verdict.climb_rate_max_mps = std::fmax(verdict.climb_rate_max_mps, state.climb_rate_mps);
    verdict.descent_rate_max_mps = std::fmax(verdict.descent_rate_max_mps, -state.climb_rate_mps);
    verdict.speed_min_mps = std::fmin(verdict.speed_min_mps, in_air.speed_mps);
    verdict.speed_max_mps = std::fmax(verdict.speed_max_mps, in_air.speed_mps);
  }
  if (!(std::fabs(states.front().time_s) <= kTimeRounding_s)) {
    findings.add("time_step", states.front(), states.front().time_s, 0.0);
  }

  double length_m = 0.0;
  double low_m = 0.0;
  for (std::size_t i = 1; i < states.size(); ++i) {
    const flight::FlightState& a = states[i - 1];
    const flight::FlightState& b = states[i];
    if (!is_finite(a) || !is_finite(b)) {
      continue;
    }
    check_continuity(a, b, step_s, limits, demands.wind, findings);

    const Sweep sweep =
        sweep_surface(map.surface_m, path_point(a), path_point(b), demands.ceiling_height_m);
    const double chord_m = distance_m(a.point(), b.point());
    length_m += chord_m;
    low_m += sweep.share_low * chord_m;
    const auto place_at = [&](double t) {
      return geo::MapPoint{a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m)};
    };
    const auto time_at = [&](double t) { return a.time_s + t * (b.time_s - a.time_s); };
    if (!std::isnan(sweep.outside_at)) {
      findings.add("outside_map", time_at(sweep.outside_at), place_at(sweep.outside_at), kNan, 0.0);
    }
    if (!std::isnan(sweep.unknown_at)) {
      findings.add("unknown_surface", time_at(sweep.unknown_at), place_at(sweep.unknown_at), kNan,
                   0.0);
    }
    if (std::isnan(sweep.clearance_min_m)) {
      continue;
    }
    const double clearance_m =
        piece_clearance(map.surface_m, sweep, sagitta_of(a, b, step_s)).least_m;
    const geo::MapPoint place = place_at(sweep.clearance_min_at);
    if (std::isnan(verdict.clearance_min_m) || clearance_m < verdict.clearance_min_m) {
      verdict.clearance_min_m = clearance_m;
      verdict.clearance_min_place = place;
    }
    if (!(clearance_m >= demands.required_clearance_m)) {
      findings.add("clearance", time_at(sweep.clearance_min_at), place, clearance_m,
                   demands.required_clearance_m);
    }
  }
  const PieceBlocks pieces(states, step_s);
  check_wires(map, states, pieces, demands.required_clearance_m, findings);
  check_obstacles(map, states, pieces, demands.required_clearance_m, findings);
  check_areas(map, states, pieces, findings);

  if (length_m > 0.0) {
    verdict.share_under_ceiling = std::min(low_m / length_m, 1.0);
  }
  if (!(verdict.share_under_ceiling >= demands.share_under_ceiling_min)) {
    findings.add("share_under_ceiling", states.back(), verdict.share_under_ceiling,
                 demands.share_under_ceiling_min);
  }

  const flight::FlightState& first = states.front();
  const double start_horizontal_m = distance_m(first.point(), start.point());
  const double start_vertical_m = first.altitude_m - start.altitude_m;
  const double start_m =
      std::sqrt(start_horizontal_m * start_horizontal_m + start_vertical_m * start_vertical_m);
  if (!(start_m <= demands.start_radius_m)) {
    findings.add("start", first, start_m, demands.start_radius_m);
  }
  verdict.goal_distance_m = distance_m(states.back().point(), goal.point());
  if (!(verdict.goal_distance_m <= demands.goal_radius_m)) {
    findings.add("goal", states.back(), verdict.goal_distance_m, demands.goal_radius_m);
  }

  check_via(states, via, demands.via_radius_m, findings);

  verdict.violation_count = findings.count();
  verdict.violations = findings.worst();
  verdict.is_verified = verdict.violation_count == 0;
  return verdict;
}

}  // namespace hedgehop::verification
