#include "geo/vertical_datum.hpp"

#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/angles.hpp"
#include "base/errors.hpp"

namespace hedgehop::geo {
namespace {

using testing::AllOf;
using testing::HasSubstr;

GeodeticPosition at_deg(double latitude, double longitude) {
  return {radians_from_degrees(latitude), radians_from_degrees(longitude)};
}

GeodeticBox around_deg(double latitude, double longitude) {
  return {radians_from_degrees(longitude - 0.1), radians_from_degrees(latitude - 0.1),
          radians_from_degrees(longitude + 0.1), radians_from_degrees(latitude + 0.1)};
}

TEST(VerticalDatum, NamesAndCodesMeanTheSame) {
  EXPECT_EQ(VerticalDatum::parse("egm96").epsg_code, 5773);
  EXPECT_EQ(VerticalDatum::parse("EPSG:5773").name, "EGM96");
  EXPECT_EQ(VerticalDatum::parse("EPSG:3855").name, "EGM2008");
  EXPECT_EQ(VerticalDatum::parse("Ellipsoid"), VerticalDatum::parse("EPSG:4979"));
  EXPECT_EQ(VerticalDatum::parse("epsg:5703").name, "EPSG:5703");
}

TEST(VerticalDatum, RefusesWhatIsNone) {
  for (const char* text : {"", "EGM", "EPSG:", "EPSG:0", "EPSG:-1", "EPSG:4326", "EPSG:32632",
                           "EPSG:5773x", "EPSG:99999999999", "sea"}) {
    EXPECT_THROW((void)VerticalDatum::parse(text), UsageError) << text;
  }
}

TEST(VerticalShift, GeoidHeightIsThatOfTheModel) {
  const VerticalShift shift(VerticalDatum::parse("EGM96"), VerticalDatum::parse("ellipsoid"),
                            around_deg(51.5, 10.5));
  // EGM96's undulation at 51.5 N, 10.5 E: 45.86 m.
  EXPECT_NEAR(shift.at_m(at_deg(51.5, 10.5)), 45.86, 0.01);
  const VerticalShift back(VerticalDatum::parse("ellipsoid"), VerticalDatum::parse("EGM96"),
                           around_deg(51.5, 10.5));
  EXPECT_EQ(back.at_m(at_deg(51.5, 10.5)), -shift.at_m(at_deg(51.5, 10.5)));
  EXPECT_FALSE(shift.operation().empty());
}

TEST(VerticalShift, AMissingGridIsNamedAndNeverTakenForNoShift) {
  try {
    const VerticalShift shift(VerticalDatum::parse("EGM2008"), VerticalDatum::parse("EGM96"),
                              around_deg(51.5, 10.5));
    // The grid is installed here: the models differ by less than two metres, hardly by nothing.
    EXPECT_LT(std::fabs(shift.at_m(at_deg(51.5, 10.5))), 3.0);
    EXPECT_NE(shift.at_m(at_deg(51.5, 10.5)), 0.0);
  } catch (const DataError& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("EGM2008"), HasSubstr("us_nga_egm08_25"),
                                    HasSubstr("not installed")));
    EXPECT_THAT(error.hint(), AllOf(HasSubstr("put it into /"), HasSubstr("datum=")));
  }
}

TEST(VerticalShift, WhatHasNoWayIsRefused) {
  // A Dutch datum in Germany's middle.
  EXPECT_THROW(VerticalShift(VerticalDatum::parse("EPSG:5709"), VerticalDatum::parse("EGM96"),
                             around_deg(-30.0, -60.0)),
               DataError);
}

}  // namespace
}  // namespace hedgehop::geo
