#include "preparation/visibility.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <gdal_alg.h>
#include <gdal_priv.h>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

#include "base/errors.hpp"
#include "map/map.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::preparation {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

// Rolling hills of several wavelengths; slopes up to about 30 degrees.
raster::Grid<float> hills(int columns, int rows, double cell_m, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> phase(0.0, 2.0 * std::numbers::pi);
  raster::Grid<float> grid({1000.0, 2000.0, cell_m, columns, rows}, 0.0F);
  for (const double wavelength_m : {3000.0, 1300.0, 560.0, 240.0}) {
    for (int wave = 0; wave < 3; ++wave) {
      const double direction = phase(random);
      const double offset = phase(random);
      const double k = 2.0 * std::numbers::pi / wavelength_m;
      for (int row = 0; row < rows; ++row) {
        for (int column = 0; column < columns; ++column) {
          const double along_m =
              cell_m * (column * std::cos(direction) + row * std::sin(direction));
          grid.at(column, row) +=
              static_cast<float>(0.02 * wavelength_m * std::sin(k * along_m + offset));
        }
      }
    }
  }
  return grid;
}

VisibilityOptions flat_earth(double radius_m, double reference_height_m, int azimuths) {
  return {radius_m, reference_height_m, azimuths, false, 0.0, {}};
}

VisibilityLayers layers_everywhere(const VisibilityGround& ground, const VisibilityOptions& options,
                                   const VisibilityExecution& execution = {1, Simd::kBest}) {
  SilentObserver observer;
  return visibility_of_block(ground, {0, 0}, ground.surface_m.columns(), ground.surface_m.rows(),
                             options, execution, observer);
}

raster::Grid<std::uint16_t> visibility_everywhere(const raster::Grid<float>& surface_m,
                                                  const VisibilityOptions& options,
                                                  int threads = 1) {
  return layers_everywhere({surface_m, surface_m}, options, {threads, Simd::kBest}).shares[0];
}

std::uint16_t visibility_at(const raster::Grid<float>& surface_m, raster::CellIndex cell,
                            const VisibilityOptions& options) {
  SilentObserver observer;
  return visibility_of_block({surface_m, surface_m}, cell, 1, 1, options, {1, Simd::kBest},
                             observer)
      .shares[0]
      .at(0, 0);
}

// Hills with holes, steep pits and walls: nothing a raster can hold is left out.
raster::Grid<float> wild_ground(int columns, int rows, unsigned seed) {
  raster::Grid<float> grid = hills(columns, rows, 30.0, seed);
  std::mt19937 random(seed);
  for (int i = 0; i < columns * rows / 50; ++i) {
    float& value = grid.at(static_cast<int>(random() % columns), static_cast<int>(random() % rows));
    value = random() % 3 == 0 ? kNan : value + static_cast<float>(random() % 120) - 40.0F;
  }
  return grid;
}

raster::Grid<float> raised_here_and_there(raster::Grid<float> grid, unsigned seed) {
  std::mt19937 random(seed + 1);
  for (float& value : grid.values()) {
    value += random() % 20 == 0 ? 45.0F : 0.0F;
  }
  return grid;
}

void expect_same(const VisibilityLayers& a, const VisibilityLayers& b) {
  ASSERT_EQ(a.shares.size(), b.shares.size());
  for (std::size_t i = 0; i < a.shares.size(); ++i) {
    EXPECT_EQ(a.shares[i].values(), b.shares[i].values()) << "height " << i;
  }
  EXPECT_EQ(a.is_partial.values(), b.is_partial.values());
}

TEST(Visibility, FlatGroundIsSeenAltogether) {
  const raster::Grid<float> flat({0.0, 0.0, 30.0, 60, 50}, 321.0F);
  const auto stored = visibility_everywhere(flat, flat_earth(900.0, 15.24, 64));
  for (const std::uint16_t value : stored.values()) {
    EXPECT_EQ(value, 65534);
  }
}

TEST(Visibility, ALongWallHidesWhatItsShadowCovers) {
  // A wall along x, 20 cells north of the eye, 100 m high, eye at 10 m: the ground behind is hidden
  // altogether, so the rest of the disc is seen: with R = 40 cells and the wall at distance a = R /
  // 2, the hidden segment has the share (acos(1/2) - sin(acos(1/2)) / 2) / pi = (pi/3 - sqrt(3)/4)
  // / pi.
  raster::Grid<float> ground({0.0, 0.0, 10.0, 101, 101}, 0.0F);
  for (int column = 0; column < 101; ++column) {
    ground.at(column, 70) = 100.0F;
  }
  const std::uint16_t stored = visibility_at(ground, {50, 50}, flat_earth(400.0, 10.0, 720));
  const double hidden = (std::numbers::pi / 3.0 - std::sqrt(3.0) / 4.0) / std::numbers::pi;
  // The wall itself is seen and one cell wide: its row belongs to the seen part.
  EXPECT_NEAR(map::visibility_share(stored), 1.0 - hidden, 0.015);
}

