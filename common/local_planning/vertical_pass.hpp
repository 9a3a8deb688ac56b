#pragma once

#include <optional>
#include <vector>

#include "local_planning/local_planner.hpp"
#include "raster/grid.hpp"

namespace hedgehop::local_planning {

/// The same flight, lower: the same ground track in the same time, with the lowest altitudes that
/// keep the clearance and what the vehicle can do.
///
/// The floor below a piece of the track is the greatest height of the interpolated surface within
/// `lateral_margin_m` of it, plus `clearance_m`: heights of cell centres in the strip, and of
/// points on its middle line and its two edges, for between cell centres the surface has no peak.
/// Over unknown ground the floor is the altitude that was flown. Above that floor
/// lowest_profile() finds the altitudes with the least mean over the way; nothing lower clears the
/// ground, so the height ceiling is held where that is possible. At its nearest step to each place
/// that is `held`, the goal for example, the flight stays as high as that place, as far as the
/// given flight came up to it.
///
/// The command model is then flown again with the given commands of heading and speed; the command
/// of the climb rate is what its heave loop needs to make the next rate of that profile, by the
/// inverse of the loop, and pulls back to the profile where limits kept it from it. So the states
/// obey the model as before.
///
/// @param surface_m    the one to clear
/// @param flight       at least 2 steps
/// @param step_model   empty: the command model is stepped in process
/// @return  nothing if there is no such flight: the start is too low and too slow to climb, or the
///          step model did not follow by more than kFollowed_m.
/// @note  O(steps). A function of its arguments alone, as far as `step_model` is one.
std::optional<Flight> lowered_flight(const raster::Grid<float>& surface_m,
                                     const command_model::CommandModel& model,
                                     const VerticalPassOptions& options, const Flight& flight,
                                     const std::vector<flight::Waypoint>& held,
                                     const StepModel& step_model);

/// Greatest height of the interpolated surface within `margin_m` beside a straight piece of track;
/// NaN if a void or the outside of the grid is found there.
double highest_beside_m(const raster::Grid<float>& surface_m, const geo::MapPoint& from,
                        const geo::MapPoint& to, double margin_m);

/// How far the flown altitudes may stray from the profile.
inline constexpr double kFollowed_m = 0.5;

}  // namespace hedgehop::local_planning
