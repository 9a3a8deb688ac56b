#include "preparation/map_patches.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <limits>

#include "base/angles.hpp"
#include "base/shipped_config.hpp"
#include "preparation/prepare.hpp"
#include "support/elevation_files.hpp"
#include "support/temporary_folder.hpp"
#include "support/test_map.hpp"

namespace hedgehop::preparation {
namespace {

using map::Patch;
using map::PatchKind;
using testing::HasSubstr;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

Patch obstacle(std::int64_t id, geo::MapPoint centre, double radius_m, double height_m) {
  Patch patch;
  patch.id = id;
  patch.centre = centre;
  patch.radius_m = radius_m;
  patch.height_m = height_m;
  return patch;
}

Patch threat(std::int64_t id, geo::MapPoint centre, double range_m, double mast_m) {
  Patch patch = obstacle(id, centre, range_m, mast_m);
  patch.kind = PatchKind::kThreat;
  return patch;
}

Patch area(std::int64_t id, std::vector<geo::MapPoint> outline) {
  Patch patch;
  patch.id = id;
  patch.kind = PatchKind::kArea;
  patch.outline = std::move(outline);
  patch.floor = {-kInfinity, map::AreaLimit::Reference::kAboveGround};
  patch.ceiling.value_m = kInfinity;
  return patch;
}

map::Map patched(const map::Map& base, const std::vector<Patch>& patches) {
  SilentObserver observer;
  for (const Patch& patch : patches) {
    EXPECT_EQ(reason_against(base, patch), "");
  }
  return patched_map(base, patches, {}, observer);
}

std::string corners_of(const map::Area& area) {
  std::string text;
  for (const map::Area::Polygon& polygon : area.polygons) {
    for (const geo::MapPoint& corner : polygon.outer) {
      text += std::to_string(corner.x_m) + ',' + std::to_string(corner.y_m) + ' ';
    }
  }
  return text;
}

bool has_same_bits(const raster::Grid<float>& a, const raster::Grid<float>& b) {
  return std::equal(a.values().begin(), a.values().end(), b.values().begin(), b.values().end(),
                    [](float x, float y) { return x == y || (std::isnan(x) && std::isnan(y)); });
}

map::Map slope() {
  return test::make_map(60, 50, 10.0,
                        [](double x_m, double y_m) { return 100.0 + 0.1 * x_m + 0.05 * y_m; });
}

TEST(MapPatches, TheSameThingsMakeTheSameMapWhateverTheOrderAndNoneMakeTheBase) {
  const map::Map base = slope();
  const std::vector<Patch> one = {obstacle(5, {200, 200}, 20, 30), obstacle(3, {210, 200}, 15, 60),
                                  threat(9, {400, 100}, 150, 3),
                                  area(4, {{10, 10}, {90, 10}, {50, 80}})};
  const std::vector<Patch> other = {one[2], one[3], one[1], one[0]};
  const map::Map map = patched(base, one);
  EXPECT_EQ(map.hash, patched(base, other).hash);
  EXPECT_NE(map.hash, base.hash);
  EXPECT_NO_THROW(map::validate(map));
  EXPECT_EQ(patched(base, {}).hash, base.hash);
  // Each of them counts.
  for (std::size_t i = 0; i < one.size(); ++i) {
    std::vector<Patch> fewer = one;
    fewer.erase(fewer.begin() + static_cast<long>(i));
    EXPECT_NE(map.hash, patched(base, fewer).hash) << i;
  }
}

TEST(MapPatches, AnObstacleRaisesTheCellsThatItsDiscTouchesAndNoOthers) {
  const map::Map base = slope();
  const map::Map map = patched(base, {obstacle(1, {205.0, 255.0}, 12.0, 40.0)});
  // Centre of cell (20, 25); a disc of 12 m reaches 7 m into the four cells beside it and, in the
  // corners, sqrt(5^2 + 5^2) = 7.1 < 12 into the diagonal ones.
  for (int row = 0; row < 50; ++row) {
    for (int column = 0; column < 60; ++column) {
      const bool is_touched = std::abs(column - 20) <= 1 && std::abs(row - 25) <= 1;
      const double here_m = static_cast<double>(base.surface_m.at(column, row));
      const double top_m = 100.0 + 0.1 * 205.0 + 0.05 * 255.0 + 40.0;
      const auto now_m = static_cast<double>(map.surface_m.at(column, row));
      if (is_touched) {
        EXPECT_GE(now_m, std::max(here_m + 40.0, top_m) - 1e-4);
        EXPECT_LE(now_m, std::max(here_m + 40.0, top_m) + 1.0 / 64.0 + 1e-4);
        EXPECT_EQ(map.visibility.at(column, row), 65534);
      } else {
        EXPECT_EQ(now_m, here_m);
        EXPECT_EQ(map.visibility.at(column, row), base.visibility.at(column, row));
      }
      const bool is_marked = (map.semantics.at(column, row) &
                              static_cast<unsigned>(map::SemanticClass::kObstacle)) != 0;
      EXPECT_EQ(is_marked, is_touched) << column << ' ' << row;
    }
  }
  ASSERT_EQ(map.obstacles.size(), 1U);
  EXPECT_NEAR(map.obstacles[0].top_m, 173.25, 1e-4);
}

TEST(MapPatches, AnAltitudeMeansTheSameAsTheHeightThatReachesIt) {
  const map::Map base = slope();
  Patch by_top = obstacle(1, {205.0, 255.0}, 12.0, 0.0);
  by_top.height_m.reset();
  by_top.top_m = static_cast<double>(base.surface_m.at(20, 25)) + 40.0;
  EXPECT_EQ(patched(base, {by_top}).hash,
            patched(base, {obstacle(1, {205.0, 255.0}, 12.0, 40.0)}).hash);
}

TEST(MapPatches, UnknownCellsStayUnknown) {
  map::Map base = slope();
  base.terrain_m.at(21, 25) = base.surface_m.at(21, 25) = std::numeric_limits<float>::quiet_NaN();
  base.visibility.at(20, 25) = map::kVisibilityUnknown;
  test::finish_map(base);
  const map::Map map =
      patched(base, {obstacle(1, {205.0, 255.0}, 12.0, 40.0), threat(2, {100, 100}, 900, 50)});
  EXPECT_TRUE(std::isnan(map.surface_m.at(21, 25)));
  EXPECT_EQ(map.visibility.at(20, 25), map::kVisibilityUnknown);
  EXPECT_THAT(reason_against(base, obstacle(1, {215.0, 255.0}, 12.0, 40.0)), HasSubstr("unknown"));
}

// A wall of 30 m across flat ground at x = 300..310, an eye of 10 m at x = 105. By similar
// triangles the line over the wall's sample at distance 200 climbs 20 m in 200 m; at distance d it
// is 10 + d/10 high.
TEST(MapPatches, AnObserverMakesSeenWhatItSeesAtEachHeightOfTheMap) {
  map::Map base = test::make_map(
      60, 21, 10.0, [](double x_m, double) { return x_m > 300.0 && x_m < 310.0 ? 30.0 : 0.0; });
  base.further_visibility = {{60.0, base.visibility}};
  test::finish_map(base);
  const map::Map map = patched(base, {threat(1, {105.0, 105.0}, 400.0, 10.0)});
  for (int column = 0; column < 60; ++column) {
    const double d_m = std::fabs(10.0 * column + 5.0 - 105.0);
    const bool is_in_range = d_m <= 400.0;
    const bool is_behind = column > 30;
    const auto is_seen = [&](double height_m) {
      return is_in_range && (!is_behind || height_m >= 10.0 + d_m / 10.0);
    };
    EXPECT_EQ(map.visibility.at(column, 10) == 65534, is_seen(15.24)) << column;
    EXPECT_EQ(map.further_visibility[0].share.at(column, 10) == 65534, is_seen(60.0)) << column;
  }
  EXPECT_EQ(map.surface_m.values(), base.surface_m.values());
}

TEST(MapPatches, AnObserverJoinsThoseThatTheMapKnowsAndNobodyElse) {
  map::Map base = test::make_map(
      60, 21, 10.0, [](double x_m, double) { return x_m > 300.0 && x_m < 310.0 ? 30.0 : 0.0; });
  Patch appears = threat(1, {105.0, 105.0}, 400.0, 10.0);
  appears.label = "scout";
  EXPECT_TRUE(patched(base, {appears}).threats.empty());
  base.threats = {{"tower", raster::Grid<float>(base.geometry, 12.0F)}};
  test::finish_map(base);
  const map::Map map = patched(base, {appears});
  ASSERT_EQ(map.threats.size(), 2U);
  EXPECT_EQ(map.threats[0].height_m.values(), base.threats[0].height_m.values());
  EXPECT_EQ(map.threats[1].name, "scout");
  EXPECT_EQ(map.threats[1].height_m.at(20, 10), 0.0F);
  // Over the wall of 20 m more than the eye, 200 m away: 10 + d / 10 as above.
  EXPECT_NEAR(map.threats[1].height_m.at(40, 10), 10.0 + 300.0 / 10.0, 1e-3);
  EXPECT_TRUE(std::isnan(map.threats[1].height_m.at(55, 10)));
  EXPECT_NE(map.hash, base.hash);
}

TEST(MapPatches, WhatAnObserverSeesOverAnObstacleIsSeenAtTheSameAltitude) {
  map::Map base = test::make_map(60, 21, 10.0, [](double, double) { return 0.0; });
  base.threats = {{"tower", raster::Grid<float>(base.geometry, 12.0F)}};
  base.threats[0].height_m.at(30, 10) = std::nanf("");
  test::finish_map(base);
  const map::Map map =
      patched(base, {obstacle(1, {405.0, 105.0}, 4.0, 5.0), obstacle(2, {205.0, 105.0}, 4.0, 50.0),
                     obstacle(3, {305.0, 105.0}, 4.0, 50.0)});
  EXPECT_EQ(map.threats[0].height_m.at(40, 10), 7.0F);
  EXPECT_EQ(map.threats[0].height_m.at(20, 10), 0.0F);
  EXPECT_TRUE(std::isnan(map.threats[0].height_m.at(30, 10)));
  EXPECT_EQ(map.threats[0].height_m.at(45, 10), 12.0F);
}

// Else a mast that appears could hide somebody.
TEST(MapPatches, AnObstacleHidesNothingFromAnObserver) {
  const map::Map base = test::make_map(60, 21, 10.0, [](double, double) { return 0.0; });
  const Patch wall = obstacle(1, {305.0, 105.0}, 5.0, 100.0);
  const map::Map map = patched(base, {wall, threat(2, {105.0, 105.0}, 400.0, 10.0)});
  EXPECT_EQ(map.visibility.at(40, 10), 65534);
}

TEST(MapPatches, WhatCannotBeMeantIsNamed) {
  const map::Map base = slope();
  EXPECT_THAT(reason_against(base, obstacle(1, {-1.0, 10.0}, 5, 5)), HasSubstr("outside"));
  EXPECT_THAT(reason_against(base, area(1, {{900, 900}, {950, 900}, {920, 990}})),
              HasSubstr("outside"));
  EXPECT_THAT(reason_against(base, area(1, {{0, 0}, {10, 10}, {10, 0}, {0, 10}})),
              HasSubstr("crosses itself"));
  EXPECT_THAT(reason_against(base, area(1, {{0, 0}, {10, 0}, {5, 0}})),
              HasSubstr("back the way it came"));
  EXPECT_EQ(reason_against(base, area(1, {{0, 0}, {10, 0}, {20, 0}, {10, 10}})), "");
  Patch low = area(1, {{0, 0}, {10, 0}, {5, 10}});
  low.floor = {10.0, map::AreaLimit::Reference::kAmsl};
  low.ceiling.value_m = 5.0;
  EXPECT_THAT(reason_against(base, low), HasSubstr("below its beginning"));
  Patch without_height = obstacle(1, {10.0, 10.0}, 5, 5);
  without_height.height_m.reset();
  EXPECT_THAT(reason_against(base, without_height), HasSubstr("stated"));
}

TEST(MapPatches, OverOpenGroundTheyMakeTheMapThatIsPreparedWithThem) {
  test::TemporaryFolder folder;
  const auto path = [&](const char* name) { return folder.path() / name; };
  ConfigReader reader = ConfigReader::from_text(shipped_config("prepare.yaml"), "prepare.yaml");
  PrepareOptions options = PrepareOptions::read(reader);
  options.visibility.radius_m = 300.0;
  options.visibility.azimuths = 8;
  test::write_raster(path("dem.tif"),
                     {"EPSG:32632", 499000.0, 5539600.0, 30.0, 80, 80, -9999.0, ""},
                     [](double x_m, double y_m) {
                       return 400.0 + 20.0 * std::sin(x_m / 300.0) + 20.0 * std::cos(y_m / 200.0);
                     });
  const geo::MapProjection projection("EPSG:32632");
  const geo::GeodeticPosition place = projection.to_geodetic({500000.0, 5538500.0});
  const geo::GeodeticPosition corners[] = {projection.to_geodetic({500300.0, 5538300.0}),
                                           projection.to_geodetic({500600.0, 5538300.0}),
                                           projection.to_geodetic({500450.0, 5538600.0})};
  const auto degrees = [](double angle_rad) {
    char text[40];
    std::snprintf(text, sizeof text, "%.9f", degrees_from_radians(angle_rad));
    return std::string(text);
  };
  std::ofstream(path("o.csv"))
      << "latitude,longitude,height_m,radius_m,horizontal_error_m,vertical_error_m,name\n"
      << degrees(place.latitude_rad) << ',' << degrees(place.longitude_rad) << ",80,20,0,0,crane\n";
  std::ofstream json(path("a.geojson"));
  json
      << R"({"type":"FeatureCollection","features":[{"type":"Feature","properties":{"name":"fire",)"
      << R"("kind":"no_fly","ceiling_m":900},"geometry":{"type":"Polygon","coordinates":[[)";
  for (int i = 0; i < 4; ++i) {
    const geo::GeodeticPosition& corner = corners[i % 3];
    json << (i > 0 ? "," : "") << '[' << degrees(corner.longitude_rad) << ','
         << degrees(corner.latitude_rad) << ']';
  }
  json << "]]}}]}";
  json.close();
  PrepareRequest request{{path("dem.tif")}, {}, std::nullopt, {}, "EPSG:32632", "", {}, 1};
  SilentObserver observer;
  const map::Map base = prepare(request, options, observer).map;
  request.area_files = {path("a.geojson")};
  const map::Map with_area = prepare(request, options, observer).map;
  request.obstacle_files = {path("o.csv")};
  const map::Map with_both = prepare(request, options, observer).map;
  ASSERT_EQ(with_both.obstacles.size(), 1U);

  // Files come through GEOS, which begins at the northernmost corner and goes round clockwise.
  Patch fire = area(1, {});
  for (const int i : {2, 1, 0}) {
    fire.outline.push_back(projection.to_map(corners[i]));
  }
  fire.label = "fire";
  fire.ceiling.value_m = 900.0;
  Patch crane =
      obstacle(2, projection.to_map(place), 20.0 + options.obstacles.safety_radius_m, 80.0);
  crane.label = "crane";
  EXPECT_EQ(patched(base, {fire}).hash, with_area.hash)
      << corners_of(with_area.areas[0]) << " and " << corners_of(patched(base, {fire}).areas[0]);

  const map::Map map = patched(base, {fire, crane});
  EXPECT_TRUE(has_same_bits(map.terrain_m, with_both.terrain_m));
  EXPECT_TRUE(has_same_bits(map.surface_m, with_both.surface_m));
  EXPECT_EQ(map.semantics.values(), with_both.semantics.values());
  ASSERT_EQ(map.obstacles.size(), 1U);
  EXPECT_EQ(map.obstacles[0].radius_m, with_both.obstacles[0].radius_m);
  EXPECT_EQ(map.obstacles[0].height_m, with_both.obstacles[0].height_m);
  EXPECT_EQ(map.obstacles[0].top_m, with_both.obstacles[0].top_m);
  EXPECT_EQ(map.obstacles[0].name, with_both.obstacles[0].name);
  for (std::size_t i = 0; i < map.visibility.values().size(); ++i) {
    const bool is_raised = map.surface_m.values()[i] > base.surface_m.values()[i];
    EXPECT_EQ(map.visibility.values()[i], is_raised ? 65534 : with_both.visibility.values()[i]);
  }
}

}  // namespace
}  // namespace hedgehop::preparation
