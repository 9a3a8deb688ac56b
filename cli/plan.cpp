#include <CLI/CLI.hpp>
#include <cstdio>
#include <deque>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <system_error>

#include "base/files.hpp"
#include "effective_config.hpp"
#include "evaluation/risk_planning.hpp"
#include "output/figures.hpp"
#include "output/plan_bundle.hpp"
#include "output/route_choices.hpp"
#include "plan_result.hpp"
#include "planning/alternatives.hpp"
#include "planning/map_for_plan.hpp"
#include "planning/planning.hpp"
#include "planning/request_areas.hpp"
#include "planning/roadmap_store.hpp"
#include "request_arguments.hpp"
#include "uncertainty_arguments.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

struct PlanArguments {
  RequestArguments request;
  std::string map;
  std::string out;
  bool is_overwriting = false;
  bool has_figures = false;
  UncertaintyArguments uncertainty;
  double violation_probability = 0.0;  // 0: errors are not looked at
  bool has_alternatives = false;
  bool are_alternatives_flown = false;
  std::string alternatives_file;
};

// Routes to choose from, and the flights along them that were asked for.
struct Choices {
  flight::RouteChoices routes;
  std::deque<std::variant<flight::Plan, flight::NoPlan>> flights;  // of routes 1, 2, ...
  bool is_stopped = false;

  [[nodiscard]] std::vector<output::FlownChoice> flown(const flight::Plan& main) const {
    std::vector<output::FlownChoice> list = {{0, &main, nullptr}};
    for (std::size_t i = 0; i < flights.size(); ++i) {
      list.push_back({i + 1, std::get_if<flight::Plan>(&flights[i]),
                      std::get_if<flight::NoPlan>(&flights[i])});
    }
    return list;
  }
};

// One sentence about the errors that a plan was made for.
std::string text_of(const evaluation::RiskPlan& planned, double wanted) {
  const evaluation::ClearanceRisk& risk = planned.risk;
  char text[400];
  std::snprintf(
      text, sizeof text,
      "heights raised by %.1f m: with errors of %.1f m (surface) and %.1f m (position) the "
      "clearance falls below %.1f m with probability %.4f (%.4f to %.4f), %s %.4f",
      planned.margin_m, risk.errors.dem_m, risk.errors.navigation_m, risk.clearance_m,
      risk.probability, risk.low, risk.high,
      planned.is_met ? "at most the wanted" : "NOT the wanted", wanted);
  return text;
}

struct Made {
  std::variant<flight::Plan, flight::NoPlan> answer;
  bool is_risk_met = true;
  bool is_stopped = false;  // before the search for a route was done
  bool is_on_time = true;
};

Made make_plan(const map::Map& map, const flight::PlanRequest& request,
               const planning::PlanningConfig& config, const PlanArguments& arguments,
               const Console& console, StageTimer& timer, Observer& observer) {
  if (arguments.violation_probability > 0.0) {
    const evaluation::RiskDemand demand{
        arguments.uncertainty.errors, arguments.violation_probability,
        arguments.uncertainty.options(), arguments.uncertainty.seed};
    const auto plan = [](const map::Map& on, const flight::PlanRequest& asked,
                         const planning::PlanningConfig& with, Observer& watcher) {
      return planning::plan(on, asked, with, route_progress(watcher), watcher);
    };
    auto found = evaluation::plan_within_risk(map, request, config, demand, plan, observer);
    timer.lap("route_flight_and_risk");
    if (auto* no_plan = std::get_if<flight::NoPlan>(&found)) {
      return {std::move(*no_plan)};
    }
    auto& planned = std::get<evaluation::RiskPlan>(found);
    planned.plan.warnings.push_back(text_of(planned, arguments.violation_probability));
    return {std::move(planned.plan), planned.is_met};
  }
  auto route = planning::plan_route(map, request, config, route_progress(observer), observer);
  const bool is_stopped = observer.stop_requested();
  timer.lap("route");
  if (auto* no_plan = std::get_if<flight::NoPlan>(&route)) {
    observer.check_stop();  // nothing was found yet
    return {std::move(*no_plan)};
  }
  if (is_stopped) {
    console.say("stopped: flying the best route so far; Ctrl-C again gives it up");
  }
  const auto flying = console.observer(2);
  const flight::RoutePlan& found = std::get<flight::RoutePlan>(route);
  auto result = planning::plan_flight(map, found, config, {}, *flying);
  flying->check_stop();
  timer.lap("flight_and_verification");
  if (auto* plan = std::get_if<flight::Plan>(&result); plan != nullptr && is_stopped) {
    plan->warnings.push_back("stopped after " + std::to_string(found.route.work_units) +
                             " work units: the best route until then; planned to the end, it may "
                             "cost less");
  }
  return {std::move(result), true, is_stopped};
}

