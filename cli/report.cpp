#include "report.hpp"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <deque>
#include <memory>
#include <nlohmann/json.hpp>

#include "base/angles.hpp"
#include "base/config_reader.hpp"
#include "base/files.hpp"
#include "effective_config.hpp"
#include "map/map_bundle.hpp"
#include "output/figures.hpp"
#include "output/plan_bundle.hpp"
#include "output/report_page.hpp"
#include "output/route_choices.hpp"
#include "planning/planning.hpp"
#include "planning/request_areas.hpp"
#include "request_arguments.hpp"
#include "verbs.hpp"
#include "verification/plan_check.hpp"

namespace hedgehop::cli {
namespace {

namespace fs = std::filesystem;

constexpr char kReportFile[] = "report.html";
constexpr char kFiguresFolder[] = "figures";

struct Options {
  briefing::LegOptions legs;
  briefing::ManoeuvreOptions manoeuvres;
  briefing::CostOptions costs;
};

Options options_of(const ReportRequest& request) {
  ConfigReader reader = effective_config("report.yaml", request.config_file, request.settings);
  ConfigReader legs = reader.required_section("legs");
  ConfigReader manoeuvres = reader.required_section("manoeuvres");
  ConfigReader costs = reader.required_section("costs");
  const Options options{briefing::read_leg_options(legs),
                        briefing::read_manoeuvre_options(manoeuvres),
                        briefing::read_cost_options(costs)};
  reader.finish();
  return options;
}

void require_same_map(const flight::Plan& other, const std::string& folder,
                      const ReportRequest& request, const map::Map& map) {
  if (other.route_plan.map.hash != map.hash) {
    throw UsageError("plan " + folder + " was made on another map than plan " +
                         request.plan_folder.string() + ", or with other areas",
                     "compare plans of one map");
  }
}

// The state at a time of the flight.
std::size_t state_at(const flight::Trajectory& trajectory, double time_s) {
  const auto after = std::lower_bound(
      trajectory.states.begin(), trajectory.states.end(), time_s,
      [](const flight::FlightState& state, double time) { return state.time_s < time; });
  return static_cast<std::size_t>(std::min(after, trajectory.states.end() - 1) -
                                  trajectory.states.begin());
}

std::vector<geo::MapPoint> straight_places(const flight::Plan& plan, const map::Map& map) {
  std::vector<geo::MapPoint> places = {plan.route_plan.start.point()};
  if (!map.crs_wkt.empty()) {
    const geo::MapProjection projection(map.crs_wkt);
    for (const flight::RequestPoint& via : plan.route_plan.request.via) {
      places.push_back(projection.to_map(via.position));
    }
  }
  places.push_back(plan.route_plan.goal.point());
  return places;
}

// Refuses before anything is done.
void require_free(const fs::path& file, bool is_overwriting) {
  std::error_code error;
  if (fs::is_directory(file, error)) {
    throw UsageError("output file " + file.string() + " is a folder", "choose another name");
  }
  if (fs::exists(file, error) && !is_overwriting) {
    throw UsageError("output file " + file.string() + " exists already",
                     "choose another name with --out, or add --overwrite to replace it");
  }
  const fs::path parent = fs::absolute(file).parent_path();
  if (!fs::is_directory(parent, error)) {
    throw UsageError("the folder " + parent.string() + " does not exist",
                     "create it first, or choose another place");
  }
}

struct ReportArguments {
  ReportRequest request;
  std::string plan, map, out, start_time;
  std::optional<double> declination_deg;
  bool is_overwriting = false;
  bool has_no_figures = false;
};

ExitCode run(const Console& console, ReportArguments& arguments) {
  ReportRequest& request = arguments.request;
  request.plan_folder = arguments.plan;
  request.map_folder = arguments.map;
  if (!arguments.start_time.empty()) {
    request.start_time = parse_time(arguments.start_time, "--start-time");
  }
  if (arguments.declination_deg) {
    request.declination_rad = radians_from_degrees(*arguments.declination_deg);
  }
  const fs::path file =
      arguments.out.empty() ? fs::path(arguments.plan) / kReportFile : fs::path(arguments.out);
  const flight::Plan plan = output::read_plan_bundle(arguments.plan);
  if (!request.start_time && plan.timetable) {
    request.start_time = plan.timetable->entries.front().expected;
  }
  require_free(file, arguments.is_overwriting);
  const auto observer = console.observer();
  const map::Map map = planning::read_map_of_plan(arguments.map, plan, arguments.plan);
  observer->check_stop();
  const std::string html = report_html(request, plan, map);
  observer->check_stop();

  const fs::path figures = fs::path(arguments.plan) / kFiguresFolder;
  std::error_code error;
  const bool are_there = fs::exists(figures, error);
  const bool are_drawn = !arguments.has_no_figures && (!are_there || arguments.is_overwriting);
  if (are_drawn) {
    StagedFolder staged(figures, "plan.gp", arguments.is_overwriting);
    output::write_figures(plan, map, staged.path());
    observer->check_stop();
    staged.commit();
  }
  write_file_atomically(file, html);

  if (console.is_json) {
    nlohmann::ordered_json json;
    json["schema"] = "hedgehop report";
    json["schema_version"] = 1;
    json["plan"] = arguments.plan;
    json["report"] = file.string();
    if (are_there || are_drawn) {
      json["figures"] = figures.string();
    }
    std::printf("%s\n",
                json.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace).c_str());
  } else {
    std::printf("report        %s\n", file.c_str());
    if (are_drawn) {
      std::printf("figures       %s\n", figures.c_str());
    }
  }
  if (!arguments.has_no_figures && !are_drawn) {
    console.say("note: the figures in " + figures.string() +
                " are left as they are; --overwrite draws them again");
  }
  return ExitCode::kOk;
}

}  // namespace