TEST(Visibility, AHouseTakesTheSameViewFromAPlaceBesideItWhereverBothStand) {
  // Five houses on a plain, farther from each other than is looked: what stands in the nearest rows
  // hides by where it is seen from alone, not by where the lines of the map run.
  constexpr int kBeside = 7;
  constexpr std::array<raster::CellIndex, 5> kHouses = {
      {{45, 45}, {136, 47}, {50, 143}, {141, 138}, {93, 94}}};
  raster::Grid<float> ground({1234.0, 987.0, 10.0, 190, 190}, 100.0F);
  for (const raster::CellIndex& house : kHouses) {
    ground.at(house.column, house.row) = 160.0F;
  }
  const auto stored = visibility_everywhere(ground, flat_earth(300.0, 15.24, 180));
  int hidden = 0;
  for (int row = -kBeside; row <= kBeside; ++row) {
    for (int column = -kBeside; column <= kBeside; ++column) {
      const auto beside = [&](const raster::CellIndex& house) {
        return stored.at(house.column + column, house.row + row);
      };
      hidden += beside(kHouses[0]) < 65000 ? 1 : 0;
      for (const raster::CellIndex& house : kHouses) {
        EXPECT_EQ(beside(house), beside(kHouses[0])) << column << " columns, " << row << " rows";
      }
    }
  }
  EXPECT_GT(hidden, 100) << "the house must hide something";
}

TEST(Visibility, AgreesWithBruteForceLinesOfSight) {
  std::random_device device;
  const unsigned seed = device();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const VisibilityOptions options{5000.0, 15.24, 180, true, 0.13, {}};
  const raster::Grid<float> surface_m = hills(420, 410, 30.0, seed);
  std::vector<double> errors;
  for (int i = 0; i < 40; ++i) {
    const raster::CellIndex cell{static_cast<int>(random() % 240),
                                 static_cast<int>(random() % 220)};
    errors.push_back(
        std::fabs(map::visibility_share(visibility_at(surface_m, cell, options)) -
                  reference_visibility_share({surface_m, surface_m}, cell, 15.24, options)));
  }
  std::sort(errors.begin(), errors.end());
  double mean = 0.0;
  for (const double error : errors) {
    mean += error / static_cast<double>(errors.size());
  }
  RecordProperty("mean_error", std::to_string(mean));
  EXPECT_LE(mean, 0.001) << "greatest " << errors.back();
  EXPECT_LE(errors[37], 0.003);
}

TEST(Visibility, AgreesWithBruteForceWhereForestsMakeSteps) {
  std::random_device device;
  const unsigned seed = device();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const VisibilityOptions options{5000.0, 15.24, 180, true, 0.13, {}};
  raster::Grid<float> surface_m = hills(420, 410, 30.0, seed);
  for (int i = 0; i < 600; ++i) {
    const int column = static_cast<int>(random() % 420);
    const int row = static_cast<int>(random() % 410);
    const int columns = 1 + static_cast<int>(random() % 14);
    const int rows = 1 + static_cast<int>(random() % 14);
    for (int r = row; r < std::min(row + rows, 410); ++r) {
      for (int c = column; c < std::min(column + columns, 420); ++c) {
        surface_m.at(c, r) += 25.0F;
      }
    }
  }
  double mean = 0.0;
  double bias = 0.0;
  constexpr int kCells = 40;
  for (int i = 0; i < kCells; ++i) {
    const raster::CellIndex cell{170 + static_cast<int>(random() % 80),
                                 170 + static_cast<int>(random() % 70)};
    const double error = map::visibility_share(visibility_at(surface_m, cell, options)) -
                         reference_visibility_share({surface_m, surface_m}, cell, 15.24, options);
    mean += std::fabs(error) / kCells;
    bias += error / kCells;
  }
  RecordProperty("mean_error", std::to_string(mean));
  RecordProperty("bias", std::to_string(bias));
  EXPECT_LE(mean, 0.0015);
  EXPECT_LE(std::fabs(bias), 0.001);
}

