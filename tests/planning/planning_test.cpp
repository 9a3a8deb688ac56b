#include "planning/planning.hpp"

#include <cmath>
#include <cstring>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>

#include "base/angles.hpp"
#include "support/test_map.hpp"
#include "support/utm_map.hpp"

namespace hedgehop::planning {
namespace {

using ::testing::HasSubstr;

// 18 x 12 km of rolling hills, 120 m of relief, slopes up to 9 degrees, in UTM zone 32.
map::Map rolling_hills() {
  map::Map map = test::make_map(600, 400, 30.0, [](double x_m, double y_m) {
    return 400.0 + 30.0 * std::sin(x_m / 700.0) + 30.0 * std::cos(y_m / 600.0);
  });
  test::place_in_utm(map);
  map.visibility = raster::Grid<std::uint16_t>(map.geometry, test::stored_visibility(0.1));
  test::finish_map(map);
  return map;
}

flight::RequestPoint place(const map::Map& map, double east_m, double north_m,
                           std::optional<double> height_m = std::nullopt) {
  const geo::MapProjection projection(map.crs_wkt);
  return {projection.to_geodetic({test::kUtmWest_m + east_m, test::kUtmSouth_m + north_m}),
          height_m};
}

PlanningConfig config_with(const std::vector<std::string>& settings) {
  return read_planning_config(effective_planning_config("", settings), "test");
}

class PlanningTest : public ::testing::Test {
 protected:
  std::variant<flight::Plan, flight::NoPlan> plan(const flight::PlanRequest& request) {
    SilentObserver observer;
    return hedgehop::planning::plan(map_, request, config_, {}, observer);
  }
  flight::NoPlanCause cause(const flight::PlanRequest& request) {
    const auto result = plan(request);
    const auto* no_plan = std::get_if<flight::NoPlan>(&result);
    EXPECT_NE(no_plan, nullptr);
    if (no_plan == nullptr) {
      return flight::NoPlanCause::kStopped;
    }
    EXPECT_FALSE(no_plan->explanation.empty());
    return no_plan->cause;
  }

