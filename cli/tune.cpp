#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <deque>
#include <memory>

#include "base/files.hpp"
#include "evaluation/tuning.hpp"
#include "evaluation_arguments.hpp"
#include "planning/map_for_plan.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

struct TuneArguments {
  std::vector<std::string> maps;
  std::string parameters_file;
  std::vector<std::string> parameters;
  std::int64_t flights = 0;
  std::int64_t held_out = 0;
  std::int64_t evaluations = 0;
  SeedArgument seed;
  std::string routes_folder;
  PlanningArguments planning;
  std::string out;
};

struct TuneConfig {
  evaluation::DrawingRules routes;
  evaluation::TuneOptions tune;
};

TuneConfig asked(const TuneArguments& arguments) {
  ConfigReader shipped = shipped_evaluation();
  ConfigReader routes = shipped.required_section("routes");
  ConfigReader tune = shipped.required_section("tune");
  TuneConfig config{evaluation::read_route_rules(routes), evaluation::read_tune_options(tune)};
  if (!arguments.parameters_file.empty()) {
    ConfigReader file = ConfigReader::from_file(arguments.parameters_file);
    config.tune.parameters = evaluation::read_tuned_parameters(file);
    file.finish();
  }
  if (!arguments.parameters.empty()) {
    if (arguments.parameters_file.empty()) {
      config.tune.parameters.clear();
    }
    for (const std::string& text : arguments.parameters) {
      config.tune.parameters.push_back(evaluation::tuned_parameter(text));
    }
  }
  for (std::size_t i = 0; i < config.tune.parameters.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (config.tune.parameters[i].range.key == config.tune.parameters[j].range.key) {
        throw UsageError("'" + config.tune.parameters[i].range.key + "' is to be tuned twice",
                         "name it once");
      }
    }
  }
  if (arguments.flights > 0) {
    config.tune.flights = arguments.flights;
  }
  if (arguments.held_out > 0) {
    config.tune.held_out = arguments.held_out;
  }
  if (arguments.evaluations > 0) {
    config.tune.search.evaluations_max = arguments.evaluations;
  }
  return config;
}

// Maps, what flying over them costs, and the problems on each: those that the search sees, and
// those that it does not.
struct Problems {
  std::deque<map::Map> maps;
  std::deque<risk::CostModel> costs;
  std::vector<evaluation::ProblemsOfMap> training;
  std::vector<evaluation::ProblemsOfMap> held_out;
};

void draw(const TuneArguments& arguments, const TuneConfig& config,
          const planning::PlanningConfig& planning, std::uint64_t seed, Observer& observer,
          Problems& problems) {
  for (const std::string& folder : arguments.maps) {
    problems.maps.push_back(planning::read_map_for(folder, planning));
  }
  for (const map::Map& map : problems.maps) {
    problems.costs.push_back(planning::cost_model(map, planning));
    std::vector<evaluation::DrawnRoute> routes =
        evaluation::draw_routes(map, planning, config.routes,
                                config.tune.flights + config.tune.held_out, seed,
                                arguments.routes_folder, planned_route, observer)
            .routes;
    const auto first_held_out = routes.begin() + config.tune.flights;
    const risk::CostModel* costs = &problems.costs.back();
    problems.training.push_back({costs, {routes.begin(), first_held_out}});
    problems.held_out.push_back({costs, {first_held_out, routes.end()}});
  }
}

void print_change(const char* name, const std::optional<evaluation::PairedChange>& change) {
  if (change && !std::isnan(change->change)) {
    std::printf("  %-24s %+6.2f %%  [%+.2f, %+.2f]\n", name, 100.0 * change->change,
                100.0 * change->low, 100.0 * change->high);
  }
}

void print_safety(const char* name, const evaluation::TuneSafety& safety) {
  std::printf(
      "  %-24s %lld of %lld reached, %lld collisions, %lld violations, %lld not verified, "
      "%lld slowed\n",
      name, static_cast<long long>(safety.reached), static_cast<long long>(safety.flights),
      static_cast<long long>(safety.collisions), static_cast<long long>(safety.violations),
      static_cast<long long>(safety.not_verified), static_cast<long long>(safety.slowed));
}

void print_comparison(const char* name, const evaluation::TuneComparison& comparison,
                      const std::vector<std::string>& maps) {
  std::printf("%s, %lld pairs: tuned against given, with 95 %% interval\n", name,
              static_cast<long long>(comparison.pairs));
  print_change("cost, mean of flights", comparison.flight_cost);
  for (std::size_t m = 0; maps.size() > 1 && m < maps.size(); ++m) {
    print_change(("  on " + maps[m]).c_str(), comparison.by_map[m]);
  }
  print_change("cost", comparison.cost);
  print_change("length", comparison.length);
  print_change("visibility", comparison.visibility);
  print_change("semantics", comparison.semantics);
  print_change("height", comparison.height);
  print_change("bank", comparison.bank);
  print_safety("given", comparison.given);
  print_safety("tuned", comparison.tuned);
}

