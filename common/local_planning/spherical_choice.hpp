#pragma once

#include <optional>
#include <vector>

#include "local_planning/direction.hpp"
#include "local_planning/polar_histogram.hpp"

namespace hedgehop::local_planning {

/// Section `vfh_3d` of the local options.
struct SphericalOptions {
  double elevation_step_rad = 0.0;  // between the climb angles that are candidates
  double goal = 0.0;                // cost per radian off the direction to the target
  double heading = 0.0;             // likewise off the present direction of flight
  double before = 0.0;              // likewise off the direction chosen before
};

/// A direction in space.
struct SphericalDirection {
  double azimuth_math_rad = 0.0;
  double elevation_rad = 0.0;  // up positive
};

/// The angle between two directions [rad], 0 to pi.
double apart_rad(const SphericalDirection& a, const SphericalDirection& b);

/// The choice of the three-dimensional VFH: azimuth and climb angle together.
///
/// Candidates are the centres of the K azimuth sectors with climb angles from tangent_min to
/// tangent_max, elevation_step_rad apart. One is free if it clears the terrain of its sector, tan e
/// >= t_k; over a surface without overhangs, what is free in a sector is all above one angle, so
/// the histogram of cells by azimuth and elevation is the polar histogram of tangents. The cheapest
/// free one minimises
///
///     goal |d, d_goal| + heading |d, d_now| + before |d, d_before| + polar_share c_p,k (risk_k -
///     mean risk)
///
/// |.,.| angle between directions in space; c_p,k as in cheapest_direction_rad(). Ties go to the
/// lowest sector, then to the lowest climb.
///
/// @param now  direction of flight, climb included
/// @return  nothing if no candidate is free
/// @note  For comparison, in plain form: O(K E) arc cosines.
///
/// Source: S. Vanneste, B. Bellekens, M. Weyn, "3DVFH+: Real-Time Three-Dimensional Obstacle
/// Avoidance Using an Octomap", MORSE 2014, CEUR 1319; without its octree, as maps are surfaces.
std::optional<SphericalDirection> cheapest_spherical(
    const PolarHistogram& histogram, const Sectors& sectors, const SphericalOptions& options,
    double polar_offset_rad3, const DirectionQuestion& question, const SphericalDirection& now,
    const SphericalDirection& before);

}  // namespace hedgehop::local_planning
