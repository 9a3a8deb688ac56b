#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "base/config_reader.hpp"
#include "base/observer.hpp"
#include "evaluation/problem_drawing.hpp"
#include "flight/plan.hpp"
#include "map/map.hpp"
#include "planning/planning.hpp"

namespace hedgehop::evaluation {

/// Section `random` of the evaluation config.
struct RandomOptions {
  std::int64_t problems = 0;
  DrawingRules drawing;
  std::int64_t work_budget = 0;                // per problem; 0: as the planning config says
  std::vector<std::string> baseline_settings;  // on top of the planning config: the zero weights
};
RandomOptions read_random_options(ConfigReader& reader);

enum class Outcome : std::uint8_t {
  kVerified,
  kNotVerified,  // a plan that breaks a demand
  kNamedCause,   // no plan, for a reason that has a name
  kNotFound,     // no plan, and nothing is proved
  kError,        // the planner threw
};

/// "verified" and so on.
const char* name_of(Outcome outcome);

/// One planner's answer to one problem.
struct Run {
  Outcome outcome = Outcome::kNotFound;
  std::string explanation;        // cause and sentence, error, or the first broken rule
  flight::PathMeasures measures;  // of a plan; visibility by the default config's height rule
  double route_cost_m = 0.0;      // of a plan, by its own weights
  double clearance_min_m = 0.0;   // of a plan
  std::int64_t violation_count = 0;
  double clock_s = 0.0;  // readings of the given clock; 0 without one

  [[nodiscard]] bool has_plan() const {
    return outcome == Outcome::kVerified || outcome == Outcome::kNotVerified;
  }
};

struct ProblemResult {
  DrawnProblem problem;
  geo::GeodeticPosition start;
  geo::GeodeticPosition goal;
  double distance_m = 0.0;  // straight
  Run with_weights;
  Run baseline;                    // zero weights
  double visibility_change = 0.0;  // relative to the baseline; NaN unless both are verified
};

struct RandomResult {
  std::uint64_t seed = 0;
  std::int64_t rejected_unknown = 0;
  std::int64_t rejected_near = 0;
  bool is_stopped = false;  // by the observer; then `problems` are those that were finished
  std::vector<ProblemResult> problems;

  // Counts of the runs with weights.
  std::int64_t verified = 0;
  std::int64_t not_verified = 0;
  std::int64_t named_cause = 0;
  std::int64_t not_found = 0;
  std::int64_t errors = 0;

  std::int64_t baseline_verified = 0;
  std::int64_t compared = 0;       // problems where both runs are verified
  double visibility_change = 0.0;  // of the sums over those, -0.2: a fifth less seen; NaN for none
  double length_change = 0.0;      // likewise
};

/// Plans one problem; planning::plan outside tests. Called from several threads at once.
using PlanFunction = std::function<std::variant<flight::Plan, flight::NoPlan>(
    const map::Map& map, const flight::PlanRequest& request, const planning::PlanningConfig& config,
    Observer& observer)>;

/// Reads seconds of some clock of the calling thread; may be empty. Its readings decide nothing.
using Clock = std::function<double()>;

/// Plans drawn problems twice, with the weights of `config` and with those of the baseline, and
/// counts what became of them.
///
/// Start and goal are asked for without a height, which means the reference height. The visibility
/// measure of both runs is the one of CostModel::measures() with the weights of `config`: the same
/// rule for the height in both. Problems run side by side on all threads that oneTBB may use;
/// results do not depend on how many those are.
///
/// @param plan  throws nothing but Interrupted on purpose; anything else becomes Outcome::kError.
/// @throws DataError    if the map is too small.
/// @throws Interrupted  if the observer says so.
RandomResult evaluate_random(const map::Map& map, const planning::PlanningConfig& config,
                             const RandomOptions& options, std::uint64_t seed,
                             const PlanFunction& plan, const Clock& clock, Observer& observer);

/// The result as JSON, without clock readings: `drawn`, `rejected_draws`, `verified`,
/// `not_verified`, `named_cause`, `not_found`, `errors`, `visibility_change`, `seed` and the list
/// of problems.
std::string random_result_json(const RandomResult& result);

/// The clock readings alone: sums and one pair a problem.
std::string random_timings_json(const RandomResult& result);

}  // namespace hedgehop::evaluation
