#include <array>
#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <limits>
#include <numbers>
#include <optional>
#include <random>

#include "base/angles.hpp"
#include "global_planning/flight_envelope.hpp"
#include "global_planning/leg_ground.hpp"
#include "global_planning/planning_case.hpp"
#include "global_planning/roadmap.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::global_planning {
namespace {

using flight::NoPlan;
using flight::NoPlanCause;
using flight::Route;
using flight::Waypoint;
using test::plan;
using test::PlanningCase;
using test::shipped_global_options;

using test::kLengthOnly;
using test::kWeights;

double plan_distance_m(const Waypoint& a, const Waypoint& b) {
  return std::hypot(a.x_m - b.x_m, a.y_m - b.y_m);
}

// Everything that a route promises, reckoned apart from the planner's own checks.
void expect_lawful(const PlanningCase& in, const GlobalOptions& options, const Route& route,
                   const Waypoint& start, const Waypoint& goal) {
  ASSERT_GE(route.waypoints.size(), 2U);
  EXPECT_EQ(route.waypoints.front(), start);
  EXPECT_EQ(route.waypoints.back(), goal);
  for (std::size_t i = 1; i < route.waypoints.size(); ++i) {
    const Waypoint& a = route.waypoints[i - 1];
    const Waypoint& b = route.waypoints[i];
    const double run_m = plan_distance_m(a, b);
    EXPECT_LE(std::fabs(std::atan2(b.altitude_m - a.altitude_m, run_m)),
              options.climb_angle_max_rad + 1e-9);
    const int steps = static_cast<int>(run_m / 3.7) + 1;  // another step than the planner's
    for (int k = 0; k <= steps; ++k) {
      const double t = static_cast<double>(k) / steps;
      const Waypoint at{a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m),
                        a.altitude_m + t * (b.altitude_m - a.altitude_m)};
      const double height_m = at.altitude_m - raster::sample_bilinear(in.map.surface_m, at.point());
      ASSERT_LE(height_m, options.envelope_ceiling_m + 1e-5);
      const double to_end_m = std::min(plan_distance_m(at, start), plan_distance_m(at, goal));
      if (to_end_m < options.end_funnel_m) {
        ASSERT_GE(height_m, 15.24 - 1e-3);  // the height of both ends
        continue;
      }
      // The floor over the highest surface within the margin, from samples all around.
      double highest_m = raster::sample_bilinear(in.map.surface_m, at.point());
      for (int j = 0; j < 8; ++j) {
        for (const double radius_m : {0.5, 1.0}) {
          const geo::MapPoint beside{
              at.x_m + radius_m * options.lateral_margin_m * std::cos(0.25 * j * std::numbers::pi),
              at.y_m + radius_m * options.lateral_margin_m * std::sin(0.25 * j * std::numbers::pi)};
          highest_m = std::max(highest_m, raster::sample_bilinear(in.map.surface_m, beside));
        }
      }
      ASSERT_GE(at.altitude_m, highest_m + options.envelope_floor_m - 1e-5);
    }
  }
  // Turns: in plan view, waypoints on a straight run change the climb alone.
  std::vector<Waypoint> corners;
  const auto turn_at = [](const Waypoint& a, const Waypoint& b, const Waypoint& c) {
    return std::fabs(wrap_to_pi(std::atan2(c.y_m - b.y_m, c.x_m - b.x_m) -
                                std::atan2(b.y_m - a.y_m, b.x_m - a.x_m)));
  };
  for (const Waypoint& waypoint : route.waypoints) {
    while (corners.size() >= 2 &&
           turn_at(corners[corners.size() - 2], corners.back(), waypoint) < 1e-7) {
      corners.pop_back();
    }
    corners.push_back(waypoint);
  }
  for (std::size_t i = 2; i < corners.size(); ++i) {
    const Waypoint& a = corners[i - 2];
    const Waypoint& b = corners[i - 1];
    const Waypoint& c = corners[i];
    const double turn_rad = turn_at(a, b, c);
    EXPECT_LE(turn_rad, options.turn_angle_max_rad + 1e-9);
    EXPECT_LE(options.turn_radius_m * std::tan(0.5 * turn_rad),
              0.5 * std::min(plan_distance_m(a, b), plan_distance_m(b, c)) + 1e-6);
  }
  // Cost: steps of 0.1 m against the reported ones, which jump at cell edges.
  const double fine_m = in.costs.route_cost(route.waypoints, 0.1).total_m();
  EXPECT_NEAR(route.cost.total_m(), fine_m, 0.01 * fine_m);
  EXPECT_LE(route.lower_bound_m, route.cost.total_m());
  // Guide
  ASSERT_GE(route.guide.size(), 2U);
  EXPECT_EQ(route.guide.front(), start);
  EXPECT_EQ(route.guide.back(), goal);
  EXPECT_NEAR(route.guide_spacing_m * static_cast<double>(route.guide.size() - 1),
              flight::length_m(route.waypoints), 1e-6);
  EXPECT_NEAR(route.guide_spacing_m, options.guide_spacing_m, 1.0);
  for (std::size_t i = 1; i < route.guide.size(); ++i) {
    EXPECT_LE(flight::length_m({route.guide[i - 1], route.guide[i]}),
              route.guide_spacing_m + 1e-6);  // shorter only where a corner is cut
  }
  EXPECT_LE(route.work_units, options.work_budget);
}

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
  EXPECT_EQ(route->batches, 0);  // the lattice alone

  GlobalOptions bit_star = shipped_global_options();
  bit_star.use_lattice = false;
  const auto second = plan(in, bit_star, in.above(1000, 1000, 30.0), in.above(5000, 4000, 30.0));
  ASSERT_TRUE(std::holds_alternative<Route>(second));
  EXPECT_EQ(std::get<Route>(second).waypoints.size(), 2U);
  EXPECT_EQ(std::get<Route>(second).batches, 1);  // then it is proved optimal
}

