#include "global_planning/warm_planner.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>
#include <random>

#include "global_planning/cost_field.hpp"
#include "global_planning/planning_case.hpp"
#include "global_planning/route_finish.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::global_planning {
namespace {

using flight::NoPlan;
using flight::Waypoint;
using test::shipped_global_options;

using test::kWeights;
constexpr double kSmallPatch_m = 150.0;

// A map whose visibility changes under its cost model.
struct ChangingCase {
  map::Map map;
  risk::CostModel costs;

  explicit ChangingCase(map::Map made)
      : map(std::move(made)),
        costs(map, kWeights, risk::SemanticCostTable({}, 0.0), 1.0, std::nullopt, kSmallPatch_m) {}
  ChangingCase(const ChangingCase&) = delete;
  ChangingCase& operator=(const ChangingCase&) = delete;

  [[nodiscard]] Waypoint above(double x_m, double y_m) const {
    return {x_m, y_m, raster::sample_bilinear(map.surface_m, {x_m, y_m}) + 15.24};
  }

  // Sets the visibility inside a disc.
  raster::Window set_disc(const geo::MapPoint& centre, double radius_m, double share) {
    const raster::GridGeometry& g = map.geometry;
    const auto clamped = [](int value, int count) { return std::clamp(value, 0, count - 1); };
    const raster::CellIndex low = g.cell_at({centre.x_m - radius_m, centre.y_m - radius_m});
    const raster::CellIndex high = g.cell_at({centre.x_m + radius_m, centre.y_m + radius_m});
    const int west = clamped(low.column, g.columns);
    const int south = clamped(low.row, g.rows);
    const raster::Window window{west, south, clamped(high.column, g.columns) - west + 1,
                                clamped(high.row, g.rows) - south + 1};
    for (int row = south; row < south + window.rows; ++row) {
      for (int column = west; column < west + window.columns; ++column) {
        const geo::MapPoint at = g.centre({column, row});
        if (std::hypot(at.x_m - centre.x_m, at.y_m - centre.y_m) <= radius_m) {
          map.visibility.at(column, row) = test::stored_visibility(share);
        }
      }
    }
    return window;
  }
};

TEST(WarmPlanner, AModelThatTookInAChangeIsTheModelOfTheChangedMap) {
  const std::uint64_t seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> place(-300.0, 3300.0);
  std::uniform_real_distribution<double> share(0.0, 1.0);
  ChangingCase in(test::make_fractal_map(seed, 100, 30.0, 700.0, 100.0));
  for (int i = 0; i < 5; ++i) {
    const raster::Window window =
        in.set_disc({place(random), place(random)}, 40.0 + 400.0 * share(random), share(random));
    const raster::Window reached = in.costs.visibility_changed(window);
    const risk::CostModel wanted(in.map, kWeights, risk::SemanticCostTable({}, 0.0), 1.0,
                                 std::nullopt, kSmallPatch_m);
    EXPECT_EQ(in.costs.visibility_layer().values(), wanted.visibility_layer().values()) << seed;
    for (int row = 0; row < 100; ++row) {
      for (int column = 0; column < 100; ++column) {
        ASSERT_EQ(*in.costs.visibilities({column, row}), *wanted.visibilities({column, row}))
            << seed;
      }
    }
    EXPECT_LE(reached.column, window.column);
    EXPECT_GE(reached.column + reached.columns, window.column + window.columns);
  }
}

TEST(WarmPlanner, ARepairedFieldIsTheFieldMadeAnewToTheLastBit) {
  const std::uint64_t seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> place(0.0, 6000.0);
  std::uniform_real_distribution<double> share(0.0, 1.0);
  map::Map map = test::make_fractal_map(seed, 200, 30.0, 1500.0, 200.0);
  for (int row = 80; row < 120; ++row) {  // ground that cannot be flown
    for (int column = 60; column < 75; ++column) {
      map.terrain_m.at(column, row) = map.surface_m.at(column, row) =
          std::numeric_limits<float>::quiet_NaN();
    }
  }
  test::finish_map(map);
  ChangingCase in(std::move(map));
  const GlobalOptions options = shipped_global_options();
  const FlightEnvelope envelope(in.costs, options, in.above(500.0, 500.0),
                                in.above(5500.0, 5200.0));
  CostField field(envelope, envelope.goal().point(), 60.0);
  std::size_t renewed = 0;
  for (int i = 0; i < 8; ++i) {
    // Some appear, some go, one lies on the goal.
    const geo::MapPoint centre =
        i == 3 ? envelope.goal().point() : geo::MapPoint{place(random), place(random)};
    const raster::Window window = in.set_disc(centre, 200.0 + 800.0 * share(random), share(random));
    renewed += field.repair(envelope, in.costs.visibility_changed(window));
    const CostField wanted(envelope, envelope.goal().point(), 60.0);
    for (double y_m = 30.0; y_m < 6000.0; y_m += 60.0) {
      for (double x_m = 30.0; x_m < 6000.0; x_m += 60.0) {
        ASSERT_EQ(field.cost_m({x_m, y_m}), wanted.cost_m({x_m, y_m}))
            << "seed " << seed << ", change " << i << " at " << x_m << " " << y_m;
      }
    }
  }
  EXPECT_GT(renewed, 0U) << seed;
}

TEST(WarmPlanner, AChangeBesideTheWayRenewsOnlyWhatLiesBehindIt) {
  // GIVEN a plain and a goal in the west
  ChangingCase in(test::make_map(300, 100, 60.0, [](double, double) { return 100.0; }));
  const GlobalOptions options = shipped_global_options();
  const FlightEnvelope envelope(in.costs, options, in.above(17000.0, 3000.0),
                                in.above(1000.0, 3000.0));
  CostField field(envelope, envelope.goal().point(), 60.0);
  // WHEN something is seen in the far east
  const std::size_t renewed = field.repair(
      envelope, in.costs.visibility_changed(in.set_disc({15000.0, 3000.0}, 1000.0, 0.8)));
  // THEN no more than the ground east of its western edge is renewed: 4 of 18 km
  EXPECT_GT(renewed, 200U);
  EXPECT_LT(renewed, field.block_count() * 4 / 18);
  EXPECT_EQ(field.repair(envelope, {0, 0, 300, 100}), 0U) << "nothing has changed since";
}

TEST(WarmPlanner, LegsThroughADiscCostOtherwiseThanBeforeAndLegsAcrossTheCornersOfItsSquareDoNot) {
  // GIVEN a plain whose middle is seen within 1500 m
  ChangingCase in(test::make_map(100, 100, 60.0, [](double, double) { return 100.0; }));
  const FlightEnvelope envelope(in.costs, shipped_global_options(), in.above(500.0, 500.0),
                                in.above(5500.0, 5500.0));
  const CostField before(envelope, envelope.goal().point(), 60.0);
  CostField after = before;
  after.repair(envelope, in.costs.visibility_changed(in.set_disc({3000.0, 3000.0}, 1500.0, 0.8)));
  // THEN only what meets the disc has become another leg
  EXPECT_TRUE(before.costs_as(before, {500.0, 500.0}, {5500.0, 5500.0}));
  EXPECT_FALSE(after.costs_as(before, {3000.0, 3000.0}, {3010.0, 3000.0}));
  EXPECT_FALSE(after.costs_as(before, {500.0, 3000.0}, {5500.0, 3000.0})) << "both ends outside";
  EXPECT_TRUE(after.costs_as(before, {1500.0, 2000.0}, {2000.0, 1500.0}));
  EXPECT_TRUE(after.costs_as(before, {4400.0, 4400.0}, {4490.0, 4490.0}));
  EXPECT_TRUE(after.costs_as(before, {500.0, 4650.0}, {5500.0, 4650.0}));
}

TEST(WarmPlanner, TheWayDownTheFieldCostsWhatTheFieldSays) {
  const std::uint64_t seed = test::fresh_seed();
  ChangingCase in(test::make_fractal_map(seed, 150, 60.0, 1500.0, 100.0));
  const FlightEnvelope envelope(in.costs, shipped_global_options(), in.above(900.0, 900.0),
                                in.above(8000.0, 7500.0));
  const CostField field(envelope, envelope.goal().point(), 60.0);
  const std::vector<geo::MapPoint> way = field.way_from(envelope.start().point());
  ASSERT_GE(way.size(), 2U);
  double sum_m = 0.0;
  for (std::size_t i = 1; i < way.size(); ++i) {
    const auto density = [&](const geo::MapPoint& at) {
      return envelope.low_density(envelope.geometry().cell_at(at));
    };
    sum_m += 0.5 * (density(way[i - 1]) + density(way[i])) *
             std::hypot(way[i].x_m - way[i - 1].x_m, way[i].y_m - way[i - 1].y_m);
  }
  EXPECT_NEAR(field.cost_m(way.front()) * 1.0275, sum_m, 1e-4 * sum_m) << seed;
  EXPECT_TRUE(field.way_from({-100.0, 0.0}).empty());
}

class WarmPlannerOnHills : public ::testing::Test {
 protected:
  // Gentle ground of 15 x 9 km where a route exists for sure.
  WarmPlannerOnHills()
      : in_([] {
          map::Map map = test::make_map(250, 150, 60.0, [](double x_m, double y_m) {
            return 300.0 + 25.0 * std::sin(x_m / 800.0) * std::cos(y_m / 650.0);
          });
          map.visibility = raster::Grid<std::uint16_t>(map.geometry, test::stored_visibility(0.1));
          test::finish_map(map);
          return map;
        }()),
        options_(shipped_global_options(3000000)),
        problem_{in_.above(1500.0, 4500.0), in_.above(13500.0, 4500.0), 1, options_.work_budget} {
    const auto planned = plan_leg(in_.costs, options_, problem_, {}, observer_);
    route_ = std::get<flight::Route>(planned).waypoints;
  }

