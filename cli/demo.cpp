#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "base/angles.hpp"
#include "base/files.hpp"
#include "bus/private_url.hpp"
#include "map_sources/synthetic_region.hpp"
#include "output/figures.hpp"
#include "output/plan_bundle.hpp"
#include "plan_over_bus.hpp"
#include "plan_result.hpp"
#include "planning/planning.hpp"
#include "report.hpp"
#include "service_children.hpp"
#include "synthetic_map.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

constexpr char kDemoFile[] = "demo.json";
constexpr double kTimeout_s = 15.0;

struct DemoArguments {
  std::string out = "demo";
  bool is_overwriting = false;
  std::uint64_t seed = 1;
};

// The services live as long as this call.
std::variant<flight::Plan, flight::NoPlan> plan_by_services(const Console& console,
                                                            const ServiceSetup& setup,
                                                            const flight::PlanRequest& request,
                                                            const std::string& config_text,
                                                            Observer& observer) {
  bus::Bus bus(setup.bus);
  bus::BlobExchange exchange({}, bus);
  ServiceChildren children(console, bus, setup);
  auto result = BusPlanner(bus, exchange).plan(request, config_text, kTimeout_s, observer);
  // The command model has begun to fly: a few seconds of it belong into the log.
  for (int i = 0; i < 60 && !observer.stop_requested(); ++i) {
    bus.poll(0.05);
    exchange.tick(bus.now());
    children.watch();
  }
  if (children.stop() != 0) {
    throw SystemFailure("a service did not end properly", "its own message stands above");
  }
  return result;
}

ExitCode run(const Console& console, const DemoArguments& arguments) {
  StagedFolder folder(arguments.out, kDemoFile, arguments.is_overwriting);
  const auto observer = console.observer();
  const std::filesystem::path out = folder.path();

  StageTimer timer;
  console.say("making a synthetic region: hills, forest, villages, a town, a power line");
  std::filesystem::create_directory(out / "region");
  const map_sources::SyntheticRegion region =
      map_sources::write_synthetic_region(out / "region", {.seed = arguments.seed});
  observer->check_stop();
  timer.lap("region");
  const map::Map map = prepare_synthetic_map(region, out / "map", {}, console.threads, *observer);
  observer->check_stop();
  timer.lap("prepare");

  ServiceSetup setup;
  setup.bus.url = bus::private_url();
  setup.map = out / "map";
  setup.log = out / "flight.lcmlog";
  setup.threads = console.threads;
  console.say("starting the services on " + setup.bus.url);
  const planning::PlanningConfig config = planning::read_planning_config(
      planning::effective_planning_config("", {}), "effective configuration");
  flight::PlanRequest request;
  request.start.position = region.start;
  request.goal.position = region.goal;
  const auto result = plan_by_services(console, setup, request, config.text, *observer);
  observer->check_stop();
  timer.lap("services");
  if (const auto* no_plan = std::get_if<flight::NoPlan>(&result)) {
    return report_no_plan(console, *no_plan);
  }
  const auto& plan = std::get<flight::Plan>(result);
  std::filesystem::create_directory(out / "plan");
  output::write_plan_bundle(plan, out / "plan");
  console.say("drawing");
  output::write_figures(plan, map, out / "plan" / "figures");
  ReportRequest report;
  report.plan_folder = out / "plan";
  report.map_folder = out / "map";
  write_file_atomically(out / "plan" / "report.html", report_html(report, plan, map));
  timer.lap("write");
  timer.write(out / "plan");

  const auto degrees_text = [](const geo::GeodeticPosition& position) {
    char text[64];
    std::snprintf(text, sizeof text, "%.6f,%.6f", degrees_from_radians(position.latitude_rad),
                  degrees_from_radians(position.longitude_rad));
    return std::string(text);
  };
  const nlohmann::ordered_json json = {{"schema", "hedgehop demo"},
                                       {"schema_version", 1},
                                       {"label", region.label},
                                       {"seed", arguments.seed},
                                       {"start", degrees_text(region.start)},
                                       {"goal", degrees_text(region.goal)},
                                       {"map", "map"},
                                       {"plan", "plan"},
                                       {"log", "flight.lcmlog"}};
  write_file_atomically(out / kDemoFile, json.dump(2) + "\n");
  observer->check_stop();
  folder.commit();

  const std::filesystem::path done = arguments.out;
  const ExitCode code = report_plan(console, plan, (done / "plan").string());
  console.say("report        " + (done / "plan" / "report.html").string());
  console.say("picture       " + (done / "plan" / "figures" / "plan.png").string());
  console.say("log           " + (done / "flight.lcmlog").string() +
              " (hedgehop log info, hedgehop replay, lcm-logplayer)");
  return code;
}

}  // namespace

void add_demo_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand(
      "demo", "The whole chain on an invented region: prepare, services, request over LCM, report");
  verb->footer(
      "Needs no files and no network. Leaves the region, its map, the plan with its report and "
      "pictures, and the "
      "log of everything that went over the bus.\n"
      "Example:\n"
      "  hedgehop demo --out demo");
  auto arguments = std::make_shared<DemoArguments>();
  verb->add_option("--out", arguments->out, "Folder to write to (default: demo)");
  verb->add_flag("--overwrite", arguments->is_overwriting, "Replace an existing demo in --out");
  verb->add_option("--seed", arguments->seed, "Another seed, another region (default 1)");
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] { return run(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
