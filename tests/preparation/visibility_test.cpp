#include "preparation/visibility.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <gdal_alg.h>
#include <gdal_priv.h>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

#include "base/errors.hpp"
#include "map/map.hpp"

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

raster::Grid<std::uint16_t> visibility_everywhere(const raster::Grid<float>& surface_m,
                                                  const VisibilityOptions& options,
                                                  int threads = 1) {
  SilentObserver observer;
  return visibility_of_block(surface_m, surface_m, {0, 0}, surface_m.columns(), surface_m.rows(),
                             options, threads, observer);
}

TEST(Visibility, FlatGroundIsSeenAltogether) {
  const raster::Grid<float> flat({0.0, 0.0, 30.0, 60, 50}, 321.0F);
  const auto stored = visibility_everywhere(flat, {900.0, 15.24, 64});
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
  const VisibilityOptions options{400.0, 10.0, 720};
  SilentObserver observer;
  const auto stored = visibility_of_block(ground, ground, {50, 50}, 1, 1, options, 1, observer);
  const double hidden = (std::numbers::pi / 3.0 - std::sqrt(3.0) / 4.0) / std::numbers::pi;
  // The wall itself is seen and one cell wide: its row belongs to the seen part.
  EXPECT_NEAR(map::visibility_share(stored.at(0, 0)), 1.0 - hidden, 0.015);
}

TEST(Visibility, AgreesWithBruteForceLinesOfSight) {
  std::random_device device;
  const unsigned seed = device();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const VisibilityOptions options{5000.0, 15.24, 180};
  const raster::Grid<float> surface_m = hills(420, 410, 30.0, seed);
  SilentObserver observer;
  std::vector<double> errors;
  for (int i = 0; i < 40; ++i) {
    const raster::CellIndex cell{static_cast<int>(random() % 240),
                                 static_cast<int>(random() % 220)};
    const auto stored = visibility_of_block(surface_m, surface_m, cell, 1, 1, options, 1, observer);
    errors.push_back(std::fabs(map::visibility_share(stored.at(0, 0)) -
                               reference_visibility_share(surface_m, surface_m, cell, options)));
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
  SilentObserver observer;
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
    const auto stored =
        visibility_of_block(surface_m, surface_m, cell, 1, 1, {radius_m, 15.24, 180}, 1, observer);
    const double share = map::visibility_share(stored.at(0, 0));
    const double gdal_share = static_cast<double>(seen) / static_cast<double>(seen + hidden);
    EXPECT_NEAR(share, gdal_share, 0.02);
    sum += share - gdal_share;
    ++count;
  }
  EXPECT_NEAR(sum / count, 0.0, 0.008);
  GDALClose(dataset);
}

TEST(Visibility, TurningTheGroundTurnsTheResult) {
  const raster::Grid<float> surface_m = hills(70, 70, 30.0, 7);
  raster::Grid<float> turned(surface_m.geometry(), 0.0F);
  for (int row = 0; row < 70; ++row) {
    for (int column = 0; column < 70; ++column) {
      turned.at(69 - row, column) = surface_m.at(column, row);  // a quarter turn to the left
    }
  }
  const VisibilityOptions options{900.0, 15.24, 180};
  const auto stored = visibility_everywhere(surface_m, options);
  const auto stored_turned = visibility_everywhere(turned, options);
  for (int row = 0; row < 70; ++row) {
    for (int column = 0; column < 70; ++column) {
      // Interpolation weights f and 1 - f swap, so that the last bit of a height may differ.
      EXPECT_NEAR(stored_turned.at(69 - row, column), stored.at(column, row), 65.0);
    }
  }
}

TEST(Visibility, NeitherThreadsNorTheBlockChangeAByte) {
  raster::Grid<float> surface_m = hills(190, 150, 30.0, 3);
  surface_m.at(60, 60) = kNan;
  const VisibilityOptions options{1500.0, 15.24, 180};
  const auto one = visibility_everywhere(surface_m, options, 1);
  EXPECT_EQ(visibility_everywhere(surface_m, options, 2).values(), one.values());
  EXPECT_EQ(visibility_everywhere(surface_m, options, 7).values(), one.values());
  SilentObserver observer;
  const auto block =
      visibility_of_block(surface_m, surface_m, {37, 51}, 91, 33, options, 3, observer);
  for (int row = 0; row < 33; ++row) {
    for (int column = 0; column < 91; ++column) {
      ASSERT_EQ(block.at(column, row), one.at(37 + column, 51 + row));
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
  const auto stored = visibility_everywhere(flat, {900.0, 15.24, 64});
  EXPECT_EQ(stored.at(30, 30), 65534);
  EXPECT_EQ(stored.at(45, 30), 65534);
  EXPECT_EQ(stored.at(37, 30), map::kVisibilityUnknown);
  raster::Grid<float> lonely({0.0, 0.0, 30.0, 61, 61}, kNan);
  lonely.at(30, 30) = 5.0F;
  EXPECT_EQ(visibility_everywhere(lonely, {900.0, 15.24, 64}).at(30, 30), map::kVisibilityUnknown);
}

TEST(Visibility, AgreesWithBruteForceBesideUnknownGroundAndTheBorder) {
  raster::Grid<float> surface_m = hills(120, 120, 30.0, 11);
  for (int row = 40; row < 60; ++row) {
    for (int column = 30; column < 50; ++column) {
      surface_m.at(column, row) = kNan;
    }
  }
  const VisibilityOptions options{1500.0, 15.24, 360};
  const auto stored = visibility_everywhere(surface_m, options, 2);
  double sum = 0.0;
  int count = 0;
  for (const raster::CellIndex cell :
       {raster::CellIndex{0, 0}, raster::CellIndex{119, 60}, raster::CellIndex{28, 50},
        raster::CellIndex{52, 45}, raster::CellIndex{60, 119}, raster::CellIndex{40, 63}}) {
    const double share = map::visibility_share(stored.at(cell));
    const double reference = reference_visibility_share(surface_m, surface_m, cell, options);
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
  const VisibilityOptions options{1200.0, 15.24, 180};
  SilentObserver observer;
  const auto plain = visibility_of_block(ground, ground, {0, 0}, 100, 100, options, 2, observer);
  const auto beside =
      visibility_of_block(ground, with_line, {0, 0}, 100, 100, options, 2, observer);
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
  EXPECT_THROW(visibility_of_block(flat, flat, {0, 0}, 300, 300, {900.0, 15.24, 64}, 2, stopper),
               Interrupted);
}

TEST(Visibility, RefusesOptionsThatMakeNoSense) {
  const raster::Grid<float> flat({0.0, 0.0, 30.0, 30, 30}, 1.0F);
  EXPECT_THROW(visibility_everywhere(flat, {900.0, 15.24, 63}), std::invalid_argument);
  EXPECT_THROW(visibility_everywhere(flat, {10.0, 15.24, 64}), std::invalid_argument);
  EXPECT_THROW(visibility_everywhere(flat, {900.0, -1.0, 64}), std::invalid_argument);
  SilentObserver observer;
  EXPECT_THROW(visibility_of_block(flat, flat, {1, 1}, 30, 30, {900.0, 15.24, 64}, 1, observer),
               std::invalid_argument);
}

}  // namespace
}  // namespace hedgehop::preparation
