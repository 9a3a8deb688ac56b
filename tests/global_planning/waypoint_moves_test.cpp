#include "global_planning/waypoint_moves.hpp"

#include <gtest/gtest.h>
#include <limits>
#include <random>
#include <vector>

#include "global_planning/flight_envelope.hpp"
#include "global_planning/planning_case.hpp"
#include "global_planning/route_finish.hpp"
#include "support/fresh_seed.hpp"
#include "support/rough_terrain.hpp"

namespace hedgehop::global_planning {
namespace {

using flight::Waypoint;
using test::PlanningCase;

using test::kLengthOnly;
using test::kWeights;
constexpr std::int64_t kNoLimit = std::numeric_limits<std::int64_t>::max() / 4;

std::vector<Waypoint> zigzag(const PlanningCase& in, double aside_m, double higher_m) {
  std::vector<Waypoint> route;
  for (int i = 0; i <= 20; ++i) {
    const bool is_end = i == 0 || i == 20;
    const int side = i % 2 == 0 ? 1 : -1;
    route.push_back(in.above(1000.0 + 100.0 * i, 1500.0 + (is_end ? 0.0 : side * aside_m),
                             30.0 + (is_end ? 0.0 : (1 + side) * higher_m)));
  }
  return route;
}

TEST(MoveWaypoints, MakeAZigzagOverLevelGroundStraight) {
  const PlanningCase in(test::make_map(140, 100, 30.0, [](double, double) { return 200.0; }),
                        kLengthOnly);
  GlobalOptions options = test::shipped_global_options();
  options.turn_radius_m = 0.0;
  std::vector<Waypoint> route = zigzag(in, 15.0, 2.0);
  const FlightEnvelope envelope(in.costs, options, route.front(), route.back());
  const double before_m = envelope.route_cost_m(route, 1.0);
  EXPECT_GT(before_m, 2080.0);  // 20 legs of sqrt(100^2 + 30^2) m, two of them shorter
  std::int64_t work_units = 0;
  const double after_m = move_waypoints(envelope, kNoLimit, work_units, route, before_m);
  // Straight it is 2000 m; with no waypoint more than 2.5 m aside the legs are at most 0.13 m
  // longer.
  EXPECT_LT(after_m, 2002.5);
  EXPECT_GE(after_m, 2000.0);
  EXPECT_EQ(after_m, envelope.route_cost_m(route, 1.0));
  EXPECT_EQ(route.front(), in.above(1000.0, 1500.0, 30.0));
  EXPECT_EQ(route.back(), in.above(3000.0, 1500.0, 30.0));
  EXPECT_EQ(route.size(), 21U);
  EXPECT_GT(work_units, 0);
}

TEST(MoveWaypoints, KeepBandClimbAndTurnsAndNeverCostMore) {
  const std::uint64_t seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  int gained = 0;
  int found = 0;
  for (int i = 0; i < 6; ++i) {
    const PlanningCase in(
        test::make_rough_map(200, 200, 30.0, static_cast<unsigned>(random()), 12.0), kWeights);
    GlobalOptions options = test::shipped_global_options();
    options.refine = false;
    const Waypoint start = in.above(600.0, 700.0 + 200.0 * i, 40.0);
    const Waypoint goal = in.above(5300.0, 4900.0 - 300.0 * i, 40.0);
    const auto planned = test::plan(in, options, start, goal);
    if (!std::holds_alternative<flight::Route>(planned)) {
      continue;
    }
    ++found;
    std::vector<Waypoint> route = std::get<flight::Route>(planned).waypoints;
    const FlightEnvelope envelope(in.costs, options, start, goal);
    const double before_m = envelope.route_cost_m(route, 1.0);
    std::int64_t work_units = 0;
    const double after_m = move_waypoints(envelope, kNoLimit, work_units, route, before_m);
    EXPECT_LE(after_m, before_m);
    EXPECT_EQ(after_m, envelope.route_cost_m(route, 1.0));
    gained += after_m < before_m ? 1 : 0;
    EXPECT_TRUE(are_turns_allowed(envelope, route));
    for (std::size_t leg = 1; leg < route.size(); ++leg) {
      EXPECT_TRUE(envelope.is_clear(route[leg - 1], route[leg])) << leg;
      EXPECT_TRUE(envelope.is_climb_allowed(route[leg - 1], route[leg])) << leg;
    }
    EXPECT_EQ(route.front(), start);
    EXPECT_EQ(route.back(), goal);
  }
  EXPECT_GE(found, 4);
  EXPECT_EQ(gained, found);
}

TEST(MoveWaypoints, LetTheArcsOfAllCornersGoOnFitting) {
  // Cutting corners pays, but makes the legs between them shorter.
  const PlanningCase in(test::make_map(140, 140, 30.0, [](double, double) { return 200.0; }),
                        kLengthOnly);
  const GlobalOptions options = test::shipped_global_options();
  std::vector<Waypoint> route = {in.above(1000.0, 1000.0, 30.0), in.above(1900.0, 1000.0, 30.0),
                                 in.above(2260.0, 1150.0, 30.0), in.above(2760.0, 1650.0, 30.0),
                                 in.above(2960.0, 2300.0, 30.0)};
  const FlightEnvelope envelope(in.costs, options, route.front(), route.back());
  ASSERT_TRUE(are_turns_allowed(envelope, route));
  const double before_m = envelope.route_cost_m(route, 1.0);
  std::int64_t work_units = 0;
  EXPECT_LT(move_waypoints(envelope, kNoLimit, work_units, route, before_m), before_m);
  EXPECT_TRUE(are_turns_allowed(envelope, route));
}

TEST(MoveWaypoints, EndWithTheWorkBudget) {
  const PlanningCase in(test::make_map(140, 100, 30.0, [](double, double) { return 200.0; }),
                        kLengthOnly);
  GlobalOptions options = test::shipped_global_options();
  options.turn_radius_m = 0.0;
  const std::vector<Waypoint> zigzags = zigzag(in, 15.0, 2.0);
  const FlightEnvelope envelope(in.costs, options, zigzags.front(), zigzags.back());
  const double before_m = envelope.route_cost_m(zigzags, 1.0);
  std::vector<Waypoint> untouched = zigzags;
  std::int64_t work_units = 100;
  EXPECT_EQ(move_waypoints(envelope, 110, work_units, untouched, before_m), before_m);
  EXPECT_EQ(untouched, zigzags);
  EXPECT_LE(work_units, 110);
  double least_m = before_m;
  for (const std::int64_t budget : {400, 1000, 100000}) {
    std::vector<Waypoint> route = zigzags;
    work_units = 0;
    const double after_m = move_waypoints(envelope, budget, work_units, route, before_m);
    EXPECT_LE(after_m, least_m) << budget;
    EXPECT_LE(work_units, budget);
    least_m = after_m;
  }
  EXPECT_LT(least_m, before_m);
}

}  // namespace
}  // namespace hedgehop::global_planning
