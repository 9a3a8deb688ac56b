#include "map/map_description.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "map/map_bundle.hpp"
#include "map/source_layer.hpp"
#include "support/temporary_folder.hpp"
#include "support/test_map.hpp"

namespace hedgehop::map {
namespace {

using testing::HasSubstr;

// 40 x 40 cells of 30 m; the middle of its south-western cell lies on 9 E, at the equator + 15 m.
Map map_at_the_equator() {
  Map map = test::make_map(40, 40, 30.0, [](double x_m, double y_m) { return 100.0 + x_m + y_m; });
  map.geometry.west_m = 500000.0 - 15.0;
  const auto move = [&](auto& grid) {
    auto values = grid.values();
    grid = std::decay_t<decltype(grid)>(map.geometry, 0);
    grid.values() = values;
  };
  move(map.terrain_m);
  move(map.surface_m);
  move(map.semantics);
  move(map.visibility);
  map.crs_wkt = geo::MapProjection("EPSG:32632").wkt();
  map.surface_m.at(0, 0) += 25.0F;
  map.semantics.at(0, 0) = static_cast<std::uint16_t>(SemanticClass::kForest) |
                           static_cast<std::uint16_t>(SemanticClass::kPowerLine);
  map.visibility.at(0, 0) = test::stored_visibility(0.25);
  map.terrain_m.at(1, 0) = map.surface_m.at(1, 0) = std::numeric_limits<float>::quiet_NaN();
  map.visibility.at(1, 0) = kVisibilityUnknown;
  test::finish_map(map);
  return map;
}

geo::GeodeticPosition at_deg(double latitude_deg, double longitude_deg) {
  return {radians_from_degrees(latitude_deg), radians_from_degrees(longitude_deg)};
}

TEST(MapDescription, SaysWhatLiesAtAPlace) {
  const Map map = map_at_the_equator();
  const auto place = nlohmann::json::parse(place_description_json(map, at_deg(0.0001, 9.0)));
  EXPECT_EQ(place["column"], 0);
  EXPECT_EQ(place["row_from_south"], 0);
  EXPECT_EQ(place["terrain_m"], 130.0);
  EXPECT_EQ(place["surface_above_terrain_m"], 25.0);
  EXPECT_EQ(place["classes"], nlohmann::json({"forest", "power_line"}));
  EXPECT_NEAR(place["visibility"].get<double>(), 0.25, 1e-4);
  EXPECT_THAT(place_description_text(map, at_deg(0.0001, 9.0)), HasSubstr("forest, power_line"));
}

TEST(MapDescription, NamesTheAreasAndObstaclesAtAPlace) {
  Map map = map_at_the_equator();
  const double west_m = map.geometry.west_m;
  const double south_m = map.geometry.south_m;
  const auto square = [&](double from_m, double to_m) {
    return std::vector<geo::MapPoint>{{west_m + from_m, south_m + from_m},
                                      {west_m + to_m, south_m + from_m},
                                      {west_m + to_m, south_m + to_m},
                                      {west_m + from_m, south_m + to_m},
                                      {west_m + from_m, south_m + from_m}};
  };
  constexpr double kEndless = std::numeric_limits<double>::infinity();
  // GIVEN a restricted square of 600 m with a hole from 300 to 400 m, and a mast in its first cell
  map.areas = {{"ED-R 1",
                "R",
                true,
                {100.0, AreaLimit::Reference::kAboveGround},
                {kEndless, AreaLimit::Reference::kAmsl},
                {{square(0.0, 600.0), {square(300.0, 400.0)}}}},
               {"far", "D", false, {}, {}, {{square(900.0, 1000.0), {}}}}};
  Obstacle mast;
  mast.kind = ObstacleKind::kMast;
  mast.point = {west_m + 15.0, south_m + 15.0};
  mast.radius_m = 40.0;
  mast.height_m = 80.0;
  map.obstacles = {mast};
  const geo::MapProjection projection(map.crs_wkt);
  const auto at_m = [&](double x_m, double y_m) {
    return projection.to_geodetic({west_m + x_m, south_m + y_m});
  };
  // THEN its name stands at a place inside, and nowhere else
  const auto place = nlohmann::json::parse(place_description_json(map, at_m(20.0, 20.0)));
  ASSERT_EQ(place["areas"].size(), 1U);
  EXPECT_EQ(place["areas"][0]["name"], "ED-R 1");
  EXPECT_EQ(place["areas"][0]["is_hard"], true);
  EXPECT_EQ(place["areas"][0]["floor"]["value_m"], 100.0);
  EXPECT_EQ(place["areas"][0]["floor"]["above"], "ground");
  EXPECT_TRUE(place["areas"][0]["ceiling"].is_null());
  ASSERT_EQ(place["obstacles"].size(), 1U);
  EXPECT_EQ(place["obstacles"][0]["height_m"], 80.0);
  EXPECT_THAT(place_description_text(map, at_m(20.0, 20.0)),
              HasSubstr("ED-R 1 (R), must not be entered, 100 m above ground to no end"));
  for (const double in_hole_or_beside_m : {350.0, 700.0}) {
    const auto other = nlohmann::json::parse(
        place_description_json(map, at_m(in_hole_or_beside_m, in_hole_or_beside_m)));
    EXPECT_TRUE(other["areas"].empty()) << in_hole_or_beside_m;
    EXPECT_TRUE(other["obstacles"].empty());
  }
}

TEST(MapDescription, UnknownIsNullAndNeverANumber) {
  const Map map = map_at_the_equator();
  // 30 m are 0.00027 degrees.
  const auto place = nlohmann::json::parse(place_description_json(map, at_deg(0.0001, 9.00027)));
  EXPECT_EQ(place["column"], 1);
  EXPECT_TRUE(place["terrain_m"].is_null());
  EXPECT_TRUE(place["surface_above_terrain_m"].is_null());
  EXPECT_TRUE(place["visibility"].is_null());
  EXPECT_THAT(place_description_text(map, at_deg(0.0001, 9.00027)), HasSubstr("unknown"));
}

TEST(MapDescription, WithTheBundleItSaysWhereTheHeightsOfAPlaceComeFrom) {
  const test::TemporaryFolder folder;
  const Map map = map_at_the_equator();
  write_map_bundle(map,
                   R"({"inputs": [{"name": "a.tif", "kind": "elevation", "used_as": "terrain",
                       "vertical_datum": "EGM96"}, {"name": "a.osm", "kind": "land use"},
                      {"name": "b.tif", "kind": "elevation", "used_as": "surface",
                       "vertical_datum": "EGM2008"}]})",
                   folder.path());
  const auto at_first = [&] {
    return nlohmann::json::parse(place_description_json(map, at_deg(0.0001, 9.0), folder.path()));
  };
  EXPECT_FALSE(at_first().contains("elevation_from"));  // a bundle without the layer
  raster::Grid<std::uint16_t> sources(map.geometry, packed({1, HeightOrigin::kElevation}));
  sources.at(0, 0) = packed({2, HeightOrigin::kStoreys});
  sources.at(1, 0) = packed({CellSource::kFilled, HeightOrigin::kThin});
  write_source_layer(map, sources, folder.path());
  EXPECT_EQ(at_first()["elevation_from"], "b.tif (surface, EGM2008)");
  EXPECT_EQ(at_first()["height_from"], "storeys that the source states");
  const std::string text = place_description_text(map, at_deg(0.0001, 9.00027), folder.path());
  EXPECT_THAT(text, HasSubstr("filled in from neighbouring cells"));
  EXPECT_THAT(text, HasSubstr("wire or thin obstacle"));
  EXPECT_EQ(read_cell_source(map, folder.path(), {39, 39})->elevation, 1);

  write_source_layer(map, raster::Grid<std::uint16_t>(map.geometry, 65535), folder.path());
  EXPECT_THROW((void)at_first(), DataError);
  raster::GridGeometry smaller = map.geometry;
  smaller.rows = 39;
  write_source_layer(map, raster::Grid<std::uint16_t>(smaller, 1), folder.path());
  EXPECT_THROW((void)at_first(), DataError);
}

