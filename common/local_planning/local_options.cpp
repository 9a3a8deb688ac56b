#include <algorithm>
#include <numbers>
#include <string>

#include "base/angles.hpp"
#include "local_planning/local_planner.hpp"

namespace hedgehop::local_planning {
namespace {

double number_in(ConfigReader& reader, const char* key, double low, double high,
                 const char* demand) {
  const double value = reader.required_double(key);
  reader.require(value >= low && value <= high, key, demand);
  return value;
}

double positive(ConfigReader& reader, const char* key) {
  const double value = reader.required_double(key);
  reader.require(value > 0.0 && value <= 1e6, key, "must be above 0 and at most 1e6");
  return value;
}

double not_negative(ConfigReader& reader, const char* key) {
  return number_in(reader, key, 0.0, 1e6, "must lie between 0 and 1e6");
}

int whole_number(ConfigReader& reader, const char* key, int low, int high, const char* demand) {
  const std::int64_t value = reader.required_integer(key);
  reader.require(value >= low && value <= high, key, demand);
  return static_cast<int>(value);
}

DirectionWeights read_direction_weights(ConfigReader& reader, LocalOptions& options) {
  DirectionWeights weights;
  const std::string goal_cost = reader.required_string("goal_cost");
  reader.require(goal_cost == "quadratic" || goal_cost == "absolute", "goal_cost",
                 "must be quadratic or absolute");
  weights.goal_cost = goal_cost == "quadratic" ? GoalCost::kQuadratic : GoalCost::kAbsolute;
  weights.goal = positive(reader, "goal");
  options.semantics_weight = not_negative(reader, "semantics");
  options.visibility_weight = not_negative(reader, "visibility");
  weights.climb = not_negative(reader, "climb");
  weights.climb_relative = not_negative(reader, "climb_relative");
  weights.polar_offset_rad3 = positive(reader, "polar_offset_rad3");
  reader.finish();
  return weights;
}

IndicatorOptions read_indicator(ConfigReader& reader) {
  IndicatorOptions options;
  options.inertia = positive(reader, "inertia");
  options.spring_1ps2 = positive(reader, "spring_1ps2");
  options.damping_1ps = not_negative(reader, "damping_1ps");
  options.relative_damping_1ps = not_negative(reader, "relative_damping_1ps");
  options.relative_spring_1ps2 = not_negative(reader, "relative_spring_1ps2");
  reader.finish();
  return options;
}

ProfileOptions read_climb_ahead(ConfigReader& reader) {
  ProfileOptions options;
  options.is_used = reader.required_bool("use");
  options.horizon_s = number_in(reader, "horizon_s", 1.0, 60.0, "must lie between 1 and 60");
  options.sample_s = number_in(reader, "sample_s", 0.05, 2.0, "must lie between 0.05 and 2");
  options.response_s = number_in(reader, "response_s", 0.0, 5.0, "must lie between 0 and 5");
  options.acceleration_share =
      number_in(reader, "acceleration_share", 0.1, 1.0, "must lie between 0.1 and 1");
  options.guide_allowance_m = not_negative(reader, "guide_allowance_m");
  reader.finish();
  return options;
}

RolloutOptions read_rollout(ConfigReader& reader) {
  RolloutOptions options;
  options.horizon_s = number_in(reader, "horizon_s", 4.0, 60.0, "must lie between 4 and 60");
  options.sample_s = number_in(reader, "sample_s", 0.1, 0.5, "must lie between 0.1 and 0.5");
  options.reach_rad = reader.required_angle("reach_deg");
  reader.require(options.reach_rad >= 30.0 * kDegree_rad && options.reach_rad <= std::numbers::pi,
                 "reach_deg", "must lie between 30 and 180");
  options.lag_s = number_in(reader, "lag_s", 0.0, 3.0, "must lie between 0 and 3");
  options.gain = not_negative(reader, "gain");
  options.change_1prad = not_negative(reader, "change_1prad");
  options.tree_depth = whole_number(reader, "tree_depth", 1, 4, "must lie between 1 and 4");
  options.branch_s =
      number_in(reader, "branch_s", 0.5, options.horizon_s, "must lie between 0.5 and horizon_s");
  options.later_weight =
      number_in(reader, "later_weight", 0.01, 10.0, "must lie between 0.01 and 10");
  reader.finish();
  return options;
}

RolloutEscapeOptions read_rollout_escape(ConfigReader& reader) {
  RolloutEscapeOptions options;
  options.is_used = reader.required_bool("use");
  options.clearance_m = positive(reader, "clearance_m");
  options.lateral_margin_m =
      number_in(reader, "lateral_margin_m", 0.0, 500.0, "must lie between 0 and 500");
  options.back_s = number_in(reader, "back_s", 1.0, 600.0, "must lie between 1 and 600");
  options.time_max_s = number_in(reader, "time_max_s", 1.0, 600.0, "must lie between 1 and 600");
  reader.finish();
  return options;
}

VerticalPassOptions read_vertical_pass(ConfigReader& reader) {
  VerticalPassOptions options;
  options.is_used = reader.required_bool("use");
  options.knot_s = number_in(reader, "knot_s", 0.05, 2.0, "must lie between 0.05 and 2");
  options.clearance_m = positive(reader, "clearance_m");
  options.lateral_margin_m =
      number_in(reader, "lateral_margin_m", 0.0, 500.0, "must lie between 0 and 500");
  options.acceleration_share =
      number_in(reader, "acceleration_share", 0.1, 1.0, "must lie between 0.1 and 1");
  options.rate_share = number_in(reader, "rate_share", 0.1, 1.0, "must lie between 0.1 and 1");
  reader.finish();
  return options;
}

SphericalOptions read_spherical(ConfigReader& reader) {
  SphericalOptions options;
  options.elevation_step_rad = reader.required_angle("elevation_step_deg");
  options.goal = positive(reader, "goal");
  options.heading = not_negative(reader, "heading");
  options.before = not_negative(reader, "before");
  reader.require(options.elevation_step_rad >= 0.1 * kDegree_rad &&
                     options.elevation_step_rad <= 30.0 * kDegree_rad,
                 "elevation_step_deg", "must lie between 0.1 and 30");
  reader.finish();
  return options;
}

}  // namespace

LocalOptions read_local_options(ConfigReader& reader) {
  LocalOptions options;
  const std::string mode = reader.required_string("mode");
  reader.require(mode == "tvfh" || mode == "rollout" || mode == "vfh_3d", "mode",
                 "must be tvfh, rollout or vfh_3d");
  options.mode = mode == "tvfh"      ? LocalMode::kTvfh
                 : mode == "rollout" ? LocalMode::kRollout
                                     : LocalMode::kVfh3d;
  options.step_s = number_in(reader, "step_s", 0.001, 0.2, "must lie between 0.001 and 0.2");
  options.window_m = number_in(reader, "window_m", 50.0, 20000.0, "must lie between 50 and 20000");
  options.sectors = whole_number(reader, "sectors", 8, 1024, "must lie between 8 and 1024");
  options.safety_radius_m = not_negative(reader, "safety_radius_m");
  options.safety_height_m = positive(reader, "safety_height_m");
  options.near_distance_m = positive(reader, "near_distance_m");
  options.truncation_angle_rad = reader.required_angle("truncation_angle_deg");
  options.truncation_distance_m = not_negative(reader, "truncation_distance_m");
  options.arc_radius_max_factor =
      number_in(reader, "arc_radius_max_factor", 1.0, 1000.0, "must lie between 1 and 1000");
  options.is_arc_widened = reader.required_bool("widen_arc_bounds");
  options.climb_share = number_in(reader, "climb_share", 0.1, 1.0, "must lie between 0.1 and 1");
  options.climb_angle_min_rad = reader.required_angle("climb_angle_min_deg");
  options.look_ahead_m = positive(reader, "look_ahead_m");
  options.projection_back_m = not_negative(reader, "projection_back_m");
  options.projection_ahead_m = positive(reader, "projection_ahead_m");
  options.corridor_m = positive(reader, "corridor_m");
  options.goal_only_distance_m = not_negative(reader, "goal_only_distance_m");
  options.goal_radius_m = positive(reader, "goal_radius_m");
  options.slow_speed_mps = positive(reader, "slow_speed_mps");
  options.length_factor_max =
      number_in(reader, "length_factor_max", 1.0, 100.0, "must lie between 1 and 100");
  options.passes = whole_number(reader, "passes", 1, 20, "must lie between 1 and 20");
  options.window_shrink_m = not_negative(reader, "window_shrink_m");
  reader.require(options.window_m - (options.passes - 1) * options.window_shrink_m >= 50.0,
                 "window_shrink_m", "leaves less than 50 m of the window in the last pass");
  reader.require(options.safety_radius_m < options.window_m, "safety_radius_m",
                 "must be below window_m");
  reader.require(options.truncation_angle_rad >= 60.0 * kDegree_rad &&
                     options.truncation_angle_rad <= std::numbers::pi,
                 "truncation_angle_deg", "must lie between 60 and 180");
  reader.require(options.climb_angle_min_rad < 0.0 && options.climb_angle_min_rad > -1.0,
                 "climb_angle_min_deg", "must lie between -57 and 0");
  const std::string steering = reader.required_string("steering");
  reader.require(steering == "torque" || steering == "cheapest" || steering == "openings",
                 "steering", "must be torque, cheapest or openings");
  options.steering = steering == "torque"     ? Steering::kTorque
                     : steering == "cheapest" ? Steering::kCheapest
                                              : Steering::kOpenings;
  options.repulsion_width_rad = reader.required_angle("repulsion_width_deg");
  reader.require(options.repulsion_width_rad >= 1.0 * kDegree_rad &&
                     options.repulsion_width_rad <= std::numbers::pi,
                 "repulsion_width_deg", "must lie between 1 and 180");
  options.opening_wide_rad = reader.required_angle("opening_wide_deg");
  reader.require(options.opening_wide_rad >= 0.0 && options.opening_wide_rad <= std::numbers::pi,
                 "opening_wide_deg", "must lie between 0 and 180");
  ConfigReader weights = reader.required_section("weights");
  options.weights = read_direction_weights(weights, options);
  ConfigReader heading = reader.required_section("heading_indicator");
  options.heading_indicator = read_indicator(heading);
  ConfigReader climb = reader.required_section("climb_indicator");
  options.climb_indicator = read_indicator(climb);
  ConfigReader rollout = reader.required_section("rollout");
  options.rollout = read_rollout(rollout);
  ConfigReader rollout_escape = reader.required_section("rollout_escape");
  options.rollout_escape = read_rollout_escape(rollout_escape);
  ConfigReader spherical = reader.required_section("vfh_3d");
  options.vfh_3d = read_spherical(spherical);
  ConfigReader ahead = reader.required_section("climb_ahead");
  options.climb_ahead = read_climb_ahead(ahead);
  ConfigReader vertical = reader.required_section("vertical_pass");
  options.vertical_pass = read_vertical_pass(vertical);
  options.is_compared_with_following = reader.required_bool("compare_with_following");
  options.bank_weight_1prad = not_negative(reader, "bank_weight_1prad");
  options.retry_speeds_mps = reader.required_doubles("retry_speeds_mps");
  reader.require(std::is_sorted(options.retry_speeds_mps.rbegin(), options.retry_speeds_mps.rend()),
                 "retry_speeds_mps", "must descend");
  for (const double speed_mps : options.retry_speeds_mps) {
    reader.require(speed_mps > 0.0 && speed_mps <= 1000.0, "retry_speeds_mps",
                   "must lie between 0 and 1000");
  }
  reader.finish();
  return options;
}

}  // namespace hedgehop::local_planning
