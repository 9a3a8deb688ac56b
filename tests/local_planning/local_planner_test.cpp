#include "local_planning/local_planner.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <limits>
#include <numbers>
#include <random>

#include "local_planning/local_planning_setup.hpp"
#include "local_planning/surroundings.hpp"
#include "support/fresh_seed.hpp"
#include "support/rough_terrain.hpp"
#include "support/test_map.hpp"

namespace hedgehop::local_planning {
namespace {

using ::testing::HasSubstr;

constexpr double kSpeed_mps = 40.0;

std::variant<Flight, flight::NoPlan> flown(const map::Map& map,
                                           const std::vector<flight::Waypoint>& guide,
                                           const LocalOptions& options,
                                           const StepModel& step_model = {},
                                           Kernel kernel = Kernel::kBest) {
  const auto vehicle = test::shipped_vehicle();
  SilentObserver observer;
  return fly_along(test::test_costs(map), vehicle, options, guide,
                   state_at_start(guide, kSpeed_mps, vehicle.limits), kSpeed_mps, step_model,
                   observer, kernel);
}

double least_clearance_m(const map::Map& map, const Flight& flight) {
  double least_m = std::numeric_limits<double>::infinity();
  for (const FlownStep& step : flight.steps) {
    least_m = std::min(
        least_m, step.state.altitude_m -
                     raster::sample_bilinear(map.surface_m, {step.state.x_m, step.state.y_m}));
  }
  return least_m;
}

double distance_to_goal_m(const Flight& flight, const std::vector<flight::Waypoint>& guide) {
  return std::hypot(flight.steps.back().state.x_m - guide.back().x_m,
                    flight.steps.back().state.y_m - guide.back().y_m);
}

bool is_same_bytes(const Flight& a, const Flight& b) {
  if (a.steps.size() != b.steps.size()) {
    return false;
  }
  static_assert(std::is_trivially_copyable_v<FlownStep>);
  return std::memcmp(a.steps.data(), b.steps.data(), a.steps.size() * sizeof(FlownStep)) == 0;
}

TEST(LocalPlanner, StraightGuideOverLevelGroundIsFlownStraightWithoutBank) {
  const auto map = test::make_map(200, 100, 30.0, [](double, double) { return 100.0; });
  const std::vector<flight::Waypoint> guide{{1500, 1500, 130}, {4500, 1500, 130}};
  const auto result = flown(map, guide, test::shipped_local_options());
  const Flight& flight = std::get<Flight>(result);
  for (const FlownStep& step : flight.steps) {
    ASSERT_EQ(step.state.y_m, 1500.0);
    ASSERT_EQ(step.state.bank_left_rad, 0.0);
    ASSERT_NEAR(step.state.altitude_m, 130.0, 0.5);
    ASSERT_EQ(step.state.speed_mps, kSpeed_mps);
  }
  EXPECT_LE(distance_to_goal_m(flight, guide), 2.0) << "ends at the nearest approach";
  EXPECT_EQ(flight.infeasible_decisions, 0);
  EXPECT_EQ(flight.decisions + 1, static_cast<std::int64_t>(flight.steps.size()));
}

class EachHistogramMode : public ::testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(LocalPlanner, EachHistogramMode,
                         ::testing::Values("mode=tvfh", "mode=vfh_3d", "steering=cheapest",
                                           "steering=openings"));

TEST_P(EachHistogramMode, WallAcrossTheGuideIsFlownOverWithTheSafetyHeight) {
  // A ridge of 45 m as long as the map; the guide knows nothing of it.
  const auto map = test::make_map(200, 200, 30.0, [](double x_m, double) {
    return std::fabs(x_m - 3000.0) < 60.0 ? 145.0 : 100.0;
  });
  const std::vector<flight::Waypoint> guide{{1500, 3000, 125}, {4500, 3000, 125}};
  const auto result =
      flown(map, guide, test::shipped_local_options(std::string("local.") + GetParam()));
  const Flight& flight = std::get<Flight>(result);
  EXPECT_GT(least_clearance_m(map, flight), 17.0);
  double over_ridge_m = 0.0;
  for (const FlownStep& step : flight.steps) {
    if (std::fabs(step.state.x_m - 3000.0) < 60.0) {
      over_ridge_m = std::max(over_ridge_m, step.state.altitude_m - 145.0);
    }
  }
  EXPECT_LT(over_ridge_m, 35.0) << "and not much more than that";
  EXPECT_LE(distance_to_goal_m(flight, guide), 50.0);
}

TEST_P(EachHistogramMode, TowerTooSteepToFlyOverIsFlownAround) {
  const auto map = test::make_map(200, 200, 30.0, [](double x_m, double y_m) {
    return std::hypot(x_m - 3000.0, y_m - 3000.0) < 50.0 ? 400.0 : 100.0;
  });
  const std::vector<flight::Waypoint> guide{{1500, 3000, 125}, {4500, 3000, 125}};
  const auto result =
      flown(map, guide, test::shipped_local_options(std::string("local.") + GetParam()));
  const Flight& flight = std::get<Flight>(result);
  EXPECT_GT(least_clearance_m(map, flight), 15.0);
  double aside_m = 0.0;
  for (const FlownStep& step : flight.steps) {
    aside_m = std::max(aside_m, std::fabs(step.state.y_m - 3000.0));
  }
  EXPECT_GT(aside_m, 60.0);
  EXPECT_LE(distance_to_goal_m(flight, guide), 50.0);
}

TEST(Surroundings, HardAreasAreWallsOrGroundAndHighOnesAreNothing) {
  map::Map map = test::make_map(60, 60, 30.0, [](double, double) { return 100.0; });
  const auto strip = [](double west_m, double floor_m, double ceiling_m) {
    map::Area area;
    area.floor = {floor_m, map::AreaLimit::Reference::kAmsl};
    area.ceiling = {ceiling_m, map::AreaLimit::Reference::kAmsl};
    area.polygons = {{{{west_m, 0.0},
                       {west_m + 20.0, 0.0},
                       {west_m + 20.0, 1800.0},
                       {west_m, 1800.0},
                       {west_m, 0.0}},
                      {}}};
    return area;
  };
  const double infinity = std::numeric_limits<double>::infinity();
  map.areas = {strip(305.0, -infinity, infinity), strip(605.0, 120.0, 180.0),
               strip(905.0, 200.0, infinity)};
  test::finish_map(map);
  const risk::CostModel costs = test::test_costs(map);
  const Surroundings around(costs, 350.0, 40.0, 1.0, 1.0);
  const auto surface_m = [&](double x_m) {
    return around.surface_m().at(around.geometry().cell_at({x_m, 915.0}));
  };
  EXPECT_EQ(surface_m(315.0), Surroundings::kBlockedAltitude_m);
  EXPECT_EQ(surface_m(615.0), 180.0F);
  EXPECT_EQ(surface_m(915.0), 100.0F);
  EXPECT_EQ(surface_m(345.0), 100.0F);
  EXPECT_EQ(around.dilated_m({345.0, 915.0}), 100.0);  // a wall is nothing to climb over
  EXPECT_EQ(around.dilated_m({645.0, 915.0}), 180.0);
}

class EachLateralSearch : public ::testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(LocalPlanner, EachLateralSearch,
                         ::testing::Values("steering=torque", "steering=cheapest"));

TEST_P(EachLateralSearch, RiskOnOneSideBendsTheFlightToTheOther) {
  const LocalOptions usual = test::shipped_local_options(std::string("local.") + GetParam());
  auto map = test::make_map(200, 200, 30.0, [](double, double) { return 100.0; });
  for (int row = 0; row < 200; ++row) {
    for (int column = 0; column < 200; ++column) {
      map.visibility.at(column, row) = test::stored_visibility(row >= 100 ? 0.9 : 0.1);
    }
  }
  test::finish_map(map);
  const std::vector<flight::Waypoint> guide{{1500, 3000, 130}, {4500, 3000, 130}};
  const auto pulled = std::get<Flight>(flown(map, guide, usual));
  double mean_aside_m = 0.0;
  for (const FlownStep& step : pulled.steps) {
    mean_aside_m += (step.state.y_m - 3000.0) / static_cast<double>(pulled.steps.size());
  }
  EXPECT_LT(mean_aside_m, -5.0);
  // A torque is a sum: of costs whose mean is rounded.
  const double tolerance_m = usual.steering == Steering::kTorque ? 1e-4 : 1e-6;
  // Weight zero, and equal risk everywhere, leave the flight on the line.
  LocalOptions options = usual;
  options.visibility_weight = 0.0;
  const auto unweighted = std::get<Flight>(flown(map, guide, options));
  for (const FlownStep& step : unweighted.steps) {
    ASSERT_NEAR(step.state.y_m, 3000.0, tolerance_m);
  }
  std::fill(map.visibility.values().begin(), map.visibility.values().end(),
            test::stored_visibility(0.7));
  const auto uniform = std::get<Flight>(flown(map, guide, usual));
  for (const FlownStep& step : uniform.steps) {
    ASSERT_NEAR(step.state.y_m, 3000.0, tolerance_m);
  }
}

TEST(LocalPlanner, NoRiskDrivesTheFlightOutOfItsCorridor) {
  auto map = test::make_map(200, 200, 30.0, [](double, double) { return 100.0; });
  for (int row = 0; row < 200; ++row) {
    for (int column = 0; column < 200; ++column) {
      map.visibility.at(column, row) = test::stored_visibility(1.0 - row / 200.0);
    }
  }
  test::finish_map(map);
  const std::vector<flight::Waypoint> guide{{1500, 3000, 130}, {4500, 3000, 130}};
  LocalOptions options = test::shipped_local_options("local.weights.visibility=100");
  const auto pulled = std::get<Flight>(flown(map, guide, options));
  double aside_m = 0.0;
  for (const FlownStep& step : pulled.steps) {
    aside_m = std::max(aside_m, std::fabs(step.state.y_m - 3000.0));
  }
  EXPECT_GT(aside_m, 50.0);
  EXPECT_LT(aside_m, options.corridor_m + 287.0) << "the corridor, and the radius of turning back";
  EXPECT_LE(distance_to_goal_m(pulled, guide), 50.0);
}

TEST(LocalPlanner, GoalInsideTheTurningCircleIsReachedOnASecondApproach) {
  // The goal lies 150 m abeam; the tightest turn at 40 m/s has 287 m of radius.
  const auto map = test::make_map(200, 200, 30.0, [](double, double) { return 100.0; });
  const std::vector<flight::Waypoint> guide{{3000, 3000, 130}, {3000, 3150, 130}};
  const auto vehicle = test::shipped_vehicle();
  SilentObserver observer;
  const auto result = fly_along(test::test_costs(map), vehicle,
                                test::shipped_local_options("local.length_factor_max=30"), guide,
                                command_model::trimmed_state(3000, 3000, 130, kSpeed_mps, 0.0, 0.0),
                                kSpeed_mps, {}, observer);
  ASSERT_TRUE(std::holds_alternative<Flight>(result));
  EXPECT_LE(distance_to_goal_m(std::get<Flight>(result), guide), 50.0);
}

TEST(LocalPlanner, CliffBehindTheGoalDoesNotTurnTheFlightAway) {
  const auto map = test::make_map(220, 200, 30.0,
                                  [](double x_m, double) { return x_m > 4700.0 ? 600.0 : 100.0; });
  const std::vector<flight::Waypoint> guide{{1500, 3000, 125}, {4500, 3000, 125}};
  const auto flight = std::get<Flight>(flown(map, guide, test::shipped_local_options()));
  EXPECT_LE(distance_to_goal_m(flight, guide), 50.0);
  EXPECT_LT(static_cast<double>(flight.steps.size()) * 0.05 * kSpeed_mps, 3100.0);
  for (const FlownStep& step : flight.steps) {
    ASSERT_LT(step.state.altitude_m, 150.0) << "nor make it climb";
  }
}

TEST(LocalPlanner, BentGuideIsFlownWithinTheVehiclesLimits) {
  const auto map = test::make_map(300, 300, 30.0, [](double, double) { return 100.0; });
  const std::vector<flight::Waypoint> guide{
      {1500, 1500, 130}, {3500, 1500, 130}, {4500, 3232, 130}, {6500, 3232, 130}};
  const auto vehicle = test::shipped_vehicle();
  const Flight flight = std::get<Flight>(flown(map, guide, test::shipped_local_options()));
  double bank_max_rad = 0.0;
  for (const FlownStep& step : flight.steps) {
    bank_max_rad = std::max(bank_max_rad, std::fabs(step.state.bank_left_rad));
    ASSERT_LE(std::fabs(step.state.bank_left_rad), vehicle.limits.bank_max_rad);
  }
  EXPECT_GT(bank_max_rad, 0.1);
  EXPECT_LE(distance_to_goal_m(flight, guide), 50.0);
  const double length_m = static_cast<double>(flight.steps.size()) * 0.05 * kSpeed_mps;
  EXPECT_LT(length_m, flight::length_m(guide) * 1.01);
}

TEST(LocalPlanner, AllKernelsFlyTheSameBytes) {
  const auto seed = test::fresh_seed();
  map::Map map = test::make_rough_map(220, 220, 30.0, seed, 25.0);
  std::mt19937_64 random(seed);
  for (auto& value : map.visibility.values()) {
    value = static_cast<std::uint16_t>(random() % 65535);
  }
  test::finish_map(map);
  const auto guide = test::stand_in_guide(map, {{1500, 1500}, {3300, 2600}, {5000, 5000}}, 50.0,
                                          20.0, 30.0, 0.14, 15.24);
  std::vector<std::pair<std::string, LocalOptions>> modes;
  for (const char* mode : {"local.mode=tvfh", "local.mode=rollout", "local.mode=vfh_3d",
                           "local.steering=cheapest", "local.steering=openings"}) {
    modes.emplace_back(mode, test::shipped_local_options(mode));
    modes.back().second.passes = modes.back().second.mode == LocalMode::kVfh3d ? 1 : 2;
  }
  modes.emplace_back("a tree of rollouts", test::shipped_local_options("local.mode=rollout"));
  modes.back().second.rollout.tree_depth = 2;
  for (const auto& [mode, options] : modes) {
    const auto plain = flown(map, guide, options, {}, Kernel::kPlain);
    ASSERT_TRUE(std::holds_alternative<Flight>(plain)) << mode;
    for (const Kernel kernel : {Kernel::kBest, Kernel::kAvx2, Kernel::kAvx512}) {
      if (!is_available(kernel)) {
        continue;
      }
      const auto fast = flown(map, guide, options, {}, kernel);
      ASSERT_TRUE(std::holds_alternative<Flight>(fast)) << mode << name_of_kernel(kernel);
      EXPECT_TRUE(is_same_bytes(std::get<Flight>(plain), std::get<Flight>(fast)))
          << mode << ", " << name_of_kernel(kernel);
    }
  }
}

TEST(LocalPlanner, ATreeOfRolloutsFliesAroundAPocketThatOneDecisionEnters) {
  // The pocket of the rollout's own test: north of the block the way is open, the shorter one
  // around its south ends at a wall beyond what 12 s of flight see.
  const auto map = test::make_map(170, 100, 30.0, [](double x_m, double y_m) {
    const auto within = [&](double west_m, double east_m, double south_m, double north_m) {
      return x_m > west_m && x_m < east_m && y_m > south_m && y_m < north_m;
    };
    return within(2300.0, 2400.0, 1460.0, 1600.0) || within(2300.0, 2620.0, 1430.0, 1460.0) ||
                   within(2000.0, 2620.0, 1000.0, 1030.0) || within(2560.0, 2620.0, 1000.0, 1460.0)
               ? 300.0
               : 0.0;
  });
  const std::vector<flight::Waypoint> guide{{1000, 1500, 30}, {4000, 1500, 30}};
  LocalOptions options = test::shipped_local_options("local.mode=rollout");
  const auto northmost_and_southmost_m = [](const Flight& flight) {
    double north_m = -1e9;
    double south_m = 1e9;
    for (const FlownStep& step : flight.steps) {
      north_m = std::max(north_m, step.state.y_m);
      south_m = std::min(south_m, step.state.y_m);
    }
    return std::pair{north_m, south_m};
  };
  const auto one = flown(map, guide, options);
  if (const auto* flight = std::get_if<Flight>(&one)) {
    EXPECT_LT(northmost_and_southmost_m(*flight).second, 1440.0) << "into the pocket";
    EXPECT_GT(flight->escapes + flight->infeasible_decisions, 0);
  }
  options.rollout.tree_depth = 2;
  const auto two = flown(map, guide, options);
  ASSERT_TRUE(std::holds_alternative<Flight>(two));
  const Flight& flight = std::get<Flight>(two);
  EXPECT_GT(northmost_and_southmost_m(flight).first, 1640.0);
  EXPECT_GT(northmost_and_southmost_m(flight).second, 1440.0);
  EXPECT_EQ(flight.escapes, 0);
  EXPECT_EQ(flight.infeasible_decisions, 0);
  EXPECT_LE(distance_to_goal_m(flight, guide), options.goal_radius_m);
}

TEST(LocalPlanner, SameQuestionGivesTheSameBytes) {
  const auto seed = test::fresh_seed();
  const map::Map map = test::make_rough_map(220, 220, 30.0, seed, 25.0);
  const auto guide = test::stand_in_guide(map, {{1500, 1500}, {3300, 2600}, {5000, 5000}}, 50.0,
                                          20.0, 30.0, 0.14, 15.24);
  const LocalOptions options = test::shipped_local_options();
  const auto first = flown(map, guide, options);
  const auto second = flown(map, guide, options);
  ASSERT_TRUE(std::holds_alternative<Flight>(first));
  EXPECT_TRUE(is_same_bytes(std::get<Flight>(first), std::get<Flight>(second)));
  // And through a step model of the caller's, which sees nothing but state, command and step.
  const command_model::CommandModel model(test::shipped_vehicle());
  const auto stepped_outside =
      flown(map, guide, options,
            [&](const command_model::ModelState& state, const command_model::Command& command,
                double step_s) { return model.step(state, command, step_s); });
  EXPECT_TRUE(is_same_bytes(std::get<Flight>(first), std::get<Flight>(stepped_outside)));
}

TEST(LocalPlanner, FurtherPassSmoothsTheFlight) {
  const map::Map map = test::make_rough_map(220, 220, 30.0, 7, 20.0);
  const auto guide = test::stand_in_guide(
      map, {{1500, 1500}, {2600, 1700}, {3300, 2600}, {4200, 2700}, {5000, 4500}}, 50.0, 20.0, 30.0,
      0.14, 15.24);
  const auto bank_rad_s = [](const Flight& flight) {
    double sum = 0.0;
    for (const FlownStep& step : flight.steps) {
      sum += std::fabs(step.state.bank_left_rad) * flight.step_s;
    }
    return sum;
  };
  const Flight once =
      std::get<Flight>(flown(map, guide, test::shipped_local_options("local.passes=1")));
  const Flight twice =
      std::get<Flight>(flown(map, guide, test::shipped_local_options("local.passes=2")));
  EXPECT_GT(twice.decisions, once.decisions + 1000);
  EXPECT_LT(bank_rad_s(twice), bank_rad_s(once));
  EXPECT_LE(distance_to_goal_m(twice, guide), 50.0);
  EXPECT_GT(least_clearance_m(map, twice), 10.0);
}

TEST(LocalPlanner, WallThatCannotBePassedIsNamedWithItsPlace) {
  // A closed ring of 800 m around the start.
  const auto map = test::make_map(200, 200, 30.0, [](double x_m, double y_m) {
    const double from_start_m = std::hypot(x_m - 3000.0, y_m - 3000.0);
    return from_start_m > 900.0 && from_start_m < 1100.0 ? 900.0 : 100.0;
  });
  const std::vector<flight::Waypoint> guide{{3000, 3000, 125}, {5500, 3000, 125}};
  LocalOptions options = test::shipped_local_options("local.length_factor_max=2");
  const auto result = flown(map, guide, options);
  ASSERT_TRUE(std::holds_alternative<flight::NoPlan>(result) ||
              least_clearance_m(map, std::get<Flight>(result)) > 0.0)
      << "neither stuck nor over it";
  ASSERT_TRUE(std::holds_alternative<flight::NoPlan>(result));
  const auto& none = std::get<flight::NoPlan>(result);
  EXPECT_EQ(none.cause, flight::NoPlanCause::kLocalPlannerStuck);
  ASSERT_TRUE(none.place);
  EXPECT_LT(std::hypot(none.place->x_m - 3000.0, none.place->y_m - 3000.0), 3000.0);
  EXPECT_THAT(none.explanation, HasSubstr("was not reached within 2.00 times"));
}

TEST(LocalPlanner, GuideThatLeavesTheMapIsNamed) {
  const auto map = test::make_map(100, 100, 30.0, [](double, double) { return 100.0; });
  const std::vector<flight::Waypoint> guide{{1500, 1500, 130}, {9000, 1500, 130}};
  const auto result = flown(map, guide, test::shipped_local_options("local.length_factor_max=1"));
  ASSERT_TRUE(std::holds_alternative<flight::NoPlan>(result));
  EXPECT_EQ(std::get<flight::NoPlan>(result).cause, flight::NoPlanCause::kLocalPlannerStuck);
}

TEST(LocalPlanner, ObserverStopsTheFlight) {
  class Stopping final : public Observer {
   public:
    void progress(std::string_view, double done, double) override { is_far_ = done > 0.3; }
    void note(std::string_view) override {}
    [[nodiscard]] bool stop_requested() const override { return is_far_; }

   private:
    bool is_far_ = false;
  };
  const auto map = test::make_map(200, 100, 30.0, [](double, double) { return 100.0; });
  const std::vector<flight::Waypoint> guide{{1500, 1500, 130}, {4500, 1500, 130}};
  const auto vehicle = test::shipped_vehicle();
  Stopping observer;
  const auto result =
      fly_along(test::test_costs(map), vehicle, test::shipped_local_options(), guide,
                state_at_start(guide, kSpeed_mps, vehicle.limits), kSpeed_mps, {}, observer);
  ASSERT_TRUE(std::holds_alternative<flight::NoPlan>(result));
  EXPECT_EQ(std::get<flight::NoPlan>(result).cause, flight::NoPlanCause::kStopped);
}

TEST(LocalPlanner, BrokenPreconditionsAreRefused) {
  const auto map = test::make_map(100, 100, 30.0, [](double, double) { return 100.0; });
  const std::vector<flight::Waypoint> guide{{1500, 1500, 130}, {2500, 1500, 130}};
  const auto vehicle = test::shipped_vehicle();
  SilentObserver observer;
  auto state = state_at_start(guide, kSpeed_mps, vehicle.limits);
  const auto options = test::shipped_local_options();
  EXPECT_THROW(
      fly_along(test::test_costs(map), vehicle, options, guide, state, 200.0, {}, observer),
      std::invalid_argument);
  EXPECT_THROW(fly_along(test::test_costs(map), vehicle, options, {guide[0]}, state, kSpeed_mps, {},
                         observer),
               std::invalid_argument);
  state.altitude_m = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(
      fly_along(test::test_costs(map), vehicle, options, guide, state, kSpeed_mps, {}, observer),
      std::invalid_argument);
}

TEST(LocalPlanner, StartClimbsWithTheGuideAndTurnsWithIt) {
  const std::vector<flight::Waypoint> guide{{0, 0, 100}, {0, 100, 110}};
  const auto state = state_at_start(guide, kSpeed_mps, test::shipped_vehicle().limits);
  EXPECT_NEAR(state.heading_math_rad, 0.5 * std::numbers::pi, 1e-15);
  EXPECT_DOUBLE_EQ(state.climb_rate_mps, 4.0);
  EXPECT_EQ(state.bank_left_rad, 0.0);
}

}  // namespace
}  // namespace hedgehop::local_planning