TEST(PlanLeg, RoutesOverRandomHillsKeepEverythingTheyPromise) {
  const std::uint64_t seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  int found = 0;
  for (int k = 0; k < 6; ++k) {
    const double relief_m = 150.0 + 130.0 * k;
    const PlanningCase in(test::make_fractal_map(random(), 200, 30.0, 3000.0, relief_m), kWeights);
    GlobalOptions options = shipped_global_options(30000);
    options.use_lattice = k % 2 == 0;
    options.refine = k < 4;
    const Waypoint start = in.above(500 + 1500 * unit(random), 500 + 5000 * unit(random));
    const Waypoint goal = in.above(4000 + 1500 * unit(random), 500 + 5000 * unit(random));
    const auto result = plan(in, options, start, goal, random());
    if (const auto* route = std::get_if<Route>(&result)) {
      SCOPED_TRACE("relief " + std::to_string(relief_m));
      expect_lawful(in, options, *route, start, goal);
      ++found;
    }
  }
  EXPECT_GE(found, 4);  // at 60,000 and shipped ceilings nearly all; steep small maps may fail
}

TEST(PlanLeg, AWallWithAGapIsPassedThroughTheGap) {
  // A ridge of 400 m from west to east with a pass of 300 m width at x = 4200.
  const PlanningCase in(test::make_map(200, 200, 30.0,
                                       [](double x_m, double y_m) {
                                         const bool is_wall = std::fabs(y_m - 3000.0) < 60.0;
                                         return is_wall && std::fabs(x_m - 4200.0) > 150.0 ? 400.0
                                                                                           : 0.0;
                                       }),
                        kLengthOnly);
  const GlobalOptions options = shipped_global_options(120000);
  const Waypoint start = in.above(2500, 1000);
  const Waypoint goal = in.above(2500, 5000);
  const auto result = plan(in, options, start, goal);
  const auto* route = std::get_if<Route>(&result);
  ASSERT_NE(route, nullptr);
  expect_lawful(in, options, *route, start, goal);
  for (std::size_t i = 1; i < route->waypoints.size(); ++i) {
    const Waypoint& a = route->waypoints[i - 1];
    const Waypoint& b = route->waypoints[i];
    if ((a.y_m < 3000.0) != (b.y_m < 3000.0)) {
      const double x_m = a.x_m + (3000.0 - a.y_m) / (b.y_m - a.y_m) * (b.x_m - a.x_m);
      EXPECT_NEAR(x_m, 4200.0, 150.0);
    }
  }
  // Two straight legs over (4080, 3000), the edge of the pass kept clear by the margin and a cell.
  const double shortest_m = 2.0 * std::hypot(4080.0 - 2500.0, 2000.0);
  EXPECT_LE(flight::length_m(route->waypoints), 1.06 * shortest_m);
}

