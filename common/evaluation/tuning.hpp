#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "base/config_reader.hpp"
#include "base/observer.hpp"
#include "evaluation/drawn_routes.hpp"
#include "evaluation/paired_statistics.hpp"
#include "evaluation/parameter_search.hpp"
#include "flight/trajectory.hpp"
#include "risk/cost_model.hpp"

namespace hedgehop::evaluation {

/// Section `tune` of the evaluation config.
struct TuneOptions {
  struct Parameter {
    ParameterRange range;
    std::string mode;  // of the local planner that it concerns; "any": all
  };
  std::int64_t flights = 0;   // that parameters are searched on, of each map
  std::int64_t held_out = 0;  // that the search never sees, of each map
  std::int64_t bootstrap_draws = 0;
  SearchOptions search;
  std::vector<Parameter> parameters;
};
TuneOptions read_tune_options(ConfigReader& reader);
/// A list `parameters` as in that section.
std::vector<TuneOptions::Parameter> read_tuned_parameters(ConfigReader& reader);
/// `KEY=LOW:HIGH` or `KEY=LOW:HIGH:log`. Throws UsageError.
TuneOptions::Parameter tuned_parameter(const std::string& text);

/// The flight of one problem.
struct TuneFlight {
  std::size_t map = 0;
  std::int64_t problem = 0;
  bool is_reached = false;  // the goal; else nothing below is known
  bool is_verified = false;
  double clearance_m = 0.0;  // least one
  double speed_mps = 0.0;    // that was asked of the local planner
  double cost_m = 0.0;       // local_planning::flight_cost_m()
  flight::PathMeasures measures;
};
/// Flies always the same problems, with a config. Throws Interrupted.
using FlyProblems = std::function<std::vector<TuneFlight>(const planning::PlanningConfig& config,
                                                          const Observer& observer)>;

/// Problems on one map.
struct ProblemsOfMap {
  const risk::CostModel* costs = nullptr;
  std::vector<DrawnRoute> routes;
};
/// Flies them all with fly_route().
/// @note  On all threads that oneTBB may use; the result does not depend on how many those are.
FlyProblems flights_of(std::vector<ProblemsOfMap> problems);

/// What became of all flights of a set, with one config.
struct TuneSafety {
  std::int64_t flights = 0;
  std::int64_t reached = 0;       // the goal; of these are
  std::int64_t collisions = 0;    // the path touches the surface
  std::int64_t violations = 0;    // comes nearer to it than is required
  std::int64_t not_verified = 0;  // breaks any demand
  std::int64_t slowed = 0;        // flown slower than the config's speed, where that was not safe
};

/// Tuned parameters against those that were given, on the same problems.
struct TuneComparison {
  TuneSafety given;
  TuneSafety tuned;
  std::int64_t pairs = 0;                   // verified with both
  std::optional<PairedChange> flight_cost;  // each flight's own change of cost, all alike; so low
                                            // and high are of the mean. Nothing without pairs
  std::vector<std::optional<PairedChange>> by_map;  // the same
  std::optional<PairedChange> cost;                 // of the sums, as all below
  std::optional<PairedChange> length;
  std::optional<PairedChange> visibility;
  std::optional<PairedChange> semantics;
  std::optional<PairedChange> height;  // mean above the surface
  std::optional<PairedChange> bank;    // integral of |bank| over the way
};

struct TuneResult {
  struct Parameter {
    ParameterRange range;
    double given = 0.0;
    double tuned = 0.0;
  };
  std::vector<Parameter> parameters;
  std::int64_t evaluations = 0;
  bool is_stopped = false;                 // the search, by the observer
  std::optional<TuneComparison> training;  // on what the search saw
  std::optional<TuneComparison> held_out;  // nothing before it was checked
  bool is_better = false;
  std::string verdict;  // in words
};

/// Searches for the parameters that make flights cheap. Small is
///
///     mean over problems of  cost / cost with the given config - 1
///
/// over the problems that the given config flies verified. A set of parameters with which one of
/// them is not reached, not verified, or flown slower than it was before, counts as worse than all
/// that fly them: `1 + share of such flights`, and cheap flights buy nothing. Routes are given, and
/// what a flight costs stays what the given config says.
///
/// @param config  what `local` says is the start and what is compared with
/// @throws ConfigError  if a parameter is not one of the section local, is its bank weight (which
///                      the cost is measured by), does not hold the given value in its range, or
///                      may not be what the range says.
/// @throws DataError    if no training problem is flown verified with the given config.
/// @throws Interrupted  if the observer says so before anything was judged.
TuneResult tune(const planning::PlanningConfig& config, const TuneOptions& options,
                const FlyProblems& training, std::uint64_t seed, std::size_t maps,
                Observer& observer);

/// Flies the held-out problems and gives the verdict: tuned parameters are better if the 95 %
/// bootstrap interval of the mean change of cost lies below 0 and no count of safety is worse.
/// @throws Interrupted  if the observer says so; the result is as before then.
void check_held_out(const planning::PlanningConfig& config, const TuneOptions& options,
                    const FlyProblems& held_out, std::uint64_t seed, std::size_t maps,
                    TuneResult& result, Observer& observer);

/// The tuned parameters as a planning config that lies over the shipped one, with the verdict as
/// comments before it.
std::string tuned_config(const TuneResult& result);

/// What identifies a run, for its record.
struct TuneRecord {
  std::uint64_t seed = 0;
  std::vector<std::string> map_hashes;
  std::vector<std::string> map_labels;
  std::string file;  // that tuned_config() went to
};
std::string tune_result_json(const TuneResult& result, const TuneOptions& options,
                             const TuneRecord& record);

}  // namespace hedgehop::evaluation
