#include "planning/reaction.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <random>

#include "base/angles.hpp"
#include "planning/route_flight.hpp"
#include "support/fresh_seed.hpp"
#include "support/shipped_options.hpp"
#include "support/test_map.hpp"
#include "support/utm_map.hpp"

namespace hedgehop::planning {
namespace {

const ReactionOptions kOptions{60.0, 20.0 * kDegree_rad};

// 12 x 6 km of hills in UTM zone 32, and a plan across them from west to east.
class ReactionTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    map_ = new map::Map(test::make_map(400, 200, 30.0, [](double x_m, double y_m) {
      return 400.0 + 20.0 * (std::sin(x_m / 500.0) + std::cos(y_m / 400.0));
    }));
    test::place_in_utm(*map_);
    test::finish_map(*map_);
    config_ = new PlanningConfig(test::shipped_planning());
    RouteTask task;
    for (double x_m = 1500.0; x_m <= 10500.0; x_m += 50.0) {
      const geo::MapPoint point = at(x_m, 3000.0);
      task.guide.push_back(
          {point.x_m, point.y_m, raster::sample_bilinear(map_->surface_m, point) + 40.0});
    }
    task.start = task.guide.front();
    task.goal = task.guide.back();
    task.held = {task.goal};
    task.speed_mps = config_->speed_mps;
    task.initial =
        local_planning::state_at_start(task.guide, task.speed_mps, config_->vehicle.limits);
    SilentObserver observer;
    auto flown = fly_route(cost_model(*map_, *config_), *config_, task, {}, observer);
    plan_ = new RouteFlight(std::get<RouteFlight>(std::move(flown)));
  }
  static void TearDownTestSuite() {
    delete plan_;
    delete config_;
    delete map_;
  }

  static geo::MapPoint at(double x_m, double y_m) {
    return {test::kUtmWest_m + x_m, test::kUtmSouth_m + y_m};
  }
  static double math_rad(double true_rad, const flight::FlightState& state) {
    return math_angle_from_azimuth_rad(grid_from_true_azimuth_rad(true_rad, state.convergence_rad));
  }
  static FlightUnderPlan flight_at(std::size_t step) {
    const flight::FlightState& state = plan_->trajectory.states.at(step);
    FlightUnderPlan flight;
    flight.plan = &plan_->trajectory;
    flight.step = step;
    flight.state =
        command_model::trimmed_state(state.x_m, state.y_m, state.altitude_m, state.speed_mps,
                                     math_rad(state.heading_true_rad, state), state.climb_rate_mps);
    flight.commanded_heading_math_rad = math_rad(state.commanded_heading_true_rad, state);
    return flight;
  }
  static std::size_t step_ahead(std::size_t step, double ahead_m) {
    const auto& states = plan_->trajectory.states;
    while (std::hypot(states[step].x_m - states[0].x_m, states[step].y_m - states[0].y_m) <
           ahead_m) {
      ++step;
    }
    return step;
  }

  // Every cell that the cylinder touches stands as high as its top.
  static map::Map with_tower(const geo::MapPoint& place, double radius_m, double height_m) {
    map::Map map = *map_;
    const double reach_m = radius_m + map.geometry.cell_m;
    const auto top_m = static_cast<float>(raster::sample_bilinear(map.surface_m, place) + height_m);
    for (int row = 0; row < map.geometry.rows; ++row) {
      for (int column = 0; column < map.geometry.columns; ++column) {
        const geo::MapPoint centre = map.geometry.centre({column, row});
        if (std::hypot(centre.x_m - place.x_m, centre.y_m - place.y_m) <= reach_m) {
          map.surface_m.at(column, row) = std::max(map.surface_m.at(column, row), top_m);
        }
      }
    }
    map::Obstacle tower;
    tower.point = place;
    tower.radius_m = radius_m;
    tower.height_m = height_m;
    tower.top_m = static_cast<double>(top_m);
    map.obstacles.push_back(tower);
    return map;
  }

