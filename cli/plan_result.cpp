#include "plan_result.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <nlohmann/json.hpp>

#include "base/angles.hpp"
#include "base/files.hpp"
#include "base/utc_time.hpp"

namespace hedgehop::cli {
namespace {

double process_cpu_s() {
  timespec time{};
  ::clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

// Routes to choose from, as a table.
void print_choices(const flight::RouteChoices& choices,
                   const std::vector<output::FlownChoice>& flown) {
  std::printf("\nroute               length      seen  land use  runs with others  flown\n");
  for (std::size_t i = 0; i < choices.routes.size(); ++i) {
    const flight::RouteChoice& choice = choices.routes[i];
    double shared = 0.0;
    for (std::size_t j = 0; j < choices.routes.size(); ++j) {
      shared = std::max(shared, j == i ? 0.0 : choices.shared[i][j]);
    }
    const auto flight = std::find_if(flown.begin(), flown.end(),
                                     [i](const auto& candidate) { return candidate.route == i; });
    const char* verdict = flight == flown.end()               ? "not flown"
                          : flight->plan == nullptr           ? "no flight along it arrives"
                          : flight->plan->verdict.is_verified ? "verified"
                                                              : "NOT verified";
    std::printf("%-16s %6.2f km  %6.0f m  %6.0f m  %14.0f %%  %s\n", choice.name.c_str(),
                1e-3 * choice.measures.length_m, choice.measures.visibility_m,
                choice.measures.semantics_m, 100.0 * shared, verdict);
  }
  if (!choices.why_no_more.empty()) {
    std::printf("no more routes: %s\n", choices.why_no_more.c_str());
  }
}

}  // namespace

StageTimer::StageTimer() : wall_(std::chrono::steady_clock::now()), cpu_s_(process_cpu_s()) {}

void StageTimer::lap(const std::string& stage) {
  const auto now = std::chrono::steady_clock::now();
  const double cpu_s = process_cpu_s();
  laps_.push_back({stage, std::chrono::duration<double>(now - wall_).count(), cpu_s - cpu_s_});
  wall_ = now;
  cpu_s_ = cpu_s;
}

void StageTimer::write(const std::filesystem::path& folder) const {
  nlohmann::ordered_json json;
  json["schema"] = "hedgehop timings";
  json["schema_version"] = 1;
  for (const Lap& lap : laps_) {
    json["stages"].push_back({{"stage", lap.stage}, {"wall_s", lap.wall_s}, {"cpu_s", lap.cpu_s}});
  }
  write_file_atomically(folder / "timings.json", json.dump(2) + "\n");
}

global_planning::OnProgress route_progress(Observer& observer) {
  return [&observer](const global_planning::RouteProgress& progress) {
    observer.progress("planning the route", static_cast<double>(progress.work_units),
                      static_cast<double>(progress.work_budget));
  };
}

ExitCode report_no_plan(const Console& console, const flight::NoPlan& no_plan) {
  const bool is_request_wrong = no_plan.cause <= flight::NoPlanCause::kReferenceHeightMismatch;
  const ExitCode code = is_request_wrong ? ExitCode::kUsage : ExitCode::kNoRoute;
  std::fprintf(stderr, "error: no plan (%s): %s\n", flight::name_of(no_plan.cause),
               no_plan.explanation.c_str());
  if (console.is_json) {
    nlohmann::ordered_json json;
    json["schema"] = "hedgehop no plan";
    json["schema_version"] = 1;
    json["no_plan"]["cause"] = flight::name_of(no_plan.cause);
    json["no_plan"]["explanation"] = no_plan.explanation;
    if (no_plan.place) {
      json["no_plan"]["x_m"] = no_plan.place->x_m;
      json["no_plan"]["y_m"] = no_plan.place->y_m;
    }
    std::printf("%s\n", json.dump(2).c_str());
  }
  return code;
}

ExitCode report_plan(const Console& console, const flight::Plan& plan, const std::string& folder,
                     bool is_stopped, const flight::RouteChoices* choices,
                     const std::vector<output::FlownChoice>& flown) {
  const flight::PathMeasures& measures = plan.measures;
  const flight::Verdict& verdict = plan.verdict;
  if (console.is_json) {
    nlohmann::ordered_json json;
    json["schema"] = "hedgehop plan result";
    json["schema_version"] = 1;
    json["plan"] = folder;
    json["request_id"] = plan.route_plan.request_id.hex();
    json["map_hash"] = plan.route_plan.map.hash.hex();
    json["is_stopped"] = is_stopped;
    json["is_verified"] = verdict.is_verified;
    json["violation_count"] = verdict.violation_count;
    json["length_m"] = measures.length_m;
    json["duration_s"] = measures.duration_s;
    json["mean_height_m"] = measures.mean_height_m;
    json["clearance_min_m"] = verdict.clearance_min_m;
    json["share_under_ceiling"] = measures.share_under_ceiling;
    json["visibility_m"] = measures.visibility_m;
    json["semantics_m"] = measures.semantics_m;
    json["route_cost_m"] = plan.route_plan.route.cost.total_m();
    json["lower_bound_m"] = plan.route_plan.route.lower_bound_m;
    if (plan.timetable) {
      const flight::Timetable& table = *plan.timetable;
      json["departure"] = utc_text(table.entries.front().expected);
      json["arrival"] = utc_text(table.entries.back().expected);
      json["is_on_time"] = table.greatest_error_s() <= table.tolerance_s;
    }
    json["warnings"] = plan.warnings;
    if (choices != nullptr) {
      json["alternatives"] =
          nlohmann::ordered_json::parse(output::route_choices_json(*choices, flown));
      for (nlohmann::ordered_json& route : json["alternatives"]["routes"]) {
        route.erase("waypoints");  // in the file
      }
    }
    std::printf("%s\n", json.dump(2).c_str());
  } else {
    if (!plan.route_plan.map.label.empty()) {
      std::printf("%s\n", plan.route_plan.map.label.c_str());
    }
    std::printf("plan          %s\n", folder.c_str());
    std::printf("length        %.2f km in %.0f s\n", 1e-3 * measures.length_m, measures.duration_s);
    if (plan.timetable) {
      std::printf("times         %s to %s\n",
                  utc_text(plan.timetable->entries.front().expected).c_str(),
                  utc_text(plan.timetable->entries.back().expected).c_str());
    }
    std::printf(
        "height        mean %.1f m above the surface, %.1f %% of the way under the ceiling\n",
        measures.mean_height_m, 100.0 * measures.share_under_ceiling);
    std::printf("clearance     at least %.1f m\n", verdict.clearance_min_m);
    std::printf("bank          at most %.1f degrees\n", degrees_from_radians(verdict.bank_max_rad));
    std::printf("seen by       %.1f %% of the surroundings on average\n",
                measures.length_m > 0.0 ? 100.0 * measures.visibility_m / measures.length_m : 0.0);
    if (verdict.is_verified) {
      std::printf("verified      yes, no violation\n");
    } else {
      std::printf("verified      NO, %lld violations\n",
                  static_cast<long long>(verdict.violation_count));
    }
    if (choices != nullptr) {
      print_choices(*choices, flown);
    }
  }
  for (const std::string& warning : plan.warnings) {
    console.say("warning: " + warning);
  }
  if (!verdict.is_verified) {
    for (std::size_t i = 0; i < verdict.violations.size() && i < 5; ++i) {
      const flight::Violation& violation = verdict.violations[i];
      std::fprintf(stderr, "violation: %s at %.2f s (x %.0f m, y %.0f m): %.4g, limit %.4g\n",
                   violation.rule.c_str(), violation.time_s, violation.place.x_m,
                   violation.place.y_m, violation.value, violation.limit);
    }
    return ExitCode::kNotVerified;
  }
  return ExitCode::kOk;
}

}  // namespace hedgehop::cli
