#pragma once

#include "raster/grid.hpp"

namespace hedgehop::verification {

/// One end of a straight piece of path.
struct PathPoint {
  double x_m = 0.0;
  double y_m = 0.0;
  double altitude_m = 0.0;
};

/// What a straight piece of path meets on its way. `at` values are shares of the piece, in [0, 1].
struct Sweep {
  double clearance_min_m = 0.0;  // over the known part of the piece; NaN if nothing of it is known
  double clearance_min_at = 0.0;
  double gradient_max = 0.0;  // steepest slope of the patches touched and of their neighbours [-]
  double share_low = 0.0;     // of the piece, at most `low_height_m` above the surface
  double unknown_at = 0.0;    // first place over a void; NaN if there is none
  double outside_at = 0.0;    // first place outside the raster; NaN if there is none
};

/// Height of a grid at a point, NaN outside and where a void takes part.
///
/// Between four cell centres the height is bilinear; beyond the outermost centres it is that of the
/// nearest point between centres. The same surface as sweep_surface() measures against.
double interpolated_height_m(const raster::Grid<float>& heights_m, const geo::MapPoint& point);

/// Least clearance of a straight piece of path above the interpolated surface, in closed form.
///
/// The piece is cut where it passes from one patch between four cell centres to the next. Within a
/// patch the surface is h(u, v) = a + b u + c v + d u v; along the piece u and v are linear in its
/// parameter t, so altitude minus surface is a quadratic in t, whose least value is at an end or at
/// its vertex. Nothing is sampled. The share below `low_height_m` comes from the roots of the same
/// quadratics.
///
/// Both ends must be finite.
/// @note  O(patches crossed). Pure.
Sweep sweep_surface(const raster::Grid<float>& surface_m, const PathPoint& from,
                    const PathPoint& to, double low_height_m);

}  // namespace hedgehop::verification
