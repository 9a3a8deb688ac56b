#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "map/map_bundle.hpp"
#include "map/map_description.hpp"
#include "request_arguments.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {

void add_info_verb(CLI::App& app, Console& console) {
  auto* verb =
      app.add_subcommand("info", "What a map bundle holds, and what it says about a place");
  verb->footer(
      "Examples:\n"
      "  hedgehop info map\n"
      "  hedgehop info map --at 49.987,11.542 --json");
  struct Arguments {
    std::string map, at;
  };
  auto arguments = std::make_shared<Arguments>();
  verb->add_option("map", arguments->map, "Map bundle, a folder made by `hedgehop prepare`")
      ->required();
  verb->add_option("--at", arguments->at, "A place, LAT,LON: what is there");
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] {
      const map::Map map = map::read_map_bundle(arguments->map);
      std::string text;
      if (!arguments->at.empty()) {
        const geo::GeodeticPosition position = parse_request_point(arguments->at, "--at").position;
        text = console.is_json ? map::place_description_json(map, position, arguments->map)
                               : map::place_description_text(map, position, arguments->map);
      } else {
        const std::string manifest = map::read_map_manifest(arguments->map);
        text = console.is_json ? map::map_description_json(map, manifest)
                               : map::map_description_text(map, manifest);
      }
      std::fputs(text.c_str(), stdout);
      if (!text.ends_with('\n')) {
        std::fputc('\n', stdout);
      }
      return ExitCode::kOk;
    };
  });
}

}  // namespace hedgehop::cli
