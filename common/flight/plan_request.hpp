#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "geo/map_projection.hpp"

namespace hedgehop::flight {

/// A place to be at, with an optional height above the surface model; without one, the reference
/// height.
struct RequestPoint {
  geo::GeodeticPosition position;
  std::optional<double> height_m;
};

/// Lower or upper end of an area that a request names.
struct RequestAreaEnd {
  double value_m = 0.0;          // -infinity: from the ground on and below; +infinity: without end
  bool is_above_ground = false;  // else AMSL in the map's datum

  bool operator==(const RequestAreaEnd&) const = default;
};

/// A volume of this flight alone, beside those of the map: not to be entered (hard), or that costs
/// (soft). Rings are closed; edges are straight on the map.
struct RequestArea {
  using Ring = std::vector<geo::GeodeticPosition>;
  struct Polygon {
    Ring outer;
    std::vector<Ring> holes;
  };
  std::string name;
  std::string kind;  // as map::Area::kind
  bool is_hard = true;
  RequestAreaEnd floor;
  RequestAreaEnd ceiling;
  std::vector<Polygon> polygons;  // at least 1
};

/// What the user asks for. Everything else that shapes a plan stands in the map and the config.
struct PlanRequest {
  RequestPoint start;
  RequestPoint goal;
  std::vector<RequestPoint> via;                 // in this order
  std::optional<double> start_heading_true_rad;  // default: towards the first waypoint
  std::optional<double> speed_mps;               // default: config
  std::uint64_t seed = 1;
  std::int64_t work_budget = 0;  // work units of the global planner; 0: config
  /// Already part of the map that the request is planned on, as planning::map_with_areas() gives
  /// it, and of its hash.
  std::vector<RequestArea> areas = {};
};

/// Why there is no plan. Stable names, used in JSON, messages and statistics.
enum class NoPlanCause : std::uint8_t {
  kStartOutsideMap,
  kGoalOutsideMap,
  kStartUnknownTerrain,  // void cells at or around the place
  kGoalUnknownTerrain,
  kStartBelowEnvelope,  // inside terrain or closer to the surface than the envelope allows
  kGoalBelowEnvelope,
  kStartAboveEnvelope,
  kGoalAboveEnvelope,
  kGoalEqualsStart,
  kReferenceHeightMismatch,  // the map's visibility was computed for another height
  kSearchSpaceDisconnected,  // proved: no connection within the height envelope
  kBudgetExhausted,          // not found within the work budget: nothing is proved
  kLocalPlannerStuck,        // the command model could not reach the goal along the route
  kStopped,                  // cancelled before a first route was found
  kClimbLimit,               // proved: climb and turn limits hold every route near one end
  kStartInsideArea,          // a hard area holds the place at its altitude
  kGoalInsideArea,
};

/// "start_outside_map" and so on.
const char* name_of(NoPlanCause cause);

/// No plan is a value: a cause, a place and a sentence for the user.
struct NoPlan {
  NoPlanCause cause = NoPlanCause::kBudgetExhausted;
  std::optional<geo::MapPoint> place;
  std::string explanation;  // what, where, why and what to do
};

/// Whether a cause names a reason (true) or only says that nothing was found (false).
bool is_named_cause(NoPlanCause cause);

}  // namespace hedgehop::flight