  void expect_valid(const WarmRoute& warm, const Waypoint& start) {
    const std::vector<Waypoint>& line = warm.route.waypoints;
    const risk::CostModel costs(in_.map, kWeights, risk::SemanticCostTable({}, 0.0), 1.0,
                                std::nullopt, kSmallPatch_m);
    const FlightEnvelope envelope(costs, options_, start, problem_.goal);
    EXPECT_EQ(line.front(), start);
    EXPECT_EQ(line.back(), problem_.goal);
    for (std::size_t i = 1; i < line.size(); ++i) {
      EXPECT_TRUE(envelope.is_clear(line[i - 1], line[i])) << i;
    }
    EXPECT_TRUE(are_turns_allowed(envelope, line));
    // It claims no less than it costs on the changed map.
    EXPECT_EQ(warm.route.cost, costs.route_cost(line, 1.0));
    EXPECT_LE(warm.route.lower_bound_m, warm.route.cost.total_m());
  }
  // The place of the route at a share of its legs.
  [[nodiscard]] Waypoint on_route(double share) const {
    double left_m = share * flight::length_m(route_);
    for (std::size_t i = 1; i < route_.size(); ++i) {
      const double leg_m = flight::length_m({route_[i - 1], route_[i]});
      if (left_m < leg_m) {
        const double t = left_m / leg_m;
        return {route_[i - 1].x_m + t * (route_[i].x_m - route_[i - 1].x_m),
                route_[i - 1].y_m + t * (route_[i].y_m - route_[i - 1].y_m),
                route_[i - 1].altitude_m + t * (route_[i].altitude_m - route_[i - 1].altitude_m)};
      }
      left_m -= leg_m;
    }
    return route_.back();
  }

