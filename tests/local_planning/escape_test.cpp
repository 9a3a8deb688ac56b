#include "local_planning/escape.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <numbers>
#include <random>

#include "local_planning/local_planning_setup.hpp"
#include "local_planning/vertical_pass.hpp"
#include "support/fresh_seed.hpp"
#include "support/rough_terrain.hpp"
#include "support/test_map.hpp"

namespace hedgehop::local_planning {
namespace {

constexpr double kSpeed_mps = 40.0;
constexpr double kStep_s = 0.05;
const EscapeOptions kOptions{20.0, 10.0, 10.0, 120.0};

class EscapeTest : public ::testing::Test {
 protected:
  std::optional<Flight> low_flight(const map::Map& map,
                                   const std::vector<flight::Waypoint>& guide) {
    SilentObserver observer;
    const auto flown =
        fly_along(test::test_costs(map), vehicle_, options_, guide,
                  state_at_start(guide, kSpeed_mps, vehicle_.limits), kSpeed_mps, {}, observer);
    const auto* flight = std::get_if<Flight>(&flown);
    return flight == nullptr ? std::nullopt
                             : lowered_flight(map.surface_m, model_, options_.vertical_pass,
                                              *flight, {guide.back()}, {});
  }

  // The least height above the interpolated surface, at ten places of each step.
  static double least_height_m(const map::Map& map, const std::vector<FlownStep>& steps) {
    double least_m = std::numeric_limits<double>::infinity();
    for (std::size_t i = 1; i < steps.size(); ++i) {
      const auto& a = steps[i - 1].state;
      const auto& b = steps[i].state;
      for (int k = 0; k <= 10; ++k) {
        const double t = 0.1 * k;
        const double surface_m = raster::sample_bilinear(
            map.surface_m, {a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m)});
        least_m = std::min(least_m, a.altitude_m + t * (b.altitude_m - a.altitude_m) - surface_m);
      }
    }
    return least_m;
  }

  // Level circles to the left for 2 minutes from the end of an escape.
  [[nodiscard]] std::vector<FlownStep> circled(const Escape& escape) const {
    std::vector<FlownStep> circle(1);
    circle.front().state = escape.steps.back().state;
    for (int i = 0; i < 2400; ++i) {
      FlownStep step;
      const auto& now = circle.back().state;
      step.state = model_.step(now, {now.speed_mps, now.heading_math_rad + 1.5, 0.0}, kStep_s);
      circle.push_back(step);
    }
    return circle;
  }

