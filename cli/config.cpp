#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "base/shipped_config.hpp"
#include "planning/planning.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {

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
        const nlohmann::ordered_json json = {{"schema_version", 1},
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
  show->footer("Example:\n  hedgehop config show --config mine.yaml --set speed_mps=30");
  struct Arguments {
    std::string config_file;
    std::vector<std::string> settings;
  };
  auto arguments = std::make_shared<Arguments>();
  show->add_option("--config", arguments->config_file,
                   "YAML file whose keys replace those of the shipped planning.yaml");
  show->add_option("--set", arguments->settings, "One setting, key=value; may be repeated")
      ->allow_extra_args(false);
  add_common_options(*show, console);
  show->callback([&console, arguments] {
    console.action = [&console, arguments] {
      const planning::PlanningConfig config = planning::read_planning_config(
          planning::effective_planning_config(arguments->config_file, arguments->settings),
          "effective configuration");
      if (console.is_json) {
        const nlohmann::ordered_json json = {{"schema_version", 1},
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
