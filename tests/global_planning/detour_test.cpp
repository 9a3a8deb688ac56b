#include "global_planning/detour.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <random>

#include "global_planning/planning_case.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::global_planning {
namespace {

using flight::Waypoint;
using test::PlanningCase;
using test::shipped_global_options;

constexpr risk::CostWeights kWeights{25.0, 0.0, 0.0, 0.0};
constexpr double kLow_m = 130.0;  // above a plain at 100 m

// A plain of 18 x 9 km, seen from a disc alone.
PlanningCase plain_with_disc(const geo::MapPoint& centre, double radius_m, double share) {
  map::Map map = test::make_map(300, 150, 60.0, [](double, double) { return 100.0; });
  for (int row = 0; row < 150; ++row) {
    for (int column = 0; column < 300; ++column) {
      const geo::MapPoint at = map.geometry.centre({column, row});
      if (std::hypot(at.x_m - centre.x_m, at.y_m - centre.y_m) <= radius_m) {
        map.visibility.at(column, row) = test::stored_visibility(share);
      } else {
        map.visibility.at(column, row) = test::stored_visibility(0.0);
      }
    }
  }
  test::finish_map(map);
  return {std::move(map), kWeights};
}

// As the planner takes it: when the route was planned.
double cost_per_field(const FlightEnvelope& envelope, const CostField& field,
                      const RouteLine& route) {
  return envelope.route_cost_m(route.points(), 4.0) / field.cost_m(route.points().front().point());
}

TEST(RouteLine, PlacesAndPartsLieWhereTheirDistanceSays) {
  // East 300 m, north 400 m.
  const RouteLine line({{0.0, 0.0, 10.0}, {300.0, 0.0, 40.0}, {300.0, 400.0, 0.0}});
  EXPECT_DOUBLE_EQ(line.length_m(), 700.0);
  EXPECT_EQ(line.at(100.0), (Waypoint{100.0, 0.0, 20.0}));
  EXPECT_EQ(line.at(500.0), (Waypoint{300.0, 200.0, 20.0}));
  EXPECT_EQ(line.at(900.0), (Waypoint{300.0, 400.0, 0.0})) << "beyond the end";
  const std::vector<Waypoint> part = line.part(200.0, 400.0);
  ASSERT_EQ(part.size(), 3U);
  EXPECT_EQ(part[1], (Waypoint{300.0, 0.0, 40.0}));
  const RouteLine::Nearest nearest = line.nearest({250.0, 300.0});
  EXPECT_DOUBLE_EQ(nearest.along_m, 600.0);
  EXPECT_DOUBLE_EQ(nearest.distance_m, 50.0);
}

TEST(RouteLine, WaypointsOfAStraightRunAreNoCorners) {
  const std::vector<Waypoint> route = {{0.0, 0.0, 0.0},     {100.0, 0.0, 20.0}, {250.0, 0.0, 0.0},
                                       {250.0, 100.0, 0.0}, {250.0, 90.0, 0.0}, {300.0, 90.0, 5.0}};
  const std::vector<Waypoint> corners = corners_of(route);
  ASSERT_EQ(corners.size(), 5U) << "back along a line is a corner";
  EXPECT_EQ(corners[1], route[2]);
  EXPECT_EQ(corners[2], route[3]);
}

TEST(Detour, OfARouteThatNothingHasChangedThereIsNone) {
  const PlanningCase in = plain_with_disc({9000.0, 1000.0}, 500.0, 0.5);
  const Waypoint start{1500.0, 4500.0, kLow_m};
  const Waypoint goal{16500.0, 4500.0, kLow_m};
  const FlightEnvelope envelope(in.costs, shipped_global_options(), start, goal);
  const CostField field(envelope, goal.point(), 120.0);
  const RouteLine route({start, goal});
  EXPECT_FALSE(find_detour(envelope, field, route,
                           {2000.0, true, cost_per_field(envelope, field, route),
                            [](const geo::MapPoint&) { return false; }}));
}

TEST(Detour, AroundADiscLeavesBeforeItAndComesBackBehindIt) {
  const std::uint64_t seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> place(5500.0, 11000.0);
  const geo::MapPoint disc{place(random), 4500.0};
  constexpr double kRadius_m = 1200.0;
  const PlanningCase in = plain_with_disc(disc, kRadius_m, 0.9);
  const Waypoint start{1500.0, 4500.0, kLow_m};
  const Waypoint goal{16500.0, 4500.0, kLow_m};
  const FlightEnvelope envelope(in.costs, shipped_global_options(), start, goal);
  const CostField field(envelope, goal.point(), 120.0);
  const RouteLine route({start, goal});
  const auto is_changed = [&](const geo::MapPoint& at) {
    return std::hypot(at.x_m - disc.x_m, at.y_m - disc.y_m) <= kRadius_m;
  };
  constexpr double kFlown_m = 700.0;
  const auto detour = find_detour(envelope, field, route, {kFlown_m, true, 1.0, is_changed});
  ASSERT_TRUE(detour) << seed;
  EXPECT_GE(detour->leave_m, kFlown_m) << seed;
  EXPECT_LT(detour->leave_m, disc.x_m - kRadius_m - 1500.0) << seed;
  EXPECT_GT(detour->join_m, disc.x_m + kRadius_m - 1500.0) << seed;
  EXPECT_LT(detour->join_m, route.length_m())
      << "the rest of the route is as short as any, " << seed;
  // Ways beside the route come no farther than the disc's edge and two blocks.
  EXPECT_LE(detour->aside_m, kRadius_m + 240.0) << seed;
}

TEST(Detour, ARouteAroundWhatIsGoneIsLeftForTheStraightWay) {
  const PlanningCase in = plain_with_disc({9000.0, 1000.0}, 100.0, 0.0);
  const Waypoint start{1500.0, 4500.0, kLow_m};
  const Waypoint goal{16500.0, 4500.0, kLow_m};
  const FlightEnvelope envelope(in.costs, shipped_global_options(), start, goal);
  const CostField field(envelope, goal.point(), 120.0);
  // 15 km straight, 17.5 km over the corner.
  const RouteLine route({start, {9000.0, 9000.0 - 60.0 * 5.0, kLow_m}, goal});
  const auto detour = find_detour(envelope, field, route,
                                  {0.0, true, 1.0, [](const geo::MapPoint&) { return false; }});
  ASSERT_TRUE(detour);
  EXPECT_LT(detour->leave_m, 1500.0) << "each metre along the wrong way costs";
}

}  // namespace
}  // namespace hedgehop::global_planning
