#include "evaluate_framework.hpp"

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <memory>

#include "evaluation/framework_comparison.hpp"
#include "evaluation/sensitivity.hpp"
#include "evaluation_arguments.hpp"
#include "planning/map_for_plan.hpp"

namespace hedgehop::cli {
namespace {

struct FrameworkArguments {
  std::string map;
  std::int64_t runs = 0;
  double budget_s = 0.0;
  std::vector<std::string> parameters;
  SeedArgument seed;
  PlanningArguments planning;
  std::string folder;
};

struct FrameworkConfig {
  evaluation::FrameworkOptions table3;
  evaluation::SensitivityOptions sensitivity;
};

FrameworkConfig config_from(ConfigReader& reader) {
  FrameworkConfig config;
  ConfigReader table3 = reader.required_section("table3");
  config.table3 = evaluation::read_framework_options(table3);
  ConfigReader sensitivity = reader.required_section("sensitivity");
  config.sensitivity = evaluation::read_sensitivity_options(sensitivity);
  return config;
}

void print_change(const char* name, const evaluation::PairedChange& change, const char* paper) {
  std::printf("  %-11s %+6.1f %%  [%+.1f, %+.1f]   %s\n", name, 100.0 * change.change,
              100.0 * change.low, 100.0 * change.high, paper);
}

void print(const evaluation::FrameworkResult& result) {
  std::printf(
      "%zu problems drawn, %lld solved and verified, %lld of the others with a named cause\n",
      result.problems.size(), static_cast<long long>(result.solved),
      static_cast<long long>(result.named_causes));
  std::printf("baseline: %lld of %lld solved in %.0f s each (paper: 66 %%, solved or not solved)\n",
              static_cast<long long>(result.baseline_solved), static_cast<long long>(result.solved),
              result.options.budget_s);
  std::printf("edges per second: straight %.0f, Dubins %.0f (paper: 1.9 times as many)\n",
              result.straight_edges_per_s, result.baseline_edges_per_s);
  std::printf(
      "time: median %.2f s, %.2f processor s; missions of %.1f km: %.2f s (paper: 43.6 s)\n",
      result.wall_s_median, result.cpu_s_median, 1e-3 * result.options.mission_m,
      result.mission_wall_s_median);
  for (const evaluation::FrameworkChange& change : result.changes) {
    const bool is_table3 = change.against == "dubins";
    std::printf("%s against %s, %lld pairs\n", change.name.c_str(), change.against.c_str(),
                static_cast<long long>(change.pairs));
    if (change.pairs == 0) {
      continue;
    }
    print_change("length", change.length, is_table3 ? "paper -31 %" : "");
    print_change("visibility", change.visibility, is_table3 ? "paper -38 %" : "");
    print_change("semantics", change.semantics, is_table3 ? "paper -93 %" : "");
    print_change("height", change.height, is_table3 ? "paper +4 %" : "");
    if (change.bank) {
      print_change("bank", *change.bank, "");
    }
    if (change.cost) {
      print_change("cost", *change.cost, "");
    }
  }
}

ExitCode run_table3(const Console& console, const FrameworkArguments& arguments) {
  ConfigReader reader = shipped_evaluation();
  evaluation::FrameworkOptions options = config_from(reader).table3;
  if (arguments.runs > 0) {
    options.runs = arguments.runs;
  }
  if (arguments.budget_s > 0.0) {
    options.budget_s = arguments.budget_s;
  }
  const std::uint64_t seed = arguments.seed.value(console);
  const planning::PlanningConfig config = arguments.planning.calm_config("evaluate table3");
  const map::Map map = planning::read_map_for(arguments.map, config);
  const auto observer = console.observer();
  const evaluation::FrameworkResult result = evaluation::compare_frameworks(
      map, config, options, seed, arguments.folder, process_cpu_s, wall_s, *observer);
  if (console.is_json) {
    std::printf("%s", evaluation::framework_result_json(result, this_machine()).c_str());
  } else {
    print(result);
  }
  return evaluation_code(console, result.is_stopped);
}

double change_percent(const std::optional<evaluation::PairedChange>& change) {
  return change ? 100.0 * change->change : std::nan("");
}

ExitCode run_sensitivity(const Console& console, const FrameworkArguments& arguments) {
  ConfigReader reader = shipped_evaluation();
  ConfigReader routes = reader.required_section("routes");
  const evaluation::DrawingRules rules = evaluation::read_route_rules(routes);
  evaluation::SensitivityOptions options = config_from(reader).sensitivity;
  if (arguments.runs > 0) {
    options.runs = arguments.runs;
  }
  if (!arguments.parameters.empty()) {
    std::erase_if(options.parameters, [&](const auto& parameter) {
      return std::find(arguments.parameters.begin(), arguments.parameters.end(), parameter.key) ==
             arguments.parameters.end();
    });
    if (options.parameters.size() != arguments.parameters.size()) {
      throw UsageError("--parameters names one that evaluation.yaml does not vary, or one twice",
                       "see the section sensitivity of hedgehop config show evaluation");
    }
  }
  const std::uint64_t seed = arguments.seed.value(console);
  const planning::PlanningConfig config = arguments.planning.calm_config("evaluate sensitivity");
  const map::Map map = planning::read_map_for(arguments.map, config);
  const auto observer = console.observer();
  const evaluation::SensitivityResult result = evaluation::evaluate_sensitivity(
      map, config, options, rules, seed, arguments.folder, planned_route, *observer);
  if (console.is_json) {
    std::printf("%s", evaluation::sensitivity_result_json(result, this_machine()).c_str());
    return evaluation_code(console, result.is_stopped);
  }
  std::printf("%-36s %8s %8s %8s %8s %8s %8s %8s %8s\n", "parameter", "value", "reached", "unsafe",
              "length", "seen", "semantic", "height", "bank");
  for (const evaluation::SensitivityRow& row : result.rows) {
    std::printf("%-36s %8g %8lld %8lld %+7.1f%% %+7.1f%% %+7.1f%% %+7.1f%% %+7.1f%%%s\n",
                row.key.c_str(), row.value, static_cast<long long>(row.reached),
                static_cast<long long>(row.violations), change_percent(row.length),
                change_percent(row.visibility), change_percent(row.semantics),
                change_percent(row.height), change_percent(row.bank), row.is_base ? "  *" : "");
  }
  return evaluation_code(console, result.is_stopped);
}

std::shared_ptr<FrameworkArguments> add_arguments(CLI::App& verb, Console& console,
                                                  const char* folder_help) {
  auto arguments = std::make_shared<FrameworkArguments>();
  verb.add_option("--map", arguments->map, "Map bundle")->required();
  verb.add_option("--runs", arguments->runs, "Number of problems (default: evaluation.yaml)")
      ->check(CLI::Range(1, 100000));
  arguments->seed.add_to(verb, "all that is drawn");
  verb.add_option("--keep", arguments->folder, folder_help);
  arguments->planning.add_to(verb);
  add_common_options(verb, console);
  return arguments;
}

}  // namespace

void add_framework_evaluation_verbs(CLI::App& evaluate, Console& console) {
  auto* table3 = evaluate.add_subcommand(
      "table3", "Compare with the paper's framework and with a baseline of Dubins curves");
  table3->footer(
      "Draws problems until this program has verified plans for --runs of them; counts all. Each "
      "is "
      "then planned by the paper's framework (BIT* for --budget-s seconds, then TVFH+) and by the "
      "purely global baseline of the paper's table 3: BIT* over Dubins curves, headings of both "
      "ends from our route, its time increased by that of our local planner, its envelope as "
      "baseline_settings of evaluation.yaml say. Changes are those of the sums, with a 95 % "
      "bootstrap interval.\n"
      "Two problems are planned at a time, each in a process of its own; times are processor time. "
      "--keep lets an interrupted run go on.\n"
      "Example:\n"
      "  hedgehop evaluate table3 --map map --runs 5 --budget-s 5 --seed 7 --json");
  auto of_table3 = add_arguments(*table3, console,
                                 "Folder that keeps finished problems (default: none is kept)");
  table3
      ->add_option(
          "--budget-s", of_table3->budget_s,
          "Processor time of the other planners [s] (default: evaluation.yaml, as the paper)")
      ->check(CLI::Range(0.01, 3600.0));
  table3->callback([&console, of_table3] {
    console.action = [&console, of_table3] { return run_table3(console, *of_table3); };
  });

  auto* sensitivity = evaluate.add_subcommand(
      "sensitivity", "Vary one parameter at a time and measure what it does to the flights");
  sensitivity->footer(
      "Flies the same drawn problems with each value of each parameter of the section sensitivity "
      "of evaluation.yaml and compares the paper's measures with those under the base settings "
      "(marked *). Weights of the global planner plan the routes anew. 'unsafe' counts flights "
      "that came nearer to the surface than verification.required_clearance_m.\n"
      "Example:\n"
      "  hedgehop evaluate sensitivity --map map --parameters local.window_m --seed 7 --json");
  auto of_sensitivity = add_arguments(*sensitivity, console,
                                      "Folder that keeps global routes (default: none is kept)");
  sensitivity
      ->add_option("--parameters", of_sensitivity->parameters,
                   "Keys to vary, with commas between (default: all of evaluation.yaml)")
      ->delimiter(',')
      ->allow_extra_args(false);
  sensitivity->callback([&console, of_sensitivity] {
    console.action = [&console, of_sensitivity] {
      return run_sensitivity(console, *of_sensitivity);
    };
  });
}

}  // namespace hedgehop::cli