TEST(PlanLeg, AHighlyVisibleDiscIsFlownAround) {
  map::Map map = test::make_map(240, 240, 30.0, [](double, double) { return 0.0; });
  for (int row = 0; row < 240; ++row) {
    for (int column = 0; column < 240; ++column) {
      const geo::MapPoint centre = map.geometry.centre({column, row});
      if (std::hypot(centre.x_m - 3600.0, centre.y_m - 3600.0) < 1000.0) {
        map.visibility.at(column, row) = test::stored_visibility(1.0);
      }
    }
  }
  test::finish_map(map);
  const PlanningCase in(std::move(map), kWeights);
  const GlobalOptions options = shipped_global_options(80000);
  const Waypoint start = in.above(1000, 3600);
  const Waypoint goal = in.above(6200, 3600);
  const auto result = plan(in, options, start, goal);
  const auto* route = std::get_if<Route>(&result);
  ASSERT_NE(route, nullptr);
  expect_lawful(in, options, *route, start, goal);
  // Two tangents and the arc between them around the disc.
  const double tangent_m = std::sqrt(2600.0 * 2600.0 - 1000.0 * 1000.0);
  const double arc_m = 1000.0 * (std::numbers::pi - 2.0 * std::acos(1000.0 / 2600.0));
  const double shortest_m = 2.0 * tangent_m + arc_m;
  EXPECT_LE(flight::length_m(route->waypoints), 1.1 * shortest_m);
  EXPECT_LT(route->cost.visibility_m, 0.05 * in.costs.route_cost({start, goal}, 5.0).visibility_m);
  EXPECT_LT(route->cost.total_m(), 0.2 * in.costs.route_cost({start, goal}, 5.0).total_m());
}

TEST(PlanLeg, TheLatticeWithRefinementBeatsBitStarAndEitherIsBetterRefined) {
  const std::uint64_t seed = test::fresh_seed();
  double lattice_m = 0.0;
  double bit_star_m = 0.0;
  int compared = 0;
  for (std::uint64_t k = 0; k < 3; ++k) {
    const PlanningCase in(test::make_fractal_map(seed + k, 250, 30.0, 3000.0, 350.0), kWeights);
    const Waypoint start = in.above(1000, 1000);
    const Waypoint goal = in.above(6500, 6000);
    std::array<double, 4> cost_m{};
    bool is_complete = true;
    for (std::size_t which = 0; which < cost_m.size(); ++which) {
      GlobalOptions options = shipped_global_options(60000);
      options.use_lattice = which < 2;
      options.refine = which % 2 == 0;
      const auto result = plan(in, options, start, goal, 5);
      const auto* route = std::get_if<Route>(&result);
      is_complete = is_complete && route != nullptr;
      cost_m[which] = route != nullptr ? route->cost.total_m() : 0.0;
      if (route != nullptr) {
        expect_lawful(in, options, *route, start, goal);
      }
    }
    if (is_complete) {
      ++compared;
      lattice_m += cost_m[0];
      bit_star_m += cost_m[3];
      EXPECT_LE(cost_m[0], 1.005 * cost_m[1]);  // shortcuts come last and know other corners
      EXPECT_LE(cost_m[2], 1.1 * cost_m[3]);    // with a third less of the search
    }
  }
  ASSERT_GE(compared, 2);
  EXPECT_LT(lattice_m, bit_star_m);
}

TEST(PlanLeg, SameArgumentsGiveTheSameRouteToTheLastBitAndAnotherSeedAnother) {
  const PlanningCase in(test::make_fractal_map(7, 250, 30.0, 3000.0, 600.0), kWeights);
  GlobalOptions options = shipped_global_options(30000);
  options.use_lattice = false;  // the lattice draws nothing, so it knows no seed
  const auto first = plan(in, options, in.above(1000, 1000), in.above(6500, 6000), 42);
  const auto again = plan(in, options, in.above(1000, 1000), in.above(6500, 6000), 42);
  const auto other = plan(in, options, in.above(1000, 1000), in.above(6500, 6000), 43);
  ASSERT_TRUE(std::holds_alternative<Route>(first));
  ASSERT_TRUE(std::holds_alternative<Route>(other));
  const Route& a = std::get<Route>(first);
  const Route& b = std::get<Route>(again);
  EXPECT_EQ(a.waypoints, b.waypoints);
  EXPECT_EQ(a.guide, b.guide);
  EXPECT_EQ(a.cost, b.cost);
  EXPECT_EQ(a.work_units, b.work_units);
  EXPECT_EQ(a.samples, b.samples);
  EXPECT_NE(a.waypoints, std::get<Route>(other).waypoints);
}

