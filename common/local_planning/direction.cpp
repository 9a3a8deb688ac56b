#include "local_planning/direction.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/angles.hpp"

namespace hedgehop::local_planning {

namespace {

// The shorter way between two angles in [0, 2 pi).
float apart(float a_rad, float b_rad) {
  const float difference_rad = std::fabs(a_rad - b_rad);
  return std::min(difference_rad, kTwoPi_f - difference_rad);
}

// Fills task.polar; returns its mean over the sectors with cells.
float polar_mean(const DirectionTask& task) {
  float partial[kLanes] = {};
  int known = 0;
  for (int k = 0; k < task.sectors; ++k) {
    const float tangent =
        std::min(std::max(task.tan_masked[k], task.tangent_min), task.tangent_max);
    task.polar[k] = task.risk[k] + task.climb_weight * tangent +
                    task.climb_relative_weight * std::max(tangent - task.goal_tangent, 0.0F);
    if (task.risk_weight[k] > 0.0F) {
      partial[k % kLanes] += task.polar[k];
      ++known;
    }
  }
  return known > 0 ? sum_of_parts(partial) / static_cast<float>(known) : 0.0F;
}

// Cost of risk and climb in a direction of sector k.
float polar_cost(const DirectionTask& task, float mean, int k, float direction_rad) {
  if (!(task.polar_share > 0.0F) || !(task.risk_weight[k] > 0.0F)) {
    return 0.0F;
  }
  const float off_rad = apart(direction_rad, task.heading_rad);
  return task.polar_share * (task.polar[k] - mean) /
         (off_rad * off_rad * off_rad + task.polar_offset);
}

float sector_cost(const DirectionTask& task, float mean, int k) {
  const float off_goal_rad = apart(task.centre_rad[k], task.goal_rad);
  return task.goal_weight * (task.is_quadratic ? off_goal_rad * off_goal_rad : off_goal_rad) +
         polar_cost(task, mean, k, task.centre_rad[k]);
}

DirectionTask task_of(const PolarHistogram& histogram, const Sectors& sectors,
                      const DirectionWeights& weights, const DirectionQuestion& question,
                      DirectionScratch& scratch) {
  const auto size = static_cast<std::size_t>(padded_to_lanes(sectors.count()));
  if (scratch.centre_rad.size() != size) {
    scratch.centre_rad.assign(size, 0.0F);
    scratch.polar.assign(size, 0.0F);
    for (int k = 0; k < sectors.count(); ++k) {
      scratch.centre_rad[static_cast<std::size_t>(k)] = static_cast<float>(sectors.centre_rad(k));
    }
  }
  DirectionTask task;
  task.tan_masked = histogram.tan_masked.data();
  task.tan_needed = task.tan_masked;
  task.risk = histogram.risk.data();
  task.risk_weight = histogram.risk_weight.data();
  task.centre_rad = scratch.centre_rad.data();
  task.polar = scratch.polar.data();
  task.sectors = sectors.count();
  task.goal_sector = sectors.of_angle(question.goal_math_rad);
  task.is_quadratic = weights.goal_cost == GoalCost::kQuadratic;
  task.goal_weight = static_cast<float>(weights.goal);
  task.climb_weight = static_cast<float>(weights.climb);
  task.climb_relative_weight = static_cast<float>(weights.climb_relative);
  task.polar_offset = static_cast<float>(weights.polar_offset_rad3);
  task.heading_rad = static_cast<float>(wrap_to_two_pi(question.heading_math_rad));
  task.goal_rad = static_cast<float>(wrap_to_two_pi(question.goal_math_rad));
  task.goal_tangent = static_cast<float>(question.goal_tangent);
  task.tangent_min = static_cast<float>(question.tangent_min);
  task.tangent_max = static_cast<float>(question.tangent_max);
  task.polar_share = static_cast<float>(question.polar_share);
  return task;
}

// The candidates of the opening of `width` sectors from `right` on are left in; the first and last
// sector, for the narrow ones both middle ones.
void keep_candidates(const PolarHistogram& histogram, int right, int width, int wide, int sectors,
                     std::vector<float>& needed) {
  const int in = width > wide ? wide / 2 : (width - 1) / 2;
  for (const int k : {right + in, right + width - 1 - in}) {
    const auto at = static_cast<std::size_t>(k % sectors);
    needed[at] = histogram.tan_masked[at];
  }
}

}  // namespace

int plain_cheapest(const DirectionTask& task) {
  const float mean = polar_mean(task);
  int chosen = kNoDirection;
  float best = std::numeric_limits<float>::infinity();
  if (task.tan_needed[task.goal_sector] <= task.tangent_max) {
    chosen = kGoalDirection;
    best = polar_cost(task, mean, task.goal_sector, task.goal_rad);
  }
  for (int k = 0; k < task.sectors; ++k) {
    if (!(task.tan_needed[k] <= task.tangent_max)) {
      continue;
    }
    const float cost = sector_cost(task, mean, k);
    if (cost < best) {
      best = cost;
      chosen = k;
    }
  }
  return chosen;
}

float plain_torque(const TorqueTask& turn) {
  const DirectionTask& task = turn.costs;
  const float mean = polar_mean(task);
  float partial[kLanes] = {};
  for (int k = 0; k < task.sectors; ++k) {
    if (!(task.tan_masked[k] <= task.tangent_max)) {
      continue;
    }
    const float cost = polar_cost(task, mean, k, task.centre_rad[k]);
    float off_rad = task.centre_rad[k] - turn.indicator_rad;
    off_rad -= off_rad > kPi_f ? kTwoPi_f : 0.0F;
    off_rad += off_rad < -kPi_f ? kTwoPi_f : 0.0F;
    const float fall = 1.0F + off_rad * off_rad * turn.inverse_width2;
    const float pull = cost * off_rad;
    partial[k % kLanes] += cost > 0.0F ? pull / (fall * fall) : pull;
  }
  return sum_of_parts(partial);
}

std::vector<float> direction_costs(const PolarHistogram& histogram, const Sectors& sectors,
                                   const DirectionWeights& weights,
                                   const DirectionQuestion& question) {
  DirectionScratch scratch;
  const DirectionTask task = task_of(histogram, sectors, weights, question, scratch);
  const float mean = polar_mean(task);
  std::vector<float> costs;
  for (int k = 0; k < task.sectors; ++k) {
    costs.push_back(task.tan_masked[k] <= task.tangent_max
                        ? sector_cost(task, mean, k)
                        : std::numeric_limits<float>::quiet_NaN());
  }
  return costs;
}

std::optional<double> cheapest_direction_rad(const PolarHistogram& histogram,
                                             const Sectors& sectors,
                                             const DirectionWeights& weights,
                                             const DirectionQuestion& question,
                                             DirectionScratch& scratch,
                                             int (*cheapest)(const DirectionTask&)) {
  const DirectionTask task = task_of(histogram, sectors, weights, question, scratch);
  const int chosen = cheapest(task);
  if (chosen == kNoDirection) {
    return std::nullopt;
  }
  return chosen == kGoalDirection ? question.goal_math_rad : wrap_to_pi(sectors.centre_rad(chosen));
}

std::optional<double> cheapest_opening_rad(const PolarHistogram& histogram, const Sectors& sectors,
                                           const DirectionWeights& weights, double wide_rad,
                                           const DirectionQuestion& question,
                                           DirectionScratch& scratch,
                                           int (*cheapest)(const DirectionTask&)) {
  DirectionTask task = task_of(histogram, sectors, weights, question, scratch);
  const int count = task.sectors;
  const auto is_open = [&](int k) { return task.tan_masked[k % count] <= task.tangent_max; };
  if (is_open(task.goal_sector)) {
    return question.goal_math_rad;
  }
  scratch.needed.assign(scratch.centre_rad.size(), std::numeric_limits<float>::infinity());
  const int wide = static_cast<int>(std::lround(wide_rad / kTwoPi * count));
  // Once around from the goal, whose sector is none of any opening.
  int width = 0;
  for (int k = task.goal_sector + 1; k <= task.goal_sector + count; ++k) {
    if (is_open(k)) {
      ++width;
    } else if (width > 0) {
      keep_candidates(histogram, k - width, width, wide, count, scratch.needed);
      width = 0;
    }
  }
  task.tan_needed = scratch.needed.data();
  const int chosen = cheapest(task);
  return chosen == kNoDirection ? std::nullopt
                                : std::optional(wrap_to_pi(sectors.centre_rad(chosen)));
}

double cost_torque_rad(const PolarHistogram& histogram, const Sectors& sectors,
                       const DirectionWeights& weights, const DirectionQuestion& question,
                       double indicator_math_rad, double repulsion_width_rad,
                       DirectionScratch& scratch, float (*torque)(const TorqueTask&)) {
  TorqueTask task;
  task.costs = task_of(histogram, sectors, weights, question, scratch);
  task.indicator_rad = static_cast<float>(wrap_to_two_pi(indicator_math_rad));
  task.inverse_width2 = static_cast<float>(1.0 / (repulsion_width_rad * repulsion_width_rad));
  return -kTwoPi / sectors.count() / weights.goal * static_cast<double>(torque(task));
}

std::optional<double> nearest_feasible_rad(const PolarHistogram& histogram, const Sectors& sectors,
                                           double direction_rad, float tangent_max) {
  std::optional<double> best_rad;
  double best = std::numeric_limits<double>::infinity();
  for (int k = 0; k < sectors.count(); ++k) {
    if (histogram.tan_masked[static_cast<std::size_t>(k)] > tangent_max) {
      continue;
    }
    const double off_rad = wrap_to_pi(sectors.centre_rad(k) - direction_rad);
    const double distance_rad = std::fabs(off_rad);
    if (distance_rad < best || (distance_rad == best && off_rad > 0.0)) {
      best = distance_rad;
      best_rad = wrap_to_pi(sectors.centre_rad(k));
    }
  }
  return best_rad;
}

double least_climb_direction_rad(const PolarHistogram& histogram, const Sectors& sectors,
                                 double heading_math_rad, double preferred_rad, double reach_rad) {
  double best_rad = heading_math_rad;
  float best = std::numeric_limits<float>::infinity();
  double best_off_rad = std::numeric_limits<double>::infinity();
  for (int k = 0; k < sectors.count(); ++k) {
    const double centre_rad = sectors.centre_rad(k);
    if (std::fabs(wrap_to_pi(centre_rad - heading_math_rad)) > reach_rad) {
      continue;
    }
    const float tangent = histogram.tan_masked[static_cast<std::size_t>(k)];
    const double off_rad = std::fabs(wrap_to_pi(centre_rad - preferred_rad));
    if (tangent < best || (tangent == best && off_rad < best_off_rad)) {
      best = tangent;
      best_off_rad = off_rad;
      best_rad = wrap_to_pi(centre_rad);
    }
  }
  return best_rad;
}

}  // namespace hedgehop::local_planning
