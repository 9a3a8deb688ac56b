#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <memory>
#include <nlohmann/json.hpp>

#include "bus_arguments.hpp"
#include "map/map_bundle.hpp"
#include "service_children.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

struct ServeArguments {
  BusArguments bus;
  std::string map;
  std::string log;
  bool is_lockstep = false;
};

// "hedgehop-20260131T120000Z.lcmlog"
std::string default_log_name() {
  const std::time_t now = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
  std::tm utc{};
  ::gmtime_r(&now, &utc);
  char name[64];
  std::strftime(name, sizeof name, "hedgehop-%Y%m%dT%H%M%SZ.lcmlog", &utc);
  return name;
}

ExitCode run(const Console& console, const ServeArguments& arguments) {
  ServiceSetup setup;
  setup.bus = arguments.bus.options();
  setup.map = arguments.map;
  setup.log = arguments.log.empty() ? default_log_name() : arguments.log;
  setup.threads = console.threads;
  setup.is_lockstep = arguments.is_lockstep;
  map::read_map_manifest(setup.map);  // says at once when there is no map
  if (std::filesystem::exists(setup.log)) {
    throw UsageError("log " + setup.log.string() + " exists", "name another file with --log");
  }

  bus::Bus bus(setup.bus);
  ServiceChildren children(console, bus, setup);
  if (console.is_json) {
    const nlohmann::ordered_json json = {{"schema", "hedgehop serve"},
                                         {"schema_version", 1},
                                         {"lcm_url", bus.url()},
                                         {"map", setup.map.string()},
                                         {"log", setup.log.string()}};
    std::printf("%s\n", json.dump(2).c_str());
  } else {
    std::printf("services are ready on %s, log %s\n", bus.url().c_str(), setup.log.c_str());
  }
  std::fflush(stdout);
  console.say("Ctrl-C ends them");
  while (!is_stop_requested()) {
    bus.poll(0.1);
    children.watch();
  }
  return children.stop() == 0 ? ExitCode::kOk : ExitCode::kFailure;
}

}  // namespace

void add_serve_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand("serve", "Run the five services for a map, until Ctrl-C");
  verb->footer(
      "Starts flight_logger, map_tiler, global_planner, local_planner and command_model, records "
      "everything on the bus, and starts again what crashes. Then ask for plans with `hedgehop "
      "request`, look on with `hedgehop watch` or lcm-spy.\n"
      "Example:\n"
      "  hedgehop serve --map map --log flight.lcmlog");
  auto arguments = std::make_shared<ServeArguments>();
  verb->add_option("--map", arguments->map, "Map bundle, a folder made by `hedgehop prepare`")
      ->required();
  verb->add_option("--log", arguments->log,
                   "LCM log to write (default: hedgehop-<UTC time>.lcmlog in this folder)");
  verb->add_flag("--lockstep", arguments->is_lockstep,
                 "Let local_planner fly the model of command_model, step by step; same trajectory");
  arguments->bus.add_to(*verb);
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] { return run(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