TEST(PlanLeg, MoreWorkNeverMakesTheSearchedRouteDearer) {
  const PlanningCase in(test::make_fractal_map(9, 250, 30.0, 3000.0, 400.0), kWeights);
  double before_m = std::numeric_limits<double>::infinity();
  for (const std::int64_t budget : {30000, 50000, 80000}) {
    const auto result =
        plan(in, shipped_global_options(budget), in.above(1000, 1000), in.above(6500, 6000));
    ASSERT_TRUE(std::holds_alternative<Route>(result));
    const double cost_m = std::get<Route>(result).cost.total_m();
    EXPECT_LE(cost_m, 1.02 * before_m);  // the shortcut scan does not know the same corners
    before_m = cost_m;
  }
}

TEST(PlanLeg, RiskWeightsLowerTheVisibilityOfTheRoute) {
  const PlanningCase in(test::make_fractal_map(21, 300, 30.0, 3000.0, 500.0), kWeights);
  const PlanningCase blind(test::make_fractal_map(21, 300, 30.0, 3000.0, 500.0), kLengthOnly);
  const GlobalOptions options = shipped_global_options(60000);
  const auto careful = plan(in, options, in.above(1000, 1000), in.above(8000, 7000));
  const auto careless = plan(blind, options, in.above(1000, 1000), in.above(8000, 7000));
  ASSERT_TRUE(std::holds_alternative<Route>(careful));
  ASSERT_TRUE(std::holds_alternative<Route>(careless));
  const auto visibility_m = [&](const auto& route) {
    return in.costs.route_cost(std::get<Route>(route).waypoints, 5.0).visibility_m;
  };
  EXPECT_LT(visibility_m(careful), 0.8 * visibility_m(careless));
}

TEST(PlanLeg, ProgressIsToldFromTheFirstBatchToTheFinishedRoute) {
  const PlanningCase in(test::make_fractal_map(9, 250, 30.0, 3000.0, 300.0), kWeights);
  const GlobalOptions options = shipped_global_options(30000);
  const SilentObserver observer;
  std::vector<RouteProgress> told;
  const auto result = plan_leg(
      in.costs, options, {in.above(1000, 1000), in.above(6500, 6000), 1, 30000},
      [&](const RouteProgress& progress) { told.push_back(progress); }, observer);
  ASSERT_TRUE(std::holds_alternative<Route>(result));
  ASSERT_GE(told.size(), 3U);
  EXPECT_EQ(told.front().best_cost_m, std::numeric_limits<double>::infinity());
  EXPECT_EQ(told.back().best_cost_m, std::get<Route>(result).cost.total_m());
  for (std::size_t k = 1; k < told.size(); ++k) {
    EXPECT_GE(told[k].work_units, told[k - 1].work_units);
    EXPECT_EQ(told[k].work_budget, 30000);
  }
}

class RouteThatContinues : public testing::TestWithParam<const char*> {};

// A circle of the turn radius from the heading on, then straight: the shortest way of a vehicle
// that may end with any heading (L. E. Dubins, 1957).
double turn_and_straight_m(double bearing_off_rad, double distance_m, double radius_m) {
  const double centre_x_m = distance_m * std::cos(bearing_off_rad);
  const double centre_y_m = distance_m * std::sin(bearing_off_rad) - radius_m;
  const double to_goal_m = std::hypot(centre_x_m, centre_y_m);
  const double straight_m = std::sqrt(to_goal_m * to_goal_m - radius_m * radius_m);
  const double turned_rad = std::atan2(centre_y_m, centre_x_m) + 0.5 * std::numbers::pi -
                            std::atan2(straight_m, radius_m);
  return radius_m * turned_rad + straight_m;
}

