#include <cmath>
#include <gtest/gtest.h>
#include <random>
#include <variant>

#include "local_planning/local_planner.hpp"
#include "local_planning/local_planning_setup.hpp"
#include "support/fresh_seed.hpp"
#include "support/rough_terrain.hpp"

namespace hedgehop::local_planning {
namespace {

constexpr double kSpeed_mps = 40.0;
constexpr int kFlights = 40;
constexpr double kClearance_m = 10.0;
constexpr double kGoalRadius_m = 60.0;

// A zig-zag from west to east, legs of 0.6 to 3 km, turns of at most 60 degrees, well inside.
std::vector<geo::MapPoint> random_corners(std::mt19937_64& random, double extent_m) {
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  std::vector<geo::MapPoint> corners;
  while (corners.size() < 4) {
    corners = {{uniform(1500.0, 3000.0), uniform(4000.0, extent_m - 4000.0)}};
    double heading_rad = uniform(-0.5, 0.5);
    for (int leg = 0; leg < 8; ++leg) {
      const double length_m = uniform(600.0, 3000.0);
      const geo::MapPoint next{corners.back().x_m + length_m * std::cos(heading_rad),
                               corners.back().y_m + length_m * std::sin(heading_rad)};
      if (next.x_m > extent_m - 1500.0 || next.y_m < 1500.0 || next.y_m > extent_m - 1500.0) {
        break;
      }
      corners.push_back(next);
      const double turn_rad = uniform(0.0, 1.047);
      heading_rad += heading_rad > 0.0 ? -turn_rad : turn_rad;
    }
  }
  return corners;
}

struct Tally {
  int flown = 0;
  int arrived = 0;
  int safe = 0;
};

// `masts`: towers of 72 to 168 m that the guide knows nothing of, a square kilometre.
Tally fly_all(double slope_p90_deg, double masts,
              const LocalOptions& options = test::shipped_local_options()) {
  const auto vehicle = test::shipped_vehicle();
  std::mt19937_64 random(test::fresh_seed());
  Tally tally;
  map::Map bare;
  for (int flight = 0; flight < kFlights; ++flight) {
    if (flight % 10 == 0) {
      bare = test::make_rough_map(450, 450, 30.0, random(), slope_p90_deg);
    }
    const auto corners = random_corners(random, 450 * 30.0);
    const auto guide =
        test::stand_in_guide(bare, corners, 50.0, 20.0, 30.0, std::tan(8.0 * kDegree_rad), 15.24);
    map::Map map = bare;
    for (int mast = 0; mast < masts * 13.5 * 13.5; ++mast) {
      const raster::CellIndex cell{static_cast<int>(random() % 450),
                                   static_cast<int>(random() % 450)};
      const geo::MapPoint place = map.geometry.centre(cell);
      const auto is_near = [&](const flight::Waypoint& end) {
        return std::hypot(place.x_m - end.x_m, place.y_m - end.y_m) < 500.0;
      };
      if (!is_near(guide.front()) && !is_near(guide.back())) {
        map.surface_m.at(cell) += static_cast<float>(72 + random() % 97);
      }
    }
    SilentObserver observer;
    const auto result =
        fly_along(test::test_costs(map), vehicle, options, guide,
                  state_at_start(guide, kSpeed_mps, vehicle.limits), kSpeed_mps, {}, observer);
    ++tally.flown;
    if (!std::holds_alternative<Flight>(result)) {
      continue;
    }
    ++tally.arrived;
    const auto& steps = std::get<Flight>(result).steps;
    bool is_safe = std::hypot(steps.back().state.x_m - guide.back().x_m,
                              steps.back().state.y_m - guide.back().y_m) <= kGoalRadius_m;
    for (std::size_t i = 0; i < steps.size() && is_safe; ++i) {
      const auto& state = steps[i].state;
      is_safe = state.altitude_m - raster::sample_bilinear(map.surface_m, {state.x_m, state.y_m}) >=
                kClearance_m;
    }
    tally.safe += is_safe ? 1 : 0;
  }
  return tally;
}

TEST(RoughFlights, SteepHillsAreFlownWithTheRequiredClearance) {
  const Tally tally = fly_all(33.0, 0.0);
  EXPECT_EQ(tally.flown, kFlights);
  EXPECT_GE(tally.safe, kFlights * 95 / 100);
}

TEST(RoughFlights, MastsThatTheGuideDoesNotKnowAreAvoided) {
  const Tally tally = fly_all(25.0, 3.0);
  EXPECT_GE(tally.safe, kFlights * 95 / 100);
}

TEST(RoughFlights, RolloutsKeepTheRequiredClearanceWhereverTheyArrive) {
  const Tally tally = fly_all(40.0, 3.0, test::shipped_local_options("local.mode=rollout"));
  EXPECT_GE(tally.arrived, kFlights * 95 / 100);
  EXPECT_EQ(tally.safe, tally.arrived);
}

}  // namespace
}  // namespace hedgehop::local_planning
