#include "evaluate_replanning.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>

#include "evaluation/replanning_evaluation.hpp"
#include "evaluation_arguments.hpp"
#include "planning/map_for_plan.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

struct Arguments {
  std::string map;
  std::int64_t events = 0;
  double distance_m = 0.0;
  SeedArgument seed;
  PlanningArguments planning;
};

void print_spread(const char* name, const evaluation::Spread& spread) {
  std::printf("%-34s %9.3f %9.3f %9.3f\n", name, spread.median, spread.p95, spread.max);
}

void print(const evaluation::ReplanningResult& result) {
  using evaluation::ReplanningEvent;
  const auto row = [&](const char* name, double scale, const auto& value) {
    std::vector<double> values;
    for (const ReplanningEvent& event : result.events) {
      values.push_back(scale * value(event));
    }
    const evaluation::Spread spread = evaluation::spread_of(values);
    print_spread(name, spread);
  };
  const auto count = [&](const auto& is) {
    return static_cast<long long>(std::count_if(result.events.begin(), result.events.end(), is));
  };
  std::printf("%zu threats on routes with seed %llu; %lld valid, %lld planned anew\n",
              result.events.size(), static_cast<unsigned long long>(result.seed),
              count([](const ReplanningEvent& event) { return event.is_valid; }),
              count([](const ReplanningEvent& event) { return event.is_cold; }));
  std::printf("%-34s %9s %9s %9s\n", "", "median", "95 %", "greatest");
  print_spread("prepared, processor time [s]", evaluation::spread_of(result.prepare_s));
  row("warm, processor time [ms]", 1e3, [](const ReplanningEvent& e) { return e.warm_s; });
  row("cold, processor time [ms]", 1e3, [](const ReplanningEvent& e) { return e.cold_s; });
  row("cost over its own polish", 1.0,
      [](const ReplanningEvent& e) { return e.cost_m / e.polished_m; });
  row("cost over the cold plan's", 1.0,
      [](const ReplanningEvent& e) { return e.cost_m / e.cold_cost_m; });
  row("cost of flying on over cost", 1.0,
      [](const ReplanningEvent& e) { return e.old_cost_m / e.cost_m; });
}

ExitCode run(const Console& console, const Arguments& arguments) {
  ConfigReader reader = shipped_evaluation();
  ConfigReader section = reader.required_section("replanning");
  evaluation::ReplanningOptions options = evaluation::read_replanning_options(section);
  if (arguments.events > 0) {
    options.events = arguments.events;
  }
  if (arguments.distance_m > 0.0) {
    options.drawing.distance_min_m = arguments.distance_m;
  }
  const std::uint64_t seed = arguments.seed.value(console);
  const planning::PlanningConfig config = arguments.planning.calm_config("evaluate replanning");
  const map::Map map = planning::read_map_for(arguments.map, config);
  const auto observer = console.observer();
  const evaluation::ReplanningResult result =
      evaluation::evaluate_replanning(map, config, options, seed, process_cpu_s, *observer);
  if (console.is_json) {
    std::printf("%s", evaluation::replanning_json(result, this_machine()).c_str());
  } else {
    print(result);
  }
  return evaluation_code(console, result.is_stopped);
}

}  // namespace

void add_replanning_verb(CLI::App& evaluate, Console& console) {
  auto* verb = evaluate.add_subcommand(
      "replanning", "Time new routes around threats that appear while an old one is flown");
  verb->footer(
      "Plans drawn problems; then, several times for each, moves the start along the route and "
      "raises the visibility in a disc on what lies ahead. The warm planner keeps what of the "
      "field of costs and of the route is still good. Its route is checked on an envelope made "
      "anew, its cost compared with what refining it to the end gives (its own polish) and with "
      "planning anew (cold). Times are processor time of one thread.\n"
      "Example:\n"
      "  hedgehop evaluate replanning --map map --events 20 --json");
  auto arguments = std::make_shared<Arguments>();
  verb->add_option("--map", arguments->map, "Map bundle")->required();
  verb->add_option("--events", arguments->events, "Number of threats (default: evaluation.yaml)")
      ->check(CLI::Range(1, 100000));
  verb->add_option("--distance-m,--distance", arguments->distance_m,
                   "Least distance between start and goal [m] (default: evaluation.yaml)")
      ->check(CLI::Range(100.0, 1e6));
  arguments->seed.add_to(*verb, "the drawing");
  arguments->planning.add_to(*verb);
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] { return run(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
