#include "map_sources/obstacle_file.hpp"

#include <cmath>
#include <fstream>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "support/temporary_folder.hpp"

namespace hedgehop::map_sources {
namespace {

using testing::HasSubstr;

std::string refusal_of(const std::string& text) {
  try {
    (void)parse_obstacles(text, "file");
  } catch (const DataError& error) {
    EXPECT_NE(error.hint(), "") << error.what();
    return error.what();
  }
  return "";
}

// One entry in the FAA's columns, written from its table of columns.
std::string dat_line(const std::string& latitude, const std::string& longitude, int agl_ft,
                     int amsl_ft, char horizontal, char vertical, char action = 'A',
                     const std::string& type = "TOWER", char status = 'O') {
  std::string line(128, ' ');
  const auto put = [&](std::size_t column, const std::string& text) {
    line.replace(column - 1, text.size(), text);
  };
  const auto number = [](int value) {
    char text[16];
    std::snprintf(text, sizeof text, value < 0 ? "%06d" : "%05d", value);
    return std::string(text).substr(0, 5);
  };
  put(1, "08-000123");
  put(11, std::string(1, status));
  put(13, "US CO");
  put(19, "SOMEWHERE");
  put(36, latitude);
  put(49, longitude);
  put(63, type);
  put(82, "1");
  put(84, number(agl_ft));
  put(90, number(amsl_ft));
  put(96, "N");
  put(98, std::string(1, horizontal));
  put(100, std::string(1, vertical));
  put(102, "N");
  put(104, "2001ANM00001OE");
  put(119, std::string(1, action));
  put(121, "2020123");
  return line;
}

constexpr char kDatHeader[] =
    "  CURRENCY DATE = 01/02/26\r\n"
    "                                     LATITUDE    LONGITUDE     OBSTACLE            AGL   "
    "AMSL\r\n"
    "OAS#      V CO ST CITY            DEG MIN SEC   DEG MIN SEC   TYPE                 HT    "
    "HT\r\n"
    "-------------------------------------------------------------------------------------------"
    "\r\n";

TEST(DofColumns, EachFieldComesFromItsColumns) {
  const auto records = parse_obstacles(
      std::string(kDatHeader) + dat_line("37 00 26.20N", "103 51 59.90W", 256, 6541, '5', 'E') +
          "\r\n" +
          dat_line("12 30 00.00S", "000 15 30.00E", 90, 12, '1', 'A', 'C', "WINDMILL", 'U') +
          "\r\n",
      "DOF.DAT");
  ASSERT_EQ(records.size(), 2U);
  EXPECT_EQ(records[0].line, 5);
  EXPECT_EQ(records[0].kind, StructureKind::kTower);
  EXPECT_EQ(records[0].name, "08-000123 TOWER SOMEWHERE");
  EXPECT_NEAR(degrees_from_radians(records[0].position.latitude_rad), 37.0 + 26.2 / 3600.0, 1e-12);
  EXPECT_NEAR(degrees_from_radians(records[0].position.longitude_rad),
              -(103.0 + 51.0 / 60.0 + 59.9 / 3600.0), 1e-12);
  EXPECT_NEAR(*records[0].height_m, 256 * 0.3048, 1e-9);
  EXPECT_NEAR(*records[0].top_m, 6541 * 0.3048, 1e-9);
  EXPECT_NEAR(*records[0].horizontal_error_m, 500 * 0.3048, 1e-9);
  EXPECT_NEAR(*records[0].vertical_error_m, 125 * 0.3048, 1e-9);
  EXPECT_TRUE(records[0].is_verified);
  EXPECT_EQ(records[1].kind, StructureKind::kWindTurbine);
  EXPECT_NEAR(degrees_from_radians(records[1].position.latitude_rad), -12.5, 1e-12);
  EXPECT_NEAR(*records[1].horizontal_error_m, 20 * 0.3048, 1e-9);
  EXPECT_NEAR(*records[1].vertical_error_m, 3 * 0.3048, 1e-9);
  EXPECT_FALSE(records[1].is_verified);
}

TEST(DofColumns, AccuracyCodesWidenAsTheFaaSays) {
  const double expected_m[] = {6.096, 15.24, 30.48, 76.2, 152.4, 304.8, 926.0, 1852.0};
  for (int code = 1; code <= 8; ++code) {
    const auto records = parse_obstacles(
        dat_line("37 00 00.00N", "103 00 00.00W", 100, 200, static_cast<char>('0' + code), 'B'),
        "f");
    EXPECT_NEAR(*records.at(0).horizontal_error_m, expected_m[code - 1], 1e-9) << code;
  }
  const auto unknown =
      parse_obstacles(dat_line("37 00 00.00N", "103 00 00.00W", 100, 200, '9', 'I'), "f");
  EXPECT_FALSE(unknown.at(0).horizontal_error_m);
  EXPECT_FALSE(unknown.at(0).vertical_error_m);
  EXPECT_FALSE(parse_obstacles(dat_line("37 00 00.00N", "103 00 00.00W", 100, 200, ' ', ' '), "f")
                   .at(0)
                   .horizontal_error_m);
}

TEST(DofColumns, DismantledEntriesAreLeftOutAndNothingElse) {
  const std::string kept = dat_line("37 00 00.00N", "103 00 00.00W", 100, 200, '1', 'A', 'C');
  const std::string gone = dat_line("37 00 00.00N", "103 00 00.00W", 100, 200, '1', 'A', 'D');
  EXPECT_EQ(parse_obstacles(kept + "\n" + gone + "\n\n" + kept, "f").size(), 2U);
}

TEST(DofColumns, ADamagedLineIsRefusedWithItsNumber) {
  const std::string good = dat_line("37 00 00.00N", "103 00 00.00W", 100, 200, '1', 'A');
  std::string bad = good;
  bad.replace(83, 5, "1x000");
  EXPECT_THAT(refusal_of(good + "\n" + bad), HasSubstr("file:2: height in columns 84 to 88"));
  bad = good;
  bad.replace(35, 2, "97");
  EXPECT_THAT(refusal_of(bad), HasSubstr("file:1: latitude in columns 36 to 37"));
  bad = good;
  bad[46] = 'X';
  EXPECT_THAT(refusal_of(bad), HasSubstr("latitude ends in 'X'"));
  bad = good;
  bad[97] = '0';
  EXPECT_THAT(refusal_of(bad), HasSubstr("horizontal accuracy code '0'"));
  EXPECT_THAT(refusal_of(good + "\n" + good.substr(0, 90)), HasSubstr("file:2: has 90 columns"));
  EXPECT_THAT(refusal_of(good + "\nsomething else"), HasSubstr("file:2: does not begin with"));
  EXPECT_THAT(refusal_of("  CURRENCY DATE = 01/02/26\n" + good), HasSubstr("has no end"));
}

TEST(ObstacleCsv, TheFaasOwnCsvIsInFeet) {
  const auto records = parse_obstacles(
      "OAS,VERIFIED STATUS,COUNTRY,STATE,CITY,LATDEC,LONDEC,DMSLAT,DMSLON,TYPE,QUANTITY,AGL,AMSL,"
      "LIGHTING,ACCURACY,MARKING,FAA STUDY,ACTION,JDATE\r\n"
      "08-000001,O,US,CO,DENVER          ,39.500000,-104.250000,39 30 00.00N,104 15 00.00W,"
      "STACK             ,1,00100,-0166,N, 2C,N,2011ANE00000OE,A,2012268 \r\n"
      "08-000002,U,US,CO,DENVER,39.6,-104.3,,,TOWER,1,00200,06000,N,4D,N,,D,2012268\r\n"
      "08-000003,U,US,CO,DENVER,39.7,-104.4,,,TOWER,1,00300,06000,N,,N,,C,2012268\r\n",
      "f.csv");
  ASSERT_EQ(records.size(), 2U);
  EXPECT_EQ(records[0].kind, StructureKind::kChimney);
  EXPECT_NEAR(degrees_from_radians(records[0].position.longitude_rad), -104.25, 1e-12);
  EXPECT_NEAR(*records[0].height_m, 30.48, 1e-9);
  EXPECT_NEAR(*records[0].top_m, -166 * 0.3048, 1e-9);
  EXPECT_NEAR(*records[0].horizontal_error_m, 15.24, 1e-9);
  EXPECT_NEAR(*records[0].vertical_error_m, 6.096, 1e-9);
  EXPECT_EQ(records[1].name, "08-000003");
  EXPECT_FALSE(records[1].is_verified);
  EXPECT_FALSE(records[1].horizontal_error_m);
}

TEST(ObstacleCsv, PlainColumnsInAnyOrderWithQuotesAndDecimalCommas) {
  const auto records = parse_obstacles(
      "\xef\xbb\xbfName;Type;Height_m;Latitude;Longitude;horizontal_error_m;radius_m;remark\n"
      "\"Sender \"\"A\"\"; old\";Antenna;\"120,5\";49,95;11,5;3;2;\"two\nlines\"\n"
      "\n"
      "b;silo;30;50,0;11,6;;;",
      "f");
  ASSERT_EQ(records.size(), 2U);
  EXPECT_EQ(records[0].name, "Sender \"A\"; old");
  EXPECT_EQ(records[0].kind, StructureKind::kMast);
  EXPECT_EQ(*records[0].height_m, 120.5);
  EXPECT_FALSE(records[0].top_m);
  EXPECT_EQ(records[0].radius_m, 2.0);
  EXPECT_EQ(*records[0].horizontal_error_m, 3.0);
  EXPECT_EQ(records[0].line, 2);
  EXPECT_EQ(records[1].line, 5);
  EXPECT_FALSE(records[1].horizontal_error_m);
}

TEST(ObstacleCsv, WhatCannotBeMeantIsRefusedWithItsLine) {
  EXPECT_THAT(refusal_of("lat,lon,height\n50,11,30\n"), HasSubstr("'height' states no unit"));
  EXPECT_THAT(refusal_of("lat,lon,name\n50,11,a\n"), HasSubstr("no column tells the height"));
  EXPECT_THAT(refusal_of("a,b\n1,2\n"), HasSubstr("has no column latitude_deg"));
  EXPECT_THAT(refusal_of(""), HasSubstr("empty"));
  EXPECT_THAT(refusal_of("lat,lon,height_m\n50,11,30\n50,11,tall\n"),
              HasSubstr("file:3: 'tall' in column 3 is not a number"));
  EXPECT_THAT(refusal_of("lat,lon,height_m\n50,11,\n"), HasSubstr("file:2: the height is missing"));
  EXPECT_THAT(refusal_of("lat,lon,height_m\n50\n"), HasSubstr("latitude or longitude is missing"));
  EXPECT_THAT(refusal_of("lat,lon,height_m\n91,11,30\n"), HasSubstr("not on the globe"));
  EXPECT_THAT(refusal_of("lat,lon,height_m\n50,11,-5\n"), HasSubstr("is not possible"));
  EXPECT_THAT(refusal_of("lat,lon,height_m\n50,11,nan\n"), HasSubstr("not a number"));
  EXPECT_THAT(refusal_of("lat,lon,height_m\n50,11,\"30\n"), HasSubstr("quoted field has no end"));
  EXPECT_THAT(refusal_of("lat,lon,height_m,accuracy\n50,11,30,7Z\n"), HasSubstr("accuracy code"));
}

TEST(ObstacleFiles, OnlyWhatMayReachTheRegionIsKept) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "a.csv";
  // 0.01 degrees of latitude are 1112 m.
  std::ofstream(path) << "lat,lon,height_m,horizontal_error_m\n"
                         "50.005,11.005,30,1\n"    // inside
                         "50.02,11.005,30,1\n"     // 1112 m north
                         "50.02,11.005,30,1300\n"  // the same, but it may stand inside
                         "-50.02,11.005,30,1\n";
  SilentObserver observer;
  const geo::MapProjection projection("EPSG:32632");
  const geo::GeodeticBox region{radians_from_degrees(11.0), radians_from_degrees(50.0),
                                radians_from_degrees(11.01), radians_from_degrees(50.01)};
  const ObstacleList list = read_obstacle_files({path}, projection, region, 10.0, observer);
  EXPECT_EQ(list.record_count, 4);
  ASSERT_EQ(list.obstacles.size(), 2U);
  EXPECT_EQ(list.obstacles[0].record.line, 2);
  EXPECT_EQ(list.obstacles[1].record.line, 4);
  EXPECT_EQ(list.unknown_accuracy_count, 2);  // vertically
  const geo::MapPoint expected = projection.to_map(list.obstacles[0].record.position);
  EXPECT_EQ(list.obstacles[0].point.x_m, expected.x_m);
  EXPECT_THROW(read_obstacle_files({folder.path() / "none"}, projection, region, 0.0, observer),
               DataError);
}

}  // namespace
}  // namespace hedgehop::map_sources
