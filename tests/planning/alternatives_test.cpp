#include "planning/alternatives.hpp"

#include <algorithm>
#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <limits>
#include <random>

#include "base/shipped_config.hpp"
#include "support/fractal_terrain.hpp"
#include "support/fresh_seed.hpp"
#include "support/test_map.hpp"
#include "support/utm_map.hpp"

namespace hedgehop::planning {
namespace {

using flight::RouteChoice;
using flight::RouteChoices;
using flight::Waypoint;
using ::testing::HasSubstr;

constexpr double kCell_m = 60.0;

AlternativeOptions shipped_options() {
  auto reader = ConfigReader::from_text(shipped_config("alternatives.yaml"), "alternatives.yaml");
  return read_alternative_options(reader);
}

// Fewer searches, for tests that look at one of them.
AlternativeOptions few_searches() {
  AlternativeOptions options = shipped_options();
  options.weightings.resize(3);
  options.avoidances = {0.0, 4.0};
  return options;
}

PlanningConfig config_with(const std::vector<std::string>& settings) {
  return read_planning_config(effective_planning_config("", settings), "test");
}

flight::PlanRequest across(const map::Map& map, double y_m) {
  const geo::MapProjection projection(map.crs_wkt);
  const raster::GridGeometry& g = map.geometry;
  flight::PlanRequest request;
  request.start.position = projection.to_geodetic({g.west_m + 1200.0, g.south_m + y_m});
  request.goal.position = projection.to_geodetic({g.east_m() - 1200.0, g.south_m + y_m});
  return request;
}

RouteChoices choices_of(const map::Map& map, const flight::PlanRequest& request,
                        const PlanningConfig& config, const AlternativeOptions& options) {
  SilentObserver observer;
  const auto route = plan_route(map, request, config, {}, observer);
  if (const auto* none = std::get_if<flight::NoPlan>(&route)) {
    ADD_FAILURE() << none->explanation;
    return {};
  }
  return plan_alternatives(map, std::get<flight::RoutePlan>(route), config, options, observer);
}

// Share of one route within 300 m of another, by points 3 m apart on both.
double shared_by_points(const std::vector<Waypoint>& route, const std::vector<Waypoint>& other) {
  const auto points_of = [](const std::vector<Waypoint>& line) {
    std::vector<geo::MapPoint> points;
    for (std::size_t i = 1; i < line.size(); ++i) {
      const double length_m =
          std::hypot(line[i].x_m - line[i - 1].x_m, line[i].y_m - line[i - 1].y_m);
      const int steps = static_cast<int>(length_m / 3.0) + 1;
      for (int k = 0; k < steps; ++k) {
        const double t = (k + 0.5) / steps;
        points.push_back({line[i - 1].x_m + t * (line[i].x_m - line[i - 1].x_m),
                          line[i - 1].y_m + t * (line[i].y_m - line[i - 1].y_m)});
      }
    }
    return points;
  };
  const auto points = points_of(route);
  const auto others = points_of(other);
  int near = 0;
  for (std::size_t i = 0; i < points.size(); i += 10) {
    near += std::any_of(others.begin(), others.end(),
                        [&](const geo::MapPoint& place) {
                          return std::hypot(place.x_m - points[i].x_m, place.y_m - points[i].y_m) <
                                 300.0;
                        })
                ? 10
                : 0;
  }
  return static_cast<double>(near) / static_cast<double>(points.size());
}

void expect_a_choice(const RouteChoices& choices, const AlternativeOptions& options) {
  for (std::size_t i = 0; i < choices.routes.size(); ++i) {
    for (std::size_t j = 0; j < choices.routes.size(); ++j) {
      if (i == j) {
        continue;
      }
      const RouteChoice& a = choices.routes[i];
      const RouteChoice& b = choices.routes[j];
      EXPECT_LE(shared_by_points(a.plan.route.waypoints, b.plan.route.waypoints),
                options.shared_share_max + 0.01)
          << a.name << " along " << b.name;
      EXPECT_TRUE(a.measures.length_m < b.measures.length_m ||
                  a.measures.visibility_m < b.measures.visibility_m ||
                  a.measures.semantics_m < b.measures.semantics_m)
          << a.name << " is better than " << b.name << " in nothing";
    }
    EXPECT_LE(choices.routes[i].measures.length_m,
              options.length_factor_max * choices.routes[0].measures.length_m);
  }
}

const RouteChoice* named(const RouteChoices& choices, const std::string& name) {
  for (const RouteChoice& choice : choices.routes) {
    if (choice.name == name) {
      return &choice;
    }
  }
  return nullptr;
}

// Level ground of 12 x 9 km. A belt 3 km wide leads straight to the goal over a town in full view;
// north of it nobody looks, but people live there; south of it nobody lives, but it is half seen.
map::Map three_ways() {
  map::Map map = test::make_map(200, 150, kCell_m, [](double, double) { return 400.0; });
  for (int row = 0; row < 150; ++row) {
    for (int column = 0; column < 200; ++column) {
      const double y_m = (row + 0.5) * kCell_m;
      const bool is_between = column > 25 && column < 175;
      const bool is_belt = y_m > 3000.0 && y_m < 6000.0;
      map.visibility.at(column, row) = test::stored_visibility(!is_between     ? 0.1
                                                               : is_belt       ? 0.6
                                                               : y_m >= 6000.0 ? 0.05
                                                                               : 0.35);
      map.semantics.at(column, row) =
          is_between && y_m > 3000.0
              ? static_cast<std::uint16_t>(is_belt ? map::SemanticClass::kSettlement
                                                   : map::SemanticClass::kVillage)
              : std::uint16_t{0};
    }
  }
  test::place_in_utm(map);
  test::finish_map(map);
  return map;
}

TEST(Alternatives, OfferTheShortTheHiddenAndTheQuietWay) {
  const map::Map map = three_ways();
  const PlanningConfig config = config_with({"small_patch_m=0"});
  AlternativeOptions options = few_searches();
  options.weightings[0].visibility = 0.0;  // the straight line, whatever it costs
  options.weightings[0].semantics = 0.0;
  const RouteChoices choices = choices_of(map, across(map, 4500.0), config, options);

  ASSERT_GE(choices.routes.size(), 3U) << choices.why_no_more;
  EXPECT_LE(choices.routes.size(), 5U);
  expect_a_choice(choices, options);
  const RouteChoice* fast = named(choices, "fast");
  ASSERT_NE(fast, nullptr) << choices.why_no_more;
  EXPECT_NEAR(fast->measures.length_m, 9600.0, 100.0);
  // The plan's own and the one of the other kind are the ways north and south.
  double north_m = -std::numeric_limits<double>::infinity();
  double south_m = std::numeric_limits<double>::infinity();
  for (const RouteChoice& choice : choices.routes) {
    for (const Waypoint& waypoint : choice.plan.route.waypoints) {
      north_m = std::max(north_m, waypoint.y_m - map.geometry.south_m);
      south_m = std::min(south_m, waypoint.y_m - map.geometry.south_m);
    }
  }
  EXPECT_GT(north_m, 6000.0) << "nobody looks there";
  EXPECT_LT(south_m, 3000.0) << "nobody lives there";
}

TEST(Alternatives, EachCarriesTheConfigThatJudgesItAndABoundUnderItsCost) {
  const map::Map map = three_ways();
  const PlanningConfig config = config_with({"small_patch_m=0"});
  const RouteChoices choices = choices_of(map, across(map, 4500.0), config, few_searches());

  ASSERT_GE(choices.routes.size(), 2U) << choices.why_no_more;
  EXPECT_EQ(choices.routes[0].name, "main");
  EXPECT_EQ(choices.routes[0].plan.config_text, config.text);
  for (const RouteChoice& choice : choices.routes) {
    const PlanningConfig own = read_planning_config(choice.plan.config_text, choice.name);
    EXPECT_EQ(own.weights.visibility, choice.visibility_weight);
    EXPECT_EQ(own.weights.semantics, choice.semantics_weight);
    EXPECT_EQ(choice.plan.request_id,
              flight::plan_request_id(choice.plan.request, map.hash, choice.plan.config_text));
    const flight::RouteCost cost =
        cost_model(map, own).route_cost(choice.plan.route.waypoints, 1.0);
    EXPECT_NEAR(cost.total_m(), choice.plan.route.cost.total_m(), 1e-6 * cost.total_m());
    EXPECT_GT(choice.plan.route.lower_bound_m, 0.0);
    EXPECT_LE(choice.plan.route.lower_bound_m, cost.total_m() * (1.0 + 1e-9));
    EXPECT_EQ(choice.plan.route.waypoints.front(), choices.routes[0].plan.start);
    EXPECT_EQ(choice.plan.route.waypoints.back(), choices.routes[0].plan.goal);
  }
}

TEST(Alternatives, InANarrowValleyThereIsOneRouteAndItSaysWhere) {
  // GIVEN known ground 900 m wide all the way
  map::Map map = test::make_map(200, 60, kCell_m, [](double, double y_m) {
    return std::fabs(y_m - 1800.0) < 450.0 ? 400.0 : std::numeric_limits<double>::quiet_NaN();
  });
  test::place_in_utm(map);
  test::finish_map(map);
  const RouteChoices choices =
      choices_of(map, across(map, 1800.0), config_with({}), few_searches());
  ASSERT_EQ(choices.routes.size(), 1U);
  for (const RouteWeighting& weighting : few_searches().weightings) {
    EXPECT_THAT(choices.why_no_more, HasSubstr(weighting.name + ": "));
  }
  EXPECT_THAT(choices.why_no_more, HasSubstr("run together, around "));
  EXPECT_THAT(choices.why_no_more, HasSubstr("although each metre within 600 m"));
}

TEST(Alternatives, OverDrawnGroundEachPairKeepsItsLimitsAndTheSameQuestionGivesTheSameRoutes) {
  const std::uint64_t seed = test::fresh_seed();
  map::Map map = test::make_fractal_map(seed, 200, kCell_m, 3000.0, 120.0);
  std::mt19937_64 random(seed);
  std::uniform_int_distribution<int> place(10, 189);
  for (int town = 0; town < 25; ++town) {
    const int column = place(random);
    const int row = place(random);
    for (int r = std::max(row - 6, 0); r < std::min(row + 6, 200); ++r) {
      for (int c = std::max(column - 6, 0); c < std::min(column + 6, 200); ++c) {
        map.semantics.at(c, r) = static_cast<std::uint16_t>(map::SemanticClass::kSettlement);
      }
    }
  }
  test::place_in_utm(map);
  test::finish_map(map);
  const PlanningConfig config = config_with({});
  AlternativeOptions options = few_searches();
  options.weightings.resize(2);
  SilentObserver observer;
  const auto route = plan_route(map, across(map, 6000.0), config, {}, observer);
  if (!std::holds_alternative<flight::RoutePlan>(route)) {
    GTEST_SKIP() << "no route over the ground of seed " << seed;
  }
  const auto& main = std::get<flight::RoutePlan>(route);
  const RouteChoices first = plan_alternatives(map, main, config, options, observer);
  expect_a_choice(first, options);
  EXPECT_EQ(first.routes[0].plan.route.waypoints, main.route.waypoints) << seed;
  const RouteChoices second = plan_alternatives(map, main, config, options, observer);
  ASSERT_EQ(first.routes.size(), second.routes.size()) << seed;
  for (std::size_t i = 0; i < first.routes.size(); ++i) {
    EXPECT_EQ(first.routes[i].plan.route.waypoints, second.routes[i].plan.route.waypoints) << seed;
  }
  EXPECT_EQ(first.why_no_more, second.why_no_more) << seed;
}

TEST(Alternatives, PassTheViaPointsOfTheRequest) {
  const map::Map map = three_ways();
  const PlanningConfig config = config_with({"small_patch_m=0"});
  flight::PlanRequest request = across(map, 4500.0);
  const geo::MapProjection projection(map.crs_wkt);
  const geo::MapPoint via{map.geometry.west_m + 6000.0, map.geometry.south_m + 4500.0};
  request.via.push_back({projection.to_geodetic(via), std::nullopt});
  AlternativeOptions options = shipped_options();
  options.shared_share_max = 0.8;
  options.weightings.resize(2);
  const RouteChoices choices = choices_of(map, request, config, options);
  EXPECT_GE(choices.routes.size(), 2U) << choices.why_no_more;
  for (const RouteChoice& choice : choices.routes) {
    double nearest_m = std::numeric_limits<double>::infinity();
    for (const Waypoint& waypoint : choice.plan.route.waypoints) {
      nearest_m = std::min(nearest_m, std::hypot(waypoint.x_m - via.x_m, waypoint.y_m - via.y_m));
    }
    EXPECT_LT(nearest_m, 0.01) << choice.name;
  }
}

TEST(Alternatives, WhoeverStopsThemKeepsWhatWasFound) {
  class Stopper final : public Observer {
   public:
    void progress(std::string_view, double done, double) override { done_ = done; }
    void note(std::string_view) override {}
    [[nodiscard]] bool stop_requested() const override { return done_ >= 4.0; }

   private:
    double done_ = 0.0;
  };
  const map::Map map = three_ways();
  const PlanningConfig config = config_with({"small_patch_m=0"});
  SilentObserver silent;
  const auto route = plan_route(map, across(map, 4500.0), config, {}, silent);
  ASSERT_TRUE(std::holds_alternative<flight::RoutePlan>(route));
  Stopper stopper;
  const RouteChoices choices = plan_alternatives(map, std::get<flight::RoutePlan>(route), config,
                                                 shipped_options(), stopper);
  EXPECT_LE(choices.routes.size(), 2U);
  EXPECT_THAT(choices.why_no_more, HasSubstr("stopped"));
  EXPECT_EQ(choices.shared.size(), choices.routes.size());
}

}  // namespace
}  // namespace hedgehop::planning
