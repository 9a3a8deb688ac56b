#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/config_reader.hpp"
#include "base/observer.hpp"
#include "evaluation/optimality_evaluation.hpp"
#include "evaluation/problem_drawing.hpp"
#include "flight/route.hpp"
#include "map/map.hpp"
#include "planning/planning.hpp"

namespace hedgehop::evaluation {

/// Section `replanning` of the evaluation config.
struct ReplanningOptions {
  std::int64_t events = 0;
  std::int64_t events_per_route = 0;
  DrawingRules drawing;
  double flown_min = 0.0;  // share of the route that lies behind the aircraft
  double flown_max = 0.0;
  double threat_at_min = 0.0;  // where the threat appears, as a share of the route
  double threat_at_max = 0.0;
  double threat_radius_min_m = 0.0;
  double threat_radius_max_m = 0.0;
  double threat_visibility = 0.0;  // inside its disc at least
};
ReplanningOptions read_replanning_options(ConfigReader& reader);

/// A threat that appears on a route while it is flown.
struct ReplanningEvent {
  flight::Waypoint start;
  flight::Waypoint goal;
  geo::MapPoint threat;
  double threat_radius_m = 0.0;
  double warm_s = 0.0;  // processor time: layer, field and route
  double cold_s = 0.0;  // of planning the same anew
  double cost_m = 0.0;  // of the warm route, eq. (1) at steps of 1 m
  double claimed_cost_m = 0.0;
  double polished_m = 0.0;   // the least that refining it reaches
  double cold_cost_m = 0.0;  // NaN: no route
  double old_cost_m = 0.0;   // of flying on as before
  std::int64_t blocks_renewed = 0;
  bool is_cold = false;   // the warm planner had to plan anew
  bool is_valid = false;  // every leg clear, every turn allowed, on a fresh envelope
};

struct ReplanningResult {
  std::uint64_t seed = 0;
  Hash128 map_hash;
  std::string map_label;
  ReplanningOptions options;
  std::int64_t blocks = 0;            // of the whole field
  std::int64_t routes_not_found = 0;  // drawn problems without a first route
  bool is_stopped = false;
  std::vector<double> prepare_s;  // processor time of each route's warm planner, before events
  std::vector<ReplanningEvent> events;
};

/// Plans drawn problems, then each several times again: the aircraft has flown part of the route,
/// and a threat appears on what lies ahead.
///
/// One thread. What the warm planner works out beforehand, while the old route is flown, counts by
/// itself. The warm time begins when the map's layer has changed and ends with the route; the
/// cold one is that of plan_leg() with a cost model that is ready. Polished is what refine() makes
/// of the warm route in the end, so it has the same course. Throws DataError if the map is too
/// small, Interrupted if the observer says so before the first event is done.
ReplanningResult evaluate_replanning(const map::Map& map, const planning::PlanningConfig& config,
                                     const ReplanningOptions& options, std::uint64_t seed,
                                     const ProcessClock& clock, Observer& observer);

/// Median, 95th percentile and greatest value of a list; NaN without values.
struct Spread {
  double median = 0.0;
  double p95 = 0.0;
  double max = 0.0;
};
Spread spread_of(std::vector<double> values);

std::string replanning_json(const ReplanningResult& result, const MachineRecord& machine);

}  // namespace hedgehop::evaluation
