#include "map/map_bundle.hpp"

#include <cmath>
#include <fstream>
#include <functional>
#include <gdal_priv.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <random>

#include "base/errors.hpp"
#include "base/files.hpp"
#include "support/temporary_folder.hpp"
#include "support/test_map.hpp"

namespace hedgehop::map {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

Map sample_map() {
  Map map = test::make_map(53, 41, 30.0, [](double x_m, double y_m) {
    return std::floor(64.0 * (300.0 + 0.05 * x_m + 20.0 * std::sin(y_m / 200.0))) / 64.0;
  });
  const geo::MapProjection projection("EPSG:32632");
  map.geometry.west_m = 690000.0;
  map.geometry.south_m = 5540010.0;
  const auto move = [&](auto grid) {
    auto moved = grid;
    moved = std::decay_t<decltype(grid)>(map.geometry, 0);
    moved.values() = grid.values();
    return moved;
  };
  map.terrain_m = move(map.terrain_m);
  map.surface_m = move(map.surface_m);
  map.semantics = move(map.semantics);
  map.visibility = move(map.visibility);
  map.crs_wkt = projection.wkt();
  map.vertical_datum = "EGM96";
  map.surface_m.at(7, 3) += 18.0F;
  map.semantics.at(7, 3) = static_cast<std::uint16_t>(SemanticClass::kForest);
  map.semantics.at(0, 40) = static_cast<std::uint16_t>(SemanticClass::kUnmapped);
  map.terrain_m.at(52, 0) = map.surface_m.at(52, 0) = std::numeric_limits<float>::quiet_NaN();
  map.visibility.at(52, 0) = kVisibilityUnknown;
  map.visibility.at(1, 2) = test::stored_visibility(0.25);
  map.overhead_lines = {
      {4711, {{{690100.125, 5540100.5}, 30.0}, {{690400.0, 5540300.0}, 42.5}}},
      {-8,
       {{{690000.0, 5540100.0}, 1.0}, {{690001.0, 5540101.0}, 2.0}, {{690002.0, 5540101.0}, 3.0}}}};
  map.overhead_lines[1].kind = LineKind::kAerialway;
  map.overhead_lines[1].supports[1].is_pole = false;
  map.obstacles = {
      {12, ObstacleKind::kWindTurbine, "a \"b\" ä", {690050.0, 5540070.25}, 80.0, 199.5, 512.125},
      {-3,
       ObstacleKind::kOther,
       "",
       {690060.0, 5540080.0},
       0.0,
       0.0,
       std::numeric_limits<double>::quiet_NaN()}};
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  map.areas = {{"ED-R 1",
                "R",
                true,
                {-kInfinity, AreaLimit::Reference::kAmsl},
                {1524.0, AreaLimit::Reference::kAmsl},
                {{{{690000.0, 5540010.0},
                   {690900.0, 5540010.0},
                   {690900.0, 5540910.0},
                   {690000.0, 5540910.0},
                   {690000.0, 5540010.0}},
                  {{{690100.0, 5540110.0},
                    {690100.0, 5540210.0},
                    {690200.0, 5540210.0},
                    {690100.0, 5540110.0}}}},
                 {{{691000.0, 5540010.0},
                   {691100.5, 5540010.0},
                   {691100.0, 5540110.0},
                   {691000.0, 5540010.0}},
                  {}}}},
               {"quiet",
                "avoid",
                false,
                {30.0, AreaLimit::Reference::kAboveGround},
                {kInfinity, AreaLimit::Reference::kAboveGround},
                {{{{690300.0, 5540310.0},
                   {690400.0, 5540310.0},
                   {690400.0, 5540410.0},
                   {690300.0, 5540310.0}},
                  {}}}}};
  map.attributions = {"(c) someone", "ä second line"};
  map.label = "TEST REGION";
  test::finish_map(map);
  return map;
}

constexpr char kProvenance[] = R"({"inputs": [{"path": "a.tif"}], "tool_version": "1"})";

std::string bytes_of_file(const fs::path& path) { return read_file(path); }

void replace_in_manifest(const fs::path& folder, const std::string& pointer,
                         const nlohmann::ordered_json& value) {
  auto manifest = nlohmann::ordered_json::parse(read_map_manifest(folder));
  manifest[nlohmann::ordered_json::json_pointer(pointer)] = value;
  std::ofstream(folder / kMapManifestFile) << manifest.dump();
}

std::string refusal_of(const fs::path& folder) {
  try {
    (void)read_map_bundle(folder);
  } catch (const DataError& error) {
    return error.what();
  }
  return "";
}

class BundleOnDisk : public testing::Test {
 protected:
  void SetUp() override { write_map_bundle(map_, kProvenance, folder_.path()); }
  Map map_ = sample_map();
  test::TemporaryFolder folder_;
};

TEST_F(BundleOnDisk, ReadsBackAsTheSameMap) {
  const Map back = read_map_bundle(folder_.path());
  EXPECT_EQ(back.hash, map_.hash);
  EXPECT_EQ(map_hash(back), map_.hash);
  EXPECT_EQ(back.geometry, map_.geometry);
  EXPECT_EQ(back.label, "TEST REGION");
  EXPECT_EQ(back.attributions, map_.attributions);
  ASSERT_EQ(back.overhead_lines.size(), 2U);
  EXPECT_EQ(back.overhead_lines[0].source_id, 4711);
  EXPECT_EQ(back.overhead_lines[0].supports[1].height_m, 42.5);
  EXPECT_EQ(back.overhead_lines[1].supports[2].point.x_m, 690002.0);
  EXPECT_EQ(back.overhead_lines[1].kind, LineKind::kAerialway);
  EXPECT_TRUE(back.overhead_lines[1].supports[0].is_pole);
  EXPECT_FALSE(back.overhead_lines[1].supports[1].is_pole);
  ASSERT_EQ(back.obstacles.size(), 2U);
  EXPECT_EQ(back.obstacles[0].kind, ObstacleKind::kWindTurbine);
  EXPECT_EQ(back.obstacles[0].name, "a \"b\" ä");
  EXPECT_EQ(back.obstacles[0].top_m, 512.125);
  EXPECT_TRUE(std::isnan(back.obstacles[1].top_m));
  ASSERT_EQ(back.areas.size(), 2U);
  EXPECT_EQ(back.areas[0].name, "ED-R 1");
  EXPECT_TRUE(back.areas[0].is_hard);
  EXPECT_EQ(back.areas[0].floor, map_.areas[0].floor);
  EXPECT_EQ(back.areas[0].ceiling, map_.areas[0].ceiling);
  ASSERT_EQ(back.areas[0].polygons.size(), 2U);
  EXPECT_EQ(back.areas[0].polygons[0].holes.size(), 1U);
  EXPECT_EQ(back.areas[0].polygons[1].outer[1].x_m, 691100.5);
  EXPECT_FALSE(back.areas[1].is_hard);
  EXPECT_EQ(back.areas[1].floor, map_.areas[1].floor);
  EXPECT_EQ(back.areas[1].ceiling, map_.areas[1].ceiling);
  EXPECT_TRUE(std::isnan(back.terrain_m.at(52, 0)));
  EXPECT_EQ(visibility_share(back.visibility.at(1, 2)), map_.visibility.at(1, 2) / 65534.0);
}

TEST(MapBundle, AnExposureVolumeComesBackWithItsHeightsAndBelongsToTheHash) {
  Map map = test::make_map(70, 40, 30.0, [](double x_m, double) { return 0.1 * x_m; });
  const Hash128 without = map.hash;
  map.further_visibility = {{5.5, raster::Grid<std::uint16_t>(map.geometry, 100)},
                            {60.0, raster::Grid<std::uint16_t>(map.geometry, 900)}};
  map.further_visibility[1].share.at(69, 0) = kVisibilityUnknown;
  test::finish_map(map);
  EXPECT_NE(map.hash, without);
  test::TemporaryFolder folder;
  write_map_bundle(map, "{}", folder.path());
  const Map back = read_map_bundle(folder.path());
  ASSERT_EQ(back.further_visibility.size(), 2U);
  EXPECT_EQ(back.further_visibility[0].height_m, 5.5);
  EXPECT_EQ(back.further_visibility[1].height_m, 60.0);
  EXPECT_EQ(back.further_visibility[1].share.values(), map.further_visibility[1].share.values());
  EXPECT_EQ(back.hash, map.hash);
  EXPECT_TRUE(covers_height(back, 5.5));
  EXPECT_TRUE(covers_height(back, 33.0));
  EXPECT_FALSE(covers_height(back, 5.0));
  EXPECT_FALSE(covers_height(back, 60.5));

  for (const auto& spoil : std::vector<std::function<void(Map&)>>{
           [](Map& m) { m.further_visibility[0].height_m = 70.0; },
           [](Map& m) { m.further_visibility[0].height_m = m.reference_height_m; },
           [](Map& m) { m.further_visibility[0].height_m = -1.0; },
           [](Map& m) { m.further_visibility[0].share = raster::Grid<std::uint16_t>(); }}) {
    Map bad = map;
    spoil(bad);
    bad.hash = map_hash(bad);
    EXPECT_THROW(validate(bad), DataError);
  }
}

TEST(MapBundle, NamedObserversHaveAHashOfTheirOwnAndHeightsThatAreSome) {
  Map map = test::make_map(30, 20, 30.0, [](double x_m, double) { return x_m; });
  const Hash128 bare = map.hash;
  EXPECT_EQ(map_hash_without_threats(map), bare);
  map.threats = {{"tower", raster::Grid<float>(map.geometry, 3.0F)}};
  map.threats[0].height_m.at(2, 3) = std::nanf("");
  map.threats[0].height_m.at(3, 3) = 0.0F;
  test::finish_map(map);
  EXPECT_NE(map.hash, bare);
  EXPECT_EQ(map_hash_without_threats(map), bare);
  EXPECT_NO_THROW(validate(map));

  for (const float bad_m : {-0.5F, std::numeric_limits<float>::infinity()}) {
    Map bad = map;
    bad.threats[0].height_m.at(7, 11) = bad_m;
    test::finish_map(bad);
    EXPECT_THROW(validate(bad), DataError);
    try {
      validate_threats(bad);
      ADD_FAILURE() << bad_m;
    } catch (const DataError& error) {
      EXPECT_THAT(error.what(), testing::HasSubstr("'tower'"));
      EXPECT_THAT(error.what(), testing::HasSubstr("column 7, row 11"));
    }
  }
  Map other = map;
  other.threats[0].height_m = raster::Grid<float>({0.0, 0.0, 30.0, 30, 21}, 3.0F);
  EXPECT_THROW(validate_threats(other), DataError);
}

TEST(MapBundle, HeightBandsAreWrittenWithTheirNames) {
  const Map map = test::make_map(30, 20, 30.0, [](double, double) { return 1.0; });
  raster::Grid<float> one(map.geometry, 3.0F);
  one.at(2, 0) = std::numeric_limits<float>::quiet_NaN();
  const raster::Grid<float> two(map.geometry, 7.5F);
  test::TemporaryFolder folder;
  write_height_bands(map, {{"tower", &one}, {"hill", &two}}, folder.path() / "threats.tif");
  auto* dataset =
      static_cast<GDALDataset*>(GDALOpen((folder.path() / "threats.tif").c_str(), GA_ReadOnly));
  ASSERT_NE(dataset, nullptr);
  ASSERT_EQ(dataset->GetRasterCount(), 2);
  EXPECT_STREQ(dataset->GetRasterBand(2)->GetDescription(), "hill");
  float values[3] = {0.0F, 0.0F, 0.0F};
  ASSERT_EQ(dataset->GetRasterBand(1)->RasterIO(GF_Read, 0, 19, 3, 1, values, 3, 1, GDT_Float32, 0,
                                                0, nullptr),
            CE_None);
  EXPECT_EQ(values[0], 3.0F);
  EXPECT_TRUE(std::isnan(values[2]));
  GDALClose(dataset);
}

TEST(MapBundle, HeightBandsAreReadBackAsTheyWereWritten) {
  const Map map = test::make_map(30, 20, 30.0, [](double, double) { return 1.0; });
  raster::Grid<float> one(map.geometry, 3.0F);
  one.at(2, 0) = std::numeric_limits<float>::quiet_NaN();
  raster::Grid<float> two(map.geometry, 0.0F);
  two.at(29, 19) = 7.5F;
  test::TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "threats.tif";
  write_height_bands(map, {{"tower", &one}, {"hill <x>", &two}}, file);

  const std::vector<HeightLayer> layers = read_height_bands(map, file);

  ASSERT_EQ(layers.size(), 2U);
  EXPECT_EQ(layers[0].name, "tower");
  EXPECT_EQ(layers[1].name, "hill <x>");
  EXPECT_TRUE(std::isnan(layers[0].height_m.at(2, 0)));
  EXPECT_EQ(layers[0].height_m.at(3, 0), 3.0F);
  EXPECT_EQ(layers[1].height_m.at(29, 19), 7.5F);
  EXPECT_EQ(layers[1].height_m.at(0, 0), 0.0F);

  const Map other = test::make_map(30, 21, 30.0, [](double, double) { return 1.0; });
  EXPECT_THROW(read_height_bands(other, file), DataError);
  EXPECT_THROW(read_height_bands(map, folder.path() / "none.tif"), DataError);
}

TEST_F(BundleOnDisk, FilesAreNorthUpWithRowZeroOfMemoryInTheSouth) {
  GDALAllRegister();
  auto* dataset =
      static_cast<GDALDataset*>(GDALOpen((folder_.path() / "surface.tif").c_str(), GA_ReadOnly));
  ASSERT_NE(dataset, nullptr);
  double transform[6];
  dataset->GetGeoTransform(transform);
  EXPECT_EQ(transform[3], 5540010.0 + 41 * 30.0);
  EXPECT_EQ(transform[5], -30.0);
  float value = 0.0F;
  ASSERT_EQ(dataset->GetRasterBand(1)->RasterIO(GF_Read, 7, 41 - 1 - 3, 1, 1, &value, 1, 1,
                                                GDT_Float32, 0, 0, nullptr),
            CE_None);
  EXPECT_EQ(value, map_.surface_m.at(7, 3));
  EXPECT_TRUE(std::isnan(dataset->GetRasterBand(1)->GetNoDataValue()));
  EXPECT_STREQ(dataset->GetSpatialRef()->GetAuthorityCode(nullptr), "32632");
  GDALClose(dataset);
}

TEST_F(BundleOnDisk, NamesTheClassesInTheSemanticsFile) {
  GDALAllRegister();
  auto* dataset =
      static_cast<GDALDataset*>(GDALOpen((folder_.path() / "semantics.tif").c_str(), GA_ReadOnly));
  ASSERT_NE(dataset, nullptr);
  EXPECT_STREQ(dataset->GetRasterBand(1)->GetMetadataItem("BIT_1024"), "power_line");
  GDALClose(dataset);
}

TEST_F(BundleOnDisk, SameMapGivesTheSameBytesInAnotherFolder) {
  const test::TemporaryFolder other;
  write_map_bundle(map_, kProvenance, other.path());
  int files = 0;
  for (const auto& entry : fs::directory_iterator(folder_.path())) {
    EXPECT_EQ(bytes_of_file(entry.path()), bytes_of_file(other.path() / entry.path().filename()))
        << entry.path().filename();
    ++files;
  }
  EXPECT_EQ(files, 6);
}

TEST_F(BundleOnDisk, ManifestHoldsTheBundleAndItsProvenance) {
  const auto manifest = nlohmann::json::parse(read_map_manifest(folder_.path()));
  EXPECT_EQ(manifest["void_count"], 1);
  EXPECT_EQ(manifest["unmapped_count"], 1);
  EXPECT_EQ(manifest["crs_code"], "EPSG:32632");
  EXPECT_EQ(manifest["tool_version"], "1");
  EXPECT_EQ(manifest["inputs"][0]["path"], "a.tif");
  EXPECT_NEAR(manifest["extent_deg"]["west"].get<double>(), 11.65, 0.05);
}

TEST_F(BundleOnDisk, ProvenanceMayNotReplaceWhatTheBundleSays) {
  EXPECT_THROW(write_map_bundle(map_, R"({"cell_m": 1})", folder_.path()), std::invalid_argument);
  EXPECT_THROW(write_map_bundle(map_, "[1]", folder_.path()), std::invalid_argument);
}

TEST_F(BundleOnDisk, NamesTheFileThatIsMissing) {
  for (const char* name :
       {"terrain.tif", "surface.tif", "semantics.tif", "visibility.tif", "features.gpkg"}) {
    const fs::path away = folder_.path() / "away";
    fs::rename(folder_.path() / name, away);
    EXPECT_THAT(refusal_of(folder_.path()), HasSubstr(name));
    fs::rename(away, folder_.path() / name);
  }
  EXPECT_EQ(refusal_of(folder_.path()), "");
}

TEST_F(BundleOnDisk, RefusesAFolderThatIsNoBundle) {
  const test::TemporaryFolder empty;
  EXPECT_THAT(refusal_of(empty.path()), HasSubstr("manifest.json"));
  EXPECT_THAT(refusal_of(empty.path() / "nowhere"), HasSubstr("no such folder"));
}

TEST_F(BundleOnDisk, RefusesAnotherSchemaVersionOrSomeOtherJson) {
  replace_in_manifest(folder_.path(), "/schema_version", kMapSchemaVersion + 1);
  EXPECT_THAT(refusal_of(folder_.path()),
              HasSubstr("schema version " + std::to_string(kMapSchemaVersion + 1)));
  std::ofstream(folder_.path() / kMapManifestFile) << "{}";
  EXPECT_THAT(refusal_of(folder_.path()), HasSubstr("not the manifest"));
  std::ofstream(folder_.path() / kMapManifestFile) << std::string(100000, '[');
  EXPECT_THAT(refusal_of(folder_.path()), HasSubstr("not a JSON object"));
}

TEST_F(BundleOnDisk, RefusesAManifestThatLiesAboutSizesTypesOrPlaces) {
  const std::string good = read_map_manifest(folder_.path());
  const std::vector<std::pair<std::string, nlohmann::ordered_json>> lies = {
      {"/columns", 54},
      {"/columns", 1000000000000LL},
      {"/columns", -1},
      {"/columns", "53"},
      {"/rows", 190000},
      {"/cell_m", 0.0},
      {"/cell_m", 31.0},
      {"/extent_m/west", 1e300},
      {"/extent_m/south", 5540040.0},
      {"/crs_wkt", "nonsense"},
      {"/label", 3},
      {"/attributions", "x"},
      {"/map_hash", "00"},
      {"/vertical_datum", "EGM2008"},
      {"/reference_height_m", 20.0},
      {"/label", "other"},
      {"/extent_m", 7}};
  for (const auto& [pointer, value] : lies) {
    replace_in_manifest(folder_.path(), pointer, value);
    EXPECT_NE(refusal_of(folder_.path()), "") << pointer << " = " << value;
    std::ofstream(folder_.path() / kMapManifestFile) << good;
  }
  EXPECT_EQ(refusal_of(folder_.path()), "");
}

TEST_F(BundleOnDisk, RefusesALayerOfAnotherTypeOrAnotherContent) {
  fs::copy_file(folder_.path() / "semantics.tif", folder_.path() / "terrain.tif",
                fs::copy_options::overwrite_existing);
  EXPECT_THAT(refusal_of(folder_.path()), HasSubstr("type of bands"));
  fs::copy_file(folder_.path() / "surface.tif", folder_.path() / "terrain.tif",
                fs::copy_options::overwrite_existing);
  EXPECT_THAT(refusal_of(folder_.path()), HasSubstr("hash"));
}

TEST_F(BundleOnDisk, RandomDamageIsRefusedOrHarmlessButNeverAWrongMap) {
  std::random_device device;
  const unsigned seed = device();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  int refused = 0;
  for (const char* name : {"terrain.tif", "surface.tif", "semantics.tif", "visibility.tif",
                           "features.gpkg", kMapManifestFile}) {
    const std::string good = bytes_of_file(folder_.path() / name);
    for (int trial = 0; trial < 12; ++trial) {
      std::string bad = good;
      if (trial == 0) {
        bad.resize(bad.size() / 2);
      } else {
        for (int i = 0; i < 4; ++i) {
          bad[random() % bad.size()] = static_cast<char>(random());
        }
      }
      std::ofstream(folder_.path() / name, std::ios::binary) << bad;
      try {
        const Map back = read_map_bundle(folder_.path());
        EXPECT_EQ(map_hash(back), map_.hash) << name;
      } catch (const DataError&) {
        ++refused;
      }
    }
    std::ofstream(folder_.path() / name, std::ios::binary) << good;
  }
  EXPECT_GE(refused, 6);
}

TEST(MapBundle, AMapWithoutCoordinateSystemOrFeaturesSurvivesToo) {
  const test::TemporaryFolder folder;
  const Map map = test::make_map(3, 2, 10.0, [](double, double) { return 5.0; });
  write_map_bundle(map, "{}", folder.path());
  EXPECT_EQ(read_map_bundle(folder.path()).hash, map.hash);
}

TEST(MapBundle, ReportsWhenItCannotWrite) {
  const Map map = test::make_map(3, 2, 10.0, [](double, double) { return 5.0; });
  EXPECT_THROW(write_map_bundle(map, "{}", "/proc/no-such-folder"), SystemFailure);
}

}  // namespace
}  // namespace hedgehop::map
