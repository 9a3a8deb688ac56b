#include "map_sources/vector_source.hpp"

#include <array>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <gdal_priv.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ogr_geometry.h>
#include <ogrsf_frmts.h>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "base/shipped_config.hpp"
#include "support/temporary_folder.hpp"

namespace hedgehop::map_sources {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

// A file being written: layers of features with a text, a number and a count.
class Sheet {
 public:
  Sheet(const fs::path& path, const char* driver) {
    GDALAllRegister();
    dataset_ = GetGDALDriverManager()->GetDriverByName(driver)->Create(path.c_str(), 0, 0, 0,
                                                                       GDT_Unknown, nullptr);
  }
  ~Sheet() { GDALClose(dataset_); }
  Sheet(const Sheet&) = delete;
  Sheet& operator=(const Sheet&) = delete;

  Sheet& layer(const char* name, const std::string& crs = "EPSG:4326") {
    OGRSpatialReference reference;
    reference.SetFromUserInput(crs.c_str());
    reference.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    layer_ = dataset_->CreateLayer(name, crs.empty() ? nullptr : &reference, wkbUnknown, nullptr);
    OGRFieldDefn kind("kind", OFTString);
    OGRFieldDefn height("height", OFTReal);
    OGRFieldDefn text("height_text", OFTString);
    OGRFieldDefn levels("levels", OFTInteger);
    for (OGRFieldDefn* field : {&kind, &height, &text, &levels}) {
      EXPECT_EQ(layer_->CreateField(field), OGRERR_NONE);
    }
    return *this;
  }
  Sheet& feature(const char* kind, const char* wkt, double height = NAN, const char* text = "",
                 int levels = 0) {
    OGRFeature feature(layer_->GetLayerDefn());
    feature.SetField("kind", kind);
    if (!std::isnan(height)) {
      feature.SetField("height", height);
    }
    if (*text != '\0') {
      feature.SetField("height_text", text);
    }
    if (levels != 0) {
      feature.SetField("levels", levels);
    }
    if (*wkt != '\0') {
      OGRGeometry* geometry = nullptr;
      OGRGeometryFactory::createFromWkt(wkt, nullptr, &geometry);
      feature.SetGeometryDirectly(geometry);
    }
    EXPECT_EQ(layer_->CreateFeature(&feature), OGRERR_NONE);
    return *this;
  }

 private:
  GDALDataset* dataset_ = nullptr;
  OGRLayer* layer_ = nullptr;
};

constexpr char kMapping[] = R"(attribution: "(c) surveyor"
coverage_layers: [ground]
rules:
  - {layer: ground, attribute: kind, values: [wood], class: forest, height_attribute: height, height_unit: m}
  - {layer: ground, attribute: kind, values: [house], class: building, levels_attribute: levels}
  - {layer: ground, attribute: kind, values: [pond, lake], class: water}
  - {layer: lines, attribute: kind, values: [hedge], class: tree, default_height_m: 3}
  - {layer: lines, class: power_line, height_attribute: height_text, height_unit: ft}
)";

class VectorFiles : public testing::Test {
 protected:
  fs::path path(const std::string& name) const { return folder_.path() / name; }
  VectorFindings read(const fs::path& file, const std::string& mapping = kMapping) {
    SilentObserver observer;
    return read_vectors({file, VectorMapping::read(mapping, "m.yaml")}, projection_, region_,
                        land_use_, observer);
  }
  template <typename Error>
  std::string refusal_of(const fs::path& file, const std::string& mapping = kMapping) {
    try {
      (void)read(file, mapping);
    } catch (const Error& error) {
      EXPECT_NE(error.hint(), "") << error.what();
      return error.what() + (" | " + error.hint());
    }
    return "";
  }
  test::TemporaryFolder folder_;
  geo::MapProjection projection_{"EPSG:32632"};
  geo::GeodeticBox region_{radians_from_degrees(8.9), radians_from_degrees(49.9),
                           radians_from_degrees(9.1), radians_from_degrees(50.1)};
  LandUse land_use_;
};

