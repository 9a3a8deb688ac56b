#include "verification/surface_sweep.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <random>

#include "support/fresh_seed.hpp"

namespace hedgehop::verification {
namespace {

const float kVoid = std::numeric_limits<float>::quiet_NaN();

raster::Grid<float> random_grid(std::mt19937_64& random, int columns, int rows, double cell_m) {
  raster::Grid<float> grid({-40.0, 25.0, cell_m, columns, rows}, 0.0F);
  for (float& value : grid.values()) {
    value = std::uniform_real_distribution<float>(0.0F, 60.0F)(random);
  }
  return grid;
}

PathPoint random_point(std::mt19937_64& random, const raster::GridGeometry& geometry) {
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  return {uniform(geometry.west_m, geometry.east_m()),
          uniform(geometry.south_m, geometry.north_m()), uniform(50.0, 90.0)};
}

TEST(InterpolatedHeight, AgreesWithTheRastersOwnInterpolationEverywhere) {
  std::mt19937_64 random(test::fresh_seed());
  raster::Grid<float> grid = random_grid(random, 9, 7, 10.0);
  grid.at(3, 4) = kVoid;
  grid.at(8, 6) = kVoid;
  for (int i = 0; i < 20000; ++i) {
    const geo::MapPoint point{std::uniform_real_distribution<double>(-60.0, 70.0)(random),
                              std::uniform_real_distribution<double>(5.0, 115.0)(random)};
    const double expected_m = raster::sample_bilinear(grid, point);
    const double found_m = interpolated_height_m(grid, point);
    ASSERT_EQ(std::isnan(found_m), std::isnan(expected_m)) << point.x_m << " " << point.y_m;
    if (!std::isnan(expected_m)) {
      ASSERT_NEAR(found_m, expected_m, 1e-9);
    }
  }
}

TEST(InterpolatedHeight, TakesNoNotesOfAVoidThatHasNoWeight) {
  raster::Grid<float> grid({0.0, 0.0, 10.0, 3, 3}, 7.0F);
  grid.at(1, 2) = kVoid;
  EXPECT_EQ(interpolated_height_m(grid, {12.0, 15.0}), 7.0);
  EXPECT_TRUE(std::isnan(interpolated_height_m(grid, {12.0, 15.1})));
}

TEST(SweepSurface, FindsTheSaddleThatTheEndsOfTheChordDoNotShow) {
  // One patch with opposite corners 40 m high: on the diagonal between the high corners of the
  // neighbours the surface is h = 40 (u (1-v) + v (1-u)). Along u = v = s that is 80 s (1-s): 20 m
  // in the middle, 0 at both ends.
  raster::Grid<float> grid({-5.0, -5.0, 10.0, 2, 2}, 0.0F);
  grid.at(1, 0) = 40.0F;
  grid.at(0, 1) = 40.0F;
  const Sweep sweep = sweep_surface(grid, {0.0, 0.0, 50.0}, {10.0, 10.0, 50.0}, 35.0);
  EXPECT_NEAR(sweep.clearance_min_m, 30.0, 1e-12);
  EXPECT_NEAR(sweep.clearance_min_at, 0.5, 1e-12);
  // Height 50 - 80 s (1-s) is at most 35 where s (1-s) >= 15/80: s in [0.25, 0.75].
  EXPECT_NEAR(sweep.share_low, 0.5, 1e-12);
}

TEST(SweepSurface, AgreesWithBruteForceSamplingOverRandomGrids) {
  std::mt19937_64 random(test::fresh_seed());
  for (int round = 0; round < 60; ++round) {
    const raster::Grid<float> grid = random_grid(random, 12, 9, 10.0);
    const PathPoint from = random_point(random, grid.geometry());
    const PathPoint to = random_point(random, grid.geometry());
    constexpr double kLow_m = 30.0;
    const Sweep sweep = sweep_surface(grid, from, to, kLow_m);
    const double length_m = std::sqrt((to.x_m - from.x_m) * (to.x_m - from.x_m) +
                                      (to.y_m - from.y_m) * (to.y_m - from.y_m));
    constexpr int kSamples = 20000;
    double least_m = 1e9;
    int low = 0;
    for (int i = 0; i <= kSamples; ++i) {
      const double t = static_cast<double>(i) / kSamples;
      const geo::MapPoint point{from.x_m + t * (to.x_m - from.x_m),
                                from.y_m + t * (to.y_m - from.y_m)};
      const double height_m = from.altitude_m + t * (to.altitude_m - from.altitude_m) -
                              raster::sample_bilinear(grid, point);
      least_m = std::min(least_m, height_m);
      low += height_m <= kLow_m ? 1 : 0;
      // A sample is never below the least clearance.
      ASSERT_GE(height_m, sweep.clearance_min_m - 1e-9);
    }
    // Between samples the height changes by at most the steepest slope, 60 sqrt(2) m over a cell.
    const double slope = 60.0 * std::sqrt(2.0) / 10.0;
    EXPECT_NEAR(sweep.clearance_min_m, least_m, (slope * length_m + 40.0) / kSamples);
    EXPECT_NEAR(sweep.share_low, static_cast<double>(low) / kSamples, 30.0 / kSamples);
    const double t = sweep.clearance_min_at;
    EXPECT_NEAR(from.altitude_m + t * (to.altitude_m - from.altitude_m) -
                    raster::sample_bilinear(grid, {from.x_m + t * (to.x_m - from.x_m),
                                                   from.y_m + t * (to.y_m - from.y_m)}),
                sweep.clearance_min_m, 1e-9);
    EXPECT_TRUE(std::isnan(sweep.unknown_at));
    EXPECT_TRUE(std::isnan(sweep.outside_at));
  }
}

TEST(SweepSurface, HalfMetreSamplesOfAShortStepNeverLieBelowTheClosedForm) {
  std::mt19937_64 random(test::fresh_seed());
  const raster::Grid<float> grid = random_grid(random, 40, 40, 10.0);
  for (int round = 0; round < 5000; ++round) {
    const PathPoint from = random_point(random, grid.geometry());
    const double azimuth_rad = std::uniform_real_distribution<double>(0.0, 6.3)(random);
    const PathPoint to{from.x_m + 2.0 * std::sin(azimuth_rad),
                       from.y_m + 2.0 * std::cos(azimuth_rad),
                       from.altitude_m + std::uniform_real_distribution<double>(-0.4, 0.4)(random)};
    const Sweep sweep = sweep_surface(grid, from, to, 30.0);
    double least_m = 1e9;
    for (int i = 0; i <= 4; ++i) {
      const double t = 0.25 * i;
      const double surface_m = raster::sample_bilinear(
          grid, {from.x_m + t * (to.x_m - from.x_m), from.y_m + t * (to.y_m - from.y_m)});
      if (!std::isnan(surface_m)) {
        least_m =
            std::min(least_m, from.altitude_m + t * (to.altitude_m - from.altitude_m) - surface_m);
      }
    }
    ASSERT_LE(sweep.clearance_min_m, least_m + 1e-9);
    // A sample distance (at the map's edge, else half of it) times the slope of path and patch.
    ASSERT_GE(sweep.clearance_min_m, least_m - 0.5 * (0.2 + sweep.gradient_max) - 1e-9);
  }
}

TEST(SweepSurface, GradientBoundsTheSlopeMetOnTheWay) {
  std::mt19937_64 random(test::fresh_seed());
  const raster::Grid<float> grid = random_grid(random, 12, 12, 10.0);
  for (int round = 0; round < 200; ++round) {
    const PathPoint from = random_point(random, grid.geometry());
    const PathPoint to = random_point(random, grid.geometry());
    const Sweep sweep = sweep_surface(grid, from, to, 0.0);
    for (int i = 0; i < 50; ++i) {
      const double t = std::uniform_real_distribution<double>(0.0, 1.0)(random);
      const geo::MapPoint on{from.x_m + t * (to.x_m - from.x_m),
                             from.y_m + t * (to.y_m - from.y_m)};
      const double azimuth_rad = std::uniform_real_distribution<double>(0.0, 6.3)(random);
      const geo::MapPoint beside{on.x_m + 9.9 * std::sin(azimuth_rad),
                                 on.y_m + 9.9 * std::cos(azimuth_rad)};
      const double rise_m =
          std::fabs(raster::sample_bilinear(grid, beside) - raster::sample_bilinear(grid, on));
      if (!std::isnan(rise_m)) {
        ASSERT_LE(rise_m, 9.9 * sweep.gradient_max + 1e-9);
      }
    }
  }
}

TEST(SweepSurface, NamesTheFirstPlaceOverAVoid) {
  raster::Grid<float> grid({0.0, 0.0, 10.0, 10, 3}, 0.0F);
  grid.at(6, 1) = kVoid;
  // Centre 6 lies at x = 65: patches 5 (from x = 55) and 6 have it as a corner.
  const Sweep sweep = sweep_surface(grid, {5.0, 12.0, 20.0}, {95.0, 12.0, 20.0}, 30.0);
  EXPECT_NEAR(5.0 + sweep.unknown_at * 90.0, 55.0, 1e-9);
  EXPECT_NEAR(sweep.clearance_min_m, 20.0, 1e-12);
  EXPECT_NEAR(sweep.share_low, 70.0 / 90.0, 1e-12);
}

TEST(SweepSurface, NamesTheFirstPlaceOutsideTheRaster) {
  const raster::Grid<float> grid({0.0, 0.0, 10.0, 10, 10}, 3.0F);
  const Sweep leaves = sweep_surface(grid, {50.0, 50.0, 20.0}, {150.0, 50.0, 20.0}, 30.0);
  EXPECT_NEAR(leaves.outside_at, 0.5, 1e-12);
  EXPECT_NEAR(leaves.clearance_min_m, 17.0, 1e-12);
  const Sweep corner = sweep_surface(grid, {-10.0, 5.0, 20.0}, {5.0, -10.0, 20.0}, 30.0);
  EXPECT_EQ(corner.outside_at, 0.0);
  EXPECT_TRUE(std::isnan(corner.clearance_min_m));
}

TEST(SweepSurface, IsFlatBeyondTheOutermostCentres) {
  raster::Grid<float> grid({0.0, 0.0, 10.0, 2, 2}, 0.0F);
  grid.at(1, 1) = 8.0F;
  const Sweep sweep = sweep_surface(grid, {15.5, 15.5, 20.0}, {19.9, 19.9, 20.0}, 30.0);
  EXPECT_NEAR(sweep.clearance_min_m, 12.0, 1e-12);
}

TEST(SweepSurface, MeasuresAPieceThatStandsStill) {
  const raster::Grid<float> grid({0.0, 0.0, 10.0, 4, 4}, 5.0F);
  const Sweep sweep = sweep_surface(grid, {15.0, 15.0, 20.0}, {15.0, 15.0, 18.0}, 30.0);
  EXPECT_NEAR(sweep.clearance_min_m, 13.0, 1e-12);
}

TEST(SweepSurface, WorksOnARasterOfOneCell) {
  const raster::Grid<float> grid({0.0, 0.0, 10.0, 1, 1}, 5.0F);
  const Sweep sweep = sweep_surface(grid, {1.0, 1.0, 20.0}, {9.0, 9.0, 18.0}, 14.0);
  EXPECT_NEAR(sweep.clearance_min_m, 13.0, 1e-12);
  EXPECT_NEAR(sweep.share_low, 0.5, 1e-12);
}

}  // namespace
}  // namespace hedgehop::verification
