#include "map_sources/open_air.hpp"

#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <limits>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "geo/geodesic.hpp"

namespace hedgehop::map_sources {
namespace {

using testing::HasSubstr;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kFoot_m = 0.3048;

std::string refusal_of(const std::string& text) {
  try {
    (void)parse_open_air(text, "file");
  } catch (const DataError& error) {
    EXPECT_NE(error.hint(), "") << error.what();
    return error.what();
  }
  return "";
}

double degrees(double angle_rad) { return degrees_from_radians(angle_rad); }

TEST(AltitudeLimits, AreReadAsPublicationsWriteThem) {
  const auto limit = [](const char* text) {
    const auto value = altitude_limit_in(text, kFoot_m);
    EXPECT_TRUE(value) << text;
    return value.value_or(AltitudeLimit{-1.0, false});
  };
  EXPECT_NEAR(limit("FL 95").value_m, 9500 * kFoot_m, 1e-9);
  EXPECT_FALSE(limit("FL 95").is_above_ground);
  EXPECT_NEAR(limit("fl095").value_m, 9500 * kFoot_m, 1e-9);
  EXPECT_EQ(limit("2500 ft MSL"), (AltitudeLimit{2500 * kFoot_m, false}));
  EXPECT_EQ(limit("2500ft"), (AltitudeLimit{2500 * kFoot_m, false}));
  EXPECT_EQ(limit("4500"), (AltitudeLimit{4500 * kFoot_m, false}));
  EXPECT_EQ(limit("1500MSL"), (AltitudeLimit{1500 * kFoot_m, false}));
  EXPECT_EQ(limit("1500FT AGL"), (AltitudeLimit{1500 * kFoot_m, true}));
  EXPECT_EQ(limit("1000 GND"), (AltitudeLimit{1000 * kFoot_m, true}));
  EXPECT_EQ(limit("300 m AGL"), (AltitudeLimit{300.0, true}));
  EXPECT_EQ(limit("762M"), (AltitudeLimit{762.0, false}));
  EXPECT_EQ(limit("1200 m AMSL"), (AltitudeLimit{1200.0, false}));
  EXPECT_EQ(limit("-300 ft"), (AltitudeLimit{-300 * kFoot_m, false}));
  EXPECT_EQ(limit("GND"), (AltitudeLimit{-kInfinity, true}));
  EXPECT_EQ(limit("Sfc"), (AltitudeLimit{-kInfinity, true}));
  EXPECT_EQ(limit("UNL"), (AltitudeLimit{kInfinity, false}));
  for (const char* wrong : {"", "FL", "Ask on 122.8", "12 km", "MSL", "1500 ft AGL or so", "FL-10",
                            "1e9 ft", "nan", "100000000", "FL95 AGL"}) {
    EXPECT_FALSE(altitude_limit_in(wrong, kFoot_m)) << wrong;
  }
  EXPECT_FALSE(altitude_limit_in("1500", 0.0));
  EXPECT_FALSE(altitude_limit_in("1500 MSL", 0.0));
  EXPECT_EQ(altitude_limit_in("0", 0.0), (AltitudeLimit{0.0, false}));
}

TEST(OpenAir, PolygonsWithTheirNamesClassesAndLimits) {
  const auto areas = parse_open_air(
      "\xef\xbb\xbf* comment\r\n"
      "AC R\r\n"
      "AN ED-R 1 * not a comment\r\n"
      "AH 5000 ft MSL * that is one\r\n"
      "AL GND\r\n"
      "AY TRA\r\n"
      "SP 0,1,0,0,255\r\n"
      "V Z=100\r\n"
      "DP 50:00:00 N 011:00:00 E\r\n"
      "DP 50:30.5N 11:00:36E\r\n"
      "dp 50:30:30 N 012:00:00.5 W\r\n"
      "DP 50:00:00 N 011:00:00 E\r\n"
      "\r\n"
      "AC CTR\r\n"
      "AN second\r\n"
      "DP 10:00:00 S 011:00:00 E\r\n"
      "DP 11.5 S 011:00:00 E\r\n"
      "DP 11:00:00 S 012:00:00 E",
      "f");
  ASSERT_EQ(areas.size(), 2U);
  EXPECT_EQ(areas[0].line, 2);
  EXPECT_EQ(areas[0].kind, "R");
  EXPECT_EQ(areas[0].name, "ED-R 1 * not a comment");
  EXPECT_EQ(areas[0].floor, (AltitudeLimit{-kInfinity, true}));
  EXPECT_EQ(areas[0].ceiling, (AltitudeLimit{5000 * kFoot_m, false}));
  ASSERT_EQ(areas[0].outline.size(), 3U);  // the last corner repeats the first
  EXPECT_NEAR(degrees(areas[0].outline[1].latitude_rad), 50.0 + 30.5 / 60.0, 1e-12);
  EXPECT_NEAR(degrees(areas[0].outline[1].longitude_rad), 11.01, 1e-12);
  EXPECT_NEAR(degrees(areas[0].outline[2].longitude_rad), -(12.0 + 0.5 / 3600.0), 1e-12);
  EXPECT_EQ(areas[1].kind, "CTR");
  EXPECT_EQ(areas[1].ceiling.value_m, kInfinity);
  EXPECT_NEAR(degrees(areas[1].outline[1].latitude_rad), -11.5, 1e-12);
}

TEST(OpenAir, ACircleRunsAroundItsCentreWithinAMetre) {
  const auto areas = parse_open_air("AC P\nV X=50:00:00 N 011:00:00 E\nDC 5.5\n", "f");
  const geo::GeodeticPosition centre{radians_from_degrees(50.0), radians_from_degrees(11.0)};
  const auto& outline = areas.at(0).outline;
  ASSERT_GT(outline.size(), 20U);
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const geo::Geodesic way = geo::geodesic_between(centre, outline[i]);
    EXPECT_NEAR(way.distance_m, 5.5 * 1852.0, 1e-6);
    const geo::Geodesic chord =
        geo::geodesic_between(outline[i], outline[(i + 1) % outline.size()]);
    const double half_m = 0.5 * chord.distance_m;
    const double radius_m = 5.5 * 1852.0;
    EXPECT_LT(radius_m - std::sqrt(radius_m * radius_m - half_m * half_m), 1.0);
  }
}

TEST(OpenAir, ArcsGoTheWayTheyAreTold) {
  const std::string centre = "AC R\nV X=50:00:00 N 011:00:00 E\n";
  const auto azimuths = [](const std::string& text) {
    const auto areas = parse_open_air(text, "f");
    const geo::GeodeticPosition middle{radians_from_degrees(50.0), radians_from_degrees(11.0)};
    std::vector<double> result;
    for (const auto& corner : areas.at(0).outline) {
      result.push_back(degrees(geo::geodesic_between(middle, corner).azimuth_rad));
    }
    return result;
  };
  // Clockwise from 350 to 20 degrees is 30 degrees, the other way 330.
  const auto right = azimuths(centre + "DA 2,350,20\n");
  EXPECT_NEAR(right.front(), 350.0, 1e-6);
  EXPECT_NEAR(right.back(), 20.0, 1e-6);
  for (const double azimuth : right) {
    EXPECT_TRUE(azimuth > 349.9 || azimuth < 20.1) << azimuth;
  }
  const auto left = azimuths(centre + "V D=-\nDA 2,350,20\n");
  EXPECT_NEAR(left.front(), 350.0, 1e-6);
  EXPECT_NEAR(left.back(), 20.0, 1e-6);
  for (const double azimuth : left) {
    EXPECT_TRUE(azimuth > 19.9 && azimuth < 350.1) << azimuth;
  }
  EXPECT_GT(left.size(), 8 * right.size());
  // Between two places: north and east of the centre; the direction is + again in the next area.
  const std::string ends = "DB 50:05:00 N 011:00:00 E, 50:00:00 N 011:07:46 E\n";
  for (const double azimuth : azimuths(centre + ends)) {
    EXPECT_TRUE(azimuth < 90.2 || azimuth > 359.9) << azimuth;
  }
  const auto areas = parse_open_air(centre + "V D=-\n" + ends + centre + ends, "f");
  EXPECT_GT(areas.at(0).outline.size(), 2 * areas.at(1).outline.size());
}

TEST(OpenAir, WhatCannotBeReadIsRefusedWithItsLine) {
  const std::string good =
      "AC R\nDP 50:00:00 N 011:00:00 E\nDP 50:30:00 N 011:00:00 E\nDP 50:30:00 N 012:00:00 E\n";
  EXPECT_EQ(refusal_of(good), "");
  EXPECT_THAT(refusal_of(good + "AL somewhere\n"), HasSubstr("file:5: the altitude 'somewhere'"));
  EXPECT_THAT(refusal_of(good + "DP 50:61:00 N 011:00:00 E\n"), HasSubstr("file:5:"));
  EXPECT_THAT(refusal_of(good + "DP 91:00:00 N 011:00:00 E\n"), HasSubstr("file:5:"));
  EXPECT_THAT(refusal_of(good + "DP 50:00:00 N\n"), HasSubstr("cannot be read"));
  EXPECT_THAT(refusal_of(good + "DC 5\n"), HasSubstr("before its centre"));
  EXPECT_THAT(refusal_of(good + "DY 50:00:00 N 011:00:00 E\n"), HasSubstr("airways"));
  EXPECT_THAT(refusal_of(good + "XX what\n"), HasSubstr("'XX what' cannot be read"));
  EXPECT_THAT(refusal_of(good + "V X=50:00:00 N 011:00:00 E\nDC 0\n"), HasSubstr("radius"));
  EXPECT_THAT(refusal_of(good + "V X=50:00:00 N 011:00:00 E\nDA 1,5\n"), HasSubstr("file:6"));
  EXPECT_THAT(refusal_of("DP 50:00:00 N 011:00:00 E\n"), HasSubstr("before the first AC"));
  EXPECT_THAT(refusal_of("AC R\nAN a\n"), HasSubstr("file:1: area 'a' has fewer than three"));
  EXPECT_THAT(refusal_of(good + "AL 5000 ft\nAH 1000 ft\n"), HasSubstr("ends below"));
}

}  // namespace
}  // namespace hedgehop::map_sources
