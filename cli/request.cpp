#include <CLI/CLI.hpp>
#include <algorithm>
#include <memory>

#include "base/files.hpp"
#include "bus/map_exchange.hpp"
#include "bus_arguments.hpp"
#include "output/figures.hpp"
#include "output/plan_bundle.hpp"
#include "plan_over_bus.hpp"
#include "plan_result.hpp"
#include "planning/planning.hpp"
#include "request_arguments.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

struct BusRequestArguments {
  RequestArguments request;
  BusArguments bus;
  std::string out;
  double timeout_s = 10.0;
  bool is_overwriting = false;
  bool has_figures = false;
};

// Figures need the map, which is on the bus too.
std::shared_ptr<const map::Map> map_from_bus(const Hash128& hash, bus::Bus& bus,
                                             bus::BlobExchange& exchange,
                                             bus::MapAssembly& assembly, Observer& observer) {
  while (true) {
    bus.poll(std::min(0.05, exchange.next_tick_s(bus.now())));
    exchange.tick(bus.now());
    assembly.need(hash);
    assembly.tick();
    if (auto map = assembly.map_of(hash)) {
      return map;
    }
    if (assembly.index() && !assembly.index()->offers(hash)) {
      throw DataError(
          "the map has changed since the plan was made, so that no figures can be drawn",
          "ask again, or without --figures");
    }
    if (!assembly.refusal().empty()) {
      throw DataError("the map that came over the bus cannot be used: " + assembly.refusal(), "");
    }
    observer.check_stop();
  }
}

ExitCode run(const Console& console, const BusRequestArguments& arguments) {
  const map_sources::Mission mission = arguments.request.mission(console);
  const auto demand = arguments.request.time_demand(mission);
  const planning::PlanningConfig config =
      planning::read_planning_config(planning::effective_planning_config(
                                         arguments.request.config_file, arguments.request.settings),
                                     "effective configuration");
  StagedFolder folder(arguments.out, output::kPlanFile, arguments.is_overwriting);
  const auto observer = console.observer();
  const flight::PlanRequest request = arguments.request.plan_request(mission, nullptr, *observer);

  StageTimer timer;
  bus::Bus bus(arguments.bus.options());
  bus::BlobExchange exchange({}, bus);
  bus::MapAssembly assembly(exchange);
  if (arguments.has_figures) {
    bus.subscribe<messages::MapIndex>(
        messages::kMapIndexChannel,
        [&assembly](const messages::MapIndex& index, const messages::Stamp& stamp) {
          assembly.receive(index, stamp.sender_id);
        });
  }
  BusPlanner planner(bus, exchange);
  bool is_on_time = true;
  const auto plan_at = [&](std::optional<double> speed_mps) {
    flight::PlanRequest timed = request;
    timed.speed_mps = speed_mps ? speed_mps : request.speed_mps;
    return planner.plan(timed, config.text, arguments.timeout_s, *observer);
  };
  std::variant<flight::Plan, flight::NoPlan> result;
  if (demand) {
    auto timed = planning::plan_on_time(*demand, config, plan_at);
    if (auto* found = std::get_if<planning::TimedPlan>(&timed)) {
      is_on_time = found->is_met;
      if (!is_on_time) {
        found->plan.warnings.push_back(found->shortfall);
      }
      result = std::move(found->plan);
    } else {
      result = std::get<flight::NoPlan>(std::move(timed));
    }
  } else {
    result = plan_at(std::nullopt);
  }
  timer.lap("plan_over_bus");
  if (const auto* no_plan = std::get_if<flight::NoPlan>(&result)) {
    return report_no_plan(console, *no_plan);
  }
  const auto& plan = std::get<flight::Plan>(result);
  output::write_plan_bundle(plan, folder.path());
  timer.lap("write");
  if (arguments.has_figures) {
    const auto map = map_from_bus(plan.route_plan.map.hash, bus, exchange, assembly, *observer);
    output::write_figures(plan, *map, folder.path() / "figures");
    timer.lap("figures");
  }
  observer->check_stop();
  timer.write(folder.path());
  folder.commit();
  const ExitCode code = report_plan(console, plan, arguments.out);
  return is_on_time ? code : ExitCode::kNotVerified;
}

}  // namespace

void add_request_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand("request", "Plan a flight by the services on the bus");
  verb->footer(
      "The map is the one that `hedgehop serve` put on the bus. The plan is the same, byte for "
      "byte, as `hedgehop plan` makes from the same arguments. Ctrl-C cancels the planning.\n"
      "Example:\n"
      "  hedgehop serve --map map &\n"
      "  hedgehop request --start 49.95,11.45 --goal 50.05,11.58 --out plan");
  auto arguments = std::make_shared<BusRequestArguments>();
  arguments->request.add_to(*verb);
  arguments->bus.add_to(*verb);
  verb->add_option("--out", arguments->out, "Folder to write the plan to")->required();
  verb->add_option("--timeout-s", arguments->timeout_s,
                   "Longest wait for the first answer of a service (default 10)")
      ->check(CLI::Range(0.1, 86400.0));
  verb->add_flag("--overwrite", arguments->is_overwriting, "Replace an existing plan in --out");
  verb->add_flag("--figures", arguments->has_figures,
                 "Draw the plan into figures/ (needs gnuplot)");
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] { return run(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
