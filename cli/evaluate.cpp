#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <sys/resource.h>
#include <unistd.h>

#include "base/files.hpp"
#include "base/shipped_config.hpp"
#include "evaluate_bus.hpp"
#include "evaluate_flight.hpp"
#include "evaluate_framework.hpp"
#include "evaluate_local.hpp"
#include "evaluate_optimality.hpp"
#include "evaluate_reaction.hpp"
#include "evaluate_replanning.hpp"
#include "evaluate_speed.hpp"
#include "evaluate_verifier.hpp"
#include "evaluation/protection_evaluation.hpp"
#include "evaluation/random_evaluation.hpp"
#include "evaluation_arguments.hpp"
#include "map/map_bundle.hpp"
#include "planning/map_for_plan.hpp"
#include "preparation/prepare.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

struct RandomArguments {
  std::string map;
  std::int64_t problems = 0;
  SeedArgument seed;
  PlanningArguments planning;
  std::string timings_file;
  bool is_overwriting = false;
};

struct ProtectionArguments {
  std::string map;
  std::int64_t cells = 0;
  int azimuths = 0;  // 0: as configured
  SeedArgument seed;
  preparation::Simd simd = preparation::Simd::kBest;
};

double peak_bytes() {
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  return 1024.0 * static_cast<double>(usage.ru_maxrss);
}

ExitCode run_random(const Console& console, const RandomArguments& arguments) {
  ConfigReader reader = shipped_evaluation();
  ConfigReader section = reader.required_section("random");
  evaluation::RandomOptions options = evaluation::read_random_options(section);
  if (arguments.problems > 0) {
    options.problems = arguments.problems;
  }
  if (std::error_code error; !arguments.timings_file.empty() && !arguments.is_overwriting &&
                             std::filesystem::exists(arguments.timings_file, error)) {
    throw UsageError("output file " + arguments.timings_file + " exists already",
                     "choose another name, or add --overwrite to replace it");
  }
  const std::uint64_t seed = arguments.seed.value(console);
  const planning::PlanningConfig config = arguments.planning.config();
  const map::Map map = planning::read_map_for(arguments.map, config);
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
    return evaluation_code(console, result.is_stopped);
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
  return evaluation_code(console, result.is_stopped);
}

ExitCode run_protection(const Console& console, const ProtectionArguments& arguments) {
  ConfigReader evaluations = shipped_evaluation();
  ConfigReader section = evaluations.required_section("protection");
  evaluation::ProtectionOptions options = evaluation::read_protection_options(section);
  if (arguments.cells > 0) {
    options.error_cells = arguments.cells;
    options.gdal_cells = std::min(options.gdal_cells, arguments.cells);
  }
  const std::uint64_t seed = arguments.seed.value(console);
  const map::Map map = map::read_map_bundle(arguments.map);
  ConfigReader reader =
      ConfigReader::from_text(shipped_config("prepare.yaml"), "config/prepare.yaml");
  preparation::VisibilityOptions visibility = preparation::PrepareOptions::read(reader).visibility;
  visibility.radius_m = map.visibility_radius_m;
  visibility.reference_height_m = map.reference_height_m;
  if (arguments.azimuths > 0) {
    visibility.azimuths = arguments.azimuths;
  }
  const int processors = static_cast<int>(std::max(1L, ::sysconf(_SC_NPROCESSORS_ONLN)));
  const int threads = console.threads > 0 ? console.threads : processors;
  const auto observer = console.observer();
  const evaluation::ProtectionResult result =
      evaluation::evaluate_protection(map, visibility, options, {threads, arguments.simd}, seed,
                                      {process_cpu_s, peak_bytes}, *observer);
  if (console.is_json) {
    std::printf("%s", evaluation::protection_result_json(result).c_str());
    return evaluation_code(console, result.is_stopped);
  }
  std::printf(
      "processor time   %.2f s per million cells (%d azimuths, %s, %d threads), %.2f s with one\n",
      result.cpu_s_per_million_cells, result.azimuths, result.simd.c_str(), result.threads,
      result.one_thread_cpu_s_per_million_cells);
  std::printf("cells            %lld, %s\n", static_cast<long long>(result.timed_cells),
              result.is_surroundings_complete ? "surroundings inside the map"
                                              : "some surroundings beyond the map's edge");
  std::printf("memory           %.0f bytes a cell\n", result.memory_bytes_per_cell);
  std::printf(
      "error            mean %.5f, 95 %% below %.5f, greatest %.5f, bias %+.5f (%lld cells)\n",
      result.error.mean_abs, result.error.p95_abs, result.error.max_abs, result.error.bias,
      static_cast<long long>(result.error.cells));
  std::printf("GDAL             %.0f s per million cells, mean error %.5f (%lld cells)\n",
              result.gdal_cpu_s_per_million_cells, result.gdal_mean_abs_error,
              static_cast<long long>(result.gdal_cells));
  std::printf("changed patch    %.3f s, %s a full run\n", result.update_cpu_s,
              !result.is_update_exact.has_value() ? "not compared with"
              : *result.is_update_exact           ? "same bytes as"
                                                  : "NOT the bytes of");
  std::printf("exposure volume  %zu heights, %.2f s per million cells, %.2f times one height\n",
              result.exposure_heights_m.size() + 1, result.exposure_cpu_s_per_million_cells,
              result.exposure_ratio);
  return evaluation_code(console, result.is_stopped);
}

