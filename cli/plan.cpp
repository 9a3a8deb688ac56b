#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <memory>

#include "base/files.hpp"
#include "map/map_bundle.hpp"
#include "output/figures.hpp"
#include "output/plan_bundle.hpp"
#include "plan_result.hpp"
#include "planning/planning.hpp"
#include "request_arguments.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

struct PlanArguments {
  RequestArguments request;
  std::string map;
  std::string out;
  bool is_overwriting = false;
  bool has_figures = false;
};

ExitCode run(const Console& console, const PlanArguments& arguments) {
  const map_sources::Mission mission = arguments.request.mission(console);
  const planning::PlanningConfig config =
      planning::read_planning_config(planning::effective_planning_config(
                                         arguments.request.config_file, arguments.request.settings),
                                     "effective configuration");
  StagedFolder folder(arguments.out, output::kPlanFile, arguments.is_overwriting);
  const auto observer = console.observer();

  StageTimer timer;
  const map::Map map = map::read_map_bundle(arguments.map);
  observer->check_stop();
  const flight::PlanRequest request = arguments.request.plan_request(mission, &map);
  timer.lap("read_map");
  auto route = planning::plan_route(map, request, config, route_progress(*observer), *observer);
  observer->check_stop();
  timer.lap("route");
  if (const auto* no_plan = std::get_if<flight::NoPlan>(&route)) {
    return report_no_plan(console, *no_plan);
  }
  auto result =
      planning::plan_flight(map, std::get<flight::RoutePlan>(route), config, {}, *observer);
  observer->check_stop();
  timer.lap("flight_and_verification");
  if (const auto* no_plan = std::get_if<flight::NoPlan>(&result)) {
    return report_no_plan(console, *no_plan);
  }
  const auto& plan = std::get<flight::Plan>(result);
  output::write_plan_bundle(plan, folder.path());
  timer.lap("write");
  if (arguments.has_figures) {
    output::write_figures(plan, map, folder.path() / "figures");
    timer.lap("figures");
  }
  observer->check_stop();
  timer.write(folder.path());
  folder.commit();
  return report_plan(console, plan, arguments.out);
}

}  // namespace

void add_plan_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand("plan", "Plan a flight on a prepared map, in this one process");
  verb->footer(
      "Writes plan.json, route.geojson, trajectory.csv and timings.json into the folder --out. The "
      "same map, request, config, seed and work budget give the same bytes.\n"
      "Examples:\n"
      "  hedgehop plan --map map --start 49.95,11.45 --goal 50.05,11.58 --out plan --figures\n"
      "  hedgehop plan --map map --mission mission.yaml --out plan");
  auto arguments = std::make_shared<PlanArguments>();
  verb->add_option("--map", arguments->map, "Map bundle, a folder made by `hedgehop prepare`")
      ->required();
  arguments->request.add_to(*verb);
  verb->add_option("--out", arguments->out, "Folder to write the plan to")->required();
  verb->add_flag("--overwrite", arguments->is_overwriting, "Replace an existing plan in --out");
  verb->add_flag("--figures", arguments->has_figures,
                 "Draw the plan into figures/ (needs gnuplot)");
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] { return run(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
