#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "evaluation_arguments.hpp"
#include "planning/map_for_plan.hpp"
#include "planning/roadmap_store.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

struct RoadmapArguments {
  std::string map;
  PlanningArguments planning;
};

ExitCode run(const Console& console, const RoadmapArguments& arguments) {
  const planning::PlanningConfig config = arguments.planning.calm_config("a roadmap");
  const map::Map map = planning::read_map_for(arguments.map, config);
  const auto observer = console.observer();
  const std::filesystem::path file = planning::roadmap_file(arguments.map);
  const double before_s = process_cpu_s();
  const planning::ReadyRoadmap ready = planning::ready_roadmap(map, config, file, *observer);
  const double cpu_s = process_cpu_s() - before_s;
  if (ready.is_built && !ready.is_written) {
    throw SystemFailure(ready.why_built, "keep the map in a folder that can be written");
  }
  const global_planning::Roadmap& roadmap = *ready.roadmap;
  if (console.is_json) {
    nlohmann::ordered_json json = {{"schema", "hedgehop roadmap"}, {"schema_version", 1}};
    json["file"] = file.string();
    json["map_hash"] = map.hash.hex();
    json["key"] = ready.key.hex();
    json["is_built"] = ready.is_built;
    json["why_built"] = nullptr;
    if (ready.is_built) {
      json["why_built"] = ready.why_built;
    }
    json["columns"] = roadmap.columns();
    json["rows"] = roadmap.rows();
    json["spacing_m"] = roadmap.spacing_m();
    json["bytes"] = std::filesystem::file_size(file);
    json["cpu_s"] = cpu_s;
    std::printf("%s\n", json.dump(2).c_str());
    return ExitCode::kOk;
  }
  std::printf("%s: %d x %d nodes %.0f m apart, %s in %.2f s\n", file.string().c_str(),
              roadmap.columns(), roadmap.rows(), roadmap.spacing_m(),
              ready.is_built ? "made" : "fits the map and the config, read", cpu_s);
  if (ready.is_built) {
    console.say(ready.why_built);
  }
  return ExitCode::kOk;
}

}  // namespace

void add_roadmap_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand("roadmap", "Work out a map once, for many plans");
  verb->footer(
      "Writes MAP.roadmap beside the bundle: a lattice whose edges know what they cost and which "
      "altitudes they allow. Plans with --set global.planner=roadmap find their first route on it; "
      "refinement and every check are those of other plans. The file belongs to one map and one "
      "config; one that does not fit is made anew, by this verb and by `plan`.\n"
      "Examples:\n"
      "  hedgehop roadmap map\n"
      "  hedgehop plan --map map --set global.planner=roadmap --start 49.95,11.45 --goal "
      "50.05,11.58 --out plan");
  auto arguments = std::make_shared<RoadmapArguments>();
  verb->add_option("map", arguments->map, "Map bundle, a folder made by `hedgehop prepare`")
      ->required();
  arguments->planning.add_to(*verb);
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] { return run(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
