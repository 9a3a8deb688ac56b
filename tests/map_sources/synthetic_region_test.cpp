#include "map_sources/synthetic_region.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <gdal_priv.h>
#include <gdal_utils.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <map>
#include <memory>
#include <numbers>
#include <ogr_spatialref.h>
#include <osmium/handler.hpp>
#include <osmium/handler/check_order.hpp>
#include <osmium/io/reader.hpp>
#include <osmium/io/xml_input.hpp>
#include <osmium/visitor.hpp>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "base/files.hpp"
#include "map_sources/synthetic_osm.hpp"
#include "map_sources/synthetic_terrain.hpp"

namespace hedgehop::map_sources {
namespace {

class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "hedgehop_XXXXXX").string();
    path_ = mkdtemp(pattern.data());
  }
  ~TemporaryFolder() { std::filesystem::remove_all(path_); }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// Heights as GDAL reads them, row by row from the north.
struct Heights {
  int columns = 0;
  int rows = 0;
  std::array<double, 6> transform{};
  std::vector<float> z;
};

Heights read_heights(GDALDataset& dataset) {
  Heights heights{dataset.GetRasterXSize(), dataset.GetRasterYSize(), {}, {}};
  dataset.GetGeoTransform(heights.transform.data());
  heights.z.resize(static_cast<std::size_t>(heights.columns) *
                   static_cast<std::size_t>(heights.rows));
  EXPECT_EQ(dataset.GetRasterBand(1)->RasterIO(GF_Read, 0, 0, heights.columns, heights.rows,
                                               heights.z.data(), heights.columns, heights.rows,
                                               GDT_Float32, 0, 0, nullptr),
            CE_None);
  return heights;
}

std::unique_ptr<GDALDataset> open_raster(const std::filesystem::path& path) {
  GDALAllRegister();
  return std::unique_ptr<GDALDataset>(
      GDALDataset::Open(path.c_str(), GDAL_OF_RASTER | GDAL_OF_VERBOSE_ERROR));
}

/// 90th percentile of the slope [deg] after resampling to 30 m, computed by GDAL.
double slope_p90_deg_by_gdal(GDALDataset& dataset) {
  std::array<const char*, 8> warp_words = {"-of", "MEM", "-tr",      "30",
                                           "30",  "-r",  "bilinear", nullptr};
  GDALWarpAppOptions* warp = GDALWarpAppOptionsNew(const_cast<char**>(warp_words.data()), nullptr);
  GDALDatasetH source = GDALDataset::ToHandle(&dataset);
  GDALDatasetH warped = GDALWarp("", nullptr, 1, &source, warp, nullptr);
  GDALWarpAppOptionsFree(warp);
  std::array<const char*, 3> slope_words = {"-of", "MEM", nullptr};
  GDALDEMProcessingOptions* options =
      GDALDEMProcessingOptionsNew(const_cast<char**>(slope_words.data()), nullptr);
  GDALDatasetH slope = GDALDEMProcessing("", warped, "slope", nullptr, options, nullptr);
  GDALDEMProcessingOptionsFree(options);
  std::vector<float> values = read_heights(*GDALDataset::FromHandle(slope)).z;
  GDALClose(slope);
  GDALClose(warped);
  std::erase_if(values, [](float value) { return value < 0.0F; });
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(values.size() * 9 / 10);
  std::nth_element(values.begin(), nth, values.end());
  return static_cast<double>(*nth);
}

/// Cells from which no strictly falling path over eight neighbours leads to the border: all that
/// cannot be reached from the border by climbing.
std::size_t undrained_cells(const Heights& heights) {
  std::vector<char> is_reached(heights.z.size(), 0);
  std::vector<int> open;
  for (int row = 0; row < heights.rows; ++row) {
    for (int column = 0; column < heights.columns; ++column) {
      if (row == 0 || column == 0 || row == heights.rows - 1 || column == heights.columns - 1) {
        open.push_back(row * heights.columns + column);
        is_reached[static_cast<std::size_t>(open.back())] = 1;
      }
    }
  }
  while (!open.empty()) {
    const int cell = open.back();
    open.pop_back();
    for (int dr = -1; dr <= 1; ++dr) {
      for (int dc = -1; dc <= 1; ++dc) {
        const int row = cell / heights.columns + dr;
        const int column = cell % heights.columns + dc;
        if (row < 0 || column < 0 || row >= heights.rows || column >= heights.columns) {
          continue;
        }
        const auto other = static_cast<std::size_t>(row * heights.columns + column);
        if (is_reached[other] == 0 &&
            heights.z[other] > heights.z[static_cast<std::size_t>(cell)]) {
          is_reached[other] = 1;
          open.push_back(static_cast<int>(other));
        }
      }
    }
  }
  return static_cast<std::size_t>(std::count(is_reached.begin(), is_reached.end(), 0));
}

