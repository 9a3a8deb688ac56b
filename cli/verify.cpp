#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>

#include "base/config_reader.hpp"
#include "base/files.hpp"
#include "base/shipped_config.hpp"
#include "leg_file.hpp"
#include "map/map_bundle.hpp"
#include "output/plan_bundle.hpp"
#include "planning/request_areas.hpp"
#include "uncertainty_arguments.hpp"
#include "verbs.hpp"
#include "verification/plan_check.hpp"
#include "verify_report.hpp"

namespace hedgehop::cli {
namespace {

ExitCode check_leg_file(const Console& console, const std::string& file,
                        const std::string& map_folder, const UncertaintyArguments& arguments) {
  if (arguments.is_asked_for()) {
    throw UsageError("errors can only be drawn for a plan, not for the legs of " + file,
                     "leave out --dem-error-m and --navigation-error-m, or give the plan's folder");
  }
  const map::Map map = map::read_map_bundle(map_folder);
  const double required_m =
      arguments.clearance_m
          ? *arguments.clearance_m
          : ConfigReader::from_text(shipped_config("planning.yaml"), "config/planning.yaml")
                .required_section("verification")
                .required_double("required_clearance_m");
  const std::vector<flight::Waypoint> waypoints = read_leg_file(file, map);
  return report_legs(console, file, map, waypoints.size(), required_m,
                     verification::check_legs(map, waypoints, required_m));
}

}  // namespace

void add_verify_verb(CLI::App& app, Console& console) {
  auto* verb = app.add_subcommand("verify",
                                  "Check a plan again, independently of the planners that made it");
  verb->footer(
      "Reads the plan's files and the map and checks, with no code of the planners: the continuous "
      "path against the surface, wires, obstacles and no-fly areas; the vehicle's limits; whether "
      "the states obey their own kinematics; start, goal and via points; and whether the costs, "
      "measures and columns in the files are true. Says how much is to spare and what comes "
      "nearest. Exit code 0: verified, 4: not.\n"
      "With --dem-error-m or --navigation-error-m errors of that standard deviation are drawn "
      "along "
      "the flight (config/uncertainty.yaml says how they go together), and the probability of a "
      "clearance below the demand is told with its interval; it decides nothing.\n"
      "A mission file, QGroundControl's .plan or a waypoint list (QGC WPL 110) with heights above "
      "mean "
      "sea level, is checked as straight legs against the map.\n"
      "Examples:\n"
      "  hedgehop verify plan --map map\n"
      "  hedgehop verify plan --map map --dem-error-m 4 --navigation-error-m 2 --json\n"
      "  hedgehop verify flight.plan --map map --clearance-m 12");
  struct Arguments {
    std::string plan, map;
    UncertaintyArguments uncertainty;
  };
  auto arguments = std::make_shared<Arguments>();
  verb->add_option("plan", arguments->plan,
                   "Plan bundle, a folder made by `hedgehop plan`; or a mission file")
      ->required();
  verb->add_option("--map", arguments->map, "The map bundle that it was planned on")->required();
  arguments->uncertainty.add_to(*verb);
  verb->add_option("--clearance-m", arguments->uncertainty.clearance_m,
                   "Clearance below which errors violate, or that legs must hold (default: the "
                   "plan's demand, or "
                   "that of the shipped config)")
      ->check(CLI::Range(0.0, 1000.0));
  add_common_options(*verb, console);
  verb->callback([&console, arguments] {
    console.action = [&console, arguments] {
      std::error_code ignored;
      if (std::filesystem::is_regular_file(arguments->plan, ignored)) {
        return check_leg_file(console, arguments->plan, arguments->map, arguments->uncertainty);
      }
      const flight::Plan plan = output::read_plan_bundle(arguments->plan);
      const map::Map map = planning::read_map_of_plan(arguments->map, plan, arguments->plan);
      const std::string folder = arguments->plan;
      const verification::PlanCheck check = verification::check_plan(
          map, plan, read_file(std::filesystem::path(folder) / output::kTrajectoryFile));
      return report_check(console, folder, map, plan, check,
                          arguments->uncertainty.risk_of(console, map, plan));
    };
  });
}

}  // namespace hedgehop::cli
