#pragma once

#include <memory>
#include <variant>
#include <vector>

#include "base/observer.hpp"
#include "flight/plan_request.hpp"
#include "flight/route.hpp"
#include "global_planning/cost_field.hpp"
#include "global_planning/detour.hpp"
#include "global_planning/flight_envelope.hpp"
#include "global_planning/global_planner.hpp"
#include "global_planning/route_line.hpp"
#include "global_planning/ways_to_goal.hpp"
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
/// joins it again; the lattice is searched between these two places alone. The field knows little
/// of climbs, so on steep ground that may find nothing: then find_ways_around() looks for a way
/// from anywhere on the old route, led by the ways to the goal that were worked out beforehand and
/// tell which places can be flown on from; after that the two places are searched from the other
/// end. What is found, with some of the old route before and after it, is moved sideways by
/// low_corridor_track() from coarse to fine, with more of the old route if that finds no track;
/// then the whole ground track is flown at its lowest_profile(). Turns where old and new meet are
/// looked at like all others. If the start lies on the old route and that is still the cheaper one,
/// it stays. Where no part is found, the lattice is searched from the start to the goal with the
/// repaired field ahead; where that too finds nothing, plan_leg() plans anew.
///
/// To construct takes 2 to 3.5 s of processor time and up to 100 MB, for those ways; copies share
/// them. Changes make them worse, not wrong: after many, a new planner leads better.
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
  // A line from start to goal with another way between two of its waypoints; empty without one.
  struct Changed {
    std::vector<flight::Waypoint> route;
    std::size_t leave = 0;
    std::size_t join = 0;
  };
  // The line with a track between two of its waypoints, as low as it may be flown.
  [[nodiscard]] std::vector<flight::Waypoint> flown(const std::vector<flight::Waypoint>& line,
                                                    std::size_t leave, std::size_t join,
                                                    const std::vector<geo::MapPoint>& track) const;
  enum class FromEnd { kLeave, kJoin };  // where the search for a part begins
  // A part of a lattice between two places of the line.
  [[nodiscard]] std::vector<flight::Waypoint> around(const std::vector<flight::Waypoint>& line,
                                                     std::size_t leave, std::size_t join,
                                                     double aside_m, FromEnd from_end,
                                                     const Observer& observer) const;
  // The same where a detour says; the old route was so long.
  [[nodiscard]] Changed around(const std::vector<flight::Waypoint>& line, const Detour& detour,
                               double old_m, bool is_on_route, FromEnd from_end,
                               const Observer& observer) const;
  // By the ways to the goal. `stay` is the line with all its waypoints.
  [[nodiscard]] Changed by_ways(const std::vector<flight::Waypoint>& line,
                                const std::vector<flight::Waypoint>& stay, bool is_on_route,
                                const Observer& observer) const;
  [[nodiscard]] std::vector<flight::Waypoint> searched(const Observer& observer) const;
  [[nodiscard]] bool is_lawful(const std::vector<flight::Waypoint>& route) const;
  // Moves what lies between two waypoints of a route sideways and flies all of it low. False if
  // that led to nothing better.
  bool improve(std::vector<flight::Waypoint>& route, const flight::Waypoint& from,
               const flight::Waypoint& to) const;
  // What routes cost for a metre of the field.
  void judge_field();
  // Whether the box around a leg comes as near as that to a change since the last plan.
  [[nodiscard]] bool is_changed(const geo::MapPoint& a, const geo::MapPoint& b,
                                double near_m) const;

  GlobalOptions options_;
  RouteProblem problem_;
  FlightEnvelope envelope_;
  CostField field_;
  std::vector<flight::Waypoint> route_;
  // When the route was new, for the ways to the goal from all around.
  std::shared_ptr<const CostField> first_field_;
  std::shared_ptr<const WaysToGoal> ways_;
  std::vector<raster::Window> changes_;  // since the last plan
  double cost_per_field_ = 1.0;
  std::size_t blocks_renewed_ = 0;
};

}  // namespace hedgehop::global_planning