void expect_promised_terrain(const std::filesystem::path& dem_file) {
  const auto dataset = open_raster(dem_file);
  ASSERT_NE(dataset, nullptr);
  const Heights heights = read_heights(*dataset);
  EXPECT_GE(heights.columns * heights.transform[1], 20000.0);
  EXPECT_GE(heights.rows * -heights.transform[5], 20000.0);
  EXPECT_LE(heights.transform[1], 30.0);
  const auto [low, high] = std::minmax_element(heights.z.begin(), heights.z.end());
  EXPECT_GE(*high - *low, 400.0F);
  EXPECT_GT(*low, 0.0F);
  EXPECT_GE(slope_p90_deg_by_gdal(*dataset), 15.0);
  EXPECT_EQ(undrained_cells(heights), 0U);
}

/// The region of the default seed, made once for all tests.
class SyntheticRegionFiles : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    region_ = new SyntheticRegion(write_synthetic_region(folder_->path(), {}));
  }
  static void TearDownTestSuite() {
    delete region_;
    delete folder_;
  }
  static TemporaryFolder* folder_;
  static SyntheticRegion* region_;
};
TemporaryFolder* SyntheticRegionFiles::folder_ = nullptr;
SyntheticRegion* SyntheticRegionFiles::region_ = nullptr;

TEST_F(SyntheticRegionFiles, TerrainIsLargeHillySteepAndDrained) {
  expect_promised_terrain(region_->dem_file);
}

TEST_F(SyntheticRegionFiles, RasterSaysWhereItIsAndThatItIsSynthetic) {
  const auto dataset = open_raster(region_->dem_file);
  ASSERT_NE(dataset, nullptr);
  const OGRSpatialReference* reference = dataset->GetSpatialRef();
  ASSERT_NE(reference, nullptr);
  EXPECT_STREQ(reference->GetAuthorityCode(nullptr), "32632");
  EXPECT_EQ(dataset->GetRasterBand(1)->GetRasterDataType(), GDT_Float32);
  EXPECT_STREQ(dataset->GetRasterBand(1)->GetUnitType(), "m");
  EXPECT_THAT(dataset->GetMetadataItem("TIFFTAG_IMAGEDESCRIPTION"),
              testing::StartsWith("SYNTHETIC REGION"));
  EXPECT_EQ(region_->label, "SYNTHETIC REGION");
  EXPECT_THAT(region_->attribution, testing::HasSubstr("not a real place"));
}

TEST_F(SyntheticRegionFiles, SameSeedGivesTheSameBytesAndAnotherSeedDoesNot) {
  const TemporaryFolder again;
  const SyntheticRegion same = write_synthetic_region(again.path(), {});
  EXPECT_TRUE(read_file(same.dem_file) == read_file(region_->dem_file));
  EXPECT_TRUE(read_file(same.osm_file) == read_file(region_->osm_file));
  EXPECT_EQ(same.start.latitude_rad, region_->start.latitude_rad);
  const TemporaryFolder other;
  const SyntheticRegion different = write_synthetic_region(other.path(), {.seed = 2});
  EXPECT_FALSE(read_file(different.dem_file) == read_file(region_->dem_file));
  EXPECT_FALSE(read_file(different.osm_file) == read_file(region_->osm_file));
}

struct Inventory : public osmium::handler::Handler {
  std::set<std::int64_t> nodes;
  std::map<std::int64_t, bool> way_is_closed;
  std::map<std::string, int> features;
  int with_height = 0;
  int unlabelled = 0;
  int dangling = 0;
  int towers_with_height = 0;
  int towers_without_height = 0;
  int buildings_with_height = 0;
  int buildings_with_levels = 0;
  int buildings_without = 0;
  std::size_t longest_way = 0;
  osmium::Box box;

