#include "local_planning/rollout.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/angles.hpp"
#include "base/elementary.hpp"

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

// A flight ahead, sample by sample.
struct Path {
  float heading = 0.0F;
  float turn = 0.0F;
  float turn_before = 0.0F;
  float east = 0.0F;  // one sample onwards [cells]
  float north = 0.0F;
  float x = 0.0F;
  float y = 0.0F;

  explicit Path(const ForecastTask& task)
      : turn(task.turn_radps),
        east(task.east_cells),
        north(task.north_cells),
        x(task.part_of_column),
        y(task.part_of_row) {}

  void advance(const ForecastTask& task, float wanted_rad) {
    const float turn_max = task.roll_share * task.turn_max_radps;
    const float pull = task.roll_share * task.gain;
    const float off = wanted_rad - heading;
    const float wanted_turn = std::min(std::max(pull * off, -turn_max), turn_max);
    const float angle = 0.5F * task.sample_s * (turn + turn_before);
    heading += task.sample_s * turn;
    turn_before = turn;
    turn = (1.0F - task.roll_share) * turn + wanted_turn;
    const float angle2 = angle * angle;
    const float sine = angle * (1.0F - angle2 * (1.0F / 6.0F));
    const float cosine = 1.0F - angle2 * (0.5F - angle2 * (1.0F / 24.0F));
    const float turned_east = east * cosine - north * sine;
    north = east * sine + north * cosine;
    east = turned_east;
    x = x + east + task.drift_east_cells;
    y = y + north + task.drift_north_cells;
  }

  [[nodiscard]] std::uint32_t ground_below(const RolloutTask& task) const {
    const ForecastTask& path = task.path;
    const int column =
        std::clamp(static_cast<int>(std::floor(x)), -path.column, path.columns - 1 - path.column);
    const int row =
        std::clamp(static_cast<int>(std::floor(y)), -path.row, path.rows - 1 - path.row);
    return task.ground[static_cast<std::ptrdiff_t>(row) * path.columns + column];
  }
};

// How the guide turns ahead of each sample.
void look_along(const ForecastTask& path, std::vector<float>& bend) {
  bend.assign(static_cast<std::size_t>(path.samples), 0.0F);
  float beside = path.beside_rad;
  for (int i = 1; i < path.samples; ++i) {
    beside *= path.fading;
    const float bearing =
        between(path.guide, path.from_in_table + path.step_in_table * static_cast<float>(i),
                path.table_count);
    bend[static_cast<std::size_t>(i)] = bearing - path.bearing_now_rad + (beside - path.beside_rad);
  }
}

