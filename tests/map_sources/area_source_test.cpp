#include "map_sources/area_source.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <gdal_priv.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <limits>
#include <ogrsf_frmts.h>
#include <random>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "support/fresh_seed.hpp"
#include "support/temporary_folder.hpp"

namespace hedgehop::map_sources {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

class AreaFiles : public testing::Test {
 protected:
  fs::path write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_.path() / name) << text;
    return folder_.path() / name;
  }
  AirspaceList read(const fs::path& path) const {
    SilentObserver observer;
    return read_areas({{path}}, projection_, region_, observer);
  }
  std::string refusal_of(const fs::path& path) const {
    try {
      (void)read(path);
    } catch (const DataError& error) {
      EXPECT_NE(error.hint(), "") << error.what();
      return error.what();
    }
    return "";
  }
  geo::MapPoint at_deg(double latitude, double longitude) const {
    return projection_.to_map({radians_from_degrees(latitude), radians_from_degrees(longitude)});
  }
  // By the shoelace formula.
  static double area_m2(const MapLine& ring) {
    double twice_m2 = 0.0;
    for (std::size_t i = 1; i < ring.size(); ++i) {
      twice_m2 += (ring[i - 1].x_m - ring[0].x_m) * (ring[i].y_m - ring[0].y_m) -
                  (ring[i].x_m - ring[0].x_m) * (ring[i - 1].y_m - ring[0].y_m);
    }
    return std::fabs(0.5 * twice_m2);
  }

  test::TemporaryFolder folder_;
  geo::MapProjection projection_{"EPSG:32632"};
  geo::GeodeticBox region_{radians_from_degrees(11.0), radians_from_degrees(50.0),
                           radians_from_degrees(11.1), radians_from_degrees(50.1)};
};

std::string feature(const std::string& properties, const std::string& coordinates,
                    const std::string& type = "Polygon") {
  return R"({"type": "Feature", "properties": {)" + properties + R"(}, "geometry": {"type": ")" +
         type + R"(", "coordinates": )" + coordinates + "}}";
}

std::string collection(const std::string& features) {
  return R"({"type": "FeatureCollection", "features": [)" + features + "]}";
}

const char kSquare[] =
    "[[[11.02, 50.02], [11.04, 50.02], [11.04, 50.04], [11.02, 50.04], [11.02, 50.02]]]";

TEST_F(AreaFiles, GeoJsonWithHolesAndLimitsInEverySpelling) {
  const AirspaceList list = read(write(
      "a.geojson",
      collection(
          feature(
              R"("name": "one", "kind": "no_fly", "floor": "GND", "ceiling": "FL 65")",
              "[[[11.02, 50.02], [11.04, 50.02], [11.04, 50.04], [11.02, 50.04], [11.02, "
              "50.02]], [[11.025, 50.025], [11.03, 50.025], [11.03, 50.03], [11.025, 50.025]]]") +
          "," +
          feature(R"("NAME": "two", "hard": false, "floor_ft": 1000, "floor_reference": "AGL",
                  "ceiling_m": 900.5)",
                  kSquare) +
          "," + feature(R"("lower": "500 ft AGL", "upper": "1500 m MSL")", kSquare) + "," +
          feature("", kSquare))));
  ASSERT_EQ(list.areas.size(), 4U);
  const AirspaceArea& one = list.areas[0];
  EXPECT_EQ(one.name, "one");
  EXPECT_EQ(one.kind, "no_fly");
  EXPECT_FALSE(one.is_hard);
  EXPECT_EQ(one.floor, (AltitudeLimit{-kInfinity, true}));
  EXPECT_NEAR(one.ceiling.value_m, 6500 * 0.3048, 1e-9);
  ASSERT_EQ(one.polygons.size(), 1U);
  EXPECT_EQ(one.polygons[0].holes.size(), 1U);
  EXPECT_EQ(list.areas[1].is_hard, false);
  EXPECT_EQ(list.areas[1].name, "two");
  EXPECT_TRUE(list.areas[1].floor.is_above_ground);
  EXPECT_NEAR(list.areas[1].floor.value_m, 304.8, 1e-9);
  EXPECT_EQ(list.areas[1].ceiling, (AltitudeLimit{900.5, false}));
  EXPECT_NEAR(list.areas[2].floor.value_m, 152.4, 1e-9);
  EXPECT_EQ(list.areas[2].ceiling, (AltitudeLimit{1500.0, false}));
  EXPECT_EQ(list.areas[3].ceiling.value_m, kInfinity);
  // The corners lie where the projection puts them, and edges are followed between them.
  const geo::MapPoint corner = at_deg(50.02, 11.02);
  EXPECT_TRUE(std::any_of(list.areas[3].polygons[0].outer.begin(),
                          list.areas[3].polygons[0].outer.end(), [&](const geo::MapPoint& p) {
                            return std::hypot(p.x_m - corner.x_m, p.y_m - corner.y_m) < 0.002;
                          }));
  EXPECT_GE(list.areas[3].polygons[0].outer.size(), 9U);
}

