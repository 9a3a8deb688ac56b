#include "evaluation/tuning.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <oneapi/tbb/parallel_for.h>
#include <tuple>

#include "base/errors.hpp"
#include "evaluation/flown_route.hpp"

namespace hedgehop::evaluation {
namespace {

using planning::PlanningConfig;

// Above any change of cost.
constexpr double kUnsafe = 1000.0;
constexpr double kInnerShare = 0.382;  // neither end nor middle, where a range is tried
constexpr const char* kSection = "local.";
constexpr const char* kBankWeight = "local.bank_weight_1prad";

bool is_usable(const TuneFlight& flight) {
  return flight.is_reached && flight.is_verified && flight.cost_m > 0.0;
}

bool is_slowed(const TuneFlight& flight, const TuneFlight& given) {
  return given.is_reached && flight.is_reached && flight.speed_mps < given.speed_mps;
}

double objective_of(const std::vector<TuneFlight>& flights, const std::vector<TuneFlight>& given) {
  double sum = 0.0;
  double count = 0.0;
  double unsafe = 0.0;
  for (std::size_t i = 0; i < given.size(); ++i) {
    if (!is_usable(given[i])) {
      continue;
    }
    count += 1.0;
    if (is_usable(flights[i]) && !is_slowed(flights[i], given[i])) {
      sum += flights[i].cost_m / given[i].cost_m - 1.0;
    } else {
      unsafe += 1.0;
    }
  }
  return unsafe > 0.0 ? kUnsafe + unsafe / count : sum / count;
}

TuneSafety safety_of(const std::vector<TuneFlight>& flights, double required_clearance_m,
                     double speed_mps) {
  TuneSafety safety;
  for (const TuneFlight& flight : flights) {
    ++safety.flights;
    if (!flight.is_reached) {
      continue;
    }
    ++safety.reached;
    safety.collisions += flight.clearance_m > 0.0 ? 0 : 1;
    safety.violations += flight.clearance_m >= required_clearance_m ? 0 : 1;
    safety.not_verified += flight.is_verified ? 0 : 1;
    safety.slowed += flight.speed_mps < speed_mps ? 1 : 0;
  }
  return safety;
}

bool is_worse(const TuneSafety& tuned, const TuneSafety& given) {
  return tuned.reached < given.reached || tuned.collisions > given.collisions ||
         tuned.violations > given.violations || tuned.not_verified > given.not_verified ||
         tuned.slowed > given.slowed;
}

// Values and what they are compared with, pair by pair.
struct Column {
  std::vector<double> values;
  std::vector<double> baseline;

