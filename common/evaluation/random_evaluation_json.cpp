#include <nlohmann/json.hpp>

#include "base/angles.hpp"
#include "evaluation/random_evaluation.hpp"

namespace hedgehop::evaluation {
namespace {

using Json = nlohmann::ordered_json;

// What a planner's error says need not be valid UTF-8.
std::string text_of(const Json& json) {
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

Json place_json(const geo::MapPoint& point, const geo::GeodeticPosition& position) {
  return {{"latitude_deg", degrees_from_radians(position.latitude_rad)},
          {"longitude_deg", degrees_from_radians(position.longitude_rad)},
          {"x_m", point.x_m},
          {"y_m", point.y_m}};
}

Json run_json(const Run& run) {
  Json json;
  json["outcome"] = name_of(run.outcome);
  if (!run.explanation.empty()) {
    json["explanation"] = run.explanation;
  }
  if (run.has_plan()) {
    json["length_m"] = run.measures.length_m;
    json["duration_s"] = run.measures.duration_s;
    json["visibility_m"] = run.measures.visibility_m;
    json["semantics_m"] = run.measures.semantics_m;
    json["bank_rad_m"] = run.measures.bank_rad_m;
    json["mean_height_m"] = run.measures.mean_height_m;
    json["max_height_m"] = run.measures.max_height_m;
    json["share_under_ceiling"] = run.measures.share_under_ceiling;
    json["clearance_min_m"] = run.clearance_min_m;
    json["route_cost_m"] = run.route_cost_m;
    json["violation_count"] = run.violation_count;
  }
  return json;
}

}  // namespace

std::string random_result_json(const RandomResult& result) {
  Json json;
  json["schema"] = "hedgehop evaluate random";
  json["schema_version"] = 1;
  json["is_stopped"] = result.is_stopped;
  json["seed"] = result.seed;
  json["drawn"] = result.problems.size();
  json["rejected_draws"] = result.rejected_unknown + result.rejected_near;
  json["rejected_unknown_elevation"] = result.rejected_unknown;
  json["rejected_too_near"] = result.rejected_near;
  json["verified"] = result.verified;
  json["not_verified"] = result.not_verified;
  json["named_cause"] = result.named_cause;
  json["not_found"] = result.not_found;
  json["errors"] = result.errors;
  json["baseline_verified"] = result.baseline_verified;
  json["compared"] = result.compared;
  json["visibility_change"] = result.visibility_change;
  json["length_change"] = result.length_change;
  json["problems"] = Json::array();
  for (const ProblemResult& problem : result.problems) {
    Json entry;
    entry["start"] = place_json(problem.problem.start, problem.start);
    entry["goal"] = place_json(problem.problem.goal, problem.goal);
    entry["distance_m"] = problem.distance_m;
    entry["visibility_change"] = problem.visibility_change;
    entry["with_weights"] = run_json(problem.with_weights);
    entry["baseline"] = run_json(problem.baseline);
    json["problems"].push_back(entry);
  }
  return text_of(json);
}

std::string random_timings_json(const RandomResult& result) {
  Json json;
  json["schema"] = "hedgehop evaluate random timings";
  json["schema_version"] = 1;
  double with_weights_s = 0.0;
  double baseline_s = 0.0;
  Json list = Json::array();
  for (const ProblemResult& problem : result.problems) {
    with_weights_s += problem.with_weights.clock_s;
    baseline_s += problem.baseline.clock_s;
    list.push_back({{"with_weights_s", problem.with_weights.clock_s},
                    {"baseline_s", problem.baseline.clock_s}});
  }
  json["with_weights_s"] = with_weights_s;
  json["baseline_s"] = baseline_s;
  json["problems"] = list;
  return text_of(json);
}

}  // namespace hedgehop::evaluation
