#include <nlohmann/json.hpp>

#include "base/angles.hpp"
#include "evaluation/optimality_evaluation.hpp"

namespace hedgehop::evaluation {
namespace {

using Json = nlohmann::ordered_json;

Json end_json(const geo::GeodeticPosition& position, const flight::Waypoint& waypoint) {
  return {{"latitude_deg", degrees_from_radians(position.latitude_rad)},
          {"longitude_deg", degrees_from_radians(position.longitude_rad)},
          {"x_m", waypoint.x_m},
          {"y_m", waypoint.y_m},
          {"altitude_m", waypoint.altitude_m}};
}

Json row_json(const OptimalityRow& row) {
  return {{"planner", row.planner},
          {"budget_s", row.budget_s},
          {"success", row.success},
          {"solved", row.solved},
          {"first_route_s_median", row.first_route_s_median},
          {"first_route_over_best_median", row.first_route_over_best_median},
          {"cost_over_best_median", row.cost_over_best_median},
          {"cost_over_best_p95", row.cost_over_best_p95},
          {"cost_over_bound_median", row.cost_over_bound_median},
          {"edges_per_s", row.edges_per_s},
          {"overshoot_s_median", row.overshoot_s_median},
          {"overshoot_s_max", row.overshoot_s_max},
          {"turn_rule", row.turn_rule},
          {"turns_kept", row.turns_kept},
          {"no_route_causes", row.no_route_causes},
          {"failures", row.failures}};
}

Json attempt_json(const JudgedAttempt& attempt, const std::string& planner) {
  Json json = {{"planner", planner},
               {"first_route_s", attempt.first_route_s},
               {"first_route_cost_m", attempt.first_route_cost_m},
               {"cost_m", attempt.costs_m},
               {"last_cost_m", attempt.last_cost_m},
               {"stopped_s", Json::array()},
               {"edges", Json::array()},
               {"turns_kept", attempt.are_turns_kept},
               {"refused_routes", attempt.refused_routes},
               {"lower_bound_m", attempt.lower_bound_m}};
  for (const BudgetMark& mark : attempt.marks) {
    json["stopped_s"].push_back(mark.stopped_s);
    json["edges"].push_back(mark.edges);
  }
  if (!attempt.no_route_cause.empty()) {
    json["no_route_cause"] = attempt.no_route_cause;
  }
  if (!attempt.failure.empty()) {
    json["failure"] = attempt.failure;
  }
  return json;
}

}  // namespace

std::string optimality_result_json(const OptimalityResult& result, const MachineRecord& machine) {
  Json json;
  json["schema"] = "hedgehop evaluate optimality";
  json["schema_version"] = 1;
  json["is_stopped"] = result.is_stopped;
  json["seed"] = result.seed;
  json["map_hash"] = result.map_hash.hex();
  json["map_label"] = result.map_label;
  json["version"] = machine.version;
  json["machine"] = {{"processor", machine.processor}, {"simd", machine.simd}};
  json["time"] =
      "processor time of the process from a cold start of each planner, one thread; ompl_prmstar "
      "uses two threads, whose sum counts. Planners of the library tell and stop late: for a "
      "budget "
      "they are given what they had when they had stopped, overshoot_s later";
  json["budgets_s"] = result.options.budgets_s;
  json["polish_s"] = result.options.polish_s;
  json["distance_min_m"] = result.options.drawing.distance_min_m;
  json["drawn"] = result.problems.size();
  json["rejected_draws"] = result.rejected_draws;
  json["rows"] = Json::array();
  for (const OptimalityRow& row : result.rows) {
    json["rows"].push_back(row_json(row));
  }
  json["cost_ratios"] = Json::array();
  for (const CostRatio& ratio : result.ratios) {
    json["cost_ratios"].push_back({{"planner", ratio.planner},
                                   {"budget_s", ratio.budget_s},
                                   {"against", ratio.against},
                                   {"against_budget_s", ratio.against_budget_s},
                                   {"problems", ratio.problems},
                                   {"median", ratio.median}});
  }
  json["problems"] = Json::array();
  for (const OptimalityProblem& problem : result.problems) {
    Json entry;
    entry["start"] = end_json(problem.start, problem.from);
    entry["goal"] = end_json(problem.goal, problem.to);
    entry["distance_m"] = problem.distance_m;
    entry["best_known_m"] = problem.best_known_m;
    entry["best_known_by"] = problem.best_known_by;
    entry["lower_bound_m"] = problem.lower_bound_m;
    entry["runs"] = Json::array();
    for (std::size_t i = 0; i < problem.attempts.size(); ++i) {
      // Rows of a contestant, one a budget, follow one another.
      const std::string& planner = result.rows[i * result.options.budgets_s.size()].planner;
      entry["runs"].push_back(attempt_json(problem.attempts[i], planner));
    }
    json["problems"].push_back(std::move(entry));
  }
  // What a library's exception says need not be valid UTF-8.
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace hedgehop::evaluation
