#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <random>
#include <string>
#include <variant>
#include <vector>

#include "global_planning/flight_envelope.hpp"
#include "global_planning/planning_case.hpp"

namespace hedgehop::global_planning {
namespace {

using test::PlanningCase;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
using test::kLengthOnly;
constexpr double kSide_m = 12000.0;

map::AreaLimit above_ground(double height_m) {
  return {height_m, map::AreaLimit::Reference::kAboveGround};
}

// A box between two corners.
map::Area box(const std::string& name, geo::MapPoint south_west, geo::MapPoint north_east,
              map::AreaLimit floor, map::AreaLimit ceiling, bool is_hard = true) {
  map::Area area;
  area.name = name;
  area.is_hard = is_hard;
  area.floor = floor;
  area.ceiling = ceiling;
  area.polygons = {{{south_west,
                     {north_east.x_m, south_west.y_m},
                     north_east,
                     {south_west.x_m, north_east.y_m},
                     south_west},
                    {}}};
  return area;
}

PlanningCase plain_with(std::vector<map::Area> areas,
                        const risk::CostWeights& weights = kLengthOnly, double soft_cost = 0.0) {
  map::Map map =
      test::make_map(400, 400, 30.0, [](double x_m, double) { return 100.0 + 0.002 * x_m; });
  map.areas = std::move(areas);
  test::finish_map(map);
  return {std::move(map), weights, risk::SemanticCostTable({{0xFFFF, 1.0}}, 0.0, soft_cost)};
}

// Places of a route, 2 m apart or less.
template <typename Visit>
void for_each_place(const std::vector<flight::Waypoint>& waypoints, const Visit& visit) {
  for (std::size_t i = 1; i < waypoints.size(); ++i) {
    const flight::Waypoint& a = waypoints[i - 1];
    const flight::Waypoint& b = waypoints[i];
    const int steps = 1 + static_cast<int>(std::hypot(b.x_m - a.x_m, b.y_m - a.y_m) / 2.0);
    for (int k = 0; k <= steps; ++k) {
      const double t = static_cast<double>(k) / steps;
      visit(flight::Waypoint{a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m),
                             a.altitude_m + t * (b.altitude_m - a.altitude_m)});
    }
  }
}

flight::Route route_of(const PlanningCase& in, const flight::Waypoint& start,
                       const flight::Waypoint& goal) {
  const auto result = test::plan(in, test::shipped_global_options(), start, goal);
  if (const auto* none = std::get_if<flight::NoPlan>(&result)) {
    ADD_FAILURE() << none->explanation;
    return {};
  }
  return std::get<flight::Route>(result);
}

TEST(Areas, ARouteGoesRoundANoFlyAreaAndKeepsTheLateralMargin) {
  const PlanningCase in =
      plain_with({box("R 1", {5000, 4000}, {7000, 7000}, {-kInfinity, {}}, {kInfinity, {}})});
  const flight::Route route = route_of(in, in.above(2000, 6000), in.above(10000, 6000));
  const double margin_m = test::shipped_global_options().lateral_margin_m;
  for_each_place(route.waypoints, [&](const flight::Waypoint& p) {
    const bool is_near = p.x_m > 5000 - margin_m && p.x_m < 7000 + margin_m &&
                         p.y_m > 4000 - margin_m && p.y_m < 7000 + margin_m;
    ASSERT_FALSE(is_near) << p.x_m << " " << p.y_m;
  });
  // The shortest way round passes two corners in the north.
  const double shortest_m = std::hypot(3000.0, 1000.0) + 2000.0 + std::hypot(3000.0, 1000.0);
  EXPECT_GT(flight::length_m(route.waypoints), shortest_m);
  EXPECT_LT(flight::length_m(route.waypoints), 1.05 * shortest_m);
}

TEST(Areas, AnAreaThatBeginsAboveIsFlownUnder) {
  const PlanningCase in =
      plain_with({box("TMA", {5000, 0}, {7000, kSide_m}, above_ground(60.0), {kInfinity, {}})});
  const flight::Route route = route_of(in, in.above(2000, 6000), in.above(10000, 6000));
  EXPECT_LT(flight::length_m(route.waypoints), 1.01 * 8000.0);
  for_each_place(route.waypoints, [&](const flight::Waypoint& p) {
    if (p.x_m >= 5000 && p.x_m <= 7000) {
      ASSERT_LT(p.altitude_m, 100.0 + 0.002 * p.x_m + 60.0);
    }
  });
}

TEST(Areas, ALowAreaAcrossTheWholeMapIsFlownOver) {
  const PlanningCase in =
      plain_with({box("plant", {5000, 0}, {7000, kSide_m}, {-kInfinity, {}}, above_ground(70.0))});
  const flight::Route route = route_of(in, in.above(2000, 6000), in.above(10000, 6000));
  for_each_place(route.waypoints, [&](const flight::Waypoint& p) {
    if (p.x_m >= 5000 && p.x_m <= 7000) {
      ASSERT_GT(p.altitude_m, 100.0 + 0.002 * p.x_m + 70.0);
    }
  });
}

TEST(Areas, AnAreaThatEnclosesTheGoalIsNamed) {
  // A frame of four boxes, higher than the envelope.
  const map::AreaLimit top = above_ground(400.0);
  const PlanningCase in =
      plain_with({box("west", {6000, 4000}, {6300, 8000}, {-kInfinity, {}}, top),
                  box("east", {9700, 4000}, {10000, 8000}, {-kInfinity, {}}, top),
                  box("south", {6000, 4000}, {10000, 4300}, {-kInfinity, {}}, top),
                  box("north", {6000, 7700}, {10000, 8000}, {-kInfinity, {}}, top)});
  const auto result =
      test::plan(in, test::shipped_global_options(), in.above(2000, 6000), in.above(8000, 6000));
  const auto* none = std::get_if<flight::NoPlan>(&result);
  ASSERT_NE(none, nullptr);
  EXPECT_EQ(none->cause, flight::NoPlanCause::kSearchSpaceDisconnected);
  EXPECT_NE(none->explanation.find("encloses the goal"), std::string::npos) << none->explanation;
  const bool is_named =
      std::any_of(in.map.areas.begin(), in.map.areas.end(), [&](const auto& area) {
        return none->explanation.find("'" + area.name + "'") != std::string::npos;
      });
  EXPECT_TRUE(is_named) << none->explanation;
}

TEST(Areas, ASoftAreaCostsAtItsAltitudesOnly) {
  const risk::CostWeights weights{0.0, 0.0, 4.0, 0.0};
  const auto cost = [&](map::AreaLimit floor) {
    const PlanningCase in = plain_with(
        {box("CTR", {5000, 0}, {7000, kSide_m}, floor, {kInfinity, {}}, false)}, weights, 0.5);
    const flight::Waypoint a = in.above(4000, 6000, 40.0);
    const flight::Waypoint b = in.above(8000, 6000, 40.0);
    const FlightEnvelope envelope(in.costs, test::shipped_global_options(), a, b);
    return envelope.leg_cost_m(a, b);
  };
  const double length_m = std::hypot(4000.0, 0.002 * 4000.0);
  // Half of it inside, where 4 x 0.5 is added to each metre. Midpoints stand 30 m apart.
  EXPECT_NEAR(cost({-kInfinity, {}}), length_m + 2.0 * length_m / 2.0, 60.0);
  EXPECT_NEAR(cost(above_ground(41.0)), length_m, 1e-6);
}

TEST(Areas, NoRouteEntersAnyOfRandomAreas) {
  const auto seed = std::random_device{}();
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> place(1500.0, kSide_m - 1500.0);
  std::uniform_real_distribution<double> radius(150.0, 900.0);
  std::uniform_real_distribution<double> limit_m(0.0, 120.0);
  int found = 0;
  for (int round = 0; round < 6; ++round) {
    std::vector<map::Area> areas;
    std::vector<geo::MapPoint> centres;
    std::vector<double> radii;
    for (int k = 0; k < 25; ++k) {
      centres.push_back({place(random), place(random)});
      radii.push_back(radius(random));
      map::Area area;
      area.name = std::to_string(k);
      // A third each: all altitudes, from the ground, from some height on.
      area.floor = k % 3 == 2 ? above_ground(limit_m(random)) : map::AreaLimit{-kInfinity, {}};
      area.ceiling = k % 3 == 1 ? above_ground(limit_m(random)) : map::AreaLimit{kInfinity, {}};
      std::vector<geo::MapPoint> ring;
      for (int corner = 0; corner <= 12; ++corner) {
        const double angle = 2.0 * std::acos(-1.0) * (corner % 12) / 12.0;
        ring.push_back({centres.back().x_m + radii.back() * std::cos(angle),
                        centres.back().y_m + radii.back() * std::sin(angle)});
      }
      area.polygons = {{ring, {}}};
      areas.push_back(area);
    }
    const PlanningCase in = plain_with(areas);
    const auto result = test::plan(in, test::shipped_global_options(), in.above(700, 700),
                                   in.above(kSide_m - 700, kSide_m - 700));
    const auto* route = std::get_if<flight::Route>(&result);
    if (route == nullptr) {
      continue;
    }
    ++found;
    // The circle inscribed in twelve corners lies inside the area.
    for_each_place(route->waypoints, [&](const flight::Waypoint& p) {
      const double height_m = p.altitude_m - (100.0 + 0.002 * p.x_m);
      for (std::size_t k = 0; k < areas.size(); ++k) {
        const bool is_low = height_m < areas[k].floor.value_m - 0.1;
        const bool is_high = height_m > areas[k].ceiling.value_m + 0.1;
        const double from_m = std::hypot(p.x_m - centres[k].x_m, p.y_m - centres[k].y_m);
        ASSERT_TRUE(is_low || is_high || from_m > radii[k] * std::cos(std::acos(-1.0) / 12.0))
            << k << " at " << p.x_m << " " << p.y_m << " height " << height_m;
      }
    });
  }
  EXPECT_GE(found, 3);
}

}  // namespace
}  // namespace hedgehop::global_planning
