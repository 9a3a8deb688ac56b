#include "global_planning/lattice_search.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

#include "global_planning/cost_field.hpp"
#include "global_planning/planning_case.hpp"
#include "global_planning/track_profile.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::global_planning {
namespace {

using flight::Waypoint;
using test::PlanningCase;

using test::kLengthOnly;
using test::kWeights;
constexpr LatticeSpare kSpare{2.0, 0.97};
const auto kNever = [] { return false; };

TEST(LatticeSearch, OverAPlainTheTrackIsTheStraightLineIfItPointsAlongTheLattice) {
  const PlanningCase in(test::make_map(200, 200, 30.0, [](double, double) { return 50.0; }),
                        kLengthOnly);
  const GlobalOptions options = test::shipped_global_options();
  const FlightEnvelope envelope(in.costs, options, in.above(1000, 1000), in.above(1000, 5000));
  const LatticeResult found = search_lattice(envelope, options, kSpare, 100000, kNever);
  ASSERT_EQ(found.track.size(), 2U);
  EXPECT_NEAR(found.cost_m, 4000.0, 1e-6);
}

TEST(LatticeSearch, EveryCornerOfATrackMayBeFlownAndTheProfileKeepsTheBand) {
  const std::uint64_t seed = test::fresh_seed();
  int found_tracks = 0;
  int rough_tracks = 0;
  for (std::uint64_t k = 0; k < 5; ++k) {
    const PlanningCase in(test::make_fractal_map(seed + k, 220, 30.0, 3000.0, 500.0), kWeights);
    const GlobalOptions options = test::shipped_global_options();
    const FlightEnvelope envelope(in.costs, options, in.above(900, 900), in.above(5700, 5400));
    const LatticeResult found = search_lattice(envelope, options, kSpare, 300000, kNever);
    EXPECT_LE(found.work_units, 300000 + 400);  // a label is expanded to its end
    const auto& track = found.track;
    for (std::size_t i = 2; i < track.size(); ++i) {
      EXPECT_TRUE(envelope.is_turn_allowed(
          track[i - 1].x_m - track[i - 2].x_m, track[i - 1].y_m - track[i - 2].y_m,
          track[i].x_m - track[i - 1].x_m, track[i].y_m - track[i - 1].y_m));
    }
    if (track.empty()) {
      continue;
    }
    const auto profile = lowest_profile(envelope, track, 10.0);
    if (profile.empty()) {
      ++rough_tracks;  // between the samples of the search the ground is rougher than its spare
      continue;
    }
    ASSERT_GE(profile.size(), track.size());
    EXPECT_EQ(profile.front(), envelope.start());
    EXPECT_EQ(profile.back(), envelope.goal());
    for (std::size_t i = 1; i < profile.size(); ++i) {
      EXPECT_TRUE(envelope.is_clear(profile[i - 1], profile[i]));
    }
    ++found_tracks;
  }
  EXPECT_GE(found_tracks, 3);
  EXPECT_LE(rough_tracks, 1);
}

TEST(LatticeSearch, AWalledInStartEndsTheSearchAndNotTheBudget) {
  // A basin of 1.2 km around the start, behind a wall that no envelope reaches over.
  const PlanningCase in(test::make_map(200, 200, 30.0,
                                       [](double x_m, double y_m) {
                                         const double from_m =
                                             std::hypot(x_m - 2000.0, y_m - 2000.0);
                                         return from_m > 1200.0 && from_m < 1400.0 ? 900.0 : 0.0;
                                       }),
                        kLengthOnly);
  const GlobalOptions options = test::shipped_global_options();
  const FlightEnvelope envelope(in.costs, options, in.above(2000, 2000), in.above(5000, 5000));
  const LatticeResult found = search_lattice(envelope, options, kSpare, 3000000, kNever);
  EXPECT_TRUE(found.track.empty());
  EXPECT_TRUE(found.is_exhausted);
  EXPECT_LT(found.work_units, 1000000);
}

TEST(CostField, OverAPlainItIsTheDistanceUpToMetrication) {
  const PlanningCase in(test::make_map(200, 200, 30.0, [](double, double) { return 50.0; }),
                        kLengthOnly);
  const GlobalOptions options = test::shipped_global_options();
  const Waypoint goal = in.above(3000, 3000);
  const FlightEnvelope envelope(in.costs, options, in.above(1000, 1000), goal);
  const CostField field(envelope, goal.point(), 60.0);
  for (int k = 0; k < 32; ++k) {
    const double angle_rad = k * std::numbers::pi / 16.0;
    const geo::MapPoint from{3000.0 + 2000.0 * std::cos(angle_rad),
                             3000.0 + 2000.0 * std::sin(angle_rad)};
    // Never more than the straight way, but for the block of the target; never 3 % less.
    EXPECT_LE(field.cost_m(from), 2000.0 + 60.0);
    EXPECT_GE(field.cost_m(from), 2000.0 / 1.03 - 60.0);
  }
  EXPECT_EQ(field.cost_m({-10.0, 50.0}), std::numeric_limits<double>::infinity());
}

TEST(CostField, AcrossAHillsideItIsTheDistanceAndUpWhatTheClimbTakes) {
  const PlanningCase in(
      test::make_map(200, 200, 30.0, [](double x_m, double) { return 100.0 + 0.3 * x_m; }),
      kLengthOnly);
  GlobalOptions options = test::shipped_global_options();
  options.climb_angle_max_rad = std::atan(0.15);
  options.descent_angle_max_rad = std::atan(0.1);
  const geo::MapPoint target{3015.0, 3015.0};
  const FlightEnvelope envelope(in.costs, options, in.above(1000, 1000), in.above(1500, 1000));
  const CostField field(envelope, target, 30.0);
  EXPECT_NEAR(field.cost_m({3015.0, 4515.0}), 1500.0 / 1.0275, 1.0);
  // 450 m of height at 15 %, whatever way is taken; what is left of the distance costs nothing
  // more.
  EXPECT_NEAR(field.cost_m({4515.0, 3015.0}), 3000.0 / 1.0275, 5.0);
  EXPECT_NEAR(field.cost_m({1515.0, 4515.0}), 3000.0 / 1.0275, 5.0);
}

TEST(CostField, WhatTheEnvelopeEvensOutCountsNoClimb) {
  // Ridges of 40 m, 120 m apart, with slopes of two thirds.
  const PlanningCase in(test::make_map(200, 200, 30.0,
                                       [](double x_m, double) {
                                         return 100.0 + (2.0 / 3.0) *
                                                            std::fabs(std::fmod(x_m, 120.0) - 60.0);
                                       }),
                        kLengthOnly);
  const GlobalOptions options = test::shipped_global_options();
  const FlightEnvelope envelope(in.costs, options, in.above(1000, 1000), in.above(1500, 1000));
  const CostField field(envelope, {3015.0, 3015.0}, 30.0);
  EXPECT_NEAR(field.cost_m({4515.0, 3015.0}), 1500.0 / 1.0275, 10.0);
}

TEST(TrackProfile, LeavesAndReachesTheFloorOfAnEndOnASlopeThatTheClimbLimitAllows) {
  // Start and goal below the floor on the two sides of a ridge with slopes of 10 %. Within their
  // funnels of 400 m the floor comes to rise by another 3 %, against a climb limit of 14 %.
  const PlanningCase in(
      test::make_map(300, 100, 30.0,
                     [](double x_m, double) { return 400.0 - 0.1 * std::fabs(x_m - 4500.0); }),
      kLengthOnly);
  const GlobalOptions options = test::shipped_global_options();
  const FlightEnvelope envelope(in.costs, options, in.above(1500, 1500), in.above(7400, 1600));
  const auto profile = lowest_profile(
      envelope, {envelope.start().point(), {4000.0, 1400.0}, envelope.goal().point()}, 10.0);
  ASSERT_FALSE(profile.empty());
  for (std::size_t i = 1; i < profile.size(); ++i) {
    EXPECT_TRUE(envelope.is_clear(profile[i - 1], profile[i]));
  }
}

TEST(LatticeSearch, CrestsBetweenTheSamplesNearAnEndLeaveNoTrackWithoutProfile) {
  // The start in a hollow of one cell between crests of random height: what its first leg climbs
  // over lies on lines through cell centres, and near it there is no spare for what is not looked
  // at.
  const std::uint64_t seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> crest_m(1.0, 9.0);
  int tracks = 0;
  for (int k = 0; k < 20; ++k) {
    std::vector<double> heights_m(200 * 100, 0.0);
    for (int row = 40; row <= 60; ++row) {
      for (int column = 20; column <= 40; ++column) {
        heights_m[static_cast<std::size_t>(row * 200 + column)] = crest_m(random);
      }
    }
    const PlanningCase in(
        test::make_map(200, 100, 30.0,
                       [&](double x_m, double y_m) {
                         const int column = static_cast<int>(x_m / 30.0);
                         const int row = static_cast<int>(y_m / 30.0);
                         return heights_m[static_cast<std::size_t>(row * 200 + column)];
                       }),
        kLengthOnly);
    const GlobalOptions options = test::shipped_global_options();
    const FlightEnvelope envelope(in.costs, options, in.above(915, 1515), in.above(5000, 1500));
    // As a plan does: a second time with more to spare.
    bool is_track = false;
    bool is_profile = false;
    for (const LatticeSpare& spare : {kSpare, LatticeSpare{6.0, 0.85}}) {
      const LatticeResult found = search_lattice(envelope, options, spare, 300000, kNever);
      is_track = is_track || !found.track.empty();
      is_profile = is_profile ||
                   (!found.track.empty() && !lowest_profile(envelope, found.track, 10.0).empty());
    }
    tracks += is_track ? 1 : 0;
    EXPECT_EQ(is_profile, is_track) << "map " << k;
  }
  EXPECT_GE(tracks, 10);
}

TEST(TrackProfile, OverARidgeItIsTheConeOfTheClimbLimit) {
  // A ridge of 100 m across the track: far before it the flight is as low as the floor, and rises
  // with the climb limit to pass it.
  const PlanningCase in(test::make_map(300, 100, 30.0,
                                       [](double x_m, double) {
                                         return std::fabs(x_m - 4500.0) < 100.0 ? 100.0 : 0.0;
                                       }),
                        kLengthOnly);
  GlobalOptions options = test::shipped_global_options();
  options.lateral_margin_m = 0.0;
  const FlightEnvelope envelope(in.costs, options, in.above(1000, 1500, 20.0),
                                in.above(8000, 1500, 20.0));
  const auto profile = lowest_profile(envelope, {{1000.0, 1500.0}, {8000.0, 1500.0}}, 15.0);
  ASSERT_GE(profile.size(), 4U);
  const double tangent = std::tan(options.climb_angle_max_rad);
  double highest_m = 0.0;
  for (const Waypoint& at : profile) {
    highest_m = std::max(highest_m, at.altitude_m);
    // The cone over the ridge, whose interpolated crest ends one cell further out.
    const double beside_m = std::max(std::fabs(at.x_m - 4500.0) - 130.0, 0.0);
    const double lowest_m = std::max(20.0, 120.0 - tangent * beside_m);
    EXPECT_LE(at.altitude_m, lowest_m + 4.0 + 8.0);
  }
  EXPECT_NEAR(highest_m, 120.0, 5.0);
}

TEST(LatticeSearch, APartTurnsOutOfWhatLeadsToItAndIntoWhatFollowsFromEitherEnd) {
  const std::uint64_t seed = test::fresh_seed();
  int found_tracks = 0;
  // Some hills leave no way, about one in thirty.
  for (std::uint64_t hills = 0; hills < 4; ++hills) {
    const PlanningCase in(test::make_fractal_map(seed + hills, 220, 30.0, 3000.0, 150.0), kWeights);
    const GlobalOptions options = test::shipped_global_options();
    const FlightEnvelope envelope(in.costs, options, in.above(600, 600), in.above(6000, 6000));
    const CostField to_goal(envelope, envelope.goal().point(), 120.0);
    LatticePart part{in.above(1800, 2000, 45.0),
                     in.above(4600, 4000, 45.0),
                     LeadIn{400.0, 0.0},
                     LeadIn{0.0, 400.0},
                     60.0,
                     2000.0};
    const CostField to_part(to_goal, part.from.point(), part.to.point());
    for (const bool is_backward : {false, true}) {
      part.is_backward = is_backward;
      const LatticeResult found = search_lattice(envelope, options, kSpare, part, 100000, kNever,
                                                 is_backward ? to_part : to_goal);
      if (found.track.empty()) {
        continue;
      }
      ++found_tracks;
      EXPECT_DOUBLE_EQ(found.track.front().x_m, part.from.x_m);
      EXPECT_DOUBLE_EQ(found.track.front().y_m, part.from.y_m);
      EXPECT_DOUBLE_EQ(found.track.back().x_m, part.to.x_m);
      EXPECT_DOUBLE_EQ(found.track.back().y_m, part.to.y_m);
      std::vector<geo::MapPoint> whole = {{part.from.x_m - 400.0, part.from.y_m}};
      whole.insert(whole.end(), found.track.begin(), found.track.end());
      whole.push_back({part.to.x_m, part.to.y_m + 400.0});
      for (std::size_t i = 2; i < whole.size(); ++i) {
        EXPECT_TRUE(envelope.is_turn_allowed(
            whole[i - 1].x_m - whole[i - 2].x_m, whole[i - 1].y_m - whole[i - 2].y_m,
            whole[i].x_m - whole[i - 1].x_m, whole[i].y_m - whole[i - 1].y_m))
            << "seed " << seed + hills << ", corner " << i - 1;
      }
    }
  }
  EXPECT_GT(found_tracks, 0) << seed;
}

}  // namespace
}  // namespace hedgehop::global_planning