TEST(Visibility, AgreesWithTheViewshedOfGdal) {
  GDALAllRegister();
  const unsigned seed = 20;
  const int size = 161;
  const raster::Grid<float> surface_m = hills(size, size, 30.0, seed);
  const double radius_m = 2000.0;
  auto* memory = GetGDALDriverManager()->GetDriverByName("MEM");
  auto* dataset = memory->Create("", size, size, 1, GDT_Float32, nullptr);
  double transform[6] = {0.0, 30.0, 0.0, size * 30.0, 0.0, -30.0};
  dataset->SetGeoTransform(transform);
  for (int row = 0; row < size; ++row) {
    ASSERT_EQ(dataset->GetRasterBand(1)->RasterIO(GF_Write, 0, size - 1 - row, size, 1,
                                                  const_cast<float*>(surface_m.row(row)), size, 1,
                                                  GDT_Float32, 0, 0, nullptr),
              CE_None);
  }
  double sum = 0.0;
  int count = 0;
  for (const raster::CellIndex cell :
       {raster::CellIndex{80, 80}, raster::CellIndex{75, 90}, raster::CellIndex{88, 71},
        raster::CellIndex{70, 70}, raster::CellIndex{91, 84}}) {
    const geo::MapPoint eye{(cell.column + 0.5) * 30.0, (cell.row + 0.5) * 30.0};
    GDALDatasetH viewshed =
        GDALViewshedGenerate(GDALRasterBand::ToHandle(dataset->GetRasterBand(1)), "MEM", "",
                             nullptr, eye.x_m, eye.y_m, 15.24, 0.0, 255, 0, 100, -1, 0.0, GVM_Edge,
                             radius_m, nullptr, nullptr, GVOT_NORMAL, nullptr);
    ASSERT_NE(viewshed, nullptr);
    auto* band = GDALDataset::FromHandle(viewshed)->GetRasterBand(1);
    std::vector<GByte> cells(static_cast<std::size_t>(band->GetXSize()) *
                             static_cast<std::size_t>(band->GetYSize()));
    ASSERT_EQ(band->RasterIO(GF_Read, 0, 0, band->GetXSize(), band->GetYSize(), cells.data(),
                             band->GetXSize(), band->GetYSize(), GDT_Byte, 0, 0, nullptr),
              CE_None);
    const auto seen = std::count(cells.begin(), cells.end(), 255);
    const auto hidden = std::count(cells.begin(), cells.end(), 0);
    GDALClose(viewshed);
    const double share =
        map::visibility_share(visibility_at(surface_m, cell, flat_earth(radius_m, 15.24, 180)));
    const double gdal_share = static_cast<double>(seen) / static_cast<double>(seen + hidden);
    EXPECT_NEAR(share, gdal_share, 0.02);
    sum += share - gdal_share;
    ++count;
  }
  EXPECT_NEAR(sum / count, 0.0, 0.008);
  GDALClose(dataset);
}

TEST(Visibility, RoundingHidesNextToNothingOfAnEvenSlope) {
  // From above an even slope all of it is seen. Far out its slopes rise by less from step to step
  // than heights are rounded: by 1.1 units in the first line, by 0.1 in the last.
  struct Eye {
    double cell_m;
    double height_m;
    double least_share;
  };
  const std::uint64_t seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> steepness(-0.2, 0.2);
  constexpr double kRadius_m = 5000.0;
  for (const Eye& eye : {Eye{30.0, 15.24, 0.999}, Eye{20.0, 15.24, 0.999}, Eye{10.0, 15.24, 0.997},
                         Eye{30.0, 5.0, 0.997}, Eye{20.0, 5.0, 0.994}, Eye{10.0, 5.0, 0.98}}) {
    const int reach = static_cast<int>(kRadius_m / eye.cell_m) + 2;
    const int side = 2 * reach + 1;
    for (int i = 0; i < 5; ++i) {
      const double eastwards = eye.cell_m * steepness(random);
      const double northwards = eye.cell_m * steepness(random);
      raster::Grid<float> slope({0.0, 0.0, eye.cell_m, side, side}, 0.0F);
      for (int row = 0; row < side; ++row) {
        for (int column = 0; column < side; ++column) {
          slope.at(column, row) =
              static_cast<float>(eastwards * (column - reach) + northwards * (row - reach));
        }
      }
      EXPECT_GE(map::visibility_share(
                    visibility_at(slope, {reach, reach}, flat_earth(kRadius_m, eye.height_m, 180))),
                eye.least_share)
          << eye.cell_m << " m cells, from " << eye.height_m << " m; a cell eastwards rises by "
          << eastwards << " m, a cell northwards by " << northwards << " m";
    }
  }
}

TEST(Visibility, LevelGroundIsSeenAltogetherHoweverLowTheEye) {
  // Far out neighbouring slopes differ by much less than a unit.
  const raster::Grid<float> flat({0.0, 0.0, 10.0, 603, 603}, 321.37F);
  for (const double height_m : {0.5, 2.0, 15.24}) {
    EXPECT_EQ(visibility_at(flat, {301, 301}, flat_earth(3000.0, height_m, 64)), 65534) << height_m;
  }
}

TEST(Visibility, ReliefThatTakesWideLanesChangesNothingElsewhere) {
  // A spire beyond the reach of the left half makes heights of the tile span more than 16 bits.
  const std::uint64_t seed = test::fresh_seed();
  const raster::Grid<float> ground = wild_ground(200, 90, static_cast<unsigned>(seed));
  raster::Grid<float> with_spire = ground;
  with_spire.at(190, 45) = 8000.0F;
  const VisibilityOptions options{1500.0, 15.24, 60, true, 0.13, {60.0}};
  const auto narrow = layers_everywhere({ground, ground}, options);
  const auto wide = layers_everywhere({with_spire, with_spire}, options);
  for (std::size_t i = 0; i < 2; ++i) {
    for (int row = 0; row < 90; ++row) {
      for (int column = 0; column < 190 - 53; ++column) {
        ASSERT_EQ(narrow.shares[i].at(column, row), wide.shares[i].at(column, row));
      }
    }
  }
  EXPECT_NE(narrow.shares[0].values(), wide.shares[0].values());
}

