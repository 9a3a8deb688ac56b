// Which files a box needs; expected names counted on a map by hand.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "base/shipped_config.hpp"
#include "fetch/fetch_options.hpp"

namespace hedgehop::fetch {
namespace {

using testing::ElementsAre;

geo::GeodeticBox box(double west, double south, double east, double north) {
  return {radians_from_degrees(west), radians_from_degrees(south), radians_from_degrees(east),
          radians_from_degrees(north)};
}

std::vector<std::string> names(const geo::GeodeticBox& of, double margin_m, int tile_deg = 1) {
  Source source;
  source.url = "https://example.org/{ns}{lat2}{ew}{lon3}";
  source.file = "{ns}{lat2}{ew}{lon3}";
  source.tile_deg = tile_deg;
  std::vector<std::string> result;
  for (const WantedFile& wanted : wanted_files(source, of, margin_m)) {
    EXPECT_EQ(wanted.url, "https://example.org/" + wanted.file);
    result.push_back(wanted.file);
  }
  return result;
}

TEST(WantedFiles, TilesAreNamedByTheirSouthWesternCorner) {
  EXPECT_THAT(names(box(9.35, 51.65, 9.85, 51.95), 0.0), ElementsAre("N51E009"));
  EXPECT_THAT(names(box(-0.5, -0.5, 0.5, 0.5), 0.0),
              ElementsAre("S01W001", "S01E000", "N00W001", "N00E000"));
  EXPECT_THAT(names(box(-70.9, -33.2, -70.1, -32.9), 0.0), ElementsAre("S34W071", "S33W071"));
}

TEST(WantedFiles, ABoxThatEndsOnAnEdgeDoesNotNeedTheNextTile) {
  EXPECT_THAT(names(box(9.0, 51.0, 10.0, 52.0), 0.0), ElementsAre("N51E009"));
}

TEST(WantedFiles, TheMarginReachesOverTheEdgeInMetres) {
  // At 51.95 N a minute of latitude is 1.85 km: 0.05 degrees to the edge are 5.6 km.
  EXPECT_THAT(names(box(9.4, 51.65, 9.6, 51.95), 5000.0), ElementsAre("N51E009"));
  EXPECT_THAT(names(box(9.4, 51.65, 9.6, 51.95), 6000.0), ElementsAre("N51E009", "N52E009"));
  // Degrees of longitude are shorter there: 0.08 degrees are 5.5 km.
  EXPECT_THAT(names(box(9.4, 51.2, 9.92, 51.6), 5000.0), ElementsAre("N51E009"));
  EXPECT_THAT(names(box(9.4, 51.2, 9.92, 51.6), 6000.0), ElementsAre("N51E009", "N51E010"));
}

TEST(WantedFiles, WiderTilesBeginAtMultiplesOfTheirSize) {
  EXPECT_THAT(names(box(-1.0, 51.0, 1.0, 52.0), 0.0, 5), ElementsAre("N50W005", "N50E000"));
}

TEST(WantedFiles, TilesEndAtTheEdgesOfTheWorld) {
  EXPECT_THAT(names(box(179.5, 89.2, 180.0, 90.0), 50000.0).back(), "N89E179");
  EXPECT_THAT(names(box(-180.0, -90.0, -179.5, -89.5), 0.0).front(), "S90W180");
}

TEST(WantedFiles, ASourceWithoutTilesGetsTheBoxAsItWasGiven) {
  Source source;
  source.url = "https://example.org/?{south},{west},{north},{east}";
  source.file = "{west}_{east}.osm";
  source.checksum_url = "https://example.org/{west}.md5";
  const auto wanted = wanted_files(source, box(-9.35, 51.65, 9.85, 52.0), 6000.0);
  ASSERT_EQ(wanted.size(), 1U);
  EXPECT_EQ(wanted[0].url, "https://example.org/?51.65,-9.35,52,9.85");
  EXPECT_EQ(wanted[0].file, "-9.35_9.85.osm");
  EXPECT_EQ(wanted[0].checksum_url, "https://example.org/-9.35.md5");
}

TEST(WantedFiles, EmptyAndImmenseBoxesAreRefused) {
  EXPECT_THROW(names(box(9.0, 51.0, 9.0, 52.0), 0.0), UsageError);
  EXPECT_THROW(names(box(9.0, 52.0, 10.0, 51.0), 0.0), UsageError);
  EXPECT_THROW(names(box(170.0, 51.0, 190.0, 52.0), 0.0), UsageError);
  EXPECT_THROW(names(box(0.0, 0.0, 20.0, 20.0), 0.0), UsageError);
}

TEST(FetchOptions, TheShippedSourcesArePublicNamedAndLicensed) {
  ConfigReader reader = ConfigReader::from_text(shipped_config("fetch.yaml"), "config/fetch.yaml");
  const FetchOptions options = FetchOptions::read(reader);
  EXPECT_NO_THROW((void)options.source(SourceKind::kTerrain, options.default_terrain));
  EXPECT_NO_THROW((void)options.source(SourceKind::kOsm, options.default_osm));
  EXPECT_THROW((void)options.source(SourceKind::kOsm, options.default_terrain), UsageError);
  for (const Source& source : options.sources) {
    EXPECT_TRUE(source.url.starts_with("https://")) << source.name;
    EXPECT_TRUE(source.page.starts_with("https://")) << source.name;
    // No placeholder is left over, and the names are those of files.
    for (const WantedFile& wanted : wanted_files(source, box(9.35, 51.65, 9.85, 51.9), 0.0)) {
      EXPECT_EQ(wanted.url.find_first_of("{} "), std::string::npos) << wanted.url;
      EXPECT_EQ(wanted.file.find_first_of("{}/ "), std::string::npos) << wanted.file;
    }
  }
  EXPECT_EQ(options.source(SourceKind::kTerrain, "srtm").name, "srtm");
}

}  // namespace
}  // namespace hedgehop::fetch
