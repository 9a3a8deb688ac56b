#include "preparation/threat_layer.hpp"

#include <algorithm>
#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "support/fractal_terrain.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::preparation {
namespace {

raster::Grid<float> seen_from(const raster::Grid<float>& ground_m, const geo::MapPoint& place,
                              double mast_m, double range_m, double drop_1pm = 0.0,
                              int threads = 1) {
  SilentObserver observer;
  return lowest_seen_height({ground_m, ground_m}, ground_m, place, mast_m, range_m, drop_1pm,
                            threads, observer);
}

TEST(ThreatLayer, BehindAWallTheShadowGrowsWithDistance) {
  // Eye 10 m up at column 10, a 30 m wall at column 20: the line over it rises by 20 m in 300 m.
  raster::Grid<float> ground({0.0, 0.0, 30.0, 60, 41}, 0.0F);
  for (int row = 0; row < 41; ++row) {
    ground.at(20, row) = 30.0F;
  }
  const auto seen = seen_from(ground, ground.geometry().centre({10, 20}), 10.0, 1200.0);
  EXPECT_EQ(seen.at(15, 20), 0.0F);
  EXPECT_EQ(seen.at(20, 20), 0.0F);
  for (const int column : {21, 30, 45}) {
    EXPECT_NEAR(seen.at(column, 20), 10.0 + 20.0 * (column - 10) / 10.0, 1e-3);
  }
  EXPECT_TRUE(std::isnan(seen.at(51, 20)));  // 1230 m away
  EXPECT_EQ(seen.at(10, 20), 0.0F);
}

TEST(ThreatLayer, BeyondTheHorizonHeightGrowsWithTheSquareOfTheDistance) {
  // Over a smooth sphere an eye of height h sees to sqrt(h / drop), and beyond it what is higher
  // than drop (d - sqrt(h / drop))^2.
  const raster::Grid<float> ground({0.0, 0.0, 50.0, 300, 5}, 0.0F);
  const double drop_1pm = 1.0 / (2.0 * 6371000.0);
  const auto seen = seen_from(ground, ground.geometry().centre({0, 2}), 4.0, 20000.0, drop_1pm);
  const double horizon_m = std::sqrt(4.0 / drop_1pm);
  EXPECT_EQ(seen.at(140, 2), 0.0F);  // 7000 m; horizon at 7139 m
  for (const int column : {170, 220, 299}) {
    const double beyond_m = 50.0 * column - horizon_m;
    EXPECT_NEAR(seen.at(column, 2), drop_1pm * beyond_m * beyond_m, 0.01);
  }
}

TEST(ThreatLayer, AgreesWithBruteForceFromAnyPlace) {
  const std::uint64_t seed = test::fresh_seed();
  const test::FractalTerrain terrain(seed, 1500.0, 400.0);
  raster::Grid<float> ground({1000.0, 2000.0, 30.0, 90, 80}, 0.0F);
  for (int row = 0; row < 80; ++row) {
    for (int column = 0; column < 90; ++column) {
      const geo::MapPoint centre = ground.geometry().centre({column, row});
      ground.at(column, row) = static_cast<float>(terrain(centre.x_m, centre.y_m));
    }
  }
  std::mt19937_64 random(seed);
  const geo::MapPoint place{1000.0 + 30.0 * (20.0 + 1e-3 * static_cast<double>(random() % 40000)),
                            2000.0 + 30.0 * (20.0 + 1e-3 * static_cast<double>(random() % 40000))};
  const double drop_1pm = 0.87 / (2.0 * 6371000.0);
  const auto seen = seen_from(ground, place, 12.0, 1e5, drop_1pm);
  const double eye_m = static_cast<double>(ground.at(ground.geometry().cell_at(place))) + 12.0;
  // A height is seen if no point of the straight line, at crossings with the rows or columns
  // through cell centres, lies below the ground there; tested just above and just below.
  const auto is_seen = [&](raster::CellIndex cell, double height_m) {
    const geo::MapPoint target = ground.geometry().centre(cell);
    const double dx_m = target.x_m - place.x_m;
    const double dy_m = target.y_m - place.y_m;
    const double distance_m = std::hypot(dx_m, dy_m);
    const bool is_along_x = std::fabs(dx_m) >= std::fabs(dy_m);
    const double top_m =
        static_cast<double>(ground.at(cell)) + height_m - drop_1pm * distance_m * distance_m;
    for (int k = 0; k < (is_along_x ? 90 : 80); ++k) {
      const geo::MapPoint line =
          ground.geometry().centre(is_along_x ? raster::CellIndex{k, 0} : raster::CellIndex{0, k});
      const double t = is_along_x ? (line.x_m - place.x_m) / dx_m : (line.y_m - place.y_m) / dy_m;
      if (!(t > 1e-9 && t < 1.0 - 1e-9)) {
        continue;
      }
      const geo::MapPoint here{place.x_m + t * dx_m, place.y_m + t * dy_m};
      const double d_m = t * distance_m;
      const double z_m = raster::sample_bilinear(ground, here) - drop_1pm * d_m * d_m;
      if (eye_m + t * (top_m - eye_m) < z_m) {
        return false;
      }
    }
    return true;
  };
  int hidden = 0;
  for (int i = 0; i < 400; ++i) {
    const raster::CellIndex cell{static_cast<int>(random() % 90), static_cast<int>(random() % 80)};
    const double lowest_m = static_cast<double>(seen.at(cell));
    EXPECT_TRUE(is_seen(cell, lowest_m + 0.01)) << cell.column << " " << cell.row;
    if (lowest_m > 0.02) {
      ++hidden;
      EXPECT_FALSE(is_seen(cell, lowest_m - 0.01)) << cell.column << " " << cell.row;
    }
  }
  EXPECT_GT(hidden, 20);
  EXPECT_EQ(seen_from(ground, place, 12.0, 1e5, drop_1pm, 3).values(), seen.values());
}

TEST(ThreatLayer, AnObserverOnUnknownGroundSeesNothing) {
  raster::Grid<float> ground({0.0, 0.0, 30.0, 20, 20}, 100.0F);
  ground.at(10, 10) = std::numeric_limits<float>::quiet_NaN();
  for (const geo::MapPoint& place : {geo::MapPoint{310.0, 310.0}, geo::MapPoint{-5.0, 50.0}}) {
    const auto nothing = seen_from(ground, place, 5.0, 500.0);
    EXPECT_TRUE(std::all_of(nothing.values().begin(), nothing.values().end(),
                            [](float lowest_m) { return std::isnan(lowest_m); }));
  }
  const auto seen = seen_from(ground, ground.geometry().centre({3, 10}), 5.0, 900.0);
  EXPECT_TRUE(std::isnan(seen.at(10, 10)));
  EXPECT_EQ(seen.at(15, 10), 0.0F);  // unknown ground hides nothing
}

TEST(NamedObservers, AreReadInDegreesAndRefusedWithTheirLine) {
  auto reader = ConfigReader::from_text(
      "observers:\n"
      "  - {name: a, latitude_deg: 45, longitude_deg: -90, mast_height_m: 3, range_m: 4000}\n",
      "o.yaml");
  const auto observers = read_named_observers(reader);
  ASSERT_EQ(observers.size(), 1U);
  EXPECT_NEAR(observers[0].position.latitude_rad, radians_from_degrees(45.0), 1e-15);
  EXPECT_NEAR(observers[0].position.longitude_rad, radians_from_degrees(-90.0), 1e-15);
  for (const char* bad :
       {"{name: '', latitude_deg: 45, longitude_deg: 9, mast_height_m: 3, range_m: 4000}",
        "{name: b, latitude_deg: 95, longitude_deg: 9, mast_height_m: 3, range_m: 4000}",
        "{name: b, latitude_deg: 45, longitude_deg: 190, mast_height_m: 3, range_m: 4000}",
        "{name: b, latitude_deg: 45, longitude_deg: 9, mast_height_m: -3, range_m: 4000}",
        "{name: b, latitude_deg: 45, longitude_deg: 9, mast_height_m: 3, range_m: 0}",
        "{name: b, latitude_deg: 45, longitude_deg: 9, mast_height_m: 3}"}) {
    auto refused = ConfigReader::from_text(std::string("observers:\n  - ") + bad + "\n", "o.yaml");
    try {
      (void)read_named_observers(refused);
      ADD_FAILURE() << "accepted " << bad;
    } catch (const ConfigError& error) {
      EXPECT_THAT(error.what(), testing::HasSubstr("o.yaml:2")) << bad;
    }
  }
}

}  // namespace
}  // namespace hedgehop::preparation
