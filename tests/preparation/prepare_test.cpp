#include "preparation/prepare.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <fstream>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "base/files.hpp"
#include "base/shipped_config.hpp"
#include "map/map_bundle.hpp"
#include "map/source_layer.hpp"
#include "preparation/ground_weights.hpp"
#include "support/elevation_files.hpp"
#include "support/temporary_folder.hpp"

namespace hedgehop::preparation {
namespace {

namespace fs = std::filesystem;
using map::SemanticClass;
using testing::HasSubstr;

PrepareOptions shipped_options() {
  ConfigReader reader = ConfigReader::from_text(shipped_config("prepare.yaml"), "prepare.yaml");
  return PrepareOptions::read(reader);
}

geo::GeodeticBox box_deg(double west, double south, double east, double north) {
  return {radians_from_degrees(west), radians_from_degrees(south), radians_from_degrees(east),
          radians_from_degrees(north)};
}

bool has(const map::Map& map, raster::CellIndex cell, SemanticClass value) {
  return (map.semantics.at(cell) & static_cast<std::uint16_t>(value)) != 0;
}

class Listener final : public Observer {
 public:
  explicit Listener(int stop_after = -1) : stop_after_(stop_after) {}
  void progress(std::string_view stage, double done, double total) override {
    EXPECT_GE(done, 0.0) << stage;
    EXPECT_LE(done, total + 1e-9) << stage;
    ++calls_;
  }
  void note(std::string_view text) override { notes += std::string(text) + "\n"; }
  [[nodiscard]] bool stop_requested() const override {
    return stop_after_ >= 0 && calls_ >= stop_after_;
  }
  [[nodiscard]] int calls() const { return calls_; }
  std::string notes;

 private:
  int stop_after_;
  std::atomic<int> calls_ = 0;
};

// Land use drawn on a sheet in map coordinates around (500000, 5540000), UTM zone 32.
class Drawing {
 public:
  int node(double x_m, double y_m, const std::string& tags = "") {
    const geo::GeodeticPosition p = projection_.to_geodetic({x_m, y_m});
    char text[200];
    std::snprintf(text, sizeof(text), "<node id=\"%d\" version=\"1\" lat=\"%.7f\" lon=\"%.7f\">",
                  ++nodes_, degrees_from_radians(p.latitude_rad),
                  degrees_from_radians(p.longitude_rad));
    node_text_ += text + tags + "</node>\n";
    return nodes_;
  }
  void way(const std::vector<int>& refs, const std::string& tags) {
    way_text_ += "<way id=\"" + std::to_string(++ways_) + "\" version=\"1\">";
    for (const int ref : refs) {
      way_text_ += "<nd ref=\"" + std::to_string(ref) + "\"/>";
    }
    way_text_ += tags + "</way>\n";
  }
  void rectangle(double west_m, double south_m, double east_m, double north_m,
                 const std::string& tags) {
    const int a = node(west_m, south_m);
    const int b = node(east_m, south_m);
    const int c = node(east_m, north_m);
    const int d = node(west_m, north_m);
    way({a, b, c, d, a}, tags);
  }
  void write(const fs::path& path, const geo::GeodeticBox& bounds,
             const std::string& generator = "test") const {
    std::ofstream file(path);
    file.precision(12);
    file << "<?xml version=\"1.0\"?>\n<osm version=\"0.6\" generator=\"" << generator
         << "\">\n<bounds minlat=\"" << degrees_from_radians(bounds.south_rad) << "\" minlon=\""
         << degrees_from_radians(bounds.west_rad) << "\" maxlat=\""
         << degrees_from_radians(bounds.north_rad) << "\" maxlon=\""
         << degrees_from_radians(bounds.east_rad) << "\"/>\n"
         << node_text_ << way_text_ << "</osm>\n";
  }

 private:
  geo::MapProjection projection_{"EPSG:32632"};
  int nodes_ = 0;
  int ways_ = 0;
  std::string node_text_;
  std::string way_text_;
};

std::string tag(const std::string& key, const std::string& value) {
  return "<tag k=\"" + key + "\" v=\"" + value + "\"/>";
}

class Prepare : public testing::Test {
 protected:
  Prepare() {
    options_.visibility.radius_m = 900.0;
    options_.visibility.azimuths = 32;
  }
  fs::path path(const std::string& name) const { return folder_.path() / name; }
  // 15 x 15 km of elevation around the sheet's origin, 8.9..9.1 E.
  fs::path elevation(const std::function<double(double, double)>& height_m) {
    test::write_raster(path("dem.tif"),
                       {"EPSG:32632", 492500.0, 5547500.0, 30.0, 500, 500, -9999.0, ""}, height_m);
    return path("dem.tif");
  }
  PreparedMap prepared(const PrepareRequest& request) {
    return prepare(request, options_, listener_);
  }
  template <typename Error = DataError>
  std::string refusal_of(const PrepareRequest& request) {
    try {
      (void)prepared(request);
    } catch (const Error& error) {
      EXPECT_NE(error.hint(), "") << error.what();
      return error.what();
    }
    return "";
  }
  static raster::CellIndex cell(const map::Map& map, double x_m, double y_m) {
    return map.geometry.cell_at({x_m, y_m});
  }
  static double above_terrain_m(const map::Map& map, double x_m, double y_m) {
    const raster::CellIndex c = cell(map, x_m, y_m);
    return static_cast<double>(map.surface_m.at(c)) - static_cast<double>(map.terrain_m.at(c));
  }

