#pragma once

#include <vector>

#include "flight/route.hpp"
#include "geo/map_projection.hpp"
#include "global_planning/flight_envelope.hpp"

namespace hedgehop::global_planning {

/// The lowest flight along a ground track from start to goal of the envelope, as straight legs.
///
/// Along the track the lowest altitude that keeps the band and both slope limits is the upper
/// envelope of cones: z(s) = max over q of (low(q) - tan(climb) (q - s)) for q ahead, and
/// (low(q) - tan(descent) (s - q)) for q behind. Corners of the
/// track become waypoints, and so do points between them where the profile bends;
/// FlightEnvelope::is_clear holds for each leg. Empty when no profile fits, which can be when the
/// track was searched with coarser samples. O(length / step_m).
std::vector<flight::Waypoint> lowest_profile(const FlightEnvelope& envelope,
                                             const std::vector<geo::MapPoint>& track,
                                             double step_m);

/// The same between two places of a flight: from `start_m` to `goal_m` [m AMSL].
std::vector<flight::Waypoint> lowest_profile(const FlightEnvelope& envelope,
                                             const std::vector<geo::MapPoint>& track,
                                             double start_m, double goal_m, double step_m);

/// The line that lowest_profile() follows: the lowest altitudes at places at most `step_m` apart.
/// What lies between them is not looked at, so it is no route, but costs about what one does.
std::vector<flight::Waypoint> lowest_line(const FlightEnvelope& envelope,
                                          const std::vector<geo::MapPoint>& track, double start_m,
                                          double goal_m, double step_m);

/// The lowest flight along a route's own ground track, if there is one that costs less than the
/// route. Empty otherwise. Costs are compared in steps of `compare_step_m`.
std::vector<flight::Waypoint> cheaper_profile(const FlightEnvelope& envelope,
                                              const std::vector<flight::Waypoint>& route,
                                              double step_m, double compare_step_m);

}  // namespace hedgehop::global_planning
