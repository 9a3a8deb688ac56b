#pragma once

#include <cstddef>
#include <cstdint>

#include "planning/planning.hpp"
#include "raster/window.hpp"

namespace hedgehop::planning {

struct ReactionOptions {
  double horizon_s = 0.0;               // of the plan ahead that is looked at and flown again
  double heading_rate_max_radps = 0.0;  // of the commanded heading
};

/// A flight along a trajectory, at the moment when something appears.
struct FlightUnderPlan {
  const flight::Trajectory* plan = nullptr;
  std::size_t step = 0;             // of the plan, where the vehicle is
  command_model::ModelState state;  // through the air
  double commanded_heading_math_rad = 0.0;
};

enum class ReactionKind : std::uint8_t {
  kNone,       // the plan ahead may be flown as it is
  kAround,     // along the plan, around what has appeared
  kWayOut,     // a climb-out or a climbing turn
  kLastResort  // nothing keeps the clearance; this keeps most of it
};
/// "none", "around", "way_out", "last_resort".
const char* name_of(ReactionKind kind);

struct Reaction {
  ReactionKind kind = ReactionKind::kNone;
  bool is_plan_verified = false;  // the plan ahead, on the changed ground
  flight::Trajectory trajectory;  // from the present state on; empty for kNone
  std::size_t way_out_step = 0;   // where it leaves the plan for good; one past the end: never
  flight::Verdict verdict;        // of `trajectory`; of the plan ahead for kNone
};

/// The part of a map that a reaction looks at: the plan ahead and 1.5 km around it.
raster::Window window_of_reaction(const raster::GridGeometry& geometry,
                                  const ReactionOptions& options, const FlightUnderPlan& flight);

/// A window of a map with the features that reach into it; its hash is not made.
map::Map map_part(const map::Map& map, const raster::Window& window);

/// What a flight does at once about something that appears ahead, before anybody plans again.
///
/// Nothing, if the plan ahead verifies on the changed ground and, for something that `is_seen_from`
/// (a threat), costs at most 2 % more than what could be flown instead. Else the local planner's
/// rollouts fly along the plan from the present state, as low as the vertical pass makes it where
/// that verifies; at the end of the horizon, if that is not the plan's, the vehicle climbs out and
/// circles for kCircling_s, which gives whoever plans again the time for it. If that does not
/// verify, a way out is taken at once; see local_planning::escape_from(). The commanded heading
/// goes on from the one commanded before and never changes faster than the limit.
///
/// @param ground  changed, at least the window of the reaction; features of it are looked at
/// @param config  that of the plan, in_wind() of its start
/// @note  A function of its arguments alone. 10 to 20 ms for 60 s of flight over 30 m cells.
Reaction reaction_to(const map::Map& ground, const PlanningConfig& config,
                     const ReactionOptions& options, const FlightUnderPlan& flight,
                     bool is_seen_from);

/// What is flown from a state on if the plan ends there: a way out, see
/// local_planning::escape_from(), or the last resort. `ground` and `config` as above.
Reaction way_out_from(const map::Map& ground, const PlanningConfig& config,
                      const ReactionOptions& options, const FlightUnderPlan& flight);

inline constexpr double kCircling_s = 90.0;

}  // namespace hedgehop::planning
