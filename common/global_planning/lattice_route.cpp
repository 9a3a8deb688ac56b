#include "global_planning/lattice_route.hpp"

#include <array>

#include "global_planning/lattice_search.hpp"
#include "global_planning/track_profile.hpp"

namespace hedgehop::global_planning {
namespace {

constexpr double kProfileStep_m = 10.0;
// The second one only where the profile of the first track does not fit between its samples.
constexpr std::array<LatticeSpare, 2> kLatticeSpares = {{{2.0, 0.97}, {6.0, 0.85}}};

}  // namespace

std::vector<flight::Waypoint> lattice_route(const FlightEnvelope& envelope,
                                            const GlobalOptions& options, std::int64_t work_budget,
                                            std::int64_t& work_units,
                                            const std::function<bool()>& should_stop,
                                            const CostField* to_goal) {
  for (const LatticeSpare& spare : kLatticeSpares) {
    const LatticeResult found =
        search_lattice(envelope, options, spare, work_budget - work_units, should_stop, to_goal);
    work_units += found.work_units;
    if (found.track.empty()) {
      break;
    }
    if (auto waypoints = lowest_profile(envelope, found.track, kProfileStep_m);
        !waypoints.empty()) {
      return waypoints;
    }
  }
  return {};
}

}  // namespace hedgehop::global_planning
