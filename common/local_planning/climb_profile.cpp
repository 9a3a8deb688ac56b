#include "local_planning/climb_profile.hpp"

#include <algorithm>
#include <cmath>

#include "base/angles.hpp"
#include "base/elementary.hpp"

namespace hedgehop::local_planning {
namespace {

constexpr double kBrakingHelpsAfter_s = 2.0;
constexpr double kNearTarget_m = 50.0;  // nearer, the direction to the target says nothing

double rate_for(double rise_m, double time_s, double climb_rate_mps, double acceleration_mps2,
                double response_s, double rate_max_mps) {
  const double missing_m = rise_m - climb_rate_mps * time_s;
  if (missing_m <= 0.0) {
    return rise_m / time_s;
  }
  const double free_s = time_s - response_s;
  if (free_s <= 0.0) {
    return rate_max_mps;
  }
  const double root_s2 = free_s * free_s - 2.0 * missing_m / acceleration_mps2;
  return root_s2 < 0.0 ? rate_max_mps
                       : climb_rate_mps + acceleration_mps2 * (free_s - std::sqrt(root_s2));
}

}  // namespace

ClimbAhead climb_ahead(const Surroundings& surroundings, const Guide& guide, double along_m,
                       const command_model::ModelState& state, double commanded_heading_math_rad,
                       double look_ahead_m, double safety_height_m,
                       const command_model::CommandModel& model, const ProfileOptions& options) {
  const flight::Limits& limits = model.vehicle().limits;
  const command_model::ModelParameters& constants = model.vehicle().model;
  const double acceleration_mps2 =
      options.acceleration_share * limits.vertical_acceleration_max_mps2;
  const double unlimited_mps = 10.0 * limits.climb_rate_max_mps;
  const double speed_mps = state.speed_mps;
  const double turn_max_radps =
      kGravity_mps2 * elementary::tan(model.bank_command_max_rad()) / speed_mps;
  const double heading_gain_1ps =
      constants.heading_gain_1ps / (1.0 + constants.heading_rate_damping);
  // Share of the turn rate that the bank makes good in one sample.
  const double roll_share = std::min(1.0, options.sample_s * constants.attitude_frequency_radps /
                                              (2.0 * constants.attitude_damping));

  geo::MapPoint place{state.x_m, state.y_m};
  double heading_rad = state.heading_math_rad;
  double turn_rate_radps = kGravity_mps2 * elementary::tan(state.bank_left_rad) / speed_mps;
  double wanted_rad = commanded_heading_math_rad;
  ClimbAhead ahead{-limits.descent_rate_max_mps, -limits.descent_rate_max_mps};
  const int samples = static_cast<int>(options.horizon_s / options.sample_s + 0.5);
  flight::Waypoint target = guide.at(along_m + look_ahead_m);
  double goal_rad = elementary::atan2(target.y_m - place.y_m, target.x_m - place.x_m);
  for (int i = 1; i <= samples; ++i) {
    const double time_s = i * options.sample_s;
    const double wanted_turn_radps = std::clamp(
        heading_gain_1ps * wrap_to_pi(wanted_rad - heading_rad), -turn_max_radps, turn_max_radps);
    const double middle_rad = heading_rad + 0.5 * options.sample_s * turn_rate_radps;
    place.x_m += speed_mps * options.sample_s * elementary::cos(middle_rad);
    place.y_m += speed_mps * options.sample_s * elementary::sin(middle_rad);
    heading_rad += options.sample_s * turn_rate_radps;
    turn_rate_radps += roll_share * (wanted_turn_radps - turn_rate_radps);

    along_m += speed_mps * options.sample_s *
               std::max(0.0, elementary::cos(wrap_to_pi(middle_rad - goal_rad)));
    if (along_m > guide.length_m()) {
      break;
    }
    target = guide.at(along_m + look_ahead_m);
    const double dx_m = target.x_m - place.x_m;
    const double dy_m = target.y_m - place.y_m;
    if (dx_m * dx_m + dy_m * dy_m > kNearTarget_m * kNearTarget_m) {
      const double next_goal_rad = elementary::atan2(dy_m, dx_m);
      wanted_rad += wrap_to_pi(next_goal_rad - goal_rad);
      goal_rad = next_goal_rad;
    }

    const double needed_m = std::max(surroundings.dilated_m(place) + safety_height_m,
                                     guide.at(along_m).altitude_m - options.guide_allowance_m);
    const double rate_mps = rate_for(needed_m - state.altitude_m, time_s, state.climb_rate_mps,
                                     acceleration_mps2, options.response_s, unlimited_mps);
    ahead.climb_rate_mps = std::max(ahead.climb_rate_mps, rate_mps);
    if (time_s >= kBrakingHelpsAfter_s) {
      ahead.shortfall_rate_mps = std::max(ahead.shortfall_rate_mps, rate_mps);
    }
  }
  ahead.climb_rate_mps = std::min(ahead.climb_rate_mps, limits.climb_rate_max_mps);
  return ahead;
}

}  // namespace hedgehop::local_planning