void write_ground(Sheet& sheet) {
  sheet.layer("ground")
      .feature("wood",
               "POLYGON ((9 50,9.01 50,9.01 50.01,9 50.01,9 50),(9.004 50.004,9.006 "
               "50.004,9.006 50.006,9.004 50.006,9.004 50.004))",
               22.5)
      .feature("house", "MULTIPOLYGON (((9.02 50,9.021 50,9.021 50.001,9.02 50)))", NAN, "", 3)
      .feature("lake", "POLYGON ((9.03 50,9.04 50,9.04 50.01,9.03 50))")
      .feature("rock", "POINT (9 50)")
      .feature("house", "");
  sheet.layer("lines")
      .feature("hedge", "LINESTRING (9 49.99,9.001 49.99)")
      .feature("cable",
               "MULTILINESTRING ((9 49.98,9.01 49.98,9.01 49.98,9.02 49.985),(9.03 49.98,"
               "9.04 49.98))",
               NAN, "100")
      .feature("cable", "POINT (9 49.98)");
}

TEST_F(VectorFiles, EveryRuleGivesItsObjectsInOrder) {
  {
    Sheet sheet(path("a.gpkg"), "GPKG");
    write_ground(sheet);
  }
  const VectorFindings findings = read(path("a.gpkg"));
  EXPECT_EQ(findings.format, "GPKG");
  EXPECT_THAT(findings.objects_of_rule, testing::ElementsAre(1, 1, 1, 1, 1));
  EXPECT_EQ(findings.unmapped_feature_count, 1);  // the rock
  EXPECT_EQ(findings.unusable_feature_count, 1);  // the cable of a point
  ASSERT_EQ(land_use_.areas.size(), 3U);
  const AreaObject& wood = land_use_.areas[0];
  EXPECT_EQ(wood.object_class, ObjectClass::kForest);
  EXPECT_EQ(wood.height_m, 22.5);
  ASSERT_EQ(wood.polygons.size(), 1U);
  EXPECT_EQ(wood.polygons[0].outer.size(), 5U);
  ASSERT_EQ(wood.polygons[0].holes.size(), 1U);
  // 9 E, 50 N: on the central meridian of the zone, 5538630.703 m north by the map's own formula.
  EXPECT_NEAR(wood.polygons[0].outer[0].x_m, 500000.0, 0.001);
  EXPECT_NEAR(wood.polygons[0].outer[0].y_m, 5538630.703, 0.001);
  EXPECT_EQ(land_use_.areas[1].levels, 3.0);
  EXPECT_FALSE(land_use_.areas[1].height_m.has_value());
  EXPECT_EQ(land_use_.areas[2].object_class, ObjectClass::kWater);
  ASSERT_EQ(land_use_.lines.size(), 1U);
  EXPECT_EQ(land_use_.lines[0].default_height_m, 3.0);
  ASSERT_EQ(land_use_.power_lines.size(), 2U);
  EXPECT_EQ(land_use_.power_lines[0].supports.size(), 3U);  // the doubled vertex is one support
  EXPECT_NEAR(*land_use_.power_lines[1].supports[0].height_m, 30.48, 1e-9);
  ASSERT_EQ(land_use_.mapped.size(), 1U);
  EXPECT_NEAR(degrees_from_radians(land_use_.mapped[0].east_rad), 9.04, 1e-9);
  EXPECT_NEAR(degrees_from_radians(land_use_.mapped[0].south_rad), 50.0, 1e-9);
}