  void add(double value, double baseline_value) {
    values.push_back(value);
    baseline.push_back(baseline_value);
  }
  [[nodiscard]] std::optional<PairedChange> change(std::int64_t draws, std::uint64_t seed) const {
    return values.empty() ? std::nullopt
                          : std::optional(paired_change(values, baseline, draws, seed));
  }
};

TuneComparison compared(const std::vector<TuneFlight>& tuned, const std::vector<TuneFlight>& given,
                        const PlanningConfig& config, const TuneOptions& options,
                        std::uint64_t seed, std::size_t maps) {
  TuneComparison result;
  const double required_m = config.demands.required_clearance_m;
  result.given = safety_of(given, required_m, config.speed_mps);
  result.tuned = safety_of(tuned, required_m, config.speed_mps);
  constexpr std::array kMeasures{
      &flight::PathMeasures::length_m, &flight::PathMeasures::visibility_m,
      &flight::PathMeasures::semantics_m, &flight::PathMeasures::mean_height_m,
      &flight::PathMeasures::bank_rad_m};
  Column flight_cost;
  Column cost;
  std::vector<Column> by_map(maps);
  std::array<Column, kMeasures.size()> measures;
  for (std::size_t i = 0; i < given.size(); ++i) {
    if (!is_usable(given[i]) || !is_usable(tuned[i])) {
      continue;
    }
    ++result.pairs;
    const double ratio = tuned[i].cost_m / given[i].cost_m;
    flight_cost.add(ratio, 1.0);
    by_map[given[i].map].add(ratio, 1.0);
    cost.add(tuned[i].cost_m, given[i].cost_m);
    for (std::size_t m = 0; m < kMeasures.size(); ++m) {
      measures[m].add(tuned[i].measures.*kMeasures[m], given[i].measures.*kMeasures[m]);
    }
  }
  const auto change = [&](const Column& column) {
    return column.change(options.bootstrap_draws, seed);
  };
  result.flight_cost = change(flight_cost);
  for (const Column& column : by_map) {
    result.by_map.push_back(change(column));
  }
  result.cost = change(cost);
  result.length = change(measures[0]);
  result.visibility = change(measures[1]);
  result.semantics = change(measures[2]);
  result.height = change(measures[3]);
  result.bank = change(measures[4]);
  return result;
}

std::vector<std::string> settings_of(const std::vector<ParameterRange>& ranges,
                                     const std::vector<double>& values) {
  std::vector<std::string> settings;
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    settings.push_back(setting_of(ranges[i].key, values[i]));
  }
  return settings;
}

// The parameter with the value that it has; throws ConfigError where it cannot be tuned.
TuneResult::Parameter checked(const PlanningConfig& config, const ParameterRange& range) {
  if (!range.key.starts_with(kSection) || range.key == kBankWeight) {
    throw ConfigError("'" + range.key + "' cannot be tuned",
                      "routes are planned once and flights are judged by the given cost: take "
                      "parameters of the section local, without its bank weight");
  }
  TuneResult::Parameter parameter{range, value_of(config, range.key), 0.0};
  parameter.tuned = parameter.given;
  if (!(parameter.given >= range.low && parameter.given <= range.high)) {
    throw ConfigError("the range of '" + range.key + "' does not hold its value, " +
                          setting_of(range.key, parameter.given),
                      "widen it: the search begins at that value");
  }
  for (const double value : {range.low, range.high, range.value_at(kInnerShare)}) {
    config_with(config.text, {setting_of(range.key, value)});
  }
  return parameter;
}

TuneOptions::Parameter read_parameter(ConfigReader& section) {
  TuneOptions::Parameter parameter;
  ParameterRange& range = parameter.range;
  range.key = section.required_string("key");
  parameter.mode = section.required_string("mode");
  range.low = section.required_double("low");
  range.high = section.required_double("high");
  range.is_logarithmic = section.required_bool("logarithmic");
  section.require(range.low < range.high, "high", "must be above low");
  section.require(!range.is_logarithmic || range.low > 0.0, "low",
                  "must be above 0 where logarithmic");
  section.require(parameter.mode == "any" || parameter.mode == "tvfh" ||
                      parameter.mode == "rollout" || parameter.mode == "vfh_3d",
                  "mode", "must be any, tvfh, rollout or vfh_3d");
  section.finish();
  return parameter;
}

std::string percent(double share) {
  char text[32];
  std::snprintf(text, sizeof text, "%+.2f %%", 100.0 * share);
  return text;
}

// The verdict on what was held out, and whether it is for the tuned parameters.
std::pair<bool, std::string> judged(const TuneComparison& held_out) {
  if (is_worse(held_out.tuned, held_out.given)) {
    return {false, "keep the given parameters: held-out flights are less safe with the tuned ones"};
  }
  if (!held_out.flight_cost) {
    return {false, "keep the given parameters: no held-out flight verifies with both"};
  }
  const PairedChange& change = *held_out.flight_cost;
  const std::string interval = percent(change.change) + " [" + percent(change.low) + ", " +
                               percent(change.high) + "] of the cost of held-out flights";
  return change.high < 0.0 ? std::pair{true, "take the tuned parameters: " + interval}
                           : std::pair{false, "keep the given parameters: " + interval +
                                                  ", an interval that does not lie below 0"};
}

}  // namespace

std::vector<TuneOptions::Parameter> read_tuned_parameters(ConfigReader& reader) {
  std::vector<TuneOptions::Parameter> parameters;
  for (ConfigReader& section : reader.required_sections("parameters")) {
    parameters.push_back(read_parameter(section));
  }
  reader.require(!parameters.empty(), "parameters", "must name one");
  return parameters;
}

TuneOptions read_tune_options(ConfigReader& reader) {
  TuneOptions options;
  options.flights = reader.required_integer("flights");
  options.held_out = reader.required_integer("held_out");
  options.search.evaluations_max = reader.required_integer("evaluations");
  options.search.first_step_share = reader.required_double("first_step_share");
  options.bootstrap_draws = reader.required_integer("bootstrap_draws");
  options.parameters = read_tuned_parameters(reader);
  for (const auto& [key, value] : {std::pair{"flights", options.flights},
                                   {"held_out", options.held_out},
                                   {"evaluations", options.search.evaluations_max}}) {
    reader.require(value >= 1 && value <= 100000, key, "must lie between 1 and 100000");
  }
  reader.require(options.search.first_step_share >= 0.01 && options.search.first_step_share <= 0.5,
                 "first_step_share", "must lie between 0.01 and 0.5");
  reader.require(options.bootstrap_draws >= 100 && options.bootstrap_draws <= 1000000,
                 "bootstrap_draws", "must lie between 100 and 1000000");
  reader.finish();
  return options;
}