// One path; returns the rises of its samples.
void roll_out(RolloutTask& task, int candidate, const std::vector<float>& bend,
              std::vector<float>& rises) {
  const ForecastTask& path = task.path;
  Path flown(path);
  float risk = 0.0F;
  float needed = kNothing;
  float near = kNothing;
  for (int i = 0; i < path.samples; ++i) {
    const auto at = static_cast<std::size_t>(i);
    flown.advance(path, task.wanted_rad[candidate] + bend[at]);
    const std::uint32_t word = flown.ground_below(task);
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

// What a candidate costs over ground with this risk.
float cost_of(const RolloutTask& task, int candidate, float risk_cost) {
  const float off = away(task.wanted_rad[candidate], task.goal_off_rad);
  const float tangent =
      std::min(std::max(task.needed[candidate], task.tangent_min), task.tangent_max);
  return task.goal_weight * (task.is_quadratic ? off * off : off) +
         (risk_cost + task.climb_weight * tangent +
          task.climb_relative_weight * std::max(tangent - task.goal_tangent, 0.0F)) +
         task.change_weight * away(task.wanted_rad[candidate], task.before_off_rad);
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
  std::vector<float> bend;
  look_along(path, bend);
  std::vector<float> rises(bend.size());
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
    const float cost = cost_of(task, k, task.risk_weight * task.risk[k]);
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
      rollout_(kernel == Kernel::kPlain ? &plain_rollout : step_kernels(kernel).rollout),
      nodes_(static_cast<std::size_t>(options.tree_depth)),
      bends_(nodes_.size()) {
  // Closer together near the heading, where the choice mostly is.
  constexpr int kAround = kCandidates - 2;
  for (int k = 0; k < kAround; ++k) {
    const double u = (2.0 * k + 1.0 - kAround) / kAround;
    offsets_rad_[static_cast<std::size_t>(k)] =
        static_cast<float>(options.reach_rad * (0.35 * u + 0.65 * u * u * u));
  }
}

void Rollout::ask(Node& node, const command_model::StateTrigonometry& trigonometry,
                  double before_rad) {
  const command_model::ModelState& state = node.state;
  const DirectionQuestion& question = node.view.question;
  const auto relative = [&](double angle_rad) {
    return static_cast<float>(wrap_to_pi(angle_rad - state.heading_math_rad));
  };
  RolloutTask& task = node.task;
  task.path = forecast_.task(state, trigonometry, node.view.guide, node.commanded_rad);
  const double step_m = state.speed_mps * options_.sample_s;
  const double ground_step_m =
      forecast_.ground_speed_mps(state, node.view.guide.along_m) * options_.sample_s;
  if (node.view.reach_m < ground_step_m * task.path.samples) {
    task.path.samples =
        std::max(kSamplesMin, static_cast<int>(std::ceil(node.view.reach_m / ground_step_m)));
  }
  node.wanted_rad = offsets_rad_;
  node.wanted_rad[kGoalCandidate] = relative(question.goal_math_rad);
  node.wanted_rad[kCommandedCandidate] = relative(node.commanded_rad);
  task.wanted_rad = node.wanted_rad.data();
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
  task.needed = node.needed.data();
  task.risk = node.risk.data();
  node.near = kNothing;
  task.near = &node.near;
  rollout_(task, scratch_);
}

double Rollout::direction_rad(const Node& node, int candidate) {
  switch (candidate) {
    case kGoalCandidate:
      return node.view.question.goal_math_rad;
    case kCommandedCandidate:
      return node.commanded_rad;
    default:
      return wrap_to_pi(node.state.heading_math_rad +
                        static_cast<double>(node.wanted_rad[static_cast<std::size_t>(candidate)]));
  }
}

void Rollout::ask_after(std::size_t depth, int candidate, const PartEnd& end,
                        const ViewAt& view_at) {
  const Node& before = nodes_[depth];
  Node& node = nodes_[depth + 1];
  const DirectionQuestion& question = before.view.question;
  const double speed_mps = before.state.speed_mps;
  const double needed = static_cast<double>(before.needed[static_cast<std::size_t>(candidate)]);
  const double tangent = std::clamp(std::max(needed, question.goal_tangent), question.tangent_min,
                                    question.tangent_max);
  const double climbed_m = tangent > 0.0
                               ? tangent * std::max(0.0, end.run_m - options_.lag_s * speed_mps)
                               : tangent * end.run_m;
  node.state = before.state;
  node.state.x_m += end.east_m;
  node.state.y_m += end.north_m;
  node.state.altitude_m += climbed_m;
  node.state.heading_math_rad = wrap_to_pi(node.state.heading_math_rad + end.turned_rad);
  node.state.climb_rate_mps = speed_mps * tangent;
  command_model::StateTrigonometry trigonometry;
  trigonometry.tan_bank = end.turn_rate_radps * speed_mps / kGravity_mps2;
  trigonometry.cos_heading = elementary::cos(node.state.heading_math_rad);
  trigonometry.sin_heading = elementary::sin(node.state.heading_math_rad);
  node.state.bank_left_rad = elementary::atan(trigonometry.tan_bank);
  node.view = view_at(node.state, trigonometry, before.view.guide.along_m, end.run_m);
  node.commanded_rad = direction_rad(before, candidate);
  ask(node, trigonometry, node.commanded_rad);
}

Rollout::Best Rollout::best_of(std::size_t depth, double bound, const ViewAt& view_at) {
  Node& node = nodes_[depth];
  const RolloutTask& task = node.task;
  if (depth + 1 == nodes_.size()) {
    if (task.chosen == kNoDirection) {
      return {};
    }
    const auto chosen = static_cast<std::size_t>(task.chosen);
    return {task.chosen,
            static_cast<double>(cost_of(task, task.chosen, task.risk_weight * node.risk[chosen]))};
  }
  // Without risk, which is not negative; nor is what comes after but for a descent that is liked.
  std::array<std::pair<float, int>, kCandidates> order;
  std::size_t count = 0;
  for (int k = 0; k < kCandidates; ++k) {
    if (task.needed[k] <= task.tangent_max) {
      order[count++] = {cost_of(task, k, 0.0F), k};
    }
  }
  std::sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count));
  double least_after = 0.0;
  for (std::size_t later = depth + 1; later < nodes_.size(); ++later) {
    least_after =
        options_.later_weight *
        (std::min(0.0, static_cast<double>(task.climb_weight * task.tangent_min)) + least_after);
  }
  std::vector<float>& bend = bends_[depth];
  look_along(task.path, bend);
  const int samples = std::clamp(static_cast<int>(options_.branch_s / options_.sample_s + 0.5), 1,
                                 task.path.samples);
  const float part_risk_weight =
      task.risk_weight * static_cast<float>(task.path.samples) / static_cast<float>(samples);
  Best best{kNoDirection, bound};
  for (std::size_t i = 0; i < count; ++i) {
    const auto [without_risk, k] = order[i];
    if (static_cast<double>(without_risk) + least_after >= best.cost) {
      break;
    }
    Path path(task.path);
    float risk = 0.0F;
    for (int sample = 0; sample < samples; ++sample) {
      path.advance(task.path, task.wanted_rad[k] + bend[static_cast<std::size_t>(sample)]);
      risk += static_cast<float>(path.ground_below(task) & PackedGround::kRiskMax);
    }
    const auto cost = static_cast<double>(cost_of(task, k, part_risk_weight * risk));
    if (cost + least_after >= best.cost) {
      continue;
    }
    const double cell_m = surroundings_->geometry().cell_m;
    ask_after(depth, k,
              {static_cast<double>(path.x - task.path.part_of_column) * cell_m,
               static_cast<double>(path.y - task.path.part_of_row) * cell_m,
               static_cast<double>(path.heading), static_cast<double>(path.turn),
               samples * node.state.speed_mps * options_.sample_s},
              view_at);
    const Best after = best_of(depth + 1, (best.cost - cost) / options_.later_weight, view_at);
    if (after.candidate != kNoDirection && cost + options_.later_weight * after.cost < best.cost) {
      best = {k, cost + options_.later_weight * after.cost};
    }
  }
  return best;
}

RolloutChoice Rollout::choose(const command_model::ModelState& state,
                              const command_model::StateTrigonometry& trigonometry,
                              const RolloutView& view, double commanded_rad, double before_rad,
                              const ViewAt& view_at) {
  Node& root = nodes_.front();
  root.state = state;
  root.view = view;
  root.commanded_rad = commanded_rad;
  ask(root, trigonometry, before_rad);
  const double way_m =
      state.speed_mps *
      (options_.horizon_s + options_.branch_s * static_cast<double>(nodes_.size() - 1));
  if (nodes_.size() > 1 && view_at && root.task.chosen != kNoDirection && way_m <= view.reach_m) {
    const Best best = best_of(0, std::numeric_limits<double>::infinity(), view_at);
    if (best.candidate != kNoDirection) {
      root.task.chosen = best.candidate;
    }
  }
  RolloutChoice choice;
  if (root.task.chosen != kNoDirection) {
    choice.direction_rad = direction_rad(root, root.task.chosen);
  }
  choice.needed_commanded = static_cast<double>(root.needed[kCommandedCandidate]);
  choice.needed_near = static_cast<double>(root.near);
  choice.ahead = ClimbForecast::answer(root.task.path, view.guide);
  if (!choice.direction_rad) {
    choice.least_climb_rad = direction_rad(
        root, static_cast<int>(std::min_element(root.needed.begin(), root.needed.end()) -
                               root.needed.begin()));
  }
  return choice;
}

}  // namespace hedgehop::local_planning
