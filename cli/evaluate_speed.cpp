#include "evaluate_speed.hpp"

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <optional>

#include "evaluation/local_speed.hpp"
#include "evaluation_arguments.hpp"
#include "planning/map_for_plan.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

using local_planning::Kernel;

struct SpeedArguments {
  std::string map;
  PlanningArguments planning;
  evaluation::LocalSpeedOptions options{15, 3, 12000.0, Kernel::kBest};
};

ExitCode run_local_speed(const Console& console, const SpeedArguments& arguments) {
  if (!local_planning::is_available(arguments.options.kernel)) {
    throw UsageError("this processor lacks the instructions that --simd asks for");
  }
  const planning::PlanningConfig config = arguments.planning.calm_config("evaluate local-speed");
  std::optional<map::Map> map;
  if (!arguments.map.empty()) {
    map = planning::read_map_for(arguments.map, config);
  }
  const auto observer = console.observer();
  const evaluation::LocalSpeedResult result = evaluation::evaluate_local_speed(
      map ? &*map : nullptr, config, arguments.options, thread_cpu_s, *observer);
  if (console.is_json) {
    std::printf("%s", evaluation::local_speed_json(result).c_str());
    return evaluation_code(console, result.is_stopped);
  }
  std::printf("processor time of one thread [ms] for 1 km at 40 m/s, a decision every 50 ms (%s)\n",
              result.kernel.c_str());
  std::printf("planner  cell_m  window_m  sectors  ms_per_km  plain form  paper   times  bytes\n");
  for (const evaluation::LocalSpeedRow& row : result.rows) {
    std::printf("%-8s %6.1f  %8.0f  %7d  %9.3f  %10.2f", row.planner.c_str(), row.cell_m,
                row.window_m, row.sectors, row.ms_per_km, row.reference_ms_per_km);
    if (std::isnan(row.paper_ms_per_km)) {
      std::printf("      -       -");
    } else {
      std::printf("  %5.1f  %6.0f", row.paper_ms_per_km, row.paper_ms_per_km / row.ms_per_km);
    }
    std::printf("  %s\n", row.is_same_bytes ? "same" : "DIFFER");
  }
  return evaluation_code(console, result.is_stopped);
}

}  // namespace

void add_local_speed_verb(CLI::App& evaluate, Console& console) {
  auto* verb = evaluate.add_subcommand(
      "local-speed", "Time the local planner's closed loop beside its plain form and the paper");
  verb->footer(
      "Flies one guide of some kilometres again and again, with the windows and numbers of sectors "
      "of the paper's table 1. Times are the least of interleaved repeats and hold the whole step: "
      "histogram, mask, risk, choice, indicators, climb ahead, command model. The padded layers of "
      "the map are made once and timed apart, as setup_ms.\n"
      "Example:\n"
      "  hedgehop evaluate local-speed --json");
  auto arguments = std::make_shared<SpeedArguments>();
  verb->add_option("--map", arguments->map, "Map bundle (default: synthetic hills)");
  verb->add_option("--repeats", arguments->options.repeats, "Flights of which the fastest counts")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  verb->add_option("--reference-repeats", arguments->options.reference_repeats,
                   "Likewise for the plain form")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  verb->add_option("--length", arguments->options.length_m, "Length of the flight [m]")
      ->check(CLI::Range(1000.0, 100000.0))
      ->capture_default_str();
  verb->add_option("--simd", arguments->options.kernel,
                   "Instructions to use: avx2 or avx512 (default: the widest there is)")
      ->transform(CLI::CheckedTransformer(std::map<std::string, Kernel>{
                                              {"avx2", Kernel::kAvx2}, {"avx512", Kernel::kAvx512}})
                      .description("{avx2,avx512}"));
  arguments->planning.add_to(*verb);
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] { return run_local_speed(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
