#include "planning/alternatives.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <optional>

#include "base/errors.hpp"
#include "geo/map_projection.hpp"
#include "global_planning/leg_ground.hpp"
#include "planning/route_parts.hpp"

namespace hedgehop::planning {
namespace {

using flight::RouteChoice;
using flight::RouteChoices;
using flight::RouteMeasures;

constexpr char kMainName[] = "main";
constexpr double kMeasureStep_m = 5.0;

bool is_folder_name(const std::string& name) {
  return !name.empty() && name.size() <= 40 && name != kMainName && name.front() != '-' &&
         std::all_of(name.begin(), name.end(), [](char c) {
           return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' || c == '_';
         });
}

std::string shortest_text(double value) {
  std::array<char, 32> buffer{};
  return {buffer.data(), std::to_chars(buffer.data(), buffer.data() + buffer.size(), value).ptr};
}

std::string percent_text(double share) { return text_of(100.0 * share, 0) + " %"; }

class AlternativeSearch {
 public:
  AlternativeSearch(const map::Map& map, const flight::RoutePlan& main,
                    const PlanningConfig& config, const AlternativeOptions& options,
                    Observer& observer)
      : options_(options),
        config_(config),
        observer_(observer),
        projection_(map.crs_wkt),
        costs_(cost_model(map, config)),
        plain_(costs_.reweighted(1.0, 1.0)) {
    auto placed = place_stops(costs_, main.request, config);
    if (std::holds_alternative<flight::NoPlan>(placed)) {
      throw DataError("the plan's start, goal or via points do not fit the map",
                      "use the map and the config that the plan was made with");
    }
    const auto& stops = std::get<std::vector<flight::Waypoint>>(placed);
    const global_planning::GlobalOptions global =
        global_options(in_wind(config, map.crs_wkt, stops.front().point()),
                       main.request.speed_mps.value_or(config.speed_mps));
    for (std::size_t leg = 0; leg + 1 < stops.size(); ++leg) {
      legs_.emplace_back(
          costs_, global,
          leg_problem(map, stops, main.request, config, static_cast<std::int64_t>(leg)));
    }
    found_.shared_within_m = options.shared_within_m;
    found_.shared_share_max = options.shared_share_max;
    found_.routes.push_back({kMainName, main, measures_of(main.route), config.weights.visibility,
                             config.weights.semantics, 0.0});
  }

  RouteChoices all() {
    std::string reasons;
    double done = 0.0;
    const auto total = static_cast<double>(options_.weightings.size() * options_.avoidances.size());
    for (const RouteWeighting& weighting : options_.weightings) {
      if (found_.routes.size() >= options_.routes_max) {
        break;
      }
      const risk::CostModel costs = costs_.reweighted(weighting.visibility, weighting.semantics);
      std::string why;
      bool is_found = false;
      for (std::size_t i = 0; i < options_.avoidances.size() && !is_found; ++i) {
        observer_.progress("looking for alternatives", done + static_cast<double>(i), total);
        if (observer_.stop_requested()) {
          found_.why_no_more = "stopped before all weightings were tried";
          return finished();
        }
        is_found = try_one(weighting, costs, options_.avoidances[i], why);
      }
      done += static_cast<double>(options_.avoidances.size());
      if (!is_found) {
        reasons += (reasons.empty() ? "" : "; ") + weighting.name + ": " + why;
      }
    }
    observer_.progress("looking for alternatives", total, total);
    if (found_.routes.size() < options_.routes_max) {
      found_.why_no_more = reasons;
    }
    return finished();
  }

 private:
  [[nodiscard]] RouteMeasures measures_of(const flight::Route& route) const {
    const flight::RouteCost cost = plain_.route_cost(route.waypoints, kMeasureStep_m);
    return {cost.length_m, cost.visibility_m, cost.semantics_m};
  }

  /// Why a route may not stand beside those found so far. Before refinement nothing is said about
  /// what it is better in: that would be unfair.
  [[nodiscard]] std::optional<std::string> fault_of(const flight::Route& route,
                                                    bool is_refined) const {
    const RouteMeasures measures = measures_of(route);
    const double longest_m = options_.length_factor_max * found_.routes.front().measures.length_m;
    if (measures.length_m > longest_m) {
      return "its route is longer than " + text_of(0.001 * longest_m, 1) + " km";
    }
    for (const RouteChoice& other : found_.routes) {
      const std::vector<flight::Waypoint>& others = other.plan.route.waypoints;
      const double shared =
          std::max(shared_share(route.waypoints, others, options_.shared_within_m),
                   shared_share(others, route.waypoints, options_.shared_within_m));
      if (shared > options_.shared_share_max) {
        return percent_text(shared) + " of it or of '" + other.name + "' run together, around " +
               text_of(projection_.to_geodetic(
                   longest_shared_stretch(route.waypoints, others, options_.shared_within_m)));
      }
    }
    for (const RouteChoice& other : found_.routes) {
      if (!is_refined) {
        break;
      }
      if (!is_better_in_something(measures, other.measures, options_.gain_min)) {
        return "it is better than '" + other.name + "' in nothing";
      }
      if (!is_better_in_something(other.measures, measures, options_.gain_min)) {
        return "it is better than '" + other.name + "' in everything, which then is no choice";
      }
    }
    return std::nullopt;
  }

