#include "raster/grid.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <random>

namespace hedgehop::raster {
namespace {

const GridGeometry kGeometry{1000.0, 2000.0, 10.0, 12, 9};

Grid<float> plane(double slope_x, double slope_y) {
  Grid<float> grid(kGeometry, 0.0F);
  for (int row = 0; row < grid.rows(); ++row) {
    for (int column = 0; column < grid.columns(); ++column) {
      const geo::MapPoint centre = kGeometry.centre({column, row});
      grid.at(column, row) =
          static_cast<float>(slope_x * (centre.x_m - 1000.0) + slope_y * (centre.y_m - 2000.0));
    }
  }
  return grid;
}

TEST(GridGeometry, CellsHoldTheirSouthWesternEdgesOnly) {
  EXPECT_EQ(kGeometry.cell_at({1000.0, 2000.0}), (CellIndex{0, 0}));
  EXPECT_EQ(kGeometry.cell_at({1010.0, 2009.999}), (CellIndex{1, 0}));
  EXPECT_EQ(kGeometry.cell_at({999.999, 2000.0}), (CellIndex{-1, 0}));
  EXPECT_TRUE(kGeometry.contains(geo::MapPoint{1000.0, 2000.0}));
  EXPECT_FALSE(kGeometry.contains(geo::MapPoint{1120.0, 2000.0}));
  EXPECT_EQ(kGeometry.centre({11, 8}).x_m, 1115.0);
  EXPECT_EQ(kGeometry.centre({11, 8}).y_m, 2085.0);
}

TEST(SampleBilinear, ReproducesAPlaneBetweenTheOutermostCentres) {
  const Grid<float> grid = plane(0.25, -0.5);
  std::random_device device;
  const unsigned seed = device();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> x_m(1005.0, 1115.0);
  std::uniform_real_distribution<double> y_m(2005.0, 2085.0);
  for (int i = 0; i < 500; ++i) {
    const geo::MapPoint point{x_m(random), y_m(random)};
    EXPECT_NEAR(sample_bilinear(grid, point),
                0.25 * (point.x_m - 1000.0) - 0.5 * (point.y_m - 2000.0), 1e-9);
  }
}

TEST(SampleBilinear, IsConstantBeyondTheOutermostCentresAndUnknownOutside) {
  const Grid<float> grid = plane(1.0, 0.0);
  EXPECT_EQ(sample_bilinear(grid, {1000.0, 2050.0}), 5.0);
  EXPECT_EQ(sample_bilinear(grid, {1119.999, 2050.0}), 115.0);
  EXPECT_TRUE(std::isnan(sample_bilinear(grid, {1120.0, 2050.0})));
  EXPECT_TRUE(std::isnan(sample_bilinear(grid, {1050.0, 1999.999})));
}

TEST(SampleBilinear, AnUnknownCellSpoilsWhatItTakesPartIn) {
  Grid<float> grid = plane(0.0, 0.0);
  grid.at(5, 4) = std::numeric_limits<float>::quiet_NaN();
  EXPECT_TRUE(std::isnan(sample_bilinear(grid, {1055.0, 2045.0})));
  EXPECT_TRUE(std::isnan(sample_bilinear(grid, {1064.9, 2045.0})));
  EXPECT_EQ(sample_bilinear(grid, {1065.0, 2045.0}), 0.0);
}

TEST(MaxWithin, TakesEveryCellWhoseAreaTheDiscTouches) {
  Grid<float> grid = plane(0.0, 0.0);
  grid.at(8, 4) = 50.0F;  // its area begins 25 m east and 0 m north of (1055, 2045)
  EXPECT_EQ(max_within(grid, {1055.0, 2045.0}, 24.9), 0.0);
  EXPECT_EQ(max_within(grid, {1055.0, 2045.0}, 25.1), 50.0);
  grid.at(8, 4) = 0.0F;
  grid.at(7, 6) = 50.0F;  // nearest corner 15 m east, 15 m north: 21.2 m away
  EXPECT_EQ(max_within(grid, {1055.0, 2045.0}, 21.0), 0.0);
  EXPECT_EQ(max_within(grid, {1055.0, 2045.0}, 21.5), 50.0);
}

TEST(MaxWithin, UnknownOrOutsideIsUnknown) {
  Grid<float> grid = plane(0.0, 0.0);
  EXPECT_TRUE(std::isnan(max_within(grid, {1005.0, 2045.0}, 6.0)));
  EXPECT_EQ(max_within(grid, {1005.0, 2045.0}, 4.0), 0.0);
  grid.at(5, 4) = std::numeric_limits<float>::quiet_NaN();
  EXPECT_TRUE(std::isnan(max_within(grid, {1075.0, 2045.0}, 16.0)));
}

}  // namespace
}  // namespace hedgehop::raster
