#include "global_planning/stock_planner.hpp"

#include <atomic>
#include <cmath>
#include <gtest/gtest.h>
#include <set>
#include <string>

#include "global_planning/planning_case.hpp"
#include "global_planning/route_finish.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::global_planning {
namespace {

using flight::Waypoint;
using test::PlanningCase;
using test::shipped_global_options;

using test::kWeights;
constexpr double kRadius_m = 282.0;

struct StockCase {
  PlanningCase in;
  GlobalOptions options = shipped_global_options();
  FlightEnvelope envelope;

  explicit StockCase(std::uint64_t seed)
      // Gentle enough for planners that try few edges.
      : in(test::make_fractal_map(seed, 200, 30.0, 4000.0, 4.0), kWeights),
        envelope(in.costs, options, in.above(1000, 1000), in.above(4800, 4600)) {}

  /// Stops after so many questions; returns the last route.
  std::vector<Waypoint> run(StockPlanner& planner, int questions,
                            std::vector<double>* costs_m = nullptr) const {
    std::vector<Waypoint> last;
    std::atomic<int> asked{0};
    planner.run([&] { return ++asked > questions; },
                [&](const std::vector<Waypoint>& route) {
                  last = route;
                  if (costs_m != nullptr) {
                    costs_m->push_back(in.costs.route_cost(route, 1.0).total_m());
                  }
                });
    return last;
  }

  [[nodiscard]] bool is_valid(const std::vector<Waypoint>& route) const {
    bool is_good = route.front() == envelope.start() && route.back() == envelope.goal();
    for (std::size_t i = 1; i < route.size(); ++i) {
      is_good = is_good && envelope.is_clear(route[i - 1], route[i]);
    }
    return is_good;
  }
};

class EachStockPlanner : public ::testing::TestWithParam<StockMethod> {};

TEST_P(EachStockPlanner, FindsRoutesThatFlyAndGetCheaper) {
  const StockCase in(3);
  StockPlanner planner(in.envelope, in.options, GetParam(), kRadius_m, test::fresh_seed());
  std::vector<double> costs_m;
  std::vector<Waypoint> route;
  for (int attempt = 0; attempt < 60 && route.empty(); ++attempt) {
    route = in.run(planner, 500, &costs_m);
  }
  ASSERT_FALSE(route.empty());
  EXPECT_TRUE(in.is_valid(route));
  const double straight_m = flight::length_m({in.envelope.start(), in.envelope.goal()});
  for (std::size_t i = 0; i < costs_m.size(); ++i) {
    EXPECT_GT(costs_m[i], straight_m);
    // By its own sums, in steps of 30 m, each is better than the one before.
    if (i > 0) {
      EXPECT_LT(costs_m[i], 1.1 * costs_m[i - 1]);
    }
  }
  EXPECT_GT(planner.edge_evaluations(), 10);
  // It goes on where it ended; AIT* looks backward for a while before it asks for edges again.
  const std::int64_t before = planner.edge_evaluations();
  for (int attempt = 0; attempt < 50 && planner.edge_evaluations() == before; ++attempt) {
    in.run(planner, 200);
  }
  EXPECT_GT(planner.edge_evaluations(), before);
}

INSTANTIATE_TEST_SUITE_P(StockPlanners, EachStockPlanner, ::testing::ValuesIn(kStockMethods),
                         [](const auto& method) { return std::string(name_of(method.param)); });

TEST(StockPlanner, DubinsRoutesTurnNoMoreSharplyThanTheRadius) {
  const StockCase in(3);
  StockPlanner planner(in.envelope, in.options, StockMethod::kDubins, kRadius_m, 5);
  std::vector<Waypoint> route;
  for (int attempt = 0; attempt < 20 && route.empty(); ++attempt) {
    route = in.run(planner, 1500);
  }
  ASSERT_GT(route.size(), 100U);
  for (std::size_t i = 2; i < route.size(); ++i) {
    const Waypoint& a = route[i - 2];
    const Waypoint& b = route[i - 1];
    const Waypoint& c = route[i];
    const double first_m = std::hypot(b.x_m - a.x_m, b.y_m - a.y_m);
    const double second_m = std::hypot(c.x_m - b.x_m, c.y_m - b.y_m);
    const double turn_rad = std::remainder(
        std::atan2(c.y_m - b.y_m, c.x_m - b.x_m) - std::atan2(b.y_m - a.y_m, b.x_m - a.x_m),
        2.0 * std::acos(-1.0));
    // Chords of arcs turn by the mean of the arcs that they span.
    EXPECT_LE(std::fabs(turn_rad), 0.5 * (first_m + second_m) / kRadius_m * 1.001 + 1e-6);
    EXPECT_LE(first_m, in.options.final_check_step_m + 1e-6);
  }
}

TEST(StockPlanner, DubinsRoutesBeginAndEndWithTheHeadingsThatAreAskedFor) {
  const StockCase in(3);
  const double pi = std::acos(-1.0);
  const double straight_rad = std::atan2(in.envelope.goal().y_m - in.envelope.start().y_m,
                                         in.envelope.goal().x_m - in.envelope.start().x_m);
  const EndHeadings headings{straight_rad + 0.4, straight_rad - 0.3};
  StockPlanner planner(in.envelope, in.options, StockMethod::kDubins, kRadius_m, 5, headings);
  std::vector<Waypoint> route;
  for (int attempt = 0; attempt < 20 && route.empty(); ++attempt) {
    route = in.run(planner, 1500);
  }
  ASSERT_GT(route.size(), 100U);
  const auto heading_rad = [&](std::size_t from) {
    return std::atan2(route[from + 1].y_m - route[from].y_m, route[from + 1].x_m - route[from].x_m);
  };
  // A chord of an arc turns by half of what it spans.
  const double chord_rad = 0.5 * in.options.final_check_step_m / kRadius_m + 1e-6;
  EXPECT_LE(std::fabs(std::remainder(heading_rad(0) - *headings.start_math_rad, 2.0 * pi)),
            chord_rad);
  EXPECT_LE(
      std::fabs(std::remainder(heading_rad(route.size() - 2) - *headings.goal_math_rad, 2.0 * pi)),
      chord_rad);
}

TEST(StockPlanner, NamesDiffer) {
  std::set<std::string_view> names;
  for (const StockMethod method : kStockMethods) {
    names.insert(name_of(method));
  }
  EXPECT_EQ(names.size(), kStockMethods.size());
  EXPECT_EQ(name_of(StockMethod::kInformedRrtStar), "ompl_informed_rrtstar");
}

TEST(StockPlanner, DubinsNeedsARadius) {
  const StockCase in(3);
  EXPECT_THROW(StockPlanner(in.envelope, in.options, StockMethod::kDubins, 0.0, 1),
               std::invalid_argument);
}

}  // namespace
}  // namespace hedgehop::global_planning
