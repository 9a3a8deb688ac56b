#pragma once

#include <vector>

#include "geo/map_projection.hpp"
#include "global_planning/flight_envelope.hpp"
#include "raster/grid.hpp"

namespace hedgehop::global_planning {

/// Cost of the way from each place of the map to one target, in plan view and as low as the
/// envelope allows: what eq. (1) would charge if climb and turn limits did not exist.
///
/// Cells are joined to blocks of about `block_m` that cost the mean of what their flyable cells
/// cost; Dijkstra's method joins each block with sixteen neighbours. Such paths are up to 2.8 %
/// longer than the straight ones they stand for; the field is divided by that. It guides a search;
/// it is not a strict bound, as means hide what is narrower than a block. O(blocks log blocks).
class CostField {
 public:
  CostField(const FlightEnvelope& envelope, const geo::MapPoint& target, double block_m);

  /// Cost to the target [m], interpolated between block centres; infinity where no way leads there
  /// and outside the map.
  [[nodiscard]] double cost_m(const geo::MapPoint& from) const;

 private:
  raster::GridGeometry blocks_;
  std::vector<float> cost_m_;
};

}  // namespace hedgehop::global_planning
