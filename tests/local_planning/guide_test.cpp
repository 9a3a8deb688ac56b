#include "local_planning/guide.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "support/fresh_seed.hpp"

namespace hedgehop::local_planning {
namespace {

TEST(Guide, PlacesAndSlopesFollowTheLegs) {
  const Guide guide({{0, 0, 100}, {100, 0, 110}, {100, 50, 100}});
  EXPECT_DOUBLE_EQ(guide.length_m(), 150.0);
  EXPECT_EQ(guide.at(50.0), (flight::Waypoint{50, 0, 105}));
  EXPECT_EQ(guide.at(125.0), (flight::Waypoint{100, 25, 105}));
  EXPECT_EQ(guide.at(-5.0), (flight::Waypoint{0, 0, 100}));
  EXPECT_EQ(guide.at(1e9), (flight::Waypoint{100, 50, 100}));
  EXPECT_DOUBLE_EQ(guide.slope(10.0), 0.1);
  EXPECT_DOUBLE_EQ(guide.slope(149.0), -0.2);
  EXPECT_NEAR(guide.heading_math_rad(120.0), 0.5 * std::numbers::pi, 1e-15);
}

TEST(Guide, NearestPlaceIsProjectedOntoTheLeg) {
  const Guide guide({{0, 0, 0}, {100, 0, 0}, {100, 100, 0}});
  EXPECT_DOUBLE_EQ(guide.project({30, 20}, 0, 200), 30.0);
  EXPECT_DOUBLE_EQ(guide.project({130, 60}, 0, 200), 160.0);
  EXPECT_DOUBLE_EQ(guide.project({120, -30}, 0, 200), 100.0);
  EXPECT_DOUBLE_EQ(guide.project({-50, 5}, 0, 200), 0.0);
}

TEST(Guide, ProjectionDoesNotJumpToANeighbouringLeg) {
  // Out and back, 40 m apart; the helicopter has drifted 30 m towards the way back.
  const Guide guide({{0, 0, 0}, {1000, 0, 0}, {1000, 40, 0}, {0, 40, 0}});
  EXPECT_DOUBLE_EQ(guide.project({200, 30}, 50, 700), 200.0);
  EXPECT_DOUBLE_EQ(guide.project({200, 30}, 1200, 2000), 1840.0);
  EXPECT_DOUBLE_EQ(guide.project({200, 30}, 250, 700), 250.0) << "held within the window";
}

TEST(Guide, ProjectionIsTheSameFromAnyGuess) {
  std::mt19937_64 random(test::fresh_seed());
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (int trial = 0; trial < 200; ++trial) {
    // Legs of all lengths that turn back and cross each other, now and then on whole metres, where
    // two places are equally near.
    const bool is_whole = trial % 4 == 0;
    std::vector<flight::Waypoint> points;
    double x_m = 5e5;
    double y_m = 5e6;
    for (int i = 0; i < 40; ++i) {
      points.push_back({x_m, y_m, 0.0});
      const double reach_m = uniform(1.0, 150.0);
      x_m += is_whole ? std::round(uniform(-3.0, 3.0)) * 10.0 : uniform(-reach_m, reach_m);
      y_m += is_whole ? std::round(uniform(-3.0, 3.0)) * 10.0 : uniform(-reach_m, reach_m);
    }
    const Guide guide(points);
    for (int i = 0; i < 50; ++i) {
      const flight::Waypoint near = points[random() % points.size()];
      const geo::MapPoint point{near.x_m + std::round(uniform(-40.0, 40.0)),
                                near.y_m + std::round(uniform(-40.0, 40.0))};
      const double from_m = uniform(-100.0, guide.length_m());
      const double to_m = from_m + uniform(0.0, 800.0);
      EXPECT_EQ(guide.project(point, from_m, to_m, uniform(from_m, to_m)),
                guide.project(point, from_m, to_m));
    }
  }
}

TEST(Guide, RepeatedPlacesAreMerged) {
  const Guide guide({{0, 0, 10}, {0, 0, 20}, {100, 0, 30}});
  EXPECT_DOUBLE_EQ(guide.length_m(), 100.0);
  EXPECT_DOUBLE_EQ(guide.at(0.0).altitude_m, 20.0);
  EXPECT_DOUBLE_EQ(guide.slope(0.0), 0.1);
}

TEST(Guide, GuidesWithoutExtentOrWithUnknownPlacesAreRefused) {
  EXPECT_THROW(Guide({}), std::invalid_argument);
  EXPECT_THROW(Guide({{1, 2, 3}}), std::invalid_argument);
  EXPECT_THROW(Guide({{1, 2, 3}, {1, 2, 5}}), std::invalid_argument);
  EXPECT_THROW(Guide({{0, 0, 0}, {std::numeric_limits<double>::quiet_NaN(), 0, 0}}),
               std::invalid_argument);
}

}  // namespace
}  // namespace hedgehop::local_planning
