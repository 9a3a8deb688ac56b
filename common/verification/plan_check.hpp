#pragma once

#include <string>
#include <string_view>

#include "flight/plan.hpp"
#include "map/map.hpp"
#include "verification/margins.hpp"

namespace hedgehop::verification {

/// All that can be said about a finished plan.
struct PlanCheck {
  flight::Verdict verdict;  // of the flight and of what plan.json and trajectory.csv say
  Margins margins;          // empty for a flight of less than two states
};

/// Checks a plan as it was read from its files: the flight by verify(), against the limits and
/// demands of its own config; the costs, measures and claims of plan.json (check_figures()); the
/// columns of trajectory.csv that follow from others (check_trajectory_file()).
/// @param trajectory_csv  the text of the file
/// @throws UsageError   if the plan was made on another map.
/// @throws ConfigError  if its config cannot be read.
PlanCheck check_plan(const map::Map& map, const flight::Plan& plan,
                     const std::string& trajectory_csv);

/// Unit of the value and the limit of a violation of a rule: "m", "rad", ..., or "" for a number.
std::string_view unit_of(std::string_view rule);

}  // namespace hedgehop::verification
