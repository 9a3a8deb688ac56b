#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/config_reader.hpp"
#include "base/observer.hpp"
#include "evaluation/drawn_routes.hpp"
#include "evaluation/optimality_evaluation.hpp"
#include "evaluation/paired_statistics.hpp"

namespace hedgehop::evaluation {

/// Section `sensitivity` of the evaluation config.
struct SensitivityOptions {
  /// One setting of the planning config that is varied alone.
  struct Parameter {
    std::string key;
    std::string symbol;           // as the paper writes it
    bool changes_routes = false;  // a weight of the global planner: routes are planned again
    std::vector<double> values;
  };
  std::int64_t runs = 0;
  std::int64_t bootstrap_draws = 0;
  std::vector<std::string> base_settings;  // on top of the planning config
  std::vector<Parameter> parameters;
};
SensitivityOptions read_sensitivity_options(ConfigReader& reader);

/// The flights with one value of one parameter, against the same flights with the base settings.
struct SensitivityRow {
  std::string key;
  std::string symbol;
  double value = 0.0;
  bool is_base = false;                // the value that the base settings have
  std::int64_t flights = 0;            // problems that have a route
  std::int64_t reached = 0;            // the goal
  std::int64_t collisions = 0;         // of these
  std::int64_t violations = 0;         // came nearer to the surface than is required
  std::int64_t pairs = 0;              // reached here and with the base settings
  std::optional<PairedChange> length;  // nothing without pairs, as below
  std::optional<PairedChange> visibility;
  std::optional<PairedChange> semantics;
  std::optional<PairedChange> height;  // mean above the surface
  std::optional<PairedChange> bank;    // integral of |bank| over the way
};

struct SensitivityResult {
  std::uint64_t seed = 0;
  std::string map_hash;
  std::string map_label;
  SensitivityOptions options;
  std::int64_t problems = 0;  // drawn for so many routes
  std::vector<SensitivityRow> rows;
  bool is_stopped = false;  // early: the values that were not finished are left out
};

/// Varies parameters one at a time and measures the flights of the same drawn problems (the paper's
/// qualitative discussion as numbers). What a flight costs is always measured under the base
/// settings. Parameters of the global planner change the routes, all others fly the same ones.
///
/// @param folder  keeps global routes, as draw_routes() does
/// @throws DataError, Interrupted  as draw_routes()
/// @note  On all threads that oneTBB may use; the result does not depend on how many those are.
SensitivityResult evaluate_sensitivity(const map::Map& map, const planning::PlanningConfig& config,
                                       const SensitivityOptions& options, const DrawingRules& rules,
                                       std::uint64_t seed, const std::filesystem::path& folder,
                                       const RouteFunction& plan, Observer& observer);

std::string sensitivity_result_json(const SensitivityResult& result, const MachineRecord& machine);

}  // namespace hedgehop::evaluation
