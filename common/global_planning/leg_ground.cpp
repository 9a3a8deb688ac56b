#include "global_planning/leg_ground.hpp"

#include <algorithm>
#include <string>

#include "global_planning/corridor_refinement.hpp"
#include "global_planning/cost_bound.hpp"
#include "global_planning/lattice_route.hpp"
#include "global_planning/route_finish.hpp"

namespace hedgehop::global_planning {
namespace {

constexpr double kCostStep_m = 1.0;

}  // namespace

LegGround::LegGround(const risk::CostModel& costs, const GlobalOptions& options,
                     const RouteProblem& problem)
    : options_(options), problem_(problem), ground_(costs, options, problem.start, problem.goal) {}

std::variant<flight::Route, flight::NoPlan> LegGround::plan(const risk::CostModel& costs,
                                                            const std::vector<Avoidance>& avoided,
                                                            bool is_refined,
                                                            const Observer& observer) const {
  FlightEnvelope envelope(ground_, costs);
  envelope.continue_from(problem_.lead_in);
  for (const Avoidance& avoidance : avoided) {
    envelope.avoid(avoidance.route, avoidance.within_m, avoidance.cost);
  }
  const auto should_stop = [&observer] { return observer.stop_requested(); };
  flight::Route route;
  route.waypoints =
      lattice_route(envelope, options_, problem_.work_budget, route.work_units, should_stop);
  if (route.waypoints.empty()) {
    return flight::NoPlan{
        observer.stop_requested() ? flight::NoPlanCause::kStopped
                                  : flight::NoPlanCause::kBudgetExhausted,
        problem_.goal.point(),
        "the lattice search found no route with " + std::to_string(route.work_units) + " legs"};
  }
  if (is_refined) {
    refine(envelope, problem_.work_budget, route.work_units, route.waypoints,
           [&](double, std::int64_t) { return should_stop(); });
    cut_short(envelope, options_.final_check_step_m, problem_.work_budget, route.work_units,
              route.waypoints);
  }
  route.guide = equidistant(route.waypoints, options_.guide_spacing_m, route.guide_spacing_m);
  route.cost = costs.route_cost(route.waypoints, kCostStep_m);
  if (is_refined) {
    route.lower_bound_m = std::min(least_cost_m(envelope), route.cost.total_m());
  }
  return route;
}

}  // namespace hedgehop::global_planning