TEST_F(VectorFiles, AnyFormatAndAnyCoordinateSystemGiveTheSamePlaces) {
  for (const auto& [name, driver, crs] :
       {std::array{"a.gpkg", "GPKG", "EPSG:4326"}, std::array{"a.geojson", "GeoJSON", "EPSG:4326"},
        std::array{"a.kml", "KML", "EPSG:4326"}, std::array{"b.gpkg", "GPKG", "EPSG:3857"},
        std::array{"c.gpkg", "GPKG", "EPSG:25832"},
        std::array{"a.shp", "ESRI Shapefile", "EPSG:25832"}}) {
    SCOPED_TRACE(name);
    OGRSpatialReference wgs84, other;
    wgs84.SetFromUserInput("EPSG:4326");
    wgs84.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    other.SetFromUserInput(crs);
    other.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    OGRGeometry* geometry = nullptr;
    OGRGeometryFactory::createFromWkt("POLYGON ((9.05 50,9.06 50,9.06 50.01,9.05 50))", &wgs84,
                                      &geometry);
    ASSERT_EQ(geometry->transformTo(&other), OGRERR_NONE);
    char* wkt = nullptr;
    geometry->exportToWkt(&wkt);
    { Sheet(path(name), driver).layer("a", crs).feature("wood", wkt); }
    CPLFree(wkt);
    OGRGeometryFactory::destroyGeometry(geometry);
    land_use_ = LandUse();
    (void)read(path(name),
               "attribution: ''\ncoverage_layers: [a]\nrules:\n  - {layer: a, class: forest}\n");
    ASSERT_EQ(land_use_.areas.size(), 1U);
    const geo::MapPoint expected =
        projection_.to_map({radians_from_degrees(50.0), radians_from_degrees(9.05)});
    const MapLine& outer = land_use_.areas[0].polygons[0].outer;
    double nearest_m = 1e9;  // a format may turn the ring round
    for (const geo::MapPoint& point : outer) {
      nearest_m =
          std::min(nearest_m, std::hypot(point.x_m - expected.x_m, point.y_m - expected.y_m));
    }
    EXPECT_LT(nearest_m, 0.01);
  }
}

TEST_F(VectorFiles, WhatLiesElsewhereAndWhatIsNotFiniteIsLeftOut) {
  {
    Sheet sheet(path("a.gpkg"), "GPKG");
    sheet.layer("a")
        .feature("x", "POLYGON ((20 50,20.01 50,20.01 50.01,20 50))")
        .feature("x", "POLYGON ((9 50,9.01 50,9.01 95,9 50))")
        .feature("x", "POLYGON ((9 50,9.01 50,9.01 50.01,9 50))");
    sheet.layer("b").feature("x", "POINT (9 50)");
  }
  const VectorFindings findings =
      read(path("a.gpkg"),
           "attribution: ''\ncoverage_layers: [b]\nrules:\n  - {layer: a, class: forest}\n");
  EXPECT_EQ(land_use_.areas.size(), 1U);
  EXPECT_EQ(findings.unusable_feature_count, 1);
}

TEST_F(VectorFiles, HeightsThatSayNothingAreCountedAndAbsentOnesAreNot) {
  {
    Sheet(path("a.gpkg"), "GPKG")
        .layer("ground")
        .feature("wood", "POINT (9 50)", -5.0)
        .feature("wood", "POINT (9 50)")
        .feature("wood", "POINT (9 50)", 1200.0);
  }
  (void)read(path("a.gpkg"),
             "attribution: ''\ncoverage_layers: [ground]\nrules:\n"
             "  - {layer: ground, class: forest, height_attribute: height, height_unit: m}\n");
  EXPECT_EQ(land_use_.unreadable_height_count, 2);
  EXPECT_EQ(land_use_.lines.size(), 3U);
}

TEST_F(VectorFiles, RefusalsNameTheRuleOrTheFileAndWhatThereIs) {
  {
    Sheet sheet(path("a.gpkg"), "GPKG");
    write_ground(sheet);
  }
  const std::string head = "attribution: ''\ncoverage_layers: [ground]\nrules:\n";
  EXPECT_THAT(refusal_of<ConfigError>(path("a.gpkg"), head + "  - {layer: grund, class: forest}\n"),
              AllOf(HasSubstr("m.yaml:4: "), HasSubstr("'grund'"), HasSubstr("ground, lines")));
  EXPECT_THAT(refusal_of<ConfigError>(
                  path("a.gpkg"),
                  head + "  - {layer: ground, attribute: sort, values: [x], class: forest}\n"),
              AllOf(HasSubstr("m.yaml:4: "), HasSubstr("'sort'"), HasSubstr("kind, height")));
  EXPECT_THAT(refusal_of<ConfigError>(path("a.gpkg"),
                                      "attribution: ''\ncoverage_layers: [b]\nrules:\n"
                                      "  - {layer: ground, class: forest}\n"),
              HasSubstr("no layer 'b'"));
  EXPECT_THAT(refusal_of<DataError>(path("nowhere.gpkg")), HasSubstr("no such file"));
  std::ofstream(path("text.gpkg")) << "hello";
  EXPECT_THAT(refusal_of<DataError>(path("text.gpkg")), HasSubstr("not a vector file"));
  { Sheet(path("bare.gpkg"), "GPKG").layer("ground", "").layer("lines"); }
  EXPECT_THAT(refusal_of<DataError>(path("bare.gpkg")), HasSubstr("empty"));
}

