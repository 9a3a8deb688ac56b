#include "map_sources/elevation_source.hpp"

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "geo/map_projection.hpp"
#include "support/elevation_files.hpp"
#include "support/temporary_folder.hpp"

namespace hedgehop::map_sources {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

const std::string& utm32() {
  static const std::string kWkt = geo::MapProjection("EPSG:32632").wkt();
  return kWkt;
}

geo::VerticalDatum egm96() { return geo::VerticalDatum::parse("EGM96"); }

ElevationLayers layers_of(const std::vector<ElevationInput>& files,
                          const raster::GridGeometry& geometry, int threads = 1) {
  SilentObserver observer;
  return ElevationSource(files, egm96(), 0.0).on_grid(geometry, utm32(), threads, observer);
}

template <typename Call>
std::string refusal_of(const Call& call) {
  try {
    call();
  } catch (const DataError& error) {
    EXPECT_NE(error.hint(), "") << error.what();
    return error.what();
  }
  return "";
}

void write_bytes(const fs::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

// A tile of 1201 x 1201 big-endian samples, from the north-western corner.
std::string hgt_bytes(const std::function<int(int column, int row)>& height) {
  std::string bytes;
  for (int row = 0; row < 1201; ++row) {
    for (int column = 0; column < 1201; ++column) {
      const auto value = static_cast<std::uint16_t>(height(column, row));
      bytes.push_back(static_cast<char>(value >> 8));
      bytes.push_back(static_cast<char>(value & 255));
    }
  }
  return bytes;
}

class ElevationFiles : public testing::Test {
 protected:
  test::TemporaryFolder folder_;
  fs::path path(const std::string& name) const { return folder_.path() / name; }
};

TEST_F(ElevationFiles, APlaneInMapCoordinatesStaysThatPlane) {
  test::write_raster(
      path("plane.tif"), {"EPSG:32632", 500000.0, 5540000.0, 20.0, 200, 200, -9999.0, ""},
      [](double x, double y) { return 0.01 * (x - 500000.0) + 0.02 * (y - 5536000.0); });
  const raster::GridGeometry g{500400.0, 5536400.0, 30.0, 80, 90};
  const ElevationLayers layers = layers_of({path("plane.tif")}, g);
  for (int row = 0; row < g.rows; ++row) {
    for (int column = 0; column < g.columns; ++column) {
      const geo::MapPoint centre = g.centre({column, row});
      const double expected_m = 0.01 * (centre.x_m - 500000.0) + 0.02 * (centre.y_m - 5536000.0);
      // 1/128 m of rounding; where samples and cells are out of step the kernel's weights are a
      // little one-sided: a tenth of a sample, 2 m, at a slope of 0.022.
      EXPECT_NEAR(layers.terrain_m.at(column, row), expected_m, 0.06);
      // No sample of the cell is further from its centre than 15 m in each direction.
      EXPECT_LE(layers.upper_terrain_m.at(column, row), expected_m + 0.45 + 0.06);
      EXPECT_EQ(layers.terrain_m.at(column, row) * 64.0F,
                std::floor(layers.terrain_m.at(column, row) * 64.0F));
    }
  }
}

TEST_F(ElevationFiles, ASpikeInATileKeepsItsPlaceWithinHalfACell) {
  // The sample of N49E011 at column 600, row 480 lies at 11.5 E, 49.6 N.
  write_bytes(path("N49E011.hgt"), hgt_bytes([](int column, int row) {
                return column == 600 && row == 480 ? 900 : 300;
              }));
  const geo::MapProjection projection("EPSG:32632");
  const geo::MapPoint spike =
      projection.to_map({radians_from_degrees(49.6), radians_from_degrees(11.5)});
  const raster::GridGeometry g{std::floor(spike.x_m / 30.0) * 30.0 - 900.0,
                               std::floor(spike.y_m / 30.0) * 30.0 - 900.0, 30.0, 60, 60};
  const ElevationLayers layers = layers_of({path("N49E011.hgt")}, g);
  const raster::CellIndex cell = g.cell_at(spike);
  EXPECT_GE(layers.upper_terrain_m.at(cell), 900.0F);
  EXPECT_GE(raster::sample_bilinear(layers.upper_terrain_m, spike), 900.0);
  EXPECT_EQ(layers.terrain_m.at(cell.column + 8, cell.row), 300.0F);
  EXPECT_EQ(layers.upper_terrain_m.at(cell.column, cell.row - 8), 300.0F);
}

TEST_F(ElevationFiles, NeitherACellNorTheSurfaceBetweenCellsFallsBelowASample) {
  std::random_device device;
  const unsigned seed = device();
  SCOPED_TRACE("seed " + std::to_string(seed));
  for (const double step_m : {7.0, 30.0, 77.0}) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> height_m(100.0, 160.0);
    const int size = static_cast<int>(2400.0 / step_m);
    std::vector<std::pair<geo::MapPoint, double>> samples;
    test::write_raster(path("rough.tif"),
                       {"EPSG:32632", 500003.0, 5540011.0, step_m, size, size, -9999.0, ""},
                       [&](double x, double y) {
                         const double z = static_cast<double>(static_cast<float>(height_m(random)));
                         samples.push_back({{x, y}, z});
                         return z;
                       });
    const raster::GridGeometry g{500600.0, 5538400.0, 30.0, 30, 30};
    const ElevationLayers layers = layers_of({path("rough.tif")}, g);
    int tested = 0;
    for (const auto& [point, z] : samples) {
      if (g.contains(point)) {
        EXPECT_GE(layers.upper_terrain_m.at(g.cell_at(point)), z);
        // Beyond the outermost centres there is nothing to interpolate with.
        if (std::fabs(point.x_m - 501050.0) < 435.0 && std::fabs(point.y_m - 5538850.0) < 435.0) {
          EXPECT_GE(raster::sample_bilinear(layers.upper_terrain_m, point), z - 1e-9);
        }
        ++tested;
      }
    }
    EXPECT_GT(tested, 100);
    for (std::size_t i = 0; i < g.cell_count(); ++i) {
      EXPECT_GE(layers.upper_terrain_m.values()[i], layers.terrain_m.values()[i]);
    }
  }
}

TEST_F(ElevationFiles, VoidsAreUnknownAndNeverAHeight) {
  test::write_raster(path("void.tif"), {"EPSG:32632", 500000.0, 5540000.0, 30.0, 60, 60, 0.0, ""},
                     [](double x, double) {
                       if (x < 500300.0) {
                         return 0.0;  // the file's no-data value
                       }
                       if (x < 500600.0) {
                         return -32768.0;
                       }
                       if (x < 500900.0) {
                         return std::nan("");
                       }
                       return x < 501200.0 ? 1e20 : 250.0;
                     });
  const ElevationLayers layers = layers_of({path("void.tif")}, {500000.0, 5538200.0, 30.0, 60, 60});
  for (int column = 0; column < 60; ++column) {
    const float value_m = layers.terrain_m.at(column, 30);
    if (column < 39) {
      EXPECT_TRUE(std::isnan(value_m)) << column << " " << value_m;
    } else if (column > 40) {
      EXPECT_EQ(value_m, 250.0F);
      EXPECT_EQ(layers.upper_terrain_m.at(column, 30), 250.0F);
    }
  }
}

TEST_F(ElevationFiles, NeighbouringTilesJoinWithoutASeam) {
  const auto height = [](double x, double y) {
    return 0.05 * (x - 500000.0) + 0.03 * (y - 5530000.0);
  };
  test::write_raster(path("w.tif"), {"EPSG:32632", 500000.0, 5540000.0, 90.0, 30, 30, -9999.0, ""},
                     height);
  test::write_raster(path("e.tif"), {"EPSG:32632", 502700.0, 5540000.0, 90.0, 30, 30, -9999.0, ""},
                     height);
  const ElevationLayers layers =
      layers_of({path("w.tif"), path("e.tif")}, {501500.0, 5538000.0, 30.0, 80, 40});
  for (int column = 0; column < 80; ++column) {
    const double x_m = 501500.0 + (column + 0.5) * 30.0;
    EXPECT_NEAR(layers.terrain_m.at(column, 20), height(x_m, 5538000.0 + 20.5 * 30.0), 0.02);
  }
}

TEST_F(ElevationFiles, TheFirstFileWinsAndTheSecondFillsItsVoids) {
  test::write_raster(path("a.tif"),
                     {"EPSG:32632", 500000.0, 5540000.0, 10.0, 100, 100, -9999.0, ""},
                     [](double x, double) { return x < 500500.0 ? 100.0 : -9999.0; });
  test::write_raster(path("b.tif"), {"EPSG:4326", 8.98, 50.03, 0.0005, 100, 100, -9999.0, ""},
                     [](double, double) { return 400.0; });
  const ElevationLayers layers =
      layers_of({path("a.tif"), path("b.tif")}, {500000.0, 5539000.0, 20.0, 50, 50});
  EXPECT_EQ(layers.terrain_m.at(5, 25), 100.0F);
  EXPECT_EQ(layers.upper_terrain_m.at(5, 25), 100.0F);
  EXPECT_EQ(layers.terrain_m.at(45, 25), 400.0F);
}

TEST_F(ElevationFiles, FeetBecomeMetres) {
  test::write_raster(path("feet.tif"),
                     {"EPSG:32632", 500000.0, 5540000.0, 30.0, 40, 40, -9999.0, "ft"},
                     [](double, double) { return 1000.0; });
  const ElevationLayers layers = layers_of({path("feet.tif")}, {500300.0, 5539100.0, 30.0, 5, 5});
  EXPECT_NEAR(layers.terrain_m.at(2, 2), 304.8, 1.0 / 64.0);
}

TEST_F(ElevationFiles, ThreadsChangeNoByte) {
  test::write_raster(
      path("t.tif"), {"EPSG:4326", 11.0, 50.2, 0.0003, 900, 700, -9999.0, ""},
      [](double x, double y) { return 300.0 + 80.0 * std::sin(900.0 * x) * std::cos(700.0 * y); });
  const raster::GridGeometry g{645000.0, 5545000.0, 30.0, 500, 450};
  const ElevationLayers one = layers_of({path("t.tif")}, g, 1);
  const ElevationLayers four = layers_of({path("t.tif")}, g, 4);
  for (std::size_t i = 0; i < g.cell_count(); ++i) {
    ASSERT_TRUE(one.terrain_m.values()[i] == four.terrain_m.values()[i] ||
                (std::isnan(one.terrain_m.values()[i]) && std::isnan(four.terrain_m.values()[i])));
    ASSERT_TRUE(one.upper_terrain_m.values()[i] == four.upper_terrain_m.values()[i] ||
                std::isnan(one.upper_terrain_m.values()[i]));
  }
}

TEST_F(ElevationFiles, RefusalsSayWhatIsWrongWithWhichFile) {
  const auto open = [](const fs::path& file) {
    return refusal_of([&] { ElevationSource source({file}, egm96(), 0.0); });
  };
  EXPECT_THAT(open(path("nowhere.tif")), HasSubstr("nowhere.tif: no such file"));
  EXPECT_THAT(open(folder_.path()), HasSubstr("is not a file"));
  write_bytes(path("text.tif"), "this is no raster");
  EXPECT_THAT(open(path("text.tif")), HasSubstr("is not a raster"));
  write_bytes(path("foo.hgt"), hgt_bytes([](int, int) { return 1; }));
  EXPECT_THAT(open(path("foo.hgt")), HasSubstr("does not say where the tile lies"));
  write_bytes(path("N49E011.hgt"), "short");
  EXPECT_THAT(open(path("N49E011.hgt")), HasSubstr("is not a raster"));
  write_bytes(path("N50E011.hgt.zip"), std::string("PK\x03\x04 cut off", 12));
  EXPECT_THAT(open(path("N50E011.hgt.zip")), HasSubstr("zip"));
  test::write_raster(path("no_crs.tif"), {"", 0.0, 0.0, 1.0, 10, 10, -9999.0, ""},
                     [](double, double) { return 1.0; });
  EXPECT_THAT(open(path("no_crs.tif")), HasSubstr("no coordinate system"));
  test::write_raster(path("fathoms.tif"),
                     {"EPSG:32632", 500000.0, 5540000.0, 30.0, 10, 10, -9999.0, "fathom"},
                     [](double, double) { return 1.0; });
  EXPECT_THAT(open(path("fathoms.tif")), HasSubstr("'fathom'"));
  EXPECT_THROW(ElevationSource({}, egm96(), 0.0), UsageError);
}

TEST_F(ElevationFiles, StopsWhenAsked) {
  class Stopped final : public Observer {
   public:
    void progress(std::string_view, double, double) override {}
    void note(std::string_view) override {}
    [[nodiscard]] bool stop_requested() const override { return true; }
  } observer;
  test::write_raster(path("a.tif"), {"EPSG:32632", 500000.0, 5540000.0, 30.0, 40, 40, -9999.0, ""},
                     [](double, double) { return 1.0; });
  const ElevationSource source({path("a.tif")}, egm96(), 0.0);
  EXPECT_THROW((void)source.on_grid({500000.0, 5539000.0, 30.0, 9, 9}, utm32(), 1, observer),
               Interrupted);
}

TEST_F(ElevationFiles, EachCellIsOfTheFirstFileInOrderWhateverTheirLattices) {
  // West and east lie on one lattice, the survey between them in the order on another.
  const auto flat = [](double height_m) { return [height_m](double, double) { return height_m; }; };
  test::write_raster(path("w.tif"), {"EPSG:32632", 500000.0, 5540000.0, 90.0, 20, 30, -9999.0, ""},
                     flat(100.0));
  test::write_raster(path("survey.tif"),
                     {"EPSG:25832", 501000.0, 5540000.0, 10.0, 160, 270, -9999.0, ""}, flat(200.0));
  test::write_raster(path("e.tif"), {"EPSG:32632", 501800.0, 5540000.0, 90.0, 20, 30, -9999.0, ""},
                     flat(300.0));
  const ElevationLayers layers = layers_of({path("w.tif"), path("survey.tif"), path("e.tif")},
                                           {500300.0, 5538200.0, 30.0, 90, 40});
  const auto at = [&](double x_m) {
    return layers.source.at(layers.source.geometry().cell_at({x_m, 5538800.0}));
  };
  EXPECT_EQ(at(501200.0), 1);  // west and survey
  EXPECT_EQ(at(502300.0), 2);  // survey and east
  EXPECT_EQ(at(502700.0), 3);  // east alone
  EXPECT_EQ(layers.terrain_m.at(layers.terrain_m.geometry().cell_at({502300.0, 5538800.0})),
            200.0F);
}

TEST_F(ElevationFiles, KindIsTheUsersWordElseTheProductsElseTerrain) {
  const auto kind = [&](const std::string& name, const std::string& suffix = "") {
    test::write_raster(path(name), {}, [](double, double) { return 1.0; });
    const ElevationSource source({ElevationInput::parse(path(name).string() + suffix)}, egm96(),
                                 0.0);
    return std::string(word_of(source.files()[0].kind)) + " by " + source.files()[0].kind_from;
  };
  EXPECT_EQ(kind("plain.tif"), "terrain by default");
  EXPECT_EQ(kind("town_DSM_2019.tif"), "surface by name");
  EXPECT_EQ(kind("adsmith.tif"), "terrain by default");
  EXPECT_EQ(kind("srtm_38_03.tif"), "terrain by product");
  EXPECT_EQ(kind("ALPSMLC30_N049E011_DSM.tif"), "surface by product");
  EXPECT_EQ(kind("ALPSMLC30_N050E011_DSM.tif", ":terrain"), "terrain by command line");
  EXPECT_EQ(kind("other.tif", ":datum=EGM96:surface"), "surface by command line");
}

TEST(ElevationInput, PartsBehindTheNameAreReadInAnyOrder) {
  const ElevationInput input =
      ElevationInput::parse("/a/b.asc:crs=EPSG:25832:surface:datum=ellipsoid");
  EXPECT_EQ(input.file, "/a/b.asc");
  EXPECT_EQ(input.kind, ElevationKind::kSurface);
  EXPECT_EQ(input.crs, "EPSG:25832");
  ASSERT_TRUE(input.datum.has_value());
  EXPECT_EQ(input.datum->name, "ellipsoid");
  EXPECT_EQ(ElevationInput::parse("a.tif").file, "a.tif");
  EXPECT_FALSE(ElevationInput::parse("a.tif").kind.has_value());
  EXPECT_EQ(ElevationInput::parse("a.tif:roof").file, "a.tif:roof");  // then there is no such file
  EXPECT_THROW((void)ElevationInput::parse("a.tif:datum=sea"), UsageError);
}

TEST_F(ElevationFiles, BelowASurfaceTheGroundOfATerrainFileShows) {
  test::write_raster(path("dsm.tif"),
                     {"EPSG:32632", 500000.0, 5540000.0, 30.0, 60, 60, -9999.0, ""},
                     [](double x, double) { return x < 500900.0 ? 430.0 : 390.0; });
  test::write_raster(path("dtm.tif"),
                     {"EPSG:32632", 500000.0, 5540000.0, 10.0, 180, 180, -9999.0, ""},
                     [](double, double) { return 400.0; });
  const raster::GridGeometry g{500300.0, 5538600.0, 30.0, 40, 20};
  const ElevationLayers layers = layers_of({path("dsm.tif"), path("dtm.tif")}, g);
  EXPECT_EQ(layers.terrain_m.at(5, 10), 400.0F);
  EXPECT_EQ(layers.upper_terrain_m.at(5, 10), 430.0F);
  EXPECT_EQ(layers.is_surface.at(5, 10), 1);
  EXPECT_EQ(layers.terrain_m.at(35, 10), 390.0F);  // never above the surface
  const ElevationLayers other = layers_of({path("dtm.tif"), path("dsm.tif")}, g);
  EXPECT_EQ(other.upper_terrain_m.at(5, 10), 400.0F);
  EXPECT_EQ(other.is_surface.at(5, 10), 0);
}

ElevationLayers filled_layers(const std::vector<ElevationInput>& files,
                              const raster::GridGeometry& geometry, double radius_m) {
  SilentObserver observer;
  return ElevationSource(files, egm96(), radius_m).on_grid(geometry, utm32(), 1, observer);
}

TEST_F(ElevationFiles, ASmallHoleIsFilledInALargeOneOnlyWhereItIsNarrow) {
  const auto plane = [](double x, double y) {
    return 300.0 + 0.1 * (x - 500000.0) + 0.2 * (y - 5538000.0);
  };
  const geo::MapPoint small{500315.0, 5539085.0};
  const geo::MapPoint large{501215.0, 5539085.0};
  test::write_raster(path("holes.tif"),
                     {"EPSG:32632", 500000.0, 5540000.0, 30.0, 60, 60, -9999.0, ""},
                     [&](double x, double y) {
                       return std::hypot(x - small.x_m, y - small.y_m) < 65.0 ||
                                      std::hypot(x - large.x_m, y - large.y_m) < 300.0
                                  ? -9999.0
                                  : plane(x, y);
                     });
  const raster::GridGeometry g{499700.0 + 300.0, 5538200.0, 30.0, 70, 50};  // reaches over the edge
  const ElevationLayers layers = filled_layers({path("holes.tif")}, g, 120.0);
  const raster::CellIndex cell = g.cell_at(small);
  EXPECT_EQ(layers.source.at(cell), ElevationLayers::kFilled);
  EXPECT_NEAR(layers.terrain_m.at(cell), plane(small.x_m, small.y_m), 1.0 / 64.0);
  // The rim, three cells away uphill to the north-east, is the highest that is seen.
  EXPECT_GE(layers.upper_terrain_m.at(cell), plane(small.x_m + 60.0, small.y_m + 60.0) - 0.1);
  EXPECT_TRUE(std::isnan(layers.terrain_m.at(g.cell_at(large))));
  EXPECT_TRUE(std::isnan(layers.upper_terrain_m.at(g.cell_at(large))));
  EXPECT_EQ(layers.source.at(g.cell_at(large)), 0);
  EXPECT_TRUE(std::isnan(layers.terrain_m.at(g.cell_at({501830.0, 5539085.0}))));  // east of all
  EXPECT_TRUE(std::isnan(filled_layers({path("holes.tif")}, g, 0.0).terrain_m.at(cell)));
  // A second file comes first.
  test::write_raster(path("more.tif"),
                     {"EPSG:32632", 500000.0, 5540000.0, 30.0, 60, 60, -9999.0, ""},
                     [](double, double) { return 777.0; });
  const ElevationLayers both = filled_layers({path("holes.tif"), path("more.tif")}, g, 120.0);
  EXPECT_EQ(both.terrain_m.at(cell), 777.0F);
  EXPECT_EQ(both.source.at(cell), 2);
}

TEST_F(ElevationFiles, ACellDoesNotDependOnHowFarTheGridReaches) {
  std::random_device device;
  const unsigned seed = device();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  test::write_raster(path("rough.tif"),
                     {"EPSG:32632", 500003.0, 5540011.0, 21.0, 120, 120, -9999.0, ""},
                     [&](double, double) {
                       return uniform(random) < 0.6 ? -9999.0 : 100.0 + 60.0 * uniform(random);
                     });
  const raster::GridGeometry large{500100.0, 5537700.0, 30.0, 70, 70};
  const raster::GridGeometry small{500400.0, 5538000.0, 30.0, 40, 35};
  const ElevationLayers whole = filled_layers({path("rough.tif")}, large, 70.0);
  const ElevationLayers part = filled_layers({path("rough.tif")}, small, 70.0);
  int filled = 0;
  for (int row = 0; row < small.rows; ++row) {
    for (int column = 0; column < small.columns; ++column) {
      ASSERT_EQ(part.source.at(column, row), whole.source.at(column + 10, row + 10));
      filled += part.source.at(column, row) == ElevationLayers::kFilled ? 1 : 0;
      if (part.source.at(column, row) != 0) {
        ASSERT_EQ(part.terrain_m.at(column, row), whole.terrain_m.at(column + 10, row + 10));
        ASSERT_EQ(part.upper_terrain_m.at(column, row),
                  whole.upper_terrain_m.at(column + 10, row + 10));
      }
    }
  }
  EXPECT_GT(filled, 0);
}

TEST_F(ElevationFiles, HeightsOfAnotherDatumAreConverted) {
  const geo::MapPoint place = geo::MapProjection("EPSG:32632")
                                  .to_map({radians_from_degrees(51.5), radians_from_degrees(10.5)});
  const raster::GridGeometry g{std::floor(place.x_m / 30.0) * 30.0,
                               std::floor(place.y_m / 30.0) * 30.0, 30.0, 2, 2};
  const auto height_at_place = [&](const std::string& crs, const std::string& suffix) {
    test::write_raster(path("h.tif"), {crs, 10.4, 51.6, 0.002, 100, 100, -9999.0, ""},
                       [](double, double) { return 345.86; });
    const ElevationSource source({ElevationInput::parse(path("h.tif").string() + suffix)}, egm96(),
                                 0.0);
    SilentObserver observer;
    return source.on_grid(g, utm32(), 1, observer).terrain_m.at(0, 0);
  };
  // EGM96's geoid lies 45.86 m above the ellipsoid at 51.5 N, 10.5 E.
  EXPECT_NEAR(height_at_place("EPSG:4326", ":datum=ellipsoid"), 300.0, 0.03);
  EXPECT_NEAR(height_at_place("EPSG:4979", ""), 300.0, 0.03);
  EXPECT_NEAR(height_at_place("EPSG:4326+5773", ""), 345.86, 0.02);
  EXPECT_NEAR(height_at_place("EPSG:4326", ""), 345.86, 0.02);
  EXPECT_NEAR(height_at_place("EPSG:4326+5773", ":datum=ellipsoid"), 300.0, 0.03);
  std::string what;
  try {
    const float height_m = height_at_place("EPSG:4326+3855", "");
    EXPECT_NE(height_m, 345.86F);  // the grid is installed: the two models differ here
  } catch (const DataError& error) {
    EXPECT_THAT(error.what(), testing::AllOf(HasSubstr("h.tif"), HasSubstr("us_nga_egm08_25")));
    EXPECT_THAT(error.hint(), HasSubstr("datum="));
  }
}

TEST_F(ElevationFiles, FormatsOfOneRasterGiveOneTerrain) {
  test::write_raster(path("a.tif"), {"EPSG:32632", 500000.0, 5540000.0, 40.0, 50, 50, -9999.0, ""},
                     [](double x, double y) {
                       return std::fabs(x - 500820.0) < 1.0 && std::fabs(y - 5539180.0) < 1.0
                                  ? 900.0
                              : x < 500200.0 ? -9999.0
                                             : 250.5;
                     });
  GDALDataset* source = GDALDataset::Open(path("a.tif").c_str());
  ASSERT_NE(source, nullptr);
  const auto copy = [&](const char* driver, const char* name, std::vector<const char*> options) {
    options.push_back(nullptr);
    GDALDataset* made = GetGDALDriverManager()->GetDriverByName(driver)->CreateCopy(
        path(name).c_str(), source, FALSE, const_cast<char**>(options.data()), nullptr, nullptr);
    ASSERT_NE(made, nullptr) << driver;
    GDALClose(made);
  };
  copy("AAIGrid", "a.asc", {"DECIMAL_PRECISION=2"});
  fs::remove(path("a.prj"));
  fs::remove(path("a.asc.aux.xml"));
  copy("VRT", "a.vrt", {});
  copy("COG", "cog.tif", {"COMPRESS=LZW", "OVERVIEWS=IGNORE_EXISTING"});
  copy("EHdr", "b.bil", {});
  source->SetMetadataItem("AREA_OR_POINT", "Point");
  copy("GTiff", "point.tif", {"TILED=YES"});
  GDALClose(source);
  // The same grid by the centre of its south-western cell.
  std::ifstream corner(path("a.asc"));
  std::ofstream centre(path("centre.asc"));
  for (std::string line; std::getline(corner, line);) {
    if (line.starts_with("xllcorner")) {
      line = "xllcenter 500020.0";
    } else if (line.starts_with("yllcorner")) {
      line = "yllcenter 5538020.0";
    }
    centre << line << "\n";
  }
  centre.close();
  const raster::GridGeometry g{500000.0, 5538600.0, 20.0, 80, 50};
  const ElevationLayers expected = layers_of({path("a.tif")}, g);
  EXPECT_GE(expected.upper_terrain_m.at(g.cell_at({500820.0, 5539180.0})), 900.0F);
  for (const char* name : {"a.asc:crs=EPSG:32632", "centre.asc:crs=EPSG:32632", "a.vrt", "cog.tif",
                           "b.bil", "point.tif"}) {
    const ElevationLayers layers = layers_of({ElevationInput::parse(path(name).string())}, g);
    for (std::size_t i = 0; i < g.cell_count(); ++i) {
      const float a = layers.upper_terrain_m.values()[i];
      const float b = expected.upper_terrain_m.values()[i];
      ASSERT_TRUE(a == b || (std::isnan(a) && std::isnan(b))) << name << ": " << a << " " << b;
    }
  }
  EXPECT_THAT(refusal_of([&] { ElevationSource lost({path("a.asc")}, egm96(), 0.0); }),
              HasSubstr("no coordinate system"));
}

TEST_F(ElevationFiles, ATextGridThatIsDamagedAboveTheRegionIsRefusedAtOnce) {
  std::ofstream file(path("cut.asc"));
  file << "ncols 100\nnrows 90\nxllcorner 500000\nyllcorner 5538000\ncellsize 30\n";
  for (int row = 0; row < 40; ++row) {
    for (int column = 0; column < (row == 20 ? 97 : 100); ++column) {
      file << " 300";
    }
    file << "\n";
  }
  file.close();
  EXPECT_THAT(refusal_of([&] {
                (void)layers_of(
                    {ElevationInput::parse(path("cut.asc").string() + ":crs=EPSG:32632")},
                    {500600.0, 5538300.0, 30.0, 20, 20});
              }),
              HasSubstr("cannot be read"));
}

TEST_F(ElevationFiles, AVirtualMosaicThatPointsElsewhereIsRefused) {
  const auto vrt = [&](const std::string& target) {
    write_bytes(path("m.vrt"),
                "<VRTDataset rasterXSize=\"10\" rasterYSize=\"10\"><SRS>EPSG:32632</SRS>"
                "<GeoTransform>500000,30,0,5540000,0,-30</GeoTransform>"
                "<VRTRasterBand dataType=\"Float32\" band=\"1\"><SimpleSource><SourceFilename "
                "relativeToVRT=\"0\">" +
                    target +
                    "</SourceFilename><SourceBand>1</SourceBand><SourceProperties "
                    "RasterXSize=\"10\" RasterYSize=\"10\" DataType=\"Float32\"/></SimpleSource>"
                    "</VRTRasterBand></VRTDataset>");
    return refusal_of([&] { (void)layers_of({path("m.vrt")}, {500060.0, 5539760.0, 30.0, 5, 5}); });
  };
  EXPECT_THAT(vrt("/vsicurl/http://example.org/a.tif"), HasSubstr("no file here"));
  EXPECT_THAT(vrt("/nowhere/at_all.tif"), HasSubstr("cannot be read"));
}

TEST(ElevationOfRealTiles, ZippedTilesOfNorthernBavariaOpen) {
  const char* data = std::getenv("HEDGEHOP_DATA");
  const fs::path folder = fs::path(data == nullptr ? "../shared/data" : data) / "bayreuth";
  if (!fs::exists(folder / "N49E011.hgt.zip")) {
    GTEST_SKIP() << "no real data in " << folder.string();
  }
  const ElevationSource source({folder / "N49E011.hgt.zip", folder / "N50E011.hgt.zip"}, egm96(),
                               0.0);
  EXPECT_EQ(source.files()[0].format, "SRTMHGT");
  EXPECT_NEAR(degrees_from_radians(source.extent().north_rad), 51.0004167, 1e-6);
  // Across the seam at 50 N heights must run on: no step beyond what the relief of 90 m samples
  // has.
  const raster::GridGeometry g{680000.0, 5539000.0, 30.0, 200, 100};
  SilentObserver observer;
  const ElevationLayers layers = source.on_grid(g, utm32(), 2, observer);
  double greatest_step_m = 0.0;
  for (int row = 0; row + 1 < g.rows; ++row) {
    for (int column = 0; column < g.columns; ++column) {
      greatest_step_m = std::max(
          greatest_step_m, std::fabs(static_cast<double>(layers.terrain_m.at(column, row + 1)) -
                                     static_cast<double>(layers.terrain_m.at(column, row))));
    }
  }
  EXPECT_LT(greatest_step_m, 30.0);
}

}  // namespace
}  // namespace hedgehop::map_sources
