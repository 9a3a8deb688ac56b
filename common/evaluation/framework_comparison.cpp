#include "evaluation/framework_comparison.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>
#include <set>
#include <variant>

#include "base/elementary.hpp"
#include "base/errors.hpp"
#include "evaluation/contestants.hpp"
#include "evaluation/crowd_observer.hpp"
#include "evaluation/flown_route.hpp"
#include "evaluation/framework_answers.hpp"
#include "evaluation/kept_answers.hpp"
#include "global_planning/route_finish.hpp"
#include "planning/route_flight.hpp"

namespace hedgehop::evaluation {
namespace {

using flight::Waypoint;
using planning::PlanningConfig;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kCostStep_m = 1.0;
constexpr std::int64_t kTriesPerRun = 3;

double heading_rad(const Waypoint& from, const Waypoint& to) {
  return elementary::atan2(to.y_m - from.y_m, to.x_m - from.x_m);
}

/// A problem and our answer to it, as the other frameworks need it.
struct Solved {
  std::size_t at = 0;  // among the problems
  Waypoint start;
  Waypoint goal;
  global_planning::EndHeadings headings;
};

class Comparison {
 public:
  Comparison(const map::Map& map, const PlanningConfig& config, const FrameworkOptions& options,
             std::uint64_t seed, const ProcessClock& process_cpu_s, const WallClock& wall_s,
             Observer& observer)
      : map_(map),
        config_(config),
        paper_config_(config_with(config.text, options.paper_settings)),
        baseline_config_(config_with(config.text, options.baseline_settings)),
        options_(options),
        seed_(seed),
        process_cpu_s_(process_cpu_s),
        wall_s_(wall_s),
        observer_(observer),
        projection_(map.crs_wkt),
        costs_(planning::cost_model(map, config)) {}

  [[nodiscard]] double turn_radius_m() const {
    return flight::turn_radius_min_m(config_.speed_mps, config_.vehicle.limits.bank_max_rad);
  }

  /// Our framework on one problem.
  std::optional<Solved> plan_ours(const DrawnProblem& ends, FrameworkProblem& problem) {
    flight::PlanRequest request;
    request.start.position = projection_.to_geodetic(ends.start);
    request.goal.position = projection_.to_geodetic(ends.goal);
    request.seed = seed_ + static_cast<std::uint64_t>(problem.number);
    CrowdObserver crowd(observer_);
    const double begin_wall_s = wall_s_();
    const double begin_s = process_cpu_s_();
    auto planned = planning::plan_route(map_, request, config_, {}, crowd);
    const double planned_s = process_cpu_s_();
    observer_.check_stop();
    problem.ours.route_s = planned_s - begin_s;
    if (const auto* none = std::get_if<flight::NoPlan>(&planned)) {
      problem.no_plan_cause = name_of(none->cause);
      problem.has_named_cause = flight::is_named_cause(none->cause);
      return std::nullopt;
    }
    const auto& plan = std::get<flight::RoutePlan>(planned);
    problem.ours.route_cost_m = plan.route.cost.total_m();
    problem.lower_bound_m = plan.route.lower_bound_m;
    DrawnRoute route;
    route.start = plan.start;
    route.goal = plan.goal;
    route.guide = plan.route.guide;
    problem.ours = flight_of(config_, route, problem.ours);
    problem.ours.flight_s = process_cpu_s_() - planned_s;
    problem.wall_s = wall_s_() - begin_wall_s;
    if (!problem.ours.is_verified) {
      problem.no_plan_cause = problem.ours.is_found ? "not_verified" : "not_reached";
      return std::nullopt;
    }
    const std::vector<Waypoint>& way = plan.route.waypoints;
    return Solved{
        static_cast<std::size_t>(problem.number),
        plan.start,
        plan.goal,
        {heading_rad(way[0], way[1]), heading_rad(way[way.size() - 2], way[way.size() - 1])}};
  }