TEST_P(RouteThatContinues, LeavesAsItsLegBeforeAllowsAndTurnsWithinTheRadius) {
  PlanningCase in(test::make_map(400, 400, 30.0, [](double, double) { return 100.0; }),
                  kLengthOnly);
  GlobalOptions options = shipped_global_options(400000);
  options.use_lattice = std::string(GetParam()) != "bit_star";
  options.use_roadmap = std::string(GetParam()) == "roadmap";
  const SilentObserver observer;
  std::optional<Roadmap> roadmap;
  if (options.use_roadmap) {
    SilentObserver silent;
    roadmap.emplace(in.costs, options, silent);
  }
  const Waypoint start = in.above(6000, 6000);
  const Waypoint goal = in.above(10000, 6000);
  const double radius_m = options.turn_radius_m;
  for (const double off_deg : {0.0, 60.0, 120.0, 180.0}) {
    SCOPED_TRACE(off_deg);
    const double heading_rad = radians_from_degrees(off_deg);
    RouteProblem problem{start, goal, 1, options.work_budget, roadmap ? &*roadmap : nullptr};
    const double tolerance_rad = radians_from_degrees(10.0);
    const double lead_m = 2.0 * radius_m * std::tan(0.5 * tolerance_rad);
    problem.lead_in = LeadIn{lead_m * std::cos(heading_rad), lead_m * std::sin(heading_rad)};
    const auto result = plan_leg(in.costs, options, problem, {}, observer);
    ASSERT_TRUE(std::holds_alternative<Route>(result)) << std::get<NoPlan>(result).explanation;
    const auto& route = std::get<Route>(result);
    expect_lawful(in, options, route, start, goal);
    const Waypoint& next = route.waypoints[1];
    const double left_rad = std::atan2(next.y_m - start.y_m, next.x_m - start.x_m);
    EXPECT_LE(std::fabs(wrap_to_pi(left_rad - heading_rad)), tolerance_rad + 1e-9);
    // Corners lie outside of the arcs that round them off.
    const double shortest_m =
        turn_and_straight_m(std::max(heading_rad - tolerance_rad, 0.0), 4000.0, radius_m);
    EXPECT_GE(flight::length_m(route.waypoints), shortest_m - 1.0);
    EXPECT_LE(flight::length_m(route.waypoints), 1.12 * shortest_m);
  }
}

INSTANTIATE_TEST_SUITE_P(Planner, RouteThatContinues,
                         testing::Values("lattice", "bit_star", "roadmap"),
                         [](const auto& tested) { return std::string(tested.param); });

class StoppingObserver final : public Observer {
 public:
  explicit StoppingObserver(int questions) : questions_(questions) {}
  void progress(std::string_view, double, double) override {}
  void note(std::string_view) override {}
  [[nodiscard]] bool stop_requested() const override { return questions_-- <= 0; }

 private:
  mutable int questions_;
};

TEST(PlanLeg, AStopBeforeTheFirstRouteIsNamedAndLaterOnesKeepTheBest) {
  const PlanningCase in(test::make_fractal_map(9, 250, 30.0, 3000.0, 300.0), kWeights);
  const GlobalOptions options = shipped_global_options(1000000);
  const RouteProblem problem{in.above(1000, 1000), in.above(6500, 6000), 1, 1000000};
  for (const int questions : {0, 1}) {
    const auto stopped = plan_leg(in.costs, options, problem, {}, StoppingObserver(questions));
    ASSERT_TRUE(std::holds_alternative<NoPlan>(stopped));
    EXPECT_EQ(std::get<NoPlan>(stopped).cause, NoPlanCause::kStopped);
  }
  const auto late = plan_leg(in.costs, options, problem, {}, StoppingObserver(300));
  ASSERT_TRUE(std::holds_alternative<Route>(late));
  EXPECT_LT(std::get<Route>(late).work_units, 200000);
}

TEST(PlanLeg, AGoalBehindUnknownGroundIsProvedUnreachable) {
  map::Map map = test::make_map(200, 200, 30.0, [](double, double) { return 100.0; });
  for (int column = 0; column < 200; ++column) {
    for (int row = 98; row < 102; ++row) {
      map.terrain_m.at(column, row) = std::numeric_limits<float>::quiet_NaN();
    }
  }
  map.surface_m = map.terrain_m;
  test::finish_map(map);
  const PlanningCase in(std::move(map), kWeights);
  const auto result =
      plan(in, shipped_global_options(), in.above(3000, 1000), in.above(3000, 5000));
  ASSERT_TRUE(std::holds_alternative<NoPlan>(result));
  const NoPlan& no_plan = std::get<NoPlan>(result);
  EXPECT_EQ(no_plan.cause, NoPlanCause::kSearchSpaceDisconnected);
  ASSERT_TRUE(no_plan.place.has_value());
  EXPECT_NEAR(no_plan.place->x_m, 3000.0, 31.0);   // opposite the goal,
  EXPECT_NEAR(no_plan.place->y_m, 2900.0, 100.0);  // just south of the unknown strip from 2940 m
  EXPECT_THAT(no_plan.explanation, testing::HasSubstr("unknown ground"));
}

