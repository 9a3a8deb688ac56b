#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "base/files.hpp"
#include "effective_config.hpp"
#include "map/map_bundle.hpp"
#include "output/exports.hpp"
#include "output/plan_bundle.hpp"
#include "planning/planning.hpp"
#include "planning/request_areas.hpp"
#include "request_arguments.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

struct ExportArguments {
  std::string plan, map, out, start_time, config_file;
  std::vector<std::string> formats, settings;
  double clearance_m = 0.0;
  bool is_overwriting = false;
};

// One file if the name says so, else files below a folder. Refuses before anything is done.
std::vector<fs::path> targets_of(const ExportArguments& arguments,
                                 const std::vector<output::ExportFormat>& formats) {
  fs::path out = arguments.out;
  if (!out.has_filename()) {
    out = out.parent_path();
  }
  std::vector<fs::path> targets;
  std::error_code error;
  const bool is_file = formats.size() == 1 && !fs::is_directory(out, error) &&
                       out.extension() == output::entry_of(formats.front()).extension;
  if (is_file) {
    targets.push_back(out);
  } else {
    if (fs::exists(out, error) && !fs::is_directory(out, error)) {
      throw UsageError("--out " + out.string() + " is a file; a folder is needed for " +
                           std::string(formats.size() == 1 ? "this format" : "several formats"),
                       "name a folder, or a file with the extension of its one format");
    }
    for (const output::ExportFormat format : formats) {
      targets.push_back(out / (std::string("flight") + output::entry_of(format).extension));
    }
  }
  const fs::path parent = fs::absolute(out).parent_path();
  if (!fs::is_directory(parent, error)) {
    throw UsageError("the folder " + parent.string() + " does not exist",
                     "create it first, or choose another place");
  }
  for (const fs::path& target : targets) {
    if (fs::exists(target, error) && !arguments.is_overwriting) {
      throw UsageError("output file " + target.string() + " exists already",
                       "choose another name, or add --overwrite to replace it");
    }
    if (fs::is_directory(target, error)) {
      throw UsageError("output file " + target.string() + " is a folder", "choose another name");
    }
  }
  return targets;
}

// Files that stand under their names all together or, when one fails, not at all: those that were
// new are removed again, and the folder with them.
void write_all(const std::vector<fs::path>& targets,
               const std::vector<output::ExportedFile>& files) {
  std::error_code error;
  const fs::path folder = fs::absolute(targets.front()).parent_path();
  const bool is_folder_new = !fs::is_directory(folder, error);
  if (is_folder_new && !fs::create_directory(folder, error)) {
    throw SystemFailure(folder.string() + ": cannot be created: " + error.message());
  }
  std::vector<fs::path> added;
  try {
    for (std::size_t i = 0; i < files.size(); ++i) {
      const bool is_new = !fs::exists(targets[i], error);
      write_file_atomically(targets[i], files[i].content);
      if (is_new) {
        added.push_back(targets[i]);
      }
    }
  } catch (...) {
    for (const fs::path& path : added) {
      fs::remove(path, error);
    }
    if (is_folder_new) {
      fs::remove(folder, error);
    }
    throw;
  }
}

output::ExportOptions options_of(const ExportArguments& arguments) {
  ConfigReader reader = effective_config("export.yaml", arguments.config_file, arguments.settings);
  return output::read_export_options(reader);
}

Json json_of(const output::ExportedFile& file, const fs::path& target) {
  const output::ExportFormatEntry& entry = output::entry_of(file.format);
  Json json = {{"format", entry.name},
               {"file", target.string()},
               {"bytes", file.content.size()},
               {"heights", entry.heights}};
  if (file.legs) {
    json["legs"] = {{"waypoints", file.legs->states.size()},
                    {"added_waypoints", file.legs->added},
                    {"clearance_demanded_m", file.legs->clearance_demanded_m},
                    {"clearance_min_m", file.legs->clearance_min_m},
                    {"lateral_max_m", file.legs->lateral_max_m},
                    {"vertical_max_m", file.legs->vertical_max_m}};
  }
  return json;
}