TEST_F(VectorFiles, ALayerWithoutCoordinateSystemNeedsTheMappingsWord) {
  { Sheet(path("a.shp"), "ESRI Shapefile").layer("a", "").feature("x", "POINT (9 50)"); }
  const std::string rules = "coverage_layers: [a]\nrules:\n  - {layer: a, class: structure}\n";
  EXPECT_THAT(refusal_of<DataError>(path("a.shp"), "attribution: ''\n" + rules),
              HasSubstr("no coordinate system"));
  const VectorFindings findings = read(path("a.shp"), "attribution: ''\ncrs: EPSG:4326\n" + rules);
  EXPECT_EQ(land_use_.lines.size(), 1U);
  EXPECT_GE(findings.parts.size(), 3U);  // .shp, .shx, .dbf
  EXPECT_EQ(findings.parts[0], path("a.shp"));
}

TEST(VectorMapOfTaiwan, HasTheForestsAndLinesThatItsSourceDescribes) {
  const char* data = std::getenv("HEDGEHOP_DATA");
  const fs::path path =
      fs::path(data == nullptr ? "../shared/data" : data) / "hsinchu/hsinchu_topo25k.gpkg";
  if (!fs::exists(path)) {
    GTEST_SKIP() << "no real data at " << path.string();
  }
  SilentObserver observer;
  LandUse land_use;
  const std::string name = "mappings/taiwan_topo25k.yaml";
  const geo::GeodeticBox region{radians_from_degrees(120.9), radians_from_degrees(24.5),
                                radians_from_degrees(121.4), radians_from_degrees(25.0)};
  const VectorFindings findings =
      read_vectors({path, VectorMapping::read(std::string(shipped_config(name)), name)},
                   geo::MapProjection("EPSG:32651"), region, land_use, observer);
  EXPECT_EQ(findings.unusable_feature_count, 0);
  for (std::size_t i = 0; i < findings.objects_of_rule.size(); ++i) {
    EXPECT_GT(findings.objects_of_rule[i], 0) << "rule " << i;
  }
  std::array<int, kObjectClassCount> counts{};
  for (const AreaObject& area : land_use.areas) {
    ++counts[static_cast<std::size_t>(area.object_class)];
  }
  EXPECT_EQ(counts[static_cast<std::size_t>(ObjectClass::kForest)], 62);
  EXPECT_EQ(counts[static_cast<std::size_t>(ObjectClass::kBuilding)], 6157);  // eleven lie far away
  EXPECT_EQ(counts[static_cast<std::size_t>(ObjectClass::kBuiltUpArea)], 2436);
  double length_m = 0.0;
  for (const PowerLineObject& line : land_use.power_lines) {
    for (std::size_t i = 0; i + 1 < line.supports.size(); ++i) {
      length_m += std::hypot(line.supports[i + 1].point.x_m - line.supports[i].point.x_m,
                             line.supports[i + 1].point.y_m - line.supports[i].point.y_m);
    }
  }
  EXPECT_NEAR(length_m, 359e3, 2e3);  // the source's own description
  EXPECT_NEAR(degrees_from_radians(land_use.mapped[0].west_rad), 121.0, 1e-4);
  EXPECT_NEAR(degrees_from_radians(land_use.mapped[0].north_rad), 24.875, 1e-4);
}

}  // namespace
}  // namespace hedgehop::map_sources
