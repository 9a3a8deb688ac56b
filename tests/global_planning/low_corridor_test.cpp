#include "global_planning/low_corridor.hpp"

#include <array>
#include <gtest/gtest.h>
#include <limits>
#include <random>

#include "global_planning/planning_case.hpp"
#include "global_planning/route_finish.hpp"
#include "global_planning/track_profile.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::global_planning {
namespace {

using flight::Waypoint;
using test::PlanningCase;
using test::shipped_global_options;

using test::kWeights;

// What a track costs as low as it may be flown, leg by leg; infinite where it may not.
double low_cost_m(const FlightEnvelope& envelope, const std::vector<geo::MapPoint>& track,
                  double start_m, double goal_m) {
  FlightEnvelope::Arrival arrival;
  arrival.altitudes = {start_m, start_m};
  double cost_m = 0.0;
  for (std::size_t i = 1; i < track.size(); ++i) {
    if (i >= 2 && !envelope.is_turn_allowed(
                      track[i - 1].x_m - track[i - 2].x_m, track[i - 1].y_m - track[i - 2].y_m,
                      track[i].x_m - track[i - 1].x_m, track[i].y_m - track[i - 1].y_m)) {
      return std::numeric_limits<double>::infinity();
    }
    arrival = envelope.follow(track[i - 1], track[i], arrival.altitudes,
                              {15.0, 1.0, 0.98, false, false, true}, arrival.owed_m);
    if (!arrival.altitudes.is_flyable()) {
      return std::numeric_limits<double>::infinity();
    }
    cost_m += arrival.cost_m;
  }
  return arrival.altitudes.low_m <= goal_m + 1.5 && arrival.altitudes.high_m >= goal_m - 1.5
             ? cost_m
             : std::numeric_limits<double>::infinity();
}

TEST(LowCorridor, ItsTrackIsTheCheapestOfAllThroughItsPlaces) {
  const std::uint64_t seed = test::fresh_seed();
  const PlanningCase in(test::make_fractal_map(seed, 100, 30.0, 900.0, 60.0), kWeights);
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> north(800.0, 2200.0);
  const GlobalOptions options = shipped_global_options();
  int found = 0;
  for (int i = 0; i < 6; ++i) {
    // A line to the east of four stations and its ends: 5 x 5 x 5 x 5 tracks.
    const double y_m = north(random);
    constexpr double kWest_m = 900.0;
    constexpr double kStation_m = 240.0;
    constexpr double kAside_m = 40.0;
    const Waypoint a = in.above(kWest_m, y_m, 40.0);
    const Waypoint b = in.above(kWest_m + 5.0 * kStation_m, y_m, 40.0);
    const FlightEnvelope envelope(in.costs, options, a, b);
    double least_m = std::numeric_limits<double>::infinity();
    for (int code = 0; code < 625; ++code) {
      std::vector<geo::MapPoint> track = {a.point()};
      int rest = code;
      for (int station = 1; station <= 4; ++station, rest /= 5) {
        track.push_back({kWest_m + station * kStation_m, y_m + (rest % 5 - 2) * kAside_m});
      }
      track.push_back(b.point());
      least_m = std::min(least_m, low_cost_m(envelope, track, a.altitude_m, b.altitude_m));
    }
    const std::vector<geo::MapPoint> track =
        low_corridor_track(envelope, {a, b}, {kStation_m, kAside_m}, std::nullopt, std::nullopt);
    if (track.empty()) {
      continue;  // of two arrivals the cheaper one need not be the one that can go on
    }
    ++found;
    ASSERT_EQ(track.size(), 6U) << seed;
    const double cost_m = low_cost_m(envelope, track, a.altitude_m, b.altitude_m);
    EXPECT_GE(cost_m, least_m * (1.0 - 1e-9)) << seed;
    EXPECT_LE(cost_m, least_m * 1.01) << seed << ", line " << i;
  }
  EXPECT_GT(found, 2) << seed;
}

TEST(LowCorridor, LegsThatJoinItsEndsMayTurnIntoIt) {
  const PlanningCase in(test::make_map(100, 100, 30.0, [](double, double) { return 100.0; }),
                        kWeights);
  const Waypoint a = in.above(800.0, 1500.0, 40.0);
  const Waypoint b = in.above(2000.0, 1500.0, 40.0);
  const FlightEnvelope envelope(in.costs, shipped_global_options(), a, b);
  const Waypoint behind = in.above(600.0, 1480.0, 40.0);
  const Waypoint beyond = in.above(2200.0, 1540.0, 40.0);
  const std::vector<geo::MapPoint> track =
      low_corridor_track(envelope, {a, b}, {240.0, 40.0}, behind, beyond);
  ASSERT_GE(track.size(), 3U);
  std::vector<Waypoint> whole = {behind};
  for (const geo::MapPoint& point : track) {
    whole.push_back({point.x_m, point.y_m, 140.0});
  }
  whole.push_back(beyond);
  EXPECT_TRUE(are_turns_allowed(envelope, whole));
  const Waypoint back = in.above(900.0, 1500.0, 40.0);
  EXPECT_TRUE(low_corridor_track(envelope, {a, b}, {240.0, 40.0}, back, beyond).empty())
      << "who comes from the east cannot go on to it";
}

TEST(LowCorridor, TheLowestLineCostsWhatTheLowestProfileDoes) {
  const std::uint64_t seed = test::fresh_seed();
  const PlanningCase in(test::make_fractal_map(seed, 150, 30.0, 1200.0, 60.0), kWeights);
  const Waypoint a = in.above(700.0, 1500.0);
  const Waypoint b = in.above(3700.0, 1800.0);
  const FlightEnvelope envelope(in.costs, shipped_global_options(), a, b);
  const std::vector<geo::MapPoint> track = {a.point(), {2000.0, 1700.0}, b.point()};
  const std::vector<Waypoint> profile = lowest_profile(envelope, track, 10.0);
  const std::vector<Waypoint> line = lowest_line(envelope, track, a.altitude_m, b.altitude_m, 10.0);
  if (profile.empty()) {
    GTEST_SKIP() << "no flight along this track, seed " << seed;
  }
  ASSERT_FALSE(line.empty()) << seed;
  EXPECT_EQ(line.front(), a);
  EXPECT_EQ(line.back(), b);
  // Legs lie on it or above it by some metres.
  const double line_m = envelope.route_cost_m(line, 4.0);
  EXPECT_GE(envelope.route_cost_m(profile, 4.0), line_m * 0.995) << seed;
  EXPECT_LE(envelope.route_cost_m(profile, 4.0), line_m * 1.05) << seed;
}

}  // namespace
}  // namespace hedgehop::global_planning