TEST(Visibility, LowEyesOverAWideHorizonAreTheSameBytesInKernelAndPlainReference) {
  const auto seed = static_cast<unsigned>(test::fresh_seed());
  const raster::Grid<float> ground_m = wild_ground(60, 50, seed);
  // The horizon of a smooth earth is 1.0 and 1.2 km away.
  for (const double height_m : {0.07, 0.1}) {
    const VisibilityOptions options{1400.0, height_m, 36, true, 0.13, {30.0}};
    expect_same(layers_everywhere({ground_m, ground_m}, options),
                plain_visibility_of_block({ground_m, ground_m}, {0, 0}, 60, 50, options));
  }
}

TEST(Visibility, TurningTheGroundTurnsTheResult) {
  const raster::Grid<float> surface_m = hills(70, 70, 30.0, 7);
  raster::Grid<float> turned(surface_m.geometry(), 0.0F);
  for (int row = 0; row < 70; ++row) {
    for (int column = 0; column < 70; ++column) {
      turned.at(69 - row, column) = surface_m.at(column, row);  // a quarter turn to the left
    }
  }
  const VisibilityOptions options = flat_earth(900.0, 15.24, 180);
  const auto stored = visibility_everywhere(surface_m, options);
  const auto stored_turned = visibility_everywhere(turned, options);
  double sum = 0.0;
  for (int row = 0; row < 70; ++row) {
    for (int column = 0; column < 70; ++column) {
      // Rays may lie a quarter of a cell to another side.
      const double difference = map::visibility_share(stored_turned.at(69 - row, column)) -
                                map::visibility_share(stored.at(column, row));
      EXPECT_NEAR(difference, 0.0, 0.04);
      sum += std::fabs(difference);
    }
  }
  EXPECT_LE(sum / (70 * 70), 0.003);
}

TEST(Visibility, KernelAndPlainReferenceGiveTheSameBytes) {
  const auto seed = static_cast<unsigned>(test::fresh_seed());
  const raster::Grid<float> opaque_m = wild_ground(110, 95, seed);
  const raster::Grid<float> surface_m = raised_here_and_there(opaque_m, seed);
  for (const std::vector<double>& heights_m : {std::vector<double>{},
                                               {30.0},
                                               {0.0, 60.0},
                                               {60.0, 30.0, 5.0, 150.0, 100.0, 200.0, 15.24}}) {
    const VisibilityOptions options{1100.0, 15.24, 44, true, 0.13, heights_m};
    SilentObserver observer;
    const auto fast = visibility_of_block({opaque_m, surface_m}, {7, 3}, 97, 90, options,
                                          {1, Simd::kBest}, observer);
    expect_same(fast, plain_visibility_of_block({opaque_m, surface_m}, {7, 3}, 97, 90, options));
  }
}

TEST(Visibility, KernelAndPlainReferenceGiveTheSameBytesForRaysOfAnyLength) {
  const auto seed = static_cast<unsigned>(test::fresh_seed());
  const raster::Grid<float> ground_m = wild_ground(45, 41, seed);
  for (const double radius_m : {60.0, 250.0, 510.0, 690.0, 760.0, 1500.0, 2500.0}) {
    SCOPED_TRACE("radius " + std::to_string(radius_m));
    const VisibilityOptions options{radius_m, 15.24, 36, true, 0.13, {70.0}};
    expect_same(layers_everywhere({ground_m, ground_m}, options),
                plain_visibility_of_block({ground_m, ground_m}, {0, 0}, 45, 41, options));
  }
}

TEST(Visibility, HeightsThatNoEarthHasChangeNothingBetweenKernelAndPlainReference) {
  const auto seed = static_cast<unsigned>(test::fresh_seed());
  raster::Grid<float> ground_m = wild_ground(80, 70, seed);
  std::mt19937 random(seed);
  for (const float height_m : {1e5F, -1e5F, 3e7F, -3e7F, 1e30F, -1e30F, 3e38F, -3e38F}) {
    for (int i = 0; i < 5; ++i) {
      ground_m.at(static_cast<int>(random() % 80), static_cast<int>(random() % 70)) = height_m;
    }
  }
  const VisibilityOptions options{900.0, 15.24, 40, true, 0.13, {60.0}};
  expect_same(layers_everywhere({ground_m, ground_m}, options),
              plain_visibility_of_block({ground_m, ground_m}, {0, 0}, 80, 70, options));
}

TEST(Visibility, KernelAndPlainReferenceGiveTheSameBytesWithWeightedGround) {
  const auto seed = static_cast<unsigned>(test::fresh_seed());
  const raster::Grid<float> opaque_m = wild_ground(90, 80, seed);
  raster::Grid<std::uint8_t> weight(opaque_m.geometry(), 0);
  std::mt19937 random(seed);
  for (std::uint8_t& value : weight.values()) {
    value = static_cast<std::uint8_t>(random() % (kGroundWeightMax + 1));
  }
  const VisibilityOptions options{1000.0, 15.24, 52, true, 0.13, {40.0, 90.0, 120.0}};
  const VisibilityGround ground{opaque_m, opaque_m, &weight};
  expect_same(layers_everywhere(ground, options),
              plain_visibility_of_block(ground, {0, 0}, 90, 80, options));
}