void print(const evaluation::TuneResult& result, const TuneArguments& arguments) {
  std::printf("%-40s %10s %10s %10s\n", "parameter", "given", "tuned", "of range");
  for (const evaluation::TuneResult::Parameter& parameter : result.parameters) {
    const evaluation::ParameterRange& range = parameter.range;
    std::printf("%-40s %10.4g %10.4g %+9.0f %%\n", range.key.c_str(), parameter.given,
                parameter.tuned,
                100.0 * (range.share_of(parameter.tuned) - range.share_of(parameter.given)));
  }
  print_comparison("training flights", *result.training, arguments.maps);
  if (result.held_out) {
    print_comparison("held-out flights", *result.held_out, arguments.maps);
  }
  std::printf("%s\n%s holds the tuned parameters\n", result.verdict.c_str(), arguments.out.c_str());
}

ExitCode run(const Console& console, const TuneArguments& arguments) {
  const TuneConfig config = asked(arguments);
  const std::uint64_t seed = arguments.seed.value(console);
  const planning::PlanningConfig planning = arguments.planning.config();
  Problems problems;
  evaluation::TuneResult result;
  {
    const auto observer = console.observer();
    draw(arguments, config, planning, seed, *observer, problems);
    result = evaluation::tune(planning, config.tune, evaluation::flights_of(problems.training),
                              seed, problems.maps.size(), *observer);
  }
  write_file_atomically(arguments.out, evaluation::tuned_config(result));
  // What the first Ctrl-C ended is checked all the same; the second one gives that up.
  const auto observer = console.observer(2);
  bool is_checked = true;
  try {
    evaluation::check_held_out(planning, config.tune, evaluation::flights_of(problems.held_out),
                               seed, problems.maps.size(), result, *observer);
    write_file_atomically(arguments.out, evaluation::tuned_config(result));
  } catch (const Interrupted&) {
    is_checked = false;
  }
  if (console.is_json) {
    evaluation::TuneRecord record{seed, {}, {}, arguments.out};
    for (const map::Map& map : problems.maps) {
      record.map_hashes.push_back(map.hash.hex());
      record.map_labels.push_back(map.label);
    }
    std::printf("%s", evaluation::tune_result_json(result, config.tune, record).c_str());
  } else {
    print(result, arguments);
  }
  return evaluation_code(console, result.is_stopped || !is_checked);
}

}  // namespace

void add_tune_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand(
      "tune", "Search for parameters that make flights cheap, and check them on others");
  verb->footer(
      "Draws problems on each map and plans their global routes once. Searches for one set of "
      "parameters of the section local with which the training flights cost least, each against "
      "its cost with the given parameters; a set that flies one of them less safely is refused. "
      "Then flies problems that the search never saw: the tuned parameters are to be taken only "
      "if the 95 % bootstrap interval of their mean change of cost lies below 0 and no count of "
      "safety is worse. Ctrl-C ends the search, not the check; a second one ends that.\n"
      "--parameters and --parameter replace those of the section tune in evaluation.yaml; what "
      "stays as it is comes from --config and --set.\n"
      "Example:\n"
      "  hedgehop tune --map map --evaluations 100 --seed 7 --out tuned.yaml\n"
      "  hedgehop plan --map map --start 49.95,11.45 --goal 50.05,11.58 --config tuned.yaml --out "
      "plan");
  auto arguments = std::make_shared<TuneArguments>();
  verb->add_option("--map", arguments->maps, "Map bundle; may be repeated: one set for all")
      ->required()
      ->allow_extra_args(false);
  verb->add_option("--parameter", arguments->parameters,
                   "Parameter to tune, KEY=LOW:HIGH or KEY=LOW:HIGH:log; may be repeated")
      ->allow_extra_args(false);
  verb->add_option("--parameters", arguments->parameters_file,
                   "YAML file with a list of parameters, as in section tune of evaluation.yaml");
  verb->add_option("--flights", arguments->flights,
                   "Training flights on each map (default: evaluation.yaml)")
      ->check(CLI::Range(1, 100000));
  verb->add_option("--held-out", arguments->held_out,
                   "Held-out flights on each map (default: evaluation.yaml)")
      ->check(CLI::Range(1, 100000));
  verb->add_option("--evaluations", arguments->evaluations,
                   "Sets of parameters that are tried (default: evaluation.yaml)")
      ->check(CLI::Range(1, 100000));
  arguments->seed.add_to(*verb, "the problems");
  verb->add_option("--routes", arguments->routes_folder,
                   "Folder that keeps the global routes for the next run (default: none is kept)");
  arguments->planning.add_to(*verb);
  verb->add_option("--out", arguments->out, "YAML file to write, for --config")->required();
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] { return run(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
