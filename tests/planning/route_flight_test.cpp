#include "planning/route_flight.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <random>

#include "base/shipped_config.hpp"
#include "support/fresh_seed.hpp"
#include "support/test_map.hpp"
#include "support/utm_map.hpp"

namespace hedgehop::planning {
namespace {

// 12 x 6 km in UTM zone 32, seen as `share` says.
template <typename Share>
map::Map seen_hills(const Share& share, double relief_m) {
  map::Map map = test::make_map(400, 200, 30.0, [&](double x_m, double y_m) {
    return 400.0 + relief_m * (std::sin(x_m / 500.0) + std::cos(y_m / 400.0));
  });
  test::place_in_utm(map);
  for (int row = 0; row < 200; ++row) {
    for (int column = 0; column < 400; ++column) {
      map.visibility.at(column, row) = test::stored_visibility(share(column, row));
    }
  }
  test::finish_map(map);
  return map;
}

PlanningConfig config_with(const std::vector<std::string>& settings) {
  return read_planning_config(effective_planning_config("", settings), "test");
}

// From west to east through the middle, 40 m above the hills' mean slope.
RouteTask straight_task(const map::Map& map, const PlanningConfig& config) {
  RouteTask task;
  for (double x_m = 1500.0; x_m <= 10500.0; x_m += 50.0) {
    const geo::MapPoint point{test::kUtmWest_m + x_m, test::kUtmSouth_m + 3000.0};
    task.guide.push_back(
        {point.x_m, point.y_m, raster::sample_bilinear(map.surface_m, point) + 40.0});
  }
  task.start = task.guide.front();
  task.goal = task.guide.back();
  task.held = {task.goal};
  task.speed_mps = config.speed_mps;
  task.initial = local_planning::state_at_start(task.guide, task.speed_mps, config.vehicle.limits);
  return task;
}

RouteFlight flown(const map::Map& map, const PlanningConfig& config) {
  const risk::CostModel costs = cost_model(map, config);
  SilentObserver observer;
  auto answer = fly_route(costs, config, straight_task(map, config), {}, observer);
  return std::get<RouteFlight>(std::move(answer));
}

const std::vector<std::string> kPlain{
    "local.weights.semantics=0",     "local.weights.visibility=0",
    "local.weights.climb=0",         "local.weights.climb_relative=0",
    "local.vertical_pass.use=false", "local.compare_with_following=false",
    "local.retry_speeds_mps=[]"};

TEST(RouteFlight, NeverCostsMoreThanPlainFollowing) {
  std::mt19937_64 random(test::fresh_seed());
  // Squares of 300 m, seen differently.
  std::vector<double> shares(40 * 20);
  for (double& share : shares) {
    share = std::uniform_real_distribution<double>(0.05, 0.9)(random);
  }
  const map::Map map = seen_hills(
      [&](int column, int row) {
        return shares[static_cast<std::size_t>((row / 10) * 40 + column / 10)];
      },
      15.0);
  const RouteFlight plain = flown(map, config_with(kPlain));
  ASSERT_TRUE(plain.verdict.is_verified);
  for (const char* weight : {"0.8", "50"}) {
    const std::string setting = std::string("local.weights.visibility=") + weight;
    const RouteFlight flat = flown(map, config_with({setting, "local.vertical_pass.use=false"}));
    const RouteFlight best = flown(map, config_with({setting}));
    EXPECT_TRUE(flat.verdict.is_verified);
    EXPECT_TRUE(best.verdict.is_verified);
    EXPECT_LE(flat.cost_m, plain.cost_m);
    EXPECT_LE(best.cost_m, flat.cost_m);
    EXPECT_FALSE(flat.is_lowered);
  }
}

TEST(RouteFlight, WeightThatDrivesTheFlightAstrayGivesThePlainOne) {
  // Dark stripes across the way: heading for them helps nobody, for all must be crossed.
  const map::Map map = seen_hills(
      [](int column, int row) { return (column / 4 + row / 4) % 2 == 0 ? 0.2 : 0.25; }, 0.0);
  const std::vector<std::string> wild{"local.weights.visibility=1000",
                                      "local.vertical_pass.use=false"};
  const RouteFlight plain = flown(map, config_with(kPlain));
  const RouteFlight taken = flown(map, config_with(wild));
  EXPECT_TRUE(taken.is_following);
  EXPECT_DOUBLE_EQ(taken.cost_m, plain.cost_m);
  auto trusting = wild;
  trusting.emplace_back("local.compare_with_following=false");
  EXPECT_GT(flown(map, config_with(trusting)).cost_m, plain.cost_m);
}

TEST(RouteFlight, LuresOfSinglePixelsHardlyLengthenThePath) {
  // Dark pixels beside the way, one or two in each window, in ground that is seen everywhere.
  std::mt19937_64 random(test::fresh_seed());
  const map::Map map = [&] {
    std::vector<int> lure_row(400, -1);
    for (int column = 55; column < 345; column += 8 + static_cast<int>(random() % 8)) {
      lure_row[static_cast<std::size_t>(column)] =
          100 + (random() % 2 == 0 ? 1 : -1) * (2 + static_cast<int>(random() % 5));
    }
    return seen_hills(
        [&](int column, int row) {
          return lure_row[static_cast<std::size_t>(column)] == row ? 0.0 : 0.5;
        },
        0.0);
  }();
  const RouteFlight plain = flown(map, config_with(kPlain));
  const RouteFlight optimised = flown(map, config_with({}));
  EXPECT_LE(optimised.measures.length_m, 1.005 * plain.measures.length_m);
  EXPECT_LE(optimised.cost_m, plain.cost_m);
}

TEST(RouteFlight, RoughnessIsPartOfTheCost) {
  // The way runs along the border between what is seen much and what is seen little.
  const map::Map map = seen_hills([](int, int row) { return row >= 100 ? 0.9 : 0.1; }, 0.0);
  const auto with_bank_weight = [&](const char* weight) {
    return flown(map, config_with({std::string("local.bank_weight_1prad=") + weight}));
  };
  const RouteFlight free = with_bank_weight("0");
  const RouteFlight dear = with_bank_weight("10000");
  EXPECT_FALSE(free.is_following);
  EXPECT_GT(free.measures.bank_rad_m, 0.0);
  EXPECT_TRUE(dear.is_following) << "the plain flight is straight";
}

TEST(RouteFlight, LowersTheFlightAndKeepsTheRequiredClearance) {
  const map::Map map = seen_hills([](int, int) { return 0.3; }, 20.0);
  const RouteFlight high = flown(map, config_with({"local.vertical_pass.use=false"}));
  const RouteFlight low = flown(map, config_with({}));
  EXPECT_TRUE(low.is_lowered);
  EXPECT_TRUE(low.verdict.is_verified);
  EXPECT_LT(low.measures.mean_height_m, 0.75 * high.measures.mean_height_m);
  EXPECT_GE(low.verdict.clearance_min_m, config_with({}).local.vertical_pass.clearance_m - 0.5);
}

TEST(RouteFlight, WayThatIsTooSteepAtFullSpeedIsFlownSlower) {
  // A wall of 100 m with a ramp of 15 degrees before and behind it, as wide as the map; at 40 m/s
  // the vehicle climbs 11 degrees. The guide runs level into it, so nothing climbs early enough.
  map::Map map = seen_hills([](int, int) { return 0.3; }, 0.0);
  for (int row = 0; row < 200; ++row) {
    for (int column = 180; column < 220; ++column) {
      const double rise_m = std::min(100.0, 30.0 * std::tan(0.26) * (20 - std::abs(column - 200)));
      map.surface_m.at(column, row) += static_cast<float>(rise_m);
      map.terrain_m.at(column, row) += static_cast<float>(rise_m);
    }
  }
  test::finish_map(map);
  const std::vector<std::string> short_sight{"local.window_m=100", "local.climb_ahead.use=false",
                                             "local.vertical_pass.use=false"};
  auto only_fast = short_sight;
  only_fast.emplace_back("local.retry_speeds_mps=[]");
  const auto level = [&](const PlanningConfig& config) {
    const risk::CostModel costs = cost_model(map, config);
    SilentObserver observer;
    RouteTask task = straight_task(map, config);
    for (flight::Waypoint& waypoint : task.guide) {
      waypoint.altitude_m = task.start.altitude_m;
    }
    return fly_route(costs, config, task, {}, observer);
  };
  const auto fast = level(config_with(only_fast));
  ASSERT_TRUE(std::holds_alternative<RouteFlight>(fast));
  EXPECT_FALSE(std::get<RouteFlight>(fast).verdict.is_verified);
  EXPECT_EQ(std::get<RouteFlight>(fast).speed_mps, 40.0);
  const auto retried = level(config_with(short_sight));
  ASSERT_TRUE(std::holds_alternative<RouteFlight>(retried));
  EXPECT_TRUE(std::get<RouteFlight>(retried).verdict.is_verified);
  EXPECT_LT(std::get<RouteFlight>(retried).speed_mps, 40.0);
}

TEST(RouteFlight, StopRequestEndsItWithItsCause) {
  class Stopping final : public Observer {
   public:
    void progress(std::string_view, double, double) override {}
    void note(std::string_view) override {}
    [[nodiscard]] bool stop_requested() const override { return true; }
  };
  const map::Map map = seen_hills([](int, int) { return 0.3; }, 0.0);
  const PlanningConfig config = config_with({});
  const risk::CostModel costs = cost_model(map, config);
  Stopping observer;
  const auto answer = fly_route(costs, config, straight_task(map, config), {}, observer);
  ASSERT_TRUE(std::holds_alternative<flight::NoPlan>(answer));
  EXPECT_EQ(std::get<flight::NoPlan>(answer).cause, flight::NoPlanCause::kStopped);
}

TEST(RouteFlight, GroundsThatFlightsShareChangeNoneOfThem) {
  const map::Map map =
      seen_hills([](int column, int) { return column % 40 < 20 ? 0.6 : 0.1; }, 25.0);
  const std::vector<PlanningConfig> configs{
      config_with({}), config_with({"local.mode=rollout"}),
      config_with({"local.mode=vfh_3d", "local.compare_with_following=false"}),
      config_with({"local.window_m=450", "local.passes=2"}),
      config_with({"local.weights.visibility=2.5"})};
  const risk::CostModel costs = cost_model(map, configs[0]);
  RouteGrounds grounds(costs);
  for (const PlanningConfig& config : configs) {
    grounds.make(config.local);
  }
  EXPECT_EQ(&grounds.of(configs[0].local), &grounds.of(configs[2].local));
  EXPECT_NE(&grounds.of(configs[0].local), &grounds.of(configs[1].local));
  EXPECT_NE(&grounds.of(configs[0].local), &grounds.of(configs[3].local));
  EXPECT_NE(&grounds.of(configs[0].local), &grounds.of(configs[4].local));
  SilentObserver observer;
  for (const PlanningConfig& config : {configs[1], configs[2]}) {
    const RouteTask task = straight_task(map, config);
    const auto alone = std::get<RouteFlight>(fly_route(costs, config, task, {}, observer));
    const auto shared = std::get<RouteFlight>(fly_route(grounds, config, task, observer));
    EXPECT_EQ(shared.cost_m, alone.cost_m);
    ASSERT_EQ(shared.trajectory.states.size(), alone.trajectory.states.size());
    for (std::size_t i = 0; i < alone.trajectory.states.size(); i += 7) {
      EXPECT_EQ(shared.trajectory.states[i].x_m, alone.trajectory.states[i].x_m) << i;
      EXPECT_EQ(shared.trajectory.states[i].y_m, alone.trajectory.states[i].y_m) << i;
      EXPECT_EQ(shared.trajectory.states[i].altitude_m, alone.trajectory.states[i].altitude_m) << i;
    }
  }
}

}  // namespace
}  // namespace hedgehop::planning