  // From the present state on, with commanded headings that never jump.
  static void expect_smooth(const Reaction& reaction, const FlightUnderPlan& flight) {
    const auto& states = reaction.trajectory.states;
    ASSERT_GE(states.size(), 2U);
    EXPECT_EQ(states[0].x_m, flight.state.x_m);
    EXPECT_EQ(states[0].y_m, flight.state.y_m);
    EXPECT_EQ(states[0].altitude_m, flight.state.altitude_m);
    double before_rad = flight.commanded_heading_math_rad;
    const double limit_rad = kOptions.heading_rate_max_radps * reaction.trajectory.step_s + 1e-9;
    for (const flight::FlightState& state : states) {
      const double now_rad = math_rad(state.commanded_heading_true_rad, state);
      ASSERT_LE(std::fabs(wrap_to_pi(now_rad - before_rad)), limit_rad) << state.time_s;
      before_rad = now_rad;
    }
  }

  static map::Map* map_;
  static PlanningConfig* config_;
  static RouteFlight* plan_;
};
map::Map* ReactionTest::map_ = nullptr;
PlanningConfig* ReactionTest::config_ = nullptr;
RouteFlight* ReactionTest::plan_ = nullptr;

TEST_F(ReactionTest, ThePlanStandsWhileNothingIsInItsWay) {
  ASSERT_TRUE(plan_->verdict.is_verified);
  const Reaction reaction = reaction_to(with_tower(at(3500.0, 4000.0), 30.0, 150.0), *config_,
                                        kOptions, flight_at(200), false);
  EXPECT_EQ(reaction.kind, ReactionKind::kNone);
  EXPECT_TRUE(reaction.is_plan_verified);
  EXPECT_TRUE(reaction.trajectory.states.empty());
}

TEST_F(ReactionTest, ATowerOnThePlanIsFlownAroundFromThePresentStateOn) {
  std::mt19937_64 random(test::fresh_seed());
  std::uniform_real_distribution<double> share(0.0, 1.0);
  for (int i = 0; i < 4; ++i) {
    const auto step = static_cast<std::size_t>(1500.0 * share(random));
    const FlightUnderPlan flight = flight_at(step);
    const double travelled_m = std::hypot(flight.state.x_m - plan_->trajectory.states[0].x_m,
                                          flight.state.y_m - plan_->trajectory.states[0].y_m);
    const geo::MapPoint place =
        plan_->trajectory.states[step_ahead(step, travelled_m + 450.0 + 1000.0 * share(random))]
            .point();
    const double radius_m = 50.0 * share(random);
    const map::Map map = with_tower(place, radius_m, 200.0);
    const Reaction reaction = reaction_to(map, *config_, kOptions, flight, false);
    EXPECT_FALSE(reaction.is_plan_verified);
    EXPECT_TRUE(reaction.kind == ReactionKind::kAround || reaction.kind == ReactionKind::kWayOut)
        << name_of(reaction.kind);
    expect_smooth(reaction, flight);
    EXPECT_TRUE(reaction.verdict.is_verified);
    for (const flight::FlightState& state : reaction.trajectory.states) {
      ASSERT_GT(std::hypot(state.x_m - place.x_m, state.y_m - place.y_m), radius_m + 10.0)
          << "200 m high is more than can be climbed in " << state.time_s << " s";
    }
  }
}

TEST_F(ReactionTest, AnAreaAcrossTheWholeWayIsNotEntered) {
  map::Map map = *map_;
  map::Area area;
  area.kind = "no_fly";
  area.floor.value_m = -1e5;
  area.ceiling.value_m = 1e5;
  area.polygons.push_back(
      {{at(4000.0, 0.0), at(4400.0, 0.0), at(4400.0, 6000.0), at(4000.0, 6000.0), at(4000.0, 0.0)},
       {}});
  map.areas.push_back(area);
  const FlightUnderPlan flight = flight_at(1000);  // 900 m before it
  ASSERT_LT(flight.state.x_m, test::kUtmWest_m + 3600.0);
  const Reaction reaction = reaction_to(map, *config_, kOptions, flight, false);
  EXPECT_NE(reaction.kind, ReactionKind::kNone);
  expect_smooth(reaction, flight);
  EXPECT_TRUE(reaction.verdict.is_verified);
  for (const flight::FlightState& state : reaction.trajectory.states) {
    ASSERT_LT(state.x_m, test::kUtmWest_m + 4000.0) << state.time_s;
  }
  // It ends high enough to circle: minutes for whoever plans again.
  EXPECT_LT(reaction.way_out_step, reaction.trajectory.states.size());
  EXPECT_GE(reaction.trajectory.states.back().time_s, kCircling_s);
}

