#include "geo/geodesic.hpp"

#include <geodesic.h>

#include "base/angles.hpp"

namespace hedgehop::geo {
namespace {

const geod_geodesic& wgs84() {
  static const geod_geodesic kEllipsoid = [] {
    geod_geodesic ellipsoid;
    geod_init(&ellipsoid, 6378137.0, 1.0 / 298.257223563);
    return ellipsoid;
  }();
  return kEllipsoid;
}

}  // namespace

Geodesic geodesic_between(const GeodeticPosition& from, const GeodeticPosition& to) {
  double distance_m = 0.0;
  double azimuth_deg = 0.0;
  geod_inverse(&wgs84(), degrees_from_radians(from.latitude_rad),
               degrees_from_radians(from.longitude_rad), degrees_from_radians(to.latitude_rad),
               degrees_from_radians(to.longitude_rad), &distance_m, &azimuth_deg, nullptr);
  return {distance_m, wrap_to_two_pi(radians_from_degrees(azimuth_deg))};
}

GeodeticPosition geodesic_end(const GeodeticPosition& from, double azimuth_rad, double distance_m) {
  double latitude_deg = 0.0;
  double longitude_deg = 0.0;
  geod_direct(&wgs84(), degrees_from_radians(from.latitude_rad),
              degrees_from_radians(from.longitude_rad), degrees_from_radians(azimuth_rad),
              distance_m, &latitude_deg, &longitude_deg, nullptr);
  return {radians_from_degrees(latitude_deg), radians_from_degrees(longitude_deg)};
}

}  // namespace hedgehop::geo
