#include "geo/map_projection.hpp"

#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "base/errors.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::geo {
namespace {

GeodeticPosition at_deg(double latitude_deg, double longitude_deg) {
  return {radians_from_degrees(latitude_deg), radians_from_degrees(longitude_deg)};
}

// Length of the meridian from the equator, by adding up M(phi) dphi: independent of any projection
// code.
double meridian_length_m(double latitude_rad) {
  const double e2 = 0.00669437999014;
  const int steps = 20000;
  double sum = 0.0;
  for (int i = 0; i < steps; ++i) {
    const double s = std::sin(latitude_rad * (i + 0.5) / steps);
    sum += 6378137.0 * (1.0 - e2) / std::pow(1.0 - e2 * s * s, 1.5);
  }
  return sum * latitude_rad / steps;
}

TEST(MapProjection, OnTheCentralMeridianUtmIsTheScaledMeridianLength) {
  const MapProjection projection("EPSG:32632");
  for (const double latitude_deg : {1.0, 24.7, 49.99, 71.0}) {
    const MapPoint point = projection.to_map(at_deg(latitude_deg, 9.0));
    EXPECT_NEAR(point.x_m, 500000.0, 1e-3);
    EXPECT_NEAR(point.y_m, 0.9996 * meridian_length_m(radians_from_degrees(latitude_deg)), 2e-3);
  }
}

TEST(MapProjection, EastIsXAndNorthIsYWhateverTheOrderOfTheAuthority) {
  // EPSG:3035 is defined as (north, east).
  const MapProjection projection("EPSG:3035");
  const MapPoint here = projection.to_map(at_deg(50.0, 11.5));
  EXPECT_GT(projection.to_map(at_deg(50.0, 11.6)).x_m, here.x_m + 7000.0);
  EXPECT_GT(projection.to_map(at_deg(50.1, 11.5)).y_m, here.y_m + 11000.0);
}

TEST(MapProjection, ThereAndBackIsTheSamePlaceWithinAMillimetre) {
  std::random_device device;
  const unsigned seed = device();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> x_m(200000.0, 800000.0);
  std::uniform_real_distribution<double> y_m(100000.0, 8000000.0);
  const MapProjection projection("EPSG:32651");
  for (int i = 0; i < 300; ++i) {
    const MapPoint point{x_m(random), y_m(random)};
    const MapPoint back = projection.to_map(projection.to_geodetic(point));
    EXPECT_NEAR(back.x_m, point.x_m, 1.1e-3);
    EXPECT_NEAR(back.y_m, point.y_m, 1.1e-3);
    EXPECT_EQ(back.x_m, std::round(back.x_m * 1000.0) / 1000.0);
  }
}

TEST(MapProjection, ConvergenceFollowsTheClosedFormAndItsSign) {
  // gamma = atan(tan(lambda - lambda0) sin(phi)) on the sphere; on the ellipsoid the difference is
  // of order e'^2 lambda^3: below 3e-6 rad within 3 degrees of the central meridian.
  const MapProjection projection("EPSG:32632");
  for (const double longitude_deg : {6.5, 8.0, 9.0, 10.3, 11.6}) {
    for (const double latitude_deg : {5.0, 24.7, 50.0, 70.0}) {
      const MapPoint point = projection.to_map(at_deg(latitude_deg, longitude_deg));
      const double expected_rad = std::atan(std::tan(radians_from_degrees(longitude_deg - 9.0)) *
                                            std::sin(radians_from_degrees(latitude_deg)));
      EXPECT_NEAR(projection.convergence_rad(point), expected_rad, 3e-6);
    }
  }
}

// What convergence_rad() says it is, from the positions of two places 1 km apart: here worked out
// for each place by the projection itself.
double convergence_from_positions_rad(const MapProjection& projection, const MapPoint& point) {
  const GeodeticPosition south = projection.to_geodetic({point.x_m, point.y_m - 500.0});
  const GeodeticPosition north = projection.to_geodetic({point.x_m, point.y_m + 500.0});
  const double latitude_rad = 0.5 * (south.latitude_rad + north.latitude_rad);
  const double flattening = 1.0 / 298.257223563;
  const double e2 = flattening * (2.0 - flattening);
  const double sine = elementary::sin(latitude_rad);
  const double w2 = 1.0 - e2 * sine * sine;
  const double prime_vertical_m = 6378137.0 / std::sqrt(w2);
  const double meridian_m = prime_vertical_m * (1.0 - e2) / w2;
  const double north_m = meridian_m * (north.latitude_rad - south.latitude_rad);
  const double east_m = prime_vertical_m * elementary::cos(latitude_rad) *
                        wrap_to_pi(north.longitude_rad - south.longitude_rad);
  return std::round(elementary::atan2(east_m, north_m) * 1e9) / 1e9;
}

// The last bit of a position decides 6e-8 rad of the convergence, so that this would show one.
TEST(MapProjection, ConvergenceHasTheSameBitsForManyPlacesNearEachOtherAsForEachAlone) {
  std::mt19937_64 random(test::fresh_seed());
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  struct Region {
    const char* crs;
    double latitude_deg, longitude_deg;
  };
  for (const Region& region : {Region{"EPSG:32632", 50.0, 11.5}, Region{"EPSG:32651", 24.8, 121.0},
                               Region{"EPSG:32633", 71.0, 25.0}, Region{"EPSG:3035", 40.0, -5.0},
                               Region{"EPSG:3034", 60.0, 20.0}, Region{"EPSG:32760", -18.0, 179.97},
                               Region{"EPSG:32661", 89.99, 30.0}, Region{"EPSG:3857", 48.0, 8.0},
                               Region{"EPSG:2056", 46.8, 8.2}}) {
    const MapProjection projection(region.crs);
    const MapPoint middle = projection.to_map(at_deg(region.latitude_deg, region.longitude_deg));
    for (int i = 0; i < 4000; ++i) {
      const MapPoint point{middle.x_m + between(-4000.0, 4000.0),
                           middle.y_m + between(-4000.0, 4000.0)};
      ASSERT_EQ(projection.convergence_rad(point),
                convergence_from_positions_rad(projection, point))
          << region.crs << " at " << point.x_m << ", " << point.y_m;
    }
  }
}

TEST(MapProjection, KnowsItsCodeAndItsWktOpensTheSameProjection) {
  const MapProjection projection("EPSG:32632");
  EXPECT_EQ(projection.code(), "EPSG:32632");
  EXPECT_THAT(projection.wkt(), testing::StartsWith("PROJCRS["));
  EXPECT_EQ(projection.wkt().find('\n'), std::string::npos);
  const MapProjection again(projection.wkt());
  EXPECT_EQ(again.wkt(), projection.wkt());
  EXPECT_EQ(again.code(), "EPSG:32632");
  EXPECT_EQ(again.to_map(at_deg(50.0, 11.0)).x_m, projection.to_map(at_deg(50.0, 11.0)).x_m);
  EXPECT_EQ(MapProjection("+proj=tmerc +lat_0=24 +lon_0=121 +datum=WGS84 +units=m").code(), "");
}

TEST(MapProjection, RefusesWhatIsNotAMetricProjection) {
  EXPECT_THROW(MapProjection("EPSG:4326"), DataError);
  EXPECT_THROW(MapProjection("EPSG:2225"), DataError);  // US survey feet
  EXPECT_THROW(MapProjection("no such thing"), DataError);
  EXPECT_THROW(MapProjection(""), DataError);
  EXPECT_THROW(MapProjection("/etc/passwd"), DataError);
}

TEST(MapProjection, RefusesPlacesOutsideTheGlobeOrTheProjection) {
  const MapProjection projection("EPSG:32632");
  EXPECT_THROW((void)projection.to_map(at_deg(91.0, 9.0)), DataError);
  EXPECT_THROW((void)projection.to_map(at_deg(std::nan(""), 9.0)), DataError);
  EXPECT_THROW((void)projection.to_map(at_deg(0.0, 9.0 + 90.0)), DataError);
  EXPECT_THROW((void)projection.to_geodetic({1e12, 0.0}), DataError);
  EXPECT_THROW((void)projection.to_geodetic({std::nan(""), 0.0}), DataError);
}

TEST(UtmCode, FollowsTheZonesWithTheExceptionsOfNorwayAndSvalbard) {
  EXPECT_EQ(utm_code(at_deg(50.0, 11.5)), "EPSG:32632");
  EXPECT_EQ(utm_code(at_deg(50.0, 12.0)), "EPSG:32633");
  EXPECT_EQ(utm_code(at_deg(24.7, 121.1)), "EPSG:32651");
  EXPECT_EQ(utm_code(at_deg(-33.9, 18.4)), "EPSG:32734");
  EXPECT_EQ(utm_code(at_deg(0.0, -180.0)), "EPSG:32601");
  EXPECT_EQ(utm_code(at_deg(0.0, 180.0)), "EPSG:32601");
  EXPECT_EQ(utm_code(at_deg(60.4, 5.3)), "EPSG:32632");  // Bergen lies east of 3 E: zone 32
  EXPECT_EQ(utm_code(at_deg(60.4, 2.9)), "EPSG:32631");
  EXPECT_EQ(utm_code(at_deg(64.0, 5.3)), "EPSG:32631");
  EXPECT_EQ(utm_code(at_deg(78.2, 8.9)), "EPSG:32631");
  EXPECT_EQ(utm_code(at_deg(78.2, 9.0)), "EPSG:32633");
  EXPECT_EQ(utm_code(at_deg(78.2, 15.6)), "EPSG:32633");  // Longyearbyen
  EXPECT_EQ(utm_code(at_deg(78.2, 21.0)), "EPSG:32635");
  EXPECT_EQ(utm_code(at_deg(78.2, 33.0)), "EPSG:32637");
  EXPECT_EQ(utm_code(at_deg(78.2, 42.0)), "EPSG:32638");
  EXPECT_THROW(utm_code(at_deg(84.0, 0.0)), DataError);
  EXPECT_THROW(utm_code(at_deg(-80.1, 0.0)), DataError);
}

}  // namespace
}  // namespace hedgehop::geo
