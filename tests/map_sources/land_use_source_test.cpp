#include "map_sources/land_use_source.hpp"

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "support/temporary_folder.hpp"

namespace hedgehop::map_sources {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

// A drawing of nodes: number, column and row in steps of 0.001 degrees from 11 E, 50 N.
std::string node(int id, int column, int row, const std::string& tags = "") {
  return "<node id=\"" + std::to_string(id) + "\" version=\"1\" lat=\"" +
         std::to_string(50.0 + 0.001 * row) + "\" lon=\"" + std::to_string(11.0 + 0.001 * column) +
         "\">" + tags + "</node>\n";
}
std::string tag(const std::string& key, const std::string& value) {
  return "<tag k=\"" + key + "\" v=\"" + value + "\"/>";
}
std::string way(int id, const std::vector<int>& nodes, const std::string& tags) {
  std::string text = "<way id=\"" + std::to_string(id) + "\" version=\"1\">";
  for (const int ref : nodes) {
    text += "<nd ref=\"" + std::to_string(ref) + "\"/>";
  }
  return text + tags + "</way>\n";
}
std::string relation(int id, const std::vector<std::pair<int, std::string>>& ways,
                     const std::string& tags) {
  std::string text = "<relation id=\"" + std::to_string(id) + "\" version=\"1\">";
  for (const auto& [ref, role] : ways) {
    text += "<member type=\"way\" ref=\"" + std::to_string(ref) + "\" role=\"" + role + "\"/>";
  }
  return text + tag("type", "multipolygon") + tags + "</relation>\n";
}
std::string document(const std::string& content, const std::string& bounds = "") {
  return "<?xml version=\"1.0\"?>\n<osm version=\"0.6\" generator=\"test\">\n" + bounds + content +
         "</osm>\n";
}

// Two squares, one in the other: nodes 1-4 and 5-8.
std::string two_squares() {
  return node(1, 0, 0) + node(2, 10, 0) + node(3, 10, 10) + node(4, 0, 10) + node(5, 4, 4) +
         node(6, 6, 4) + node(7, 6, 6) + node(8, 4, 6);
}

class OsmFiles : public testing::Test {
 protected:
  LandUse read(const std::string& text) {
    const fs::path path = folder_.path() / "area.osm";
    std::ofstream(path, std::ios::binary) << text;
    return read_path(path);
  }
  LandUse read_path(const fs::path& path) {
    SilentObserver observer;
    return read_land_use({path}, projection_, region_, observer);
  }
  std::string refusal_of(const fs::path& path) {
    try {
      (void)read_path(path);
    } catch (const DataError& error) {
      EXPECT_NE(error.hint(), "") << error.what();
      return error.what();
    }
    return "";
  }
  test::TemporaryFolder folder_;
  geo::MapProjection projection_{"EPSG:32632"};
  geo::GeodeticBox region_{radians_from_degrees(10.9), radians_from_degrees(49.9),
                           radians_from_degrees(11.1), radians_from_degrees(50.1)};
};

TEST_F(OsmFiles, ReadsEveryClassWithItsHeight) {
  const LandUse land_use = read(
      document(two_squares() + node(20, 1, 1, tag("natural", "tree") + tag("height", "12 m")) +
               node(21, 2, 1, tag("man_made", "mast")) + node(22, 3, 1, tag("barrier", "gate")) +
               way(1, {1, 2, 3, 4, 1}, tag("landuse", "forest")) +
               way(2, {5, 6, 7, 8, 5}, tag("building", "yes") + tag("building:levels", "3")) +
               way(3, {5, 6, 7, 8, 5}, tag("landuse", "residential") + tag("height", "low")) +
               way(4, {5, 6, 7, 8, 5}, tag("natural", "water")) +
               way(5, {5, 6, 7, 8, 5}, tag("landuse", "meadow")) +
               way(6, {5, 6, 7}, tag("natural", "tree_row") + tag("height", "8"))));
  ASSERT_EQ(land_use.areas.size(), 4U);
  EXPECT_EQ(land_use.areas[0].object_class, ObjectClass::kForest);
  EXPECT_FALSE(land_use.areas[0].height_m);
  EXPECT_EQ(land_use.areas[1].object_class, ObjectClass::kBuilding);
  EXPECT_EQ(land_use.areas[1].levels, 3.0);
  EXPECT_EQ(land_use.areas[2].object_class, ObjectClass::kBuiltUpArea);
  EXPECT_EQ(land_use.areas[3].object_class, ObjectClass::kWater);
  ASSERT_EQ(land_use.lines.size(), 3U);
  EXPECT_EQ(land_use.lines[0].height_m, 12.0);
  EXPECT_EQ(land_use.lines[1].object_class, ObjectClass::kStructure);
  EXPECT_EQ(land_use.lines[2].vertices.size(), 3U);
  EXPECT_EQ(land_use.unreadable_height_count, 1);
  EXPECT_TRUE(land_use.is_openstreetmap);
}

TEST_F(OsmFiles, PowerLinesKeepTheOrderOfTheirSupportsAndTheirHeights) {
  const LandUse land_use = read(document(
      node(1, 0, 0, tag("power", "tower") + tag("height", "55")) + node(2, 3, 1) +
      node(3, 6, 5, tag("power", "tower")) +
      way(9, {3, 2, 1}, tag("power", "line") + tag("height", "40")) +
      way(10, {1, 2}, tag("power", "minor_line")) + way(11, {1, 2}, tag("power", "cable"))));
  ASSERT_EQ(land_use.power_lines.size(), 2U);
  const PowerLineObject& line = land_use.power_lines[0];
  EXPECT_EQ(line.source_id, 9);
  EXPECT_FALSE(line.is_minor);
  ASSERT_EQ(line.supports.size(), 3U);
  EXPECT_EQ(line.supports[0].height_m, 40.0);
  EXPECT_EQ(line.supports[2].height_m, 55.0);
  const geo::MapPoint expected =
      projection_.to_map({radians_from_degrees(50.005), radians_from_degrees(11.006)});
  EXPECT_EQ(line.supports[0].point.x_m, expected.x_m);
  EXPECT_EQ(line.supports[0].point.y_m, expected.y_m);
  EXPECT_TRUE(land_use.power_lines[1].is_minor);
  EXPECT_FALSE(land_use.power_lines[1].supports[1].height_m);
}

TEST_F(OsmFiles, PolesAreToldFromOtherVerticesAndCablesInTheGroundAreNoWires) {
  const LandUse land_use =
      read(document(node(1, 0, 0, tag("power", "pole")) + node(2, 3, 1) +
                    node(3, 6, 5, tag("aerialway", "pylon") + tag("height", "30 m")) +
                    node(4, 7, 7) + way(9, {1, 2}, tag("power", "line")) +
                    way(10, {1, 2}, tag("power", "minor_line") + tag("location", "underground")) +
                    way(11, {2, 3, 4}, tag("aerialway", "gondola")) +
                    way(12, {2, 4}, tag("aerialway", "platter")) +
                    way(13, {2, 4}, tag("aerialway", "magic_carpet"))));
  ASSERT_EQ(land_use.power_lines.size(), 3U);
  EXPECT_FALSE(land_use.power_lines[0].is_aerialway);
  EXPECT_TRUE(land_use.power_lines[0].supports[0].is_pole);
  EXPECT_FALSE(land_use.power_lines[0].supports[1].is_pole);
  EXPECT_TRUE(land_use.power_lines[1].is_aerialway);
  EXPECT_FALSE(land_use.power_lines[1].is_minor);
  EXPECT_TRUE(land_use.power_lines[1].supports[1].is_pole);
  EXPECT_EQ(land_use.power_lines[1].supports[1].height_m, 30.0);
  EXPECT_TRUE(land_use.power_lines[2].is_aerialway);
  EXPECT_TRUE(land_use.power_lines[2].is_minor);
}

TEST_F(OsmFiles, StructuresSayWhatTheyAreAndWindTurbinesHowWide) {
  const LandUse land_use =
      read(document(node(1, 0, 0, tag("man_made", "mast")) +
                    node(2, 1, 0, tag("man_made", "chimney") + tag("height", "90")) +
                    node(3, 2, 0,
                         tag("power", "generator") + tag("generator:source", "wind") +
                             tag("rotor:diameter", "120")) +
                    node(4, 3, 0, tag("man_made", "water_tower"))));
  ASSERT_EQ(land_use.lines.size(), 4U);
  EXPECT_EQ(land_use.lines[0].structure_kind, StructureKind::kMast);
  EXPECT_EQ(land_use.lines[1].structure_kind, StructureKind::kChimney);
  EXPECT_EQ(land_use.lines[1].height_m, 90.0);
  EXPECT_EQ(land_use.lines[2].structure_kind, StructureKind::kWindTurbine);
  EXPECT_EQ(land_use.lines[2].radius_m, 60.0);
  EXPECT_EQ(land_use.lines[3].structure_kind, StructureKind::kStructure);
  EXPECT_FALSE(land_use.lines[3].radius_m);
}

TEST_F(OsmFiles, AMultipolygonHasItsHole) {
  const LandUse land_use = read(document(
      two_squares() + way(1, {1, 2, 3}, "") + way(2, {3, 4, 1}, "") + way(3, {5, 6, 7, 8, 5}, "") +
      relation(7, {{1, "outer"}, {2, "outer"}, {3, "inner"}}, tag("landuse", "forest"))));
  ASSERT_EQ(land_use.areas.size(), 1U);
  ASSERT_EQ(land_use.areas[0].polygons.size(), 1U);
  EXPECT_EQ(land_use.areas[0].polygons[0].outer.size(), 5U);
  EXPECT_EQ(land_use.areas[0].polygons[0].holes.size(), 1U);
}

TEST_F(OsmFiles, AMultipolygonTaggedOnItsOuterWayHasItsHoleToo) {
  const LandUse land_use =
      read(document(two_squares() + way(1, {1, 2, 3, 4, 1}, tag("landuse", "forest")) +
                    way(3, {5, 6, 7, 8, 5}, tag("natural", "water")) +
                    relation(7, {{1, "outer"}, {3, "inner"}}, "")));
  ASSERT_EQ(land_use.areas.size(), 2U);
  for (const AreaObject& area : land_use.areas) {
    EXPECT_EQ(area.polygons[0].holes.size(), area.object_class == ObjectClass::kForest ? 1U : 0U);
  }
}

TEST_F(OsmFiles, IncompleteRelationsAreCountedAndTheirClosedWaysStay) {
  const LandUse land_use =
      read(document(two_squares() + way(1, {1, 2, 3, 4, 1}, tag("building", "yes")) +
                    relation(7, {{1, "outer"}, {99, "outer"}}, tag("landuse", "forest")) +
                    relation(8, {{98, "outer"}}, "")));
  EXPECT_EQ(land_use.incomplete_relation_count, 2);
  EXPECT_THAT(land_use.incomplete_relation_ids, testing::UnorderedElementsAre(7, 8));
  ASSERT_EQ(land_use.areas.size(), 1U);
  EXPECT_EQ(land_use.areas[0].object_class, ObjectClass::kBuilding);
}

TEST_F(OsmFiles, CoversTheBoundsOfItsHeaderOrElseItsNodes) {
  const std::string bounds =
      "<bounds minlat=\"49.99\" minlon=\"10.98\" maxlat=\"50.05\" maxlon=\"11.04\"/>\n";
  const LandUse with_bounds = read(document(two_squares(), bounds));
  ASSERT_EQ(with_bounds.mapped.size(), 1U);
  EXPECT_NEAR(degrees_from_radians(with_bounds.mapped[0].west_rad), 10.98, 1e-9);
  EXPECT_NEAR(degrees_from_radians(with_bounds.mapped[0].north_rad), 50.05, 1e-9);
  const LandUse without = read(document(two_squares()));
  EXPECT_NEAR(degrees_from_radians(without.mapped[0].east_rad), 11.01, 1e-9);
  EXPECT_NEAR(degrees_from_radians(without.mapped[0].south_rad), 50.0, 1e-9);
}

TEST_F(OsmFiles, WhatLiesElsewhereIsLeftOut) {
  const LandUse land_use = read(document(
      node(1, 500, 500) + node(2, 501, 500) + node(3, 501, 501) + node(4, 0, 0) +
      way(1, {1, 2, 3, 1}, tag("building", "yes")) + way(2, {1, 2}, tag("power", "line"))));
  EXPECT_TRUE(land_use.areas.empty());
  EXPECT_TRUE(land_use.power_lines.empty());
}

TEST_F(OsmFiles, TheSameFileTwiceCountsOnce) {
  const fs::path path = folder_.path() / "a.osm";
  std::ofstream(path) << document(two_squares() + way(1, {1, 2, 3, 4, 1}, tag("building", "yes")) +
                                  way(2, {1, 2}, tag("power", "line")));
  SilentObserver observer;
  const LandUse land_use = read_land_use({path, path}, projection_, region_, observer);
  EXPECT_EQ(land_use.areas.size(), 1U);
  EXPECT_EQ(land_use.power_lines.size(), 1U);
}

TEST_F(OsmFiles, ReadsCompressedFiles) {
  const std::string text =
      document(two_squares() + way(1, {1, 2, 3, 4, 1}, tag("building", "yes")));
  const fs::path path = folder_.path() / "area.osm.gz";
  gzFile file = gzopen(path.c_str(), "wb");
  gzwrite(file, text.data(), static_cast<unsigned>(text.size()));
  gzclose(file);
  EXPECT_EQ(read_path(path).areas.size(), 1U);
}

TEST_F(OsmFiles, RefusalsSayWhatIsWrongWithWhichFile) {
  EXPECT_THAT(refusal_of(folder_.path() / "nowhere.osm"), HasSubstr("no such file"));
  EXPECT_THAT(refusal_of(folder_.path()), HasSubstr("is not a file"));
  const auto write = [&](const char* name, const std::string& text) {
    std::ofstream(folder_.path() / name, std::ios::binary) << text;
    return folder_.path() / name;
  };
  EXPECT_THAT(refusal_of(write("empty.osm", document(""))), HasSubstr("holds no nodes"));
  EXPECT_THAT(refusal_of(write("cut.osm", document(two_squares()).substr(0, 200))),
              HasSubstr("cannot be read"));
  EXPECT_THAT(refusal_of(write("text.osm.pbf", "hello")), HasSubstr("cannot be read"));
  EXPECT_THAT(refusal_of(write("text.osm.gz", "hello")), HasSubstr("cannot be read"));
  EXPECT_THAT(refusal_of(write("picture.png", "hello")), HasSubstr("cannot be read"));
  EXPECT_THAT(refusal_of(write("unsorted.osm",
                               document(way(1, {1, 2}, tag("power", "line")) + two_squares()))),
              HasSubstr("not sorted"));
}

TEST_F(OsmFiles, StopsWhenAsked) {
  class Stopped final : public Observer {
   public:
    void progress(std::string_view, double, double) override {}
    void note(std::string_view) override {}
    [[nodiscard]] bool stop_requested() const override { return true; }
  } observer;
  std::ofstream(folder_.path() / "a.osm") << document(two_squares());
  EXPECT_THROW((void)read_land_use({folder_.path() / "a.osm"}, projection_, region_, observer),
               Interrupted);
}

TEST(LandUseOfRealExtract, NorthOfBayreuthIsRead) {
  const char* data = std::getenv("HEDGEHOP_DATA");
  const fs::path path =
      fs::path(data == nullptr ? "../shared/data" : data) / "bayreuth/bayreuth_north_2014.osm.gz";
  if (!fs::exists(path)) {
    GTEST_SKIP() << "no real data at " << path.string();
  }
  SilentObserver observer;
  const geo::MapProjection projection("EPSG:32632");
  const LandUse land_use = read_land_use({path}, projection,
                                         {radians_from_degrees(11.0), radians_from_degrees(49.5),
                                          radians_from_degrees(12.0), radians_from_degrees(50.5)},
                                         observer);
  std::array<int, kObjectClassCount> counts{};
  for (const AreaObject& area : land_use.areas) {
    ++counts[static_cast<std::size_t>(area.object_class)];
  }
  // The extract's own description: 4267 buildings, 128 forest areas, 168 residential areas, 24
  // lines.
  EXPECT_NEAR(counts[static_cast<std::size_t>(ObjectClass::kBuilding)], 4267, 15);
  EXPECT_NEAR(counts[static_cast<std::size_t>(ObjectClass::kForest)], 128, 8);
  EXPECT_GE(counts[static_cast<std::size_t>(ObjectClass::kBuiltUpArea)], 168);
  EXPECT_EQ(land_use.power_lines.size(), 24U);
  EXPECT_NEAR(degrees_from_radians(land_use.mapped[0].west_rad), 11.4807, 1e-7);
}

}  // namespace
}  // namespace hedgehop::map_sources
