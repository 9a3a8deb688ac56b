#include "local_planning/direction.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/angles.hpp"

namespace hedgehop::local_planning {

std::optional<double> cheapest_direction_rad(const PolarHistogram& histogram,
                                             const Sectors& sectors,
                                             const DirectionWeights& weights,
                                             const DirectionQuestion& question,
                                             std::vector<double>& scratch) {
  const std::vector<double>& needed = histogram.tan_masked;
  const std::size_t count = needed.size();
  std::vector<double>& polar = scratch;
  polar.resize(count);
  double mean = 0.0;
  int known = 0;
  for (std::size_t k = 0; k < count; ++k) {
    const double tangent = std::clamp(needed[k], question.tangent_min, question.tangent_max);
    polar[k] = histogram.risk[k] + weights.climb * tangent +
               weights.climb_relative * std::max(tangent - question.goal_tangent, 0.0);
    if (histogram.risk_weight[k] > 0.0) {
      mean += polar[k];
      ++known;
    }
  }
  mean = known > 0 ? mean / known : 0.0;

  const auto cost = [&](std::size_t k, double direction_rad) {
    const double off_goal_rad = std::fabs(wrap_to_pi(direction_rad - question.goal_math_rad));
    const double goal =
        weights.goal *
        (weights.goal_cost == GoalCost::kQuadratic ? off_goal_rad * off_goal_rad : off_goal_rad);
    if (question.polar_share <= 0.0 || histogram.risk_weight[k] <= 0.0) {
      return goal;
    }
    const double off_rad = std::fabs(wrap_to_pi(direction_rad - question.heading_math_rad));
    return goal + question.polar_share * (polar[k] - mean) /
                      (off_rad * off_rad * off_rad + weights.polar_offset_rad3);
  };

  std::optional<double> best_rad;
  double best = std::numeric_limits<double>::infinity();
  const auto goal_sector = static_cast<std::size_t>(sectors.of_angle(question.goal_math_rad));
  if (needed[goal_sector] <= question.tangent_max) {
    best_rad = question.goal_math_rad;
    best = cost(goal_sector, question.goal_math_rad);
  }
  for (std::size_t k = 0; k < count; ++k) {
    if (needed[k] > question.tangent_max) {
      continue;
    }
    const double centre_rad = sectors.centre_rad(static_cast<int>(k));
    const double value = cost(k, centre_rad);
    if (value < best) {
      best = value;
      best_rad = wrap_to_pi(centre_rad);
    }
  }
  return best_rad;
}

std::optional<double> nearest_feasible_rad(const PolarHistogram& histogram, const Sectors& sectors,
                                           double direction_rad, double tangent_max) {
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
  double best = std::numeric_limits<double>::infinity();
  double best_off_rad = best;
  for (int k = 0; k < sectors.count(); ++k) {
    const double centre_rad = sectors.centre_rad(k);
    if (std::fabs(wrap_to_pi(centre_rad - heading_math_rad)) > reach_rad) {
      continue;
    }
    const double tangent = histogram.tan_masked[static_cast<std::size_t>(k)];
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
