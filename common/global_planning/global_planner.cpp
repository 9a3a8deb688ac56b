#include "global_planning/global_planner.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <ompl/base/Planner.h>
#include <ompl/base/PlannerTerminationCondition.h>
#include <ompl/base/ProblemDefinition.h>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "global_planning/bit_star.hpp"
#include "global_planning/bit_star_search.hpp"
#include "global_planning/corridor_refinement.hpp"
#include "global_planning/cost_bound.hpp"
#include "global_planning/enclosure.hpp"
#include "global_planning/flight_envelope.hpp"
#include "global_planning/lattice_route.hpp"
#include "global_planning/reachability.hpp"
#include "global_planning/roadmap.hpp"
#include "global_planning/route_finish.hpp"

namespace hedgehop::global_planning {
namespace {

using flight::NoPlan;
using flight::NoPlanCause;

// The shortcut scan gets this share of the budget, but no more than a long route can use.
constexpr std::int64_t kShortcutShare = 20;
constexpr std::int64_t kShortcutWorkMax = 5000;
// A third of the budget is kept for the refinement, except by the lattice, which spends no more
// than it needs for its one route.
constexpr std::int64_t kRefineShare = 3;
constexpr double kCostStep_m = 1.0;  // of the cost that is reported
// BIT* after a lattice that found nothing: it seldom succeeds, and then soon.
constexpr std::int64_t kFallbackWork = 200000;

std::string text_of(double value) {
  std::ostringstream text;
  text.precision(1);
  text << std::fixed << value;
  return text.str();
}

struct EndNames {
  const char* name;
  NoPlanCause outside, unknown, below, above;
};
constexpr EndNames kStartNames = {
    "start", NoPlanCause::kStartOutsideMap, NoPlanCause::kStartUnknownTerrain,
    NoPlanCause::kStartBelowEnvelope, NoPlanCause::kStartAboveEnvelope};
constexpr EndNames kGoalNames = {"goal", NoPlanCause::kGoalOutsideMap,
                                 NoPlanCause::kGoalUnknownTerrain, NoPlanCause::kGoalBelowEnvelope,
                                 NoPlanCause::kGoalAboveEnvelope};

std::optional<NoPlan> fault_of(const flight::Waypoint& end, const EndNames& names,
                               const FlightEnvelope& envelope, const GlobalOptions& options) {
  const auto fault = [&](NoPlanCause cause, const std::string& why) {
    return NoPlan{cause, end.point(), std::string("the ") + names.name + " " + why};
  };
  if (!envelope.geometry().contains(end.point())) {
    return fault(names.outside, "lies outside the map; choose a place inside it");
  }
  const AltitudeBand band = envelope.band_at(end.point());
  if (std::isnan(band.low_m) || std::isnan(band.high_m)) {
    return fault(names.unknown, "has unknown ground or the edge of the map within " +
                                    text_of(options.lateral_margin_m) +
                                    " m; choose a place farther from it or add elevation data");
  }
  const double surface_m = band.high_m - options.envelope_ceiling_m;
  const double height_m = end.altitude_m - surface_m;
  if (height_m <= 0.0) {
    return fault(names.below,
                 "is " + text_of(-height_m) + " m below the surface; give it a height");
  }
  if (end.altitude_m > band.high_m) {
    return fault(names.above, "is " + text_of(height_m) + " m above the surface, higher than " +
                                  text_of(options.envelope_ceiling_m) +
                                  " m; lower it or raise global.envelope_ceiling_m");
  }
  if (!band.is_flyable()) {
    return fault(names.below,
                 "stands at a step of the surface that is higher than the envelope; move it");
  }
  return std::nullopt;
}

NoPlan no_plan_of(const Disconnection& gap, const GlobalOptions& options) {
  std::ostringstream why;
  if (gap.area != nullptr) {
    why << "no route exists: hard area '" << gap.area->name << "' ("
        << (gap.area->kind.empty() ? "no-fly" : gap.area->kind)
        << "), alone or with others, encloses the " << (gap.is_goal_enclosed ? "goal" : "start")
        << " at every altitude of the envelope; without areas there would be a way. The marked "
           "place is the reachable one nearest to the goal. Move the "
        << (gap.is_goal_enclosed ? "goal" : "start") << " or prepare the map without that area";
    return {NoPlanCause::kSearchSpaceDisconnected, gap.nearest_to_goal, why.str()};
  }
  why << "no route exists: from the start only " << gap.reachable_patches
      << " patches of one cell can be reached within the height envelope, and the goal is not "
         "among them; unknown ground or steps higher than the envelope is thick ("
      << text_of(options.envelope_ceiling_m - options.envelope_floor_m)
      << " m) lie between. The marked place is the reachable one nearest to the goal. Choose "
         "another "
      << (gap.is_goal_enclosed ? "goal" : "start") << ", or raise global.envelope_ceiling_m";
  return {NoPlanCause::kSearchSpaceDisconnected, gap.nearest_to_goal, why.str()};
}

// How far from an end, and with how many steps, it is tried to prove that nothing leaves it.
constexpr double kEnclosureReach_m = 5000.0;
constexpr std::int64_t kEnclosureWork = 60'000'000;  // about a second

std::string degrees_text(double tangent) {
  return text_of(degrees_from_radians(elementary::atan(tangent)));
}

// What the wind makes of a climb.
std::string in_wind_text(double tangent, const GlobalOptions& options) {
  const double wind_mps = options.wind.speed_mps();
  if (options.wind.is_calm()) {
    return "";
  }
  const double speed_mps = options.airspeed_mps;
  return " through the air, which at " + text_of(speed_mps) + " m/s in a wind of " +
         text_of(wind_mps) + " m/s are " +
         degrees_text(tangent * speed_mps / (speed_mps - wind_mps)) +
         " degrees over the ground against the wind and " +
         degrees_text(tangent * speed_mps / (speed_mps + wind_mps)) + " with it,";
}

// Why a search found nothing, if climb and turn limits hold every route near one end.
std::optional<NoPlan> prove_climb_limit(const FlightEnvelope& envelope,
                                        const GlobalOptions& options) {
  for (const bool is_goal : {true, false}) {
    const flight::Waypoint& end = is_goal ? envelope.goal() : envelope.start();
    const flight::Waypoint& other = is_goal ? envelope.start() : envelope.goal();
    const auto proof = [&](const GlobalOptions& limits) {
      return prove_enclosed(envelope, limits, end, other, kEnclosureReach_m, kEnclosureWork);
    };
    const auto enclosure = proof(options);
    if (!enclosure) {
      continue;
    }
    const SlopeLimits slopes = options.slopes();
    const SlopeLimits::Tangents here = slopes.in_wind({}, 0.0).at_most(end.altitude_m);
    GlobalOptions steeper = options;
    steeper.vehicle_slopes = nullptr;
    double needed_rad = elementary::atan(std::max(here.up, here.down));
    for (const double more_deg : {1.0, 2.0, 4.0, 8.0}) {
      const double more_rad = radians_from_degrees(more_deg);
      steeper.climb_angle_max_rad = elementary::atan(here.up) + more_rad;
      steeper.descent_angle_max_rad = elementary::atan(here.down) + more_rad;
      if (!proof(steeper)) {
        break;
      }
      needed_rad = std::max(steeper.climb_angle_max_rad, steeper.descent_angle_max_rad);
    }
    const std::string limits =
        degrees_text(here.up) +
        (here.up == here.down
             ? " degrees"
             : " and descents of at most " + degrees_text(here.down) + " degrees at its altitude") +
        in_wind_text(here.up, options);
    return NoPlan{
        NoPlanCause::kClimbLimit, end.point(),
        std::string("no route ") + (is_goal ? "reaches the goal" : "leaves the start") +
            ": with climbs of at most " + limits + " and turns of at least " +
            text_of(options.turns().least_m()) + " m radius between " +
            text_of(options.envelope_floor_m) + " and " + text_of(options.envelope_ceiling_m) +
            " m above this steep ground, nothing gets farther than " + text_of(enclosure->reach_m) +
            " m from it; it would take more than " + text_of(degrees_from_radians(needed_rad)) +
            (slopes.wind().is_calm() ? " degrees" : " degrees through the air") +
            ". Choose another " + (is_goal ? "goal" : "start") +
            ", raise global.envelope_ceiling_m, or fly slower" +
            (slopes.has_table() ? " or lighter" : "")};
  }
  return std::nullopt;
}

}  // namespace

SlopeLimits GlobalOptions::slopes() const {
  const SlopeLimits in_air = vehicle_slopes != nullptr
                                 ? *vehicle_slopes
                                 : SlopeLimits(elementary::tan(climb_angle_max_rad),
                                               elementary::tan(descent_angle_max_rad));
  return in_air.in_wind(wind, airspeed_mps);
}

GlobalOptions read_global_options(ConfigReader& reader) {
  GlobalOptions options;
  const auto positive = [&](const char* key, double& value) {
    value = reader.required_double(key);
    reader.require(value > 0.0 && std::isfinite(value), key, "must be above 0");
  };
  const auto not_negative = [&](const char* key, double& value) {
    value = reader.required_double(key);
    reader.require(value >= 0.0 && std::isfinite(value), key, "must not be negative");
  };
  positive("envelope_floor_m", options.envelope_floor_m);
  positive("envelope_ceiling_m", options.envelope_ceiling_m);
  reader.require(options.envelope_ceiling_m > options.envelope_floor_m, "envelope_ceiling_m",
                 "must be above envelope_floor_m");
  not_negative("lateral_margin_m", options.lateral_margin_m);
  options.climb_angle_max_rad = reader.required_angle("climb_angle_max_deg");
  reader.require(options.climb_angle_max_rad > 0.0 && options.climb_angle_max_rad < 1.0,
                 "climb_angle_max_deg", "must lie between 0 and 57");
  options.descent_angle_max_rad = reader.required_angle("descent_angle_max_deg");
  reader.require(options.descent_angle_max_rad > 0.0 && options.descent_angle_max_rad < 1.0,
                 "descent_angle_max_deg", "must lie between 0 and 57");
  options.turn_angle_max_rad = reader.required_angle("turn_angle_max_deg");
  reader.require(options.turn_angle_max_rad > 0.0 && options.turn_angle_max_rad < 3.1416,
                 "turn_angle_max_deg", "must lie between 0 and 180");
  not_negative("turn_radius_m", options.turn_radius_m);
  positive("end_funnel_m", options.end_funnel_m);
  positive("check_step_m", options.check_step_m);
  positive("final_check_step_m", options.final_check_step_m);
  reader.require(options.final_check_step_m <= options.check_step_m, "final_check_step_m",
                 "must not be above check_step_m");
  positive("guide_spacing_m", options.guide_spacing_m);
  options.batch_size = reader.required_integer("batch_size");
  reader.require(options.batch_size >= 1 && options.batch_size <= 1000000, "batch_size",
                 "must lie between 1 and 1000000");
  positive("radius_factor", options.radius_factor);
  positive("radius_max_m", options.radius_max_m);
  reader.require(options.radius_max_m >= options.check_step_m, "radius_max_m",
                 "must not be below check_step_m");
  const auto word = [&](const char* key, std::initializer_list<const char*> words) {
    const std::string value = reader.required_string(key);
    const auto found = std::find(words.begin(), words.end(), value);
    std::string all;
    for (const char* each : words) {
      all += (all.empty() ? "" : ", ") + std::string(each);
    }
    reader.require(found != words.end(), key, "must be one of " + all);
    return found - words.begin();
  };
  options.heuristic = static_cast<SearchHeuristic>(word("heuristic", {"length", "cost_field"}));
  options.sampler = static_cast<SamplingRegion>(word("sampler", {"ellipse", "level_set"}));
  options.turn_rule =
      static_cast<TurnRule>(word("turn_rule", {"none", "insertion", "heading_labels"}));
  const std::string planner = reader.required_string("planner");
  reader.require(planner == "lattice" || planner == "bit_star" || planner == "roadmap", "planner",
                 "must be lattice, bit_star or roadmap");
  options.use_lattice = planner != "bit_star";
  options.use_roadmap = planner == "roadmap";
  options.refine = reader.required_bool("refine");
  positive("field_block_m", options.field_block_m);
  options.work_budget = reader.required_integer("work_budget");
  reader.require(options.work_budget >= 1, "work_budget", "must be at least 1");
  reader.finish();
  return options;
}

std::variant<flight::Route, NoPlan> plan_leg(const risk::CostModel& costs,
                                             const GlobalOptions& options,
                                             const RouteProblem& problem,
                                             const OnProgress& on_progress,
                                             const Observer& observer) {
  FlightEnvelope envelope(costs, options, problem.start, problem.goal);
  envelope.continue_from(problem.lead_in);
  if (auto fault = fault_of(problem.start, kStartNames, envelope, options)) {
    return *fault;
  }
  if (auto fault = fault_of(problem.goal, kGoalNames, envelope, options)) {
    return *fault;
  }
  if (problem.start.x_m == problem.goal.x_m && problem.start.y_m == problem.goal.y_m) {
    return NoPlan{NoPlanCause::kGoalEqualsStart, problem.goal.point(),
                  "start and goal are the same place; choose another goal"};
  }
  if (observer.stop_requested()) {
    return NoPlan{NoPlanCause::kStopped, std::nullopt, "stopped before the search began"};
  }
  if (const auto gap = prove_disconnected(envelope)) {
    return no_plan_of(*gap, options);
  }

  const std::int64_t budget = problem.work_budget;
  const std::int64_t shortcut_budget = std::min(budget / kShortcutShare, kShortcutWorkMax);
  const std::int64_t search_budget = budget - shortcut_budget;
  const auto should_stop = [&observer] { return observer.stop_requested(); };
  flight::Route route;
  // Each metre costs at least 1; rounding of long sums must not exceed the straight leg.
  double lower_bound_m = flight::length_m({problem.start, problem.goal}) * (1.0 - 1e-9);

  const std::int64_t refine_budget = options.refine ? search_budget / kRefineShare : 0;
  const auto tell = [&](double best_cost_m) {
    if (on_progress) {
      on_progress(RouteProgress{route.work_units, budget, best_cost_m, lower_bound_m,
                                route.waypoints.empty() ? nullptr : &route.waypoints});
    }
  };
  tell(std::numeric_limits<double>::infinity());
  if (options.use_roadmap && problem.roadmap != nullptr) {
    route.waypoints =
        roadmap_route(envelope, *problem.roadmap, search_budget, route.work_units, should_stop);
  }
  if (options.use_lattice && route.waypoints.empty()) {
    route.waypoints =
        lattice_route(envelope, options, search_budget, route.work_units, should_stop);
  }
  if (route.waypoints.empty()) {
    const std::int64_t spent = route.work_units;
    const auto tell_of = [&](const BitStarSearch& search) {
      if (on_progress) {
        on_progress(RouteProgress{spent + search.counts().work_units, budget, search.best_cost_m(),
                                  search.lower_bound_m(),
                                  search.has_route() ? &search.best_route() : nullptr});
      }
    };
    const auto space = make_space_information(envelope, options.check_step_m);
    const auto planner =
        make_bit_star(space, envelope, options, problem.seed,
                      {std::clamp<std::int64_t>(search_budget - refine_budget - spent, 0,
                                                options.use_lattice ? kFallbackWork : budget),
                       tell_of});
    planner->setProblemDefinition(make_problem(space, envelope));
    planner->setup();
    planner->solve(ompl::base::PlannerTerminationCondition(should_stop));
    const BitStarSearch* search = search_of(*planner);
    HEDGEHOP_ASSERT(search != nullptr);
    const SearchCounts counts = search->counts();
    route.work_units += counts.work_units;
    route.samples = counts.samples;
    route.batches = counts.batches;
    lower_bound_m = search->lower_bound_m();
    if (!search->has_route()) {
      if (observer.stop_requested()) {
        return NoPlan{NoPlanCause::kStopped, std::nullopt,
                      "stopped before a first route was found, after " +
                          std::to_string(route.work_units) + " edge evaluations"};
      }
      if (auto proof = prove_climb_limit(envelope, options)) {
        return *std::move(proof);
      }
      return NoPlan{NoPlanCause::kBudgetExhausted, problem.goal.point(),
                    "no route was found with " + std::to_string(route.work_units) +
                        " edge evaluations and " + std::to_string(counts.samples) +
                        " states, which proves nothing; give more work (global.work_budget), "
                        "raise global.envelope_ceiling_m or move start or goal to more open "
                        "ground"};
    }
    route.waypoints = search->best_route();
  }

  tell(costs.route_cost(route.waypoints, kCostStep_m).total_m());
  if (options.refine) {
    refine(envelope, search_budget, route.work_units, route.waypoints,
           [&](double best_cost_m, std::int64_t) {
             tell(best_cost_m);
             return observer.stop_requested();
           });
  }
  lower_bound_m = std::max(lower_bound_m, least_cost_m(envelope));
  cut_short(envelope, options.final_check_step_m, budget, route.work_units, route.waypoints);
  route.guide = equidistant(route.waypoints, options.guide_spacing_m, route.guide_spacing_m);
  route.cost = costs.route_cost(route.waypoints, kCostStep_m);
  route.lower_bound_m = std::min(lower_bound_m, route.cost.total_m());
  tell(route.cost.total_m());
  return route;
}

}  // namespace hedgehop::global_planning
