#include "global_planning/route_finish.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <random>

#include "global_planning/planning_case.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::global_planning {
namespace {

using flight::Waypoint;
using test::PlanningCase;
using test::shipped_global_options;

using test::kWeights;

TEST(CutShort, ADetourOverFreeGroundBecomesOneLeg) {
  const PlanningCase in(test::make_map(150, 150, 30.0, [](double, double) { return 0.0; }), {});
  const FlightEnvelope envelope(in.costs, shipped_global_options(), in.above(500, 500, 40.0),
                                in.above(3500, 500, 40.0));
  std::vector<Waypoint> route = {
      envelope.start(), {1500, 800, 50.0}, {2500, 900, 60.0}, envelope.goal()};
  std::int64_t work = 0;
  cut_short(envelope, 5.0, 1000, work, route);
  EXPECT_EQ(route, (std::vector<Waypoint>{envelope.start(), envelope.goal()}));
  EXPECT_GT(work, 0);
}

TEST(CutShort, KeepsADetourThatIsCheaperThanTheStraightLeg) {
  // A seen field in the middle of hidden ground: 26 per metre against 1.
  map::Map map = test::make_map(150, 150, 30.0, [](double, double) { return 0.0; });
  for (int row = 0; row < 30; ++row) {
    for (int column = 50; column < 90; ++column) {
      map.visibility.at(column, row) = test::stored_visibility(1.0);
    }
  }
  test::finish_map(map);
  const PlanningCase in(std::move(map), {25.0, 0.0, 0.0, 0.0});
  const FlightEnvelope envelope(in.costs, shipped_global_options(), in.above(500, 500, 40.0),
                                in.above(3600, 500, 40.0));
  const std::vector<Waypoint> detour = {
      envelope.start(), {1300, 1000, 40.0}, {2800, 1000, 40.0}, envelope.goal()};
  std::vector<Waypoint> route = detour;
  std::int64_t work = 0;
  cut_short(envelope, 5.0, 1000, work, route);
  EXPECT_EQ(route, detour);
}

TEST(CutShort, NeverRaisesTheCostNorBreaksARuleNorOverspends) {
  const std::uint64_t seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  const PlanningCase in(test::make_fractal_map(seed, 200, 30.0, 4000.0, 150.0), kWeights);
  GlobalOptions options = shipped_global_options();
  options.envelope_ceiling_m = 300.0;
  const FlightEnvelope envelope(in.costs, options, in.above(600, 3000, 40.0),
                                in.above(5400, 3000, 40.0));
  int shortened = 0;
  for (int k = 0; k < 20; ++k) {
    std::vector<Waypoint> route = {envelope.start()};
    for (double x_m = 1000.0; x_m < 5100.0; x_m += 400.0) {
      const geo::MapPoint p{x_m, 3000.0 + 150.0 * (unit(random) - 0.5)};
      route.push_back({p.x_m, p.y_m, envelope.band_at(p).low_m + 60.0 + 20.0 * unit(random)});
    }
    route.push_back(envelope.goal());
    const auto before = route;
    std::int64_t work = 5;
    const std::int64_t budget = 5 + static_cast<std::int64_t>(60.0 * unit(random));
    cut_short(envelope, 5.0, budget, work, route);
    EXPECT_LE(work, budget);
    EXPECT_EQ(route.front(), before.front());
    EXPECT_EQ(route.back(), before.back());
    EXPECT_LE(in.costs.route_cost(route, 5.0).total_m(),
              in.costs.route_cost(before, 5.0).total_m() * (1.0 + 1e-12));
    for (std::size_t i = 1; i < route.size(); ++i) {
      const bool is_old = std::adjacent_find(before.begin(), before.end(),
                                             [&](const Waypoint& a, const Waypoint& b) {
                                               return a == route[i - 1] && b == route[i];
                                             }) != before.end();
      EXPECT_TRUE(is_old || envelope.is_clear(route[i - 1], route[i]));
    }
    shortened += route.size() < before.size() ? 1 : 0;
  }
  EXPECT_GT(shortened, 0);
}

TEST(Equidistant, PointsLieOnThePolylineAtEqualDistanceAlongIt) {
  // 500 + 300 + 400 m
  const std::vector<Waypoint> route = {{0, 0, 0}, {400, 300, 0}, {400, 600, 0}, {400, 600, 400}};
  double spacing_m = 0.0;
  const auto guide = equidistant(route, 50.0, spacing_m);
  EXPECT_NEAR(spacing_m, 50.0, 1e-12);
  ASSERT_EQ(guide.size(), 25U);
  EXPECT_EQ(guide.front(), route.front());
  EXPECT_EQ(guide.back(), route.back());
  EXPECT_NEAR(guide[5].x_m, 200.0, 1e-9);
  EXPECT_NEAR(guide[5].y_m, 150.0, 1e-9);
  EXPECT_NEAR(guide[13].y_m, 450.0, 1e-9);
  EXPECT_NEAR(guide[20].altitude_m, 200.0, 1e-9);
}

TEST(Equidistant, TheSpacingIsTheNearestThatDividesTheLength) {
  const std::vector<Waypoint> route = {{0, 0, 0}, {130, 0, 0}};
  double spacing_m = 0.0;
  const auto guide = equidistant(route, 50.0, spacing_m);
  EXPECT_EQ(guide.size(), 4U);  // 43.3 m is nearer to 50 than 65
  EXPECT_NEAR(spacing_m, 130.0 / 3.0, 1e-12);
  EXPECT_EQ(equidistant({{0, 0, 0}, {10, 0, 0}}, 50.0, spacing_m).size(), 2U);
  EXPECT_NEAR(spacing_m, 10.0, 1e-12);
}

}  // namespace
}  // namespace hedgehop::global_planning