void add_protection_verb(CLI::App& verb, Console& console) {
  auto* protection = verb.add_subcommand(
      "protection", "Time the visibility layer and compare it with brute force and with GDAL");
  protection->footer(
      "Computes visibility anew over the map's surface, with the map's radius and reference "
      "height. "
      "Cells whose surroundings lie inside the map are timed and drawn, in small maps all cells. "
      "The error is that of the share, 0 to 1, against a line of sight to every cell around; GDAL "
      "is its viewshed function in this process. Times are processor time of all threads.\n"
      "Example:\n"
      "  hedgehop evaluate protection --map map --json");
  auto arguments = std::make_shared<ProtectionArguments>();
  protection->add_option("--map", arguments->map, "Map bundle")->required();
  protection
      ->add_option("--cells", arguments->cells,
                   "Cells to compare with brute force (default: evaluation.yaml)")
      ->check(CLI::Range(1, 1000000));
  protection
      ->add_option("--azimuths", arguments->azimuths,
                   "Directions to look in, a multiple of 4 (default: prepare.yaml)")
      ->check(CLI::Range(8, 1000))
      ->check([](const std::string& text) {
        return std::stoi(text) % 4 == 0 ? "" : text + " is not a multiple of 4";
      });
  arguments->seed.add_to(*protection, "the drawing");
  protection
      ->add_option("--simd", arguments->simd,
                   "Instructions to use: avx2 or avx512 (default: the widest there is)")
      ->transform(CLI::CheckedTransformer(std::map<std::string, preparation::Simd>{
                                              {"avx2", preparation::Simd::kAvx2},
                                              {"avx512", preparation::Simd::kAvx512}})
                      .description("{avx2,avx512}"));
  add_common_options(*protection, console);
  protection->callback([&console, arguments] {
    console.action = [&console, arguments] { return run_protection(console, *arguments); };
  });
}

}  // namespace

void add_evaluate_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand("evaluate", "Measure how good plans and maps are");
  verb->require_subcommand(1);
  verb->footer(
      "Ctrl-C once ends all but bus and flight with what is finished (exit code 4; 130 if there is "
      "nothing).\n"
      "Examples:\n  hedgehop evaluate random --map map --problems 20 --json\n"
      "  hedgehop evaluate protection --map map --json\n"
      "  hedgehop evaluate table2 --map map --routes routes --json\n"
      "  hedgehop evaluate table3 --map map --runs 5 --budget-s 5 --json\n"
      "  hedgehop evaluate sensitivity --map map --json\n"
      "  hedgehop evaluate local-safety --map map --routes routes --json\n"
      "  hedgehop evaluate local-speed --json\n"
      "  hedgehop evaluate optimality --map map --problems 5 --json\n"
      "  hedgehop evaluate replanning --map map --events 20 --json\n"
      "  hedgehop evaluate reaction --map map --events 60 --json\n"
      "  hedgehop evaluate verifier --map map --plans 100 --json\n"
      "  hedgehop evaluate bus --map map --json\n"
      "  hedgehop evaluate flight --map map --plans 20 --json");
  add_bus_evaluation_verb(*verb, console);
  add_flight_evaluation_verb(*verb, console);
  add_protection_verb(*verb, console);
  add_local_evaluation_verbs(*verb, console);
  add_framework_evaluation_verbs(*verb, console);
  add_optimality_verb(*verb, console);
  add_reaction_verb(*verb, console);
  add_replanning_verb(*verb, console);
  add_local_speed_verb(*verb, console);
  add_verifier_verb(*verb, console);

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
  arguments->seed.add_to(*random, "the drawing");
  arguments->planning.add_to(*random);
  random->add_option("--timings", arguments->timings_file,
                     "Write the processor seconds of every plan to this JSON file");
  random->add_flag("--overwrite", arguments->is_overwriting, "Replace an existing --timings file");
  add_common_options(*random, console);
  random->callback([&console, arguments] {
    console.action = [&console, arguments] { return run_random(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
