#pragma once

#include <cstdint>
#include <memory>
#include <variant>
#include <vector>

#include "geo/map_projection.hpp"
#include "planning/planning.hpp"

namespace hedgehop::planning {

/// A route to be flown.
struct RouteTask {
  flight::Waypoint start;
  std::vector<geo::MapPoint> via;  // in this order
  flight::Waypoint goal;
  std::vector<flight::Waypoint> guide;
  std::vector<flight::Waypoint> held;  // places that the vertical pass does not sink below
  command_model::ModelState initial;   // at the first waypoint of the guide
  double speed_mps = 0.0;
};

/// A route as flown and checked.
struct RouteFlight {
  flight::Trajectory trajectory;
  flight::PathMeasures measures;
  flight::Verdict verdict;
  double cost_m = 0.0;        // local_planning::flight_cost_m()
  double speed_mps = 0.0;     // that was asked of the local planner
  bool is_following = false;  // plainly along the guide, without local optimisation
  bool is_lowered = false;    // by the vertical pass
  std::int64_t decisions = 0;
  std::int64_t infeasible_decisions = 0;
};

/// Grounds for many flights on one map, each made once; see local_planning::local_ground().
class RouteGrounds {
 public:
  /// Keeps a pointer.
  explicit RouteGrounds(const risk::CostModel& costs) : costs_(&costs) {}

  /// Makes what flights with these options need.
  void make(const local_planning::LocalOptions& options);
  /// Takes in what the surface of the map has become at these cells, after the costs have.
  void surface_changed(const std::vector<raster::CellIndex>& cells);
  /// Of options that make() knew. Safe to call from several threads.
  [[nodiscard]] const local_planning::LocalGround& of(
      const local_planning::LocalOptions& options) const;
  [[nodiscard]] const risk::CostModel& costs() const { return *costs_; }

 private:
  struct Made {
    local_planning::LocalOptions options;
    local_planning::LocalGround ground;
  };
  [[nodiscard]] const Made* find(const local_planning::LocalOptions& options) const;

  const risk::CostModel* costs_;
  std::vector<std::unique_ptr<Made>> made_;
};

/// Flies a route in each way that the config allows and returns the cheapest flight that verifies:
/// optimised locally, and if `compare_with_following` says so following the guide plainly; each
/// lowered by the vertical pass if that is used, and as it was.
///
/// So a plan is never worse than plain following, by flight_cost_m(). If the optimised flight gets
/// stuck, the plain one counts alone, and the other way round. If no flight verifies, all is tried
/// again at each lower speed of `retry_speeds_mps`: slower, the same climb rate is a steeper climb
/// and a turn is tighter. If none verifies at last, the one with the greatest clearance is
/// returned; NoPlan if none arrived.
std::variant<RouteFlight, flight::NoPlan> fly_route(
    const risk::CostModel& costs, const PlanningConfig& config, const RouteTask& task,
    const local_planning::StepModel& step_model, Observer& observer,
    const local_planning::DecisionWatch& watch = {});

/// The same for many flights on one map.
std::variant<RouteFlight, flight::NoPlan> fly_route(const RouteGrounds& grounds,
                                                    const PlanningConfig& config,
                                                    const RouteTask& task, Observer& observer);

/// A flight in the terms of a plan, with the ground below it.
///
/// @param wind  that it is flown in
flight::Trajectory trajectory_of(const local_planning::Flight& flight, const map::Map& map,
                                 const geo::MapProjection& projection, const flight::Wind& wind);

}  // namespace hedgehop::planning
