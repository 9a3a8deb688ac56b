#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "local_planning/guide.hpp"
#include "local_planning/local_planner.hpp"
#include "raster/grid.hpp"

namespace hedgehop::local_planning {

/// What an escape must keep, see escape_from().
struct EscapeOptions {
  double speed_mps = 0.0;         // commanded: slower climbs steeper and turns tighter
  double clearance_m = 0.0;       // kept above the surface
  double lateral_margin_m = 0.0;  // within this of the track
  double time_max_s = 0.0;        // until it is high enough
  HeadingCommand heading{};       // turns begin there
};

/// A way out: what is flown from the state on, until it is high enough to circle level.
struct Escape {
  double turn_left_rad = 0.0;  // commanded change of heading
  bool is_along_plan = false;  // climbs over the planned track or the guide instead
  std::vector<FlownStep> steps;
};

/// A safe continuation of a flight that cannot go on as planned: a climb-out or a climbing turn.
///
/// From the first of `ahead` the command model is flown with full climb, slowing down, straight on
/// and into turns of 30, 60, 90, 135 and 180 degrees to the left and right, in this order. The
/// first one counts that keeps the clearance all the way, as in highest_beside_m(), until it is
/// higher than everything within two turn radii and the margin by the clearance: from there it can
/// circle level for ever. The last try climbs with the planned headings and speeds: over the
/// planned track, and never lower than planned. That one also counts if it ends with the plan, at
/// its goal.
///
/// @param ahead   planned steps from the present one on, at least 2
/// @return  nothing if none keeps the clearance.
/// @note  A function of its arguments alone.
std::optional<Escape> escape_from(const raster::Grid<float>& surface_m,
                                  const command_model::CommandModel& model,
                                  const EscapeOptions& options, std::span<const FlownStep> ahead,
                                  double step_s);

/// Which ways out of a flight along a guide count.
enum class EscapeWays : std::uint8_t { kAlongGuide, kAny };

/// The same for a flight that is still being planned: the first try climbs along the guide, towards
/// the place on it that lies the way of 4 s ahead, at least 60 m; that one also counts if it
/// reaches the goal. Then straight on and the turns.
///
/// @param surface_m      as Surroundings has it: what must not be entered is a wall
/// @param from           present state
/// @param along_m        where it is along the guide
/// @param goal_radius_m  the goal is reached within this
/// @return  nothing if none keeps the clearance.
std::optional<Escape> escape_along(const raster::Grid<float>& surface_m,
                                   const command_model::CommandModel& model,
                                   const EscapeOptions& options, EscapeWays ways,
                                   const command_model::ModelState& from, const Guide& guide,
                                   double along_m, double goal_radius_m, double step_s);

/// Whether the straight piece of track between two steps keeps the clearance from `surface_m`, at
/// the lowest of the altitudes.
bool keeps_clearance(const raster::Grid<float>& surface_m, std::span<const FlownStep> steps,
                     double clearance_m, double lateral_margin_m);

}  // namespace hedgehop::local_planning
