#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "base/config_reader.hpp"
#include "base/hash.hpp"
#include "base/observer.hpp"
#include "evaluation/problem_drawing.hpp"
#include "flight/route.hpp"
#include "geo/map_projection.hpp"
#include "map/map.hpp"
#include "planning/planning.hpp"

namespace hedgehop::evaluation {

/// Section `optimality` of the evaluation config.
struct OptimalityOptions {
  std::int64_t problems = 0;
  DrawingRules drawing;
  std::vector<double> budgets_s;      // processor time, ascending
  std::vector<std::string> planners;  // names of contestants
  double polish_s = 0.0;              // for the best known route of each problem
};

/// As the config has it: `polish_s` is the share of the greatest budget up to the maximum that the
/// config names; see polish_s_of().
struct OptimalityConfig {
  OptimalityOptions options;  // polish_s is not set
  double polish_share = 0.0;  // of the greatest budget
  double polish_max_s = 0.0;
  double overrun_s = 0.0;  // a planner that has not stopped after so much more is ended
};
OptimalityConfig read_optimality_config(ConfigReader& reader);
double polish_s_of(const OptimalityConfig& config, const std::vector<double>& budgets_s);

/// Reads seconds of processor time of this process.
using ProcessClock = std::function<double()>;

/// One problem as a planner gets it.
struct OptimalityTask {
  flight::Waypoint start;
  flight::Waypoint goal;
  std::uint64_t seed = 1;
  std::vector<double> budgets_s;
};

/// A route and the processor time that the planner had used when it told of it.
struct TimedRoute {
  double time_s = 0.0;
  std::vector<flight::Waypoint> waypoints;
};

/// What a planner had done when a budget was used up.
struct BudgetMark {
  double stopped_s = 0.0;  // when it had stopped; the budget or later, less if it ended by itself
  std::int64_t edges = 0;  // edge costs or work units
};

/// What one planner did with one problem.
struct Attempt {
  std::vector<TimedRoute> routes;  // as told, each better than the one before by its own account
  std::vector<BudgetMark> marks;   // by budget; fewer if it failed
  double lower_bound_m = 0.0;      // proved by it, 0: none
  std::string no_route_cause;      // a proved reason why there is no route
  std::string failure;             // how it ended before its time: abort, exception
};

/// A planner that takes part.
struct Contestant {
  std::string name;
  /// What its routes heed: "radius" (arcs fit the legs), "angle" (paper), "curves" or "none".
  std::string turn_rule;
  /// False: a route counts for a budget if it was told within it. True: if it was there when the
  /// planner had stopped, for planners of the library that tell late and stop late.
  bool counts_when_stopped = false;
  std::function<Attempt(const OptimalityTask&, const Observer&)> run;
};

/// Improves on the best of `candidates` for `seconds` of processor time; empty if that is not
/// possible. The candidates keep the turn rule of the config and are sorted by cost.
using Polish = std::function<std::vector<flight::Waypoint>(
    const OptimalityTask&, const std::vector<std::vector<flight::Waypoint>>& candidates,
    double seconds, const Observer&)>;

/// One planner's result for one problem, costs by eq. (1) at steps of 1 m; NaN: no route.
struct JudgedAttempt {
  double first_route_s = 0.0;  // NaN without one
  double first_route_cost_m = 0.0;
  std::vector<double> costs_m;  // by budget
  double last_cost_m = 0.0;     // of the last valid route, in time or not
  std::vector<BudgetMark> marks;
  bool are_turns_kept = false;      // by the last valid route
  std::int64_t refused_routes = 0;  // last ones that failed the exact check
  double lower_bound_m = 0.0;
  std::string no_route_cause;
  std::string failure;
};

struct OptimalityProblem {
  geo::GeodeticPosition start;
  geo::GeodeticPosition goal;
  flight::Waypoint from;
  flight::Waypoint to;
  double distance_m = 0.0;              // straight
  double best_known_m = 0.0;            // that keeps the turn rule; NaN: nobody found one
  std::string best_known_by;            // contestant, or "polish"
  double lower_bound_m = 0.0;           // the greatest that was proved
  std::vector<JudgedAttempt> attempts;  // by contestant
};

/// Statistics of one planner at one budget; NaN where there is nothing to count.
struct OptimalityRow {
  std::string planner;
  std::string turn_rule;
  double budget_s = 0.0;
  std::int64_t solved = 0;
  double success = 0.0;               // share of all problems
  double first_route_s_median = 0.0;  // over the problems solved at all
  double first_route_over_best_median = 0.0;
  double cost_over_best_median = 0.0;  // over those solved within this budget, as below
  double cost_over_best_p95 = 0.0;     // least value that 95 % do not exceed
  double cost_over_bound_median = 0.0;
  double edges_per_s = 0.0;         // all edges by all time
  double overshoot_s_median = 0.0;  // time beyond the budget until it had stopped
  double overshoot_s_max = 0.0;
  double turns_kept = 0.0;  // share of the last routes that keep the turn rule of the config
  std::int64_t no_route_causes = 0;
  std::int64_t failures = 0;
};

/// Median over problems of the cost of one planner over that of another.
struct CostRatio {
  std::string planner;
  double budget_s = 0.0;
  std::string against;
  double against_budget_s = 0.0;
  std::int64_t problems = 0;  // that both solved
  double median = 0.0;
};

struct OptimalityResult {
  std::uint64_t seed = 0;
  Hash128 map_hash;
  std::string map_label;
  OptimalityOptions options;
  std::int64_t rejected_draws = 0;
  bool is_stopped = false;  // by the observer; then `problems` are those that were finished
  std::vector<OptimalityProblem> problems;
  std::vector<OptimalityRow> rows;
  std::vector<CostRatio> ratios;
};

/// Lets planners solve the same drawn problems and compares what their routes cost.
///
/// Start and goal are drawn as evaluate_random() does and lie at reference height above the highest
/// surface within the lateral margin, where a request without heights puts them. Every route is
/// judged alike: FlightEnvelope::is_clear() for each leg, eq. (1) integrated at steps of 1 m. The
/// best known cost is the least of all routes of all contestants and of a polish. Problems and
/// planners follow one another, each with one thread of oneTBB.
///
/// @throws DataError    if the map is too small.
/// @throws Interrupted  if the observer says so.
OptimalityResult evaluate_optimality(const map::Map& map, const planning::PlanningConfig& config,
                                     const OptimalityOptions& options, std::uint64_t seed,
                                     const std::vector<Contestant>& contestants,
                                     const Polish& polish, Observer& observer);

/// Where an evaluation ran; for the record only.
struct MachineRecord {
  std::string processor;
  std::string simd;
  std::string version;
};

/// The result as JSON: `rows`, one a planner and budget, `cost_ratios`, and `problems`.
std::string optimality_result_json(const OptimalityResult& result, const MachineRecord& machine);

}  // namespace hedgehop::evaluation