ExitCode run(const Console& console, const ExportArguments& arguments) {
  std::vector<output::ExportFormat> formats;
  for (const std::string& name : arguments.formats) {
    const output::ExportFormat format = output::export_format(name);
    if (std::find(formats.begin(), formats.end(), format) == formats.end()) {
      formats.push_back(format);
    }
  }
  output::ExportRequest request;
  if (!arguments.start_time.empty()) {
    request.start_time = parse_time(arguments.start_time, "--start-time");
  }
  const output::ExportOptions options = options_of(arguments);
  const flight::Plan plan = output::read_plan_bundle(arguments.plan);
  if (!request.start_time && plan.timetable) {
    request.start_time = plan.timetable->entries.front().expected;
  }
  map::Map map;
  if (!arguments.map.empty()) {
    map = planning::read_map_of_plan(arguments.map, plan, arguments.plan);
    request.map = &map;
    request.map_folder = arguments.map;
  }
  bool has_legs = false;
  for (const output::ExportFormat format : formats) {
    const output::ExportFormatEntry& entry = output::entry_of(format);
    has_legs = has_legs || entry.needs_map;
    if (entry.needs_map && request.map == nullptr) {
      throw UsageError(std::string("format ") + entry.name +
                           " needs the map: straight legs between its few waypoints are checked "
                           "against it",
                       "add --map with the map bundle that the plan was made on");
    }
  }
  request.clearance_m = arguments.clearance_m;
  if (has_legs && request.clearance_m <= 0.0) {
    request.clearance_m = planning::read_recorded_config(plan.route_plan.config_text,
                                                         arguments.plan + "/plan.json: config")
                              .demands.required_clearance_m;
  }

  const std::vector<fs::path> targets = targets_of(arguments, formats);
  const auto observer = console.observer();
  std::vector<output::ExportedFile> files;
  files.reserve(formats.size());
  for (const output::ExportFormat format : formats) {
    files.push_back(output::export_plan(plan, format, request, options));
    observer->check_stop();
  }
  write_all(targets, files);
  Json list = Json::array();
  for (std::size_t i = 0; i < files.size(); ++i) {
    list.push_back(json_of(files[i], targets[i]));
  }

  if (console.is_json) {
    const Json json = {{"schema", "hedgehop export"},
                       {"schema_version", 1},
                       {"plan", arguments.plan},
                       {"is_verified", plan.verdict.is_verified},
                       {"files", std::move(list)}};
    std::printf("%s\n", json.dump(2, ' ', false, Json::error_handler_t::replace).c_str());
  } else {
    for (std::size_t i = 0; i < files.size(); ++i) {
      const output::ExportFormatEntry& entry = output::entry_of(files[i].format);
      std::printf("%-13s %s, heights %s\n", entry.name, targets[i].c_str(), entry.heights);
      if (const auto& legs = files[i].legs) {
        std::printf(
            "              %zu waypoints, %zu of them added to hold %.1f m; straight legs clear "
            "the surface by %.1f m, stray at most %.1f m sideways and %.1f m in height\n",
            legs->states.size(), legs->added, legs->clearance_demanded_m, legs->clearance_min_m,
            legs->lateral_max_m, legs->vertical_max_m);
      }
    }
  }
  for (const output::ExportedFile& file : files) {
    for (const std::string& remark : file.remarks) {
      console.say("note: " + remark);
    }
  }
  if (!plan.verdict.is_verified) {
    console.say("warning: the plan is not verified; the files say so");
  }
  return ExitCode::kOk;
}

}  // namespace

void add_export_verb(CLI::App& app, Console& console) {
  auto* verb =
      app.add_subcommand("export", "Hand a plan on: KML, GPX, GeoPackage, autopilots, ...");
  std::string names;
  for (const output::ExportFormatEntry& entry : output::export_formats()) {
    names += (names.empty() ? "" : ", ") + std::string(entry.name);
  }
  verb->footer(
      "qgc (QGroundControl .plan) and waypoints (QGC WPL 110) hold few waypoints with straight "
      "legs, which are checked against the map; points are added until they hold the clearance. "
      "With --map a GeoPackage also holds the map's layers.\n"
      "Examples:\n"
      "  hedgehop export plan --format kml,gpx --start-time 2026-05-01T06:30Z --out files\n"
      "  hedgehop export plan --map map --format qgc --out flight.plan");
  auto arguments = std::make_shared<ExportArguments>();
  verb->add_option("plan", arguments->plan, "Plan bundle, a folder made by `hedgehop plan`")
      ->required();
  verb->add_option("--format", arguments->formats, "Formats, separated by commas: " + names)
      ->delimiter(',')
      ->allow_extra_args(false)
      ->required();
  verb->add_option("--out", arguments->out,
                   "Folder for the files (flight.kml, ...), or the file of a single format")
      ->required();
  verb->add_option("--map", arguments->map, "The map bundle that it was planned on");
  verb->add_option("--start-time", arguments->start_time,
                   "When the flight begins, ISO 8601 with zone (default: the plan's departure, if "
                   "it has one)");
  verb->add_option("--clearance-m", arguments->clearance_m,
                   "What straight legs must clear (default: as the plan was verified)")
      ->check(CLI::PositiveNumber);
  verb->add_flag("--overwrite", arguments->is_overwriting, "Replace existing files");
  verb->add_option("--config", arguments->config_file,
                   "YAML file whose keys replace those of the shipped export.yaml");
  verb->add_option("--set", arguments->settings,
                   "One setting, key=value, for example legs.lateral_tolerance_m=5")
      ->allow_extra_args(false);
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] { return run(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
