#include "evaluation_arguments.hpp"

#include <CLI/CLI.hpp>
#include <ctime>
#include <fstream>
#include <random>

#include "base/errors.hpp"
#include "base/shipped_config.hpp"
#include "hedgehop_version.hpp"
#include "preparation/visibility.hpp"
#include "services/command_model/command_model_service.hpp"

namespace hedgehop::cli {
namespace {

double seconds_of(clockid_t clock) {
  timespec time{};
  ::clock_gettime(clock, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

}  // namespace

void PlanningArguments::add_to(CLI::App& verb) {
  verb.add_option("--config", config_file,
                  "YAML file whose keys replace those of the shipped planning.yaml");
  verb.add_option("--set", settings, "One setting, key=value; may be repeated")
      ->allow_extra_args(false);
}

planning::PlanningConfig PlanningArguments::config() const {
  return planning::read_planning_config(planning::effective_planning_config(config_file, settings),
                                        "effective configuration");
}

planning::PlanningConfig PlanningArguments::calm_config(const char* verb) const {
  planning::PlanningConfig result = config();
  if (result.conditions.wind_mps > 0.0) {
    throw UsageError(std::string(verb) + " knows no wind, and conditions.wind_mps is above 0",
                     "leave conditions.wind_mps at 0");
  }
  return result;
}

void SeedArgument::add_to(CLI::App& verb, const char* of_what) {
  verb.add_option_function<std::uint64_t>(
      "--seed", [this](const std::uint64_t& value) { given = value; },
      "Seed of " + std::string(of_what) + " (default: a fresh one, printed)");
}

std::uint64_t SeedArgument::value(const Console& console) const {
  const std::uint64_t seed = given ? *given : std::random_device{}();
  console.say("seed " + std::to_string(seed));
  return seed;
}

ConfigReader shipped_evaluation() {
  return ConfigReader::from_text(shipped_config("evaluation.yaml"), "config/evaluation.yaml");
}

planning::ReactionOptions shipped_reaction() {
  return services::read_command_model_options(
             ConfigReader::from_text(shipped_config("command_model.yaml"),
                                     "config/command_model.yaml"))
      .reaction;
}

std::variant<flight::RoutePlan, flight::NoPlan> planned_route(
    const map::Map& map, const flight::PlanRequest& request, const planning::PlanningConfig& config,
    Observer& observer) {
  return planning::plan_route(map, request, config, {}, observer);
}

evaluation::MachineRecord this_machine() {
  evaluation::MachineRecord machine;
  machine.version = HEDGEHOP_VERSION;
  machine.simd = preparation::is_available(preparation::Simd::kAvx512) ? "avx512"
                 : preparation::is_available(preparation::Simd::kAvx2) ? "avx2"
                                                                       : "baseline";
  std::ifstream processors("/proc/cpuinfo");
  for (std::string line; std::getline(processors, line);) {
    const std::size_t colon = line.find(": ");
    if (line.rfind("model name", 0) == 0 && colon != std::string::npos) {
      machine.processor = line.substr(colon + 2);
      break;
    }
  }
  return machine;
}

double wall_s() { return seconds_of(CLOCK_MONOTONIC); }

ExitCode evaluation_code(const Console& console, bool is_stopped) {
  if (!is_stopped) {
    return ExitCode::kOk;
  }
  console.say("warning: stopped early; the result covers what was finished until then");
  return ExitCode::kNotVerified;
}

double thread_cpu_s() { return seconds_of(CLOCK_THREAD_CPUTIME_ID); }

double process_cpu_s() { return seconds_of(CLOCK_PROCESS_CPUTIME_ID); }

}  // namespace hedgehop::cli
