#pragma once

#include <cstdint>
#include <vector>

#include "base/config_reader.hpp"
#include "flight/trajectory.hpp"
#include "geo/map_projection.hpp"
#include "map/map.hpp"

namespace hedgehop::evaluation {

/// config/uncertainty.yaml: how errors are drawn.
struct UncertaintyOptions {
  std::int64_t draws = 0;
  double node_m = 0.0;                    // errors are looked at so often along the path
  double dem_correlation_m = 0.0;         // where the correlation of the surface's error is 1/e
  double navigation_correlation_s = 0.0;  // likewise for each axis of the position error
  double confidence = 0.0;                // of the interval
};
UncertaintyOptions read_uncertainty_options(ConfigReader& reader);

/// Standard deviations [m].
struct ErrorSizes {
  double dem_m = 0.0;         // of the surface model
  double navigation_m = 0.0;  // of the position, for each of east, north and up
};

/// What errors do to the least clearance of a flight above the surface.
struct ClearanceRisk {
  ErrorSizes errors;
  std::uint64_t seed = 0;
  double clearance_m = 0.0;  // below which a draw counts as violated
  std::int64_t nodes = 0;    // places at which each draw looks
  std::int64_t draws = 0;
  std::int64_t violations = 0;
  double probability = 0.0;  // of a violation anywhere on the flight: their share
  double low = 0.0;          // Clopper-Pearson interval of the probability
  double high = 0.0;
  double confidence = 0.0;
  // Least clearance of a flight with errors: at most this in 1 %, 5 % and half of the draws.
  double clearance_p01_m = 0.0;
  double clearance_p05_m = 0.0;
  double clearance_median_m = 0.0;
  // Where violated draws are violated worst most often; NaN without violations.
  geo::MapPoint worst_place;
  double worst_time_s = 0.0;
  std::vector<double> least_clearances_m;  // of all draws, ascending
};

/// Draws errors of surface and position along a flight and counts the draws in which the clearance
/// falls below `clearance_m` anywhere.
///
/// The surface is off by a Gaussian process along the path whose correlation falls as
/// exp(-distance / dem_correlation_m); the position by three, one for each axis, with
/// exp(-time / navigation_correlation_s). At a node the clearance is
///
///     altitude + up - surface(x + east, y + north) - error of the surface
///
/// less what the path comes lower between this node and the next, errors left aside. (How a process
/// wanders between nodes is not seen: over nodes 5 m apart and a correlation length of 300 m its
/// least value is about a tenth of a standard deviation lower.) Distance is
/// that flown, so that places that the flight passes twice err independently: that is on the safe
/// side. Wires, obstacles and areas are left aside: the map's radii and heights hold their errors.
/// A place that the error moves over unknown ground or off the map counts as violated.
///
/// Source of the interval: C. J. Clopper and E. S. Pearson, Biometrika 26(4), 1934,
/// doi:10.1093/biomet/26.4.404.
///
/// @param trajectory  at least two states, all finite
/// @throws std::invalid_argument  for less, or errors that are negative or not finite.
/// @note  The same seed gives the same result for any number of threads. O(draws x nodes), about
///        0.1 us each.
ClearanceRisk clearance_risk(const map::Map& map, const flight::Trajectory& trajectory,
                             const ErrorSizes& errors, double clearance_m,
                             const UncertaintyOptions& options, std::uint64_t seed);

}  // namespace hedgehop::evaluation