  /// The paper's framework and the baseline on a problem that ours solved.
  void plan_others(const Solved& solved, bool counts_straight_edges, FrameworkProblem& problem) {
    OptimalityTask task{solved.start,
                        solved.goal,
                        seed_ + static_cast<std::uint64_t>(problem.number),
                        {options_.budget_s}};
    const Attempt paper = run_paper_planner(costs_, paper_config_.global, task, options_.overrun_s,
                                            process_cpu_s_, observer_);
    problem.paper.failure = paper.failure;
    problem.paper.route_s = paper.marks.empty() ? kNan : paper.marks.back().stopped_s;
    if (!paper.routes.empty()) {
      const std::vector<Waypoint>& waypoints = paper.routes.back().waypoints;
      problem.paper.route_cost_m = costs_.route_cost(waypoints, kCostStep_m).total_m();
      DrawnRoute route;
      route.start = solved.start;
      route.goal = solved.goal;
      double spacing_m = 0.0;
      route.guide =
          global_planning::equidistant(waypoints, paper_config_.global.guide_spacing_m, spacing_m);
      problem.paper = flight_of(paper_config_, route, problem.paper);
    }

    task.budgets_s = {options_.budget_s + problem.ours.flight_s};
    StockRun dubins{global_planning::StockMethod::kDubins, turn_radius_m(), solved.headings,
                    options_.overrun_s};
    const Attempt baseline =
        run_stock(costs_, baseline_config_.global, dubins, task, process_cpu_s_, observer_);
    problem.baseline.failure = baseline.failure;
    if (!baseline.marks.empty()) {
      problem.baseline_edges = baseline.marks.back().edges;
      problem.baseline_s = baseline.marks.back().stopped_s;
    }
    problem.baseline.route_s = problem.baseline_s;
    problem.baseline.cost_m = kNan;
    if (!baseline.routes.empty()) {
      const std::vector<Waypoint>& route = baseline.routes.back().waypoints;
      problem.baseline.is_found = true;
      problem.baseline.route_cost_m = costs_.route_cost(route, kCostStep_m).total_m();
      problem.baseline.measures =
          costs_.measures(flown_exactly(route), config_.demands.ceiling_height_m);
    }
    if (counts_straight_edges) {
      const StockRun straight{global_planning::StockMethod::kBitStar, 0.0, {}, options_.overrun_s};
      const Attempt stock =
          run_stock(costs_, baseline_config_.global, straight, task, process_cpu_s_, observer_);
      if (!stock.marks.empty()) {
        problem.straight_edges = stock.marks.back().edges;
        problem.straight_s = stock.marks.back().stopped_s;
      }
    }
  }

 private:
  /// The path of a global route, flown.
  [[nodiscard]] FrameworkPath flight_of(const PlanningConfig& config, const DrawnRoute& route,
                                        FrameworkPath path) const {
    if (const auto flight = flown(costs_, config, route, observer_)) {
      path.is_found = true;
      path.is_verified = flight->verdict.is_verified;
      path.measures = flight->measures;
      path.cost_m = flight->cost_m;
    }
    return path;
  }

  /// States along a polyline, a step of the local planner apart.
  [[nodiscard]] flight::Trajectory flown_exactly(const std::vector<Waypoint>& route) const {
    const double step_m = config_.speed_mps * config_.local.step_s;
    double spacing_m = 0.0;
    flight::Trajectory trajectory;
    trajectory.step_s = config_.local.step_s;
    for (const Waypoint& place : global_planning::equidistant(route, step_m, spacing_m)) {
      flight::FlightState state;
      state.time_s = static_cast<double>(trajectory.states.size()) * trajectory.step_s;
      state.x_m = place.x_m;
      state.y_m = place.y_m;
      state.altitude_m = place.altitude_m;
      state.speed_mps = config_.speed_mps;
      state.surface_m = raster::sample_bilinear(map_.surface_m, place.point());
      state.terrain_m = raster::sample_bilinear(map_.terrain_m, place.point());
      trajectory.states.push_back(state);
    }
    return trajectory;
  }

