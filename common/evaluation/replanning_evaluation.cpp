#include "evaluation/replanning_evaluation.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <oneapi/tbb/global_control.h>
#include <random>
#include <variant>

#include "base/errors.hpp"
#include "evaluation/paired_statistics.hpp"
#include "evaluation/shared_json.hpp"
#include "global_planning/corridor_refinement.hpp"
#include "global_planning/global_planner.hpp"
#include "global_planning/route_finish.hpp"
#include "global_planning/warm_planner.hpp"

namespace hedgehop::evaluation {
namespace {

using flight::Waypoint;
using global_planning::FlightEnvelope;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kCostStep_m = 1.0;
constexpr int kPolishesMax = 6;
constexpr double kPolishGain = 1e-4;

// In [0, 1), the same on every machine.
double drawn(std::mt19937_64& random) { return static_cast<double>(random() >> 11U) * 0x1.0p-53; }

double between(std::mt19937_64& random, double low, double high) {
  return low + drawn(random) * (high - low);
}

/// The place at a share of a route's length.
Waypoint place_at(const std::vector<Waypoint>& route, double share) {
  double left_m = share * flight::length_m(route);
  for (std::size_t i = 1; i < route.size(); ++i) {
    const double leg_m = flight::length_m({route[i - 1], route[i]});
    if (left_m <= leg_m && leg_m > 0.0) {
      const double t = left_m / leg_m;
      const Waypoint& a = route[i - 1];
      const Waypoint& b = route[i];
      return {a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m),
              a.altitude_m + t * (b.altitude_m - a.altitude_m)};
    }
    left_m -= leg_m;
  }
  return route.back();
}

std::vector<Waypoint> rest_from(const std::vector<Waypoint>& route, double share) {
  std::vector<Waypoint> rest = {place_at(route, share)};
  double along_m = 0.0;
  const double from_m = share * flight::length_m(route);
  for (std::size_t i = 1; i < route.size(); ++i) {
    along_m += flight::length_m({route[i - 1], route[i]});
    if (along_m > from_m) {
      rest.push_back(route[i]);
    }
  }
  return rest;
}

/// Raises what a disc of the map's visibility says; gives back what it was.
class Threat {
 public:
  Threat(map::Map& map, const geo::MapPoint& centre, double radius_m, double visibility)
      : map_(map) {
    const raster::GridGeometry& g = map.geometry;
    const int west = std::max(0, g.cell_at({centre.x_m - radius_m, centre.y_m}).column);
    const int east = std::min(g.columns - 1, g.cell_at({centre.x_m + radius_m, centre.y_m}).column);
    const int south = std::max(0, g.cell_at({centre.x_m, centre.y_m - radius_m}).row);
    const int north = std::min(g.rows - 1, g.cell_at({centre.x_m, centre.y_m + radius_m}).row);
    window_ = {west, south, east - west + 1, north - south + 1};
    const auto least = static_cast<std::uint16_t>(std::lround(visibility * map::kVisibilityScale));
    for_each_layer([&](raster::Grid<std::uint16_t>& layer) {
      for (int row = south; row <= north; ++row) {
        for (int column = west; column <= east; ++column) {
          std::uint16_t& value = layer.at(column, row);
          before_.push_back(value);
          const geo::MapPoint at = g.centre({column, row});
          const double dx_m = at.x_m - centre.x_m;
          const double dy_m = at.y_m - centre.y_m;
          if (value != map::kVisibilityUnknown &&
              dx_m * dx_m + dy_m * dy_m <= radius_m * radius_m) {
            value = std::max(value, least);
          }
        }
      }
    });
  }
  Threat(const Threat&) = delete;
  Threat& operator=(const Threat&) = delete;
  ~Threat() {
    std::size_t next = 0;
    for_each_layer([&](raster::Grid<std::uint16_t>& layer) {
      for (int row = window_.row; row < window_.row + window_.rows; ++row) {
        for (int column = window_.column; column < window_.column + window_.columns; ++column) {
          layer.at(column, row) = before_[next++];
        }
      }
    });
  }
  [[nodiscard]] const raster::Window& window() const { return window_; }

 private:
  template <typename Visit>
  void for_each_layer(const Visit& visit) {
    visit(map_.visibility);
    for (map::VisibilityBand& band : map_.further_visibility) {
      visit(band.share);
    }
  }

  map::Map& map_;
  raster::Window window_;
  std::vector<std::uint16_t> before_;
};

}  // namespace