  void count(const osmium::OSMObject& object) {
    for (const char* key : {"building", "landuse", "natural", "power", "place", "waterway"}) {
      if (const char* value = object.tags()[key]) {
        ++features[std::string(key) + "=" + value];
      }
    }
    unlabelled += object.tags().has_tag("note", "synthetic") ? 0 : 1;
  }
  void node(const osmium::Node& node) {
    nodes.insert(node.id());
    box.extend(node.location());
    if (!node.tags().empty()) {
      count(node);
    }
    if (node.tags().has_tag("power", "tower")) {
      (node.tags().has_key("height") ? towers_with_height : towers_without_height) += 1;
    }
  }
  void way(const osmium::Way& way) {
    count(way);
    way_is_closed[way.id()] = way.is_closed();
    longest_way = std::max(longest_way, way.nodes().size());
    for (const osmium::NodeRef& node : way.nodes()) {
      dangling += nodes.contains(node.ref()) ? 0 : 1;
    }
    if (way.tags().has_key("building")) {
      (way.tags().has_key("height")            ? buildings_with_height
       : way.tags().has_key("building:levels") ? buildings_with_levels
                                               : buildings_without) += 1;
    }
  }
  void relation(const osmium::Relation& relation) {
    count(relation);
    ++features["relation:" + std::string(relation.tags().get_value_by_key("type", ""))];
    for (const osmium::RelationMember& member : relation.members()) {
      dangling += way_is_closed.contains(member.ref()) ? 0 : 1;
    }
  }
};

TEST_F(SyntheticRegionFiles, LandCoverIsValidOsmInOrderWithEachKindOfObject) {
  osmium::io::Reader reader(region_->osm_file.string());
  EXPECT_EQ(reader.header().get("generator"), "hedgehop synthetic region");
  osmium::handler::CheckOrder order;  // throws unless nodes, ways, relations, each by rising id
  Inventory inventory;
  EXPECT_NO_THROW(osmium::apply(reader, order, inventory));
  reader.close();

  EXPECT_EQ(inventory.dangling, 0);
  EXPECT_EQ(inventory.unlabelled, 0);
  EXPECT_LE(inventory.longest_way, 2000U);
  auto& features = inventory.features;
  EXPECT_EQ(features["place=town"], 1);
  EXPECT_GE(features["place=village"], 10);
  EXPECT_GE(features["landuse=residential"], 11);
  EXPECT_GE(features["landuse=industrial"], 1);
  EXPECT_GE(features["landuse=forest"], 20);
  EXPECT_GE(features["natural=wood"], 20);
  EXPECT_GE(features["building=house"], 1000);
  EXPECT_GE(features["building=farm"], 20);
  EXPECT_GE(features["natural=tree"], 100);
  EXPECT_GE(features["natural=tree_row"], 20);
  EXPECT_GE(features["natural=water"], 1);
  EXPECT_GE(features["waterway=stream"], 50);
  EXPECT_EQ(features["power=line"], 1);
  EXPECT_GE(features["power=tower"], 50);
  EXPECT_EQ(features["power=minor_line"], 1);
  EXPECT_GE(features["power=pole"], 5);
  EXPECT_GE(features["relation:multipolygon"], 1);
  EXPECT_GE(inventory.towers_with_height, 10);
  EXPECT_GE(inventory.towers_without_height, 10);
  EXPECT_GE(inventory.buildings_with_height, 100);
  EXPECT_GE(inventory.buildings_with_levels, 100);
  EXPECT_GE(inventory.buildings_without, 100);
}

TEST_F(SyntheticRegionFiles, SuggestedFlightIsAboutEighteenKilometresInsideTheRegion) {
  const auto is_inside = [&](const geo::GeodeticPosition& p) {
    return p.longitude_rad > region_->extent.west_rad &&
           p.longitude_rad < region_->extent.east_rad &&
           p.latitude_rad > region_->extent.south_rad && p.latitude_rad < region_->extent.north_rad;
  };
  EXPECT_TRUE(is_inside(region_->start));
  EXPECT_TRUE(is_inside(region_->goal));
  // Great circle on a sphere: good to 0.5 %.
  const double dlat = region_->goal.latitude_rad - region_->start.latitude_rad;
  const double dlon = (region_->goal.longitude_rad - region_->start.longitude_rad) *
                      std::cos(0.5 * (region_->goal.latitude_rad + region_->start.latitude_rad));
  EXPECT_NEAR(6371000.0 * std::hypot(dlat, dlon), 18000.0, 1500.0);
}

