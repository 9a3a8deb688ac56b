#include "global_planning/cost_bound.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <queue>
#include <random>
#include <utility>
#include <variant>
#include <vector>

#include "global_planning/planning_case.hpp"
#include "support/fractal_terrain.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::global_planning {
namespace {

using test::PlanningCase;

constexpr risk::CostWeights kShipped{25.0, 0.02, 4.0, 0.01};

PlanningCase flat(int cells, const std::function<double(int, int)>& visibility) {
  map::Map map = test::make_map(cells, cells, 30.0, [](double, double) { return 100.0; });
  for (int row = 0; row < cells; ++row) {
    for (int column = 0; column < cells; ++column) {
      map.visibility.at(column, row) = test::stored_visibility(visibility(column, row));
    }
  }
  test::finish_map(map);
  return {std::move(map), kShipped};
}

TEST(CostBound, IsNearlyTheStraightLineWhereEveryMetreCostsTheSame) {
  const PlanningCase in = flat(300, [](int, int) { return 0.3; });
  const GlobalOptions options = test::shipped_global_options();
  // c_vis (0.3 (1 + 0.02 h))^2 + c_height h, h above h_ref = 15.24 m; at the floor of 20 m.
  const double h = 20.0 - 15.24;
  const double density = 1.0 + 25.0 * std::pow(0.3 * (1.0 + 0.02 * h), 2) + 0.01 * h;
  for (const double angle_deg : {0.0, 10.0, 22.5, 37.0, 45.0, 71.0, 90.0, 135.0, 200.0, 333.0}) {
    const double angle = angle_deg * std::acos(-1.0) / 180.0;
    const flight::Waypoint goal = in.above(4510, 4490, 20.0);
    const flight::Waypoint start =
        in.above(4510 + 3800 * std::cos(angle), 4490 + 3800 * std::sin(angle), 20.0);
    const FlightEnvelope envelope(in.costs, options, start, goal);
    const CostBound bound(envelope, goal.point(), start.point());
    EXPECT_LE(bound.cost_m(start.point()), 3800.0 * density) << angle_deg;
    EXPECT_GE(bound.cost_m(start.point()), 0.97 * 3800.0 * density) << angle_deg;
    EXPECT_LE(least_cost_m(envelope), 3800.0 * density) << angle_deg;
    EXPECT_GE(least_cost_m(envelope), 0.98 * 3800.0 * density) << angle_deg;
    EXPECT_EQ(bound.cost_m(goal.point()), 0.0);
  }
}

// Cost of the cheapest way through cells of constant density, over points on their sides: an upper
// bound of the optimum that comes close to it.
double cheapest_m(const raster::GridGeometry& g, const std::function<double(int, int)>& density,
                  const geo::MapPoint& from, const geo::MapPoint& to) {
  constexpr int kPerSide = 6;
  // Points by integer coordinates in steps of cell / kPerSide that lie on a side.
  const int wide = g.columns * kPerSide + 1;
  const double step_m = g.cell_m / kPerSide;
  const auto point = [&](int at) {
    return geo::MapPoint{g.west_m + step_m * (at % wide), g.south_m + step_m * (at / wide)};
  };
  const int count = wide * (g.rows * kPerSide + 1);
  std::vector<double> cost(static_cast<std::size_t>(count),
                           std::numeric_limits<double>::infinity());
  using Entry = std::pair<double, int>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> queue;
  const auto sides_of = [&](int column, int row, const auto& visit) {
    for (int k = 0; k <= kPerSide; ++k) {
      visit((row * kPerSide) * wide + column * kPerSide + k);
      visit(((row + 1) * kPerSide) * wide + column * kPerSide + k);
      visit((row * kPerSide + k) * wide + column * kPerSide);
      visit((row * kPerSide + k) * wide + (column + 1) * kPerSide);
    }
  };
  const auto length = [](const geo::MapPoint& a, const geo::MapPoint& b) {
    return std::hypot(a.x_m - b.x_m, a.y_m - b.y_m);
  };
  const raster::CellIndex first = g.cell_at(from);
  sides_of(first.column, first.row, [&](int at) {
    const double value = length(from, point(at)) * density(first.column, first.row);
    if (value < cost[static_cast<std::size_t>(at)]) {
      cost[static_cast<std::size_t>(at)] = value;
      queue.emplace(value, at);
    }
  });
  while (!queue.empty()) {
    const auto [value, at] = queue.top();
    queue.pop();
    if (value > cost[static_cast<std::size_t>(at)]) {
      continue;
    }
    const int x = at % wide;
    const int y = at / wide;
    // The cells that the point belongs to.
    for (int row = (y - 1 + kPerSide) / kPerSide - 1; row <= y / kPerSide; ++row) {
      for (int column = (x - 1 + kPerSide) / kPerSide - 1; column <= x / kPerSide; ++column) {
        if (column < 0 || row < 0 || column >= g.columns || row >= g.rows) {
          continue;
        }
        sides_of(column, row, [&](int to_at) {
          const double next = value + length(point(at), point(to_at)) * density(column, row);
          if (next < cost[static_cast<std::size_t>(to_at)]) {
            cost[static_cast<std::size_t>(to_at)] = next;
            queue.emplace(next, to_at);
          }
        });
      }
    }
  }
  const raster::CellIndex last = g.cell_at(to);
  double best = std::numeric_limits<double>::infinity();
  sides_of(last.column, last.row, [&](int at) {
    best = std::min(best, cost[static_cast<std::size_t>(at)] +
                              length(point(at), to) * density(last.column, last.row));
  });
  return best;
}

TEST(CostBound, IsBelowTheCheapestWayThroughRandomFieldsAndNearIt) {
  const auto seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  for (int round = 0; round < 4; ++round) {
    // Densities from 1 to 14 side by side: far rougher than maps are.
    const int patch = round % 2 == 0 ? 1 : 6;
    std::uniform_real_distribution<double> share(0.0, 0.6);
    std::vector<double> shares(60 * 60);
    for (double& value : shares) {
      value = share(random);
    }
    const auto visibility = [&](int column, int row) {
      return shares[static_cast<std::size_t>((row / patch) * 60 + column / patch)];
    };
    const PlanningCase in = flat(60, visibility);
    GlobalOptions options = test::shipped_global_options();
    options.lateral_margin_m = 0.0;
    const flight::Waypoint start = in.above(150, 250, 20.0);
    const flight::Waypoint goal = in.above(1610, 1480, 20.0);
    const FlightEnvelope envelope(in.costs, options, start, goal);
    const CostBound bound(envelope, goal.point(), start.point());
    const double best_m = cheapest_m(
        in.map.geometry,
        [&](int column, int row) {
          return envelope.least_density({column, row});
        },
        start.point(), goal.point());
    EXPECT_LE(bound.cost_m(start.point()), best_m) << "patch " << patch;
    EXPECT_GE(bound.cost_m(start.point()), (patch == 1 ? 0.6 : 0.75) * best_m) << "patch " << patch;
    // From both ends it is nearer.
    EXPECT_LE(least_cost_m(envelope), best_m) << "patch " << patch;
    EXPECT_GE(least_cost_m(envelope), (patch == 1 ? 0.8 : 0.9) * best_m) << "patch " << patch;
  }
}

TEST(CostBound, WorksUpToTheEdgeOfTheMap) {
  const PlanningCase in = flat(12, [](int, int) { return 0.0; });
  GlobalOptions options = test::shipped_global_options();
  options.lateral_margin_m = 0.0;
  const flight::Waypoint start = in.above(20, 20, 20.0);
  const flight::Waypoint goal = in.above(340, 340, 20.0);
  const FlightEnvelope envelope(in.costs, options, start, goal);
  const CostBound bound(envelope, goal.point(), start.point());
  const double straight_m = std::hypot(320.0, 320.0) * (1.0 + 0.01 * (20.0 - 15.24));
  EXPECT_LE(bound.cost_m(start.point()), straight_m);
  EXPECT_GE(bound.cost_m(start.point()), 0.8 * straight_m);
  EXPECT_EQ(bound.cost_m({-1.0, 20.0}), 0.0);
}

TEST(CostBound, OverEachTriangleOfACellItIsLinear) {
  const auto seed = test::fresh_seed();
  const PlanningCase in(test::make_fractal_map(seed, 60, 30.0, 1000.0, 60.0), kShipped);
  const GlobalOptions options = test::shipped_global_options();
  const flight::Waypoint start = in.above(200, 300);
  const flight::Waypoint goal = in.above(1500, 1400);
  const FlightEnvelope envelope(in.costs, options, start, goal);
  const CostBound bound(envelope, goal.point(), start.point());
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> share(0.0, 1.0);
  for (int round = 0; round < 200; ++round) {
    const int column = static_cast<int>(share(random) * 59.99);
    const int row = static_cast<int>(share(random) * 59.99);
    // Some place of the triangle with its right angle in one corner, by shares of its sides there.
    double along_x = share(random);
    double along_y = share(random);
    if (along_x + along_y > 1.0) {
      along_x = 1.0 - along_x;
      along_y = 1.0 - along_y;
    }
    const bool is_east = round % 2 == 0;
    const bool is_north = ((column + row) % 2 == 0) == is_east;
    const auto corner_m = [&](bool east, bool north) {
      return bound.corner_cost_m(column + (east ? 1 : 0), row + (north ? 1 : 0));
    };
    const double expected_m = (1.0 - along_x - along_y) * corner_m(is_east, is_north) +
                              along_x * corner_m(!is_east, is_north) +
                              along_y * corner_m(is_east, !is_north);
    const double u = is_east ? 1.0 - along_x : along_x;
    const double v = is_north ? 1.0 - along_y : along_y;
    EXPECT_NEAR(bound.cost_m({30.0 * (column + u), 30.0 * (row + v)}), expected_m,
                1e-6 * (1.0 + expected_m));
  }
}

TEST(CostBound, MadeInStepsIsTheSameAndEachStepIsShort) {
  const auto seed = test::fresh_seed();
  const PlanningCase in(test::make_fractal_map(seed, 300, 30.0, 3000.0, 100.0), kShipped);
  const GlobalOptions options = test::shipped_global_options();
  const flight::Waypoint start = in.above(800, 800);
  const flight::Waypoint goal = in.above(8000, 8200);
  const FlightEnvelope envelope(in.costs, options, start, goal);
  CostBoundMaking making(envelope, goal.point(), start.point());
  int steps = 1;
  while (!making.step()) {
    ++steps;
  }
  EXPECT_TRUE(making.step());  // and stays complete
  // Ninety thousand cells, each looked at ten times and more, at most some thousand a step.
  EXPECT_GT(steps, 150);
  const CostBound in_steps = std::move(making).take();
  const CostBound at_once(envelope, goal.point(), start.point());
  for (int i = 0; i < 300; ++i) {
    EXPECT_EQ(in_steps.corner_cost_m(i, (7 * i) % 300), at_once.corner_cost_m(i, (7 * i) % 300));
  }
}

TEST(CostBound, NoPartOfAnyRouteCostsLessThanItsDifference) {
  const auto seed = test::fresh_seed();
  map::Map map = test::make_fractal_map(seed, 200, 30.0, 2000.0, 250.0);
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> share(0.0, 0.5);
  for (auto& value : map.visibility.values()) {
    value = test::stored_visibility(share(random));
  }
  test::finish_map(map);
  const PlanningCase in(std::move(map), kShipped);
  int routes = 0;
  for (const bool use_lattice : {true, false}) {
    GlobalOptions options = test::shipped_global_options();
    options.use_lattice = use_lattice;
    options.refine = use_lattice;
    const flight::Waypoint start = in.above(900, 1000);
    const flight::Waypoint goal = in.above(5100, 4900);
    const auto result = test::plan(in, options, start, goal);
    const auto* route = std::get_if<flight::Route>(&result);
    if (route == nullptr) {
      continue;
    }
    ++routes;
    const FlightEnvelope envelope(in.costs, options, start, goal);
    const CostBound bound(envelope, goal.point(), start.point());
    const CostBound from_start(envelope, start.point(), goal.point());
    const double whole_m = in.costs.route_cost(route->waypoints, 0.5).total_m();
    EXPECT_LE(bound.cost_m(start.point()), whole_m * (1.0 + 1e-3));
    EXPECT_GE(route->lower_bound_m, flight::length_m({start, goal}) * 0.999);
    EXPECT_LE(least_cost_m(envelope), whole_m * (1.0 + 1e-3));
    EXPECT_GE(least_cost_m(envelope), bound.cost_m(start.point()));
    // And so for what is left from each waypoint on.
    for (std::size_t i = 1; i + 1 < route->waypoints.size(); ++i) {
      const std::vector<flight::Waypoint> rest(
          route->waypoints.begin() + static_cast<std::ptrdiff_t>(i), route->waypoints.end());
      EXPECT_LE(bound.cost_m(rest.front().point()),
                in.costs.route_cost(rest, 0.5).total_m() * (1.0 + 1e-3));
      // Hence the level set of any cost holds all routes of that cost.
      EXPECT_LE(bound.cost_m(rest.front().point()) + from_start.cost_m(rest.front().point()),
                whole_m * (1.0 + 1e-3));
    }
  }
  EXPECT_GE(routes, 1);
}

}  // namespace
}  // namespace hedgehop::global_planning
