#pragma once

#include "local_planning/local_planner.hpp"

namespace hedgehop::local_planning {

/// What a flight costs [m]: all terms along the flown way, and its roughness,
///
///     integral over the horizontal way of  density(place, height) + c_bank |bank|
///     + risk::CostModel::directed_cost_m() of each step
///
/// trapezoidal between steps. NaN if a step lies outside the map or over a void.
double flight_cost_m(const risk::CostModel& costs, const Flight& flight, double bank_weight_1prad);

/// The options with which a flight follows its guide plainly: no weight for risk or climb.
LocalOptions following_options(LocalOptions options);

}  // namespace hedgehop::local_planning
