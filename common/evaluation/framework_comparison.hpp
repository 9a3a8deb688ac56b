#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "base/config_reader.hpp"
#include "base/observer.hpp"
#include "evaluation/optimality_evaluation.hpp"
#include "evaluation/paired_statistics.hpp"
#include "evaluation/problem_drawing.hpp"
#include "map/map.hpp"
#include "planning/planning.hpp"

namespace hedgehop::evaluation {

/// Section `table3` of the evaluation config.
struct FrameworkOptions {
  std::int64_t runs = 0;  // problems that our framework solves
  DrawingRules drawing;
  double budget_s = 0.0;  // processor time of the paper's global planner and of the baseline
  double overrun_s = 0.0;
  std::int64_t edge_runs = 0;  // of these the edges per second of straight legs are counted too
  double mission_m = 0.0;      // length of the paper's example
  double mission_tolerance = 0.0;
  std::int64_t bootstrap_draws = 0;
  std::vector<std::string> paper_settings;  // on top of the planning config: the paper's framework
  std::vector<std::string> baseline_settings;  // likewise: the baseline's envelope
};
FrameworkOptions read_framework_options(ConfigReader& reader);

/// A path of one framework and what it took; times in processor seconds.
struct FrameworkPath {
  bool is_found = false;     // a path from start to goal
  bool is_verified = false;  // of flights: by the independent verifier
  flight::PathMeasures measures;
  double cost_m = 0.0;        // of flights: local_planning::flight_cost_m(); NaN for the baseline
  double route_cost_m = 0.0;  // eq. (1) of the global route
  double route_s = 0.0;
  double flight_s = 0.0;
  std::string failure;
};

/// One drawn problem.
struct FrameworkProblem {
  std::int64_t number = 0;  // in the order of drawing
  FrameworkPath ours;
  double wall_s = 0.0;  // of ours, route and flight
  double lower_bound_m = 0.0;
  std::string no_plan_cause;  // empty if there is a verified plan
  bool has_named_cause = false;
  // Only if ours is verified:
  FrameworkPath paper;
  FrameworkPath baseline;
  std::int64_t baseline_edges = 0;
  double baseline_s = 0.0;
  std::int64_t straight_edges = 0;  // 0: not counted on this problem
  double straight_s = 0.0;
};

/// One framework against another on the problems that both solved.
struct FrameworkChange {
  std::string name;
  std::string against;
  std::int64_t pairs = 0;
  PairedChange length;
  PairedChange visibility;
  PairedChange semantics;
  PairedChange height;  // mean above the surface
  std::optional<PairedChange> bank;
  std::optional<PairedChange> cost;
};

struct FrameworkResult {
  std::uint64_t seed = 0;
  std::string map_hash;
  std::string map_label;
  FrameworkOptions options;
  double turn_radius_m = 0.0;
  std::vector<FrameworkProblem> problems;  // all that were drawn
  bool is_stopped = false;                 // early: problems that were not finished are left out
  std::int64_t from_cache = 0;
  std::int64_t solved = 0;           // by our framework
  std::int64_t named_causes = 0;     // of the others
  std::int64_t paper_solved = 0;     // of `solved`: reached the goal
  std::int64_t paper_verified = 0;   // of these
  std::int64_t baseline_solved = 0;  // of `solved`
  double baseline_edges_per_s = 0.0;
  double straight_edges_per_s = 0.0;
  std::vector<FrameworkChange> changes;
  // Of missions as long as the paper's, within the tolerance:
  std::int64_t missions = 0;
  double mission_cpu_s_median = 0.0;  // NaN for none
  double mission_wall_s_median = 0.0;
  double cpu_s_median = 0.0;  // of all solved
  double wall_s_median = 0.0;
  double cost_over_bound_median = 0.0;
};

/// Reads seconds of wall time.
using WallClock = std::function<double()>;

/// Table 3 of the paper, and our framework against the paper's.
///
/// Problems are drawn until our framework (the planning config as it is) has a verified plan for
/// `runs` of them, three times as many at most. For each of these
///
/// - the paper's framework plans: our BIT* with the paper's settings for `budget_s`, then TVFH+
///   under `paper_settings`;
/// - the purely global baseline plans: BIT* over Dubins curves whose radius is that of the greatest
///   bank at the config's speed, start and goal heading from the first two and the last two
///   waypoints of our route, `budget_s` and the time of our local planner, under
///   `baseline_settings`.
///
/// All paths are measured alike under `config`; the baseline's as if it were flown at the config's
/// speed. Ours are timed one after the other; the others run two at a time, each in a process of
/// its own with its own clock.
///
/// @param folder  keeps finished problems, so that an interrupted run goes on; empty: none are kept
/// @throws DataError    if the map is too small, or too few problems are solved.
/// @throws Interrupted  if the observer says so.
FrameworkResult compare_frameworks(const map::Map& map, const planning::PlanningConfig& config,
                                   const FrameworkOptions& options, std::uint64_t seed,
                                   const std::filesystem::path& folder,
                                   const ProcessClock& process_cpu_s, const WallClock& wall_s,
                                   Observer& observer);

/// The result as JSON: `comparisons`, `baseline`, `edges_per_s`, `mission`, `time`, `problems`; the
/// paper's figures beside them.
std::string framework_result_json(const FrameworkResult& result, const MachineRecord& machine);

}  // namespace hedgehop::evaluation
