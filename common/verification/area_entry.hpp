#pragma once

#include <optional>

#include "map/map.hpp"
#include "verification/surface_sweep.hpp"

namespace hedgehop::verification {

/// How far inside an area, seen from above, a straight piece of path is: the distance of its start
/// to the nearest edge [m], 0 for one that only touches; nothing if it keeps more than `margin_m`
/// away from the polygons. Edges belong to the area, those of holes too.
///
/// A piece touches a polygon if an end lies inside or an edge comes within the margin, in closed
/// form. O(corners). Shares no code with the planners' index of areas.
std::optional<double> depth_in_area_m(const map::Area& area, const PathPoint& from,
                                      const PathPoint& to, double margin_m);

/// Distance of a straight piece of path to the polygons of an area, seen from above [m]; 0 inside.
/// O(corners).
double distance_to_polygons_m(const map::Area& area, const PathPoint& from, const PathPoint& to);

/// Least and greatest value over a piece of path.
struct HeightRange {
  double low_m = 0.0;
  double high_m = 0.0;
};

/// Whether altitudes above the sea and heights above the ground of a piece may lie between the
/// limits of an area. NaN heights (unknown ground) may lie anywhere.
bool may_lie_within(const map::Area& area, const HeightRange& altitude, const HeightRange& height);

/// How far they are from lying between those limits [m]; 0 where may_lie_within().
double distance_to_band_m(const map::Area& area, const HeightRange& altitude,
                          const HeightRange& height);

}  // namespace hedgehop::verification