  map::Map map_ = rolling_hills();
  PlanningConfig config_ = config_with({"global.work_budget=60000"});
  flight::PlanRequest request_{.start = place(map_, 3000.0, 3000.0),
                               .goal = place(map_, 14000.0, 9000.0),
                               .via = {},
                               .start_heading_true_rad = {},
                               .speed_mps = {},
                               .seed = 1,
                               .work_budget = 0};
};

TEST_F(PlanningTest, FlightOverRollingHillsIsVerifiedAndEndsAtTheGoal) {
  const auto result = plan(request_);

  ASSERT_TRUE(std::holds_alternative<flight::Plan>(result))
      << std::get<flight::NoPlan>(result).explanation;
  const auto& plan = std::get<flight::Plan>(result);
  EXPECT_TRUE(plan.verdict.is_verified) << plan.verdict.violation_count;
  const double distance_m =
      std::hypot(plan.trajectory.states.back().x_m - plan.route_plan.goal.x_m,
                 plan.trajectory.states.back().y_m - plan.route_plan.goal.y_m);
  EXPECT_LE(distance_m, config_.demands.goal_radius_m);
  EXPECT_GE(plan.measures.length_m, std::hypot(11000.0, 6000.0) - config_.demands.goal_radius_m);
}

TEST_F(PlanningTest, SameRequestGivesTheSameFlightTwice) {
  const auto first = plan(request_);
  const auto second = plan(request_);

  const auto& a = std::get<flight::Plan>(first).trajectory.states;
  const auto& b = std::get<flight::Plan>(second).trajectory.states;
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    ASSERT_EQ(std::memcmp(&a[i], &b[i], sizeof a[i]), 0) << i;
  }
}

TEST_F(PlanningTest, StartOrGoalInsideANoFlyAreaIsRefusedWithItsName) {
  map::Area area;
  area.name = "ED-R 7";
  area.floor = {-std::numeric_limits<double>::infinity(), map::AreaLimit::Reference::kAmsl};
  area.ceiling = {2000.0, map::AreaLimit::Reference::kAmsl};
  const auto corner = [](double east_m, double north_m) {
    return geo::MapPoint{test::kUtmWest_m + east_m, test::kUtmSouth_m + north_m};
  };
  area.polygons = {{{corner(2000, 2000), corner(4000, 2000), corner(4000, 4000), corner(2000, 4000),
                     corner(2000, 2000)},
                    {}}};
  map_.areas = {area};
  test::finish_map(map_);
  const auto result = plan(request_);
  ASSERT_TRUE(std::holds_alternative<flight::NoPlan>(result));
  const auto& no_plan = std::get<flight::NoPlan>(result);
  EXPECT_EQ(no_plan.cause, flight::NoPlanCause::kStartInsideArea);
  EXPECT_THAT(no_plan.explanation, HasSubstr("no-fly area 'ED-R 7'"));
  std::swap(request_.start, request_.goal);
  EXPECT_EQ(cause(request_), flight::NoPlanCause::kGoalInsideArea);
  // Below its floor, or if it only costs, there is nothing to refuse.
  map_.areas[0].floor.value_m = 1500.0;
  test::finish_map(map_);
  EXPECT_TRUE(std::holds_alternative<flight::Plan>(plan(request_)));
  map_.areas[0].floor.value_m = 0.0;
  map_.areas[0].is_hard = false;
  test::finish_map(map_);
  EXPECT_TRUE(std::holds_alternative<flight::Plan>(plan(request_)));
}

TEST_F(PlanningTest, RouteWithViaPointPassesIt) {
  request_.via = {place(map_, 4000.0, 9000.0)};

  const auto result = plan(request_);

  ASSERT_TRUE(std::holds_alternative<flight::Plan>(result));
  double nearest_m = 1e9;
  for (const flight::Waypoint& waypoint :
       std::get<flight::Plan>(result).route_plan.route.waypoints) {
    nearest_m = std::min(nearest_m, std::hypot(waypoint.x_m - test::kUtmWest_m - 4000.0,
                                               waypoint.y_m - test::kUtmSouth_m - 9000.0));
  }
  EXPECT_LT(nearest_m, 0.01);
}

TEST_F(PlanningTest, RoundTripIsFlownToItsViaPointAndBack) {
  request_.goal = request_.start;
  request_.via = {place(map_, 9000.0, 6000.0)};
  const auto result = plan(request_);
  ASSERT_TRUE(std::holds_alternative<flight::Plan>(result));
  const auto& plan = std::get<flight::Plan>(result);
  EXPECT_TRUE(plan.verdict.is_verified) << plan.verdict.violations.front().rule;
  EXPECT_GT(plan.measures.length_m, 2.0 * (std::hypot(6000.0, 3000.0) - 250.0));
}

TEST_F(PlanningTest, FlightDoesNotEndWhereItComesByItsGoalOnTheWayToAViaPoint) {
  // The goal lies on the straight line to the via point.
  request_.goal = place(map_, 7000.0, 5000.0);
  request_.via = {place(map_, 11000.0, 7000.0)};
  const auto result = plan(request_);
  ASSERT_TRUE(std::holds_alternative<flight::Plan>(result));
  const auto& plan = std::get<flight::Plan>(result);
  EXPECT_TRUE(plan.verdict.is_verified) << plan.verdict.violations.front().rule;
  EXPECT_GT(plan.measures.length_m,
            std::hypot(8000.0, 4000.0) + std::hypot(4000.0, 2000.0) - 600.0);
}

TEST_F(PlanningTest, ViaPointWithAHeightIsNotFlownBelowByTheVerticalPass) {
  request_.via = {place(map_, 4000.0, 9000.0, 70.0)};
  const auto result = plan(request_);
  ASSERT_TRUE(std::holds_alternative<flight::Plan>(result));
  const auto& plan = std::get<flight::Plan>(result);
  const flight::FlightState* nearest = nullptr;
  double nearest_m = 1e9;
  for (const flight::FlightState& state : plan.trajectory.states) {
    const double distance_m =
        std::hypot(state.x_m - test::kUtmWest_m - 4000.0, state.y_m - test::kUtmSouth_m - 9000.0);
    if (distance_m < nearest_m) {
      nearest_m = distance_m;
      nearest = &state;
    }
  }
  ASSERT_NE(nearest, nullptr);
  // Not the full 70 m: the corner is cut, where the route is lower.
  EXPECT_GT(nearest->altitude_m - nearest->surface_m, 50.0);
  EXPECT_LT(plan.measures.mean_height_m, 45.0) << "and low elsewhere";
}

TEST_F(PlanningTest, HeadingsAreTrueAndDifferFromGridByTheConvergence) {
  const auto result = plan(request_);

  // East of the central meridian grid north lies east of true north, so the convergence is
  // positive.
  const auto& plan = std::get<flight::Plan>(result);
  const flight::FlightState& a = plan.trajectory.states[100];
  const flight::FlightState& b = plan.trajectory.states[101];
  const double azimuth_grid_rad = std::atan2(b.x_m - a.x_m, b.y_m - a.y_m);
  EXPECT_GT(a.convergence_rad, radians_from_degrees(0.5));
  EXPECT_NEAR(wrap_to_pi(a.heading_true_rad - a.convergence_rad - azimuth_grid_rad), 0.0, 0.02);
}

TEST_F(PlanningTest, EndsThatCannotBeFlownAreNamed) {
  auto request = request_;
  request.start = place(map_, -500.0, 3000.0);
  EXPECT_EQ(cause(request), flight::NoPlanCause::kStartOutsideMap);

  request = request_;
  request.goal = place(map_, 3000.0, 12500.0);
  EXPECT_EQ(cause(request), flight::NoPlanCause::kGoalOutsideMap);

  request = request_;
  request.start = place(map_, 3000.0, 3000.0, -5.0);
  EXPECT_EQ(cause(request), flight::NoPlanCause::kStartBelowEnvelope);

  request = request_;
  request.start = place(map_, 3000.0, 3000.0, 900.0);
  EXPECT_EQ(cause(request), flight::NoPlanCause::kStartAboveEnvelope);

  request = request_;
  request.goal = request.start;
  EXPECT_EQ(cause(request), flight::NoPlanCause::kGoalEqualsStart);
}

TEST_F(PlanningTest, VoidUnderTheStartIsNamed) {
  const raster::CellIndex cell =
      map_.geometry.cell_at({test::kUtmWest_m + 3000.0, test::kUtmSouth_m + 3000.0});
  map_.terrain_m.at(cell) = std::numeric_limits<float>::quiet_NaN();
  map_.surface_m.at(cell) = std::numeric_limits<float>::quiet_NaN();
  test::finish_map(map_);

  EXPECT_EQ(cause(request_), flight::NoPlanCause::kStartUnknownTerrain);
}

TEST_F(PlanningTest, SpeedThatTheVehicleDoesNotFlyIsRefused) {
  request_.speed_mps = 120.0;

  EXPECT_THROW(plan(request_), UsageError);
}

TEST_F(PlanningTest, MapForAnotherReferenceHeightIsRefused) {
  map_.reference_height_m = 30.0;
  test::finish_map(map_);

  EXPECT_EQ(cause(request_), flight::NoPlanCause::kReferenceHeightMismatch);
}

TEST_F(PlanningTest, AnExposureVolumeServesOtherReferenceHeights) {
  map_.reference_height_m = 30.0;
  map_.further_visibility = {
      {10.0, raster::Grid<std::uint16_t>(map_.geometry, test::stored_visibility(0.05))}};
  test::finish_map(map_);
  SilentObserver observer;

  const auto route = plan_route(map_, request_, config_, {}, observer);  // for 15.24 m

  EXPECT_TRUE(std::holds_alternative<flight::RoutePlan>(route));
}

TEST_F(PlanningTest, RouteOfAnotherMapIsRefused) {
  SilentObserver observer;
  const auto route = plan_route(map_, request_, config_, {}, observer);
  ASSERT_TRUE(std::holds_alternative<flight::RoutePlan>(route));
  map_.label = "another";
  test::finish_map(map_);

  EXPECT_THROW(plan_flight(map_, std::get<flight::RoutePlan>(route), config_, {}, observer),
               DataError);
}

}  // namespace
}  // namespace hedgehop::planning
