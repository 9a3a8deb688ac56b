#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/hash.hpp"
#include "base/time.hpp"
#include "flight/plan_request.hpp"
#include "flight/route.hpp"
#include "flight/trajectory.hpp"
#include "flight/verdict.hpp"

namespace hedgehop::flight {

/// Which map a plan was made on, and what its products must carry.
struct MapIdentity {
  Hash128 hash;
  std::int64_t patch_number = 0;  // of patches over a base map, in `hash` too; 0: none
  std::string crs_wkt;
  std::string vertical_datum;
  std::string label;
  std::vector<std::string> attributions;
};

/// The global planner's answer, complete enough for the local planner to go on from it alone.
struct RoutePlan {
  Hash128 request_id;  // plan_request_id()
  PlanRequest request;
  std::string config_text;  // effective planning config, canonical YAML
  MapIdentity map;
  Waypoint start;  // the request's places in the map frame
  Waypoint goal;
  Route route;
};

/// When a flight passes its places.
struct Timetable {
  struct Entry {
    std::size_t place = 0;       // 0: start, 1 and on: via points, the last one: goal
    Time expected;               // when the trajectory is nearest to it
    std::optional<Time> wanted;  // as the request states it
  };
  double tolerance_s = 0.0;    // what a wanted time may be missed by
  std::vector<Entry> entries;  // all places in their order; the first one is the departure

  /// Greatest difference between expected and wanted; 0 without wanted times.
  [[nodiscard]] double greatest_error_s() const;
};

/// A finished plan: everything that plan.json, route.geojson and trajectory.csv say.
struct Plan {
  RoutePlan route_plan;
  Trajectory trajectory;
  PathMeasures measures;
  std::int64_t decisions = 0;  // of the local planner, all passes
  std::int64_t infeasible_decisions = 0;
  Verdict verdict;
  std::optional<Timetable> timetable;  // of a flight with times of day
  std::vector<std::string> warnings;
};

/// Identity of a plan: hash of map, request, config and seed. The same question has the same id, on
/// the bus and off it.
Hash128 plan_request_id(const PlanRequest& request, const Hash128& map_hash,
                        const std::string& config_text);

}  // namespace hedgehop::flight
