#include <nlohmann/json.hpp>

#include "base/angles.hpp"
#include "evaluation/local_flights.hpp"
#include "evaluation/shared_json.hpp"

namespace hedgehop::evaluation {
namespace {

using Json = nlohmann::ordered_json;

}  // namespace

std::string table2_result_json(const Table2Result& result) {
  Json json;
  json["schema"] = "hedgehop evaluate table2";
  json["schema_version"] = 1;
  json["is_stopped"] = result.is_stopped;
  json["seed"] = result.seed;
  json["map_hash"] = result.map_hash;
  json["runs"] = result.runs;
  json["problems"] = result.problems;
  json["plain_not_reached"] = result.plain_not_reached;
  json["plain_not_verified"] = result.plain_not_verified;
  // Table 2 of the paper: mean and standard deviation of each run's own change.
  json["paper"] = {{"length", {0.02, 0.01}},
                   {"visibility", {-0.02, 0.04}},
                   {"semantics", {-0.04, 0.02}},
                   {"height", {-0.09, 0.09}},
                   {"bank", {0.45, 0.16}}};
  json["comparisons"] = Json::array();
  for (const Table2Comparison& comparison : result.comparisons) {
    json["comparisons"].push_back({{"name", comparison.name},
                                   {"pairs", comparison.pairs},
                                   {"not_verified", comparison.not_verified},
                                   {"regressions", comparison.regressions},
                                   {"plain_taken", comparison.plain_taken},
                                   {"length", change_json(comparison.length)},
                                   {"visibility", change_json(comparison.visibility)},
                                   {"semantics", change_json(comparison.semantics)},
                                   {"height", change_json(comparison.height)},
                                   {"bank", change_json(comparison.bank)},
                                   {"cost", change_json(comparison.cost)}});
  }
  return json.dump(2) + "\n";
}

std::string local_safety_result_json(const LocalSafetyResult& result) {
  Json json;
  json["schema"] = "hedgehop evaluate local-safety";
  json["schema_version"] = 1;
  json["is_stopped"] = result.is_stopped;
  json["seed"] = result.seed;
  json["map_hash"] = result.map_hash;
  json["problems"] = result.problems;
  json["required_clearance_m"] = result.required_clearance_m;
  json["towers"] = {{"per_km2", result.options.towers_per_km2},
                    {"height_min_m", result.options.tower_height_min_m},
                    {"height_max_m", result.options.tower_height_max_m},
                    {"free_radius_m", result.options.tower_free_radius_m},
                    {"near_m", result.options.tower_near_m}};
  json["cut"] = {
      {"ahead_s", result.cut_off.horizon_s},
      {"heading_rate_max_degps", degrees_from_radians(result.cut_off.heading_rate_max_radps)}};
  json["rows"] = Json::array();
  for (const LocalSafetyRow& row : result.rows) {
    json["rows"].push_back({{"planner", row.planner},
                            {"towers", row.has_towers},
                            {"settings", row.settings},
                            {"flights", row.flights},
                            {"reached", row.reached},
                            {"collisions", row.collisions},
                            {"clearance_violations", row.clearance_violations},
                            {"not_verified", row.not_verified},
                            {"ways_out", row.ways_out},
                            {"min_clearance_m", row.min_clearance_m},
                            {"mean_min_clearance_m", row.mean_min_clearance_m},
                            {"mean_height_m", row.mean_height_m},
                            {"share_under_ceiling", row.share_under_ceiling},
                            {"share_under_ceiling_off_towers", row.share_under_ceiling_off_towers},
                            {"length_m", row.length_m},
                            {"unsafe_problems", row.unsafe_problems},
                            {"seed", result.seed}});
  }
  return json.dump(2) + "\n";
}

}  // namespace hedgehop::evaluation
