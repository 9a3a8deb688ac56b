#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <variant>
#include <vector>

#include "base/config_reader.hpp"
#include "base/observer.hpp"
#include "command_model/command_model.hpp"
#include "flight/plan_request.hpp"
#include "flight/route.hpp"
#include "local_planning/climb_profile.hpp"
#include "local_planning/decision.hpp"
#include "local_planning/direction.hpp"
#include "local_planning/histogram_table.hpp"
#include "local_planning/indicator.hpp"
#include "local_planning/rollout.hpp"
#include "local_planning/spherical_choice.hpp"
#include "local_planning/step_kernels.hpp"
#include "local_planning/surroundings.hpp"
#include "risk/cost_model.hpp"

namespace hedgehop::local_planning {

/// See lowered_flight().
struct VerticalPassOptions {
  bool is_used = false;
  double knot_s = 0.0;              // between the altitudes that are looked for
  double clearance_m = 0.0;         // above the surface
  double lateral_margin_m = 0.0;    // within this of the ground track
  double acceleration_share = 0.0;  // of the vehicle's vertical acceleration limit, (0, 1]
  double rate_share = 0.0;          // of its climb and descent rates, (0, 1]
};

/// How rollouts are kept off the ground, see fly_along().
struct RolloutEscapeOptions {
  bool is_used = false;
  double clearance_m = 0.0;       // above the surface; nearer, a way out is taken before
  double lateral_margin_m = 0.0;  // within this of the ground track
  double back_s = 0.0;            // how long before a way out may begin
  double time_max_s = 0.0;        // until it is high enough
};

/// How directions are judged: by the histogram of TVFH+, as in the paper; by rolled-out flights; or
/// azimuth and climb together, see cheapest_spherical().
enum class LocalMode : std::uint8_t { kTvfh, kRollout, kVfh3d };

/// How the histogram steers: its costs turn the heading indicator, see cost_torque_rad(); or that
/// follows the cheapest feasible direction; or the one of VFH+, see cheapest_opening_rad().
enum class Steering : std::uint8_t { kTorque, kCheapest, kOpenings };

/// Section `local` of the planning config.
struct LocalOptions {
  LocalMode mode = LocalMode::kTvfh;
  double step_s = 0.0;                 // of the command model and of the decisions, (0, 0.2]
  double window_m = 0.0;               // w, radius of the active window
  int sectors = 0;                     // K, 8 to 1024
  double safety_radius_m = 0.0;        // lateral margin; half a cell diagonal is added
  double safety_height_m = 0.0;        // h_s, what the flight aims for above the surface
  double near_distance_m = 0.0;        // least distance in the denominator of a climb angle
  double truncation_angle_rad = 0.0;   // cells further off the heading than this, and
  double truncation_distance_m = 0.0;  // nearer than this, are left out
  double arc_radius_max_factor = 0.0;  // r_max0 / r_min of the arc mask, >= 1
  bool is_arc_widened = false;         // arc bounds widened by the safety radius
  double climb_share = 0.0;          // of the climb-rate limit that makes a sector feasible, (0, 1]
  double climb_angle_min_rad = 0.0;  // steepest descent, negative
  double look_ahead_m = 0.0;         // of the target on the guide
  double projection_back_m = 0.0;    // the nearest place on the guide is looked for from this far
  double projection_ahead_m = 0.0;   // behind the last one to this far ahead of it
  double corridor_m = 0.0;           // risk and climb costs fade to nothing this far off the guide
  double goal_only_distance_m = 0.0;      // nearer to the goal, only its direction counts
  double goal_radius_m = 0.0;             // the goal is reached within this
  double slow_speed_mps = 0.0;            // flown while no sector is feasible
  double length_factor_max = 0.0;         // stuck after this many times the guide's length
  int passes = 0;                         // each pass is guided by the flight of the one before
  double window_shrink_m = 0.0;           // w is smaller by this in each further pass
  Steering steering = Steering::kTorque;  // of mode tvfh
  double repulsion_width_rad = 0.0;       // of kTorque, see cost_torque_rad()
  double opening_wide_rad = 0.0;          // of kOpenings, see cheapest_opening_rad()
  DirectionWeights weights;
  double semantics_weight = 0.0;   // c_sem of the risk, eq. (5)
  double visibility_weight = 0.0;  // c_vis of the risk, eq. (5)
  IndicatorOptions heading_indicator;
  IndicatorOptions climb_indicator;
  ProfileOptions climb_ahead;
  RolloutOptions rollout;
  RolloutEscapeOptions rollout_escape;
  SphericalOptions vfh_3d;
  VerticalPassOptions vertical_pass;
  bool is_compared_with_following = false;  // the flight that follows the guide plainly is flown
                                            // too, and taken where it costs less
  double bank_weight_1prad = 0.0;           // of a flight's cost, per metre and radian of bank
  std::vector<double> retry_speeds_mps;     // descending: tried where no flight verifies
};
/// Throws ConfigError for unknown, missing, ill-typed or out-of-range keys.
LocalOptions read_local_options(ConfigReader& reader);

/// One step as flown: the model's state and what it was told for the next step.
struct FlownStep {
  command_model::ModelState state;
  double target_heading_math_rad = 0.0;  // chosen direction; by torque, what is commanded
  command_model::Command command;
  double commanded_climb_angle_rad = 0.0;
};

struct Flight {
  double step_s = 0.0;
  std::vector<FlownStep> steps;
  std::int64_t decisions = 0;
  std::int64_t infeasible_decisions = 0;  // no sector was feasible: climbed and slowed down
  std::int64_t escapes = 0;               // ways out that rollouts took
};

/// How a flight that goes on from another one may change its commanded heading.
struct HeadingCommand {
  double before_rad = std::numeric_limits<double>::quiet_NaN();  // commanded last; NaN: as it flies
  double rate_max_radps = std::numeric_limits<double>::infinity();  // also on ways out

