#include "evaluate_reaction.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cstdio>
#include <memory>

#include "base/angles.hpp"
#include "evaluation/paired_statistics.hpp"
#include "evaluation/reaction_evaluation.hpp"
#include "evaluation_arguments.hpp"
#include "planning/map_for_plan.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

struct Arguments {
  std::string map;
  std::int64_t events = 0;
  std::string routes_folder;
  SeedArgument seed;
  PlanningArguments planning;
};

void print(const evaluation::ReactionResult& result) {
  std::printf("%-9s %7s %7s %7s %8s %12s %7s %12s %12s %9s %9s %9s\n", "kind", "events", "in way",
              "around", "way out", "last resort", "unsafe", "clearance_m", "step_max_deg",
              "median_ms", "95 %_ms", "max_ms");
  for (const auto kind :
       {map::PatchKind::kObstacle, map::PatchKind::kThreat, map::PatchKind::kArea}) {
    std::array<long long, 4> reactions{};
    long long events = 0;
    long long in_way = 0;
    long long unsafe = 0;
    double clearance_m = 1e9;
    double step_rad = 0.0;
    std::vector<double> times_ms;
    for (const evaluation::ReactionEvent& event : result.events) {
      if (event.kind != kind) {
        continue;
      }
      ++events;
      in_way += event.is_in_way ? 1 : 0;
      unsafe += event.is_safe ? 0 : 1;
      ++reactions.at(static_cast<std::size_t>(event.reaction));
      clearance_m = std::min(clearance_m, event.clearance_min_m);
      step_rad = std::max(step_rad, event.heading_step_max_rad);
      times_ms.push_back(1e3 * event.reaction_s);
    }
    std::printf("%-9s %7lld %7lld %7lld %8lld %12lld %7lld %12.1f %12.2f %9.1f %9.1f %9.1f\n",
                map::name_of(kind), events, in_way, reactions[1], reactions[2], reactions[3],
                unsafe, clearance_m, degrees_from_radians(step_rad),
                evaluation::median_of(times_ms), evaluation::quantile_of(times_ms, 0.95),
                evaluation::quantile_of(times_ms, 1.0));
  }
}

ExitCode run(const Console& console, const Arguments& arguments) {
  ConfigReader reader = shipped_evaluation();
  ConfigReader rules = reader.required_section("routes");
  const evaluation::DrawingRules drawing = evaluation::read_route_rules(rules);
  ConfigReader section = reader.required_section("reaction");
  evaluation::ReactionEvaluationOptions options =
      evaluation::read_reaction_evaluation_options(section);
  if (arguments.events > 0) {
    options.events = arguments.events;
  }
  const std::uint64_t seed = arguments.seed.value(console);
  const planning::PlanningConfig config = arguments.planning.config();
  const map::Map map = planning::read_map_for(arguments.map, config);
  const auto observer = console.observer();
  // Some plans do not verify, and some things would lie outside the map.
  const std::int64_t routes = 2 + 5 * options.events / (4 * options.events_per_route);
  const evaluation::DrawnRoutes drawn = evaluation::draw_routes(
      map, config, drawing, routes, seed, arguments.routes_folder, planned_route, *observer);
  const evaluation::ReactionResult result = evaluation::evaluate_reaction(
      map, config, shipped_reaction(), options, drawn, seed, thread_cpu_s, *observer);
  if (console.is_json) {
    std::printf("%s", evaluation::reaction_json(result).c_str());
  } else {
    print(result);
  }
  return evaluation_code(console, result.is_stopped);
}

}  // namespace

void add_reaction_verb(CLI::App& evaluate, Console& console) {
  auto* verb = evaluate.add_subcommand(
      "reaction", "Let things appear ahead of flights, and see what these do at once");
  verb->footer(
      "Flies drawn routes; at drawn moments an obstacle that stands in the way, an observer or a "
      "no-fly area across the plan appears, 400 m ahead and more, and the flight reacts as the "
      "service command_model does (reaction_horizon_s). 'unsafe' counts what is flown then and "
      "does not verify; 'step_max_deg' is the greatest change of the commanded heading from one "
      "step to the next. Times are processor time, from the patch to the new commands.\n"
      "Example:\n"
      "  hedgehop evaluate reaction --map map --events 60 --seed 7 --json");
  auto arguments = std::make_shared<Arguments>();
  verb->add_option("--map", arguments->map, "Map bundle")->required();
  verb->add_option("--events", arguments->events,
                   "Number of things that appear (default: evaluation.yaml)")
      ->check(CLI::Range(1, 100000));
  verb->add_option("--routes", arguments->routes_folder,
                   "Folder that keeps the global routes for the next run (default: none is kept)");
  arguments->seed.add_to(*verb, "all that is drawn");
  arguments->planning.add_to(*verb);
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] { return run(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