  test::TemporaryFolder folder_;
  PrepareOptions options_ = shipped_options();
  Listener listener_;
  geo::GeodeticBox sheet_ =
      box_deg(8.97, 49.98, 9.03, 50.02);  // 4.3 x 4.4 km, origin near its middle
};

TEST_F(Prepare, PutsEveryObjectOnTheGroundAndEveryBitIntoItsCell) {
  Drawing drawing;
  // The sheet's middle: 9 E, 50 N is (500000, 5538630.7).
  const double y = 5538630.0;
  drawing.rectangle(500300, y, 500900, y + 600, tag("landuse", "forest") + tag("height", "30"));
  drawing.node(499100, y + 5, tag("natural", "tree"));
  drawing.rectangle(499403, y - 302, 499407, y - 298,
                    tag("building", "yes") + tag("building:levels", "4"));
  const int a = drawing.node(498900, y - 900, tag("power", "tower") + tag("height", "50"));
  const int b = drawing.node(499800, y - 900);
  drawing.way({a, b}, tag("power", "line"));
  drawing.rectangle(500500, y - 1200, 500600, y - 1100, tag("natural", "water"));
  drawing.write(path("a.osm"), sheet_);
  const PreparedMap result = prepared({{elevation([](double, double) { return 400.0; })},
                                       {path("a.osm")},
                                       sheet_,
                                       {},
                                       "",
                                       "",
                                       {},
                                       1});
  const map::Map& map = result.map;

  EXPECT_EQ(above_terrain_m(map, 500600, y + 300), 30.0);
  EXPECT_TRUE(has(map, cell(map, 500600, y + 300), SemanticClass::kForest));
  EXPECT_EQ(above_terrain_m(map, 500200, y + 300), 0.0);
  EXPECT_EQ(above_terrain_m(map, 499100, y + 5), options_.default_heights.tree_m);
  EXPECT_TRUE(has(map, cell(map, 499100, y + 5), SemanticClass::kTree));
  // Four metres wide in a cell of 30 m: a single cell, at full height.
  EXPECT_EQ(above_terrain_m(map, 499405, y - 300), 4 * options_.default_heights.building_level_m);
  EXPECT_TRUE(has(map, cell(map, 499405, y - 300), SemanticClass::kVillage));
  // From 50 m down to the default over 900 m, straight; the cell's higher end counts.
  const double low_m = options_.default_heights.power_line_m;
  EXPECT_GE(above_terrain_m(map, 499350, y - 900), 0.5 * (50.0 + low_m));
  EXPECT_LE(above_terrain_m(map, 499350, y - 900),
            0.5 * (50.0 + low_m) + 30.0 / 900.0 * 5.0 + 0.02);
  EXPECT_TRUE(has(map, cell(map, 499350, y - 900), SemanticClass::kPowerLine));
  EXPECT_EQ(above_terrain_m(map, 500550, y - 1150), 0.0);
  EXPECT_TRUE(has(map, cell(map, 500550, y - 1150), SemanticClass::kWater));
  ASSERT_EQ(map.overhead_lines.size(), 1U);
  EXPECT_EQ(map.overhead_lines[0].supports[0].height_m, 50.0);
  const auto provenance = nlohmann::json::parse(result.provenance_json);
  // Tagged: forest and one support; levels: the house; guessed: the tree and the other support.
  EXPECT_NEAR(provenance["guessed_height_share"].get<double>(), 2.0 / 5.0, 1e-6);
}

TEST_F(Prepare, NothingFliesUnderALineAcrossAValley) {
  // A valley 200 m deep between two pylons on its rims.
  const double y = 5538645.0;  // the middle of a row of cells
  const auto height_m = [](double x_m, double) {
    return std::fabs(x_m - 500000.0) < 600.0 ? 300.0 : 500.0;
  };
  Drawing drawing;
  const int a = drawing.node(499200, y);
  const int b = drawing.node(500800, y);
  drawing.way({a, b}, tag("power", "line") + tag("height", "40"));
  drawing.write(path("a.osm"), sheet_);
  const map::Map map =
      prepared({{elevation(height_m)}, {path("a.osm")}, sheet_, {}, "", "", {}, 1}).map;
  EXPECT_NEAR(static_cast<double>(map.surface_m.at(cell(map, 500000, y))), 540.0, 0.1);
  EXPECT_NEAR(static_cast<double>(map.surface_m.at(cell(map, 500000, y + 90))), 300.0, 0.1);
}

TEST_F(Prepare, ObstacleAndAreaFilesEndUpInTheMap) {
  const double y = 5538630.0;
  const geo::MapProjection projection("EPSG:32632");
  const auto degrees = [&](double x_m, double y_m) {
    const geo::GeodeticPosition p = projection.to_geodetic({x_m, y_m});
    char text[80];
    std::snprintf(text, sizeof text, "%.9f,%.9f", degrees_from_radians(p.latitude_rad),
                  degrees_from_radians(p.longitude_rad));
    return std::string(text);
  };
  std::ofstream(path("o.csv"))
      << "latitude,longitude,height_m,horizontal_error_m,vertical_error_m\n"
      << degrees(500000, y) << ",80,25,4\n"
      << degrees(560000, y) << ",80,25,4\n";
  std::ofstream(path("a.txt")) << "AC R\nAN inside\nAL 100 ft AGL\nAH FL 65\n"
                                  "V X=50:00:00 N 009:00:00 E\nDC 0.3\n"
                                  "AC D\nAN controlled\nV X=50:00:00 N 009:00:00 E\nDC 0.3\n"
                                  "AC Q\nAN danger\nV X=50:00:00 N 009:00:00 E\nDC 0.3\n";
  PrepareRequest request{
      {elevation([](double, double) { return 400.0; })}, {}, sheet_, {}, "", "", {}, 1};
  request.obstacle_files = {path("o.csv")};
  request.area_files = {path("a.txt")};
  const PreparedMap result = prepared(request);
  const map::Map& map = result.map;
  ASSERT_EQ(map.obstacles.size(), 1U);
  EXPECT_EQ(map.obstacles[0].radius_m, 25.0 + options_.obstacles.safety_radius_m);
  EXPECT_NEAR(map.obstacles[0].top_m, 484.0, 1e-9);
  EXPECT_EQ(above_terrain_m(map, 500000, y), 84.0);
  EXPECT_EQ(above_terrain_m(map, 500034, y), 84.0);
  EXPECT_EQ(above_terrain_m(map, 500090, y), 0.0);
  EXPECT_TRUE(has(map, cell(map, 500000, y), SemanticClass::kObstacle));
  ASSERT_EQ(map.areas.size(), 2U);
  EXPECT_EQ(map.areas[0].name, "inside");
  EXPECT_TRUE(map.areas[0].is_hard);
  EXPECT_NEAR(map.areas[0].floor.value_m, 30.48, 1e-9);
  EXPECT_EQ(map.areas[0].floor.reference, map::AreaLimit::Reference::kAboveGround);
  EXPECT_NEAR(map.areas[0].ceiling.value_m, 1981.2, 1e-9);
  EXPECT_FALSE(map.areas[1].is_hard);
  EXPECT_THAT(listener_.notes, HasSubstr("1 areas are left out"));
  const auto provenance = nlohmann::json::parse(result.provenance_json);
  EXPECT_EQ(provenance["obstacle_file_statistics"]["records"], 2);
  EXPECT_EQ(provenance["areas_left_out_by_kind"]["D"], 1);
  EXPECT_EQ(provenance["inputs"][1]["kind"], "obstacles");
  EXPECT_EQ(provenance["inputs"][2]["kind"], "areas");
}

TEST_F(Prepare, SettlementsCloseTheirStreetsAndGetRingsBySize) {
  const double y = 5538630.0;
  Drawing drawing;
  // Two quarters with a street of 40 m between: one settlement of 600 x 600 m = 36 ha.
  drawing.rectangle(499400, y - 300, 499680, y + 300, tag("landuse", "residential"));
  drawing.rectangle(499720, y - 300, 500000, y + 300, tag("landuse", "residential"));
  // A farm far away.
  drawing.rectangle(501200, y, 501300, y + 50, tag("landuse", "farmyard"));
  drawing.write(path("a.osm"), sheet_);
  const PreparedMap result = prepared({{elevation([](double, double) { return 400.0; })},
                                       {path("a.osm")},
                                       sheet_,
                                       {},
                                       "",
                                       "",
                                       {},
                                       1});
  const map::Map& map = result.map;
  const auto at = [&](double x_m, SemanticClass value) {
    return has(map, cell(map, x_m, y + 25), value);
  };
  EXPECT_TRUE(at(499700, SemanticClass::kSettlement));  // the street
  EXPECT_FALSE(at(499700, SemanticClass::kBuiltUpArea));
  EXPECT_FALSE(at(499700, SemanticClass::kVillage));
  EXPECT_TRUE(at(500000 + 170, SemanticClass::kSettlementAdequate));
  EXPECT_FALSE(at(500000 + 235, SemanticClass::kSettlementAdequate));
  EXPECT_TRUE(at(500000 + 370, SemanticClass::kSettlementDesired));
  EXPECT_FALSE(at(500000 + 435, SemanticClass::kSettlementDesired));
  EXPECT_TRUE(at(501250, SemanticClass::kVillage));
  EXPECT_FALSE(at(501250, SemanticClass::kSettlement));
  EXPECT_TRUE(at(501200 - 25, SemanticClass::kVillageAdequate));
  EXPECT_FALSE(at(501200 - 65, SemanticClass::kVillageAdequate));
  EXPECT_TRUE(at(501200 - 55, SemanticClass::kVillageDesired));
  EXPECT_FALSE(at(501200 - 95, SemanticClass::kVillageDesired));
  const auto provenance = nlohmann::json::parse(result.provenance_json);
  EXPECT_EQ(provenance["land_use_statistics"]["settlements"], 1);
  EXPECT_EQ(provenance["land_use_statistics"]["villages"], 1);
}

TEST_F(Prepare, OutsideTheCoveredPartCellsAreUnmappedButObstaclesStayThere) {
  const double y = 5538630.0;
  Drawing drawing;
  drawing.rectangle(499000, y - 500, 501800, y + 500, tag("landuse", "forest"));
  drawing.write(path("a.osm"), box_deg(8.97, 49.98, 9.0, 50.02));  // the western half
  const PreparedMap result = prepared({{elevation([](double, double) { return 400.0; })},
                                       {path("a.osm")},
                                       sheet_,
                                       {},
                                       "",
                                       "",
                                       {},
                                       1});
  const map::Map& map = result.map;
  EXPECT_TRUE(has(map, cell(map, 499500, y), SemanticClass::kForest));
  EXPECT_EQ(map.semantics.at(cell(map, 500500, y)),
            static_cast<std::uint16_t>(SemanticClass::kUnmapped));
  EXPECT_EQ(above_terrain_m(map, 500500, y), options_.default_heights.forest_m);
  const auto provenance = nlohmann::json::parse(result.provenance_json);
  EXPECT_NEAR(provenance["mapped_extent_deg"][0]["east"].get<double>(), 9.0, 1e-9);
}

TEST_F(Prepare, TheMarginMakesTheBorderAsGoodAsTheMiddle) {
  const fs::path dem = elevation(
      [](double x, double y) { return 400.0 + 60.0 * std::sin(x / 300.0) * std::cos(y / 250.0); });
  const map::Map large =
      prepared({{dem}, {}, box_deg(8.97, 49.98, 9.03, 50.02), {}, "EPSG:32632", "", {}, 1}).map;
  const map::Map small =
      prepared({{dem}, {}, box_deg(8.99, 49.995, 9.01, 50.005), {}, "EPSG:32632", "", {}, 2}).map;
  const int dx =
      static_cast<int>(std::lround((small.geometry.west_m - large.geometry.west_m) / 30.0));
  const int dy =
      static_cast<int>(std::lround((small.geometry.south_m - large.geometry.south_m) / 30.0));
  for (int row = 0; row < small.geometry.rows; ++row) {
    for (int column = 0; column < small.geometry.columns; ++column) {
      ASSERT_EQ(small.terrain_m.at(column, row), large.terrain_m.at(column + dx, row + dy));
      ASSERT_EQ(small.visibility.at(column, row), large.visibility.at(column + dx, row + dy));
    }
  }
  EXPECT_TRUE(has(small, {0, 0}, SemanticClass::kUnmapped));
}

TEST_F(Prepare, TilesHaveTheBytesOfTheirPartOfTheWholeRegion) {
  // A settlement, a forest and a power line across every cut, rough ground with holes.
  const fs::path dem = path("dem.tif");
  test::write_raster(dem, {"EPSG:32632", 492500.0, 5547500.0, 30.0, 500, 500, -9999.0, ""},
                     [](double x, double y) {
                       const auto mixed = static_cast<std::int64_t>(x * 7919.0 + y * 104729.0);
                       return mixed % 97 == 0
                                  ? -9999.0
                                  : 400.0 + 60.0 * std::sin(x / 300.0) * std::cos(y / 250.0) +
                                        static_cast<double>(mixed % 11);
                     });
  const double y = 5538630.0;
  Drawing drawing;
  drawing.rectangle(497000, y - 90, 503000, y + 90, tag("landuse", "residential"));
  drawing.rectangle(499950, y - 2500, 500050, y + 2500, tag("landuse", "industrial"));
  drawing.rectangle(498500, y + 400, 501500, y + 900, tag("natural", "wood"));
  std::vector<int> poles;
  for (int i = 0; i <= 8; ++i) {
    poles.push_back(drawing.node(498000 + 500 * i, y - 1500 + 375 * i));
  }
  drawing.way(poles, tag("power", "line"));
  drawing.write(path("a.osm"), box_deg(8.9, 49.9, 9.1, 50.1));
  options_.visibility.further_heights_m = {40.0};
  options_.ground_weights = {0.5, 1.0, 0.25, 1.0};
  PrepareRequest request;
  request.dem_files = {dem};
  request.osm_files = {path("a.osm")};
  request.extent = box_deg(8.98, 49.985, 9.02, 50.01);
  request.threads = 2;
  const map::Map whole = prepared(request).map;
  EXPECT_TRUE(std::any_of(
      whole.semantics.values().begin(), whole.semantics.values().end(), [](std::uint16_t bits) {
        return (bits & static_cast<std::uint16_t>(SemanticClass::kSettlement)) != 0;
      }));
  std::size_t cells = 0;
  for (const int count : {6, 1}) {
    cells = 0;
    for (int index = 1; index <= count; ++index) {
      request.tile = TileNumber{index, count};
      request.threads = 1 + index % 2;
      const map::Map part = prepared(request).map;
      const auto dx =
          static_cast<int>(std::lround((part.geometry.west_m - whole.geometry.west_m) / 30.0));
      const auto dy =
          static_cast<int>(std::lround((part.geometry.south_m - whole.geometry.south_m) / 30.0));
      ASSERT_EQ(part.further_visibility.size(), 1U);
      cells += part.geometry.cell_count();
      for (int row = 0; row < part.geometry.rows; ++row) {
        for (int column = 0; column < part.geometry.columns; ++column) {
          const raster::CellIndex there{column + dx, row + dy};
          // Unknown heights are unequal to themselves.
          const auto same = [](float a, float b) { return a == b || (a != a && b != b); };
          ASSERT_TRUE(same(part.terrain_m.at(column, row), whole.terrain_m.at(there)));
          ASSERT_TRUE(same(part.surface_m.at(column, row), whole.surface_m.at(there)));
          ASSERT_EQ(part.semantics.at(column, row), whole.semantics.at(there));
          ASSERT_EQ(part.visibility.at(column, row), whole.visibility.at(there));
          ASSERT_EQ(part.further_visibility[0].share.at(column, row),
                    whole.further_visibility[0].share.at(there));
        }
      }
    }
    EXPECT_EQ(cells, whole.geometry.cell_count());
  }
  for (const TileNumber& bad : {TileNumber{0, 4}, TileNumber{5, 4}, TileNumber{1, 0}}) {
    request.tile = bad;
    EXPECT_THROW((void)prepared(request), UsageError);
  }
}

TEST_F(Prepare, NamedObserversGetALayerAndSayWhatTheySee) {
  std::ofstream(path("observers.yaml")) << "observers:\n"
                                           "  - {name: hill, latitude_deg: 50.0, longitude_deg: "
                                           "9.0, mast_height_m: 30, range_m: 1000}\n"
                                           "  - {name: far away, latitude_deg: 10.0, "
                                           "longitude_deg: 9.0, mast_height_m: 3, range_m: 99}\n";
  PrepareRequest request;
  request.dem_files = {elevation([](double, double) { return 400.0; })};
  request.extent = box_deg(8.97, 49.98, 9.03, 50.02);
  request.observers_file = path("observers.yaml");
  const PreparedMap result = prepared(request);
  ASSERT_EQ(result.threats.size(), 2U);
  EXPECT_EQ(result.threats[0].name, "hill");
  const raster::Grid<float>& seen = result.threats[0].lowest_seen_m;
  ASSERT_EQ(seen.geometry(), result.map.geometry);
  EXPECT_EQ(seen.at(cell(result.map, 500600, 5538630)), 0.0F);  // level ground
  const auto threats = nlohmann::json::parse(result.provenance_json)["threats"];
  // pi 1000^2 / 30^2 cells
  EXPECT_NEAR(threats[0]["cells_in_range"].get<double>(), 3490.7, 70.0);
  EXPECT_EQ(threats[1]["cells_in_range"], 0);
}

TEST_F(Prepare, GroundOfAKindCountsAsTheConfigSays) {
  raster::Grid<std::uint16_t> semantics({0.0, 0.0, 30.0, 5, 1}, 0);
  const auto set = [&](int column, std::initializer_list<SemanticClass> classes) {
    for (const SemanticClass one : classes) {
      semantics.at(column, 0) |= static_cast<std::uint16_t>(one);
    }
  };
  set(0, {SemanticClass::kForest});
  set(1, {SemanticClass::kForest, SemanticClass::kSettlement});
  set(2, {SemanticClass::kWater});
  set(3, {SemanticClass::kSettlementDesired, SemanticClass::kPowerLine});
  const auto weights = ground_weights(semantics, {0.25, 0.5, 0.0, 1.0});
  EXPECT_THAT(weights.values(), testing::ElementsAre(16, 32, 0, 64, 64));
  EXPECT_TRUE(ground_weights(semantics, {1.0, 1.0, 1.0, 1.0}).is_empty());
}

TEST_F(Prepare, SameFilesGiveTheSameBundleWhateverTheThreads) {
  const double y = 5538630.0;
  Drawing drawing;
  drawing.rectangle(499000, y - 500, 500100, y + 500, tag("landuse", "forest"));
  drawing.rectangle(500300, y - 500, 501000, y + 500, tag("landuse", "residential"));
  drawing.write(path("a.osm"), sheet_);
  const fs::path dem =
      elevation([](double x, double z) { return 400.0 + 50.0 * std::sin(x / 400.0 + z / 900.0); });
  std::array<std::string, 2> bytes;
  for (const int threads : {1, 3}) {
    const PreparedMap result =
        prepared({{dem}, {path("a.osm")}, sheet_, {}, "", "LABEL", {"(c) surveyor"}, threads});
    const test::TemporaryFolder bundle;
    map::write_map_bundle(result.map, result.provenance_json, bundle.path());
    map::write_source_layer(result.map, result.sources, bundle.path());
    for (const char* name : {"manifest.json", "terrain.tif", "surface.tif", "semantics.tif",
                             "visibility.tif", "features.gpkg", "sources.tif"}) {
      bytes[threads == 1 ? 0 : 1] += read_file(bundle.path() / name);
    }
    EXPECT_EQ(map::read_map_bundle(bundle.path()).hash, result.map.hash);
    EXPECT_THAT(result.map.attributions,
                testing::ElementsAre(options_.attribution_openstreetmap, "(c) surveyor"));
    EXPECT_EQ(result.map.label, "LABEL");
  }
  EXPECT_EQ(bytes[0], bytes[1]);
}

TEST_F(Prepare, ASyntheticFileIsNotCreditedToOpenStreetMap) {
  Drawing drawing;
  drawing.node(500000, 5538630);
  drawing.write(path("a.osm"), sheet_, "hedgehop synthetic region");
  const PreparedMap result = prepared({{elevation([](double, double) { return 1.0; })},
                                       {path("a.osm")},
                                       sheet_,
                                       {},
                                       "",
                                       "",
                                       {},
                                       1});
  EXPECT_TRUE(result.map.attributions.empty());
}

TEST_F(Prepare, RefusesWhatCannotBeMeantOrIsNotThere) {
  const fs::path dem = elevation([](double, double) { return 400.0; });
  PrepareRequest request{{dem}, {}, sheet_, {}, "", "", {}, 1};
  EXPECT_EQ(refusal_of(request), "");

  request.extent = box_deg(20.0, 50.0, 20.1, 50.1);
  EXPECT_THAT(refusal_of(request), testing::AllOf(HasSubstr("20.0000"), HasSubstr("lies outside")));
  request.extent = box_deg(9.03, 49.98, 8.97, 50.02);
  EXPECT_THAT(refusal_of<UsageError>(request), HasSubstr("empty"));
  request.extent = sheet_;
  request.cell_m = 0.0;
  EXPECT_THAT(refusal_of<UsageError>(request), HasSubstr("cell size"));
  request.cell_m = {};
  request.crs = "EPSG:4326";
  EXPECT_THAT(refusal_of(request), HasSubstr("EPSG:4326"));
  request.crs = "";
  request.osm_files = {path("nowhere.osm")};
  EXPECT_THAT(refusal_of(request), HasSubstr("nowhere.osm"));
  request.osm_files = {};
  request.dem_files = {path("nowhere.tif")};
  EXPECT_THAT(refusal_of(request), HasSubstr("nowhere.tif"));
  request.dem_files = {};
  EXPECT_THAT(refusal_of<UsageError>(request), HasSubstr("no elevation file"));

  test::write_raster(path("void.tif"),
                     {"EPSG:32632", 492500.0, 5547500.0, 30.0, 500, 500, -9999.0, ""},
                     [](double, double) { return -9999.0; });
  request.dem_files = {path("void.tif")};
  EXPECT_THAT(refusal_of(request), HasSubstr("every sample there is void"));

  options_.cells_max = 1000;
  request.dem_files = {dem};
  EXPECT_THAT(refusal_of<UsageError>(request), HasSubstr("more than the 1000"));
}

TEST_F(Prepare, PartlyMissingElevationIsSaidAndStaysUnknown) {
  test::write_raster(path("half.tif"),
                     {"EPSG:32632", 492500.0, 5547500.0, 30.0, 250, 500, -9999.0, ""},
                     [](double, double) { return 400.0; });
  const PreparedMap result = prepared({{path("half.tif")}, {}, sheet_, {}, "", "", {}, 1});
  EXPECT_TRUE(std::isnan(result.map.terrain_m.at(cell(result.map, 501000, 5538630))));
  EXPECT_EQ(result.map.visibility.at(cell(result.map, 501000, 5538630)), map::kVisibilityUnknown);
  EXPECT_THAT(listener_.notes, HasSubstr("has no elevation"));
}

TEST_F(Prepare, OffsetsAreNotAddedToASurfaceThatHoldsThem) {
  const double y = 5538630.0;
  Drawing drawing;
  drawing.rectangle(500300, y, 500900, y + 600, tag("landuse", "forest") + tag("height", "30"));
  drawing.rectangle(499403, y - 302, 499407, y - 298, tag("building", "yes"));
  drawing.node(499100, y + 5, tag("man_made", "mast") + tag("height", "70"));
  const int a = drawing.node(498900, y - 900);
  const int b = drawing.node(499800, y - 900);
  drawing.way({a, b}, tag("power", "line") + tag("height", "40"));
  drawing.write(path("a.osm"), sheet_);
  const fs::path dem = elevation([](double, double) { return 400.0; });
  for (const bool is_surface : {false, true}) {
    PrepareRequest request{{dem}, {path("a.osm")}, sheet_, {}, "", "", {}, 1};
    request.dem_files[0].kind =
        is_surface ? map_sources::ElevationKind::kSurface : map_sources::ElevationKind::kTerrain;
    const PreparedMap result = prepared(request);
    EXPECT_EQ(above_terrain_m(result.map, 500600, y + 300), is_surface ? 0.0 : 30.0);
    EXPECT_EQ(above_terrain_m(result.map, 499405, y - 300),
              is_surface ? 0.0 : options_.default_heights.building_m);
    EXPECT_TRUE(has(result.map, cell(result.map, 500600, y + 300), SemanticClass::kForest));
    EXPECT_GE(above_terrain_m(result.map, 499100, y + 5), 70.0);  // too thin to be in any surface
    EXPECT_GE(above_terrain_m(result.map, 499350, y - 900), 40.0);
    const auto origin = [&](double x_m, double y_m) {
      return map::unpacked_source(result.sources.at(cell(result.map, x_m, y_m))).origin;
    };
    EXPECT_EQ(origin(500600, y + 300),
              is_surface ? map::HeightOrigin::kElevation : map::HeightOrigin::kStated);
    EXPECT_EQ(origin(499405, y - 300),
              is_surface ? map::HeightOrigin::kElevation : map::HeightOrigin::kClassDefault);
    EXPECT_EQ(origin(499350, y - 900), map::HeightOrigin::kThin);
    EXPECT_EQ(map::unpacked_source(result.sources.at(0, 0)).elevation, 1);
    const auto provenance = nlohmann::json::parse(result.provenance_json);
    EXPECT_EQ(provenance["inputs"][0]["used_as"], is_surface ? "surface" : "terrain");
    EXPECT_EQ(provenance["inputs"][0]["used_as_from"], "command line");
  }
}

TEST_F(Prepare, BuiltUpCellsHaveAtLeastTheVisibilityThatTheSwitchGives) {
  const double y = 5538630.0;
  Drawing drawing;
  drawing.rectangle(499400, y - 300, 499680, y + 300, tag("landuse", "residential"));
  drawing.write(path("a.osm"), sheet_);
  const PrepareRequest request{
      {elevation([](double x, double) { return 400.0 + 60.0 * std::sin(x / 150.0); })},
      {path("a.osm")},
      sheet_,
      {},
      "",
      "",
      {},
      1};
  const map::Map plain = prepared(request).map;
  options_.settlements.visibility_min = 0.9;
  const map::Map shown = prepared(request).map;
  int raised = 0;
  for (std::size_t i = 0; i < plain.visibility.values().size(); ++i) {
    const std::uint16_t bits = shown.semantics.values()[i];
    const bool is_built_up =
        (bits & static_cast<std::uint16_t>(SemanticClass::kBuiltUpArea)) != 0 ||
        (bits & static_cast<std::uint16_t>(SemanticClass::kVillage)) != 0;
    const double before = map::visibility_share(plain.visibility.values()[i]);
    const double after = map::visibility_share(shown.visibility.values()[i]);
    ASSERT_NEAR(after, is_built_up ? std::max(before, 0.9) : before, 1e-5);
    raised += after > before ? 1 : 0;
  }
  EXPECT_GT(raised, 100);
}

TEST_F(Prepare, VectorsThroughAMappingGiveTheMapOfTheSameOsmFile) {
  // One forest and one line, drawn once as OpenStreetMap and once as GeoJSON in the map's frame.
  const double y = 5538637.0;  // off the edges of cells
  Drawing drawing;
  drawing.rectangle(500300, y, 500900, y + 600, tag("landuse", "forest") + tag("height", "30"));
  drawing.write(path("a.osm"), sheet_);
  std::ofstream(path("a.geojson"))
      << R"({"type":"FeatureCollection","crs":{"type":"name","properties":{"name":"EPSG:32632"}},)"
      << R"("features":[{"type":"Feature","properties":{"h":"98' 5.1\""},"geometry":)"
      << R"({"type":"Polygon","coordinates":[[[500300,5538637],[500900,5538637],)"
      << R"([500900,5539237],[500300,5539237],[500300,5538637]]]}}]})";
  const fs::path dem = elevation([](double, double) { return 400.0; });
  const map::Map osm = prepared({{dem}, {path("a.osm")}, sheet_, {}, "", "", {}, 1}).map;
  PrepareRequest request{{dem}, {}, sheet_, {}, "", "", {}, 1};
  request.vectors.push_back(
      {path("a.geojson"),
       map_sources::VectorMapping::read(
           "attribution: (c) surveyor\ncoverage_layers: [a]\nrules:\n  - {layer: "
           "a, class: forest, height_attribute: h, height_unit: ft}\n",
           "m.yaml")});
  const PreparedMap vectors = prepared(request);
  int forest = 0;
  for (std::size_t i = 0; i < osm.surface_m.values().size(); ++i) {
    // 98 ft 5.1 in = 29.9999 m, rounded up to 1/64 m as 30 m are.
    ASSERT_EQ(vectors.map.surface_m.values()[i], osm.surface_m.values()[i]);
    forest += osm.surface_m.values()[i] > 400.0F ? 1 : 0;
  }
  EXPECT_GT(forest, 350);
  EXPECT_THAT(vectors.map.attributions, testing::Contains("(c) surveyor"));
  const auto provenance = nlohmann::json::parse(vectors.provenance_json);
  EXPECT_EQ(provenance["vector_sources"][0]["rules"][0]["objects"], 1);
  EXPECT_EQ(provenance["inputs"][2]["kind"], "mapping");
  EXPECT_EQ(provenance["guessed_height_share"], 0.0);
}

TEST_F(Prepare, StopsInWhateverStageItIs) {
  Drawing drawing;
  drawing.rectangle(499000, 5538000, 500100, 5539000, tag("landuse", "residential"));
  drawing.write(path("a.osm"), sheet_);
  const PrepareRequest request{
      {elevation([](double, double) { return 1.0; })}, {path("a.osm")}, sheet_, {}, "", "", {}, 1};
  Listener whole;
  (void)prepare(request, options_, whole);
  for (int stop_after = 0; stop_after < whole.calls() - 1;
       stop_after += std::max(1, whole.calls() / 12)) {
    Listener stopping(stop_after);
    EXPECT_THROW((void)prepare(request, options_, stopping), Interrupted) << stop_after;
  }
}

TEST(PrepareOptions, TheShippedFileLoadsAndAMisspeltKeyIsRefused) {
  EXPECT_NO_THROW(shipped_options());
  std::string text(shipped_config("prepare.yaml"));
  text.replace(text.find("forest_m"), 8, "forrest_m");
  ConfigReader reader = ConfigReader::from_text(text, "prepare.yaml");
  EXPECT_THROW(PrepareOptions::read(reader), ConfigError);
}

}  // namespace
}  // namespace hedgehop::preparation