ReplanningOptions read_replanning_options(ConfigReader& reader) {
  ReplanningOptions options;
  const auto count = [&](const char* key, std::int64_t& value) {
    value = reader.required_integer(key);
    reader.require(value >= 1 && value <= 100000, key, "must lie in 1 to 100000");
  };
  count("events", options.events);
  count("events_per_route", options.events_per_route);
  options.drawing = read_drawing_rules(reader);
  const auto range = [&](const char* low_key, double& low, const char* high_key, double& high,
                         double most) {
    low = reader.required_double(low_key);
    high = reader.required_double(high_key);
    reader.require(low >= 0.0 && low <= most, low_key, "is out of range");
    reader.require(high >= low && high <= most, high_key, "must not be below the other end");
  };
  range("flown_min", options.flown_min, "flown_max", options.flown_max, 0.9);
  range("threat_at_min", options.threat_at_min, "threat_at_max", options.threat_at_max, 1.0);
  range("threat_radius_min_m", options.threat_radius_min_m, "threat_radius_max_m",
        options.threat_radius_max_m, 1e5);
  options.threat_visibility = reader.required_double("threat_visibility");
  reader.require(options.threat_visibility >= 0.0 && options.threat_visibility <= 1.0,
                 "threat_visibility", "must lie between 0 and 1");
  reader.finish();
  return options;
}

ReplanningResult evaluate_replanning(const map::Map& map, const planning::PlanningConfig& config,
                                     const ReplanningOptions& options, std::uint64_t seed,
                                     const ProcessClock& clock, Observer& observer) {
  const oneapi::tbb::global_control one_thread(oneapi::tbb::global_control::max_allowed_parallelism,
                                               1);
  ReplanningResult result;
  result.seed = seed;
  result.map_hash = map.hash;
  result.map_label = map.label;
  result.options = options;
  map::Map changing = map;
  risk::CostModel costs = planning::cost_model(changing, config);
  const std::int64_t routes =
      (options.events + options.events_per_route - 1) / options.events_per_route;
  // Some have no route.
  const DrawnProblems problems = draw_problems(map, options.drawing, 2 * routes, seed);
  std::mt19937_64 random(seed);
  const auto end_at = [&](const geo::MapPoint& point) {
    return Waypoint{point.x_m, point.y_m,
                    raster::max_within(map.surface_m, point, config.global.lateral_margin_m) +
                        config.reference_height_m};
  };
  const auto total = static_cast<double>(options.events);
  const auto one_event = [&](const global_planning::WarmPlanner& planned,
                             const global_planning::RouteProblem& problem,
                             const std::vector<Waypoint>& route) {
    ReplanningEvent event;
    const double flown = between(random, options.flown_min, options.flown_max);
    event.start = place_at(route, flown);
    event.goal = problem.goal;
    event.threat =
        place_at(route, between(random, options.threat_at_min, options.threat_at_max)).point();
    event.threat_radius_m =
        between(random, options.threat_radius_min_m, options.threat_radius_max_m);
    raster::Window window;
    {
      const Threat threat(changing, event.threat, event.threat_radius_m, options.threat_visibility);
      window = threat.window();
      global_planning::WarmPlanner warm = planned;
      const double before_s = clock();
      warm.costs_changed(costs.visibility_changed(window));
      auto replanned = warm.replan(event.start, observer);
      event.warm_s = clock() - before_s;
      observer.check_stop();

      const global_planning::RouteProblem moved{event.start, problem.goal, problem.seed,
                                                problem.work_budget};
      const FlightEnvelope envelope(costs, config.global, moved.start, moved.goal);
      const auto cost_of = [&](const std::vector<Waypoint>& line) {
        return costs.route_cost(line, kCostStep_m).total_m();
      };
      event.old_cost_m = cost_of(rest_from(route, flown));
      event.cost_m = event.polished_m = event.claimed_cost_m = kNaN;
      if (const auto* found = std::get_if<global_planning::WarmRoute>(&replanned)) {
        const std::vector<Waypoint>& line = found->route.waypoints;
        event.is_cold = found->is_cold;
        event.blocks_renewed = static_cast<std::int64_t>(found->blocks_renewed);
        event.claimed_cost_m = found->route.cost.total_m();
        event.cost_m = cost_of(line);
        event.is_valid = line.front() == moved.start && line.back() == moved.goal &&
                         global_planning::are_turns_allowed(envelope, line);
        for (std::size_t i = 1; i < line.size(); ++i) {
          event.is_valid = event.is_valid && envelope.is_clear(line[i - 1], line[i]);
        }
        std::vector<Waypoint> polished = line;
        event.polished_m = event.cost_m;
        for (int i = 0; i < kPolishesMax; ++i) {
          std::int64_t work_units = 0;
          global_planning::refine(envelope, problem.work_budget, work_units, polished,
                                  [&](double, std::int64_t) { return observer.stop_requested(); });
          const double cost_m = cost_of(polished);
          const bool has_ended = !(cost_m < event.polished_m * (1.0 - kPolishGain));
          event.polished_m = std::min(event.polished_m, cost_m);
          if (has_ended) {
            break;
          }
        }
      }
      const double cold_from_s = clock();
      const auto cold = global_planning::plan_leg(costs, config.global, moved, {}, observer);
      event.cold_s = clock() - cold_from_s;
      const auto* cold_route = std::get_if<flight::Route>(&cold);
      event.cold_cost_m = cold_route != nullptr ? cold_route->cost.total_m() : kNaN;
    }
    costs.visibility_changed(window);  // as it was
    observer.check_stop();
    result.events.push_back(event);
    observer.progress("planning again", static_cast<double>(result.events.size()), total);
  };
  observer.progress("planning again", 0.0, total);
  try {
    for (std::size_t index = 0; index < problems.problems.size() &&
                                static_cast<std::int64_t>(result.events.size()) < options.events;
         ++index) {
      const global_planning::RouteProblem problem{end_at(problems.problems[index].start),
                                                  end_at(problems.problems[index].goal),
                                                  seed + index, config.global.work_budget};
      const auto found = global_planning::plan_leg(costs, config.global, problem, {}, observer);
      observer.check_stop();
      const auto* route = std::get_if<flight::Route>(&found);
      if (route == nullptr) {
        ++result.routes_not_found;
        continue;
      }
      const double before_s = clock();
      const global_planning::WarmPlanner planned(costs, config.global, problem, route->waypoints);
      result.prepare_s.push_back(clock() - before_s);
      result.blocks = static_cast<std::int64_t>(planned.field().block_count());
      for (std::int64_t k = 0; k < options.events_per_route &&
                               static_cast<std::int64_t>(result.events.size()) < options.events;
           ++k) {
        one_event(planned, problem, route->waypoints);
      }
    }
  } catch (const Interrupted&) {
    if (result.events.empty()) {
      throw;
    }
    result.is_stopped = true;
  }
  return result;
}