TEST(Visibility, AllInstructionSetsGiveTheSameBytes) {
  if (!is_available(Simd::kAvx2) || !is_available(Simd::kAvx512)) {
    GTEST_SKIP() << "this processor has not both AVX2 and AVX-512";
  }
  const auto seed = static_cast<unsigned>(test::fresh_seed());
  const raster::Grid<float> ground_m = wild_ground(230, 140, seed);
  raster::Grid<std::uint8_t> weight(ground_m.geometry(), kGroundWeightMax / 2);
  for (const auto* weights : {static_cast<raster::Grid<std::uint8_t>*>(nullptr), &weight}) {
    const VisibilityGround ground{ground_m, ground_m, weights};
    for (const std::vector<double>& heights_m :
         {std::vector<double>{}, {60.0}, {60.0, 90.0}, {30.0, 60.0, 100.0, 150.0}}) {
      const VisibilityOptions options{1500.0, 15.24, 60, true, 0.13, heights_m};
      expect_same(layers_everywhere(ground, options, {1, Simd::kAvx512}),
                  layers_everywhere(ground, options, {1, Simd::kAvx2}));
    }
  }
}

TEST(Visibility, NeitherThreadsNorBlockNorRasterChangeAByte) {
  const auto seed = static_cast<unsigned>(test::fresh_seed());
  const raster::Grid<float> surface_m = wild_ground(290, 250, seed);
  const VisibilityOptions options{1500.0, 15.24, 180, true, 0.13, {60.0}};
  const VisibilityGround ground{surface_m, surface_m};
  const auto one = layers_everywhere(ground, options, {1, Simd::kBest});
  expect_same(layers_everywhere(ground, options, {2, Simd::kBest}), one);
  expect_same(layers_everywhere(ground, options, {7, Simd::kBest}), one);

  // A block, out of the whole raster and out of a smaller one that reaches two cells beyond the
  // radius.
  const raster::CellIndex block{87, 71};
  constexpr int kColumns = 91;
  constexpr int kRows = 83;
  constexpr int kHalo = 52;
  raster::Grid<float> part({surface_m.geometry().west_m + (block.column - kHalo) * 30.0,
                            surface_m.geometry().south_m + (block.row - kHalo) * 30.0, 30.0,
                            kColumns + 2 * kHalo, kRows + 2 * kHalo},
                           0.0F);
  for (int row = 0; row < part.rows(); ++row) {
    for (int column = 0; column < part.columns(); ++column) {
      part.at(column, row) = surface_m.at(block.column - kHalo + column, block.row - kHalo + row);
    }
  }
  SilentObserver observer;
  const auto of_whole =
      visibility_of_block(ground, block, kColumns, kRows, options, {3, Simd::kBest}, observer);
  const auto of_part = visibility_of_block({part, part}, {kHalo, kHalo}, kColumns, kRows, options,
                                           {1, Simd::kBest}, observer);
  expect_same(of_part, of_whole);
  for (std::size_t i = 0; i < 2; ++i) {
    for (int row = 0; row < kRows; ++row) {
      for (int column = 0; column < kColumns; ++column) {
        ASSERT_EQ(of_whole.shares[i].at(column, row),
                  one.shares[i].at(block.column + column, block.row + row));
      }
    }
  }
}

TEST(Visibility, SpansLimitWhatIsComputedAndChangeNothingElse) {
  const raster::Grid<float> surface_m = wild_ground(150, 120, 5);
  const VisibilityOptions options{900.0, 15.24, 60, true, 0.13, {50.0}};
  const auto all = layers_everywhere({surface_m, surface_m}, options);
  std::vector<ColumnSpan> spans(120);
  for (int row = 0; row < 120; ++row) {
    spans[static_cast<std::size_t>(row)] = {std::abs(row - 60), 150 - std::abs(row - 60)};
  }
  spans[3] = {9, 9};
  SilentObserver observer;
  const auto some = visibility_of_block({surface_m, surface_m}, {0, 0}, 150, 120, options,
                                        {2, Simd::kBest}, observer, &spans);
  for (std::size_t i = 0; i < 2; ++i) {
    for (int row = 0; row < 120; ++row) {
      for (int column = 0; column < 150; ++column) {
        const ColumnSpan span = spans[static_cast<std::size_t>(row)];
        ASSERT_EQ(some.shares[i].at(column, row), column >= span.begin && column < span.end
                                                      ? all.shares[i].at(column, row)
                                                      : map::kVisibilityUnknown);
      }
    }
  }
}

