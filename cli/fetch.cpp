#include "fetch/fetch.hpp"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "base/angles.hpp"
#include "base/config_reader.hpp"
#include "base/files.hpp"
#include "effective_config.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

struct FetchArguments {
  std::vector<double> bbox_deg;
  std::string out, terrain, osm, config_file;
  std::vector<std::string> settings;
  bool is_overwriting = false;
  bool is_dry_run = false;
};

fetch::FetchOptions options_of(const FetchArguments& arguments) {
  ConfigReader reader = effective_config("fetch.yaml", arguments.config_file, arguments.settings);
  return fetch::FetchOptions::read(reader);
}

const fetch::Source& source_of(const fetch::FetchRequest& request, const std::string& name) {
  for (const fetch::Source& source : request.sources) {
    if (source.name == name) {
      return source;
    }
  }
  throw std::logic_error("a file without source");
}

std::string in_quotes(const std::string& word) {
  return word.find_first_of(" ()\"$&;*?[]\\") == std::string::npos ? word : "'" + word + "'";
}

// What comes next, as one types it. Empty without terrain.
std::string prepare_command(const FetchArguments& arguments, const fetch::FetchRequest& request,
                            const fetch::FetchReport& report) {
  std::string dem;
  std::string osm;
  std::string attributions;
  for (const fetch::FetchedFile& file : report.files) {
    if (file.state == fetch::FileState::kAbsent || file.state == fetch::FileState::kMissing) {
      continue;
    }
    const fetch::Source& source = source_of(request, file.source);
    if (source.kind == fetch::SourceKind::kOsm) {
      osm += " --osm " + in_quotes(file.path.string());
      continue;
    }
    dem += " --dem " + in_quotes(file.path.string() + source.dem_suffix);
    const std::string attribution = " --attribution " + in_quotes(source.attribution);
    if (attributions.find(attribution) == std::string::npos) {
      attributions += attribution;
    }
  }
  if (dem.empty()) {
    return {};
  }
  char box[160];
  std::snprintf(box, sizeof box, "%.9g,%.9g,%.9g,%.9g", arguments.bbox_deg[0],
                arguments.bbox_deg[1], arguments.bbox_deg[2], arguments.bbox_deg[3]);
  return "hedgehop prepare" + dem + osm + attributions + " --bbox " + box + " --out map";
}

