#include "evaluation/random_evaluation.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <limits>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include "base/errors.hpp"
#include "evaluation/crowd_observer.hpp"
#include "risk/cost_model.hpp"

namespace hedgehop::evaluation {
namespace {

Run run_of(const flight::Plan& plan, const risk::CostModel& costs, double ceiling_height_m) {
  Run run;
  run.outcome = plan.verdict.is_verified ? Outcome::kVerified : Outcome::kNotVerified;
  if (!plan.verdict.violations.empty()) {
    const flight::Violation& first = plan.verdict.violations.front();
    run.explanation = first.rule + " at " + std::to_string(first.time_s) +
                      " s: " + std::to_string(first.value) + ", limit " +
                      std::to_string(first.limit);
  }
  run.measures = costs.measures(plan.trajectory, ceiling_height_m);
  run.route_cost_m = plan.route_plan.route.cost.total_m();
  run.clearance_min_m = plan.verdict.clearance_min_m;
  run.violation_count = plan.verdict.violation_count;
  return run;
}

Run run_of(const flight::NoPlan& no_plan) {
  Run run;
  run.outcome = flight::is_named_cause(no_plan.cause) ? Outcome::kNamedCause : Outcome::kNotFound;
  run.explanation = std::string(flight::name_of(no_plan.cause)) + ": " + no_plan.explanation;
  return run;
}

double relative_change(double value, double baseline) {
  return baseline > 0.0 ? value / baseline - 1.0 : std::numeric_limits<double>::quiet_NaN();
}

void count(RandomResult& result) {
  double visibility_m = 0.0;
  double visibility_baseline_m = 0.0;
  double length_m = 0.0;
  double length_baseline_m = 0.0;
  for (ProblemResult& problem : result.problems) {
    switch (problem.with_weights.outcome) {
      case Outcome::kVerified:
        ++result.verified;
        break;
      case Outcome::kNotVerified:
        ++result.not_verified;
        break;
      case Outcome::kNamedCause:
        ++result.named_cause;
        break;
      case Outcome::kNotFound:
        ++result.not_found;
        break;
      case Outcome::kError:
        ++result.errors;
        break;
    }
    const bool is_baseline_verified = problem.baseline.outcome == Outcome::kVerified;
    result.baseline_verified += is_baseline_verified ? 1 : 0;
    problem.visibility_change = std::numeric_limits<double>::quiet_NaN();
    if (problem.with_weights.outcome == Outcome::kVerified && is_baseline_verified) {
      ++result.compared;
      problem.visibility_change = relative_change(problem.with_weights.measures.visibility_m,
                                                  problem.baseline.measures.visibility_m);
      visibility_m += problem.with_weights.measures.visibility_m;
      visibility_baseline_m += problem.baseline.measures.visibility_m;
      length_m += problem.with_weights.measures.length_m;
      length_baseline_m += problem.baseline.measures.length_m;
    }
  }
  result.visibility_change = relative_change(visibility_m, visibility_baseline_m);
  result.length_change = relative_change(length_m, length_baseline_m);
}

}  // namespace

RandomOptions read_random_options(ConfigReader& reader) {
  RandomOptions options;
  options.problems = reader.required_integer("problems");
  options.drawing = read_drawing_rules(reader);
  options.work_budget = reader.required_integer("work_budget");
  options.baseline_settings = reader.required_strings("baseline_settings");
  reader.require(options.problems >= 1 && options.problems <= 100000, "problems",
                 "must lie between 1 and 100000");
  reader.require(options.work_budget >= 0, "work_budget", "must not be negative");
  reader.finish();
  return options;
}

const char* name_of(Outcome outcome) {
  switch (outcome) {
    case Outcome::kVerified:
      return "verified";
    case Outcome::kNotVerified:
      return "not_verified";
    case Outcome::kNamedCause:
      return "named_cause";
    case Outcome::kNotFound:
      return "not_found";
    case Outcome::kError:
      return "error";
  }
  HEDGEHOP_ASSERT(!"an outcome without a name");
  return "";
}

RandomResult evaluate_random(const map::Map& map, const planning::PlanningConfig& config,
                             const RandomOptions& options, std::uint64_t seed,
                             const PlanFunction& plan, const Clock& clock, Observer& observer) {
  std::string baseline_text = config.text;
  for (const std::string& setting : options.baseline_settings) {
    baseline_text = set_config_value(baseline_text, setting);
  }
  const planning::PlanningConfig baseline =
      planning::read_planning_config(baseline_text, "planning config with baseline_settings");
  const risk::CostModel costs = planning::cost_model(map, config);

  const DrawnProblems drawn = draw_problems(map, options.drawing, options.problems, seed);
  RandomResult result;
  result.seed = seed;
  result.rejected_unknown = drawn.rejected_unknown;
  result.rejected_near = drawn.rejected_near;
  const geo::MapProjection projection(map.crs_wkt);
  for (const DrawnProblem& problem : drawn.problems) {
    ProblemResult entry;
    entry.problem = problem;
    entry.start = projection.to_geodetic(problem.start);
    entry.goal = projection.to_geodetic(problem.goal);
    const double dx_m = problem.goal.x_m - problem.start.x_m;
    const double dy_m = problem.goal.y_m - problem.start.y_m;
    entry.distance_m = std::sqrt(dx_m * dx_m + dy_m * dy_m);
    result.problems.push_back(entry);
  }

  const std::size_t runs = 2 * result.problems.size();
  std::atomic<std::size_t> done{0};
  std::vector<char> is_done(runs, 0);
  observer.progress("planning drawn problems", 0.0, static_cast<double>(runs));
  const auto run_one = [&](std::size_t index) {
    if (observer.stop_requested()) {
      return;
    }
    ProblemResult& entry = result.problems[index / 2];
    const bool is_baseline = index % 2 == 1;
    Run& run = is_baseline ? entry.baseline : entry.with_weights;
    flight::PlanRequest request;
    request.start.position = entry.start;
    request.goal.position = entry.goal;
    request.seed = seed + index / 2;
    request.work_budget = options.work_budget;
    CrowdObserver crowd(observer);
    const double before_s = clock ? clock() : 0.0;
    try {
      // Without isolation a thread that waits inside one plan would begin another one on its stack.
      const auto answer = oneapi::tbb::this_task_arena::isolate(
          [&] { return plan(map, request, is_baseline ? baseline : config, crowd); });
      const auto* found = std::get_if<flight::Plan>(&answer);
      run = found != nullptr ? run_of(*found, costs, config.demands.ceiling_height_m)
                             : run_of(std::get<flight::NoPlan>(answer));
    } catch (const Interrupted&) {
      return;
    } catch (const std::exception& error) {
      run = Run{};
      run.outcome = Outcome::kError;
      run.explanation = error.what();
    }
    run.clock_s = clock ? clock() - before_s : 0.0;
    if (observer.stop_requested()) {
      return;  // it may have ended early
    }
    is_done[index] = 1;
    observer.progress("planning drawn problems", static_cast<double>(++done),
                      static_cast<double>(runs));
  };
  oneapi::tbb::parallel_for(std::size_t{0}, runs, run_one);
  if (observer.stop_requested()) {
    result.is_stopped = true;
    std::vector<ProblemResult> finished;
    for (std::size_t i = 0; i < result.problems.size(); ++i) {
      if (is_done[2 * i] != 0 && is_done[2 * i + 1] != 0) {
        finished.push_back(std::move(result.problems[i]));
      }
    }
    if (finished.empty()) {
      throw Interrupted();
    }
    result.problems = std::move(finished);
  }
  count(result);
  return result;
}

}  // namespace hedgehop::evaluation
