#include "global_planning/way_around.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <limits>

#include "global_planning/planning_case.hpp"
#include "global_planning/route_line.hpp"
#include "global_planning/track_profile.hpp"

namespace hedgehop::global_planning {
namespace {

using flight::Waypoint;
using test::shipped_global_options;

using test::kWeights;
constexpr std::int64_t kWork = 1'000'000;

// A plain of 12 x 9 km, with a flight from west to east.
class WayAroundOnPlain : public ::testing::Test {
 protected:
  WayAroundOnPlain()
      : in_(test::make_map(200, 150, 60.0, [](double, double) { return 100.0; }), kWeights),
        options_(shipped_global_options()),
        envelope_(in_.costs, options_, in_.above(1500.0, 4500.0), in_.above(10500.0, 4500.0)),
        to_goal_(envelope_, envelope_.goal().point(), 120.0),
        ways_(envelope_, options_,
              CostField(to_goal_, envelope_.start().point(), envelope_.goal().point()), kWork) {
    for (double x_m = 1500.0; x_m <= 10500.0; x_m += 500.0) {
      question_.corners.push_back(in_.above(x_m, 4500.0));
      question_.corners.back().altitude_m += x_m == 1500.0 || x_m == 10500.0 ? 0.0 : 10.0;
      question_.cost_m.push_back((x_m - 1500.0) * density());
    }
    question_.dearer_m = [](const geo::MapPoint&) { return 0.0; };
    question_.is_changed = [](const geo::MapPoint&, const geo::MapPoint&) { return false; };
  }
  // Of a metre as low as it may be flown.
  [[nodiscard]] double density() const {
    return envelope_.low_density(envelope_.geometry().cell_at({6000.0, 4500.0}));
  }
  [[nodiscard]] std::vector<WayAround> ways_around(std::int64_t work_budget, std::size_t most) {
    std::vector<WayAround> found;
    find_ways_around(
        envelope_, ways_, question_, work_budget, [] { return false; },
        [&](const WayAround& way) {
          found.push_back(way);
          return found.size() == most;
        });
    return found;
  }