  /// `wanted_rad`, or as far towards it as a step allows.
  [[nodiscard]] double limited_rad(double commanded_rad, double wanted_rad, double step_s) const {
    return command_model::limited_heading_rad(commanded_rad, wanted_rad, rate_max_radps * step_s);
  }
};

/// How a commanded step is flown: in process, or by the command_model process in lockstep.
using StepModel = std::function<command_model::ModelState(
    const command_model::ModelState& state, const command_model::Command& command, double step_s)>;

/// The state in which a flight along `guide` begins: at its first waypoint, on its heading, wings
/// level, with the climb rate of its first leg as far as the vehicle can.
command_model::ModelState state_at_start(const std::vector<flight::Waypoint>& guide,
                                         double speed_mps, const flight::Limits& limits);
/// The same within Vehicle::vertical_rates() and on its course in the vehicle's wind.
command_model::ModelState state_at_start(const std::vector<flight::Waypoint>& guide,
                                         double speed_mps, const command_model::Vehicle& vehicle);

/// Flies the command model along a guide with TVFH+ or rollouts (all passes).
///
/// Each step of TVFH+: project the place on the guide, take the target `look_ahead_m` further,
/// compute the polar histogram, let the heading indicator follow the cheapest feasible direction or
/// as `steering` says, and command the climb
///
///     t_cmd = max(t[k_cmd], min(t[k_chi], tau_max), t_goal, tan gamma_min, climb_ahead)
///
/// k_cmd is the sector of the commanded heading, k_chi that of the present one, over which the
/// helicopter still flies; tau_max = climb_share climb_rate_max / V. The climb indicator smooths
/// t_goal alone: what the terrain needs is commanded at once. If the indicator points into a sector
/// that is not feasible, the nearest feasible one is commanded and the indicator starts again from
/// the present heading. If no sector is feasible, the one with the least climb within 108 degrees
/// is commanded, with all the climb there is, at `slow_speed_mps`. Flight slows down as well when
/// the climb ahead needs more than the vehicle has.
///
/// By torque, the indicator follows no direction that was chosen: a spring pulls it towards the
/// goal direction (the feasible one nearest to it), and cost_torque_rad() turns it beside that.
///
/// A step of the rollout mode chooses the direction by Rollout; t[k_cmd] and t[k_chi] are replaced
/// by the climb along the heading commanded before. If that heading is not feasible any more, the
/// chosen one is commanded and the indicator starts again.
///
/// Rollouts look ahead with a simpler model and only so far: now and then they lead where all ways
/// end at a slope. So their flight is checked as it grows. Where a piece of it comes nearer to the
/// surface than `rollout_escape` says, what was flown from a moment before on is thrown away, and
/// escape_along() is flown from there until it is high enough; then rollouts decide again. The
/// moment is the last one in steps of 1 s from which that leads along the guide, or if there is
/// none, the last one from which it leads anywhere. So each state of the flight has a verified
/// continuation: the rest of the flight. Near start and goal less is asked for where they
/// themselves lie lower.
///
/// A step of the three-dimensional VFH is one of TVFH+ whose direction and climb are those of
/// cheapest_spherical(); its climb takes the place of t_goal.
///
/// Risk and climb costs bend the flight only near the guide: they count with the share
/// max(0, 1 - (offset / corridor)^2) of the distance to it, so that no weight makes the flight
/// leave a route that is known to be flyable. Terrain may push it further.
///
/// Ground beyond the goal does not count. The flight ends at its nearest approach to the goal
/// within `goal_radius_m`. If it passes the goal further aside, it flies straight on, turns back
/// and tries again. Positions outside the map and voids count as walls.
///
/// @param guide       at least two different places; altitudes are followed or exceeded
/// @param initial     state at the first waypoint, within the vehicle's limits
/// @param step_model  empty: the command model is stepped in process
/// @param kernel      same bytes whatever it is
/// @param watch       shown the decisions that it wants to see
/// @return  the flight of the last pass; counts are of all passes. NoPlan: kLocalPlannerStuck with
///          the place when the goal is not reached, kStopped when the observer says so.
/// @throws std::invalid_argument  for a guide or state that is not finite, a speed out of limits.
/// @note  A function of its arguments alone, as far as `step_model` is one.
std::variant<Flight, flight::NoPlan> fly_along(
    const risk::CostModel& costs, const command_model::Vehicle& vehicle,
    const LocalOptions& options, const std::vector<flight::Waypoint>& guide,
    const command_model::ModelState& initial, double speed_mps, const StepModel& step_model,
    Observer& observer, Kernel kernel = Kernel::kBest, const DecisionWatch& watch = {});

/// What flights along any guide on a map share; immutable.
struct LocalGround {
  Surroundings surroundings;
  std::vector<std::shared_ptr<const HistogramTables>> tables;  // by pass; empty for rollouts
};
LocalGround local_ground(const risk::CostModel& costs, const LocalOptions& options);
/// Takes in what the surface of the map has become at these cells: the same then as
/// local_ground(costs, options), see Surroundings::surface_changed().
void surface_changed(LocalGround& ground, const risk::CostModel& costs, const LocalOptions& options,
                     const std::vector<raster::CellIndex>& cells);

/// The same for many flights on one map. The options may differ from those of local_ground() in
/// what concerns neither window, sectors, passes, safety radius, mode, arcs nor weights of the
/// risk.
std::variant<Flight, flight::NoPlan> fly_along(
    const LocalGround& ground, const command_model::Vehicle& vehicle, const LocalOptions& options,
    const std::vector<flight::Waypoint>& guide, const command_model::ModelState& initial,
    double speed_mps, const StepModel& step_model, Observer& observer,
    Kernel kernel = Kernel::kBest, const DecisionWatch& watch = {},
    const HeadingCommand& heading = {});

}  // namespace hedgehop::local_planning
