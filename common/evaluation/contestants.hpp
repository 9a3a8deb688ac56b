#pragma once

#include <string>
#include <vector>

#include "evaluation/optimality_evaluation.hpp"
#include "global_planning/stock_planner.hpp"
#include "planning/planning.hpp"
#include "risk/cost_model.hpp"

namespace hedgehop::evaluation {

/// Every planner that can take part, in the order of reports.
std::vector<std::string> contestant_names();

/// The planners of these names, all under the same config:
///
/// recommended   plan_leg() as the config has it
/// roadmap       first route of a Roadmap that was made before, with an envelope at hand: what one
///               of many queries takes; without refinement and lower bound
/// bitstar       our BIT* as in the paper: straight length as heuristic, ellipse, insertion
///               condition on the angle alone, no refinement
/// bitstar_labels  the same, its first route searched over directed edges
/// bitstar_field   that, led by the strict bounds of eq. (1), states drawn from their level set
/// free_turns    recommended without any rule about turns, then every piece of 30 m moved for
///               itself, whatever the budget: what the turn rule costs, and what no bound that
///               leaves turns free can exceed
/// ompl_...      the library's planners; see global_planning::StockPlanner
/// dubins        the library's BIT* over Dubins curves
///
/// Time counts from before the flight envelope is built. The library's planners run in a child
/// process each, which is ended `overrun_s` after the last budget. `costs` and `config` must
/// outlive the contestants.
/// @throws UsageError  for a name that is not in contestant_names(), or stands there twice.
std::vector<Contestant> make_contestants(const std::vector<std::string>& names,
                                         const risk::CostModel& costs,
                                         const planning::PlanningConfig& config, double overrun_s,
                                         const ProcessClock& clock);

/// How a planner of the library runs in a comparison.
struct StockRun {
  global_planning::StockMethod method = global_planning::StockMethod::kBitStar;
  double turn_radius_m = 0.0;             // of Dubins curves
  global_planning::EndHeadings headings;  // likewise
  double overrun_s = 0.0;                 // it is ended so long after the last budget
};

/// A planner of the library on one problem, in a child process.
Attempt run_stock(const risk::CostModel& costs, const global_planning::GlobalOptions& options,
                  const StockRun& run, const OptimalityTask& task, const ProcessClock& clock,
                  const Observer& observer);

/// The contestant "bitstar" on one problem, in a child process, so that several can run at once and
/// each have a clock of its own. Without a lower bound.
Attempt run_paper_planner(const risk::CostModel& costs,
                          const global_planning::GlobalOptions& options, const OptimalityTask& task,
                          double overrun_s, const ProcessClock& clock, const Observer& observer);

/// Refines the candidates, then plans again and again with other resolutions and with our BIT*
/// under other seeds, each refined, until the time is used up.
Polish make_polish(const risk::CostModel& costs, const planning::PlanningConfig& config,
                   const ProcessClock& clock);

}  // namespace hedgehop::evaluation
