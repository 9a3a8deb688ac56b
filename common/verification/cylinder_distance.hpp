#pragma once

#include "verification/surface_sweep.hpp"

namespace hedgehop::verification {

/// An upright cylinder without bottom.
struct Cylinder {
  double x_m = 0.0;
  double y_m = 0.0;
  double radius_m = 0.0;
  double top_m = 0.0;  // AMSL; +infinity: without top
};

/// Distance between a straight piece of path and a cylinder [m], 0 if it passes through.
///
/// Distance to a convex body is a convex function along the piece, whose least value is bracketed
/// by golden section down to a length of 1e-6 m; what is left of the bracket is taken off, so that
/// the result is never too great, and too small by at most 1e-6 m.
double distance_to_cylinder_m(const PathPoint& from, const PathPoint& to, const Cylinder& cylinder);

}  // namespace hedgehop::verification
