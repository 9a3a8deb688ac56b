#pragma once

#include <memory>
#include <vector>

#include "geo/map_projection.hpp"
#include "global_planning/flight_envelope.hpp"

namespace hedgehop::global_planning {

/// Strict lower bound of eq. (1) for every route of an envelope to one target.
///
/// A function u with |grad u| <= w almost everywhere and u(target) = 0 bounds every path: its cost
/// is at least the integral of w along its ground track, hence at least u where it begins. w is
/// FlightEnvelope::least_density(), constant over each cell. u is linear over two triangles of each
/// cell, whose right angles lie in opposite corners, by turns in the one pair and in the other: its
/// slope over a triangle follows from the two sides of the cell that meet there.
///
/// A first u solves |grad u| = w by fast marching (J. A. Sethian, PNAS 93(4), 1996,
/// doi:10.1073/pnas.93.4.1591); over some triangles it is too steep. Each side is then allowed to
/// rise as far as in this u, divided by the worst steepness of the triangles that it belongs to:
/// whatever keeps to these limits is nowhere too steep. The greatest such u is the shortest way
/// along the sides of cells. Repeating this with that u never lowers it. So no factor for
/// metrication is needed, and the bound holds whatever the first solution was.
///
/// Ground beyond the cell of `from` keeps the value found there: capping u keeps it valid.
/// O(cells). Climb and turn limits are left free, so over steep ground the bound is loose.
class CostBound {
 public:
  CostBound(const FlightEnvelope& envelope, const geo::MapPoint& target, const geo::MapPoint& from);

  /// No route from this place to the target costs less [m]; 0 outside the map, infinity if none can
  /// exist.
  [[nodiscard]] double cost_m(const geo::MapPoint& from) const;

  /// The same at the south-western corner of a cell, or, one column or row beyond the last, at its
  /// other corners. Over each of the two triangles of a cell it is linear.
  [[nodiscard]] double corner_cost_m(int column, int row) const;

 private:
  friend class CostBoundMaking;
  explicit CostBound(const raster::GridGeometry& cells);
  [[nodiscard]] double corner_value_m(int column, int row) const;

  raster::GridGeometry cells_;
  std::vector<float> cost_m_;  // at the corners of cells, rows of columns + 1
};

/// No route between start and goal of the envelope costs less [m]: what a CostBound says of its
/// `from`, but sharper.
///
/// A solution of |grad u| = w is too steep mostly where ways fan out from a cheap place. What fans
/// out from one end comes together from the other: so half of the difference of the solutions from
/// both ends is much less too steep, and is what the limits are taken from. (For places aside of
/// the cheapest ways a CostBound is better.) O(cells).
double least_cost_m(const FlightEnvelope& envelope);

/// The making of a CostBound in steps of about a tenth of a millisecond, for searches that may be
/// asked to end at any time. The envelope must outlive it.
class CostBoundMaking {
 public:
  CostBoundMaking(const FlightEnvelope& envelope, const geo::MapPoint& target,
                  const geo::MapPoint& from);
  ~CostBoundMaking();
  CostBoundMaking(CostBoundMaking&&) noexcept;
  CostBoundMaking& operator=(CostBoundMaking&&) noexcept;

  /// Does a little; true once the bound is complete.
  bool step();
  /// The complete bound, once.
  [[nodiscard]] CostBound take() &&;

 private:
  friend double least_cost_m(const FlightEnvelope& envelope);
  struct Corners;
  CostBound bound_;
  std::unique_ptr<Corners> corners_;  // null: complete
};

}  // namespace hedgehop::global_planning
