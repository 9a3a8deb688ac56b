#pragma once

#include "verification/surface_sweep.hpp"

namespace hedgehop::verification {

/// Distance between a straight piece of path and the curtain below an overhead span [m].
///
/// The conductor is taken as the straight line between the tops of two supports. A real one sags
/// below it, so all that lies under that line counts as wire: the distance is to the nearest point
/// of the vertical curtain that hangs from it without end. It is 0 for a path that passes through,
/// under or along the span. An infinite top altitude is allowed at both tops together (unknown
/// height).
///
/// Closed form: the curtain and the piece are convex. Either the nearest points have the horizontal
/// distance of the two (then some nearest pair lies at or below the conductor), or the nearest
/// point of the curtain is on the conductor itself.
double distance_to_span_m(const PathPoint& from, const PathPoint& to, const PathPoint& top_a,
                          const PathPoint& top_b);

}  // namespace hedgehop::verification
