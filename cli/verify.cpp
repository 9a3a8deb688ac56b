#include <CLI/CLI.hpp>
#include <memory>

#include "map/map_bundle.hpp"
#include "output/plan_bundle.hpp"
#include "plan_result.hpp"
#include "planning/planning.hpp"
#include "verbs.hpp"
#include "verification/verifier.hpp"

namespace hedgehop::cli {

void add_verify_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand("verify",
                                  "Check a plan again, independently of the planners that made it");
  verb->footer(
      "Reads the plan's files and the map and checks clearance on the continuous path, vehicle "
      "limits, "
      "kinematics, start and goal. Exit code 0: verified, 4: not.\n"
      "Example:\n"
      "  hedgehop verify plan --map map");
  struct Arguments {
    std::string plan, map;
  };
  auto arguments = std::make_shared<Arguments>();
  verb->add_option("plan", arguments->plan, "Plan bundle, a folder made by `hedgehop plan`")
      ->required();
  verb->add_option("--map", arguments->map, "The map bundle that it was planned on")->required();
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] {
      flight::Plan plan = output::read_plan_bundle(arguments->plan);
      const map::Map map = map::read_map_bundle(arguments->map);
      if (plan.route_plan.map.hash != map.hash) {
        throw UsageError("plan " + arguments->plan + " was made on map " +
                             plan.route_plan.map.hash.hex() + ", but " + arguments->map +
                             " is map " + map.hash.hex(),
                         "give the map that the plan was made on");
      }
      const planning::PlanningConfig config = planning::read_planning_config(
          plan.route_plan.config_text, arguments->plan + "/plan.json: config");
      plan.verdict =
          verification::verify(map, plan.trajectory, plan.route_plan.start, plan.route_plan.goal,
                               config.vehicle.limits, config.demands);
      return report_plan(console, plan, arguments->plan);
    };
  });
}

}  // namespace hedgehop::cli
