#include "planning/planning.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <limits>
#include <numbers>

#include "base/angles.hpp"
#include "base/errors.hpp"
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

// Of a state from a route, seen from above.
double distance_m(const flight::FlightState& state, const std::vector<flight::Waypoint>& route) {
  double least_m = std::numeric_limits<double>::infinity();
  for (std::size_t i = 1; i < route.size(); ++i) {
    const double dx_m = route[i].x_m - route[i - 1].x_m;
    const double dy_m = route[i].y_m - route[i - 1].y_m;
    const double t =
        std::clamp(((state.x_m - route[i - 1].x_m) * dx_m + (state.y_m - route[i - 1].y_m) * dy_m) /
                       (dx_m * dx_m + dy_m * dy_m),
                   0.0, 1.0);
    least_m = std::min(least_m, std::hypot(state.x_m - route[i - 1].x_m - t * dx_m,
                                           state.y_m - route[i - 1].y_m - t * dy_m));
  }
  return least_m;
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

TEST_F(PlanningTest, RouteLeavesAlongTheHeadingThatIsAskedForAndTurnsOnlyThen) {
  for (const double azimuth_deg : {90.0, 180.0, 270.0}) {
    SCOPED_TRACE(azimuth_deg);
    request_.start_heading_true_rad = radians_from_degrees(azimuth_deg);
    const auto result = plan(request_);
    ASSERT_TRUE(std::holds_alternative<flight::Plan>(result));
    const auto& plan = std::get<flight::Plan>(result);
    EXPECT_TRUE(plan.verdict.is_verified);
    const std::vector<flight::Waypoint>& route = plan.route_plan.route.waypoints;
    const double convergence_rad = plan.trajectory.states.front().convergence_rad;
    const double left_rad =
        std::atan2(route[1].x_m - route[0].x_m, route[1].y_m - route[0].y_m) + convergence_rad;
    EXPECT_LE(std::fabs(wrap_to_pi(left_rad - *request_.start_heading_true_rad)),
              radians_from_degrees(12.1));
    // So the flight can keep to the route from the beginning.
    double aside_m = 0.0;
    for (std::size_t i = 0; i < 60 * 20; ++i) {
      aside_m = std::max(aside_m, distance_m(plan.trajectory.states[i], route));
    }
    EXPECT_LT(aside_m, 150.0);
  }
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

// The same hills 3.4 km higher, 35 degrees too hot, with all the mass there may be.
TEST_F(PlanningTest, HighHotAndHeavyFlightsClimbNoFasterThanTheirPower) {
  for (raster::Grid<float>* layer : {&map_.terrain_m, &map_.surface_m}) {
    for (float& height_m : layer->values()) {
      height_m += 3400.0F;
    }
  }
  test::finish_map(map_);
  request_.start.height_m = 60.0;
  request_.goal.height_m = 60.0;
  const std::vector<std::string> hot = {"global.work_budget=60000", "conditions.mass_kg=2910",
                                        "conditions.isa_deviation_k=25"};
  const auto planned = [&](bool is_power_used) {
    std::vector<std::string> settings = hot;
    settings.push_back(std::string("conditions.use_power_curve=") +
                       (is_power_used ? "true" : "false"));
    config_ = config_with(settings);
    const auto result = plan(request_);
    const auto* none = std::get_if<flight::NoPlan>(&result);
    EXPECT_EQ(none, nullptr) << (none == nullptr ? "" : none->explanation);
    return none == nullptr ? std::get<flight::Plan>(result) : flight::Plan{};
  };
  const auto steepest_up = [](const flight::Plan& plan) {
    double tangent = 0.0;
    const auto& points = plan.route_plan.route.waypoints;
    for (std::size_t i = 1; i < points.size(); ++i) {
      tangent = std::max(tangent, (points[i].altitude_m - points[i - 1].altitude_m) /
                                      std::hypot(points[i].x_m - points[i - 1].x_m,
                                                 points[i].y_m - points[i - 1].y_m));
    }
    return tangent;
  };
  const flight::Plan free = planned(false);
  const flight::Plan held = planned(true);
  const flight::PowerLimits& power = *config_.vehicle.power_limits;
  // What power leaves at the speed of the plan above its lowest ground.
  const double low_m = 3400.0 + 340.0;
  const double most_mps = power.rates(config_.speed_mps, low_m).climb_mps;
  ASSERT_LT(most_mps, 5.0);
  EXPECT_TRUE(held.verdict.is_verified) << held.verdict.violations.front().rule;
  EXPECT_LE(steepest_up(held), config_.local.climb_share * most_mps / config_.speed_mps);
  EXPECT_GT(steepest_up(free), 1.2 * steepest_up(held));
  EXPECT_GT(free.verdict.climb_rate_max_mps, held.verdict.climb_rate_max_mps);
  for (const flight::FlightState& state : held.trajectory.states) {
    const flight::VerticalRates rates = power.rates(state.speed_mps, state.altitude_m);
    ASSERT_LE(state.climb_rate_mps, rates.climb_mps);
    ASSERT_LE(-state.climb_rate_mps, rates.descent_mps);
  }
}

TEST_F(PlanningTest, WherePowerDoesNotEvenHoldTheLevelTheMissingKilowattsAreNamed) {
  for (raster::Grid<float>* layer : {&map_.terrain_m, &map_.surface_m}) {
    for (float& height_m : layer->values()) {
      height_m += 6500.0F;
    }
  }
  test::finish_map(map_);
  config_ = config_with({"conditions.use_power_curve=true", "conditions.mass_kg=2910",
                         "conditions.isa_deviation_k=25"});
  const auto result = plan(request_);
  const auto* none = std::get_if<flight::NoPlan>(&result);
  ASSERT_NE(none, nullptr);
  EXPECT_EQ(none->cause, flight::NoPlanCause::kClimbLimit);
  EXPECT_THAT(none->explanation, HasSubstr(" kW more at the rotor"));
  EXPECT_THAT(none->explanation, HasSubstr("2910 kg"));
}

TEST(PlanningConfigPower, AVehicleWithoutAPowerCurveIsRefusedWhereItIsAskedFor) {
  std::string text = effective_planning_config("", {"conditions.use_power_curve=true"});
  const std::size_t begin = text.find("\n  power:");
  ASSERT_NE(begin, std::string::npos);
  std::size_t end = text.find("\n", begin + 1);
  while (text.compare(end, 5, "\n    ") == 0) {
    end = text.find("\n", end + 1);
  }
  text.erase(begin, end - begin);
  try {
    read_planning_config(text, "mine");
    FAIL() << "accepted";
  } catch (const ConfigError& error) {
    EXPECT_THAT(error.what(), HasSubstr("`power`"));
  }
}

}  // namespace
}  // namespace hedgehop::planning
