#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "evaluation/drawn_routes.hpp"
#include "map/patch.hpp"
#include "planning/reaction.hpp"

namespace hedgehop::evaluation {

/// Section `reaction` of the evaluation config: what appears, each kind in turn.
struct ReactionEvaluationOptions {
  std::int64_t events = 0;
  std::int64_t events_per_route = 0;
  double distance_min_m = 0.0;  // along the plan, from the vehicle to the near edge
  double distance_max_m = 0.0;
  double obstacle_radius_max_m = 0.0;
  double obstacle_height_min_m = 0.0;  // above the ground
  double obstacle_height_max_m = 0.0;
  double area_side_max_m = 0.0;
  double threat_range_min_m = 0.0;
  double threat_range_max_m = 0.0;
};
ReactionEvaluationOptions read_reaction_evaluation_options(ConfigReader& reader);

/// Something that appeared on a flight.
struct ReactionEvent {
  std::int64_t problem = 0;
  map::PatchKind kind = map::PatchKind::kObstacle;
  double distance_m = 0.0;
  bool is_in_way = false;  // the plan ahead does not verify any more
  planning::ReactionKind reaction = planning::ReactionKind::kNone;
  bool is_safe = false;               // what is flown now verifies
  double clearance_min_m = 0.0;       // of that
  double heading_step_max_rad = 0.0;  // greatest change of the commanded heading between two steps
  double reaction_s = 0.0;            // from the patch to the first new command
};

struct ReactionResult {
  std::uint64_t seed = 0;
  bool is_stopped = false;  // by the observer; then events are those that were finished
  std::string map_hash;
  planning::ReactionOptions reaction;
  ReactionEvaluationOptions options;
  double heading_step_limit_rad = 0.0;
  std::vector<ReactionEvent> events;
};

/// What flights do about things that appear ahead of them. Plans are flown along drawn routes; at
/// drawn moments an obstacle that stands in the way, a no-fly area across it or an observer beside
/// it appears, and the flight reacts as the service command_model does.
///
/// @param clock_s  processor seconds of this thread, for reaction_s
/// @note  On one thread, so that times are those of a reaction alone. All but the times depends on
///        nothing but the arguments.
ReactionResult evaluate_reaction(const map::Map& map, const planning::PlanningConfig& config,
                                 const planning::ReactionOptions& reaction,
                                 const ReactionEvaluationOptions& options,
                                 const DrawnRoutes& routes, std::uint64_t seed,
                                 const std::function<double()>& clock_s, Observer& observer);

/// JSON, schema_version first.
std::string reaction_json(const ReactionResult& result);

}  // namespace hedgehop::evaluation
