#pragma once

#include <variant>
#include <vector>

#include "base/observer.hpp"
#include "flight/plan_request.hpp"
#include "flight/route.hpp"
#include "global_planning/cost_field.hpp"
#include "global_planning/flight_envelope.hpp"
#include "global_planning/global_planner.hpp"
#include "global_planning/route_line.hpp"
#include "raster/grid.hpp"
#include "raster/window.hpp"
#include "risk/cost_model.hpp"

namespace hedgehop::global_planning {

/// A route as it was planned again.
struct WarmRoute {
  flight::Route route;             // its lower bound is the straight line
  bool is_cold = false;            // nothing of what was known led to it: plan_leg() did
  std::size_t blocks_renewed = 0;  // of the cost field
};

/// Plans a leg again and again while its start moves along and what is seen changes, from what is
/// known: heights and areas stay, the field of costs to the goal is repaired where it must be
/// (CostField::repair), and so is the route.
///
/// Blocks of the field are twice as large as those that lead plan_leg(): it only shows the way.
/// find_detour() tells from the repaired field where a better way leaves the old route and where it
/// joins it again; the lattice is searched between these two places alone, forward and, where that
/// finds nothing, backward. What is found, with some of the old route before and after it, is moved
/// sideways by low_corridor_track() from coarse to fine; then the whole ground track is flown at
/// its lowest_profile(). Turns where old and new meet are looked at like all others. If the start
/// lies on the old route and that is still the cheaper one, it stays. Where no part is found, the
/// lattice is searched from the start to the goal with the repaired field ahead; where that too
/// finds nothing, plan_leg() plans anew.
///
/// Deterministic; the same for any number of threads.
class WarmPlanner {
 public:
  /// `route` leads from the start to the goal of `problem` and is what plan_leg() or the like found
  /// under `costs`, which must outlive this.
  WarmPlanner(const risk::CostModel& costs, const GlobalOptions& options,
              const RouteProblem& problem, std::vector<flight::Waypoint> route);

  /// Cells whose costs have become other ones (risk::CostModel::visibility_changed()).
  void costs_changed(const raster::Window& cells);

  /// The route from another start, which then is the one to begin with next time.
  std::variant<WarmRoute, flight::NoPlan> replan(const flight::Waypoint& start,
                                                 const Observer& observer);

  [[nodiscard]] const CostField& field() const { return field_; }

 private:
  [[nodiscard]] std::vector<flight::Waypoint> repaired(const flight::Waypoint& start,
                                                       const Observer& observer) const;
  // The rest of the old route from here on, but for corners that are too near to turn at.
  [[nodiscard]] std::vector<flight::Waypoint> from_start(const RouteLine& old,
                                                         double along_m) const;
  // A line from start to goal, that between two of its waypoints replaced by a part of a lattice.
  [[nodiscard]] std::vector<flight::Waypoint> around(const std::vector<flight::Waypoint>& line,
                                                     std::size_t leave, std::size_t join,
                                                     double aside_m,
                                                     const Observer& observer) const;
  [[nodiscard]] std::vector<flight::Waypoint> searched(const Observer& observer) const;
  [[nodiscard]] bool is_lawful(const std::vector<flight::Waypoint>& route) const;
  // Moves what lies between two waypoints of a route sideways and flies all of it low.
  void improve(std::vector<flight::Waypoint>& route, const flight::Waypoint& from,
               const flight::Waypoint& to) const;
  // What routes cost for a metre of the field.
  void judge_field();
  [[nodiscard]] bool is_changed(const geo::MapPoint& point) const;

  GlobalOptions options_;
  RouteProblem problem_;
  FlightEnvelope envelope_;
  CostField field_;
  std::vector<flight::Waypoint> route_;
  std::vector<raster::Window> changes_;  // since the last plan
  double cost_per_field_ = 1.0;
  std::size_t blocks_renewed_ = 0;
};

}  // namespace hedgehop::global_planning
