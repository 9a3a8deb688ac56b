#include <algorithm>

#include "evaluation/flown_route.hpp"
#include "evaluation/shared_json.hpp"
#include "evaluation/tuning.hpp"

namespace hedgehop::evaluation {
namespace {

using Json = nlohmann::ordered_json;

// Appends the mapping as YAML; leaves are written as they are.
void append_yaml(const Json& mapping, const std::string& indent, std::string& text) {
  for (const auto& [key, value] : mapping.items()) {
    text += indent + key + ":";
    if (value.is_object()) {
      text += "\n";
      append_yaml(value, indent + "  ", text);
    } else {
      text += " " + value.get<std::string>() + "\n";
    }
  }
}

Json safety_json(const TuneSafety& safety) {
  return {{"flights", safety.flights},           {"reached", safety.reached},
          {"collisions", safety.collisions},     {"clearance_violations", safety.violations},
          {"not_verified", safety.not_verified}, {"slowed", safety.slowed}};
}

Json optional_change(const std::optional<PairedChange>& change) {
  return change ? change_json(*change) : Json(nullptr);
}

Json comparison_json(const std::optional<TuneComparison>& of) {
  if (!of) {
    return nullptr;
  }
  Json json = {{"given", safety_json(of->given)},
               {"tuned", safety_json(of->tuned)},
               {"pairs", of->pairs},
               {"flight_cost", optional_change(of->flight_cost)},
               {"flight_cost_by_map", Json::array()},
               {"cost", optional_change(of->cost)},
               {"length", optional_change(of->length)},
               {"visibility", optional_change(of->visibility)},
               {"semantics", optional_change(of->semantics)},
               {"height", optional_change(of->height)},
               {"bank", optional_change(of->bank)}};
  for (const auto& change : of->by_map) {
    json["flight_cost_by_map"].push_back(optional_change(change));
  }
  return json;
}

}  // namespace

std::string tuned_config(const TuneResult& result) {
  Json tree = Json::object();
  for (const TuneResult::Parameter& parameter : result.parameters) {
    const std::string setting = setting_of(parameter.range.key, parameter.tuned);
    const std::size_t equals = setting.find('=');
    std::string pointer = "/" + setting.substr(0, equals);
    std::replace(pointer.begin(), pointer.end(), '.', '/');
    tree[Json::json_pointer(pointer)] = setting.substr(equals + 1);
  }
  std::string text = "# Found by hedgehop tune; for --config of hedgehop plan and others.\n# " +
                     result.verdict + "\n";
  append_yaml(tree, "", text);
  return text;
}

std::string tune_result_json(const TuneResult& result, const TuneOptions& options,
                             const TuneRecord& record) {
  Json json;
  json["schema"] = "hedgehop tune";
  json["schema_version"] = 1;
  json["seed"] = record.seed;
  json["maps"] = Json::array();
  for (std::size_t m = 0; m < record.map_hashes.size(); ++m) {
    json["maps"].push_back({{"hash", record.map_hashes[m]}, {"label", record.map_labels[m]}});
  }
  json["file"] = record.file;
  json["is_stopped"] = result.is_stopped;
  json["flights"] = options.flights;
  json["held_out_flights"] = options.held_out;
  json["evaluations"] = result.evaluations;
  json["is_better"] = result.is_better;
  json["verdict"] = result.verdict;
  json["parameters"] = Json::array();
  for (const TuneResult::Parameter& parameter : result.parameters) {
    const ParameterRange& range = parameter.range;
    json["parameters"].push_back(
        {{"key", range.key},
         {"low", range.low},
         {"high", range.high},
         {"logarithmic", range.is_logarithmic},
         {"given", parameter.given},
         {"tuned", parameter.tuned},
         {"moved_share", range.share_of(parameter.tuned) - range.share_of(parameter.given)}});
  }
  json["training"] = comparison_json(result.training);
  json["held_out"] = comparison_json(result.held_out);
  return json.dump(2) + "\n";
}

}  // namespace hedgehop::evaluation
