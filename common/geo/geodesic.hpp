#pragma once

#include "geo/map_projection.hpp"

namespace hedgehop::geo {

/// Shortest way between two places on the WGS 84 ellipsoid.
struct Geodesic {
  double distance_m = 0.0;
  double azimuth_rad = 0.0;  // at the start, from true north, clockwise, [0, 2 pi)
};
Geodesic geodesic_between(const GeodeticPosition& from, const GeodeticPosition& to);

/// Where one arrives that leaves a place in a direction and follows the geodesic [rad, m].
/// Source: C. F. F. Karney, "Algorithms for geodesics", J. Geod. 87, 2013,
/// doi:10.1007/s00190-012-0578-z, as in PROJ; exact to nanometres.
GeodeticPosition geodesic_end(const GeodeticPosition& from, double azimuth_rad, double distance_m);

}  // namespace hedgehop::geo