TEST_F(AreaFiles, KmlIsRead) {
  const AirspaceList list = read(write(
      "a.kml",
      R"(<?xml version="1.0" encoding="UTF-8"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document>
<Placemark><name>Range</name><ExtendedData><Data name="kind"><value>R</value></Data>
<Data name="ceiling"><value>3000 ft MSL</value></Data></ExtendedData>
<Polygon><outerBoundaryIs><LinearRing><coordinates>11.02,50.02,0 11.04,50.02,0 11.04,50.04,0
11.02,50.02,0</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></Document></kml>)"));
  ASSERT_EQ(list.areas.size(), 1U);
  EXPECT_EQ(list.areas[0].name, "Range");
  EXPECT_EQ(list.areas[0].kind, "R");
  EXPECT_NEAR(list.areas[0].ceiling.value_m, 3000 * 0.3048, 1e-9);
}

TEST_F(AreaFiles, AGeoPackageInAnotherProjectionLandsOnTheSamePlace) {
  GDALAllRegister();
  const fs::path path = folder_.path() / "a.gpkg";
  const geo::MapProjection other("EPSG:32633");
  const auto corner = [&](double latitude, double longitude) {
    return other.to_map({radians_from_degrees(latitude), radians_from_degrees(longitude)});
  };
  {
    GDALDataset* dataset = GetGDALDriverManager()->GetDriverByName("GPKG")->Create(
        path.c_str(), 0, 0, 0, GDT_Unknown, nullptr);
    OGRSpatialReference reference;
    reference.importFromEPSG(32633);
    OGRLayer* layer = dataset->CreateLayer("areas", &reference, wkbPolygon, nullptr);
    auto* ring = new OGRLinearRing;
    for (const auto& [latitude, longitude] :
         {std::pair(50.02, 11.02), {50.02, 11.04}, {50.04, 11.04}}) {
      ring->addPoint(corner(latitude, longitude).x_m, corner(latitude, longitude).y_m);
    }
    ring->closeRings();
    OGRPolygon polygon;
    polygon.addRingDirectly(ring);
    OGRFeature feature(layer->GetLayerDefn());
    feature.SetGeometry(&polygon);
    ASSERT_EQ(layer->CreateFeature(&feature), OGRERR_NONE);
    GDALClose(dataset);
  }
  const AirspaceList list = read(path);
  ASSERT_EQ(list.areas.size(), 1U);
  const geo::MapPoint expected = at_deg(50.04, 11.04);
  double nearest_m = 1e9;
  for (const geo::MapPoint& p : list.areas[0].polygons.at(0).outer) {
    nearest_m = std::min(nearest_m, std::hypot(p.x_m - expected.x_m, p.y_m - expected.y_m));
  }
  EXPECT_LT(nearest_m, 0.01);
}

TEST_F(AreaFiles, OpenAirGoesThroughItsOwnParser) {
  const AirspaceList list =
      read(write("a.txt",
                 "AC R\nAN circle\nAL SFC\nAH 5000 ft\nV X=50:03:00 N 011:03:00 E\nDC 1\n"
                 "AC R\nAN elsewhere\nV X=40:03:00 N 011:03:00 E\nDC 1\n"));
  EXPECT_EQ(list.record_count, 2);
  ASSERT_EQ(list.areas.size(), 1U);
  EXPECT_EQ(list.areas[0].name, "circle");
  // The projection's scale at 11 E in zone 32 is 0.99977.
  EXPECT_NEAR(area_m2(list.areas[0].polygons.at(0).outer) / (3.14159265 * 1852.0 * 1852.0), 1.0,
              2e-3);
}

TEST_F(AreaFiles, AnAreaOfHalfTheWorldIsCutToTheRegionNotRefused) {
  const AirspaceList list = read(write(
      "a.geojson",
      collection(feature("", "[[[-170, -80], [170, -80], [170, 89], [-170, 89], [-170, -80]]]"))));
  ASSERT_EQ(list.areas.size(), 1U);
  // All of the region is inside: 7.1 x 11.1 km and more.
  const geo::MapPoint south_west = at_deg(50.0, 11.0);
  const geo::MapPoint north_east = at_deg(50.1, 11.1);
  EXPECT_GT(area_m2(list.areas[0].polygons.at(0).outer),
            (north_east.x_m - south_west.x_m) * (north_east.y_m - south_west.y_m));
}

TEST_F(AreaFiles, APolygonThatCrossesItselfIsMadeValidNotLost) {
  const AirspaceList list = read(write(
      "a.geojson",
      collection(feature(
          "",
          "[[[11.02, 50.02], [11.04, 50.04], [11.04, 50.02], [11.02, 50.04], [11.02, 50.02]]]"))));
  ASSERT_EQ(list.areas.size(), 1U);
  EXPECT_EQ(list.areas[0].polygons.size(), 2U);  // a bow tie is two triangles
}

TEST_F(AreaFiles, WhatCannotBeMeantIsRefusedWithItsFeature) {
  EXPECT_THAT(refusal_of(write("a.geojson", collection(feature(R"("floor": "1500")", kSquare)))),
              HasSubstr("the floor '1500' cannot be read"));
  EXPECT_THAT(
      refusal_of(write("b.geojson", collection(feature(R"("ceiling_m": "high")", kSquare)))),
      HasSubstr("ceiling_m is 'high'"));
  EXPECT_THAT(refusal_of(write("c.geojson", collection(feature("", "[11.02, 50.02]", "Point")))),
              HasSubstr("no polygon"));
  EXPECT_THAT(refusal_of(write("d.geojson", collection(feature(R"("hard": "maybe")", kSquare)))),
              HasSubstr("no truth value"));
  EXPECT_THAT(refusal_of(write("e.geojson", collection(feature(
                                                R"("floor_m": 500, "ceiling_m": 400)", kSquare)))),
              HasSubstr("ends below"));
  EXPECT_THAT(refusal_of(write("f.geojson", "no json at all")), HasSubstr("cannot be read"));
  EXPECT_THAT(refusal_of(folder_.path() / "none.geojson"), HasSubstr("no such file"));
  EXPECT_THAT(
      refusal_of(write("g.geojson",
                       collection(feature("", "[[[500, 50], [501, 50], [501, 51], [500, 50]]]")))),
      HasSubstr("not on the globe"));
}

TEST_F(AreaFiles, WhatIsNoPolygonIsSkippedWhereItMayBe) {
  const fs::path file = write(
      "mission.geojson", collection(feature("", "[11.02, 50.02]", "Point") + "," +
                                    feature(R"("name": "range", "hard": true)", kSquare) + "," +
                                    feature("", "[[11.02, 50.02], [11.04, 50.04]]", "LineString")));
  EXPECT_NE(refusal_of(file), "");
  SilentObserver observer;
  const AirspaceList list = read_areas({{file, true}}, projection_, region_, observer);
  ASSERT_EQ(list.areas.size(), 1U);
  EXPECT_EQ(list.areas[0].name, "range");
  EXPECT_EQ(list.record_count, 1);
}

// Whether a point lies in one of the polygons, by counting crossings.
bool holds(const std::vector<MapPolygon>& polygons, const geo::MapPoint& point) {
  const auto crosses = [&](const MapLine& ring) {
    bool is_inside = false;
    for (std::size_t i = 1; i < ring.size(); ++i) {
      const geo::MapPoint& a = ring[i - 1];
      const geo::MapPoint& b = ring[i];
      if ((a.y_m > point.y_m) != (b.y_m > point.y_m) &&
          point.x_m < a.x_m + (point.y_m - a.y_m) / (b.y_m - a.y_m) * (b.x_m - a.x_m)) {
        is_inside = !is_inside;
      }
    }
    return is_inside;
  };
  return std::any_of(polygons.begin(), polygons.end(), [&](const MapPolygon& polygon) {
    return crosses(polygon.outer) &&
           std::none_of(polygon.holes.begin(), polygon.holes.end(), crosses);
  });
}

TEST_F(AreaFiles, FencesForbidTheirInsideOrTheirOutside) {
  const auto at = [](double latitude_deg, double longitude_deg) {
    return geo::GeodeticPosition{radians_from_degrees(latitude_deg),
                                 radians_from_degrees(longitude_deg)};
  };
  // An inclusion that goes beyond the region in the north, and an exclusion inside of it.
  const Fence inclusion{
      true, {at(50.02, 11.02), at(50.02, 11.08), at(50.5, 11.08), at(50.5, 11.02)}, "a"};
  const Fence exclusion{
      false,
      {at(50.04, 11.04), at(50.04, 11.06), at(50.06, 11.06), at(50.06, 11.04), at(50.04, 11.04)},
      "b"};
  const auto areas = areas_of_fences({inclusion, exclusion}, projection_, region_);
  ASSERT_EQ(areas.size(), 2U);
  for (const AirspaceArea& area : areas) {
    EXPECT_EQ(area.is_hard, true);
    EXPECT_EQ(area.floor.value_m, -kInfinity);
    EXPECT_EQ(area.ceiling.value_m, kInfinity);
  }
  std::mt19937_64 generator(test::fresh_seed());
  std::uniform_real_distribution<double> north(50.0, 50.1);
  std::uniform_real_distribution<double> east(11.0, 11.1);
  for (int i = 0; i < 2000; ++i) {
    const double latitude = north(generator);
    const double longitude = east(generator);
    const bool is_in_a = latitude > 50.02 && longitude > 11.02 && longitude < 11.08;
    const bool is_in_b =
        latitude > 50.04 && latitude < 50.06 && longitude > 11.04 && longitude < 11.06;
    EXPECT_EQ(holds(areas[0].polygons, at_deg(latitude, longitude)), !is_in_a)
        << latitude << "," << longitude;
    EXPECT_EQ(holds(areas[1].polygons, at_deg(latitude, longitude)), is_in_b)
        << latitude << "," << longitude;
  }
  EXPECT_THROW((void)areas_of_fences({{true, {at(50, 11)}, "c"}}, projection_, region_), DataError);
}

TEST_F(AreaFiles, CircleAsAFencePermitsNothingThatTheCircleDoesNot) {
  std::mt19937_64 generator(test::fresh_seed());
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  for (int i = 0; i < 20; ++i) {
    // UTM lengths are true to 0.4 to 1 parts in a thousand; near the centre of the zone 0.9996.
    const geo::GeodeticPosition centre{radians_from_degrees(50.0 + 0.1 * unit(generator)),
                                       radians_from_degrees(8.9 + 0.2 * unit(generator))};
    const double radius_m = 50.0 + 5000.0 * unit(generator);
    const geo::MapPoint middle = projection_.to_map(centre);
    for (const bool is_inclusion : {false, true}) {
      const Fence fence = circle_fence(centre, radius_m, is_inclusion, "circle");
      std::vector<geo::MapPoint> corners;
      for (const geo::GeodeticPosition& corner : fence.outline) {
        corners.push_back(projection_.to_map(corner));
      }
      corners.push_back(corners.front());
      for (std::size_t k = 1; k < corners.size(); ++k) {
        for (const double t : {0.0, 0.25, 0.5, 0.75}) {
          const double dx_m =
              corners[k - 1].x_m + t * (corners[k].x_m - corners[k - 1].x_m) - middle.x_m;
          const double dy_m =
              corners[k - 1].y_m + t * (corners[k].y_m - corners[k - 1].y_m) - middle.y_m;
          const double reach_m = std::hypot(dx_m, dy_m) / 0.9996;
          EXPECT_NEAR(reach_m, radius_m, 2e-3 * radius_m);
          if (is_inclusion) {
            EXPECT_LE(reach_m, radius_m * (1.0 + 2e-6));
          } else {
            EXPECT_GE(reach_m, radius_m * (1.0 - 2e-6));
          }
        }
      }
    }
  }
}

}  // namespace
}  // namespace hedgehop::map_sources