Choices make_choices(const map::Map& map, const flight::Plan& plan,
                     const planning::PlanningConfig& config,
                     const planning::AlternativeOptions& options, bool are_flown,
                     const Console& console, StageTimer& timer, Observer& observer) {
  Choices choices;
  const auto searching = console.observer();
  choices.routes = planning::plan_alternatives(map, plan.route_plan, config, options, *searching);
  choices.is_stopped = searching->stop_requested();
  timer.lap("alternative_routes");
  for (std::size_t i = 1; are_flown && i < choices.routes.routes.size(); ++i) {
    const flight::RouteChoice& choice = choices.routes.routes[i];
    console.say("flying along '" + choice.name + "'");
    auto flown = planning::plan_flight(
        map, choice.plan, planning::read_planning_config(choice.plan.config_text, choice.name), {},
        observer);
    observer.check_stop();
    if (auto* made = std::get_if<flight::Plan>(&flown); made != nullptr && choice.avoidance > 0.0) {
      made->warnings.push_back(
          "its route was searched with a cost on what lies near to other routes of plan " +
          plan.route_plan.request_id.hex() + "; planning this request again may give another one");
    }
    choices.flights.push_back(std::move(flown));
  }
  if (are_flown) {
    timer.lap("alternative_flights");
  }
  return choices;
}

void write_choices(const flight::Plan& plan, const Choices& choices,
                   const std::filesystem::path& folder) {
  const std::vector<output::FlownChoice> flown = choices.flown(plan);
  write_file_atomically(folder / output::kChoicesFile,
                        output::route_choices_json(choices.routes, flown));
  write_file_atomically(folder / output::kChoicesRoutesFile,
                        output::route_choices_geojson(choices.routes));
  for (const output::FlownChoice& choice : flown) {
    if (choice.route == 0 || choice.plan == nullptr) {
      continue;
    }
    const std::filesystem::path inside =
        folder / output::kChoicesFolder / choices.routes.routes[choice.route].name;
    std::error_code error;
    std::filesystem::create_directories(inside, error);
    if (error) {
      throw SystemFailure(inside.string() + ": " + error.message(),
                          "give a folder that can be written");
    }
    output::write_plan_bundle(*choice.plan, inside);
  }
}

// The same, at the speed that times of day ask for.
Made make_plan_on_time(const map::Map& map, const flight::PlanRequest& request,
                       const planning::PlanningConfig& config, const planning::TimeDemand& demand,
                       const PlanArguments& arguments, const Console& console, StageTimer& timer,
                       Observer& observer) {
  std::map<double, Made> rounds;  // without their answers, by speed
  const auto speed_of = [](const flight::PlanRequest& asked) {
    return asked.speed_mps.value_or(0.0);
  };
  const auto plan =
      [&](std::optional<double> speed_mps) -> std::variant<flight::Plan, flight::NoPlan> {
    if (observer.stop_requested()) {
      return flight::NoPlan{flight::NoPlanCause::kStopped, std::nullopt, "stopped"};
    }
    flight::PlanRequest timed = request;
    timed.speed_mps = speed_mps ? speed_mps : request.speed_mps;
    Made made = make_plan(map, timed, config, arguments, console, timer, observer);
    auto answer = std::move(made.answer);
    rounds[speed_of(timed)] = std::move(made);
    return answer;
  };
  auto found = planning::plan_on_time(demand, config, plan);
  if (auto* no_plan = std::get_if<flight::NoPlan>(&found)) {
    return {std::move(*no_plan)};
  }
  auto& timed = std::get<planning::TimedPlan>(found);
  Made made = std::move(rounds.at(speed_of(timed.plan.route_plan.request)));
  made.is_on_time = timed.is_met;
  if (!timed.is_met) {
    timed.plan.warnings.push_back(timed.shortfall);
  }
  made.answer = std::move(timed.plan);
  return made;
}

