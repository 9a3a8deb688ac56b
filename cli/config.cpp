#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "base/shipped_config.hpp"
#include "planning/config_origins.hpp"
#include "planning/planning.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

void print_origins(const Console& console, const std::vector<planning::ConfigOrigin>& origins) {
  nlohmann::ordered_json values = nlohmann::ordered_json::array();
  for (const planning::ConfigOrigin& origin : origins) {
    const std::string place =
        origin.line > 0 ? origin.source + ":" + std::to_string(origin.line) : origin.source;
    if (console.is_json) {
      values.push_back({{"key", origin.key},
                        {"value", origin.value},
                        {"source", origin.source},
                        {"line", origin.line}});
    } else {
      std::printf("%-44s %-14s %s\n", origin.key.c_str(), origin.value.c_str(), place.c_str());
    }
  }
  if (console.is_json) {
    const nlohmann::ordered_json json = {
        {"schema", "hedgehop config origin"}, {"schema_version", 1}, {"values", std::move(values)}};
    std::printf("%s\n",
                json.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace).c_str());
  }
}

}  // namespace

void add_config_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand("config", "Show and check configuration");
  verb->require_subcommand(1);
  verb->footer(
      "Examples:\n"
      "  hedgehop config list\n"
      "  hedgehop config show --set weights.visibility=10 > my_planning.yaml");

  auto* list =
      verb->add_subcommand("list", "Names of the configuration files that ship with hedgehop");
  list->footer("Example:\n  hedgehop config list --json");
  add_common_options(*list, console);
  list->callback([&console] {
    console.action = [&console] {
      if (console.is_json) {
        const nlohmann::ordered_json json = {{"schema", "hedgehop config list"},
                                             {"schema_version", 1},
                                             {"shipped", shipped_config_names()}};
        std::printf("%s\n", json.dump(2).c_str());
      } else {
        for (const std::string& name : shipped_config_names()) {
          std::printf("%s\n", name.c_str());
        }
      }
      return ExitCode::kOk;
    };
  });

  auto* show = verb->add_subcommand("show", "The effective planning config, checked");
  show->footer(
      "Examples:\n"
      "  hedgehop config show --config mine.yaml --set speed_mps=30\n"
      "  hedgehop config show --config mine.yaml --origin");
  struct Arguments {
    std::string config_file;
    std::vector<std::string> settings;
    bool has_origin = false;
  };
  auto arguments = std::make_shared<Arguments>();
  show->add_option("--config", arguments->config_file,
                   "YAML file whose keys replace those of the shipped planning.yaml");
  show->add_option("--set", arguments->settings, "One setting, key=value; may be repeated")
      ->allow_extra_args(false);
  show->add_flag("--origin", arguments->has_origin,
                 "Each value with the file and line, or the setting, that it comes from");
  add_common_options(*show, console);
  show->callback([&console, arguments] {
    console.action = [&console, arguments] {
      const planning::PlanningConfig config = planning::read_planning_config(
          planning::effective_planning_config(arguments->config_file, arguments->settings),
          "effective configuration");
      if (arguments->has_origin) {
        print_origins(console, planning::planning_config_origins(arguments->config_file,
                                                                 arguments->settings));
      } else if (console.is_json) {
        const nlohmann::ordered_json json = {{"schema", "hedgehop config show"},
                                             {"schema_version", 1},
                                             {"config_hash", hash128(config.text).hex()},
                                             {"config", config.text}};
        std::printf("%s\n", json.dump(2).c_str());
      } else {
        std::fputs(config.text.c_str(), stdout);
      }
      return ExitCode::kOk;
    };
  });
}

}  // namespace hedgehop::cli