TEST(Visibility, AChangedPatchUpdatesToTheBytesOfAFullRun) {
  const auto seed = static_cast<unsigned>(test::fresh_seed());
  std::mt19937 random(seed);
  raster::Grid<float> ground_m = wild_ground(190, 170, seed);
  raster::Grid<std::uint8_t> weight(ground_m.geometry(), 40);
  for (const bool is_weighted : {false, true}) {
    const VisibilityGround ground{ground_m, ground_m, is_weighted ? &weight : nullptr};
    const VisibilityOptions options{1000.0, 15.24, 60, true, 0.13, {40.0, 100.0, 5.0, 60.0, 30.0}};
    const raster::CellIndex block{20, 15};
    SilentObserver observer;
    VisibilitySums sums;
    auto layers = visibility_of_block(ground, block, 150, 140, options, {1, Simd::kBest}, observer,
                                      nullptr, &sums);
    for (int i = 0; i < 6; ++i) {
      const CellRectangle patch{
          static_cast<int>(random() % 200) - 10, static_cast<int>(random() % 180) - 10,
          1 + static_cast<int>(random() % 32), 1 + static_cast<int>(random() % 32)};
      const raster::Grid<float> ground_before_m = ground_m;
      const raster::Grid<std::uint8_t> weight_before = weight;
      for (int row = std::max(patch.row, 0); row < std::min(patch.row + patch.rows, 170); ++row) {
        for (int column = std::max(patch.column, 0);
             column < std::min(patch.column + patch.columns, 190); ++column) {
          ground_m.at(column, row) =
              random() % 9 == 0 ? kNan : static_cast<float>(random() % 300) - 100.0F;
          weight.at(column, row) = static_cast<std::uint8_t>(random() % (kGroundWeightMax + 1));
        }
      }
      const VisibilityGround before{ground_before_m, ground_before_m,
                                    is_weighted ? &weight_before : nullptr};
      update_visibility_of_block(before, ground, block, patch, options, {2, Simd::kBest}, observer,
                                 layers, sums);
      VisibilitySums all_sums;
      expect_same(layers, visibility_of_block(ground, block, 150, 140, options, {1, Simd::kBest},
                                              observer, nullptr, &all_sums));
      ASSERT_EQ(sums.planes.size(), all_sums.planes.size());
      for (std::size_t plane = 0; plane < sums.planes.size(); ++plane) {
        ASSERT_EQ(sums.planes[plane].values(), all_sums.planes[plane].values()) << plane;
      }
    }
  }
}

TEST(Visibility, UpdatesNeedTheSumsOfTheSameHeights) {
  const raster::Grid<float> flat({0.0, 0.0, 30.0, 40, 40}, 10.0F);
  const VisibilityOptions options{300.0, 15.24, 36, true, 0.13, {50.0}};
  SilentObserver observer;
  VisibilitySums sums;
  auto layers = visibility_of_block({flat, flat}, {0, 0}, 40, 40, options, {1, Simd::kBest},
                                    observer, nullptr, &sums);
  const auto update = [&](VisibilitySums of) {
    update_visibility_of_block({flat, flat}, {flat, flat}, {0, 0}, {3, 3, 2, 2}, options,
                               {1, Simd::kBest}, observer, layers, of);
  };
  EXPECT_NO_THROW(update(sums));
  EXPECT_THROW(update({}), std::invalid_argument);
  sums.planes.pop_back();
  EXPECT_THROW(update(sums), std::invalid_argument);
}

TEST(Visibility, AGreaterHeightNeverHasASmallerShare) {
  const auto seed = static_cast<unsigned>(test::fresh_seed());
  const raster::Grid<float> surface_m = wild_ground(120, 110, seed);
  const std::vector<double> heights_m = {30.0, 60.0, 15.3, 100.0, 150.0, 5.0};
  const auto layers =
      layers_everywhere({surface_m, surface_m}, {1500.0, 15.24, 60, true, 0.13, heights_m});
  const std::vector<std::size_t> upwards = {6, 0, 3, 1, 2, 4, 5};  // 5, 15.24, 15.3, 30, ...
  int greater = 0;
  for (int row = 0; row < 110; ++row) {
    for (int column = 0; column < 120; ++column) {
      for (std::size_t i = 1; i < upwards.size(); ++i) {
        const std::uint16_t low = layers.shares[upwards[i - 1]].at(column, row);
        const std::uint16_t high = layers.shares[upwards[i]].at(column, row);
        ASSERT_GE(high, low) << column << " " << row << " height " << i;
        greater += high > low ? 1 : 0;
      }
    }
  }
  EXPECT_GT(greater, 110 * 120);
}