ExitCode run(const Console& console, const PlanArguments& arguments) {
  const bool has_alternatives = arguments.has_alternatives || arguments.are_alternatives_flown;
  if (has_alternatives && arguments.violation_probability > 0.0) {
    throw UsageError("--alternatives and --violation-probability do not go together",
                     "choose a route first, then plan it with --via and --violation-probability");
  }
  if (!has_alternatives && !arguments.alternatives_file.empty()) {
    throw UsageError("--alternatives-config is given without --alternatives",
                     "add --alternatives or --fly-alternatives");
  }
  if ((arguments.violation_probability > 0.0) != arguments.uncertainty.is_asked_for()) {
    throw UsageError(
        "--violation-probability and errors go together: one is given without the other",
        "give --violation-probability with --dem-error-m, --navigation-error-m or both; "
        "what errors do to a plan as it is tells hedgehop verify");
  }
  const map_sources::Mission mission = arguments.request.mission(console);
  planning::PlanningConfig config =
      planning::read_planning_config(planning::effective_planning_config(
                                         arguments.request.config_file, arguments.request.settings),
                                     "effective configuration");
  ConfigReader alternatives =
      effective_config("alternatives.yaml", arguments.alternatives_file, {});
  const planning::AlternativeOptions options = planning::read_alternative_options(alternatives);
  const auto demand = arguments.request.time_demand(mission);
  StagedFolder folder(arguments.out, output::kPlanFile, arguments.is_overwriting);
  const auto observer = console.observer();

  StageTimer timer;
  map::Map map = planning::read_map_for(arguments.map, config);
  observer->check_stop();
  const flight::PlanRequest request = arguments.request.plan_request(mission, &map, *observer);
  map = planning::map_with_areas(std::move(map), request.areas);
  timer.lap("read_map");
  if (config.global.use_roadmap) {
    // Areas of the request make another map, whose roadmap is not kept.
    const planning::ReadyRoadmap ready = planning::ready_roadmap(
        map, config,
        request.areas.empty() ? planning::roadmap_file(arguments.map) : std::filesystem::path(),
        *observer);
    if (ready.is_built && request.areas.empty()) {
      console.say("roadmap made: " + ready.why_built);
    }
    config.roadmap = {ready.roadmap, ready.key};
    timer.lap("roadmap");
  }
  const Made made = demand ? make_plan_on_time(map, request, config, *demand, arguments, console,
                                               timer, *observer)
                           : make_plan(map, request, config, arguments, console, timer, *observer);
  const auto last_observer = console.observer(2);
  last_observer->check_stop();
  if (const auto* no_plan = std::get_if<flight::NoPlan>(&made.answer)) {
    return report_no_plan(console, *no_plan);
  }
  const auto& plan = std::get<flight::Plan>(made.answer);
  std::optional<Choices> choices;
  if (has_alternatives && !made.is_stopped) {
    choices = make_choices(map, plan, config, options, arguments.are_alternatives_flown, console,
                           timer, *last_observer);
  }
  output::write_plan_bundle(plan, folder.path());
  if (choices) {
    write_choices(plan, *choices, folder.path());
  }
  timer.lap("write");
  if (arguments.has_figures) {
    output::write_figures(plan, map, folder.path() / "figures");
    if (choices) {
      output::write_choice_figure(plan, map, choices->routes, folder.path() / "figures");
    }
    timer.lap("figures");
  }
  last_observer->check_stop();
  timer.write(folder.path());
  folder.commit();
  const ExitCode code = report_plan(
      console, plan, arguments.out, made.is_stopped, choices ? &choices->routes : nullptr,
      choices ? choices->flown(plan) : std::vector<output::FlownChoice>());
  const bool is_stopped = made.is_stopped || (choices && choices->is_stopped);
  return made.is_risk_met && made.is_on_time && !is_stopped ? code : ExitCode::kNotVerified;
}

}  // namespace

void add_plan_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand("plan", "Plan a flight on a prepared map, in this one process");
  verb->footer(
      "Writes plan.json, route.geojson, trajectory.csv and timings.json into the folder --out. The "
      "same map, request, config, seed and work budget give the same bytes. Ctrl-C once ends a "
      "search with what it has (exit code 4; 130 if that is no route yet), twice gives up.\n"
      "alternatives.json and .geojson hold up to five routes to choose from, or why there are "
      "fewer.\n"
      "Examples:\n"
      "  hedgehop plan --map map --start 49.95,11.45 --goal 50.05,11.58 --out plan --figures\n"
      "  hedgehop plan --map map --mission mission.yaml --fly-alternatives --out plan\n"
      "  hedgehop plan --map map --mission m.yaml --arrival 2026-05-01T06:30Z --out plan\n"
      "  hedgehop plan --map map --mission m.yaml --dem-error-m 4 --violation-probability 0.05 "
      "--out plan");
  auto arguments = std::make_shared<PlanArguments>();
  verb->add_option("--map", arguments->map, "Map bundle, a folder made by `hedgehop prepare`")
      ->required();
  arguments->request.add_to(*verb);
  verb->add_option("--out", arguments->out, "Folder to write the plan to")->required();
  verb->add_flag("--overwrite", arguments->is_overwriting, "Replace an existing plan in --out");
  verb->add_flag("--figures", arguments->has_figures,
                 "Draw the plan into figures/ (needs gnuplot)");
  verb->add_option("--violation-probability", arguments->violation_probability,
                   "Fly so high that errors break the clearance at most this often")
      ->check(CLI::Range(0.001, 0.999));
  arguments->uncertainty.add_to(*verb);
  verb->add_flag("--alternatives", arguments->has_alternatives,
                 "Plan further routes to choose from: fast, hidden, quiet and others");
  verb->add_flag("--fly-alternatives", arguments->are_alternatives_flown,
                 "The same, each flown and verified like the plan");
  verb->add_option("--alternatives-config", arguments->alternatives_file,
                   "YAML file whose keys replace those of the shipped alternatives.yaml");
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] { return run(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