void print_json(const FetchArguments& arguments, const fetch::FetchRequest& request,
                const fetch::FetchReport& report) {
  nlohmann::ordered_json json;
  json["schema"] = "hedgehop fetch";
  json["schema_version"] = 1;
  json["out"] = arguments.out;
  json["is_complete"] = report.is_complete();
  json["files"] = nlohmann::ordered_json::array();
  for (const fetch::FetchedFile& file : report.files) {
    nlohmann::ordered_json entry = {{"path", file.path.string()},
                                    {"state", fetch::name_of(file.state)},
                                    {"source", file.source},
                                    {"url", file.url}};
    if (!file.sha256.empty()) {
      entry["bytes"] = file.bytes;
      entry["sha256"] = file.sha256;
    }
    if (!file.trouble.empty()) {
      entry["trouble"] = file.trouble;
    }
    json["files"].push_back(entry);
  }
  json["prepare"] = report.is_complete() ? prepare_command(arguments, request, report) : "";
  std::printf("%s\n", json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
}

ExitCode report_missing(const Console& console, const fetch::FetchRequest& request,
                        const fetch::FetchReport& report) {
  std::string what;
  int missing = 0;
  for (const fetch::FetchedFile& file : report.files) {
    if (file.state == fetch::FileState::kMissing) {
      ++missing;
      what += "\n  " + file.url + "\n    to " + file.path.string() + "\n    (" + file.trouble + ")";
    }
  }
  std::fprintf(stderr,
               "error: %d of %zu files could not be fetched:%s\n"
               "hint: what has come stays; run the same command again, or bring these files under "
               "these names from a machine with internet and run it then\n",
               missing, report.files.size(), what.c_str());
  for (const fetch::Source& source : request.sources) {
    console.say("source        " + source.name + ": " + source.page);
  }
  return fetch::kNotFetched;
}

ExitCode run(const Console& console, const FetchArguments& arguments) {
  const fetch::FetchOptions options = options_of(arguments);
  fetch::FetchRequest request;
  const auto side = [&](std::size_t i) { return radians_from_degrees(arguments.bbox_deg[i]); };
  request.box = {side(0), side(1), side(2), side(3)};
  const std::string terrain =
      arguments.terrain.empty() ? options.default_terrain : arguments.terrain;
  const std::string osm = arguments.osm.empty() ? options.default_osm : arguments.osm;
  if (terrain != "none") {
    request.sources.push_back(options.source(fetch::SourceKind::kTerrain, terrain));
  }
  if (osm != "none") {
    request.sources.push_back(options.source(fetch::SourceKind::kOsm, osm));
  }
  if (request.sources.empty()) {
    throw UsageError("neither terrain nor OpenStreetMap data is wanted",
                     "leave out --terrain none or --osm none");
  }
  request.folder = arguments.out;
  request.is_overwriting = arguments.is_overwriting;
  const auto observer = console.observer();
  const fetch::FetchReport report = arguments.is_dry_run
                                        ? fetch::look(request, options)
                                        : fetch::fetch(request, options, *observer);
  if (console.is_json) {
    print_json(arguments, request, report);
  } else {
    for (const fetch::FetchedFile& file : report.files) {
      const bool has_file = !file.sha256.empty();
      std::printf("%-13s %s%s\n",
                  arguments.is_dry_run && !has_file ? "to fetch" : fetch::name_of(file.state),
                  has_file ? file.path.c_str() : file.url.c_str(),
                  has_file ? (", " + std::to_string(file.bytes) + " bytes").c_str()
                  : file.state == fetch::FileState::kAbsent ? " (no such tile: sea)"
                                                            : "");
    }
    for (const fetch::Source& source : request.sources) {
      std::printf("licence       %s: %s; %s\n", source.name.c_str(), source.licence.c_str(),
                  source.attribution.c_str());
    }
  }
  if (arguments.is_dry_run) {
    return ExitCode::kOk;
  }
  if (!report.is_complete()) {
    return report_missing(console, request, report);
  }
  const std::string next = prepare_command(arguments, request, report);
  if (!console.is_json && !next.empty()) {
    std::printf("next          %s\n", next.c_str());
  }
  return ExitCode::kOk;
}

}  // namespace

void add_fetch_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand(
      "fetch", "Take terrain and OpenStreetMap data of a region from public sources");
  verb->footer(
      "Sources, licences and manners stand in config/fetch.yaml. "
      "Files "
      "come one after another, broken transfers go on where they ended, fetch.json records where "
      "each file is from. Files that are there already are taken as they are. Exit code 7: not all "
      "could be fetched; the files to bring are listed.\n"
      "Examples:\n"
      "  hedgehop fetch --bbox 9.35,51.65,9.85,51.95 --out weser\n"
      "  hedgehop fetch --bbox 9.35,51.65,9.85,51.95 --terrain copernicus --osm none --out weser "
      "--dry-run");
  auto arguments = std::make_shared<FetchArguments>();
  verb->add_option("--bbox", arguments->bbox_deg, "West,south,east,north in degrees")
      ->delimiter(',')
      ->expected(4)
      ->required();
  verb->add_option("--out", arguments->out, "Folder for the files")->required();
  verb->add_option("--terrain", arguments->terrain,
                   "Source of terrain, or none (default: default_terrain of the config)");
  verb->add_option("--osm", arguments->osm,
                   "Source of OpenStreetMap data, or none (default: default_osm of the config)");
  verb->add_option("--config", arguments->config_file,
                   "YAML file whose keys replace those of the shipped fetch.yaml");
  verb->add_option("--set", arguments->settings, "One setting, key=value; may be repeated")
      ->allow_extra_args(false);
  verb->add_flag("--dry-run", arguments->is_dry_run, "List what would be fetched; ask nobody");
  verb->add_flag("--overwrite", arguments->is_overwriting, "Fetch again what is there");
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] { return run(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
