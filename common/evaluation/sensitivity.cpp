#include "evaluation/sensitivity.hpp"

#include <array>
#include <atomic>
#include <cmath>
#include <map>
#include <oneapi/tbb/parallel_for.h>

#include "base/errors.hpp"
#include "evaluation/crowd_observer.hpp"
#include "evaluation/flown_route.hpp"
#include "evaluation/shared_json.hpp"

namespace hedgehop::evaluation {
namespace {

using Json = nlohmann::ordered_json;
using planning::PlanningConfig;

/// A flight that reached its goal.
struct Outcome {
  flight::PathMeasures measures;
  double clearance_m = 0.0;
};

/// By problem.
using Outcomes = std::map<std::int64_t, std::optional<Outcome>>;

Outcomes flown_all(const risk::CostModel& costs, const PlanningConfig& config,
                   const std::vector<DrawnRoute>& routes, const Observer& observer) {
  std::vector<std::optional<Outcome>> found(routes.size());
  oneapi::tbb::parallel_for(std::size_t{0}, routes.size(), [&](std::size_t i) {
    if (const auto flight = flown(costs, config, routes[i], observer)) {
      found[i] = Outcome{costs.measures(flight->trajectory, config.demands.ceiling_height_m),
                         flight->verdict.clearance_min_m};
    }
  });
  Outcomes outcomes;
  for (std::size_t i = 0; i < routes.size(); ++i) {
    outcomes[routes[i].problem] = found[i];
  }
  return outcomes;
}

void compare(const Outcomes& changed, const Outcomes& base, double required_clearance_m,
             const SensitivityOptions& options, std::uint64_t seed, SensitivityRow& row) {
  struct Column {
    std::optional<PairedChange>* change;
    double flight::PathMeasures::*measure;
    std::vector<double> values;
    std::vector<double> baseline;
  };
  std::array<Column, 5> columns{{{&row.length, &flight::PathMeasures::length_m, {}, {}},
                                 {&row.visibility, &flight::PathMeasures::visibility_m, {}, {}},
                                 {&row.semantics, &flight::PathMeasures::semantics_m, {}, {}},
                                 {&row.height, &flight::PathMeasures::mean_height_m, {}, {}},
                                 {&row.bank, &flight::PathMeasures::bank_rad_m, {}, {}}}};
  for (const auto& [problem, outcome] : changed) {
    ++row.flights;
    if (!outcome) {
      continue;
    }
    ++row.reached;
    row.collisions += outcome->clearance_m > 0.0 ? 0 : 1;
    row.violations += outcome->clearance_m >= required_clearance_m ? 0 : 1;
    const auto other = base.find(problem);
    if (other == base.end() || !other->second) {
      continue;
    }
    ++row.pairs;
    for (Column& column : columns) {
      column.values.push_back(outcome->measures.*column.measure);
      column.baseline.push_back(other->second->measures.*column.measure);
    }
  }
  if (row.pairs > 0) {
    for (Column& column : columns) {
      *column.change = paired_change(column.values, column.baseline, options.bootstrap_draws, seed);
    }
  }
}

}  // namespace

SensitivityOptions read_sensitivity_options(ConfigReader& reader) {
  SensitivityOptions options;
  options.runs = reader.required_integer("runs");
  options.bootstrap_draws = reader.required_integer("bootstrap_draws");
  options.base_settings = reader.required_strings("base_settings");
  for (ConfigReader& section : reader.required_sections("parameters")) {
    SensitivityOptions::Parameter parameter;
    parameter.key = section.required_string("key");
    parameter.symbol = section.required_string("symbol");
    parameter.changes_routes = section.required_bool("changes_routes");
    parameter.values = section.required_doubles("values");
    section.require(!parameter.values.empty(), "values", "must not be empty");
    section.finish();
    options.parameters.push_back(std::move(parameter));
  }
  reader.require(options.runs >= 1 && options.runs <= 100000, "runs",
                 "must lie between 1 and 100000");
  reader.require(options.bootstrap_draws >= 100 && options.bootstrap_draws <= 1000000,
                 "bootstrap_draws", "must lie between 100 and 1000000");
  reader.require(!options.parameters.empty(), "parameters", "must name one");
  reader.finish();
  return options;
}

SensitivityResult evaluate_sensitivity(const map::Map& map, const PlanningConfig& config,
                                       const SensitivityOptions& options, const DrawingRules& rules,
                                       std::uint64_t seed, const std::filesystem::path& folder,
                                       const RouteFunction& plan, Observer& observer) {
  const PlanningConfig base_config = config_with(config.text, options.base_settings);
  const risk::CostModel costs = planning::cost_model(map, base_config);
  CrowdObserver quiet(observer);
  const DrawnRoutes routes =
      draw_routes(map, base_config, rules, options.runs, seed, folder, plan, quiet);
  const Outcomes base = flown_all(costs, base_config, routes.routes, observer);

  SensitivityResult result;
  result.seed = seed;
  result.map_hash = map.hash.hex();
  result.map_label = map.label;
  result.options = options;
  result.problems = routes.problems;
  std::size_t total = 0;
  for (const auto& parameter : options.parameters) {
    total += parameter.values.size();
  }
  const auto add_row = [&](const SensitivityOptions::Parameter& parameter, double value) {
    observer.check_stop();
    observer.progress("values", static_cast<double>(result.rows.size()),
                      static_cast<double>(total));
    const std::string setting = setting_of(parameter.key, value);
    const PlanningConfig changed_config = config_with(base_config.text, {setting});
    SensitivityRow row;
    row.key = parameter.key;
    row.symbol = parameter.symbol;
    row.value = value;
    row.is_base = value == value_of(base_config, parameter.key);
    const std::vector<DrawnRoute> changed_routes =
        parameter.changes_routes && !row.is_base
            ? draw_routes(map, changed_config, rules, options.runs, seed, folder, plan, quiet)
                  .routes
            : routes.routes;
    compare(row.is_base ? base : flown_all(costs, changed_config, changed_routes, observer), base,
            base_config.demands.required_clearance_m, options, seed, row);
    observer.check_stop();  // flights may have ended early
    result.rows.push_back(std::move(row));
  };
  try {
    for (const auto& parameter : options.parameters) {
      for (const double value : parameter.values) {
        add_row(parameter, value);
      }
    }
  } catch (const Interrupted&) {
    if (result.rows.empty()) {
      throw;
    }
    result.is_stopped = true;
    return result;
  }
  observer.progress("values", static_cast<double>(total), static_cast<double>(total));
  return result;
}

std::string sensitivity_result_json(const SensitivityResult& result, const MachineRecord& machine) {
  Json json;
  json["schema"] = "hedgehop evaluate sensitivity";
  json["schema_version"] = 1;
  json["seed"] = result.seed;
  json["map"] = {{"hash", result.map_hash}, {"label", result.map_label}};
  json["machine"] = machine_json(machine);
  json["is_stopped"] = result.is_stopped;
  json["runs"] = result.options.runs;
  json["problems"] = result.problems;
  json["base_settings"] = result.options.base_settings;
  json["rows"] = Json::array();
  for (const SensitivityRow& row : result.rows) {
    Json entry = {{"parameter", row.key},
                  {"symbol", row.symbol},
                  {"value", row.value},
                  {"is_base", row.is_base},
                  {"flights", row.flights},
                  {"reached", row.reached},
                  {"collisions", row.collisions},
                  {"clearance_violations", row.violations},
                  {"pairs", row.pairs}};
    const auto add = [&](const char* name, const std::optional<PairedChange>& change) {
      entry[name] = change ? change_json(*change) : Json(nullptr);
    };
    add("length", row.length);
    add("visibility", row.visibility);
    add("semantics", row.semantics);
    add("height", row.height);
    add("bank", row.bank);
    json["rows"].push_back(std::move(entry));
  }
  return json.dump(2) + "\n";
}

}  // namespace hedgehop::evaluation