TEST(Visibility, FurtherHeightsAgreeWithBruteForce) {
  const auto seed = static_cast<unsigned>(test::fresh_seed());
  const raster::Grid<float> surface_m = hills(220, 220, 30.0, seed);
  const std::vector<double> heights_m = {30.0, 60.0, 100.0, 150.0};
  const VisibilityOptions options{3000.0, 15.24, 180, true, 0.13, heights_m};
  std::mt19937 random(seed);
  std::vector<double> sums(heights_m.size(), 0.0);
  constexpr int kCells = 20;
  SilentObserver observer;
  for (int i = 0; i < kCells; ++i) {
    const raster::CellIndex cell{static_cast<int>(100 + random() % 20),
                                 static_cast<int>(100 + random() % 20)};
    const auto layers = visibility_of_block({surface_m, surface_m}, cell, 1, 1, options,
                                            {1, Simd::kBest}, observer);
    for (std::size_t h = 0; h < heights_m.size(); ++h) {
      sums[h] += std::fabs(
          map::visibility_share(layers.shares[h + 1].at(0, 0)) -
          reference_visibility_share({surface_m, surface_m}, cell, heights_m[h], options));
    }
  }
  for (std::size_t h = 0; h < heights_m.size(); ++h) {
    EXPECT_LE(sums[h] / kCells, 0.004) << heights_m[h] << " m";
  }
}

TEST(Visibility, OnASphereTheHorizonEndsWhatIsSeen) {
  // At 1 m over a smooth sphere the horizon is sqrt(2 R h) = 3570 m away: of a disc of 5000 m half
  // is seen, 3570^2 / 5000^2 = 0.51; refraction of 0.13 moves it to 3570 / sqrt(0.87) = 3827 m.
  const raster::Grid<float> level({0.0, 0.0, 50.0, 203, 203}, 0.0F);
  VisibilityOptions options{5000.0, 1.0, 360, true, 0.0, {}};
  const double disc_m2 = 5000.0 * 5000.0;
  EXPECT_NEAR(map::visibility_share(visibility_at(level, {101, 101}, options)),
              2.0 * 6371000.0 / disc_m2, 0.01);
  options.refraction = 0.13;
  EXPECT_NEAR(map::visibility_share(visibility_at(level, {101, 101}, options)),
              2.0 * 6371000.0 / 0.87 / disc_m2, 0.01);
  options.is_earth_curved = false;
  EXPECT_EQ(visibility_at(level, {101, 101}, options), 65534);
}

TEST(Visibility, GroundWithoutWeightDoesNotSeeButStillHides) {
  // West of the eye everything counts, east nothing; a wall in the east hides nothing that counts.
  raster::Grid<float> ground({0.0, 0.0, 30.0, 101, 101}, 0.0F);
  raster::Grid<std::uint8_t> weight(ground.geometry(), 0);
  for (int row = 0; row < 101; ++row) {
    ground.at(60, row) = 500.0F;
    ground.at(30, row) = 500.0F;
    for (int column = 0; column < 50; ++column) {
      weight.at(column, row) = kGroundWeightMax;
    }
  }
  SilentObserver observer;
  const auto layers =
      visibility_of_block({ground, ground, &weight}, {50, 50}, 1, 1, flat_earth(1200.0, 10.0, 360),
                          {1, Simd::kBest}, observer);
  // Of the western half disc with 40 cells radius, the wall at 20 cells hides the segment beyond.
  const double hidden = (std::numbers::pi / 3.0 - std::sqrt(3.0) / 4.0) / (std::numbers::pi / 2.0);
  EXPECT_NEAR(map::visibility_share(layers.shares[0].at(0, 0)), 1.0 - hidden, 0.03);
}

TEST(Visibility, EvenWeightsChangeAlmostNothing) {
  const raster::Grid<float> ground = hills(120, 100, 30.0, 17);
  const raster::Grid<std::uint8_t> half(ground.geometry(), kGroundWeightMax / 2);
  const VisibilityOptions options = flat_earth(1500.0, 15.24, 100);
  const auto plain = layers_everywhere({ground, ground}, options).shares[0];
  const auto weighted = layers_everywhere({ground, ground, &half}, options).shares[0];
  for (std::size_t i = 0; i < plain.values().size(); ++i) {
    EXPECT_NEAR(plain.values()[i], weighted.values()[i], 70.0);  // weights rounded to fewer places
  }
}

TEST(Visibility, CellsNearUnknownGroundCarryAFlag) {
  raster::Grid<float> ground({0.0, 0.0, 30.0, 90, 80}, 100.0F);
  ground.at(45, 40) = kNan;
  ground.at(20, 60) = kNan;
  const double radius_m = 500.0;
  const auto layers = layers_everywhere({ground, ground}, flat_earth(radius_m, 15.24, 16));
  for (int row = 0; row < 80; ++row) {
    for (int column = 0; column < 90; ++column) {
      bool is_partial = false;
      for (int r = row - 20; r <= row + 20; ++r) {
        for (int c = column - 20; c <= column + 20; ++c) {
          const bool is_known =
              ground.geometry().contains(raster::CellIndex{c, r}) && !std::isnan(ground.at(c, r));
          is_partial =
              is_partial || (!is_known && 30.0 * std::hypot(c - column, r - row) <= radius_m);
        }
      }
      ASSERT_EQ(layers.is_partial.at(column, row), is_partial ? 1 : 0) << column << " " << row;
    }
  }
}

