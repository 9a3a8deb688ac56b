#include "geo/geodetic_tiles.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <random>

#include "support/fresh_seed.hpp"

namespace hedgehop::geo {
namespace {

constexpr double kRadius_m = 6378137.0;

// Mercator of a sphere, whose inverse has a closed form.
GeodeticTiles::Angles mercator(double x_m, double y_m) {
  return {std::atan(std::sinh(y_m / kRadius_m)), x_m / kRadius_m};
}

TEST(GeodeticTiles, MissASmoothProjectionByLessThanTheyPromiseAndAskItOncePerSquare) {
  std::mt19937_64 random(test::fresh_seed());
  std::uniform_real_distribution<double> offset_m(0.0, 6000.0);
  int questions = 0;
  GeodeticTiles tiles;
  for (int i = 0; i < 5000; ++i) {
    const double x_m = 1234000.0 + offset_m(random);
    const double y_m = 6000000.0 + offset_m(random);
    const auto angles = tiles.at(x_m, y_m, [&](double at_x_m, double at_y_m) {
      ++questions;
      return std::optional(mercator(at_x_m, at_y_m));
    });
    ASSERT_TRUE(angles);
    const GeodeticTiles::Angles expected = mercator(x_m, y_m);
    ASSERT_NEAR(angles->latitude_rad, expected.latitude_rad, GeodeticTiles::kError_rad);
    ASSERT_NEAR(angles->longitude_rad, expected.longitude_rad, GeodeticTiles::kError_rad);
  }
  EXPECT_EQ(questions, 21 * 9) << "9 squares of 2 km: 16 nodes and 5 places to test each";
}

TEST(GeodeticTiles, HaveNoAnswerOverASeamOrWhereTheProjectionHasNone) {
  GeodeticTiles tiles;
  const double seam_m = 501000.0;  // in the middle of a square
  const auto with_seam = [&](double x_m, double y_m) {
    GeodeticTiles::Angles angles = mercator(x_m, y_m);
    angles.longitude_rad -= x_m > seam_m ? 2.0 * std::acos(-1.0) : 0.0;
    return std::optional(angles);
  };
  EXPECT_FALSE(tiles.at(seam_m - 300.0, 1000.0, with_seam));
  EXPECT_FALSE(tiles.at(seam_m + 300.0, 1000.0, with_seam));
  EXPECT_TRUE(tiles.at(seam_m + 1500.0, 1000.0, with_seam));

  GeodeticTiles beside_a_hole;
  const auto with_hole = [&](double x_m, double y_m) {
    return x_m > 2500.0 ? std::nullopt : std::optional(mercator(x_m, y_m));
  };
  EXPECT_FALSE(beside_a_hole.at(2100.0, 0.0, with_hole));
  EXPECT_TRUE(beside_a_hole.at(1900.0, 0.0, with_hole));
  EXPECT_FALSE(beside_a_hole.at(3e8, 0.0, with_hole));
  EXPECT_FALSE(beside_a_hole.at(std::nan(""), 0.0, with_hole));
}

}  // namespace
}  // namespace hedgehop::geo
