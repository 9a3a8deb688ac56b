#include "evaluation/optimality_evaluation.hpp"

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>
#include <oneapi/tbb/global_control.h>

#include "base/errors.hpp"
#include "evaluation/paired_statistics.hpp"
#include "global_planning/flight_envelope.hpp"
#include "global_planning/route_finish.hpp"
#include "raster/grid.hpp"

namespace hedgehop::evaluation {
namespace {

using flight::Waypoint;
using global_planning::FlightEnvelope;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kCostStep_m = 1.0;

/// Judges the routes of one problem.
class Judge {
 public:
  Judge(const risk::CostModel& costs, const global_planning::GlobalOptions& options,
        const OptimalityTask& task)
      : envelope_(costs, options, task.start, task.goal), task_(&task) {}

  [[nodiscard]] bool is_valid(const std::vector<Waypoint>& route) const {
    if (route.size() < 2 || !(route.front() == task_->start) || !(route.back() == task_->goal)) {
      return false;
    }
    for (std::size_t i = 1; i < route.size(); ++i) {
      if (!envelope_.is_clear(route[i - 1], route[i])) {
        return false;
      }
    }
    return true;
  }
  [[nodiscard]] double cost_m(const std::vector<Waypoint>& route) const {
    return envelope_.costs().route_cost(route, kCostStep_m).total_m();
  }
  [[nodiscard]] bool are_turns_kept(const std::vector<Waypoint>& route) const {
    return global_planning::are_turns_allowed(envelope_, route);
  }

