#include "local_planning/rollout.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/angles.hpp"

namespace hedgehop::local_planning {
namespace {

constexpr float kNothing = -std::numeric_limits<float>::infinity();
constexpr int kSamplesMin = 4;

ProfileOptions over_horizon(ProfileOptions profile, const RolloutOptions& options) {
  profile.horizon_s = options.horizon_s;
  profile.sample_s = options.sample_s;
  return profile;
}

// From the guide's table, like the kernel's.
float between(const float* table, float at, int count) {
  const float whole = std::min(std::floor(at), static_cast<float>(count - 2));
  const auto index = static_cast<std::size_t>(whole);
  return table[2 * index] + (at - whole) * (table[2 * index + 2] - table[2 * index]);
}

float away(float a_rad, float b_rad) {
  const float difference_rad = std::fabs(a_rad - b_rad);
  return std::fabs(std::min(difference_rad, kTwoPi_f - difference_rad));
}

// One path; returns the rises of its samples.
void roll_out(RolloutTask& task, int candidate, const std::vector<float>& bend,
              std::vector<float>& rises) {
  const ForecastTask& path = task.path;
  const float turn_max = path.roll_share * path.turn_max_radps;
  const float pull = path.roll_share * path.gain;
  const float keep = 1.0F - path.roll_share;
  const float half_s = 0.5F * path.sample_s;
  float heading = 0.0F;
  float turn = path.turn_radps;
  float turn_before = 0.0F;
  float east = path.east_cells;
  float north = path.north_cells;
  float x = path.part_of_column;
  float y = path.part_of_row;
  float risk = 0.0F;
  float needed = kNothing;
  float near = kNothing;
  for (int i = 0; i < path.samples; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const float off = task.wanted_rad[candidate] + bend[at] - heading;
    const float wanted_turn = std::min(std::max(pull * off, -turn_max), turn_max);
    const float angle = half_s * (turn + turn_before);
    heading += path.sample_s * turn;
    turn_before = turn;
    turn = keep * turn + wanted_turn;
    const float angle2 = angle * angle;
    const float sine = angle * (1.0F - angle2 * (1.0F / 6.0F));
    const float cosine = 1.0F - angle2 * (0.5F - angle2 * (1.0F / 24.0F));
    const float turned_east = east * cosine - north * sine;
    north = east * sine + north * cosine;
    east = turned_east;
    x = x + east + path.drift_east_cells;
    y = y + north + path.drift_north_cells;
    const int column =
        std::clamp(static_cast<int>(std::floor(x)), -path.column, path.columns - 1 - path.column);
    const int row =
        std::clamp(static_cast<int>(std::floor(y)), -path.row, path.rows - 1 - path.row);
    const std::uint32_t word =
        task.ground[static_cast<std::ptrdiff_t>(row) * path.columns + column];
    const float rise = static_cast<float>(word >> PackedGround::kRiskBits) *
                           (1.0F / PackedGround::kStepsPerMetre) -
                       (path.floor_m - PackedGround::kLowest_m);
    risk += static_cast<float>(word & PackedGround::kRiskMax);
    const float run_m = static_cast<float>(i + 1) * task.step_m;
    const float early = 1.0F / std::max(run_m - task.lag_m, task.shortest_m);
    const float late = 1.0F / (run_m + task.lag_m);
    const float tangent = std::max(rise * early, rise * late);
    float& greatest = run_m <= task.lag_m ? near : needed;
    greatest = std::max(greatest, tangent);
    rises[at] = rise;
  }
  task.needed[candidate] = needed;
  task.risk[candidate] = risk;
  task.near[0] = near;
}

void greatest_rates(ForecastTask& path, const std::vector<float>& rises) {
  path.greatest_mps = path.rate_min_mps;
  path.greatest_later_mps = path.rate_min_mps;
  for (int i = 0; i < path.samples; ++i) {
    const auto number = static_cast<float>(i + 1);
    const float at = path.from_in_table + path.step_in_table * number;
    if (!(at <= path.end_in_table)) {
      continue;
    }
    const float rise = std::max(rises[static_cast<std::size_t>(i)],
                                between(path.guide + 1, at, path.table_count) - path.guide_floor_m);
    const float time = number * path.sample_s;
    const float missing = rise - path.climb_rate_mps * time;
    const float free = time - path.response_s;
    const float root = free * free - (missing + missing) / path.acceleration_mps2;
    float rate = path.rate_max_mps;
    if (missing <= 0.0F) {
      rate = rise / time;
    } else if (free > 0.0F && root >= 0.0F) {
      rate =
          path.climb_rate_mps + path.acceleration_mps2 * (free - std::sqrt(std::max(root, 0.0F)));
    }
    path.greatest_mps = std::max(path.greatest_mps, rate);
    if (time >= kBrakingHelpsAfter_s) {
      path.greatest_later_mps = std::max(path.greatest_later_mps, rate);
    }
  }
}

}  // namespace

void plain_rollout(RolloutTask& task, FlightScratch& /*scratch*/) {
  ForecastTask& path = task.path;
  std::vector<float> bend(static_cast<std::size_t>(path.samples));
  std::vector<float> rises(bend.size());
  float beside = path.beside_rad;
  for (int i = 1; i < path.samples; ++i) {
    beside *= path.fading;
    const float bearing =
        between(path.guide, path.from_in_table + path.step_in_table * static_cast<float>(i),
                path.table_count);
    bend[static_cast<std::size_t>(i)] = bearing - path.bearing_now_rad + (beside - path.beside_rad);
  }
  for (int k = 0; k < kCandidates; ++k) {
    roll_out(task, k, bend, rises);
  }
  greatest_rates(path, rises);

  task.chosen = kNoDirection;
  float best = std::numeric_limits<float>::infinity();
  for (int k = 0; k < kCandidates; ++k) {
    if (!(task.needed[k] <= task.tangent_max)) {
      continue;
    }
    const float off = away(task.wanted_rad[k], task.goal_off_rad);
    const float tangent = std::min(std::max(task.needed[k], task.tangent_min), task.tangent_max);
    const float cost = task.goal_weight * (task.is_quadratic ? off * off : off) +
                       (task.risk_weight * task.risk[k] + task.climb_weight * tangent +
                        task.climb_relative_weight * std::max(tangent - task.goal_tangent, 0.0F)) +
                       task.change_weight * away(task.wanted_rad[k], task.before_off_rad);
    if (cost < best) {
      best = cost;
      task.chosen = k;
    }
  }
}

Rollout::Rollout(const Surroundings& surroundings, const Guide& guide,
                 const command_model::CommandModel& model, double look_ahead_m,
                 double safety_height_m, const ProfileOptions& profile,
                 const RolloutOptions& options, const DirectionWeights& weights, double speed_mps,
                 Kernel kernel)
    : surroundings_(&surroundings),
      forecast_(surroundings, guide, model, look_ahead_m, safety_height_m,
                over_horizon(profile, options), speed_mps, step_kernels(kernel)),
      options_(options),
      weights_(weights),
      rollout_(kernel == Kernel::kPlain ? &plain_rollout : step_kernels(kernel).rollout) {
  // Closer together near the heading, where the choice mostly is.
  constexpr int kAround = kCandidates - 2;
  for (int k = 0; k < kAround; ++k) {
    const double u = (2.0 * k + 1.0 - kAround) / kAround;
    offsets_rad_[static_cast<std::size_t>(k)] =
        static_cast<float>(options.reach_rad * (0.35 * u + 0.65 * u * u * u));
  }
}

RolloutChoice Rollout::choose(const command_model::ModelState& state,
                              const command_model::StateTrigonometry& trigonometry, double along_m,
                              const DirectionQuestion& question, double target_math_rad,
                              double commanded_rad, double before_rad, double reach_m) {
  const auto relative = [&](double angle_rad) {
    return static_cast<float>(wrap_to_pi(angle_rad - state.heading_math_rad));
  };
  RolloutTask task;
  task.path = forecast_.task(state, trigonometry, along_m, commanded_rad, target_math_rad);
  const double step_m = state.speed_mps * options_.sample_s;
  const double ground_step_m = forecast_.ground_speed_mps(state, along_m) * options_.sample_s;
  if (reach_m < ground_step_m * task.path.samples) {
    task.path.samples = std::max(kSamplesMin, static_cast<int>(std::ceil(reach_m / ground_step_m)));
  }
  wanted_rad_ = offsets_rad_;
  wanted_rad_[kGoalCandidate] = relative(question.goal_math_rad);
  wanted_rad_[kCommandedCandidate] = relative(commanded_rad);
  task.wanted_rad = wanted_rad_.data();
  task.ground = surroundings_->packed().row(task.path.row) + task.path.column;
  task.step_m = static_cast<float>(step_m);
  task.lag_m = static_cast<float>(options_.lag_s * state.speed_mps);
  task.shortest_m = static_cast<float>(0.5 * state.speed_mps);
  task.goal_off_rad = relative(question.goal_math_rad);
  task.before_off_rad = relative(before_rad);
  task.is_quadratic = weights_.goal_cost == GoalCost::kQuadratic;
  task.goal_weight = static_cast<float>(weights_.goal);
  const double gain = options_.gain * question.polar_share;
  task.risk_weight = static_cast<float>(gain * surroundings_->risk_max() /
                                        (PackedGround::kRiskMax * task.path.samples));
  task.climb_weight = static_cast<float>(gain * weights_.climb);
  task.climb_relative_weight = static_cast<float>(gain * weights_.climb_relative);
  task.change_weight = static_cast<float>(options_.change_1prad);
  task.goal_tangent = static_cast<float>(question.goal_tangent);
  task.tangent_min = static_cast<float>(question.tangent_min);
  task.tangent_max = static_cast<float>(question.tangent_max);
  task.needed = needed_.data();
  task.risk = risk_.data();
  float near = kNothing;
  task.near = &near;
  rollout_(task, scratch_);

  const auto direction = [&](int candidate) {
    switch (candidate) {
      case kGoalCandidate:
        return question.goal_math_rad;
      case kCommandedCandidate:
        return commanded_rad;
      default:
        return wrap_to_pi(state.heading_math_rad +
                          static_cast<double>(wanted_rad_[static_cast<std::size_t>(candidate)]));
    }
  };
  RolloutChoice choice;
  if (task.chosen != kNoDirection) {
    choice.direction_rad = direction(task.chosen);
  }
  choice.needed_commanded = static_cast<double>(needed_[kCommandedCandidate]);
  choice.needed_near = static_cast<double>(near);
  choice.ahead = forecast_.answer(task.path, state);
  if (!choice.direction_rad) {
    choice.least_climb_rad = direction(
        static_cast<int>(std::min_element(needed_.begin(), needed_.end()) - needed_.begin()));
  }
  return choice;
}

}  // namespace hedgehop::local_planning