std::string report_html(const ReportRequest& request, const flight::Plan& plan,
                        const map::Map& map) {
  const Options options = options_of(request);
  const planning::PlanningConfig config = planning::read_recorded_config(
      plan.route_plan.config_text, (request.plan_folder / output::kPlanFile).string() + ": config");
  const risk::CostModel model = planning::cost_model(map, config);

  output::ReportContent content;
  content.plan = &plan;
  content.map = &map;
  content.map_manifest_json = map::read_map_manifest(request.map_folder);
  content.check =
      verification::check_plan(map, plan, read_file(request.plan_folder / output::kTrajectoryFile));
  std::vector<std::size_t> via;
  std::vector<double> via_distance_m;
  for (const verification::ViaPass& pass : content.check.margins.via) {
    via.push_back(state_at(plan.trajectory, pass.time_s));
    via_distance_m.push_back(pass.distance_m);
  }
  content.legs = briefing::flight_legs(plan.trajectory, via, options.legs);
  content.manoeuvres =
      briefing::manoeuvres(map, plan.trajectory, via, via_distance_m, options.manoeuvres);
  content.costs = briefing::cost_profile(model, plan.trajectory, options.costs);
  content.beside_m = options.costs.beside_m;
  content.straight_height_m = model.reference_height_m();
  content.straight = briefing::straight_cost(model, straight_places(plan, map),
                                             content.straight_height_m, options.costs.step_m);
  std::error_code error;
  if (const fs::path threats = request.map_folder / map::kThreatsFile; fs::exists(threats, error)) {
    content.threats = map::read_height_bands(map, threats);
    content.exposures = briefing::exposures(content.threats, plan.trajectory);
  }
  content.start_time = request.start_time;
  content.declination_rad = request.declination_rad;
  std::deque<flight::Plan> others;
  if (auto list = output::read_route_choices(request.plan_folder)) {
    if (list->request_id != plan.route_plan.request_id || list->routes.empty()) {
      throw DataError((request.plan_folder / output::kChoicesFile).string() +
                          ": does not belong to the plan beside it",
                      "plan again with --alternatives, or remove that file");
    }
    for (output::ListedRoute& route : list->routes) {
      const flight::Plan* flown = nullptr;
      if (route.is_flown && !content.choices.empty()) {
        const fs::path folder = request.plan_folder / output::kChoicesFolder / route.name;
        others.push_back(output::read_plan_bundle(folder));
        require_same_map(others.back(), folder.string(), request, map);
        flown = &others.back();
        content.alternatives.push_back(
            {route.name, flown,
             briefing::cost_profile(model, flown->trajectory, options.costs).total()});
      }
      content.choices.push_back({std::move(route), flown});
    }
    content.why_no_more_choices = list->why_no_more;
  }
  for (const std::string& folder : request.compare) {
    others.push_back(output::read_plan_bundle(folder));
    require_same_map(others.back(), folder, request, map);
    content.alternatives.push_back(
        {folder, &others.back(),
         briefing::cost_profile(model, others.back().trajectory, options.costs).total()});
  }
  return output::report_page(content);
}

void add_report_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand(
      "report", "One HTML page about a plan: map, profiles, manoeuvres, legs, costs, verification");
  verb->footer(
      "The page needs no network and no other file: open it in any browser. Legs and manoeuvres "
      "are told ahead as a pilot would be told; config/report.yaml says what counts as one. "
      "Figures go into PLAN/figures as PNG, SVG and PDF, with the gnuplot scripts and data that "
      "made them.\n"
      "Examples:\n"
      "  hedgehop report plan --map map\n"
      "  hedgehop report plan --map map --start-time 2026-05-01T06:30Z --declination-deg 4.1 "
      "--out flight.html");
  auto arguments = std::make_shared<ReportArguments>();
  verb->add_option("plan", arguments->plan, "Plan bundle, a folder made by `hedgehop plan`")
      ->required();
  verb->add_option("--map", arguments->map, "The map bundle that it was planned on")->required();
  verb->add_option("--out", arguments->out, "File to write (default: PLAN/report.html)");
  verb->add_option("--start-time", arguments->start_time,
                   "When the flight begins, ISO 8601 with zone (default: the plan's departure, if "
                   "it has one)");
  verb->add_option("--declination-deg", arguments->declination_deg,
                   "Magnetic declination, east positive; without it no magnetic headings")
      ->check(CLI::Range(-180.0, 180.0));
  verb->add_option("--compare", arguments->request.compare,
                   "Another plan on the same map, shown as an alternative; may be repeated")
      ->allow_extra_args(false);
  verb->add_flag("--no-figures", arguments->has_no_figures, "Leave PLAN/figures alone");
  verb->add_flag("--overwrite", arguments->is_overwriting,
                 "Replace an existing report and figures");
  verb->add_option("--config", arguments->request.config_file,
                   "YAML file whose keys replace those of the shipped report.yaml");
  verb->add_option("--set", arguments->request.settings,
                   "One setting, key=value, for example legs.tolerance_m=50")
      ->allow_extra_args(false);
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] { return run(console, *arguments); };
  });
}

}  // namespace hedgehop::cli
