#include <CLI/CLI.hpp>
#include <cstdio>
#include <ctime>
#include <memory>
#include <nlohmann/json.hpp>
#include <random>

#include "base/files.hpp"
#include "base/shipped_config.hpp"
#include "evaluation/random_evaluation.hpp"
#include "map/map_bundle.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

struct RandomArguments {
  std::string map;
  std::int64_t problems = 0;
  std::uint64_t seed = 0;
  bool has_seed = false;
  std::string config_file;
  std::vector<std::string> settings;
  std::string timings_file;
};

evaluation::RandomOptions random_options() {
  ConfigReader reader =
      ConfigReader::from_text(shipped_config("evaluation.yaml"), "config/evaluation.yaml");
  ConfigReader section = reader.required_section("random");
  evaluation::RandomOptions options = evaluation::read_random_options(section);
  reader.finish();
  return options;
}

double thread_cpu_s() {
  timespec time{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

ExitCode run_random(const Console& console, const RandomArguments& arguments) {
  evaluation::RandomOptions options = random_options();
  if (arguments.problems > 0) {
    options.problems = arguments.problems;
  }
  const std::uint64_t seed = arguments.has_seed ? arguments.seed : std::random_device{}();
  console.say("seed " + std::to_string(seed));
  const planning::PlanningConfig config = planning::read_planning_config(
      planning::effective_planning_config(arguments.config_file, arguments.settings),
      "effective configuration");
  const map::Map map = map::read_map_bundle(arguments.map);
  const auto observer = console.observer();
  const auto plan = [](const map::Map& on, const flight::PlanRequest& request,
                       const planning::PlanningConfig& with, Observer& watcher) {
    return planning::plan(on, request, with, {}, watcher);
  };
  const evaluation::RandomResult result =
      evaluation::evaluate_random(map, config, options, seed, plan, thread_cpu_s, *observer);
  if (!arguments.timings_file.empty()) {
    write_file_atomically(arguments.timings_file, evaluation::random_timings_json(result));
  }
  if (console.is_json) {
    std::printf("%s", evaluation::random_result_json(result).c_str());
    return ExitCode::kOk;
  }
  const auto drawn = static_cast<long long>(result.problems.size());
  std::printf("drawn              %lld problems with seed %llu, %lld draws rejected\n", drawn,
              static_cast<unsigned long long>(result.seed),
              static_cast<long long>(result.rejected_unknown + result.rejected_near));
  std::printf("verified           %lld\n", static_cast<long long>(result.verified));
  std::printf("not verified       %lld\n", static_cast<long long>(result.not_verified));
  std::printf("named cause        %lld\n", static_cast<long long>(result.named_cause));
  std::printf("not found          %lld\n", static_cast<long long>(result.not_found));
  std::printf("errors             %lld\n", static_cast<long long>(result.errors));
  std::printf("visibility change  %+.1f %% against zero weights, over %lld problems\n",
              100.0 * result.visibility_change, static_cast<long long>(result.compared));
  std::printf("length change      %+.1f %%\n", 100.0 * result.length_change);
  return ExitCode::kOk;
}

}  // namespace

void add_evaluate_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand("evaluate", "Measure how good the plans are");
  verb->require_subcommand(1);
  verb->footer("Example:\n  hedgehop evaluate random --map map --problems 20 --json");

  auto* random = verb->add_subcommand(
      "random", "Plan problems with random start and goal, with the weights and with zero weights");
  random->footer(
      "Draws start and goal uniformly over the valid cells at least 1.5 km inside the map and at "
      "least "
      "8 km apart, plans each problem with the weights of the config and again with zero weights, "
      "and "
      "counts verified plans, named causes and problems that were not found. visibility_change "
      "compares "
      "the sums of the visibility measure over the problems that both solved: -0.25 is a quarter "
      "less.\n"
      "Example:\n"
      "  hedgehop evaluate random --map map --problems 20 --seed 7 --json");
  auto arguments = std::make_shared<RandomArguments>();
  random->add_option("--map", arguments->map, "Map bundle")->required();
  random
      ->add_option("--problems", arguments->problems,
                   "Number of problems (default: evaluation.yaml)")
      ->check(CLI::Range(1, 100000));
  random->add_option_function<std::uint64_t>(
      "--seed",
      [arguments](const std::uint64_t& value) {
        arguments->seed = value;
        arguments->has_seed = true;
      },
      "Seed of the drawing (default: a fresh one, printed)");
  random->add_option("--config", arguments->config_file,
                     "YAML file whose keys replace those of the shipped planning.yaml");
  random->add_option("--set", arguments->settings, "One setting, key=value; may be repeated")
      ->allow_extra_args(false);
  random->add_option("--timings", arguments->timings_file,
                     "Write the processor seconds of every plan to this JSON file");
  add_common_options(*random, console);
  random->callback([&console, arguments] {
    console.action = [&console, arguments] { return run_random(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
