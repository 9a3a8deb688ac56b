#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "base/config_reader.hpp"
#include "console.hpp"
#include "evaluation/optimality_evaluation.hpp"
#include "planning/planning.hpp"
#include "planning/reaction.hpp"

namespace hedgehop::cli {

/// --config and --set: what to change of the shipped planning config. Must outlive the parsing.
struct PlanningArguments {
  std::string config_file;
  std::vector<std::string> settings;

  void add_to(CLI::App& verb);
  /// Throws ConfigError.
  [[nodiscard]] planning::PlanningConfig config() const;
  /// The same for what knows no wind: throws UsageError if there is one.
  [[nodiscard]] planning::PlanningConfig calm_config(const char* verb) const;
};

/// --seed. Must outlive the parsing.
struct SeedArgument {
  std::optional<std::uint64_t> given;

  void add_to(CLI::App& verb, const char* of_what);
  /// The one given, or a fresh one; told on stderr either way.
  [[nodiscard]] std::uint64_t value(const Console& console) const;
};

/// The shipped evaluation.yaml.
ConfigReader shipped_evaluation();

/// How the service command_model reacts, as shipped.
planning::ReactionOptions shipped_reaction();

/// planning::plan_route() without progress, for evaluation::draw_routes().
std::variant<flight::RoutePlan, flight::NoPlan> planned_route(
    const map::Map& map, const flight::PlanRequest& request, const planning::PlanningConfig& config,
    Observer& observer);

/// Processor, instruction set and version of this program, for the record.
evaluation::MachineRecord this_machine();

/// Seconds since some moment of the past.
double wall_s();

/// Exit code of an evaluation: 0, or 4 for one that was stopped, after a word about it.
ExitCode evaluation_code(const Console& console, bool is_stopped);

/// Processor seconds of the calling thread, and of the whole process.
double thread_cpu_s();
double process_cpu_s();

}  // namespace hedgehop::cli