TEST_F(SyntheticRegionFiles, ExtentIsCoveredByTheRasterAndAtLeastTwentyKilometresWide) {
  const geo::GeodeticBox& box = region_->extent;
  EXPECT_GE((box.north_rad - box.south_rad) * 6371000.0, 20000.0);
  EXPECT_GE((box.east_rad - box.west_rad) * 6371000.0 * std::cos(box.north_rad), 20000.0);
  const auto dataset = open_raster(region_->dem_file);
  ASSERT_NE(dataset, nullptr);
  const Heights heights = read_heights(*dataset);
  OGRSpatialReference geodetic;
  geodetic.importFromEPSG(4326);
  geodetic.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  const std::unique_ptr<OGRCoordinateTransformation> transformation(
      OGRCreateCoordinateTransformation(&geodetic, dataset->GetSpatialRef()));
  for (const double longitude_rad : {box.west_rad, box.east_rad}) {
    for (const double latitude_rad : {box.south_rad, box.north_rad}) {
      double x = longitude_rad * 180.0 / std::numbers::pi;
      double y = latitude_rad * 180.0 / std::numbers::pi;
      ASSERT_TRUE(transformation->Transform(1, &x, &y));
      const double column = (x - heights.transform[0]) / heights.transform[1];
      const double row = (y - heights.transform[3]) / heights.transform[5];
      EXPECT_GT(column, 0.0);
      EXPECT_LT(column, heights.columns);
      EXPECT_GT(row, 0.0);
      EXPECT_LT(row, heights.rows);
    }
  }
}

TEST(SyntheticRegion, KeepsItsPromisesForAnySeed) {
  std::random_device device;
  for (int attempt = 0; attempt < 3; ++attempt) {
    const std::uint64_t seed = device();
    SCOPED_TRACE("seed " + std::to_string(seed));
    const TemporaryFolder folder;
    expect_promised_terrain(write_synthetic_region(folder.path(), {.seed = seed}).dem_file);
  }
}

TEST(TraceAreas, RingWithAHoleHasTheAreaOfTheDiscsDifference) {
  // GIVEN a ring between radius 10 and 30 around (50, 50)
  std::vector<double> field;
  for (int j = 0; j <= 100; ++j) {
    for (int i = 0; i <= 100; ++i) {
      const double radius = std::hypot(i - 50.0, j - 50.0);
      field.push_back(std::min(30.0 - radius, radius - 10.0));
    }
  }
  // WHEN it is traced
  const auto areas = trace_areas(field, 101, 101, 0.0, 0.0, 1.0, 0.0);
  // THEN there is one area with one hole, both of the right size: polygons of about 200 corners
  ASSERT_EQ(areas.size(), 1U);
  ASSERT_EQ(areas[0].holes.size(), 1U);
  EXPECT_NEAR(areas[0].area_m2, std::numbers::pi * 900.0, 3.0);
  EXPECT_TRUE(is_inside(areas[0].outer, {50.0, 50.0}));
  EXPECT_TRUE(is_inside(areas[0].holes[0], {50.0, 58.0}));
  EXPECT_FALSE(is_inside(areas[0].holes[0], {50.0, 62.0}));
}

TEST(TraceAreas, InsideOfEveryNodeIsKeptForARandomField) {
  std::random_device device;
  const auto seed = device();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 generator(seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<double> field(40 * 30);
  std::generate(field.begin(), field.end(), [&] { return uniform(generator); });
  const auto areas = trace_areas(field, 40, 30, 0.0, 0.0, 1.0, 0.0);
  for (int j = 0; j < 30; ++j) {
    for (int i = 0; i < 40; ++i) {
      const bool is_rim = i == 0 || j == 0 || i == 39 || j == 29;
      const bool expected = !is_rim && field[static_cast<std::size_t>(j * 40 + i)] > 0.0;
      int covers = 0;
      for (const TracedArea& area : areas) {
        const geo::MapPoint p{static_cast<double>(i), static_cast<double>(j)};
        bool covered = is_inside(area.outer, p);
        for (const auto& hole : area.holes) {
          covered = covered && !is_inside(hole, p);
        }
        covers += covered ? 1 : 0;
      }
      EXPECT_EQ(covers, expected ? 1 : 0) << "node " << i << ", " << j;
    }
  }
}

TEST(SyntheticTerrain, RefusesGeometriesItCannotErode) {
  EXPECT_THROW(make_synthetic_terrain({0.0, 0.0, 25.0, 100, 100}, 1, 0.3), std::invalid_argument);
  EXPECT_THROW(make_synthetic_terrain({0.0, 0.0, 25.0, 960, 952}, 1, 0.3), std::invalid_argument);
  EXPECT_THROW(make_synthetic_terrain({0.0, 0.0, 25.0, 960, 960}, 1, 0.0), std::invalid_argument);
}

}  // namespace
}  // namespace hedgehop::map_sources