Spread spread_of(std::vector<double> values) {
  values.erase(
      std::remove_if(values.begin(), values.end(), [](double value) { return std::isnan(value); }),
      values.end());
  if (values.empty()) {
    return {kNaN, kNaN, kNaN};
  }
  return {median_of(values), quantile_of(values, 0.95), quantile_of(values, 1.0)};
}

std::string replanning_json(const ReplanningResult& result, const MachineRecord& machine) {
  using Json = nlohmann::ordered_json;
  const auto spread = [&](const auto& value) {
    std::vector<double> values;
    for (const ReplanningEvent& event : result.events) {
      values.push_back(value(event));
    }
    const Spread found = spread_of(values);
    return Json{{"median", found.median}, {"p95", found.p95}, {"max", found.max}};
  };
  const auto number = [&](const auto& is) {
    return std::count_if(result.events.begin(), result.events.end(), is);
  };
  const Spread prepared = spread_of(result.prepare_s);
  Json json;
  json["schema"] = "hedgehop evaluate replanning";
  json["schema_version"] = 1;
  json["map_hash"] = result.map_hash.hex();
  json["label"] = result.map_label;
  json["seed"] = result.seed;
  json["machine"] = machine_json(machine);
  json["is_stopped"] = result.is_stopped;
  json["events"] = result.events.size();
  json["routes_not_found"] = result.routes_not_found;
  json["valid"] = number([](const ReplanningEvent& event) { return event.is_valid; });
  json["planned_anew"] = number([](const ReplanningEvent& event) { return event.is_cold; });
  json["prepare_s"] = {{"median", prepared.median}, {"p95", prepared.p95}, {"max", prepared.max}};
  json["warm_s"] = spread([](const ReplanningEvent& event) { return event.warm_s; });
  json["cold_s"] = spread([](const ReplanningEvent& event) { return event.cold_s; });
  json["warm_over_cold_time"] =
      spread([](const ReplanningEvent& event) { return event.warm_s / event.cold_s; });
  json["cost_over_polished"] =
      spread([](const ReplanningEvent& event) { return event.cost_m / event.polished_m; });
  json["cost_over_cold"] =
      spread([](const ReplanningEvent& event) { return event.cost_m / event.cold_cost_m; });
  json["old_over_cost"] =
      spread([](const ReplanningEvent& event) { return event.old_cost_m / event.cost_m; });
  json["renewed_share_of_field"] = spread([&](const ReplanningEvent& event) {
    return static_cast<double>(event.blocks_renewed) / static_cast<double>(result.blocks);
  });
  json["rows"] = Json::array();
  for (const ReplanningEvent& event : result.events) {
    json["rows"].push_back({{"start", {{"x_m", event.start.x_m}, {"y_m", event.start.y_m}}},
                            {"goal", {{"x_m", event.goal.x_m}, {"y_m", event.goal.y_m}}},
                            {"threat",
                             {{"x_m", event.threat.x_m},
                              {"y_m", event.threat.y_m},
                              {"radius_m", event.threat_radius_m}}},
                            {"warm_s", event.warm_s},
                            {"cold_s", event.cold_s},
                            {"cost_m", event.cost_m},
                            {"claimed_cost_m", event.claimed_cost_m},
                            {"polished_m", event.polished_m},
                            {"cold_cost_m", event.cold_cost_m},
                            {"old_cost_m", event.old_cost_m},
                            {"blocks_renewed", event.blocks_renewed},
                            {"planned_anew", event.is_cold},
                            {"is_valid", event.is_valid}});
  }
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace hedgehop::evaluation