  const map::Map& map_;
  const PlanningConfig& config_;
  PlanningConfig paper_config_;
  PlanningConfig baseline_config_;
  const FrameworkOptions& options_;
  std::uint64_t seed_;
  const ProcessClock& process_cpu_s_;
  const WallClock& wall_s_;
  Observer& observer_;
  geo::MapProjection projection_;
  risk::CostModel costs_;
};

FrameworkChange change_of(const FrameworkResult& result, const char* name,
                          FrameworkPath FrameworkProblem::*first, const char* against,
                          FrameworkPath FrameworkProblem::*second, bool are_flights) {
  FrameworkChange change;
  change.name = name;
  change.against = against;
  const auto paired = [&](const auto& value) {
    std::vector<double> values;
    std::vector<double> baseline;
    for (const FrameworkProblem& problem : result.problems) {
      if (problem.ours.is_verified && (problem.*first).is_found && (problem.*second).is_found) {
        values.push_back(value(problem.*first));
        baseline.push_back(value(problem.*second));
      }
    }
    change.pairs = static_cast<std::int64_t>(values.size());
    return values.empty()
               ? PairedChange{}
               : paired_change(values, baseline, result.options.bootstrap_draws, result.seed);
  };
  change.length = paired([](const FrameworkPath& path) { return path.measures.length_m; });
  change.visibility = paired([](const FrameworkPath& path) { return path.measures.visibility_m; });
  change.semantics = paired([](const FrameworkPath& path) { return path.measures.semantics_m; });
  change.height = paired([](const FrameworkPath& path) { return path.measures.mean_height_m; });
  if (are_flights) {
    change.bank = paired([](const FrameworkPath& path) { return path.measures.bank_rad_m; });
    change.cost = paired([](const FrameworkPath& path) { return path.cost_m; });
  }
  return change;
}

void summarise(FrameworkResult& result) {
  double baseline_edges = 0.0;
  double baseline_s = 0.0;
  double straight_edges = 0.0;
  double straight_s = 0.0;
  std::vector<double> cpu_s;
  std::vector<double> wall_s;
  std::vector<double> mission_cpu_s;
  std::vector<double> mission_wall_s;
  std::vector<double> over_bound;
  const FrameworkOptions& options = result.options;
  for (const FrameworkProblem& problem : result.problems) {
    if (!problem.ours.is_verified) {
      result.named_causes += problem.has_named_cause ? 1 : 0;
      continue;
    }
    ++result.solved;
    result.paper_solved += problem.paper.is_found ? 1 : 0;
    result.paper_verified += problem.paper.is_verified ? 1 : 0;
    result.baseline_solved += problem.baseline.is_found ? 1 : 0;
    if (problem.straight_edges > 0) {
      straight_edges += static_cast<double>(problem.straight_edges);
      straight_s += problem.straight_s;
      baseline_edges += static_cast<double>(problem.baseline_edges);
      baseline_s += problem.baseline_s;
    }
    cpu_s.push_back(problem.ours.route_s + problem.ours.flight_s);
    wall_s.push_back(problem.wall_s);
    if (std::fabs(problem.ours.measures.length_m - options.mission_m) <=
        options.mission_tolerance * options.mission_m) {
      mission_cpu_s.push_back(cpu_s.back());
      mission_wall_s.push_back(problem.wall_s);
    }
    if (problem.lower_bound_m > 0.0) {
      over_bound.push_back(problem.ours.route_cost_m / problem.lower_bound_m);
    }
  }
  // On the same problems, so that both meet the same terrain.
  result.baseline_edges_per_s = baseline_s > 0.0 ? baseline_edges / baseline_s : kNan;
  result.straight_edges_per_s = straight_s > 0.0 ? straight_edges / straight_s : kNan;
  result.missions = static_cast<std::int64_t>(mission_cpu_s.size());
  result.mission_cpu_s_median = median_of(mission_cpu_s);
  result.mission_wall_s_median = median_of(mission_wall_s);
  result.cpu_s_median = median_of(cpu_s);
  result.wall_s_median = median_of(wall_s);
  result.cost_over_bound_median = median_of(over_bound);
  result.changes = {change_of(result, "framework", &FrameworkProblem::ours, "dubins",
                              &FrameworkProblem::baseline, false),
                    change_of(result, "paper_framework", &FrameworkProblem::paper, "dubins",
                              &FrameworkProblem::baseline, false),
                    change_of(result, "framework", &FrameworkProblem::ours, "paper_framework",
                              &FrameworkProblem::paper, true)};
}

}  // namespace

FrameworkOptions read_framework_options(ConfigReader& reader) {
  FrameworkOptions options;
  const auto positive = [&](const char* key) {
    const double value = reader.required_double(key);
    reader.require(value > 0.0 && std::isfinite(value), key, "must be above 0");
    return value;
  };
  options.runs = reader.required_integer("runs");
  options.drawing = read_drawing_rules(reader);
  options.budget_s = positive("budget_s");
  options.overrun_s = positive("overrun_s");
  options.edge_runs = reader.required_integer("edge_runs");
  options.mission_m = positive("mission_m");
  options.mission_tolerance = positive("mission_tolerance");
  options.bootstrap_draws = reader.required_integer("bootstrap_draws");
  options.paper_settings = reader.required_strings("paper_settings");
  options.baseline_settings = reader.required_strings("baseline_settings");
  reader.require(options.runs >= 1 && options.runs <= 100000, "runs",
                 "must lie between 1 and 100000");
  reader.require(options.edge_runs >= 0, "edge_runs", "must not be negative");
  reader.require(options.bootstrap_draws >= 100 && options.bootstrap_draws <= 1000000,
                 "bootstrap_draws", "must lie between 100 and 1000000");
  reader.finish();
  return options;
}

FrameworkResult compare_frameworks(const map::Map& map, const PlanningConfig& config,
                                   const FrameworkOptions& options, std::uint64_t seed,
                                   const std::filesystem::path& folder,
                                   const ProcessClock& process_cpu_s, const WallClock& wall_s,
                                   Observer& observer) {
  const KeptAnswers kept(folder, framework_identity(map, config, options, seed));
  Comparison comparison(map, config, options, seed, process_cpu_s, wall_s, observer);
  FrameworkResult result;
  result.seed = seed;
  result.map_hash = map.hash.hex();
  result.map_label = map.label;
  result.options = options;
  result.turn_radius_m = comparison.turn_radius_m();

  std::vector<Solved> open;
  std::int64_t solved = 0;
  const DrawnProblems drawn =
      draw_problems(map, options.drawing, kTriesPerRun * options.runs, seed);
  while (solved < options.runs &&
         result.problems.size() < static_cast<std::size_t>(kTriesPerRun * options.runs)) {
    observer.progress("our framework", static_cast<double>(solved),
                      static_cast<double>(options.runs));
    FrameworkProblem problem;
    problem.number = static_cast<std::int64_t>(result.problems.size());
    if (const auto json = kept.find(problem.number)) {
      if (const auto known = framework_problem_of(*json, problem.number)) {
        solved += known->ours.is_verified ? 1 : 0;
        ++result.from_cache;
        result.problems.push_back(*known);
        continue;
      }
    }
    std::optional<Solved> answer;
    try {
      answer = comparison.plan_ours(drawn.problems[result.problems.size()], problem);
    } catch (const Interrupted&) {
      result.is_stopped = true;
      break;
    }
    if (answer) {
      open.push_back(*answer);
      ++solved;
    } else {
      kept.keep(problem.number, framework_problem_json(problem));
    }
    result.problems.push_back(std::move(problem));
  }
  observer.progress("our framework", static_cast<double>(options.runs),
                    static_cast<double>(options.runs));
  if (solved < options.runs && !result.is_stopped) {
    throw DataError("only " + std::to_string(solved) + " of " +
                        std::to_string(result.problems.size()) + " drawn problems were solved, " +
                        std::to_string(options.runs) + " were asked for",
                    "ask for fewer, or see with hedgehop evaluate random why");
  }

  // In the order of drawing, so that what an interrupted run has kept is what a shorter one needs.
  std::atomic<std::size_t> next{0};
  std::atomic<std::size_t> done{0};
  std::vector<char> is_finished(open.size(), 0);
  oneapi::tbb::task_arena two(2);
  two.execute([&] {
    oneapi::tbb::parallel_for(0, 2, [&](int) {
      for (std::size_t i = next++; i < open.size(); i = next++) {
        FrameworkProblem& problem = result.problems[open[i].at];
        if (observer.stop_requested()) {
          return;
        }
        try {
          comparison.plan_others(open[i], static_cast<std::int64_t>(i) < options.edge_runs,
                                 problem);
        } catch (const Interrupted&) {
          return;
        }
        if (observer.stop_requested()) {
          return;  // a planner may have ended early
        }
        is_finished[i] = 1;
        kept.keep(problem.number, framework_problem_json(problem));
        observer.progress("the paper's framework and its baseline", static_cast<double>(++done),
                          static_cast<double>(open.size()));
      }
    });
  });
  if (observer.stop_requested()) {
    result.is_stopped = true;
    std::set<std::int64_t> unfinished;
    for (std::size_t i = 0; i < open.size(); ++i) {
      if (is_finished[i] == 0) {
        unfinished.insert(static_cast<std::int64_t>(open[i].at));
      }
    }
    std::erase_if(result.problems, [&](const FrameworkProblem& problem) {
      return unfinished.contains(problem.number);
    });
    if (result.problems.empty()) {
      throw Interrupted();
    }
  }
  summarise(result);
  return result;
}

}  // namespace hedgehop::evaluation
