#include <limits>

#include "evaluation/framework_answers.hpp"
#include "evaluation/shared_json.hpp"

namespace hedgehop::evaluation {
namespace {

using Json = nlohmann::ordered_json;

// NaN is written as null.
double number_of(const Json& json) {
  return json.is_null() ? std::numeric_limits<double>::quiet_NaN() : json.get<double>();
}

Json path_json(const FrameworkPath& path) {
  const flight::PathMeasures& m = path.measures;
  return {{"is_found", path.is_found},      {"is_verified", path.is_verified},
          {"length_m", m.length_m},         {"duration_s", m.duration_s},
          {"visibility_m", m.visibility_m}, {"semantics_m", m.semantics_m},
          {"bank_rad_m", m.bank_rad_m},     {"mean_height_m", m.mean_height_m},
          {"max_height_m", m.max_height_m}, {"share_under_ceiling", m.share_under_ceiling},
          {"cost_m", path.cost_m},          {"route_cost_m", path.route_cost_m},
          {"route_s", path.route_s},        {"flight_s", path.flight_s},
          {"failure", path.failure}};
}

FrameworkPath path_of(const Json& json) {
  FrameworkPath path;
  path.is_found = json.at("is_found").get<bool>();
  path.is_verified = json.at("is_verified").get<bool>();
  flight::PathMeasures& m = path.measures;
  m.length_m = number_of(json.at("length_m"));
  m.duration_s = number_of(json.at("duration_s"));
  m.visibility_m = number_of(json.at("visibility_m"));
  m.semantics_m = number_of(json.at("semantics_m"));
  m.bank_rad_m = number_of(json.at("bank_rad_m"));
  m.mean_height_m = number_of(json.at("mean_height_m"));
  m.max_height_m = number_of(json.at("max_height_m"));
  m.share_under_ceiling = number_of(json.at("share_under_ceiling"));
  path.cost_m = number_of(json.at("cost_m"));
  path.route_cost_m = number_of(json.at("route_cost_m"));
  path.route_s = number_of(json.at("route_s"));
  path.flight_s = number_of(json.at("flight_s"));
  path.failure = json.at("failure").get<std::string>();
  return path;
}

Json change_json_of(const FrameworkChange& change) {
  Json json = {{"name", change.name},
               {"against", change.against},
               {"pairs", change.pairs},
               {"length", change_json(change.length)},
               {"visibility", change_json(change.visibility)},
               {"semantics", change_json(change.semantics)},
               {"height", change_json(change.height)}};
  if (change.bank) {
    json["bank"] = change_json(*change.bank);
  }
  if (change.cost) {
    json["cost"] = change_json(*change.cost);
  }
  return json;
}

double share(std::int64_t part, std::size_t whole) {
  return static_cast<double>(part) / static_cast<double>(whole);
}

}  // namespace

Json framework_identity(const map::Map& map, const planning::PlanningConfig& config,
                        const FrameworkOptions& options, std::uint64_t seed) {
  return {{"kind", "table3"},
          {"map", map.hash.hex()},
          {"config", config.text},
          {"margin_m", options.drawing.margin_m},
          {"distance_min_m", options.drawing.distance_min_m},
          {"budget_s", options.budget_s},
          {"edge_runs", options.edge_runs},
          {"paper_settings", options.paper_settings},
          {"baseline_settings", options.baseline_settings},
          {"seed", seed}};
}

Json framework_problem_json(const FrameworkProblem& problem) {
  Json json = {{"number", problem.number}, {"ours", path_json(problem.ours)}};
  json["wall_s"] = problem.wall_s;
  json["lower_bound_m"] = problem.lower_bound_m;
  json["no_plan_cause"] = problem.no_plan_cause;
  json["has_named_cause"] = problem.has_named_cause;
  json["paper"] = path_json(problem.paper);
  json["baseline"] = path_json(problem.baseline);
  json["baseline_edges"] = problem.baseline_edges;
  json["baseline_s"] = problem.baseline_s;
  json["straight_edges"] = problem.straight_edges;
  json["straight_s"] = problem.straight_s;
  return json;
}

std::optional<FrameworkProblem> framework_problem_of(const Json& json, std::int64_t number) {
  try {
    FrameworkProblem problem;
    problem.number = number;
    problem.ours = path_of(json.at("ours"));
    problem.wall_s = number_of(json.at("wall_s"));
    problem.lower_bound_m = number_of(json.at("lower_bound_m"));
    problem.no_plan_cause = json.at("no_plan_cause").get<std::string>();
    problem.has_named_cause = json.at("has_named_cause").get<bool>();
    problem.paper = path_of(json.at("paper"));
    problem.baseline = path_of(json.at("baseline"));
    problem.baseline_edges = json.at("baseline_edges").get<std::int64_t>();
    problem.baseline_s = number_of(json.at("baseline_s"));
    problem.straight_edges = json.at("straight_edges").get<std::int64_t>();
    problem.straight_s = number_of(json.at("straight_s"));
    return problem;
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

std::string framework_result_json(const FrameworkResult& result, const MachineRecord& machine) {
  const FrameworkOptions& options = result.options;
  Json json;
  json["schema"] = "hedgehop evaluate table3";
  json["schema_version"] = 1;
  json["seed"] = result.seed;
  json["map"] = {{"hash", result.map_hash}, {"label", result.map_label}};
  json["machine"] = machine_json(machine);
  json["is_stopped"] = result.is_stopped;
  json["budget_s"] = options.budget_s;
  json["turn_radius_m"] = result.turn_radius_m;
  json["paper_settings"] = options.paper_settings;
  json["baseline_settings"] = options.baseline_settings;
  json["drawn"] = result.problems.size();
  json["solved"] = result.solved;
  json["named_causes"] = result.named_causes;
  json["success"] = share(result.solved, result.problems.size());
  // Of the problems with a solution: those that were proved to have none do not count.
  json["success_of_solvable"] =
      share(result.solved, result.problems.size() - static_cast<std::size_t>(result.named_causes));
  const auto solved = static_cast<std::size_t>(result.solved);
  json["paper_framework"] = {{"reached", result.paper_solved},
                             {"verified", result.paper_verified},
                             {"share_reached", share(result.paper_solved, solved)}};
  // "success 66 %" of the paper is called the ratio of unsolved problems in its text.
  json["baseline"] = {{"solved", result.baseline_solved},
                      {"share_solved", share(result.baseline_solved, solved)},
                      {"share_not_solved", 1.0 - share(result.baseline_solved, solved)},
                      {"paper", {{"as_share_solved", 0.66}, {"as_share_not_solved", 0.66}}}};
  json["edges_per_s"] = {{"problems", options.edge_runs},
                         {"straight", result.straight_edges_per_s},
                         {"dubins", result.baseline_edges_per_s},
                         {"ratio", result.straight_edges_per_s / result.baseline_edges_per_s},
                         {"paper_ratio", 1.9}};
  json["time"] = {{"cpu_s_median", result.cpu_s_median}, {"wall_s_median", result.wall_s_median}};
  json["mission"] = {{"length_m", options.mission_m},
                     {"tolerance", options.mission_tolerance},
                     {"missions", result.missions},
                     {"cpu_s_median", result.mission_cpu_s_median},
                     {"wall_s_median", result.mission_wall_s_median},
                     {"paper_s", 43.6}};
  json["cost_over_bound_median"] = result.cost_over_bound_median;
  json["paper"] = {
      {"length", -0.31}, {"visibility", -0.38}, {"semantics", -0.93}, {"height", 0.04}};
  json["comparisons"] = Json::array();
  for (const FrameworkChange& change : result.changes) {
    json["comparisons"].push_back(change_json_of(change));
  }
  json["problems"] = Json::array();
  for (const FrameworkProblem& problem : result.problems) {
    json["problems"].push_back(framework_problem_json(problem));
  }
  return json.dump(2) + "\n";
}

}  // namespace hedgehop::evaluation
