#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "flight/route.hpp"
#include "global_planning/cost_field.hpp"
#include "global_planning/flight_envelope.hpp"
#include "global_planning/global_planner.hpp"

namespace hedgehop::global_planning {

/// A first route: the ground track that search_lattice() finds, flown at lowest_profile(). Where no
/// profile fits between the samples of the track, it is searched again with more to spare.
///
/// Adds what was spent to `work_units`, which does not exceed `work_budget` by more than the legs
/// of one corner. Empty if no route was found. `to_goal` as for search_lattice().
std::vector<flight::Waypoint> lattice_route(const FlightEnvelope& envelope,
                                            const GlobalOptions& options, std::int64_t work_budget,
                                            std::int64_t& work_units,
                                            const std::function<bool()>& should_stop,
                                            const CostField* to_goal = nullptr);

}  // namespace hedgehop::global_planning