TuneOptions::Parameter tuned_parameter(const std::string& text) {
  const auto wrong = [&](const std::string& why) -> UsageError {
    return UsageError("'" + text + "' is no parameter to tune: " + why,
                      "write it as local.look_ahead_m=150:900:log");
  };
  TuneOptions::Parameter parameter;
  parameter.mode = "any";
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos || equals == 0) {
    throw wrong("a key and '=' are missing");
  }
  parameter.range.key = text.substr(0, equals);
  const char* at = text.c_str() + equals + 1;
  char* end = nullptr;
  parameter.range.low = std::strtod(at, &end);
  if (end == at || *end != ':') {
    throw wrong("two numbers with ':' between them are missing");
  }
  at = end + 1;
  parameter.range.high = std::strtod(at, &end);
  if (end == at || (*end != '\0' && std::string(end) != ":log")) {
    throw wrong("after the second number only ':log' may follow");
  }
  parameter.range.is_logarithmic = *end != '\0';
  if (!(std::isfinite(parameter.range.low) && std::isfinite(parameter.range.high) &&
        parameter.range.low < parameter.range.high)) {
    throw wrong("the second number must be above the first one");
  }
  if (parameter.range.is_logarithmic && !(parameter.range.low > 0.0)) {
    throw wrong("with log the first number must be above 0");
  }
  return parameter;
}

FlyProblems flights_of(std::vector<ProblemsOfMap> problems) {
  return [problems = std::move(problems)](const PlanningConfig& config, const Observer& observer) {
    std::vector<planning::RouteGrounds> grounds;
    std::vector<std::pair<std::size_t, const DrawnRoute*>> tasks;
    for (std::size_t m = 0; m < problems.size(); ++m) {
      observer.check_stop();
      grounds.emplace_back(*problems[m].costs).make(config.local);
      for (const DrawnRoute& route : problems[m].routes) {
        tasks.emplace_back(m, &route);
      }
    }
    std::vector<TuneFlight> flights(tasks.size());
    oneapi::tbb::parallel_for(std::size_t{0}, tasks.size(), [&](std::size_t i) {
      const auto& [map, route] = tasks[i];
      TuneFlight& result = flights[i];
      result.map = map;
      result.problem = route->problem;
      if (const auto flight = flown(grounds[map], config, *route, observer)) {
        result.is_reached = true;
        result.is_verified = flight->verdict.is_verified;
        result.clearance_m = flight->verdict.clearance_min_m;
        result.speed_mps = flight->speed_mps;
        result.cost_m = flight->cost_m;
        result.measures = flight->measures;
      }
    });
    observer.check_stop();
    return flights;
  };
}

TuneResult tune(const PlanningConfig& config, const TuneOptions& options,
                const FlyProblems& training, std::uint64_t seed, std::size_t maps,
                Observer& observer) {
  ConfigReader whole = ConfigReader::from_text(config.text, "planning config");
  const std::string mode = whole.required_section("local").required_string("mode");
  TuneResult result;
  std::vector<ParameterRange> ranges;
  std::vector<double> start;
  for (const TuneOptions::Parameter& parameter : options.parameters) {
    if (parameter.mode == "any" || parameter.mode == mode) {
      result.parameters.push_back(checked(config, parameter.range));
      ranges.push_back(parameter.range);
      start.push_back(result.parameters.back().given);
    }
  }
  if (ranges.empty()) {
    throw ConfigError("no parameter concerns local.mode " + mode, "name some with --parameter");
  }
  const std::vector<TuneFlight> given = training(config, observer);
  if (std::none_of(given.begin(), given.end(), is_usable)) {
    throw DataError("none of the training problems is flown safely with the given parameters",
                    "ask for more of them, or see with hedgehop evaluate local-safety why");
  }
  std::vector<TuneFlight> best = given;
  double least = 0.0;
  const SearchResult found = search_parameters(
      ranges, start, options.search,
      [&](const std::vector<double>& values) {
        if (values == start) {
          return 0.0;
        }
        std::optional<PlanningConfig> changed;
        try {
          changed = config_with(config.text, settings_of(ranges, values));
        } catch (const ConfigError&) {  // each may have its value, but not all together
          return kUnsafe + 1.0;
        }
        std::vector<TuneFlight> flights = training(*changed, observer);
        const double value = objective_of(flights, given);
        if (value < least) {
          least = value;
          best = std::move(flights);
        }
        return value;
      },
      observer);
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    result.parameters[i].tuned = found.values[i];
  }
  result.evaluations = found.evaluations;
  result.is_stopped = found.is_stopped;
  result.training = compared(best, given, config, options, seed, maps);
  result.verdict = "keep the given parameters: nothing was held against the tuned ones yet";
  return result;
}

void check_held_out(const PlanningConfig& config, const TuneOptions& options,
                    const FlyProblems& held_out, std::uint64_t seed, std::size_t maps,
                    TuneResult& result, Observer& observer) {
  std::vector<std::string> settings;
  for (const TuneResult::Parameter& parameter : result.parameters) {
    settings.push_back(setting_of(parameter.range.key, parameter.tuned));
  }
  observer.progress("held-out flights", 0.0, 2.0);
  const std::vector<TuneFlight> given = held_out(config, observer);
  observer.progress("held-out flights", 1.0, 2.0);
  const std::vector<TuneFlight> tuned = held_out(config_with(config.text, settings), observer);
  observer.progress("held-out flights", 2.0, 2.0);
  result.held_out = compared(tuned, given, config, options, seed, maps);
  std::tie(result.is_better, result.verdict) = judged(*result.held_out);
}

}  // namespace hedgehop::evaluation
