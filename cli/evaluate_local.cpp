#include "evaluate_local.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>

#include "base/errors.hpp"
#include "evaluation/local_flights.hpp"
#include "evaluation_arguments.hpp"
#include "planning/map_for_plan.hpp"

namespace hedgehop::cli {
namespace {

struct LocalArguments {
  std::string map;
  std::int64_t flights = 0;
  SeedArgument seed;
  PlanningArguments planning;
  std::string routes_folder;
  std::vector<std::string> planners;  // of local-safety; empty: all
};

struct LocalEvaluationConfig {
  evaluation::DrawingRules routes;
  evaluation::Table2Options table2;
  evaluation::LocalSafetyOptions safety;
};

LocalEvaluationConfig config_from(ConfigReader& reader) {
  LocalEvaluationConfig config;
  ConfigReader routes = reader.required_section("routes");
  config.routes = evaluation::read_route_rules(routes);
  ConfigReader table2 = reader.required_section("table2");
  config.table2 = evaluation::read_table2_options(table2);
  ConfigReader safety = reader.required_section("local_safety");
  config.safety = evaluation::read_local_safety_options(safety);
  return config;
}

LocalEvaluationConfig shipped() {
  ConfigReader reader = shipped_evaluation();
  return config_from(reader);
}

// Leaves the rows of the planners that were asked for.
void keep_planners(std::vector<evaluation::LocalSafetyOptions::Row>& rows,
                   const std::vector<std::string>& planners) {
  if (planners.empty()) {
    return;
  }
  const auto is_row_of = [](const std::string& planner) {
    return [&planner](const auto& row) { return row.planner == planner; };
  };
  for (const std::string& planner : planners) {
    if (std::none_of(rows.begin(), rows.end(), is_row_of(planner))) {
      throw UsageError("there is no planner '" + planner + "' in section local_safety",
                       "take one that evaluation.yaml names, as rollout");
    }
  }
  std::erase_if(rows, [&](const auto& row) {
    return std::find(planners.begin(), planners.end(), row.planner) == planners.end();
  });
}

evaluation::DrawnRoutes routes_of(const map::Map& map, const planning::PlanningConfig& config,
                                  const evaluation::DrawingRules& rules, std::int64_t count,
                                  std::uint64_t seed, const LocalArguments& arguments,
                                  Observer& observer) {
  return evaluation::draw_routes(map, config, rules, count, seed, arguments.routes_folder,
                                 planned_route, observer);
}

void print_change(const char* name, const evaluation::PairedChange& change, const char* paper) {
  std::printf("  %-11s %+6.1f %%  [%+.1f, %+.1f]   mean %+.1f +- %.1f %%   paper %s\n", name,
              100.0 * change.change, 100.0 * change.low, 100.0 * change.high,
              100.0 * change.mean_change, 100.0 * change.change_deviation, paper);
}

ExitCode run_table2(const Console& console, const LocalArguments& arguments) {
  LocalEvaluationConfig options = shipped();
  if (arguments.flights > 0) {
    options.table2.runs = arguments.flights;
  }
  const std::uint64_t seed = arguments.seed.value(console);
  const planning::PlanningConfig config = arguments.planning.config();
  const map::Map map = planning::read_map_for(arguments.map, config);
  const auto observer = console.observer();
  const evaluation::DrawnRoutes routes =
      routes_of(map, config, options.routes, options.table2.runs, seed, arguments, *observer);
  const evaluation::Table2Result result =
      evaluation::evaluate_table2(map, config, options.table2, routes, seed, *observer);
  if (console.is_json) {
    std::printf("%s", evaluation::table2_result_json(result).c_str());
    return evaluation_code(console, result.is_stopped);
  }
  for (const evaluation::Table2Comparison& comparison : result.comparisons) {
    std::printf("%s against plain following, %lld pairs (seed %llu)\n", comparison.name.c_str(),
                static_cast<long long>(comparison.pairs),
                static_cast<unsigned long long>(result.seed));
    if (comparison.pairs > 0) {
      print_change("length", comparison.length, "+2 +- 1 %");
      print_change("visibility", comparison.visibility, "-2 +- 4 %");
      print_change("semantics", comparison.semantics, "-4 +- 2 %");
      print_change("height", comparison.height, "-9 +- 9 %");
      print_change("bank", comparison.bank, "+45 +- 16 %");
      print_change("cost", comparison.cost, "-");
    }
    std::printf(
        "  %lld cost more than plain following, which was taken %lld times; %lld not "
        "verified\n",
        static_cast<long long>(comparison.regressions),
        static_cast<long long>(comparison.plain_taken),
        static_cast<long long>(comparison.not_verified));
  }
  return evaluation_code(console, result.is_stopped);
}

ExitCode run_local_safety(const Console& console, const LocalArguments& arguments) {
  LocalEvaluationConfig options = shipped();
  if (arguments.flights > 0) {
    options.safety.flights = arguments.flights;
  }
  keep_planners(options.safety.rows, arguments.planners);
  const std::uint64_t seed = arguments.seed.value(console);
  const planning::PlanningConfig config = arguments.planning.config();
  const map::Map map = planning::read_map_for(arguments.map, config);
  const auto observer = console.observer();
  const evaluation::DrawnRoutes routes =
      routes_of(map, config, options.routes, options.safety.flights, seed, arguments, *observer);
  const evaluation::LocalSafetyResult result = evaluation::evaluate_local_safety(
      map, config.text, options.safety, shipped_reaction(), routes, seed, *observer);
  if (console.is_json) {
    std::printf("%s", evaluation::local_safety_result_json(result).c_str());
    return evaluation_code(console, result.is_stopped);
  }
  std::printf("%-10s %-6s %7s %7s %10s %10s %8s %11s %11s %12s\n", "planner", "towers", "flights",
              "reached", "collisions", "violations", "ways_out", "clearance_m", "height_m",
              "low_share");
  for (const evaluation::LocalSafetyRow& row : result.rows) {
    std::printf(
        "%-10s %-6s %7lld %7lld %10lld %10lld %8lld %11.1f %11.1f %11.1f%%\n", row.planner.c_str(),
        row.has_towers ? "yes" : "no", static_cast<long long>(row.flights),
        static_cast<long long>(row.reached), static_cast<long long>(row.collisions),
        static_cast<long long>(row.clearance_violations), static_cast<long long>(row.ways_out),
        row.min_clearance_m, row.mean_height_m, 100.0 * row.share_under_ceiling_off_towers);
  }
  return evaluation_code(console, result.is_stopped);
}

std::shared_ptr<LocalArguments> add_arguments(CLI::App& verb, Console& console,
                                              const char* flights_name, const char* flights_help) {
  auto arguments = std::make_shared<LocalArguments>();
  verb.add_option("--map", arguments->map, "Map bundle")->required();
  verb.add_option(flights_name, arguments->flights, flights_help)->check(CLI::Range(1, 100000));
  arguments->seed.add_to(verb, "all that is drawn");
  verb.add_option("--routes", arguments->routes_folder,
                  "Folder that keeps the global routes for the next run (default: none is kept)");
  arguments->planning.add_to(verb);
  add_common_options(verb, console);
  return arguments;
}

}  // namespace

void add_local_evaluation_verbs(CLI::App& evaluate, Console& console) {
  auto* table2 =
      evaluate.add_subcommand("table2", "Compare local planning with its optimisation and without");
  table2->footer(
      "Draws problems with start and goal at least 10 km apart, plans a global route for each, and "
      "flies it twice: with local optimisation as the config says, and following the route plainly "
      "(plain_settings of evaluation.yaml). Changes are those of the sums, with a 95 % bootstrap "
      "interval; mean and standard deviation are of each pair's own change, as in the paper's "
      "table 2. The comparison 'lateral' leaves out the vertical pass.\n"
      "Global routes depend on map, seed and all of the config but its section local; --routes "
      "keeps them, also those of an interrupted run.\n"
      "Example:\n"
      "  hedgehop evaluate table2 --map map --runs 100 --seed 7 --routes routes --json");
  auto of_table2 =
      add_arguments(*table2, console, "--runs", "Number of pairs (default: evaluation.yaml)");
  table2->callback([&console, of_table2] {
    console.action = [&console, of_table2] { return run_table2(console, *of_table2); };
  });

  auto* safety = evaluate.add_subcommand(
      "local-safety", "Count collisions of local planning, with and without unknown towers");
  safety->footer(
      "Flies global routes of 10 km and more once for each row of local_safety in "
      "evaluation.yaml. Rows with towers fly among towers of one cell that were added after global "
      "planning. A collision is a path that touches the surface between two states, a violation "
      "one "
      "that comes nearer than verification.required_clearance_m, both by the independent "
      "verifier. Each flight is cut off once at a drawn moment; ways_out counts those that have a "
      "climb-out or climbing turn from there that verifies.\n"
      "Example:\n"
      "  hedgehop evaluate local-safety --map map --flights 200 --seed 7 --routes routes --json");
  auto of_safety =
      add_arguments(*safety, console, "--flights", "Number of flights (default: evaluation.yaml)");
  safety
      ->add_option("--planner", of_safety->planners,
                   "Only the rows of this planner; may be repeated (default: all)")
      ->allow_extra_args(false);
  safety->callback([&console, of_safety] {
    console.action = [&console, of_safety] { return run_local_safety(console, *of_safety); };
  });
}

}  // namespace hedgehop::cli
