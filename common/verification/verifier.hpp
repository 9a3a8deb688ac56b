#pragma once

#include <optional>
#include <vector>

#include "base/config_reader.hpp"
#include "flight/plan_request.hpp"
#include "flight/power_curve.hpp"
#include "flight/route.hpp"
#include "flight/trajectory.hpp"
#include "flight/vehicle.hpp"
#include "flight/verdict.hpp"
#include "flight/wind.hpp"
#include "map/map.hpp"

namespace hedgehop::verification {

/// The power curve of a vehicle and what it is flown in.
struct PowerDemand {
  flight::PowerCurve curve;
  flight::Conditions conditions;
};

/// Vertical rates that power admits, reckoned from `power` alone: own atmosphere (hydrostatic, by
/// its lapse rate), own induced velocity (Newton's method on Glauert's equation).
flight::VerticalRates rates_by_power(const PowerDemand& power, double airspeed_mps,
                                     double altitude_m);

/// The wind of these conditions in the grid of a place, reckoned from azimuths.
flight::Wind wind_of(const flight::Conditions& conditions, double convergence_rad);

/// The same state with the speed and heading of its velocity through the air.
flight::FlightState through_air(const flight::FlightState& state, const flight::Wind& wind);

/// Section `verification` of the planning config: what a finished trajectory must hold.
struct Demands {
  double required_clearance_m = 0.0;  // above the interpolated surface, everywhere on the path
  double ceiling_height_m = 0.0;      // height under which a contour flight counts as low
  double share_under_ceiling_min = 0.0;
  double goal_radius_m = 0.0;
  double start_radius_m = 0.0;
  double via_radius_m = 0.0;  // within which each via point is passed, seen from above
  std::optional<PowerDemand> power =
      std::nullopt;        // not of the section: a flight by the power curve
  flight::Wind wind = {};  // not of the section either: that the flight is made in
};
Demands read_demands(ConfigReader& reader);

/// Thrust over weight [-] of a state whose acceleration is the vertical one, g tan(bank) across and
/// g tan(pitch) along, pitch being relative to trim:
///
///     n = sqrt((1 + a_z / g)^2 + tan^2 bank + tan^2 pitch)
///
/// In a steady, level turn that is 1 / cos(bank).
double load_factor_of(const flight::FlightState& state);

/// Checks a finished trajectory on its own terms: own interpolation, own geometry, own kinematics.
/// Shares no code with the planners.
///
/// The path between two states is the cubic through their places and velocities; its clearance is
/// that of the chord, in closed form over the interpolated surface, less a proven bound of how far
/// the cubic strays from the chord. So `clearance_min_m` is never too great, and too small by
/// millimetres.
///
/// Rules, by the names in the verdict: `clearance`, `wire_clearance` (distance to the curtain below
/// the straight conductor of each overhead line), `obstacle_clearance` (distance to the cylinder of
/// each obstacle, whose radius holds the error of its position), `no_fly_area` (minus the distance
/// to the edge of the hard area that is entered), `unknown_surface`, `outside_map`; `bank`,
/// `roll_rate`, `pitch`, `climb_rate`, `descent_rate`, `vertical_acceleration`, `load_factor` (see
/// load_factor_of()), `climb_power`, `descent_power` (see rates_by_power(), where demanded),
/// `speed_min`, `speed_max`; `start`, `goal`, `via` (passed in their order),
/// `share_under_ceiling`; `surface_column`, `terrain_column`;
/// `states`, `finite`, `time_step`; `continuity_position`, `_altitude`, `_heading`, `_bank`,
/// `_pitch`, `_speed`, `_climb_rate`,
/// `_roll_rate`, `_pitch_rate`. Each state or step that breaks a rule counts once.
///
/// In wind the velocity over ground, as the states tell it, less the wind is that through the air:
/// its speed is held against the limits and the power, and it turns as the bank says. The speeds of
/// the verdict are airspeeds.
///
/// Values of unknown things (a void, a state that is not finite) are NaN, also in the verdict's
/// figures when nothing could be measured.
flight::Verdict verify(const map::Map& map, const flight::Trajectory& trajectory,
                       const flight::Waypoint& start, const std::vector<geo::MapPoint>& via,
                       const flight::Waypoint& goal, const flight::Limits& limits,
                       const Demands& demands);

}  // namespace hedgehop::verification
