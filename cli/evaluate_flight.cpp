#include "evaluate_flight.hpp"

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <memory>

#include "base/shipped_config.hpp"
#include "evaluation/flight_evaluation.hpp"
#include "evaluation_arguments.hpp"
#include "planning/map_for_plan.hpp"
#include "services/command_model/command_model_service.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

struct Arguments {
  std::string map;
  std::int64_t plans = 0;
  double wind_mps = -1.0;
  double turbulence_mps = -1.0;
  SeedArgument seed;
  PlanningArguments planning;
};

ConfigReader shipped(const char* file) {
  return ConfigReader::from_text(shipped_config(file), std::string("config/") + file);
}

ExitCode run(const Console& console, const Arguments& arguments) {
  ConfigReader evaluation = shipped("evaluation.yaml");
  ConfigReader section = evaluation.required_section("flight");
  evaluation::FlightOptions options = evaluation::read_flight_options(section);
  if (arguments.plans > 0) {
    options.plans = arguments.plans;
  }
  if (arguments.wind_mps >= 0.0) {
    options.wind_mps = arguments.wind_mps;
  }
  if (arguments.turbulence_mps >= 0.0) {
    options.turbulence_wind_6m_mps = arguments.turbulence_mps;
  }
  ConfigReader rotor_file = shipped("rotor_plant.yaml");
  const auto rotor = command_model::read_rotor_parameters(rotor_file);
  const auto service = services::read_command_model_options(shipped("command_model.yaml"));
  const std::uint64_t seed = arguments.seed.value(console);
  const planning::PlanningConfig config = arguments.planning.config();
  const map::Map map = planning::read_map_for(arguments.map, config);
  const auto observer = console.observer();
  const evaluation::FlightResult result = evaluation::evaluate_flight(
      map, config, options, rotor, service.path_following, seed, *observer);
  if (console.is_json) {
    std::printf("%s", evaluation::flight_result_json(result).c_str());
    return result.is_held ? ExitCode::kOk : ExitCode::kFailure;
  }
  std::printf("%lld plans of %lld problems, wind of %.1f m/s from drawn directions\n",
              static_cast<long long>(result.plans), static_cast<long long>(result.problems),
              result.wind_mps);
  std::printf("margins %.1f m beside, %.1f m below, %.1f m above; rotor has %.0f kW\n",
              result.horizontal_margin_m, result.below_margin_m, result.above_margin_m,
              result.rotor_power_kw);
  std::printf(
      "plant        feed-fwd  wind   within  beside  (rms)   below   above  torque margin\n");
  for (const evaluation::FlightRow& row : result.rows) {
    std::printf("%-12s %-8s  %-5s  %3lld/%-3lld %6.2f %6.2f  %6.2f  %6.2f", row.plant.c_str(),
                row.has_feed_forward ? "yes" : "no",
                row.has_turbulence ? "gusts"
                : row.has_wind     ? "yes"
                                   : "no",
                static_cast<long long>(row.within_margins), static_cast<long long>(row.flights),
                row.horizontal_max_m, row.horizontal_rms_m, row.below_max_m, row.above_max_m);
    if (std::isnan(row.torque_margin_min)) {
      std::printf("\n");
    } else {
      std::printf("  %6.1f %%%s\n", 100.0 * row.torque_margin_min,
                  row.power_limited_flights > 0 ? " (held back)" : "");
    }
  }
  std::printf("%s\n", result.is_held
                          ? "every flight kept its path, with feed-forward within its power"
                          : "NOT every flight kept its path, with feed-forward within its power");
  return result.is_held ? ExitCode::kOk : ExitCode::kFailure;
}

}  // namespace

void add_flight_evaluation_verb(CLI::App& evaluate, Console& console) {
  auto* verb = evaluate.add_subcommand(
      "flight", "Fly plans with path-following controllers, in wind, also with a rotor plant");
  verb->footer(
      "Draws problems, plans them and flies each verified plan eight times: by the planner's "
      "closed-loop model and by an independent plant with the power of a rotor (rotor_plant.yaml), "
      "with and without the plan's states as feed-forward, without and with wind. Deviations are "
      "those from the path beside the vehicle. Exit code 1 if a flight left the margins of "
      "evaluation.yaml, or if one with feed-forward asked for more power than there is. A torque "
      "margin of 0.1 says that a tenth of the available torque was never needed.\n"
      "Example:\n"
      "  hedgehop evaluate flight --map map --plans 20 --json");
  auto arguments = std::make_shared<Arguments>();
  verb->add_option("--map", arguments->map, "Map bundle")->required();
  verb->add_option("--plans", arguments->plans, "Plans to fly (default: evaluation.yaml)")
      ->check(CLI::Range(1, 100000));
  verb->add_option("--wind-mps", arguments->wind_mps,
                   "Speed of the wind (default: evaluation.yaml)")
      ->check(CLI::Range(0.0, 30.0));
  verb->add_option("--turbulence-mps", arguments->turbulence_mps,
                   "Mean wind 6 m above the ground of Dryden turbulence, in rows of its own that "
                   "no margin binds; 0: none (default: evaluation.yaml)")
      ->check(CLI::Range(0.0, 40.0));
  arguments->seed.add_to(*verb, "the drawing");
  arguments->planning.add_to(*verb);
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] { return run(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
