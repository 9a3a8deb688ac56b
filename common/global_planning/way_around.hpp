#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "flight/route.hpp"
#include "geo/map_projection.hpp"
#include "global_planning/flight_envelope.hpp"
#include "global_planning/ways_to_goal.hpp"

namespace hedgehop::global_planning {

/// The corners of a route, from the start of the envelope to its goal, and what is known of it.
struct WayAroundQuestion {
  std::vector<flight::Waypoint> corners;
  std::vector<double> cost_m;  // from the start to each of them
  std::size_t leaves = 1;      // it may be left at the first so many corners
  std::size_t joins_from = 1;  // and joined again at this corner and those after it
  /// Whether costs along a leg may be others than when the ways to the goal were worked out.
  std::function<bool(const geo::MapPoint& a, const geo::MapPoint& b)> is_changed;
  /// About how much dearer than then it is to come from a place to the goal [m].
  std::function<double(const geo::MapPoint& at)> dearer_m;
};

/// A way beside a route.
struct WayAround {
  std::vector<geo::MapPoint> track;  // from the corner that it leaves to the one that it joins
  std::size_t leave = 0;
  std::size_t join = 0;
};

/// Looks for cheap ways beside a route and calls `accept` with each of at most four, the best ones
/// first, until it returns true.
///
/// A* with altitudes as intervals, as search_lattice() does, on the lattice of `ways`, from corners
/// of the route that lie apart. Ahead of it, it has what the ways say: an arrival from which none
/// of them goes on is dropped, and the others count as what the cheapest costs, and what has become
/// dearer where that leads through a change. An arrival that meets a way through nothing changed is
/// a whole route. Such a route follows the way until joining the old one is cheaper. About 1 us for
/// each of `work_budget` legs. Deterministic.
void find_ways_around(const FlightEnvelope& envelope, const WaysToGoal& ways,
                      const WayAroundQuestion& question, std::int64_t work_budget,
                      const std::function<bool()>& should_stop,
                      const std::function<bool(const WayAround&)>& accept);

}  // namespace hedgehop::global_planning
