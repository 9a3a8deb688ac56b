#pragma once

#include <cstddef>
#include <vector>

#include "base/config_reader.hpp"
#include "flight/trajectory.hpp"

namespace hedgehop::briefing {

struct LegOptions {
  double tolerance_m = 0.0;  // > 0
};
/// Section `legs` of config/report.yaml.
LegOptions read_leg_options(ConfigReader& reader);

/// Horizontal distance flown up to each state [m]; the first is 0.
std::vector<double> distances_m(const flight::Trajectory& trajectory);

/// A part of a flight that is told as one straight line.
struct FlightLeg {
  std::size_t first = 0;      // states of the trajectory
  std::size_t last = 0;       // the first state of the next leg
  double start_time_s = 0.0;  // since the start of the flight
  double duration_s = 0.0;
  double start_along_m = 0.0;    // distance flown before
  double length_m = 0.0;         // of the straight line, in the map frame
  double course_grid_rad = 0.0;  // of the straight line, from grid north, clockwise, [0, 2 pi)
  double course_true_rad = 0.0;  // the same from true north, with the convergence at its middle
  double speed_mps = 0.0;        // flown: distance flown over duration
  double altitude_from_m = 0.0;  // AMSL
  double altitude_to_m = 0.0;
  double height_min_m = 0.0;  // above the surface, of the states
  double height_max_m = 0.0;
};

/// The flight as few straight legs: states are left out as long as the flown track strays at most
/// `tolerance_m` sideways from the leg that replaces it (D. Douglas and T. Peucker, "Algorithms for
/// the reduction of the number of points required to represent a digitized line",
/// doi:10.3138/FM57-6770-U75U-7727). States nearest to the via points always end a leg.
///
/// @param via  states at which the flight passes via points, ascending; others are ignored.
/// @return  at least one leg for two states or more, none for less. NaN heights stay NaN only if
///          no height of the leg is known.
/// O(states x legs).
std::vector<FlightLeg> flight_legs(const flight::Trajectory& trajectory,
                                   const std::vector<std::size_t>& via, const LegOptions& options);

}  // namespace hedgehop::briefing
