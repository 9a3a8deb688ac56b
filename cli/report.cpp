#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "map/map_bundle.hpp"
#include "output/figures.hpp"
#include "output/plan_bundle.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {

void add_report_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand("report", "Draw a plan: both paths on the map, and its profiles");
  verb->footer(
      "Writes PNG figures, with the gnuplot scripts and data that made them, into PLAN/figures.\n"
      "Example:\n"
      "  hedgehop report plan --map map");
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
      const flight::Plan plan = output::read_plan_bundle(arguments->plan);
      const map::Map map = map::read_map_bundle(arguments->map);
      if (plan.route_plan.map.hash != map.hash) {
        throw UsageError("plan " + arguments->plan + " was not made on map " + arguments->map,
                         "give the map that the plan was made on");
      }
      const std::filesystem::path folder = std::filesystem::path(arguments->plan) / "figures";
      output::write_figures(plan, map, folder);
      if (console.is_json) {
        const nlohmann::ordered_json json = {{"schema_version", 1}, {"figures", folder.string()}};
        std::printf("%s\n", json.dump(2).c_str());
      } else {
        std::printf("figures       %s\n", folder.c_str());
      }
      return ExitCode::kOk;
    };
  });
}

}  // namespace hedgehop::cli