TEST_F(ReactionTest, WhereIsSeenMoreIsFlownAroundIfThatCostsLess) {
  const FlightUnderPlan flight = flight_at(600);
  const auto seen = [&](double share) {
    map::Map map = *map_;
    for (int row = 0; row < map.geometry.rows; ++row) {
      for (int column = 0; column < map.geometry.columns; ++column) {
        const geo::MapPoint centre = map.geometry.centre({column, row});
        if (std::hypot(centre.x_m - flight.state.x_m - 1400.0,
                       centre.y_m - flight.state.y_m + 350.0) < 450.0) {
          map.visibility.at(column, row) = test::stored_visibility(share);
        }
      }
    }
    return map;
  };
  const Reaction reaction = reaction_to(seen(1.0), *config_, kOptions, flight, true);
  EXPECT_TRUE(reaction.is_plan_verified);
  EXPECT_EQ(reaction.kind, ReactionKind::kAround);
  expect_smooth(reaction, flight);
  EXPECT_TRUE(reaction.verdict.is_verified);
  EXPECT_EQ(reaction_to(*map_, *config_, kOptions, flight, true).kind, ReactionKind::kNone);
}

TEST_F(ReactionTest, AWallThatCannotBeAvoidedIsMetWithTheMostClearanceThereIs) {
  // 60 m ahead, 300 m high, endless: nothing helps.
  const FlightUnderPlan flight = flight_at(600);
  map::Map map = *map_;
  for (int row = 0; row < map.geometry.rows; ++row) {
    for (int column = 0; column < map.geometry.columns; ++column) {
      if (map.geometry.centre({column, row}).x_m > flight.state.x_m + 60.0) {
        map.surface_m.at(column, row) += 300.0F;
      }
    }
  }
  const Reaction reaction = reaction_to(map, *config_, kOptions, flight, false);
  EXPECT_EQ(reaction.kind, ReactionKind::kLastResort);
  EXPECT_FALSE(reaction.verdict.is_verified);
  expect_smooth(reaction, flight);
}

TEST_F(ReactionTest, APartOfAMapHasTheSameCellsAndWhateverReachesIntoIt) {
  map::Map map = with_tower(at(3000.0, 3000.0), 40.0, 100.0);
  map.obstacles.push_back(map.obstacles[0]);
  map.obstacles[1].point = at(9000.0, 1000.0);
  map.overhead_lines = {{1, {{at(0.0, 0.0), 30.0}, {at(6000.0, 6000.0), 30.0}}},
                        {2, {{at(9000.0, 0.0), 30.0}, {at(9000.0, 6000.0), 30.0}}}};
  map.further_visibility = {{60.0, map.visibility}};
  const map::Map part = map_part(map, {90, 80, 30, 40});
  EXPECT_EQ(part.geometry.west_m, map.geometry.west_m + 2700.0);
  EXPECT_EQ(part.geometry.south_m, map.geometry.south_m + 2400.0);
  for (int row = 0; row < 40; ++row) {
    for (int column = 0; column < 30; ++column) {
      EXPECT_EQ(part.surface_m.at(column, row), map.surface_m.at(column + 90, row + 80));
      EXPECT_EQ(part.terrain_m.at(column, row), map.terrain_m.at(column + 90, row + 80));
    }
  }
  EXPECT_EQ(part.further_visibility.size(), 1U);
  ASSERT_EQ(part.obstacles.size(), 1U);
  EXPECT_EQ(part.obstacles[0].point.x_m, at(3000.0, 3000.0).x_m);
  ASSERT_EQ(part.overhead_lines.size(), 1U);
  EXPECT_EQ(part.overhead_lines[0].source_id, 1);
}

}  // namespace
}  // namespace hedgehop::planning
