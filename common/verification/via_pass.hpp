#pragma once

#include <cstddef>
#include <vector>

#include "flight/trajectory.hpp"
#include "geo/map_projection.hpp"

namespace hedgehop::verification {

/// Where a path passes a point, seen from above.
struct Pass {
  std::size_t entry = 0;  // first piece within the radius, by the state that it begins with
  std::size_t piece = 0;  // the nearest one
  double distance_m = 0.0;
};
/// The nearest place of the first stay within `radius_m` of a point, from the piece number `begin`
/// on; without one the nearest place of all, NaN for its distance if no piece is finite. At least
/// two states.
Pass first_pass(const std::vector<flight::FlightState>& states, std::size_t begin,
                const geo::MapPoint& point, double radius_m);

}  // namespace hedgehop::verification