  test::PlanningCase in_;
  GlobalOptions options_;
  FlightEnvelope envelope_;
  CostField to_goal_;
  WaysToGoal ways_;
  WayAroundQuestion question_;
};

TEST_F(WayAroundOnPlain, TheCheapestWayFromANodeCostsWhatTheStraightLineDoes) {
  int nodes = 0;
  for (int row = 0; row < ways_.lattice().rows(); row += 7) {
    for (int column = 0; column < ways_.lattice().columns(); column += 7) {
      double least_m = std::numeric_limits<double>::infinity();
      for (int d = 0; d < kLatticeDirections; ++d) {
        for (std::int32_t at = ways_.newest(column, row, d); at >= 0; at = ways_.label(at).next) {
          least_m = std::min(least_m, ways_.label(at).cost_m);
        }
      }
      const geo::MapPoint from = ways_.lattice().place(column, row);
      const double straight_m = plan_distance_m(from, envelope_.goal().point()) * density();
      // Ways that set out far from their course, or end in the funnel, are others.
      if (straight_m < 2000.0 * density() || !std::isfinite(least_m)) {
        continue;
      }
      ++nodes;
      EXPECT_GT(least_m, 0.98 * straight_m) << column << " " << row;
      // Sixteen directions are 2.8 % longer at most, and the first turns.
      EXPECT_LT(least_m, 1.06 * straight_m) << column << " " << row;
    }
  }
  EXPECT_GT(nodes, 50);
}

TEST_F(WayAroundOnPlain, AWayLeavesBeforeTheChangeAndComesBackBehindItOutsideOfIt) {
  // GIVEN a square of 2 km on the route that has become very dear
  const auto is_inside = [](const geo::MapPoint& at) {
    return std::fabs(at.x_m - 6000.0) < 1000.0 && std::fabs(at.y_m - 4500.0) < 1000.0;
  };
  for (int row = 0; row < in_.map.geometry.rows; ++row) {
    for (int column = 0; column < in_.map.geometry.columns; ++column) {
      if (is_inside(in_.map.geometry.centre({column, row}))) {
        in_.map.visibility.at(column, row) = test::stored_visibility(0.9);
      }
    }
  }
  in_.costs.visibility_changed({0, 0, in_.map.geometry.columns, in_.map.geometry.rows});
  question_.is_changed = [&](const geo::MapPoint& a, const geo::MapPoint& b) {
    return is_inside(a) || is_inside(b);
  };
  question_.dearer_m = [&](const geo::MapPoint& at) {
    return at.x_m < 7000.0 && std::fabs(at.y_m - 4500.0) < 1000.0 ? 500.0 * density() : 0.0;
  };
  question_.leaves = 7;       // until 4500 m
  question_.joins_from = 12;  // from 7500 m on
  // WHEN ways are looked for
  const std::vector<WayAround> found = ways_around(200'000, 1);
  // THEN the first one is flown beside the square
  ASSERT_EQ(found.size(), 1U);
  const WayAround& way = found.front();
  EXPECT_LT(way.leave, question_.leaves);
  EXPECT_GE(way.join, question_.joins_from);
  EXPECT_EQ(plan_distance_m(way.track.front(), question_.corners[way.leave].point()), 0.0);
  EXPECT_EQ(plan_distance_m(way.track.back(), question_.corners[way.join].point()), 0.0);
  std::vector<Waypoint> line;
  for (const geo::MapPoint& point : way.track) {
    line.push_back({point.x_m, point.y_m, 0.0});
  }
  const RouteLine along(line);
  double inside_m = 0.0;
  for (double at_m = 0.0; at_m < along.length_m(); at_m += 10.0) {
    inside_m += is_inside(along.at(at_m).point()) ? 10.0 : 0.0;
  }
  EXPECT_LT(inside_m, 200.0) << "cuts a corner at most";
  // Around the square's corners it is 700 m longer than straight on, if left at the very start.
  const double straight_m = question_.corners[way.join].x_m - question_.corners[way.leave].x_m;
  EXPECT_GT(along.length_m(), straight_m + 200.0);
  EXPECT_LT(along.length_m(), straight_m + 1300.0);
  EXPECT_FALSE(lowest_profile(envelope_, way.track, question_.corners[way.leave].altitude_m,
                              question_.corners[way.join].altitude_m, 10.0)
                   .empty());
}

TEST_F(WayAroundOnPlain, WaysThatAreRefusedAreFollowedByOthersButNotForever) {
  EXPECT_EQ(ways_around(200'000, 100).size(), 4U);
  EXPECT_TRUE(ways_around(0, 1).empty());
}

TEST(WayAround, WhereNoWayLeadsToTheGoalNoneIsFound) {
  // A wall of 400 m across the whole map, which no climb of 8 degrees out of the band crosses.
  test::PlanningCase in(test::make_map(200, 100, 60.0,
                                       [](double x_m, double) {
                                         return std::fabs(x_m - 6000.0) < 300.0 ? 500.0 : 100.0;
                                       }),
                        kWeights);
  const GlobalOptions options = shipped_global_options();
  const FlightEnvelope envelope(in.costs, options, in.above(1500.0, 3000.0),
                                in.above(10500.0, 3000.0));
  const CostField to_goal(envelope, envelope.goal().point(), 120.0);
  const WaysToGoal ways(envelope, options,
                        CostField(to_goal, envelope.start().point(), envelope.goal().point()),
                        kWork);
  for (std::size_t i = 0; i < ways.label_count(); ++i) {
    const LatticeLabel& label = ways.label(static_cast<std::int32_t>(i));
    ASSERT_GT(ways.lattice().place(label.column, label.row).x_m, 5600.0) << "west of the wall";
  }
  WayAroundQuestion question;
  question.corners = {envelope.start(), envelope.goal()};
  question.cost_m = {0.0, 9000.0};
  question.dearer_m = [](const geo::MapPoint&) { return 0.0; };
  question.is_changed = [](const geo::MapPoint&, const geo::MapPoint&) { return false; };
  int found = 0;
  find_ways_around(
      envelope, ways, question, 100'000, [] { return false; },
      [&](const WayAround&) {
        ++found;
        return true;
      });
  EXPECT_EQ(found, 0);
}

}  // namespace
}  // namespace hedgehop::global_planning
