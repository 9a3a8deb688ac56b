#pragma once

#include <cstdint>
#include <functional>
#include <memory>

#include "global_planning/bit_star_search.hpp"
#include "global_planning/flight_envelope.hpp"

namespace ompl::base {
class Planner;
class ProblemDefinition;
class SpaceInformation;
}  // namespace ompl::base

/// The search as a planner of the Open Motion Planning Library, so that its problem definitions,
/// termination conditions, SimpleSetup and Benchmark work with it and its own planners run on the
/// same problem. The library's types are only named here.
namespace hedgehop::global_planning {

/// The state space (x, y, altitude) [m] over the map, with the envelope as state and motion
/// validity. The envelope must outlive it.
std::shared_ptr<ompl::base::SpaceInformation> make_space_information(const FlightEnvelope& envelope,
                                                                     double check_step_m);

/// From the envelope's start to its goal at the least cost by eq. (1).
std::shared_ptr<ompl::base::ProblemDefinition> make_problem(
    const std::shared_ptr<ompl::base::SpaceInformation>& space, const FlightEnvelope& envelope);

/// What a caller of a BitStar planner may hear and limit.
struct BitStarHooks {
  std::int64_t work_budget = 0;                        // edge evaluations over all solve() calls
  std::function<void(const BitStarSearch&)> on_event;  // may be empty
};

/// A planner `BIT*` with the name "hedgehop BIT*". It plans in the envelope, whose start and goal
/// must be those of the problem definition: solve() returns INVALID_START or INVALID_GOAL
/// otherwise. solve() may be called again to go on. The envelope must outlive the planner.
/// Parameters of the library, until the first solve(): heuristic (length, cost_field), sampler
/// (ellipse, level_set), turn_rule (none, insertion, heading_labels) and batch_size.
std::shared_ptr<ompl::base::Planner> make_bit_star(
    const std::shared_ptr<ompl::base::SpaceInformation>& space, const FlightEnvelope& envelope,
    const GlobalOptions& options, std::uint64_t seed, BitStarHooks hooks);

/// The search behind a planner of make_bit_star(); null before its first solve().
/// Throws std::invalid_argument for any other planner.
const BitStarSearch* search_of(const ompl::base::Planner& planner);

}  // namespace hedgehop::global_planning