TEST(MapDescription, RefusesAPlaceOutsideTheMapOrAMapWithoutCoordinates) {
  EXPECT_THROW(place_description_json(map_at_the_equator(), at_deg(1.0, 9.0)), DataError);
  const Map bare = test::make_map(3, 3, 30.0, [](double, double) { return 0.0; });
  EXPECT_THROW(place_description_text(bare, at_deg(0.0, 9.0)), DataError);
}

TEST(MapDescription, CountsVoidsAndClasses) {
  const Map map = map_at_the_equator();
  const auto description = nlohmann::json::parse(map_description_json(map, R"({"tool": "x"})"));
  EXPECT_EQ(description["tool"], "x");
  EXPECT_NEAR(description["statistics"]["void_share"].get<double>(), 1.0 / 1600.0, 1e-6);
  EXPECT_NEAR(description["statistics"]["class_shares"]["forest"].get<double>(), 1.0 / 1600.0,
              1e-6);
  EXPECT_EQ(description["statistics"]["class_shares"]["village"].get<double>(), 0.0);
}

TEST(MapDescription, SurvivesAManifestOfSurprisingTypes) {
  const Map map = map_at_the_equator();
  const std::string odd =
      R"({"inputs": [3, {"name": []}], "mapped_extent_deg": ["x"], "extent_deg": 7, "tool": {}})";
  EXPECT_THAT(map_description_text(map, odd), HasSubstr("40 x 40 cells of 30 m"));
  EXPECT_THROW(map_description_text(map, "[]"), DataError);
  EXPECT_THAT(map_description_text(
                  map, R"({"settings": {"visibility": {"azimuths": 180}, "list": [[], "x"]}})"),
              testing::AllOf(HasSubstr("settings.visibility.azimuths 180"),
                             HasSubstr("settings.list[1]         x")));
}

}  // namespace
}  // namespace hedgehop::map