  command_model::Vehicle vehicle_ = test::shipped_vehicle();
  command_model::CommandModel model_{vehicle_};
  LocalOptions options_ = test::shipped_local_options();
};

std::vector<FlownStep> level_plan(double x_m, double y_m, double altitude_m) {
  std::vector<FlownStep> steps(200);
  for (std::size_t i = 0; i < steps.size(); ++i) {
    steps[i].state = command_model::trimmed_state(
        x_m + kStep_s * kSpeed_mps * static_cast<double>(i), y_m, altitude_m, kSpeed_mps, 0.0, 0.0);
    steps[i].command = {kSpeed_mps, 0.0, 0.0};
  }
  return steps;
}

TEST_F(EscapeTest, OverLevelGroundItIsAtOnceHighEnough) {
  const auto map = test::make_map(100, 100, 30.0, [](double, double) { return 100.0; });
  const auto plan = level_plan(1400.0, 1500.0, 120.0);
  const auto escape = escape_from(map.surface_m, model_, kOptions, plan, kStep_s);
  ASSERT_TRUE(escape);
  EXPECT_EQ(escape->turn_left_rad, 0.0);
  EXPECT_FALSE(escape->is_along_plan);
  EXPECT_EQ(escape->steps.size(), 1U);
}

TEST_F(EscapeTest, OutOfADescentItEndsWhereLevellingOffKeepsTheClearance) {
  // The integrator of the climb rate still holds the descent when that has ended.
  const auto map = test::make_map(200, 200, 30.0, [](double, double) { return 100.0; });
  int escapes = 0;
  for (double altitude_m = 110.0; altitude_m < 150.0; altitude_m += 1.0) {
    auto plan = level_plan(1400.0, 3000.0, altitude_m);
    plan.front().state =
        command_model::trimmed_state(1400.0, 3000.0, altitude_m, kSpeed_mps, 0.0, -8.0);
    const auto escape = escape_from(map.surface_m, model_, kOptions, plan, kStep_s);
    if (escape) {
      ++escapes;
      EXPECT_GE(least_height_m(map, escape->steps), kOptions.clearance_m) << altitude_m;
      EXPECT_GE(least_height_m(map, circled(*escape)), kOptions.clearance_m) << altitude_m;
    }
  }
  EXPECT_GE(escapes, 15);
}

TEST_F(EscapeTest, CliffAheadIsTurnedAwayFromToTheOpenSide) {
  // 500 m of wall 300 m ahead and to the left: a straight climb of 8 m/s gains 60 m until there.
  const auto map = test::make_map(200, 200, 30.0, [](double x_m, double y_m) {
    return x_m > 3300.0 || y_m > 3200.0 ? 600.0 : 100.0;
  });
  const auto plan = level_plan(3000.0, 3000.0, 120.0);
  const auto escape = escape_from(map.surface_m, model_, kOptions, plan, kStep_s);
  ASSERT_TRUE(escape);
  EXPECT_LT(escape->turn_left_rad, -0.5 * 3.14) << "to the right";
  EXPECT_GE(least_height_m(map, escape->steps), kOptions.clearance_m);
}

TEST_F(EscapeTest, CanyonIsLeftOverThePlannedTrack) {
  // 60 m wide: no room to turn; it bends, so that straight on is no way out either. Its walls are
  // too high to be climbed in time. Only the planned bend is left, and it ends in the open.
  const auto centre_m = [](double x_m) {
    return 3000.0 + (x_m > 3200.0 ? 0.35 * (x_m - 3200.0) : 0.0);
  };
  const auto map = test::make_map(600, 600, 10.0, [&](double x_m, double y_m) {
    return x_m < 4800.0 && std::fabs(y_m - centre_m(x_m)) > 45.0 ? 900.0 : 100.0;
  });
  std::vector<FlownStep> plan;
  auto state = command_model::trimmed_state(2700.0, 3000.0, 125.0, kSpeed_mps, 0.0, 0.0);
  double x_m = 0.0;
  for (int i = 0; i < 1100 && x_m < 5500.0; ++i) {
    FlownStep step;
    step.state = state;
    const double ahead_x_m = state.x_m + 100.0;
    step.command = {kSpeed_mps, std::atan2(centre_m(ahead_x_m) - state.y_m, 100.0), 0.0};
    plan.push_back(step);
    state = model_.step(state, step.command, kStep_s);
    x_m = state.x_m;
  }
  const auto escape = escape_from(map.surface_m, model_, kOptions, plan, kStep_s);
  ASSERT_TRUE(escape);
  EXPECT_TRUE(escape->is_along_plan);
  EXPECT_GE(least_height_m(map, escape->steps), kOptions.clearance_m);
}

// Walls of 800 m beside ground of twice `half_width_m`: east, then a quarter of a circle of 140 m
// to the left, then north. At 40 m/s the vehicle turns in 282 m, at 20 m/s in 71 m. Instead of the
// right wall of the first part a slope of `right_slope`, 0 for none.
map::Map bent_canyon(double half_width_m, double right_slope) {
  return test::make_map(300, 300, 10.0, [=](double x_m, double y_m) {
    if (x_m > 2300.0 || y_m > 2300.0) {
      return 100.0;  // open ground in the north and east
    }
    const double off_m = x_m <= 1500.0   ? y_m - 860.0
                         : y_m <= 1000.0 ? std::hypot(x_m - 1500.0, y_m - 1000.0) - 140.0
                                         : x_m - 1640.0;
    if (std::fabs(off_m) < half_width_m) {
      return 100.0;
    }
    return right_slope > 0.0 && x_m <= 1500.0 && off_m < 0.0
               ? std::min(900.0, 100.0 + right_slope * (-half_width_m - off_m))
               : 900.0;
  });
}

std::vector<flight::Waypoint> along_bent_canyon() {
  std::vector<flight::Waypoint> guide;
  for (double x_m = 700.0; x_m < 1500.0; x_m += 50.0) {
    guide.push_back({x_m, 860.0, 140.0});
  }
  for (int part = 0; part <= 8; ++part) {
    const double turned_rad = part / 8.0 * 0.5 * std::numbers::pi;
    guide.push_back(
        {1500.0 + 140.0 * std::sin(turned_rad), 1000.0 - 140.0 * std::cos(turned_rad), 140.0});
  }
  for (double y_m = 1050.0; y_m < 2850.0; y_m += 50.0) {
    guide.push_back({1640.0, y_m, 140.0});
  }
  return guide;
}

TEST_F(EscapeTest, BendThatIsTooTightAtFullSpeedIsLeftAlongTheGuide) {
  const map::Map map = bent_canyon(45.0, 0.0);
  const Guide guide(along_bent_canyon());
  const auto state = command_model::trimmed_state(1000.0, 860.0, 130.0, kSpeed_mps, 0.0, 0.0);
  const auto escape = escape_along(map.surface_m, model_, kOptions, EscapeWays::kAny, state, guide,
                                   300.0, 50.0, kStep_s);
  ASSERT_TRUE(escape);
  EXPECT_TRUE(escape->is_along_plan);
  EXPECT_GE(least_height_m(map, escape->steps), kOptions.clearance_m);
  for (std::size_t i = 0; i + 1 < escape->steps.size(); ++i) {
    const auto next = model_.step(escape->steps[i].state, escape->steps[i].command, kStep_s);
    ASSERT_EQ(next.altitude_m, escape->steps[i + 1].state.altitude_m);
    ASSERT_EQ(next.x_m, escape->steps[i + 1].state.x_m);
  }
  // Where the bend begins it is too late to slow down.
  const auto late = command_model::trimmed_state(1500.0, 860.0, 130.0, kSpeed_mps, 0.0, 0.0);
  EXPECT_FALSE(escape_along(map.surface_m, model_, kOptions, EscapeWays::kAny, late, guide, 800.0,
                            50.0, kStep_s));
}

TEST_F(EscapeTest, GuideIsLeftWhereOnlyATurnLeadsOut) {
  // The guide runs into a cliff; on its right the ground is level.
  const auto map = test::make_map(200, 200, 30.0, [](double x_m, double y_m) {
    return x_m > 3300.0 || y_m > 3200.0 ? 600.0 : 100.0;
  });
  const Guide guide({{2700, 3000, 120}, {5000, 3000, 120}});
  const auto state = command_model::trimmed_state(3000.0, 3000.0, 120.0, kSpeed_mps, 0.0, 0.0);
  EXPECT_FALSE(escape_along(map.surface_m, model_, kOptions, EscapeWays::kAlongGuide, state, guide,
                            300.0, 50.0, kStep_s));
  const auto escape = escape_along(map.surface_m, model_, kOptions, EscapeWays::kAny, state, guide,
                                   300.0, 50.0, kStep_s);
  ASSERT_TRUE(escape);
  EXPECT_LT(escape->turn_left_rad, -0.5 * 3.14) << "to the right";
}

TEST_F(EscapeTest, AtTheGoalThereIsNothingToEscapeFrom) {
  const auto map = test::make_map(100, 100, 30.0, [](double, double) { return 100.0; });
  const Guide guide({{500, 1500, 120}, {1500, 1500, 120}});
  const auto state = command_model::trimmed_state(1490.0, 1500.0, 120.0, kSpeed_mps, 0.0, 0.0);
  const auto escape = escape_along(map.surface_m, model_, kOptions, EscapeWays::kAlongGuide, state,
                                   guide, 990.0, 50.0, kStep_s);
  ASSERT_TRUE(escape);
  EXPECT_EQ(escape->steps.size(), 1U);
}

TEST_F(EscapeTest, RolloutsThatRunIntoACanyonsWallTakeTheWayOutBefore) {
  // The slope on the right needs the least climb, and still twice as much as there is.
  const map::Map map = bent_canyon(50.0, 0.8);
  const auto guide = along_bent_canyon();
  const auto fly = [&](bool is_kept) {
    LocalOptions options = test::shipped_local_options("local.mode=rollout");
    options.rollout_escape.is_used = is_kept;
    SilentObserver observer;
    return fly_along(test::test_costs(map), vehicle_, options, guide,
                     state_at_start(guide, kSpeed_mps, vehicle_.limits), kSpeed_mps, {}, observer);
  };
  const auto flown = fly(true);
  ASSERT_TRUE(std::holds_alternative<Flight>(flown));
  const auto& flight = std::get<Flight>(flown);
  EXPECT_GE(flight.escapes, 1);
  EXPECT_GE(least_height_m(map, flight.steps), options_.rollout_escape.clearance_m - 0.1);
  for (std::size_t i = 0; i + 1 < flight.steps.size(); ++i) {
    const auto next = model_.step(flight.steps[i].state, flight.steps[i].command, kStep_s);
    ASSERT_NEAR(next.x_m, flight.steps[i + 1].state.x_m, 1e-6) << "a jump at step " << i;
    ASSERT_NEAR(next.altitude_m, flight.steps[i + 1].state.altitude_m, 1e-6);
  }
  const auto& end = flight.steps.back().state;
  EXPECT_LT(std::hypot(end.x_m - guide.back().x_m, end.y_m - guide.back().y_m),
            options_.goal_radius_m);

  const auto loose = fly(false);
  if (const auto* unkept = std::get_if<Flight>(&loose)) {
    EXPECT_LT(least_height_m(map, unkept->steps), 0.0) << "the canyon is no test";
  }
}

TEST_F(EscapeTest, ThereIsNoneOutOfAShaft) {
  const auto map = test::make_map(200, 200, 30.0, [](double x_m, double y_m) {
    return std::hypot(x_m - 3000.0, y_m - 3000.0) > 150.0 ? 900.0 : 100.0;
  });
  EXPECT_FALSE(
      escape_from(map.surface_m, model_, kOptions, level_plan(2950.0, 3000.0, 120.0), kStep_s));
}

TEST_F(EscapeTest, EveryStateOfLowFlightsOverRoughHillsHasOneThatCanCircleAtItsEnd) {
  std::mt19937_64 random(test::fresh_seed());
  int cut = 0;
  int along_plan = 0;
  for (int flight = 0; flight < 4; ++flight) {
    const map::Map map = test::make_rough_map(300, 300, 30.0, random(), 20.0);
    const auto guide =
        test::stand_in_guide(map, {{2000, 2000}, {3500, 2800}, {5000, 5000}, {7000, 6500}}, 50.0,
                             20.0, 30.0, 0.14, 15.24);
    const auto plan = low_flight(map, guide);
    if (!plan || least_height_m(map, plan->steps) < kOptions.clearance_m) {
      continue;
    }
    for (int repeat = 0; repeat < 250; ++repeat) {
      const std::size_t at = random() % (plan->steps.size() - 2);
      const auto escape =
          escape_from(map.surface_m, model_, kOptions, std::span(plan->steps).subspan(at), kStep_s);
      ++cut;
      ASSERT_TRUE(escape) << "at step " << at;
      ASSERT_GE(least_height_m(map, escape->steps), kOptions.clearance_m - 0.01);
      for (std::size_t i = 0; i + 1 < escape->steps.size(); ++i) {
        const auto next = model_.step(escape->steps[i].state, escape->steps[i].command, kStep_s);
        ASSERT_EQ(next.altitude_m, escape->steps[i + 1].state.altitude_m);
        ASSERT_EQ(next.x_m, escape->steps[i + 1].state.x_m);
      }
      along_plan += escape->is_along_plan ? 1 : 0;
      if (escape->is_along_plan || repeat % 10 != 0) {
        continue;
      }
      ASSERT_GE(least_height_m(map, circled(*escape)), kOptions.clearance_m - 0.01);
    }
  }
  EXPECT_GE(cut, 500);
  EXPECT_LT(along_plan, cut);
}

}  // namespace
}  // namespace hedgehop::local_planning