  SilentObserver observer_;
  ChangingCase in_;
  GlobalOptions options_;
  RouteProblem problem_;
  std::vector<Waypoint> route_;
};

TEST_F(WarmPlannerOnHills, AThreatOnTheRouteIsFlownAroundFromWhereTheAircraftIs) {
  WarmPlanner planner(in_.costs, options_, problem_, route_);
  const Waypoint start = on_route(0.15);
  const geo::MapPoint threat = on_route(0.6).point();
  planner.costs_changed(in_.costs.visibility_changed(in_.set_disc(threat, 1200.0, 0.9)));
  const auto found = planner.replan(start, observer_);
  ASSERT_TRUE(std::holds_alternative<WarmRoute>(found));
  const WarmRoute& warm = std::get<WarmRoute>(found);
  expect_valid(warm, start);
  EXPECT_FALSE(warm.is_cold);
  EXPECT_GT(warm.blocks_renewed, 0U);
  double nearest_m = 1e9;
  for (const Waypoint& point : warm.route.guide) {
    nearest_m = std::min(nearest_m, std::hypot(point.x_m - threat.x_m, point.y_m - threat.y_m));
  }
  EXPECT_GT(nearest_m, 1000.0) << "a metre inside costs twenty times one outside";
  // Its own polish and the plan made anew are hardly better.
  const auto cold =
      plan_leg(in_.costs, options_, {start, problem_.goal, 1, options_.work_budget}, {}, observer_);
  ASSERT_TRUE(std::holds_alternative<flight::Route>(cold));
  EXPECT_LE(warm.route.cost.total_m(), 1.05 * std::get<flight::Route>(cold).cost.total_m());
}

TEST_F(WarmPlannerOnHills, AroundANearThreatTheRouteIsAsGoodAsAColdOneForAnyNumberOfThreads) {
  const Waypoint start = on_route(0.05);
  const geo::MapPoint threat = on_route(0.35).point();
  const raster::Window changed = in_.costs.visibility_changed(in_.set_disc(threat, 900.0, 0.9));
  std::vector<std::vector<Waypoint>> routes;
  for (const std::size_t threads : {1U, 2U}) {
    const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism,
                                            threads);
    in_.set_disc(threat, 900.0, 0.1);
    in_.costs.visibility_changed(changed);
    WarmPlanner planner(in_.costs, options_, problem_, route_);
    in_.set_disc(threat, 900.0, 0.9);
    planner.costs_changed(in_.costs.visibility_changed(changed));
    const auto found = planner.replan(start, observer_);
    ASSERT_TRUE(std::holds_alternative<WarmRoute>(found));
    EXPECT_FALSE(std::get<WarmRoute>(found).is_cold);
    routes.push_back(std::get<WarmRoute>(found).route.waypoints);
  }
  EXPECT_EQ(routes[0], routes[1]);
  const auto cold =
      plan_leg(in_.costs, options_, {start, problem_.goal, 1, options_.work_budget}, {}, observer_);
  ASSERT_TRUE(std::holds_alternative<flight::Route>(cold));
  EXPECT_LE(in_.costs.route_cost(routes[0], 1.0).total_m(),
            1.05 * std::get<flight::Route>(cold).cost.total_m());
}

