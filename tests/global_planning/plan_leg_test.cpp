#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>

#include "global_planning/planning_case.hpp"

namespace hedgehop::global_planning {
namespace {

using flight::NoPlan;
using flight::NoPlanCause;
using flight::Route;
using flight::Waypoint;
using test::plan;
using test::PlanningCase;
using test::shipped_global_options;

constexpr risk::CostWeights kWeights{25.0, 0.02, 4.0, 0.01};
constexpr risk::CostWeights kLengthOnly{};

TEST(PlanLeg, OverFlatGroundWithoutRiskTheRouteIsTheStraightLine) {
  const PlanningCase in(test::make_map(200, 200, 30.0, [](double, double) { return 100.0; }),
                        kLengthOnly);
  const auto result =
      plan(in, shipped_global_options(), in.above(1000, 1000, 30.0), in.above(5000, 4000, 30.0));
  const auto* route = std::get_if<Route>(&result);
  ASSERT_NE(route, nullptr);
  EXPECT_EQ(route->waypoints.size(), 2U);
  EXPECT_NEAR(route->cost.total_m(), 5000.0, 1e-6);
  EXPECT_NEAR(route->lower_bound_m, 5000.0, 1e-4);
  EXPECT_EQ(route->batches, 1);  // then it is proved optimal
}

TEST(PlanLeg, SameArgumentsGiveTheSameRouteToTheLastBit) {
  const PlanningCase in(test::make_fractal_map(7, 250, 30.0, 3000.0, 600.0), kWeights);
  const GlobalOptions options = shipped_global_options(20000);
  const auto first = plan(in, options, in.above(1000, 1000), in.above(6500, 6000), 42);
  const auto again = plan(in, options, in.above(1000, 1000), in.above(6500, 6000), 42);
  ASSERT_TRUE(std::holds_alternative<Route>(first));
  const Route& a = std::get<Route>(first);
  const Route& b = std::get<Route>(again);
  EXPECT_EQ(a.waypoints, b.waypoints);
  EXPECT_EQ(a.guide, b.guide);
  EXPECT_EQ(a.cost, b.cost);
  EXPECT_EQ(a.work_units, b.work_units);
  EXPECT_EQ(a.samples, b.samples);
}

}  // namespace
}  // namespace hedgehop::global_planning