TEST(Visibility, UnknownCellsNeitherCountNorHide) {
  raster::Grid<float> flat({0.0, 0.0, 30.0, 61, 61}, 100.0F);
  for (int row = 0; row < 61; ++row) {
    for (int column = 35; column < 40; ++column) {
      flat.at(column, row) = kNan;
    }
  }
  const auto stored = visibility_everywhere(flat, flat_earth(900.0, 15.24, 64));
  EXPECT_EQ(stored.at(30, 30), 65534);
  EXPECT_EQ(stored.at(45, 30), 65534);
  EXPECT_EQ(stored.at(37, 30), map::kVisibilityUnknown);
  raster::Grid<float> lonely({0.0, 0.0, 30.0, 61, 61}, kNan);
  lonely.at(30, 30) = 5.0F;
  EXPECT_EQ(visibility_everywhere(lonely, flat_earth(900.0, 15.24, 64)).at(30, 30),
            map::kVisibilityUnknown);
}

TEST(Visibility, AgreesWithBruteForceBesideUnknownGroundAndTheBorder) {
  raster::Grid<float> surface_m = hills(120, 120, 30.0, 11);
  for (int row = 40; row < 60; ++row) {
    for (int column = 30; column < 50; ++column) {
      surface_m.at(column, row) = kNan;
    }
  }
  const VisibilityOptions options = flat_earth(1500.0, 15.24, 360);
  const auto stored = visibility_everywhere(surface_m, options, 2);
  double sum = 0.0;
  int count = 0;
  for (const raster::CellIndex cell :
       {raster::CellIndex{0, 0}, raster::CellIndex{119, 60}, raster::CellIndex{28, 50},
        raster::CellIndex{52, 45}, raster::CellIndex{60, 119}, raster::CellIndex{40, 63}}) {
    const double share = map::visibility_share(stored.at(cell));
    const double reference =
        reference_visibility_share({surface_m, surface_m}, cell, 15.24, options);
    EXPECT_NEAR(share, reference, 0.012) << cell.column << " " << cell.row;
    sum += std::fabs(share - reference);
    ++count;
  }
  EXPECT_LE(sum / count, 0.004);
}

TEST(Visibility, AHigherEyeSeesMoreAndTransparentThingsHideNothing) {
  const raster::Grid<float> ground = hills(100, 100, 30.0, 5);
  raster::Grid<float> with_line = ground;
  for (int row = 0; row < 100; ++row) {
    with_line.at(50, row) += 45.0F;
  }
  const VisibilityOptions options = flat_earth(1200.0, 15.24, 180);
  const auto plain = layers_everywhere({ground, ground}, options).shares[0];
  const auto beside = layers_everywhere({ground, with_line}, options).shares[0];
  EXPECT_EQ(beside.at(48, 50), plain.at(48, 50));
  EXPECT_EQ(beside.at(52, 20), plain.at(52, 20));
  int higher = 0;
  for (int row = 0; row < 100; ++row) {
    higher += beside.at(50, row) > plain.at(50, row) ? 1 : 0;
  }
  EXPECT_GT(higher, 80);
}

TEST(Visibility, StopsWhenAsked) {
  class Stopper final : public Observer {
   public:
    void progress(std::string_view, double, double) override { ++calls_; }
    void note(std::string_view) override {}
    [[nodiscard]] bool stop_requested() const override { return calls_ >= 2; }

   private:
    std::atomic<int> calls_ = 0;
  } stopper;
  const raster::Grid<float> flat({0.0, 0.0, 30.0, 300, 300}, 1.0F);
  EXPECT_THROW(visibility_of_block({flat, flat}, {0, 0}, 300, 300, flat_earth(900.0, 15.24, 64),
                                   {2, Simd::kBest}, stopper),
               Interrupted);
}

TEST(Visibility, RefusesOptionsThatMakeNoSense) {
  const raster::Grid<float> flat({0.0, 0.0, 30.0, 30, 30}, 1.0F);
  EXPECT_THROW(visibility_everywhere(flat, flat_earth(900.0, 15.24, 63)), std::invalid_argument);
  EXPECT_THROW(visibility_everywhere(flat, flat_earth(10.0, 15.24, 64)), std::invalid_argument);
  EXPECT_THROW(visibility_everywhere(flat, flat_earth(900.0, -1.0, 64)), std::invalid_argument);
  EXPECT_THROW(visibility_everywhere(flat, {900.0, 15.24, 64, true, 1.5, {}}),
               std::invalid_argument);
  EXPECT_THROW(visibility_everywhere(flat, {900.0, 15.24, 64, true, 0.1, {-3.0}}),
               std::invalid_argument);
  SilentObserver observer;
  EXPECT_THROW(visibility_of_block({flat, flat}, {1, 1}, 30, 30, flat_earth(900.0, 15.24, 64),
                                   {1, Simd::kBest}, observer),
               std::invalid_argument);
  const std::vector<ColumnSpan> spans(29);
  EXPECT_THROW(visibility_of_block({flat, flat}, {0, 0}, 30, 30, flat_earth(900.0, 15.24, 64),
                                   {1, Simd::kBest}, observer, &spans),
               std::invalid_argument);
}

}  // namespace
}  // namespace hedgehop::preparation