TEST_F(WarmPlannerOnHills, WithoutAChangeTheRestOfTheRouteStaysAsItIs) {
  WarmPlanner planner(in_.costs, options_, problem_, route_);
  const Waypoint start = on_route(0.3);
  const auto found = planner.replan(start, observer_);
  ASSERT_TRUE(std::holds_alternative<WarmRoute>(found));
  const WarmRoute& warm = std::get<WarmRoute>(found);
  expect_valid(warm, start);
  EXPECT_EQ(warm.blocks_renewed, 0U);
  EXPECT_EQ(warm.route.waypoints[warm.route.waypoints.size() - 2], route_[route_.size() - 2]);
}

TEST_F(WarmPlannerOnHills, AnAircraftBesideTheRouteJoinsItAndAThreatThatGoesBringsItBack) {
  WarmPlanner planner(in_.costs, options_, problem_, route_);
  const Waypoint near = on_route(0.2);
  const Waypoint start = in_.above(near.x_m, near.y_m + 500.0);
  const auto beside = planner.replan(start, observer_);
  ASSERT_TRUE(std::holds_alternative<WarmRoute>(beside));
  expect_valid(std::get<WarmRoute>(beside), start);
  const double quiet_m = std::get<WarmRoute>(beside).route.cost.total_m();

  const geo::MapPoint threat = on_route(0.6).point();
  planner.costs_changed(in_.costs.visibility_changed(in_.set_disc(threat, 1200.0, 0.9)));
  const auto around = planner.replan(start, observer_);
  ASSERT_TRUE(std::holds_alternative<WarmRoute>(around));
  expect_valid(std::get<WarmRoute>(around), start);
  EXPECT_GT(std::get<WarmRoute>(around).route.cost.total_m(), quiet_m);

  planner.costs_changed(in_.costs.visibility_changed(in_.set_disc(threat, 1200.0, 0.1)));
  const auto back = planner.replan(start, observer_);
  ASSERT_TRUE(std::holds_alternative<WarmRoute>(back));
  expect_valid(std::get<WarmRoute>(back), start);
  EXPECT_LT(std::get<WarmRoute>(back).route.cost.total_m(), 1.02 * quiet_m);
}

TEST_F(WarmPlannerOnHills, AStartInsideTheGroundIsNamedAsThePlannerDoes) {
  WarmPlanner planner(in_.costs, options_, problem_, route_);
  Waypoint start = on_route(0.3);
  start.altitude_m -= 200.0;
  const auto found = planner.replan(start, observer_);
  ASSERT_TRUE(std::holds_alternative<NoPlan>(found));
  EXPECT_EQ(std::get<NoPlan>(found).cause, flight::NoPlanCause::kStartBelowEnvelope);
}

}  // namespace
}  // namespace hedgehop::global_planning
