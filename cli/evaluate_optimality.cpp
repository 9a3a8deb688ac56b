#include "evaluate_optimality.hpp"

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <memory>

#include "evaluation/contestants.hpp"
#include "evaluation/optimality_evaluation.hpp"
#include "evaluation_arguments.hpp"
#include "planning/map_for_plan.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

struct Arguments {
  std::string map;
  std::int64_t problems = 0;
  std::vector<double> budgets_s;
  std::vector<std::string> planners;
  double distance_m = 0.0;
  double polish_s = -1.0;
  SeedArgument seed;
  PlanningArguments planning;
};

// "1.023", or "-" for nothing to count.
std::string text_of(double value, int decimals) {
  if (std::isnan(value)) {
    return "-";
  }
  char text[32];
  std::snprintf(text, sizeof text, "%.*f", decimals, value);
  return text;
}

void print(const evaluation::OptimalityResult& result) {
  std::printf(
      "%zu problems of at least %.0f m with seed %llu; cost over best known and over bound\n",
      result.problems.size(), result.options.drawing.distance_min_m,
      static_cast<unsigned long long>(result.seed));
  std::printf("%-22s %8s %8s %9s %8s %8s %8s %10s %9s %6s\n", "planner", "budget s", "success",
              "first s", "median", "95 %", "bound", "edges/s", "over s", "turns");
  for (const evaluation::OptimalityRow& row : result.rows) {
    std::printf("%-22s %8s %8s %9s %8s %8s %8s %10s %9s %6s\n", row.planner.c_str(),
                text_of(row.budget_s, 2).c_str(), text_of(row.success, 2).c_str(),
                text_of(row.first_route_s_median, 3).c_str(),
                text_of(row.cost_over_best_median, 3).c_str(),
                text_of(row.cost_over_best_p95, 3).c_str(),
                text_of(row.cost_over_bound_median, 3).c_str(), text_of(row.edges_per_s, 0).c_str(),
                text_of(row.overshoot_s_median, 3).c_str(), text_of(row.turns_kept, 2).c_str());
  }
}

ExitCode run(const Console& console, const Arguments& arguments) {
  ConfigReader reader = shipped_evaluation();
  ConfigReader section = reader.required_section("optimality");
  const evaluation::OptimalityConfig shipped = evaluation::read_optimality_config(section);
  evaluation::OptimalityOptions options = shipped.options;
  if (arguments.problems > 0) {
    options.problems = arguments.problems;
  }
  if (!arguments.budgets_s.empty()) {
    options.budgets_s = arguments.budgets_s;
    std::sort(options.budgets_s.begin(), options.budgets_s.end());
  }
  if (!arguments.planners.empty()) {
    options.planners = arguments.planners == std::vector<std::string>{"all"}
                           ? evaluation::contestant_names()
                           : arguments.planners;
  }
  if (arguments.distance_m > 0.0) {
    options.drawing.distance_min_m = arguments.distance_m;
  }
  options.polish_s = arguments.polish_s >= 0.0
                         ? arguments.polish_s
                         : evaluation::polish_s_of(shipped, options.budgets_s);
  const std::uint64_t seed = arguments.seed.value(console);
  const planning::PlanningConfig config = arguments.planning.calm_config("evaluate optimality");
  const map::Map map = planning::read_map_for(arguments.map, config);
  const risk::CostModel costs = planning::cost_model(map, config);
  const auto contestants = evaluation::make_contestants(options.planners, costs, config,
                                                        shipped.overrun_s, process_cpu_s);
  const auto observer = console.observer();
  const evaluation::OptimalityResult result = evaluation::evaluate_optimality(
      map, config, options, seed, contestants,
      evaluation::make_polish(costs, config, process_cpu_s), *observer);
  if (console.is_json) {
    std::printf("%s", evaluation::optimality_result_json(result, this_machine()).c_str());
  } else {
    print(result);
  }
  return evaluation_code(console, result.is_stopped);
}

}  // namespace

void add_optimality_verb(CLI::App& verb, Console& console) {
  auto* optimality = verb.add_subcommand(
      "optimality", "Compare planners with each other, with the best known route and with a bound");
  optimality->footer(
      "Draws problems as `random` does, lets each planner solve each of them and integrates eq. "
      "(1) "
      "along every route in steps of 1 m. Budgets are processor time from a cold start with one "
      "thread. The best known route is the cheapest of all runs and of a polish that follows "
      "them.\n"
      "Planners: recommended (this program's), roadmap (one query on a roadmap made before, not "
      "refined), bitstar (its BIT* with the settings of the paper), "
      "bitstar_labels (first route over directed edges), bitstar_field (that, led by strict bounds "
      "of eq. (1), states drawn from their level set), free_turns (this program's without any rule "
      "about turns, then every 30 m of it moved for itself: no bound that leaves turns free can be "
      "higher than its cost), and the "
      "baselines ompl_bitstar, ompl_abitstar, ompl_aitstar, ompl_rrtstar, ompl_informed_rrtstar, "
      "ompl_prmstar and dubins, each in a process of its own. The library's planners know no rule "
      "about turns; `turns` is the share of routes that keep it all the same. They stop late: what "
      "they have then is counted, and `over s` is how late.\n"
      "Example:\n"
      "  hedgehop evaluate optimality --map map --problems 5 --budgets 0.5,1 --json");
  auto arguments = std::make_shared<Arguments>();
  optimality->add_option("--map", arguments->map, "Map bundle")->required();
  optimality
      ->add_option("--problems", arguments->problems,
                   "Number of problems (default: evaluation.yaml)")
      ->check(CLI::Range(1, 100000));
  optimality
      ->add_option("--budgets", arguments->budgets_s,
                   "Seconds of processor time, with commas between (default: evaluation.yaml)")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(CLI::Range(0.001, 3600.0));
  optimality
      ->add_option("--planners", arguments->planners,
                   "Planners, with commas between, or all (default: evaluation.yaml)")
      ->delimiter(',')
      ->allow_extra_args(false);
  optimality
      ->add_option("--distance-m,--distance", arguments->distance_m,
                   "Least distance between start and goal [m] (default: evaluation.yaml)")
      ->check(CLI::Range(100.0, 1e6));
  optimality
      ->add_option("--polish-s", arguments->polish_s,
                   "Seconds for the best route of each problem (default: three times the last "
                   "budget, at most 60)")
      ->check(CLI::Range(0.0, 36000.0));
  arguments->seed.add_to(*optimality, "the drawing");
  arguments->planning.add_to(*optimality);
  add_common_options(*optimality, console);
  optimality->callback([&console, arguments] {
    console.action = [&console, arguments] { return run(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
