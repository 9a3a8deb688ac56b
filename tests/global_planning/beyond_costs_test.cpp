// Costs beyond eq. (1): what they make planners do, and that bounds hold with them.

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <queue>
#include <random>
#include <tbb/global_control.h>
#include <utility>

#include "global_planning/cost_bound.hpp"
#include "global_planning/cost_field.hpp"
#include "global_planning/planning_case.hpp"
#include "global_planning/roadmap.hpp"
#include "global_planning/stock_planner.hpp"
#include "global_planning/warm_planner.hpp"
#include "risk/ground_slope.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::global_planning {
namespace {

using flight::Route;
using flight::Waypoint;
using test::PlanningCase;
using test::shipped_global_options;

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr risk::CostWeights kAll{25.0, 0.02, 4.0, 0.01, 70.0, 0.03, 2.5, 600.0, 12.0};

map::OverheadLine line_of(const std::vector<geo::MapPoint>& supports) {
  map::OverheadLine line;
  for (const geo::MapPoint& point : supports) {
    line.supports.push_back({point, 20.0, true});
  }
  return line;
}

// Hills with two observers, who see what is higher than some smooth height, and a power line.
map::Map busy_map(std::uint64_t seed, int cells, double relief_m) {
  map::Map map = test::make_fractal_map(seed, cells, 30.0, 2000.0, relief_m);
  for (std::uint64_t i = 1; i <= 2; ++i) {
    map::HeightLayer layer{"observer", raster::Grid<float>(map.geometry, kNaN)};
    const test::FractalTerrain lowest(seed + i, 1500.0, 250.0);
    for (int row = 0; row < cells; ++row) {
      for (int column = 0; column < cells; ++column) {
        const geo::MapPoint at = map.geometry.centre({column, row});
        const double height_m = lowest(at.x_m, at.y_m) - 60.0;
        if (height_m < 90.0) {
          layer.height_m.at(column, row) = static_cast<float>(std::max(height_m, 0.0));
        }
      }
    }
    map.threats.push_back(layer);
  }
  const double side_m = 30.0 * cells;
  std::vector<geo::MapPoint> poles;
  for (int i = 0; i <= 12; ++i) {
    poles.push_back(
        {0.02 * side_m + 0.08 * side_m * i, 0.5 * side_m + (i % 2 == 0 ? 0.03 : -0.03) * side_m});
  }
  map.overhead_lines = {line_of(poles)};
  test::finish_map(map);
  return map;
}

Route route_of(const PlanningCase& in, const GlobalOptions& options, const Waypoint& start,
               const Waypoint& goal) {
  auto result = test::plan(in, options, start, goal);
  const auto* route = std::get_if<Route>(&result);
  if (route == nullptr) {
    ADD_FAILURE() << std::get<flight::NoPlan>(result).explanation;
    return {};
  }
  return *route;
}

TEST(BeyondCosts, OfLegsAreThoseOfRoutes) {
  const auto seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  const PlanningCase in(busy_map(seed, 120, 200.0), kAll);
  GlobalOptions options = shipped_global_options();
  options.check_step_m = 1.0;
  options.final_check_step_m = 1.0;
  const FlightEnvelope envelope(in.costs, options, in.above(200, 200), in.above(300, 200));
  std::uniform_real_distribution<double> place(700.0, 2900.0);
  std::uniform_real_distribution<double> share(0.0, 1.0);
  int legs = 0;
  for (int round = 0; round < 2000 && legs < 60; ++round) {
    const auto drawn = [&](double x_m, double y_m) {
      const AltitudeBand band = envelope.band_at({x_m, y_m});
      return Waypoint{x_m, y_m, band.low_m + share(random) * (band.high_m - band.low_m)};
    };
    const Waypoint a = drawn(place(random), place(random));
    const Waypoint b =
        drawn(a.x_m + 500.0 * (share(random) - 0.5), a.y_m + 500.0 * (share(random) - 0.5));
    const double cost_m = envelope.leg_cost_m(a, b);
    if (cost_m < kInfinity) {
      ++legs;
      EXPECT_NEAR(cost_m, in.costs.route_cost({a, b}, 1.0).total_m(), 1e-6 * cost_m);
      EXPECT_NEAR(envelope.route_cost_m({a, b}, 1.0), cost_m, 1e-6 * cost_m);
      EXPECT_NEAR(envelope.leg_cost_m(b, a), cost_m, 1e-6 * cost_m);
    }
  }
  EXPECT_EQ(legs, 60);
}

TEST(BeyondCosts, NoPlaceOfACellCostsLessThanItsLeastDensityAtAnyHeightInAnyDirection) {
  const auto seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  const PlanningCase in(busy_map(seed, 60, 200.0), kAll);
  const GlobalOptions options = shipped_global_options();
  const FlightEnvelope envelope(in.costs, options, in.above(200, 200), in.above(300, 200));
  std::uniform_real_distribution<double> share(0.0, 1.0);
  double nearest = kInfinity;
  for (int round = 0; round < 60000; ++round) {
    const geo::MapPoint point{1800.0 * share(random), 1800.0 * share(random)};
    const AltitudeBand band = envelope.band_at(point);
    if (!band.is_flyable()) {
      continue;
    }
    const double angle = 6.283185307179586 * share(random);
    const double height = round % 2 == 0 ? 0.0 : share(random);
    const double density = envelope.density_at(
        {point.x_m, point.y_m, band.low_m + 1e-6 + height * (band.high_m - band.low_m - 2e-6)},
        std::cos(angle), std::sin(angle));
    const double least = envelope.least_density(in.map.geometry.cell_at(point));
    ASSERT_LE(least, density + 1e-9);
    nearest = std::min(nearest, density / least);
  }
  EXPECT_LT(nearest, 1.02);
}

TEST(BeyondCosts, TheBoundIsBelowEveryPlannersRoute) {
  for (int round = 0; round < 2; ++round) {
    const auto seed = test::fresh_seed();
    const PlanningCase in(busy_map(seed, 180, round == 0 ? 100.0 : 220.0), kAll);
    const GlobalOptions options = shipped_global_options(40000);
    const Waypoint start = in.above(900, 1000);
    const Waypoint goal = in.above(4500, 4300);
    const FlightEnvelope envelope(in.costs, options, start, goal);
    const double bound_m = CostBound(envelope, goal.point(), start.point()).cost_m(start.point());
    EXPECT_GE(bound_m, 0.99 * std::hypot(3600.0, 3300.0));
    int routes = 0;
    const auto judge = [&](const std::vector<Waypoint>& waypoints, const char* planner) {
      ++routes;
      EXPECT_LE(bound_m, in.costs.route_cost(waypoints, 0.5).total_m() * (1.0 + 1e-3)) << planner;
    };
    SilentObserver observer;
    const Roadmap roadmap(in.costs, options, observer);
    for (const char* planner : {"lattice", "bit_star", "roadmap"}) {
      GlobalOptions asked = options;
      asked.use_lattice = planner != std::string("bit_star");
      asked.use_roadmap = planner == std::string("roadmap");
      const RouteProblem problem{start, goal, 1, asked.work_budget,
                                 asked.use_roadmap ? &roadmap : nullptr};
      const auto found = plan_leg(in.costs, asked, problem, {}, observer);
      if (const auto* route = std::get_if<Route>(&found)) {
        judge(route->waypoints, planner);
        EXPECT_LE(route->lower_bound_m, route->cost.total_m());
        EXPECT_EQ(route->cost, in.costs.route_cost(route->waypoints, 1.0));
      }
    }
    EXPECT_GE(routes, 2) << "relief too steep for most";
  }
}

// The cheapest polyline over a grid of places: centres of every other cell, four heights. Its steps
// lead to the sixteen neighbours one or two places away.
double cheapest_on_grid_m(const PlanningCase& in, const FlightEnvelope& envelope,
                          const geo::MapPoint& from, const geo::MapPoint& to) {
  constexpr int kHeights = 4;
  constexpr std::array<double, kHeights> kShare = {0.001, 0.2, 0.5, 0.9};
  const raster::GridGeometry& g = in.map.geometry;
  const int wide = g.columns / 2;
  const int high = g.rows / 2;
  std::vector<Waypoint> places;
  for (int row = 0; row < high; ++row) {
    for (int column = 0; column < wide; ++column) {
      const geo::MapPoint at = g.centre({2 * column, 2 * row});
      const AltitudeBand band = envelope.band_at(at);
      for (const double share : kShare) {
        places.push_back({at.x_m, at.y_m, band.low_m + share * (band.high_m - band.low_m)});
      }
    }
  }
  const auto number = [&](const geo::MapPoint& point) {
    const raster::CellIndex cell = g.cell_at(point);
    return (cell.row / 2 * wide + cell.column / 2) * kHeights;
  };
  using Entry = std::pair<double, int>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> queue;
  std::vector<double> cost(places.size(), kInfinity);
  for (int k = 0; k < kHeights; ++k) {
    cost[static_cast<std::size_t>(number(from) + k)] = 0.0;
    queue.emplace(0.0, number(from) + k);
  }
  while (!queue.empty()) {
    const auto [value, at] = queue.top();
    queue.pop();
    if (value > cost[static_cast<std::size_t>(at)]) {
      continue;
    }
    if (at / kHeights == number(to) / kHeights) {
      return value;
    }
    const int column = at / kHeights % wide;
    const int row = at / kHeights / wide;
    for (int dr = -2; dr <= 2; ++dr) {
      for (int dc = -2; dc <= 2; ++dc) {
        const bool is_step = std::max(std::abs(dr), std::abs(dc)) == 1 ||
                             (std::max(std::abs(dr), std::abs(dc)) == 2 &&
                              std::min(std::abs(dr), std::abs(dc)) == 1);
        if (!is_step || column + dc < 0 || column + dc >= wide || row + dr < 0 ||
            row + dr >= high) {
          continue;
        }
        for (int k = 0; k < kHeights; ++k) {
          const int next = ((row + dr) * wide + column + dc) * kHeights + k;
          const Waypoint& a = places[static_cast<std::size_t>(at)];
          const Waypoint& b = places[static_cast<std::size_t>(next)];
          if (!(envelope.leg_cost_m(a, b) < kInfinity)) {
            continue;
          }
          const double there = value + in.costs.route_cost({a, b}, 2.0).total_m();
          if (there < cost[static_cast<std::size_t>(next)]) {
            cost[static_cast<std::size_t>(next)] = there;
            queue.emplace(there, next);
          }
        }
      }
    }
  }
  return kInfinity;
}

TEST(BeyondCosts, TheBoundIsBelowTheCheapestOfAllPolylinesOverAGridOfPlaces) {
  int compared = 0;
  for (int round = 0; round < 3; ++round) {
    const auto seed = test::fresh_seed();
    const PlanningCase in(busy_map(seed, 56, 60.0), kAll);
    GlobalOptions options = shipped_global_options();
    options.check_step_m = 10.0;
    options.final_check_step_m = 5.0;
    const geo::MapPoint from = in.map.geometry.centre({8, 10});
    const geo::MapPoint to = in.map.geometry.centre({46, 44});
    const FlightEnvelope envelope(in.costs, options, in.above(from.x_m, from.y_m, 40.0),
                                  in.above(to.x_m, to.y_m, 40.0));
    const double best_m = cheapest_on_grid_m(in, envelope, from, to);
    const double bound_m = CostBound(envelope, to, from).cost_m(from);
    if (best_m < kInfinity) {
      ++compared;
      EXPECT_LE(bound_m, best_m * (1.0 + 2e-3));
      EXPECT_GE(bound_m, 0.4 * best_m);
    }
  }
  EXPECT_GE(compared, 1);
}

// Where a route crosses a line along x; NaN if nowhere.
double crossing_x_m(const std::vector<Waypoint>& route, double y_m) {
  for (std::size_t i = 1; i < route.size(); ++i) {
    const Waypoint& a = route[i - 1];
    const Waypoint& b = route[i];
    if ((a.y_m < y_m) != (b.y_m < y_m)) {
      return a.x_m + (y_m - a.y_m) / (b.y_m - a.y_m) * (b.x_m - a.x_m);
    }
  }
  return std::numeric_limits<double>::quiet_NaN();
}

TEST(BeyondCosts, ARouteCrossesAPowerLineAtAPole) {
  for (const bool use_lattice : {true, false}) {
    map::Map map = test::make_map(200, 200, 30.0, [](double, double) { return 100.0; });
    // Poles 400 m apart; the straight way crosses in the middle of a span.
    std::vector<geo::MapPoint> poles;
    for (int i = 0; i < 14; ++i) {
      poles.push_back({400.0 * i + 300.0, 3000.0});
    }
    map.overhead_lines = {line_of(poles)};
    test::finish_map(map);
    GlobalOptions options = shipped_global_options();
    options.use_lattice = use_lattice;
    const auto crossing = [&](double weight_m) {
      const PlanningCase in(map, {.height_1pm = 0.01, .wire_crossing_m = weight_m});
      const Route route = route_of(in, options, in.above(2900, 900), in.above(2900, 5100));
      const double x_m = crossing_x_m(route.waypoints, 3000.0);
      const double off = std::fabs(std::remainder(x_m - 300.0, 400.0));
      EXPECT_NEAR(route.cost.wire_crossings_m, weight_m * off / 200.0, 1e-6 * weight_m + 1e-9);
      return off;
    };
    EXPECT_GT(crossing(0.0), 150.0) << "straight on";
    // A way over the pole, 200 m aside on 4200 m, is 20 m longer.
    EXPECT_LT(crossing(1000.0), 20.0);
  }
}

TEST(BeyondCosts, ARoutePassesOutOfSightOfANamedObserver) {
  for (const bool use_lattice : {true, false}) {
    map::Map map = test::make_map(200, 200, 30.0, [](double, double) { return 100.0; });
    // Seen at any height in a disc that lies on the way, but not behind a hill in its north.
    map::HeightLayer layer{"tower", raster::Grid<float>(map.geometry, kNaN)};
    for (int row = 0; row < 200; ++row) {
      for (int column = 0; column < 200; ++column) {
        const geo::MapPoint at = map.geometry.centre({column, row});
        if (std::hypot(at.x_m - 3000.0, at.y_m - 3000.0) < 1000.0) {
          layer.height_m.at(column, row) = at.y_m > 3600.0 ? 100.0F : 0.0F;
        }
      }
    }
    map.threats = {layer};
    test::finish_map(map);
    GlobalOptions options = shipped_global_options();
    options.use_lattice = use_lattice;
    const auto planned = [&](double weight) {
      const PlanningCase in(map, {.height_1pm = 0.01, .threats = weight});
      return route_of(in, options, in.above(900, 3100), in.above(5100, 3100));
    };
    const Route straight = planned(0.0);
    EXPECT_EQ(straight.cost.threats_m, 0.0);
    const Route hidden = planned(10.0);
    EXPECT_LT(hidden.cost.threats_m, 0.02 * 10.0 * 1900.0) << "straight on nearly 2 km are seen";
    EXPECT_GT(hidden.cost.length_m, straight.cost.length_m + 50.0);
    EXPECT_LT(hidden.cost.total_m(), 5200.0);
    // Behind the hill, not around the disc.
    EXPECT_GT(crossing_x_m(hidden.waypoints, 3600.0), 1900.0);
  }
}

double steepest_along(const map::Map& map, const std::vector<Waypoint>& route) {
  const auto slopes = risk::ground_slopes(map.terrain_m);
  double squares = 0.0;
  double length_m = 0.0;
  for (std::size_t i = 1; i < route.size(); ++i) {
    const double dx_m = route[i].x_m - route[i - 1].x_m;
    const double dy_m = route[i].y_m - route[i - 1].y_m;
    const double leg_m = std::hypot(dx_m, dy_m);
    const raster::CellIndex cell = map.geometry.cell_at(
        {0.5 * (route[i].x_m + route[i - 1].x_m), 0.5 * (route[i].y_m + route[i - 1].y_m)});
    const auto& g =
        slopes[static_cast<std::size_t>(cell.row) * static_cast<std::size_t>(map.geometry.columns) +
               static_cast<std::size_t>(cell.column)];
    const double along =
        (static_cast<double>(g[0]) * dx_m + static_cast<double>(g[1]) * dy_m) / leg_m;
    squares += along * along * leg_m;
    length_m += leg_m;
  }
  return std::sqrt(squares / length_m);
}

TEST(BeyondCosts, ARouteClimbsAHillsideObliquely) {
  // Up a hillside of 0.25 with a climb limit that straight up would keep. The goal lies 300 m to
  // the side on 3 km.
  map::Map map =
      test::make_map(200, 200, 30.0, [](double x_m, double) { return 100.0 + 0.25 * x_m; });
  for (const bool use_lattice : {true, false}) {
    GlobalOptions options = shipped_global_options();
    options.use_lattice = use_lattice;
    options.climb_angle_max_rad = options.descent_angle_max_rad = 0.35;
    options.turn_radius_m = 100.0;
    const auto planned = [&](double weight) {
      const PlanningCase in(map, {.height_1pm = 0.01, .slope_along = weight});
      return route_of(in, options, in.above(1500, 2800), in.above(4500, 3100));
    };
    const Route direct = planned(0.0);
    const Route oblique = planned(100.0);
    EXPECT_NEAR(steepest_along(map, direct.waypoints), 0.25, 0.01);
    EXPECT_LT(steepest_along(map, oblique.waypoints), 0.2)
        << (use_lattice ? "lattice" : "bit_star");
    const risk::CostModel costs(map, {.height_1pm = 0.01, .slope_along = 100.0},
                                risk::SemanticCostTable({}, 0.0), 1.0);
    EXPECT_LT(oblique.cost.total_m(), 0.95 * costs.route_cost(direct.waypoints, 1.0).total_m());
  }
}

TEST(BeyondCosts, ARouteGoesAroundAGorgeToStayUnderTheSoftCeiling) {
  // A gorge 100 m deep and 240 m wide lies across the way and ends 500 m to the north of it; over
  // it the climb limit keeps flights high above its bottom.
  const map::Map map = test::make_map(200, 200, 30.0, [](double x_m, double y_m) {
    return std::fabs(x_m - 3000.0) < 120.0 && y_m < 3500.0 ? 0.0 : 100.0;
  });
  for (const bool use_lattice : {true, false}) {
    GlobalOptions options = shipped_global_options();
    options.use_lattice = use_lattice;
    const auto planned = [&](double weight_1pm) {
      const PlanningCase in(
          map, {.height_1pm = 0.001, .soft_ceiling_m = 60.0, .soft_ceiling_1pm = weight_1pm});
      return route_of(in, options, in.above(900, 3000, 30.0), in.above(5100, 3000, 30.0));
    };
    const Route low = planned(0.2);
    double greatest_y_m = 0.0;
    for (const Waypoint& waypoint : low.waypoints) {
      greatest_y_m = std::max(greatest_y_m, waypoint.y_m);
    }
    EXPECT_GT(greatest_y_m, 3500.0);
    // Straight over it 240 m would cost 0.2 times some 50 m each.
    EXPECT_LT(low.cost.soft_ceiling_m, 100.0);
    const Route straight = planned(0.0);
    for (const Waypoint& waypoint : straight.waypoints) {
      EXPECT_LT(waypoint.y_m, 3300.0);
    }
  }
}

TEST(BeyondCosts, AFieldOnAHillsideKnowsTheDirection) {
  map::Map map =
      test::make_map(120, 120, 30.0, [](double x_m, double) { return 100.0 + 0.2 * x_m; });
  const PlanningCase in(map, {.slope_along = 50.0});
  GlobalOptions options = shipped_global_options();
  options.end_funnel_m = 1.0;
  options.climb_angle_max_rad = 0.3;  // the hillside is not too steep to be flown straight up
  const geo::MapPoint target{1815.0, 1815.0};
  const FlightEnvelope envelope(in.costs, options, in.above(600, 600), in.above(700, 600));
  const CostField field(envelope, target, 30.0);
  // A metre costs 1 across and 1 + 50 * 0.04 = 3 up or down; the field divides by 1.0275.
  EXPECT_NEAR(field.cost_m({1815.0, 2715.0}), 900.0 / 1.0275, 1.0);
  // Up, zigzag along the diagonals: sqrt(2) times the way, 1 + 50 * 0.04 / 2 = 2 for each metre.
  EXPECT_NEAR(field.cost_m({2715.0, 1815.0}), 900.0 * 2.0 * std::sqrt(2.0) / 1.0275, 1.0);
  const CostField straight_on(
      FlightEnvelope(in.costs, options, in.above(600, 600), in.above(700, 600)), target, 90.0);
  EXPECT_NEAR(straight_on.cost_m({1815.0, 2715.0}), 900.0 / 1.0275, 15.0);
  // What is kept in a file is the same field.
  const auto kept = CostField::with_numbers(in.map.geometry, 30.0, field.numbers());
  ASSERT_TRUE(kept);
  const CostField again(*kept, target, {600.0, 600.0});
  EXPECT_EQ(again.cost_m({2415.0, 2115.0}), field.cost_m({2415.0, 2115.0}));
  auto broken = field.numbers();
  broken.back() = -1.0F;
  EXPECT_FALSE(CostField::with_numbers(in.map.geometry, 30.0, broken));
}

TEST(BeyondCosts, ARoadmapKnowsThemAndIsReadBackAsItWasWritten) {
  const auto seed = test::fresh_seed();
  const PlanningCase in(busy_map(seed, 160, 60.0), kAll);
  const GlobalOptions options = shipped_global_options();
  SilentObserver observer;
  const Roadmap roadmap(in.costs, options, observer);
  constexpr Hash128 kKey{3, 4};
  const Bytes bytes = roadmap.written(kKey);
  std::string why;
  const auto read = Roadmap::read(bytes, kKey, in.map.geometry, why);
  ASSERT_TRUE(read) << why;
  EXPECT_EQ(read->written(kKey), bytes);
  const FlightEnvelope envelope(in.costs, options, in.above(700, 800), in.above(4000, 3900));
  std::int64_t work = 0;
  std::int64_t work_read = 0;
  const auto never = [] { return false; };
  EXPECT_EQ(roadmap_route(envelope, *read, 1000000, work_read, never),
            roadmap_route(envelope, roadmap, 1000000, work, never));
}

TEST(BeyondCosts, RoutesAreTheSameForAnyNumberOfThreads) {
  const auto seed = test::fresh_seed();
  const PlanningCase in(busy_map(seed, 150, 100.0), kAll);
  const GlobalOptions options = shipped_global_options();
  const auto planned = [&](std::size_t threads) {
    const tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
    return route_of(in, options, in.above(700, 800), in.above(3700, 3600));
  };
  const Route one = planned(1);
  const Route two = planned(2);
  EXPECT_EQ(one.waypoints, two.waypoints);
  EXPECT_EQ(one.cost, two.cost);
  EXPECT_EQ(one.work_units, two.work_units);
}

TEST(BeyondCosts, APlannerThatIsWarmAvoidsAnObserverThatAppears) {
  map::Map map = test::make_map(200, 200, 30.0, [](double, double) { return 100.0; });
  map.threats = {{"tower", raster::Grid<float>(map.geometry, kNaN)}};
  test::finish_map(map);
  PlanningCase in(map, {.height_1pm = 0.01, .threats = 8.0});
  const GlobalOptions options = shipped_global_options();
  const Waypoint start = in.above(900, 3050);
  const Waypoint goal = in.above(5100, 3050);
  const Route before = route_of(in, options, start, goal);
  const RouteProblem problem{start, goal, 1, options.work_budget};
  WarmPlanner planner(in.costs, options, problem, before.waypoints);
  const raster::Window window{80, 75, 40, 40};
  for (int row = window.row; row < window.row + window.rows; ++row) {
    for (int column = window.column; column < window.column + window.columns; ++column) {
      in.map.threats[0].height_m.at(column, row) = 10.0F;
    }
  }
  planner.costs_changed(in.costs.visibility_changed(window));
  const double old_m = in.costs.route_cost(before.waypoints, 1.0).total_m();
  EXPECT_NEAR(old_m, before.cost.total_m() + 8.0 * 1200.0, 60.0);
  const auto found = planner.replan(start, SilentObserver());
  ASSERT_TRUE(std::holds_alternative<WarmRoute>(found));
  const Route& route = std::get<WarmRoute>(found).route;
  EXPECT_EQ(route.cost, in.costs.route_cost(route.waypoints, 1.0));
  EXPECT_LT(route.cost.threats_m, 0.02 * 8.0 * 1200.0);
  EXPECT_LT(route.cost.total_m(), 0.5 * old_m);
}

}  // namespace
}  // namespace hedgehop::global_planning