  bool try_one(const RouteWeighting& weighting, const risk::CostModel& costs, double avoidance,
               std::string& why) {
    std::vector<global_planning::Avoidance> avoided;
    for (const RouteChoice& other : found_.routes) {
      if (avoidance > 0.0) {
        avoided.push_back({other.plan.route.waypoints, options_.avoidance_width_m, avoidance});
      }
    }
    flight::Route route;
    for (const bool is_refined : {false, true}) {
      route = {};
      for (const global_planning::LegGround& leg : legs_) {
        const auto planned = leg.plan(costs, avoided, is_refined, observer_);
        if (const auto* none = std::get_if<flight::NoPlan>(&planned)) {
          why = none->explanation;
          return false;
        }
        append_leg(route, std::get<flight::Route>(planned));
      }
      if (auto fault = fault_of(route, is_refined)) {
        why = *std::move(fault) +
              (avoidance > 0.0
                   ? ", although each metre within " + text_of(options_.avoidance_width_m, 0) +
                         " m of the others cost " + text_of(avoidance, 1) + " more"
                   : "");
        return false;
      }
    }
    RouteChoice choice;
    choice.name = weighting.name;
    choice.measures = measures_of(route);
    choice.visibility_weight = weighting.visibility;
    choice.semantics_weight = weighting.semantics;
    choice.avoidance = avoidance;
    choice.plan = found_.routes.front().plan;
    choice.plan.config_text = set_config_value(
        set_config_value(config_.text, "weights.visibility=" + shortest_text(weighting.visibility)),
        "weights.semantics=" + shortest_text(weighting.semantics));
    choice.plan.request_id =
        flight::plan_request_id(choice.plan.request, choice.plan.map.hash, choice.plan.config_text);
    choice.plan.route = std::move(route);
    found_.routes.push_back(std::move(choice));
    return true;
  }

  RouteChoices finished() {
    for (const RouteChoice& one : found_.routes) {
      std::vector<double> row;
      for (const RouteChoice& other : found_.routes) {
        row.push_back(shared_share(one.plan.route.waypoints, other.plan.route.waypoints,
                                   options_.shared_within_m));
      }
      found_.shared.push_back(std::move(row));
    }
    return std::move(found_);
  }

  const AlternativeOptions& options_;
  const PlanningConfig& config_;
  Observer& observer_;
  geo::MapProjection projection_;
  risk::CostModel costs_;
  risk::CostModel plain_;  // without weights
  std::vector<global_planning::LegGround> legs_;
  RouteChoices found_;
};

}  // namespace

AlternativeOptions read_alternative_options(ConfigReader& reader) {
  AlternativeOptions options;
  const std::int64_t routes_max = reader.required_integer("routes_max");
  reader.require(routes_max >= 2 && routes_max <= 20, "routes_max", "must lie between 2 and 20");
  options.routes_max = static_cast<std::size_t>(routes_max);
  const auto between = [&](const char* key, double low, double high, double& value) {
    value = reader.required_double(key);
    reader.require(value >= low && value <= high, key,
                   "must lie between " + text_of(low, 0) + " and " + text_of(high, 0));
  };
  between("shared_within_m", 0.0, 1e5, options.shared_within_m);
  between("shared_share_max", 0.0, 1.0, options.shared_share_max);
  between("gain_min", 0.0, 1.0, options.gain_min);
  between("length_factor_max", 1.0, 100.0, options.length_factor_max);
  between("avoidance_width_m", 0.0, 1e5, options.avoidance_width_m);
  options.avoidances = reader.required_doubles("avoidances");
  reader.require(!options.avoidances.empty() && options.avoidances.size() <= 20, "avoidances",
                 "must have 1 to 20 entries");
  for (std::size_t i = 0; i < options.avoidances.size(); ++i) {
    const double least = i == 0 ? 0.0 : options.avoidances[i - 1];
    reader.require(options.avoidances[i] >= least && options.avoidances[i] <= 1e4, "avoidances",
                   "must ascend from 0 or more to at most 10000");
  }
  for (ConfigReader& entry : reader.required_sections("weightings")) {
    RouteWeighting weighting;
    weighting.name = entry.required_string("name");
    entry.require(is_folder_name(weighting.name), "name",
                  "must be a word of small letters, digits, '-' and '_', and not 'main'");
    entry.require(
        std::none_of(options.weightings.begin(), options.weightings.end(),
                     [&](const RouteWeighting& other) { return other.name == weighting.name; }),
        "name", "names a weighting a second time");
    const auto weight = [&](const char* key, double& value) {
      value = entry.required_double(key);
      entry.require(value >= 0.0 && value <= 1e6, key, "must lie between 0 and 1000000");
    };
    weight("visibility", weighting.visibility);
    weight("semantics", weighting.semantics);
    entry.finish();
    options.weightings.push_back(std::move(weighting));
  }
  reader.require(!options.weightings.empty() && options.weightings.size() <= 50, "weightings",
                 "must have 1 to 50 entries");
  reader.finish();
  return options;
}

RouteChoices plan_alternatives(const map::Map& map, const flight::RoutePlan& main,
                               const PlanningConfig& config, const AlternativeOptions& options,
                               Observer& observer) {
  if (main.map.hash != map.hash) {
    throw DataError("the route was planned on map " + main.map.hash.hex() +
                        ", the map at hand is " + map.hash.hex(),
                    "use the map that the route was planned on");
  }
  return AlternativeSearch(map, main, config, options, observer).all();
}

}  // namespace hedgehop::planning
