#pragma once

#include <optional>
#include <string>

#include "base/errors.hpp"
#include "console.hpp"
#include "evaluation/clearance_risk.hpp"
#include "flight/plan.hpp"
#include "map/map.hpp"
#include "verification/leg_check.hpp"
#include "verification/plan_check.hpp"

namespace hedgehop::cli {

/// Prints what was found, with the risk if errors were drawn. Returns 0, or 4 when the plan is not
/// verified.
ExitCode report_check(const Console& console, const std::string& folder, const map::Map& map,
                      const flight::Plan& plan, const verification::PlanCheck& check,
                      const std::optional<evaluation::ClearanceRisk>& risk);

/// The same for the straight legs of a mission file.
ExitCode report_legs(const Console& console, const std::string& file, const map::Map& map,
                     std::size_t waypoints, double required_clearance_m,
                     const verification::LegCheck& check);

}  // namespace hedgehop::cli