TEST(PlanLeg, ATableMountainHigherThanTheEnvelopeIsProvedUnreachable) {
  // Cliffs of 600 m around a plateau; the band is 130 m high.
  const PlanningCase in(
      test::make_map(200, 200, 30.0,
                     [](double x_m, double y_m) {
                       return std::hypot(x_m - 4000.0, y_m - 4000.0) < 900.0 ? 600.0 : 0.0;
                     }),
      kWeights);
  const auto result =
      plan(in, shipped_global_options(), in.above(1000, 1000), in.above(4000, 4000));
  ASSERT_TRUE(std::holds_alternative<NoPlan>(result));
  EXPECT_EQ(std::get<NoPlan>(result).cause, NoPlanCause::kSearchSpaceDisconnected);
  EXPECT_THAT(std::get<NoPlan>(result).explanation, testing::HasSubstr("another goal"));
}

TEST(PlanLeg, ASlopeTooSteepToClimbWithoutRoomToTurnExhaustsTheBudgetAndSaysSo) {
  // A straight valley wall of 45 deg, 1000 m high: connected cell by cell, but no route within
  // limits can climb it between the map's edges.
  const PlanningCase in(
      test::make_map(120, 120, 30.0,
                     [](double x_m, double) { return std::clamp(x_m - 1300.0, 0.0, 1000.0); }),
      kWeights);
  const auto result =
      plan(in, shipped_global_options(8000), in.above(700, 1800), in.above(2900, 1800));
  ASSERT_TRUE(std::holds_alternative<NoPlan>(result));
  EXPECT_EQ(std::get<NoPlan>(result).cause, NoPlanCause::kBudgetExhausted);
  EXPECT_THAT(std::get<NoPlan>(result).explanation, testing::HasSubstr("proves nothing"));
}

TEST(PlanLeg, BadEndsAreNamed) {
  map::Map map = test::make_map(200, 200, 30.0, [](double, double) { return 100.0; });
  map.terrain_m.at(100, 100) = std::numeric_limits<float>::quiet_NaN();
  map.surface_m = map.terrain_m;
  test::finish_map(map);
  const PlanningCase in(std::move(map), kWeights);
  const GlobalOptions options = shipped_global_options();
  const Waypoint good{1000.0, 1000.0, 115.24};
  const auto cause = [&](const Waypoint& start, const Waypoint& goal) {
    const auto result = plan(in, options, start, goal);
    EXPECT_TRUE(std::holds_alternative<NoPlan>(result));
    return std::holds_alternative<NoPlan>(result) ? std::get<NoPlan>(result).cause
                                                  : NoPlanCause::kStopped;
  };
  EXPECT_EQ(cause({-10.0, 500.0, 115.0}, good), NoPlanCause::kStartOutsideMap);
  EXPECT_EQ(cause(good, {7000.0, 500.0, 115.0}), NoPlanCause::kGoalOutsideMap);
  EXPECT_EQ(cause({3015.0, 3030.0, 115.0}, good), NoPlanCause::kStartUnknownTerrain);
  EXPECT_EQ(cause(good, {3015.0, 3030.0, 115.0}), NoPlanCause::kGoalUnknownTerrain);
  EXPECT_EQ(cause({2000.0, 2000.0, 99.0}, good), NoPlanCause::kStartBelowEnvelope);
  EXPECT_EQ(cause(good, {2000.0, 2000.0, 100.0}), NoPlanCause::kGoalBelowEnvelope);
  EXPECT_EQ(cause({2000.0, 2000.0, 251.0}, good), NoPlanCause::kStartAboveEnvelope);
  EXPECT_EQ(cause(good, {2000.0, 2000.0, 300.0}), NoPlanCause::kGoalAboveEnvelope);
  EXPECT_EQ(cause(good, {1000.0, 1000.0, 130.0}), NoPlanCause::kGoalEqualsStart);
}

