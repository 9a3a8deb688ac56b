#pragma once

#include <vector>

#include "geo/map_projection.hpp"

namespace hedgehop::flight {

/// One instant of a flight. Azimuths are clockwise from true north, [0, 2 pi).
///
/// The horizontal velocity is that over ground, also in wind: states follow from each other by it.
/// Less the wind that the plan was made for (section `conditions` of its config), it is that
/// through the air: its azimuth is where the nose points, and its length is the airspeed. Bank and
/// pitch are those that fly it. Without wind both are one.
struct FlightState {
  double time_s = 0.0;            // since the start
  double x_m = 0.0;               // map frame, grid east
  double y_m = 0.0;               // map frame, grid north
  double altitude_m = 0.0;        // AMSL
  double speed_mps = 0.0;         // horizontal, over ground
  double heading_true_rad = 0.0;  // of the horizontal velocity over ground: the course
  double convergence_rad = 0.0;   // true azimuth of grid north at this place
  double bank_rad = 0.0;          // right positive
  double roll_rate_radps = 0.0;
  double pitch_rad = 0.0;  // nose up positive, relative to trim
  double pitch_rate_radps = 0.0;
  double climb_rate_mps = 0.0;  // up positive
  double vertical_acceleration_mps2 = 0.0;
  double target_heading_true_rad = 0.0;  // what the local planner chose: a course
  double commanded_heading_true_rad =
      0.0;  // target-heading indicator: what the controller was given, for the nose
  double commanded_climb_angle_rad = 0.0;  // up positive, over ground
  double commanded_speed_mps = 0.0;        // airspeed
  double surface_m = 0.0;                  // surface model below, interpolated [m AMSL]
  double terrain_m = 0.0;                  // ground below, interpolated [m AMSL]

  [[nodiscard]] geo::MapPoint point() const { return {x_m, y_m}; }
};

/// A flight in equal time steps.
struct Trajectory {
  double step_s = 0.0;
  std::vector<FlightState> states;
};

/// The paper's measures of a flown path (its tables 2 and 3).
struct PathMeasures {
  double length_m = 0.0;  // horizontal
  double duration_s = 0.0;
  double visibility_m =
      0.0;                   // integral of the visibility share over length, height rule of eq. (1)
  double semantics_m = 0.0;  // integral of the semantic cost over length
  double bank_rad_m = 0.0;   // integral of |bank| over length
  double mean_height_m = 0.0;  // above the surface, averaged over length
  double max_height_m = 0.0;
  double share_under_ceiling = 0.0;  // of the length, in [0, 1]
};

}  // namespace hedgehop::flight
