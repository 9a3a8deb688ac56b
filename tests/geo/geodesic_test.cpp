#include "geo/geodesic.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <random>

#include "base/angles.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::geo {
namespace {

GeodeticPosition at_deg(double latitude, double longitude) {
  return {radians_from_degrees(latitude), radians_from_degrees(longitude)};
}

TEST(Geodesic, AMeridianAndTheEquatorHaveTheirKnownLengths) {
  // A quarter of a WGS 84 meridian is 10001965.729 m, a degree of the equator 2 pi a / 360.
  EXPECT_NEAR(geodesic_between(at_deg(0.0, 7.0), at_deg(90.0, 7.0)).distance_m, 10001965.729, 0.01);
  const Geodesic east = geodesic_between(at_deg(0.0, 7.0), at_deg(0.0, 8.0));
  EXPECT_NEAR(east.distance_m, kTwoPi * 6378137.0 / 360.0, 1e-6);
  EXPECT_NEAR(east.azimuth_rad, 0.25 * kTwoPi, 1e-12);
  EXPECT_NEAR(geodesic_between(at_deg(10.0, 7.0), at_deg(9.0, 7.0)).azimuth_rad, 0.5 * kTwoPi,
              1e-12);
}

TEST(Geodesic, TheEndLiesWhereTheWayBackSays) {
  std::mt19937_64 random(test::fresh_seed());
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (int round = 0; round < 200; ++round) {
    const GeodeticPosition from = at_deg(uniform(-80.0, 80.0), uniform(-170.0, 170.0));
    const double azimuth_rad = uniform(0.0, kTwoPi);
    const double distance_m = uniform(10.0, 100'000.0);
    const Geodesic back = geodesic_between(from, geodesic_end(from, azimuth_rad, distance_m));
    EXPECT_NEAR(back.distance_m, distance_m, 1e-6);
    EXPECT_NEAR(wrap_to_pi(back.azimuth_rad - azimuth_rad), 0.0, 1e-8);
  }
}

}  // namespace
}  // namespace hedgehop::geo