TEST(GlobalOptions, EachValueOutOfRangeIsRefused) {
  const std::string text(shipped_config("planning.yaml"));
  for (const char* setting :
       {"global.envelope_floor_m=0", "global.envelope_ceiling_m=10", "global.lateral_margin_m=-1",
        "global.climb_angle_max_deg=0", "global.climb_angle_max_deg=80",
        "global.turn_angle_max_deg=0", "global.turn_angle_max_deg=190", "global.turn_radius_m=-5",
        "global.end_funnel_m=0", "global.check_step_m=0", "global.final_check_step_m=31",
        "global.guide_spacing_m=-50", "global.batch_size=0", "global.radius_factor=0",
        "global.radius_max_m=1", "global.work_budget=0"}) {
    auto reader = ConfigReader::from_text(set_config_value(text, setting), "planning.yaml");
    auto section = reader.required_section("global");
    EXPECT_THROW(read_global_options(section), ConfigError) << setting;
  }
}

TEST(LegGround, WithoutAvoidanceItPlansWhatThePlannerPlans) {
  const std::uint64_t seed = test::fresh_seed();
  const PlanningCase in(test::make_fractal_map(seed, 200, 60.0, 3000.0, 150.0), kWeights);
  const GlobalOptions options = shipped_global_options(3000000);
  const RouteProblem problem{in.above(2000.0, 2000.0), in.above(9500.0, 8500.0), 1,
                             options.work_budget};
  const SilentObserver observer;
  const auto wanted = plan_leg(in.costs, options, problem, {}, observer);
  const auto found = LegGround(in.costs, options, problem).plan(in.costs, {}, true, observer);
  if (!std::holds_alternative<Route>(wanted)) {
    GTEST_SKIP() << "no route over the ground of seed " << seed;
  }
  if (std::get<Route>(wanted).samples > 0) {
    EXPECT_TRUE(std::holds_alternative<NoPlan>(found)) << "a route of BIT*, seed " << seed;
    return;
  }
  ASSERT_TRUE(std::holds_alternative<Route>(found)) << seed;
  EXPECT_EQ(std::get<Route>(found).waypoints, std::get<Route>(wanted).waypoints) << seed;
  EXPECT_EQ(std::get<Route>(found).cost, std::get<Route>(wanted).cost) << seed;
}

TEST(LegGround, ARouteThatAvoidsAnotherLeavesItIsLawfulAndCostsAtLeastItsBound) {
  // GIVEN gentle ground where the straight line is the best route
  const PlanningCase in(test::make_map(200, 200, 60.0,
                                       [](double x_m, double y_m) {
                                         return 300.0 + 20.0 * std::sin(x_m / 900.0) *
                                                            std::cos(y_m / 700.0);
                                       }),
                        kWeights);
  const GlobalOptions options = shipped_global_options(3000000);
  const Waypoint start = in.above(1500.0, 6000.0);
  const Waypoint goal = in.above(10500.0, 6000.0);
  const LegGround ground(in.costs, options, {start, goal, 1, options.work_budget});
  const SilentObserver observer;
  const auto first = ground.plan(in.costs, {}, true, observer);
  ASSERT_TRUE(std::holds_alternative<Route>(first));
  const Route& direct = std::get<Route>(first);
  expect_lawful(in, options, direct, start, goal);
  // WHEN another keeps 600 m away from it where that is worth 4 a metre
  const auto second = ground.plan(in.costs, {{direct.waypoints, 600.0, 4.0}}, true, observer);
  ASSERT_TRUE(std::holds_alternative<Route>(second));
  const Route& aside = std::get<Route>(second);
  // THEN it does in its middle, as it must leave both ends, and its cost is that of eq. (1) alone
  expect_lawful(in, options, aside, start, goal);
  double middle_m = 0.0;
  for (const Waypoint& waypoint : aside.guide) {
    if (std::fabs(waypoint.x_m - 6000.0) < 500.0) {
      middle_m = std::max(middle_m, std::fabs(waypoint.y_m - 6000.0));
    }
  }
  EXPECT_GT(middle_m, 550.0);
  EXPECT_EQ(aside.cost, in.costs.route_cost(aside.waypoints, 1.0));
  EXPECT_LE(aside.lower_bound_m, direct.cost.total_m() + 1e-6) << "it binds the direct one too";
  EXPECT_GE(aside.cost.total_m(), direct.cost.total_m());
}

}  // namespace
}  // namespace hedgehop::global_planning
