#include "evaluation/reaction_evaluation.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "base/errors.hpp"
#include "command_model/planned_state.hpp"
#include "evaluation/flown_route.hpp"
#include "evaluation/paired_statistics.hpp"
#include "global_planning/random_source.hpp"
#include "preparation/map_patches.hpp"

namespace hedgehop::evaluation {
namespace {

constexpr double kRest_m = 500.0;  // of the plan beyond what appears

double between(global_planning::RandomSource& random, double low, double high) {
  return low + random.unit() * (high - low);
}

double heading_math_rad(double true_rad, const flight::FlightState& state) {
  return math_angle_from_azimuth_rad(grid_from_true_azimuth_rad(true_rad, state.convergence_rad));
}

double commanded_rad(const flight::FlightState& state) {
  return heading_math_rad(state.commanded_heading_true_rad, state);
}

std::vector<double> distances_m(const flight::Trajectory& trajectory) {
  std::vector<double> along_m{0.0};
  for (std::size_t i = 1; i < trajectory.states.size(); ++i) {
    const double dx_m = trajectory.states[i].x_m - trajectory.states[i - 1].x_m;
    const double dy_m = trajectory.states[i].y_m - trajectory.states[i - 1].y_m;
    along_m.push_back(along_m.back() + std::sqrt(dx_m * dx_m + dy_m * dy_m));
  }
  return along_m;
}

struct Drawn {
  std::size_t step = 0;
  double distance_m = 0.0;
  map::Patch patch;
};

Drawn draw(const flight::Trajectory& plan, const ReactionEvaluationOptions& options,
           map::PatchKind kind, global_planning::RandomSource& random) {
  const std::vector<double> along_m = distances_m(plan);
  Drawn drawn;
  drawn.distance_m = between(random, options.distance_min_m, options.distance_max_m);
  drawn.patch.id = 1;
  drawn.patch.kind = kind;
  double half_m = 0.0;
  switch (kind) {
    case map::PatchKind::kObstacle:
      half_m = between(random, 0.0, options.obstacle_radius_max_m);
      drawn.patch.height_m =
          between(random, options.obstacle_height_min_m, options.obstacle_height_max_m);
      break;
    case map::PatchKind::kArea:
      half_m = between(random, 0.1, 0.5) * options.area_side_max_m;
      break;
    case map::PatchKind::kThreat:
      break;
  }
  const double there_m = drawn.distance_m + half_m;
  const double last_m = along_m.back() - there_m - kRest_m;
  if (!(last_m > 0.0)) {
    throw DataError(
        "a plan of " + std::to_string(along_m.back()) + " m is too short for what appears on it",
        "ask for routes of greater distance");
  }
  const auto at = [&](double way_m) {
    return static_cast<std::size_t>(std::lower_bound(along_m.begin(), along_m.end(), way_m) -
                                    along_m.begin());
  };
  const double here_m = between(random, 0.0, last_m);
  drawn.step = at(here_m);
  const flight::FlightState& there = plan.states[at(here_m + there_m)];
  const double course_rad = heading_math_rad(there.heading_true_rad, there);
  const double east = elementary::cos(course_rad);
  const double north = elementary::sin(course_rad);
  const auto beside = [&](double ahead_m, double left_m) {
    return geo::MapPoint{there.x_m + ahead_m * east - left_m * north,
                         there.y_m + ahead_m * north + left_m * east};
  };
  const double left_m = between(random, -half_m, half_m);
  if (kind == map::PatchKind::kArea) {
    drawn.patch.floor.value_m = -1e5;
    drawn.patch.ceiling.value_m = 1e5;
    drawn.patch.outline = {beside(-half_m, left_m - half_m), beside(half_m, left_m - half_m),
                           beside(half_m, left_m + half_m), beside(-half_m, left_m + half_m)};
    return drawn;
  }
  drawn.patch.centre = beside(0.0, left_m);
  drawn.patch.radius_m = half_m;
  if (kind == map::PatchKind::kThreat) {
    drawn.patch.radius_m = between(random, options.threat_range_min_m, options.threat_range_max_m);
    drawn.patch.height_m = 5.0;
  }
  return drawn;
}

ReactionEvent event_of(const map::Map& map, const planning::PlanningConfig& calm,
                       const planning::ReactionOptions& options, const flight::Trajectory& plan,
                       const Drawn& drawn, const std::function<double()>& clock_s) {
  const planning::PlanningConfig config =
      planning::in_wind(calm, map.crs_wkt, plan.states.front().point());
  const flight::FlightState& here = plan.states[drawn.step];
  const planning::FlightUnderPlan flight{&plan, drawn.step,
                                         command_model::model_state_of(here, config.vehicle.wind),
                                         commanded_rad(here)};
  SilentObserver observer;
  ReactionEvent event;
  event.kind = drawn.patch.kind;
  event.distance_m = drawn.distance_m;
  const double before_s = clock_s();
  const map::Map ground = preparation::patched_map(
      planning::map_part(map, planning::window_of_reaction(map.geometry, options, flight)),
      {drawn.patch}, {0.0, 1}, observer);
  const planning::Reaction reaction = planning::reaction_to(
      ground, config, options, flight, drawn.patch.kind == map::PatchKind::kThreat);
  event.reaction_s = clock_s() - before_s;
  event.reaction = reaction.kind;
  event.is_in_way = !reaction.is_plan_verified;
  event.is_safe = reaction.verdict.is_verified;
  event.clearance_min_m = reaction.verdict.clearance_min_m;
  double before_rad = flight.commanded_heading_math_rad;
  for (const flight::FlightState& state : reaction.trajectory.states) {
    const double now_rad = commanded_rad(state);
    event.heading_step_max_rad =
        std::max(event.heading_step_max_rad, std::fabs(wrap_to_pi(now_rad - before_rad)));
    before_rad = now_rad;
  }
  return event;
}

}  // namespace

ReactionEvaluationOptions read_reaction_evaluation_options(ConfigReader& reader) {
  ReactionEvaluationOptions options;
  const auto count = [&](const char* key, std::int64_t& value) {
    value = reader.required_integer(key);
    reader.require(value >= 1 && value <= 100000, key, "must lie in 1 to 100000");
  };
  count("events", options.events);
  count("events_per_route", options.events_per_route);
  const auto length = [&](const char* key, double low, double high) {
    const double value = reader.required_double(key);
    reader.require(value >= low && value <= high, key, "is out of range");
    return value;
  };
  options.distance_min_m = length("distance_min_m", 0.0, 1e4);
  options.distance_max_m = length("distance_max_m", options.distance_min_m, 1e4);
  options.obstacle_radius_max_m = length("obstacle_radius_max_m", 0.0, 1e3);
  options.obstacle_height_min_m = length("obstacle_height_min_m", 0.0, 1e3);
  options.obstacle_height_max_m =
      length("obstacle_height_max_m", options.obstacle_height_min_m, 1e3);
  options.area_side_max_m = length("area_side_max_m", 1.0, 1e4);
  options.threat_range_min_m = length("threat_range_min_m", 1.0, 1e5);
  options.threat_range_max_m = length("threat_range_max_m", options.threat_range_min_m, 1e5);
  reader.finish();
  return options;
}

ReactionResult evaluate_reaction(const map::Map& map, const planning::PlanningConfig& config,
                                 const planning::ReactionOptions& reaction,
                                 const ReactionEvaluationOptions& options,
                                 const DrawnRoutes& routes, std::uint64_t seed,
                                 const std::function<double()>& clock_s, Observer& observer) {
  ReactionResult result;
  result.seed = seed;
  result.map_hash = map.hash.hex();
  result.reaction = reaction;
  result.options = options;
  result.heading_step_limit_rad = reaction.heading_rate_max_radps * config.local.step_s;
  const risk::CostModel costs = planning::cost_model(map, config);
  global_planning::RandomSource random(seed);
  try {
    for (const DrawnRoute& route : routes.routes) {
      const auto plan = flown(costs, config, route, observer);
      for (std::int64_t i = 0; i < options.events_per_route; ++i) {
        const auto done = static_cast<std::int64_t>(result.events.size());
        if (done == options.events) {
          return result;
        }
        observer.check_stop();
        observer.progress("reactions", static_cast<double>(done),
                          static_cast<double>(options.events));
        if (!plan || !plan->verdict.is_verified) {
          break;
        }
        const auto kind = static_cast<map::PatchKind>(done % 3);
        const Drawn drawn = draw(plan->trajectory, options, kind, random);
        if (!preparation::reason_against(map, drawn.patch).empty()) {
          continue;
        }
        result.events.push_back(event_of(map, config, reaction, plan->trajectory, drawn, clock_s));
        result.events.back().problem = route.problem;
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

std::string reaction_json(const ReactionResult& result) {
  using Json = nlohmann::ordered_json;
  const auto number = [](double value) { return std::isfinite(value) ? Json(value) : Json(); };
  Json json = {{"schema", "hedgehop evaluate reaction"},
               {"schema_version", 1},
               {"map_hash", result.map_hash},
               {"seed", result.seed},
               {"is_stopped", result.is_stopped},
               {"horizon_s", result.reaction.horizon_s},
               {"heading_step_limit_deg", degrees_from_radians(result.heading_step_limit_rad)},
               {"kinds", Json::array()},
               {"rows", Json::array()}};
  for (const auto kind :
       {map::PatchKind::kObstacle, map::PatchKind::kThreat, map::PatchKind::kArea}) {
    std::int64_t events = 0;
    std::int64_t in_way = 0;
    std::int64_t unsafe = 0;
    double clearance_m = std::numeric_limits<double>::quiet_NaN();
    double step_rad = 0.0;
    std::vector<double> times_s;
    Json reactions = {{"none", 0}, {"around", 0}, {"way_out", 0}, {"last_resort", 0}};
    for (const ReactionEvent& event : result.events) {
      if (event.kind != kind) {
        continue;
      }
      ++events;
      in_way += event.is_in_way ? 1 : 0;
      unsafe += event.is_safe ? 0 : 1;
      clearance_m = std::fmin(clearance_m, event.clearance_min_m);
      step_rad = std::max(step_rad, event.heading_step_max_rad);
      times_s.push_back(event.reaction_s);
      Json& count = reactions[planning::name_of(event.reaction)];
      count = count.get<std::int64_t>() + 1;
    }
    json["kinds"].push_back({{"kind", map::name_of(kind)},
                             {"events", events},
                             {"in_way", in_way},
                             {"unsafe", unsafe},
                             {"reactions", reactions},
                             {"min_clearance_m", number(clearance_m)},
                             {"heading_step_max_deg", degrees_from_radians(step_rad)},
                             {"reaction_ms_median", number(1e3 * median_of(times_s))},
                             {"reaction_ms_p95", number(1e3 * quantile_of(times_s, 0.95))},
                             {"reaction_ms_max", number(1e3 * quantile_of(times_s, 1.0))}});
  }
  for (const ReactionEvent& event : result.events) {
    json["rows"].push_back({{"problem", event.problem},
                            {"kind", map::name_of(event.kind)},
                            {"distance_m", event.distance_m},
                            {"in_way", event.is_in_way},
                            {"reaction", planning::name_of(event.reaction)},
                            {"safe", event.is_safe},
                            {"clearance_min_m", number(event.clearance_min_m)},
                            {"reaction_ms", 1e3 * event.reaction_s}});
  }
  return json.dump(2) + "\n";
}

}  // namespace hedgehop::evaluation
