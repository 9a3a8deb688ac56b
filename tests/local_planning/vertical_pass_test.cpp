#include "local_planning/vertical_pass.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <random>

#include "local_planning/flight_cost.hpp"
#include "local_planning/local_planning_setup.hpp"
#include "support/fresh_seed.hpp"
#include "support/rough_terrain.hpp"
#include "support/test_map.hpp"

namespace hedgehop::local_planning {
namespace {

constexpr double kSpeed_mps = 40.0;

class VerticalPass : public ::testing::Test {
 protected:
  Flight flown(const map::Map& map, const std::vector<flight::Waypoint>& guide) {
    SilentObserver observer;
    return std::get<Flight>(fly_along(test::test_costs(map), vehicle_, options_, guide,
                                      state_at_start(guide, kSpeed_mps, vehicle_.limits),
                                      kSpeed_mps, {}, observer));
  }
  std::optional<Flight> lowered(const map::Map& map, const Flight& flight,
                                const std::vector<flight::Waypoint>& held = {},
                                const StepModel& step_model = {}) {
    return lowered_flight(map.surface_m, model_, options_.vertical_pass, flight, held, step_model);
  }

  command_model::Vehicle vehicle_ = test::shipped_vehicle();
  command_model::CommandModel model_{vehicle_};
  LocalOptions options_ = test::shipped_local_options();
};

double height_m(const map::Map& map, const FlownStep& step) {
  return step.state.altitude_m -
         raster::sample_bilinear(map.surface_m, {step.state.x_m, step.state.y_m});
}

double least_height_m(const map::Map& map, const Flight& flight) {
  double least_m = std::numeric_limits<double>::infinity();
  for (const FlownStep& step : flight.steps) {
    least_m = std::min(least_m, height_m(map, step));
  }
  return least_m;
}

double mean_height_m(const map::Map& map, const Flight& flight) {
  double sum_m = 0.0;
  for (const FlownStep& step : flight.steps) {
    sum_m += height_m(map, step);
  }
  return sum_m / static_cast<double>(flight.steps.size());
}

TEST_F(VerticalPass, HighGuideOverLevelGroundIsFlownAtTheClearance) {
  const auto map = test::make_map(300, 100, 30.0, [](double, double) { return 100.0; });
  const std::vector<flight::Waypoint> guide{{1500, 1500, 180}, {7500, 1500, 180}};
  const Flight flight = flown(map, guide);
  const auto low = lowered(map, flight);
  ASSERT_TRUE(low);
  // 62 m down at almost 8 m/s: about 8 s and the time to change the rate, 480 m.
  for (const FlownStep& step : low->steps) {
    ASSERT_GE(height_m(map, step), options_.vertical_pass.clearance_m);
    if (step.state.x_m > 2200.0) {
      ASSERT_LE(height_m(map, step), options_.vertical_pass.clearance_m + 0.5);
    }
  }
}

TEST_F(VerticalPass, PlaceThatIsHeldStaysAsHighAsItWasFlown) {
  const auto map = test::make_map(300, 100, 30.0, [](double, double) { return 100.0; });
  const std::vector<flight::Waypoint> guide{{1500, 1500, 180}, {7500, 1500, 180}};
  const Flight flight = flown(map, guide);
  const auto low = lowered(map, flight, {guide.back(), {4500, 1500, 140}});
  ASSERT_TRUE(low);
  EXPECT_NEAR(low->steps.back().state.altitude_m, 180.0, 1.0);
  for (const FlownStep& step : low->steps) {
    if (std::fabs(step.state.x_m - 4500.0) < 1.5) {
      EXPECT_NEAR(step.state.altitude_m, 140.0, 1.0);
    }
    if (std::fabs(step.state.x_m - 3600.0) < 100.0) {
      EXPECT_LT(height_m(map, step), 20.0) << "but not longer than needed";
    }
  }
}

TEST_F(VerticalPass, WallIsPassedWithTheClearanceBesideTheTrackToo) {
  // A wall of 60 m whose last cell centre lies 15 m beside the track: within the margin of 24 m.
  const auto map = test::make_map(300, 200, 10.0, [](double x_m, double y_m) {
    return std::fabs(x_m - 1500.0) < 20.0 && y_m > 1010.0 ? 160.0 : 100.0;
  });
  const std::vector<flight::Waypoint> guide{{300, 1000, 240}, {2700, 1000, 240}};
  const Flight flight = flown(map, guide);
  const auto low = lowered(map, flight);
  ASSERT_TRUE(low);
  double beside_m = std::numeric_limits<double>::infinity();
  for (const FlownStep& step : low->steps) {
    if (std::fabs(step.state.x_m - 1500.0) < 20.0) {
      beside_m = std::min(beside_m, step.state.altitude_m - 160.0);
    }
  }
  EXPECT_GE(beside_m, options_.vertical_pass.clearance_m - 0.5);
  EXPECT_LE(beside_m, options_.vertical_pass.clearance_m + 2.0);
  EXPECT_LT(low->steps.back().state.altitude_m, 130.0) << "and down again behind it";
}

TEST_F(VerticalPass, RoughHillsAreFlownLowerOnTheSameTrackByTheSameModel) {
  const auto seed = test::fresh_seed();
  const map::Map map = test::make_rough_map(220, 220, 30.0, seed, 20.0);
  const auto guide = test::stand_in_guide(map, {{1500, 1500}, {3300, 2600}, {5000, 5000}}, 50.0,
                                          20.0, 30.0, 0.14, 15.24);
  const Flight flight = flown(map, guide);
  const auto low = lowered(map, flight, {guide.back()});
  ASSERT_TRUE(low);
  ASSERT_EQ(low->steps.size(), flight.steps.size());
  EXPECT_LT(mean_height_m(map, *low), mean_height_m(map, flight));
  EXPECT_GE(least_height_m(map, *low),
            std::min(least_height_m(map, flight), options_.vertical_pass.clearance_m) - 0.5);
  for (std::size_t i = 0; i < flight.steps.size(); ++i) {
    const command_model::ModelState& a = flight.steps[i].state;
    const command_model::ModelState& b = low->steps[i].state;
    ASSERT_EQ(a.x_m, b.x_m) << i;
    ASSERT_EQ(a.y_m, b.y_m) << i;
    ASSERT_EQ(a.heading_math_rad, b.heading_math_rad) << i;
    ASSERT_EQ(a.speed_mps, b.speed_mps) << i;
    ASSERT_LE(std::fabs(b.vertical_acceleration_mps2),
              vehicle_.limits.vertical_acceleration_max_mps2 * (1.0 + 1e-9));
    if (i + 1 < flight.steps.size()) {
      const command_model::ModelState next = model_.step(b, low->steps[i].command, flight.step_s);
      ASSERT_EQ(next.altitude_m, low->steps[i + 1].state.altitude_m) << i;
      ASSERT_EQ(next.climb_integral_mps, low->steps[i + 1].state.climb_integral_mps) << i;
    }
  }
  const risk::CostModel costs = test::test_costs(map);
  EXPECT_LT(flight_cost_m(costs, *low, 1.0), flight_cost_m(costs, flight, 1.0))
      << "nothing is seen, so only the height differs";
}

TEST_F(VerticalPass, UnknownGroundIsCrossedAsHighAsItWas) {
  auto map = test::make_map(300, 100, 30.0, [](double, double) { return 100.0; });
  const std::vector<flight::Waypoint> guide{{1500, 1500, 180}, {7500, 1500, 180}};
  const Flight flight = flown(map, guide);
  for (int row = 40; row < 60; ++row) {
    map.surface_m.at(150, row) = std::numeric_limits<float>::quiet_NaN();  // x = 4500 to 4530 m
  }
  const auto low = lowered(map, flight);
  ASSERT_TRUE(low);
  for (const FlownStep& step : low->steps) {
    if (step.state.x_m > 4500.0 && step.state.x_m < 4530.0) {
      EXPECT_NEAR(step.state.altitude_m, 180.0, 1.0);
    }
  }
}

TEST_F(VerticalPass, StepModelThatDoesNotFollowGivesNoFlight) {
  const auto map = test::make_map(300, 100, 30.0, [](double, double) { return 100.0; });
  const std::vector<flight::Waypoint> guide{{1500, 1500, 180}, {7500, 1500, 180}};
  const Flight flight = flown(map, guide);
  const StepModel sluggish = [&](const command_model::ModelState& state,
                                 const command_model::Command& command, double step_s) {
    command_model::Command half = command;
    half.climb_rate_mps *= 0.5;
    return model_.step(state, half, step_s);
  };
  EXPECT_FALSE(lowered(map, flight, {}, sluggish));
  const StepModel same = [&](const command_model::ModelState& state,
                             const command_model::Command& command,
                             double step_s) { return model_.step(state, command, step_s); };
  EXPECT_TRUE(lowered(map, flight, {}, same));
}

TEST(HighestBeside, IsTheGreatestHeightOfTheStripByBruteForce) {
  std::mt19937_64 random(test::fresh_seed());
  const map::Map map = test::make_rough_map(60, 60, 30.0, random(), 30.0);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (int repeat = 0; repeat < 100; ++repeat) {
    const geo::MapPoint from{uniform(300.0, 1500.0), uniform(300.0, 1500.0)};
    const double heading_rad = uniform(0.0, 6.28);
    const double length_m = uniform(0.0, 60.0);
    const double margin_m = uniform(3.0, 60.0);
    const geo::MapPoint to{from.x_m + length_m * std::cos(heading_rad),
                           from.y_m + length_m * std::sin(heading_rad)};
    double in_strip_m = -1e9;
    double in_capsule_m = -1e9;
    for (double y_m = from.y_m - 130.0; y_m <= from.y_m + 130.0; y_m += 1.0) {
      for (double x_m = from.x_m - 130.0; x_m <= from.x_m + 130.0; x_m += 1.0) {
        const double along_m =
            (x_m - from.x_m) * std::cos(heading_rad) + (y_m - from.y_m) * std::sin(heading_rad);
        const double aside_m = std::fabs((y_m - from.y_m) * std::cos(heading_rad) -
                                         (x_m - from.x_m) * std::sin(heading_rad));
        const double beyond_m = along_m - std::clamp(along_m, 0.0, length_m);
        const double here_m = raster::sample_bilinear(map.surface_m, {x_m, y_m});
        if (std::hypot(beyond_m, aside_m) <= margin_m) {
          in_capsule_m = std::max(in_capsule_m, here_m);
        }
        if (beyond_m == 0.0 && aside_m <= margin_m) {
          in_strip_m = std::max(in_strip_m, here_m);
        }
      }
    }
    const double found_m = highest_beside_m(map.surface_m, from, to, margin_m);
    // Slopes reach about 45 degrees, and the brute force looks every metre.
    EXPECT_GE(found_m, in_strip_m - 2.5) << repeat;
    EXPECT_LE(found_m, in_capsule_m + 2.5) << repeat;
  }
}

TEST(HighestBeside, SeesASingleCellWithinTheMarginAndNoneBeyondIt) {
  auto map = test::make_map(40, 40, 30.0, [](double, double) { return 100.0; });
  map.surface_m.at(20, 20) = 200.0F;  // centre (615, 615); its tent ends 30 m from there
  const auto at = [&](double off_m, double margin_m) {
    return highest_beside_m(map.surface_m, {580.0, 615.0 + off_m}, {650.0, 615.0 + off_m},
                            margin_m);
  };
  EXPECT_EQ(at(20.0, 24.0), 200.0) << "the peak";
  EXPECT_NEAR(at(40.0, 24.0), 100.0 + 100.0 * (14.0 / 30.0), 2.0) << "its slope";
  EXPECT_EQ(at(60.0, 24.0), 100.0);
  EXPECT_TRUE(std::isnan(highest_beside_m(map.surface_m, {20.0, 600.0}, {60.0, 600.0}, 24.0)))
      << "beyond the map's edge";
}

TEST(FlightCost, IsThatOfTheDensityAndOfTheBank) {
  auto map = test::make_map(100, 100, 30.0, [](double, double) { return 100.0; });
  for (auto& value : map.visibility.values()) {
    value = test::stored_visibility(0.2);
  }
  test::finish_map(map);
  const risk::CostModel costs = test::test_costs(map);
  Flight flight;
  flight.step_s = 0.05;
  for (int i = 0; i <= 500; ++i) {
    FlownStep step;
    step.state.x_m = 500.0 + 2.0 * i;
    step.state.y_m = 1500.0;
    step.state.altitude_m = 100.0 + 25.24;
    step.state.bank_left_rad = i % 2 == 0 ? 0.1 : -0.1;
    flight.steps.push_back(step);
  }
  // 1 + 25 (0.2 (1 + 0.02 10))^2 + 0.01 10 a metre, and 3 for each radian of bank.
  EXPECT_NEAR(flight_cost_m(costs, flight, 3.0), 1000.0 * (1.0 + 25.0 * 0.0576 + 0.1 + 0.3), 0.5);
}

}  // namespace
}  // namespace hedgehop::local_planning
