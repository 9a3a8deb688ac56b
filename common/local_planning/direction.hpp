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
  std::vector<float> needed;  // of the candidates of openings; infinite for other sectors
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

/// The same with the candidates of VFH+ (Ulrich and Borenstein, DOI 10.1109/ROBOT.1998.677362), as
/// the paper tells them: the goal direction if its sector is feasible. Otherwise the cheapest by
/// cost_k of each opening's candidates. An opening is a run of feasible sectors between others; a
/// narrow one is passed in the middle (of two middle sectors, both are candidates), one of more
/// than `wide_rad` half of that from its right edge and from its left edge.
std::optional<double> cheapest_opening_rad(const PolarHistogram& histogram, const Sectors& sectors,
                                           const DirectionWeights& weights, double wide_rad,
                                           const DirectionQuestion& question,
                                           DirectionScratch& scratch,
                                           int (*cheapest)(const DirectionTask&));

/// What the costs of the feasible sectors apply to an indicator directly, in place of one target:
///
///     2 pi / (K c_goal) sum_k m(cost_k, wrap(k alpha - a))
///     m(c, u) = -c u                       for c < 0: a spring that pulls there
///     m(c, u) = -c u / (1 + (u / s)^2)^2   for c > 0: it repels, and far away no more
///
/// cost_k is polar_share c_p,k (R_k - mean R) as above, without the cost of the goal, whose torque
/// is the spring towards it; so weights mean the same here. a indicator, s `repulsion_width_rad`.
/// With the paper's sign of the torque, indicators run away from what is cheap.
///
/// Sums are single precision, as those of cheapest_direction_rad().
///
/// @param torque  what adds up: plain_torque or that of step_kernels()
/// @return  as an angle [rad] that the spring of the indicator turns into a torque.
double cost_torque_rad(const PolarHistogram& histogram, const Sectors& sectors,
                       const DirectionWeights& weights, const DirectionQuestion& question,
                       double indicator_math_rad, double repulsion_width_rad,
                       DirectionScratch& scratch, float (*torque)(const TorqueTask&));

/// cost_k of each sector as above, in plain form; NaN for one that is not feasible.
std::vector<float> direction_costs(const PolarHistogram& histogram, const Sectors& sectors,
                                   const DirectionWeights& weights,
                                   const DirectionQuestion& question);

/// The choice in plain form: a sector, kGoalDirection or kNoDirection.
int plain_cheapest(const DirectionTask& task);
/// The sum in plain form.
float plain_torque(const TorqueTask& turn);

/// Centre of the feasible sector nearest to a direction, or nothing. A tie goes to the left.
std::optional<double> nearest_feasible_rad(const PolarHistogram& histogram, const Sectors& sectors,
                                           double direction_rad, float tangent_max);

/// Centre of the sector with the least masked climb within `reach_rad` of the heading; a tie goes
/// to the one nearer to `preferred_rad`.
double least_climb_direction_rad(const PolarHistogram& histogram, const Sectors& sectors,
                                 double heading_math_rad, double preferred_rad, double reach_rad);

}  // namespace hedgehop::local_planning
