#pragma once

#include <variant>
#include <vector>

#include "base/observer.hpp"
#include "flight/plan_request.hpp"
#include "flight/route.hpp"
#include "global_planning/flight_envelope.hpp"
#include "global_planning/global_planner.hpp"
#include "risk/cost_model.hpp"

namespace hedgehop::global_planning {

/// A route that a search shall keep away from.
struct Avoidance {
  std::vector<flight::Waypoint> route;
  double within_m = 0.0;
  double cost = 0.0;  // of a metre that near to it, beside eq. (1)
};

/// One leg that is planned again and again under other costs: heights, limits and areas of the
/// envelope are computed once; the field that leads the search, the search and the refinement
/// depend on the costs and are done each time.
class LegGround {
 public:
  /// `problem` must be one that plan_leg() solves; what `costs` belong to must outlive this.
  LegGround(const risk::CostModel& costs, const GlobalOptions& options,
            const RouteProblem& problem);

  /// As plan_leg() by lattice search, without BIT*: a lattice without a route is the answer. Cost
  /// and lower bound of the route are those of `costs` alone; its search feels `avoided` too.
  /// `costs` must be a model of the same map.
  /// @param is_refined  false: the first route, about a fifth of the time, without lower bound.
  [[nodiscard]] std::variant<flight::Route, flight::NoPlan> plan(
      const risk::CostModel& costs, const std::vector<Avoidance>& avoided, bool is_refined,
      const Observer& observer) const;

 private:
  GlobalOptions options_;
  RouteProblem problem_;
  FlightEnvelope ground_;
};

}  // namespace hedgehop::global_planning
