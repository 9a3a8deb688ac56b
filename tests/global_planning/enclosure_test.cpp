#include "global_planning/enclosure.hpp"

#include <cmath>
#include <gtest/gtest.h>

#include "global_planning/planning_case.hpp"

namespace hedgehop::global_planning {
namespace {

using test::PlanningCase;

constexpr risk::CostWeights kLengthOnly{};
constexpr double kReach_m = 3000.0;
constexpr std::int64_t kWork = 50'000'000;

// A round pit of 400 m radius with a flat floor in a plain, walls of 45 degrees, `depth_m` deep.
PlanningCase pit(double depth_m) {
  return {test::make_map(240, 240, 30.0,
                         [depth_m](double x_m, double y_m) {
                           const double from_m = std::hypot(x_m - 3600.0, y_m - 3600.0);
                           return std::fmin(std::fmax(from_m - 400.0, 0.0), depth_m);
                         }),
          kLengthOnly};
}

TEST(Enclosure, ADeepPitTooNarrowToCircleInHoldsEveryRoute) {
  // A circle of 282 m radius fits into the floor, so turns alone would climb out in a spiral: with
  // a radius of 600 m it does not fit, and one straight pass gains far less than the depth.
  const PlanningCase in = pit(600.0);
  GlobalOptions options = test::shipped_global_options();
  options.turn_radius_m = 600.0;
  const flight::Waypoint goal = in.above(3600, 3600);
  const flight::Waypoint start = in.above(600, 600);
  const FlightEnvelope envelope(in.costs, options, start, goal);
  const auto enclosure = prove_enclosed(envelope, options, goal, start, kReach_m, kWork);
  ASSERT_TRUE(enclosure.has_value());
  EXPECT_GT(enclosure->states, 0);
  // Nothing flies beyond the rim, at 1000 m; steps and what lies beside them are added.
  EXPECT_LT(enclosure->reach_m, 1000.0 + 0.8 * 600.0 + 200.0);
}

TEST(Enclosure, NothingIsProvedWhereARouteIsKnown) {
  const PlanningCase in = pit(30.0);
  const GlobalOptions options = test::shipped_global_options();
  const flight::Waypoint goal = in.above(3600, 3600);
  const flight::Waypoint start = in.above(600, 600);
  ASSERT_TRUE(std::holds_alternative<flight::Route>(test::plan(in, options, start, goal)));
  const FlightEnvelope envelope(in.costs, options, start, goal);
  EXPECT_FALSE(prove_enclosed(envelope, options, goal, start, kReach_m, kWork));
  EXPECT_FALSE(prove_enclosed(envelope, options, start, goal, kReach_m, kWork));
}

TEST(Enclosure, NothingIsProvedWithoutATurnRadius) {
  const PlanningCase in = pit(600.0);
  GlobalOptions options = test::shipped_global_options();
  options.turn_radius_m = 0.0;
  const flight::Waypoint goal = in.above(3600, 3600);
  const FlightEnvelope envelope(in.costs, options, in.above(600, 600), goal);
  EXPECT_FALSE(prove_enclosed(envelope, options, goal, in.above(600, 600), kReach_m, kWork));
}

}  // namespace
}  // namespace hedgehop::global_planning
