#include "evaluate_verifier.hpp"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "evaluation/verifier_evaluation.hpp"
#include "evaluation_arguments.hpp"
#include "planning/map_for_plan.hpp"

namespace hedgehop::cli {
namespace {

struct Arguments {
  std::string map;
  std::int64_t plans = 0;
  SeedArgument seed;
  PlanningArguments planning;
};

long long number(std::int64_t value) { return static_cast<long long>(value); }

void print(const evaluation::VerifierResult& result) {
  std::printf(
      "plans             %lld of %lld problems, seed %llu; %lld without a plan, %zu errors\n",
      number(result.plans), number(result.problems), static_cast<unsigned long long>(result.seed),
      number(result.no_plan), result.errors.size());
  std::printf("judgements        %lld: both accept %lld, both refuse %lld\n",
              number(result.judgements), number(result.both_accept), number(result.both_refuse));
  std::printf("false alarms      %lld, of these %lld by what lies between the samples\n",
              number(result.false_alarms), number(result.between_samples));
  std::printf("accepted wrongly  %lld\n", number(result.accepted_wrongly));
  std::printf(
      "sharp demands     %lld: %lld false alarms just below the clearance, %lld accepted just "
      "above\n",
      number(2 * result.sharp), number(result.sharp_false_alarms),
      number(result.sharp_accepted_wrongly));
  const auto print_gap = [](const char* name, const evaluation::Gap& gap) {
    if (gap.count > 0) {
      std::printf("%-9s         sampled distance above the verifier's by %.6f to %.4f m (%lld)\n",
                  name, gap.least_m, gap.greatest_m, number(gap.count));
    }
  };
  print_gap("ground", result.ground);
  print_gap("wire", result.wire);
  print_gap("obstacle", result.obstacle);
  print_gap("area", result.area);
}

ExitCode run(const Console& console, const Arguments& arguments) {
  ConfigReader reader = shipped_evaluation();
  ConfigReader section = reader.required_section("verifier");
  evaluation::VerifierOptions options = evaluation::read_verifier_options(section);
  if (arguments.plans > 0) {
    options.plans = arguments.plans;
  }
  const std::uint64_t seed = arguments.seed.value(console);
  const planning::PlanningConfig config = arguments.planning.calm_config("evaluate verifier");
  const map::Map map = planning::read_map_for(arguments.map, config);
  const auto observer = console.observer();
  const auto plan = [](const map::Map& on, const flight::PlanRequest& request,
                       const planning::PlanningConfig& with, Observer& watcher) {
    return planning::plan(on, request, with, {}, watcher);
  };
  const evaluation::VerifierResult result =
      evaluation::evaluate_verifier(map, config, options, seed, plan, *observer);
  if (console.is_json) {
    std::printf("%s", evaluation::verifier_result_json(result).c_str());
  } else {
    print(result);
  }
  return evaluation_code(console, result.is_stopped);
}

}  // namespace

void add_verifier_verb(CLI::App& verb, Console& console) {
  auto* verifier =
      verb.add_subcommand("verifier", "Compare the verifier with a check by brute force");
  verifier->footer(
      "Draws problems, plans them and judges each plan twice: by the verifier, and by a plain "
      "check "
      "that looks around every half metre. Each flight is judged as planned, with masts and no-fly "
      "areas drawn beside its path, and under demands just below and just above the clearance that "
      "was measured. A false alarm is a flight that the verifier alone refuses.\n"
      "Example:\n"
      "  hedgehop evaluate verifier --map map --plans 100 --seed 7 --json");
  auto arguments = std::make_shared<Arguments>();
  verifier->add_option("--map", arguments->map, "Map bundle")->required();
  verifier->add_option("--plans", arguments->plans, "Number of problems (default: evaluation.yaml)")
      ->check(CLI::Range(1, 1000000));
  arguments->seed.add_to(*verifier, "the drawing");
  arguments->planning.add_to(*verifier);
  add_common_options(*verifier, console);
  verifier->callback([&console, arguments] {
    console.action = [&console, arguments] { return run(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
