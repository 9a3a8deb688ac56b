#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <variant>
#include <vector>

#include "base/config_reader.hpp"
#include "base/observer.hpp"
#include "flight/plan_request.hpp"
#include "flight/route.hpp"
#include "flight/vehicle.hpp"
#include "global_planning/slope_limits.hpp"
#include "global_planning/turn_limit.hpp"
#include "risk/cost_model.hpp"

namespace hedgehop::global_planning {

/// What leads BIT*: lower bounds of the cost to come and the cost to go.
enum class SearchHeuristic : std::uint8_t { kLength, kCostField };
/// Where BIT* draws states: all that a route of the best cost could reach, by length or by the
/// strict bounds of CostBound.
enum class SamplingRegion : std::uint8_t { kEllipse, kLevelSet };
/// What BIT* heeds of turns: nothing, the insertion condition of the paper, or that and a first
/// route that is searched over directed edges.
enum class TurnRule : std::uint8_t { kNone, kInsertion, kHeadingLabels };

/// Section `global` of the planning config.
struct GlobalOptions {
  double envelope_floor_m = 0.0;     // least height above the surface
  double envelope_ceiling_m = 0.0;   // greatest height, looser than what the flight aims for
  double lateral_margin_m = 0.0;     // floor holds for the highest surface within this distance
  double climb_angle_max_rad = 0.0;  // of edges
  double descent_angle_max_rad = 0.0;
  double turn_angle_max_rad = 0.0;  // insertion condition (figure 3 of the paper), in plan view
  double turn_radius_m = 0.0;       // extension: arcs of this radius must fit the legs; 0 = off
  double end_funnel_m = 0.0;        // around start and goal the floor sinks to their height
  double check_step_m = 0.0;        // distance of the discrete checks on an edge
  double final_check_step_m = 0.0;  // no route leaves that fails at this step
  double guide_spacing_m = 0.0;
  std::int64_t batch_size = 0;
  double radius_factor = 0.0;  // of the r-disc of the random geometric graph
  SearchHeuristic heuristic = SearchHeuristic::kLength;
  SamplingRegion sampler = SamplingRegion::kEllipse;
  TurnRule turn_rule = TurnRule::kInsertion;
  double radius_max_m = 0.0;     // longer edges are left to the shortcut scan
  bool use_lattice = false;      // first route from search_lattice; BIT* only where that fails
  bool use_roadmap = false;      // before that, from a Roadmap, where the problem has one
  bool refine = false;           // corridor refinement of the first planner's route
  double field_block_m = 0.0;    // resolution of the cost field that leads the lattice search
  std::int64_t work_budget = 0;  // legs evaluated plus states drawn; ten legs of refine() are one
  /// Not of the section: what the vehicle admits beside the angles; null: nothing else.
  std::shared_ptr<const SlopeLimits> vehicle_slopes = nullptr;
  /// Nor are these: a wind and the airspeed that is flown in it. The angles and the radius above
  /// are those of still air.
  flight::Wind wind = {};
  double airspeed_mps = 0.0;

  /// Of the angles, or vehicle_slopes, which include them, in the wind.
  [[nodiscard]] SlopeLimits slopes() const;
  /// Of turn_radius_m, in the wind.
  [[nodiscard]] TurnLimit turns() const { return {turn_radius_m, wind, airspeed_mps}; }
};
GlobalOptions read_global_options(ConfigReader& reader);

/// One improvement of an anytime search.
struct RouteProgress {
  std::int64_t work_units = 0;
  std::int64_t work_budget = 0;
  double best_cost_m = 0.0;  // infinity before the first solution
  double lower_bound_m = 0.0;
  const std::vector<flight::Waypoint>* best_route = nullptr;  // lives as long as the call; or null
};
using OnProgress = std::function<void(const RouteProgress&)>;

class Roadmap;

/// A leg that leads to the start of a route: a horizontal vector in the order of the flight.
struct LeadIn {
  double x_m = 0.0;
  double y_m = 0.0;
};

/// Start and goal of a search, altitudes AMSL.
struct RouteProblem {
  flight::Waypoint start;
  flight::Waypoint goal;
  std::uint64_t seed = 1;
  std::int64_t work_budget = 0;
  const Roadmap* roadmap = nullptr;  // of the map under these costs and options, or null
  /// The corner at the start keeps FlightEnvelope::is_turn_allowed() too; without it, any heading.
  std::optional<LeadIn> lead_in = std::nullopt;
};

/// Plans one leg: route of a roadmap if asked for and given, else or where that finds nothing
/// lattice search (BIT* where that finds nothing, or if asked for), lowest profile,
/// corridor refinement, shortcut scan, equidistant interpolation. The route carries a strict lower
/// bound of its cost, see CostBound. Why there is no route is told with cause, place and number.
///
/// A function of its arguments alone: the same bytes for any number of threads. An observer that
/// asks to stop ends the search with the best route so far, or kStopped.
std::variant<flight::Route, flight::NoPlan> plan_leg(const risk::CostModel& costs,
                                                     const GlobalOptions& options,
                                                     const RouteProblem& problem,
                                                     const OnProgress& on_progress,
                                                     const Observer& observer);

}  // namespace hedgehop::global_planning
