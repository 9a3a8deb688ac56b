#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "local_planning/polar_histogram.hpp"
#include "local_planning/step_kernels.hpp"

namespace hedgehop::local_planning {

enum class GoalCost : std::uint8_t { kQuadratic, kAbsolute };

/// Weights of the cost of a direction.
struct DirectionWeights {
  GoalCost goal_cost = GoalCost::kQuadratic;
  double goal = 0.0;               // c_goal [1/rad^2 or 1/rad]
  double climb = 0.0;              // c_climb, per tangent of the climb angle
  double climb_relative = 0.0;     // c_climb,rel, per tangent above the guide's
  double polar_offset_rad3 = 0.0;  // c_p,ofst
};

/// What a choice depends on besides the histogram.
struct DirectionQuestion {
  double heading_math_rad = 0.0;  // chi
  double goal_math_rad = 0.0;     // direction of the target on the guide
  double goal_tangent = 0.0;      // climb towards it
  double tangent_min = 0.0;       // climb tangents are held within these for the costs
  double tangent_max = 0.0;       // a sector that needs more is not feasible
  double polar_share = 1.0;       // of risk and climb costs that counts; 0: only the goal direction
};

/// Memory of a choice.
struct DirectionScratch {
  std::vector<float> centre_rad;
  std::vector<float> polar;
};

/// Cheapest feasible direction, or nothing.
///
///     cost_k = c_goal g(wrap(k alpha - chi_goal)) + polar_share c_p,k (R_k - mean R)
///     R_k    = risk_k + c_climb t_k + c_climb,rel max(t_k - t_goal, 0)
///     c_p,k  = 1 / (|wrap(k alpha - chi)|^3 + c_p,ofst)                                  (6)
///
/// g(u) = u^2 or |u|; t_k tangent of the masked climb angle; the mean is over sectors with cells,
/// so that equal risk everywhere changes nothing. Sectors with t_k <= tangent_max are feasible; the
/// goal direction itself is a candidate too, with the risk and feasibility of its sector. Ties go
/// to the goal direction, then to the lowest sector.
///
/// Costs are single precision; the mean is summed in kLanes parts, so that SIMD gives the same
/// bits. The weights for risk are inside the histogram's risk.
///
/// @param cheapest  what compares the costs: plain_cheapest or that of step_kernels()
std::optional<double> cheapest_direction_rad(const PolarHistogram& histogram,
                                             const Sectors& sectors,
                                             const DirectionWeights& weights,
                                             const DirectionQuestion& question,
                                             DirectionScratch& scratch,
                                             int (*cheapest)(const DirectionTask&));

/// cost_k of each sector as above, in plain form; NaN for one that is not feasible.
std::vector<float> direction_costs(const PolarHistogram& histogram, const Sectors& sectors,
                                   const DirectionWeights& weights,
                                   const DirectionQuestion& question);

/// The choice in plain form: a sector, kGoalDirection or kNoDirection.
int plain_cheapest(const DirectionTask& task);

/// Centre of the feasible sector nearest to a direction, or nothing. A tie goes to the left.
std::optional<double> nearest_feasible_rad(const PolarHistogram& histogram, const Sectors& sectors,
                                           double direction_rad, float tangent_max);

/// Centre of the sector with the least masked climb within `reach_rad` of the heading; a tie goes
/// to the one nearer to `preferred_rad`.
double least_climb_direction_rad(const PolarHistogram& histogram, const Sectors& sectors,
                                 double heading_math_rad, double preferred_rad, double reach_rad);

}  // namespace hedgehop::local_planning