 private:
  FlightEnvelope envelope_;
  const OptimalityTask* task_;
};

/// One attempt, judged; the last valid route goes to `last`, costs of routes that keep the turn
/// rule to `offer`.
JudgedAttempt judge(const Judge& judge, const Contestant& contestant, const OptimalityTask& task,
                    const Attempt& attempt, std::vector<Waypoint>& last,
                    const std::function<void(double)>& offer) {
  JudgedAttempt result;
  const auto are_turns_kept = [&](const std::vector<Waypoint>& route) {
    return contestant.turn_rule == "curves" || judge.are_turns_kept(route);
  };
  const auto cost_m = [&](const std::vector<Waypoint>& route) {
    const double total_m = judge.cost_m(route);
    if (are_turns_kept(route)) {
      offer(total_m);
    }
    return total_m;
  };
  result.marks = attempt.marks;
  result.lower_bound_m = attempt.lower_bound_m;
  result.no_route_cause = attempt.no_route_cause;
  result.failure = attempt.failure;
  result.first_route_s = kNaN;
  result.first_route_cost_m = kNaN;
  result.last_cost_m = kNaN;
  for (const TimedRoute& route : attempt.routes) {
    if (judge.is_valid(route.waypoints)) {
      result.first_route_s = route.time_s;
      result.first_route_cost_m = cost_m(route.waypoints);
      break;
    }
  }
  const auto last_until = [&](double until_s) -> const std::vector<Waypoint>* {
    for (auto route = attempt.routes.rbegin(); route != attempt.routes.rend(); ++route) {
      if (route->time_s <= until_s) {
        if (judge.is_valid(route->waypoints)) {
          return &route->waypoints;
        }
        ++result.refused_routes;
      }
    }
    return nullptr;
  };
  for (std::size_t i = 0; i < task.budgets_s.size(); ++i) {
    double until_s = task.budgets_s[i];
    if (contestant.counts_when_stopped && i < attempt.marks.size()) {
      until_s = std::max(until_s, attempt.marks[i].stopped_s);
    }
    const auto* route = last_until(until_s);
    result.costs_m.push_back(route != nullptr ? cost_m(*route) : kNaN);
  }
  result.refused_routes = 0;
  if (const auto* route = last_until(kInfinity)) {
    result.last_cost_m = cost_m(*route);
    result.are_turns_kept = are_turns_kept(*route);
    last = *route;
  }
  return result;
}

OptimalityRow row_of(const std::vector<OptimalityProblem>& problems, const Contestant& contestant,
                     std::size_t who, double budget_s, std::size_t budget) {
  OptimalityRow row;
  row.planner = contestant.name;
  row.turn_rule = contestant.turn_rule;
  row.budget_s = budget_s;
  std::vector<double> first_s;
  std::vector<double> first_over_best;
  std::vector<double> over_best;
  std::vector<double> over_bound;
  std::vector<double> overshoot_s;
  double edges = 0.0;
  double time_s = 0.0;
  double turns_kept = 0.0;
  for (const OptimalityProblem& problem : problems) {
    const JudgedAttempt& attempt = problem.attempts[who];
    row.no_route_causes += attempt.no_route_cause.empty() ? 0 : 1;
    row.failures += attempt.failure.empty() ? 0 : 1;
    if (budget < attempt.marks.size()) {
      const BudgetMark& mark = attempt.marks[budget];
      overshoot_s.push_back(std::max(mark.stopped_s - budget_s, 0.0));
      edges += static_cast<double>(mark.edges);
      time_s += mark.stopped_s;
    }
    if (!std::isnan(attempt.first_route_s)) {
      first_s.push_back(attempt.first_route_s);
      first_over_best.push_back(attempt.first_route_cost_m / problem.best_known_m);
      turns_kept += attempt.are_turns_kept ? 1.0 : 0.0;
    }
    if (const double cost_m = attempt.costs_m[budget]; !std::isnan(cost_m)) {
      ++row.solved;
      over_best.push_back(cost_m / problem.best_known_m);
      if (problem.lower_bound_m > 0.0) {
        over_bound.push_back(cost_m / problem.lower_bound_m);
      }
    }
  }
  row.success = static_cast<double>(row.solved) / static_cast<double>(problems.size());
  row.first_route_s_median = median_of(first_s);
  row.first_route_over_best_median = median_of(first_over_best);
  row.cost_over_best_median = median_of(over_best);
  row.cost_over_best_p95 = quantile_of(over_best, 0.95);
  row.cost_over_bound_median = median_of(over_bound);
  row.edges_per_s = time_s > 0.0 ? edges / time_s : kNaN;
  row.overshoot_s_median = median_of(overshoot_s);
  row.overshoot_s_max =
      overshoot_s.empty() ? kNaN : *std::max_element(overshoot_s.begin(), overshoot_s.end());
  row.turns_kept = first_s.empty() ? kNaN : turns_kept / static_cast<double>(first_s.size());
  return row;
}

// Each planner of ours against each other one, budget by budget.
std::vector<CostRatio> ratios_of(const std::vector<OptimalityProblem>& problems,
                                 const std::vector<Contestant>& contestants,
                                 const std::vector<double>& budgets_s) {
  std::vector<CostRatio> ratios;
  for (std::size_t who = 0; who < contestants.size(); ++who) {
    if (contestants[who].counts_when_stopped) {
      continue;
    }
    for (std::size_t other = 0; other < contestants.size(); ++other) {
      if (other == who || (!contestants[other].counts_when_stopped && other < who)) {
        continue;
      }
      for (std::size_t i = 0; i < budgets_s.size(); ++i) {
        for (std::size_t j = 0; j < budgets_s.size(); ++j) {
          std::vector<double> values;
          for (const OptimalityProblem& problem : problems) {
            const double ratio =
                problem.attempts[who].costs_m[i] / problem.attempts[other].costs_m[j];
            if (!std::isnan(ratio)) {
              values.push_back(ratio);
            }
          }
          ratios.push_back({contestants[who].name, budgets_s[i], contestants[other].name,
                            budgets_s[j], static_cast<std::int64_t>(values.size()),
                            median_of(values)});
        }
      }
    }
  }
  return ratios;
}

// Where a request without heights puts an end.
Waypoint end_at(const map::Map& map, const planning::PlanningConfig& config,
                const geo::MapPoint& point) {
  return {point.x_m, point.y_m,
          raster::max_within(map.surface_m, point, config.global.lateral_margin_m) +
              config.reference_height_m};
}

}  // namespace

OptimalityConfig read_optimality_config(ConfigReader& reader) {
  OptimalityConfig config;
  const auto positive = [&](const char* key) {
    const double value = reader.required_double(key);
    reader.require(value > 0.0 && std::isfinite(value), key, "must be above 0");
    return value;
  };
  OptimalityOptions& options = config.options;
  options.problems = reader.required_integer("problems");
  reader.require(options.problems >= 1 && options.problems <= 100000, "problems",
                 "must lie in 1 to 100000");
  options.drawing = read_drawing_rules(reader);
  options.budgets_s = reader.required_doubles("budgets_s");
  reader.require(!options.budgets_s.empty() && options.budgets_s.front() > 0.0 &&
                     std::is_sorted(options.budgets_s.begin(), options.budgets_s.end()),
                 "budgets_s", "must be ascending and above 0");
  options.planners = reader.required_strings("planners");
  config.polish_share = reader.required_double("polish_share");
  reader.require(config.polish_share >= 0.0, "polish_share", "must not be negative");
  config.polish_max_s = positive("polish_max_s");
  config.overrun_s = positive("overrun_s");
  reader.finish();
  return config;
}

double polish_s_of(const OptimalityConfig& config, const std::vector<double>& budgets_s) {
  return std::min(config.polish_share * budgets_s.back(), config.polish_max_s);
}

OptimalityResult evaluate_optimality(const map::Map& map, const planning::PlanningConfig& config,
                                     const OptimalityOptions& options, std::uint64_t seed,
                                     const std::vector<Contestant>& contestants,
                                     const Polish& polish, Observer& observer) {
  HEDGEHOP_ASSERT(!contestants.empty() && !options.budgets_s.empty() &&
                  std::is_sorted(options.budgets_s.begin(), options.budgets_s.end()));
  const oneapi::tbb::global_control one_thread(oneapi::tbb::global_control::max_allowed_parallelism,
                                               1);
  const DrawnProblems drawn = draw_problems(map, options.drawing, options.problems, seed);
  const geo::MapProjection projection(map.crs_wkt);
  const risk::CostModel costs = planning::cost_model(map, config);
  OptimalityResult result;
  result.seed = seed;
  result.map_hash = map.hash;
  result.map_label = map.label;
  result.options = options;
  result.rejected_draws = drawn.rejected_unknown + drawn.rejected_near;

  const double steps = static_cast<double>(drawn.problems.size() * (contestants.size() + 1));
  double done = 0.0;
  const auto step_done = [&] { observer.progress("measuring planners", done += 1.0, steps); };
  observer.progress("measuring planners", 0.0, steps);
  const auto measure = [&](std::size_t index) {
    const DrawnProblem& ends = drawn.problems[index];
    OptimalityProblem problem;
    problem.start = projection.to_geodetic(ends.start);
    problem.goal = projection.to_geodetic(ends.goal);
    problem.from = end_at(map, config, ends.start);
    problem.to = end_at(map, config, ends.goal);
    problem.distance_m = flight::length_m({problem.from, problem.to});
    // Each metre costs at least 1; rounding of long sums must not exceed the straight leg.
    problem.lower_bound_m = problem.distance_m * (1.0 - 1e-9);
    const OptimalityTask task{problem.from, problem.to, seed + index, options.budgets_s};
    const Judge judging(costs, config.global, task);

    double best_m = kInfinity;
    std::vector<std::pair<double, std::vector<Waypoint>>> candidates;
    const auto offer = [&](double cost_m, const std::string& by) {
      if (cost_m < best_m) {
        best_m = cost_m;
        problem.best_known_by = by;
      }
    };
    for (const Contestant& contestant : contestants) {
      observer.check_stop();
      Attempt attempt;
      try {
        attempt = contestant.run(task, observer);
      } catch (const Interrupted&) {
        throw;
      } catch (const std::exception& error) {
        attempt = Attempt{};
        attempt.failure = error.what();
      }
      std::vector<Waypoint> last;
      problem.attempts.push_back(judge(judging, contestant, task, attempt, last,
                                       [&](double cost_m) { offer(cost_m, contestant.name); }));
      const JudgedAttempt& judged = problem.attempts.back();
      problem.lower_bound_m = std::max(problem.lower_bound_m, judged.lower_bound_m);
      if (!last.empty() && judging.are_turns_kept(last)) {
        candidates.emplace_back(judged.last_cost_m, std::move(last));
      }
      step_done();
    }
    if (polish && options.polish_s > 0.0) {
      std::stable_sort(candidates.begin(), candidates.end(),
                       [](const auto& a, const auto& b) { return a.first < b.first; });
      std::vector<std::vector<Waypoint>> routes;
      for (auto& candidate : candidates) {
        routes.push_back(std::move(candidate.second));
      }
      const std::vector<Waypoint> polished = polish(task, routes, options.polish_s, observer);
      observer.check_stop();
      if (judging.is_valid(polished)) {
        offer(judging.cost_m(polished), "polish");
      }
    }
    step_done();
    problem.best_known_m = best_m < kInfinity ? best_m : kNaN;
    result.problems.push_back(std::move(problem));
  };
  for (std::size_t index = 0; index < drawn.problems.size() && !result.is_stopped; ++index) {
    try {
      measure(index);
    } catch (const Interrupted&) {
      if (result.problems.empty()) {
        throw;
      }
      result.is_stopped = true;
    }
  }

  for (std::size_t who = 0; who < contestants.size(); ++who) {
    for (std::size_t i = 0; i < options.budgets_s.size(); ++i) {
      result.rows.push_back(
          row_of(result.problems, contestants[who], who, options.budgets_s[i], i));
    }
  }
  result.ratios = ratios_of(result.problems, contestants, options.budgets_s);
  return result;
}

}  // namespace hedgehop::evaluation
