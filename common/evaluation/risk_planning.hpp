#pragma once

#include <cstdint>
#include <variant>

#include "base/observer.hpp"
#include "evaluation/clearance_risk.hpp"
#include "evaluation/random_evaluation.hpp"
#include "flight/plan.hpp"
#include "map/map.hpp"
#include "planning/planning.hpp"

namespace hedgehop::evaluation {

/// With what probability a flight may come lower than it must.
struct RiskDemand {
  ErrorSizes errors;
  double probability = 0.0;  // in (0, 1), of a clearance below verification.required_clearance_m
  UncertaintyOptions options;
  std::uint64_t seed = 0;
};

/// A plan that was made higher until errors harm it seldom enough.
struct RiskPlan {
  flight::Plan plan;
  double margin_m = 0.0;  // by which heights were raised
  std::int64_t rounds = 0;
  ClearanceRisk risk;   // of the plan
  bool is_met = false;  // the upper end of the interval is at most what was asked for
};

/// Plans, draws errors, raises the heights by what the draws lack, and plans again, at most six
/// times and as long as that helps; each round draws afresh.
///
/// Raised are `global.envelope_floor_m`, `local.safety_height_m`, `local.vertical_pass.clearance_m`
/// and the heights of start, goal and via points for which the request names none. Heights that it
/// names stay, so a start that is asked for too near to the ground cannot be helped: then `is_met`
/// is false. As many errors are drawn as the interval needs to become narrow enough, at least
/// 20 / probability.
///
/// @param plan  as of evaluate_random()
/// @throws std::invalid_argument  for a probability outside (0, 1).
std::variant<RiskPlan, flight::NoPlan> plan_within_risk(
    const map::Map& map, const flight::PlanRequest& request, const planning::PlanningConfig& config,
    const RiskDemand& demand, const PlanFunction& plan, Observer& observer);

}  // namespace hedgehop::evaluation
