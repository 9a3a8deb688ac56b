#include <cmath>
#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "planning/planning.hpp"
#include "support/test_map.hpp"
#include "support/utm_map.hpp"

namespace hedgehop::planning {
namespace {

using flight::NoPlanCause;
using ::testing::HasSubstr;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kGround_m = 300.0;
constexpr int kCells = 400;

// A plain of 12 x 12 km; places are given from its south-western corner.
struct Ground {
  map::Map map;

  Ground() {
    map = test::make_map(kCells, kCells, 30.0, [](double, double) { return kGround_m; });
    test::place_in_utm(map);
  }
  void raise(const std::function<double(double east_m, double north_m)>& elevation_m) {
    for (int row = 0; row < kCells; ++row) {
      for (int column = 0; column < kCells; ++column) {
        const geo::MapPoint centre = map.geometry.centre({column, row});
        map.terrain_m.at(column, row) = static_cast<float>(
            elevation_m(centre.x_m - test::kUtmWest_m, centre.y_m - test::kUtmSouth_m));
      }
    }
    map.surface_m = map.terrain_m;
  }
  void add_box(const std::string& name, double west_m, double south_m, double east_m,
               double north_m, double ceiling_above_ground_m = kInfinity) {
    map::Area area;
    area.name = name;
    area.floor = {-kInfinity, map::AreaLimit::Reference::kAmsl};
    area.ceiling = {ceiling_above_ground_m, map::AreaLimit::Reference::kAboveGround};
    const auto corner = [](double e_m, double n_m) {
      return geo::MapPoint{test::kUtmWest_m + e_m, test::kUtmSouth_m + n_m};
    };
    area.polygons = {{{corner(west_m, south_m), corner(east_m, south_m), corner(east_m, north_m),
                       corner(west_m, north_m), corner(west_m, south_m)},
                      {}}};
    map.areas.push_back(area);
  }
  // A frame of four boxes, 300 m wide, around (6000, 6000) +- half_m.
  void enclose_with_areas(double east_m, double north_m, double half_m) {
    const double outer_m = half_m + 300.0;
    add_box("EDR 1", east_m - outer_m, north_m - outer_m, east_m - half_m, north_m + outer_m);
    add_box("EDR 2", east_m + half_m, north_m - outer_m, east_m + outer_m, north_m + outer_m);
    add_box("EDR 3", east_m - outer_m, north_m - outer_m, east_m + outer_m, north_m - half_m);
    add_box("EDR 4", east_m - outer_m, north_m + half_m, east_m + outer_m, north_m + outer_m);
  }
};

struct End {
  double east_m, north_m;
  std::optional<double> height_m = std::nullopt;
};

struct Planted {
  std::string name;
  std::function<void(Ground&)> change;
  End start;
  End goal;
  NoPlanCause cause;
  std::vector<std::string> says;  // the number that is short, or the name
  std::optional<End> place;       // where it is short, within a cell's diagonal
  std::vector<std::string> settings = {};
};

const double kNaN = std::nan("");
constexpr End kStart{2000.0, 2000.0};
constexpr End kGoal{9000.0, 8000.0};

double from(double e_m, double n_m, const End& end) {
  return std::hypot(e_m - end.east_m, n_m - end.north_m);
}

std::vector<Planted> planted() {
  const auto nothing = [](Ground&) {};
  return {
      {"StartOutsideTheMap",
       nothing,
       {-500, 2000},
       kGoal,
       NoPlanCause::kStartOutsideMap,
       {"start"},
       {}},
      {"GoalOutsideTheMap",
       nothing,
       kStart,
       {9000, 12500},
       NoPlanCause::kGoalOutsideMap,
       {"goal"},
       {}},
      {"StartOverAVoid",
       [](Ground& g) {
         g.raise([](double e, double n) { return from(e, n, kStart) < 200.0 ? kNaN : kGround_m; });
       },
       kStart,
       kGoal,
       NoPlanCause::kStartUnknownTerrain,
       {"start", "30 m"},
       kStart},
      {"GoalAtTheEdgeOfAVoid",
       [](Ground& g) {
         g.raise([](double e, double n) {
           return e > kGoal.east_m + 20.0 && from(e, n, kGoal) < 900.0 ? kNaN : kGround_m;
         });
       },
       kStart,
       kGoal,
       NoPlanCause::kGoalUnknownTerrain,
       {"goal", "30 m"},
       kGoal},
      {"StartTooLow",
       nothing,
       {2000, 2000, 4.0},
       kGoal,
       NoPlanCause::kStartBelowEnvelope,
       {"4.0 m", "10.0 m"},
       kStart},
      {"GoalTooLow",
       nothing,
       kStart,
       {9000, 8000, 9.5},
       NoPlanCause::kGoalBelowEnvelope,
       {"9.5 m", "10.0 m"},
       kGoal},
      {"StartTooHigh",
       nothing,
       {2000, 2000, 320.0},
       kGoal,
       NoPlanCause::kStartAboveEnvelope,
       {"320.0 m", "150.0 m"},
       kStart},
      {"GoalTooHigh",
       nothing,
       kStart,
       {9000, 8000, 151.0},
       NoPlanCause::kGoalAboveEnvelope,
       {"151.0 m", "150.0 m"},
       kGoal},
      {"GoalIsTheStart", nothing, kStart, kStart, NoPlanCause::kGoalEqualsStart, {}, kStart},
      {"StartInsideAnArea",
       [](Ground& g) { g.add_box("EDR 7", 1500, 1500, 2500, 2500); },
       kStart,
       kGoal,
       NoPlanCause::kStartInsideArea,
       {"'EDR 7'"},
       kStart},
      {"GoalInsideAnArea",
       [](Ground& g) { g.add_box("EDR 8", 8500, 7500, 9500, 8500, 60.0); },
       kStart,
       kGoal,
       NoPlanCause::kGoalInsideArea,
       {"'EDR 8'"},
       kGoal},
      {"AreasEncloseTheGoal",
       [](Ground& g) { g.enclose_with_areas(9000, 8000, 1200); },
       kStart,
       kGoal,
       NoPlanCause::kSearchSpaceDisconnected,
       {"encloses the goal", "'EDR "},
       {}},
      {"AreasEncloseTheStart",
       [](Ground& g) { g.enclose_with_areas(2500, 2500, 1200); },
       {2500, 2500},
       kGoal,
       NoPlanCause::kSearchSpaceDisconnected,
       {"encloses the start", "'EDR "},
       {}},
      {"UnknownGroundEnclosesTheGoal",
       [](Ground& g) {
         g.raise([](double e, double n) {
           const double r = from(e, n, kGoal);
           return r > 1000.0 && r < 1200.0 ? kNaN : kGround_m;
         });
       },
       kStart,
       kGoal,
       NoPlanCause::kSearchSpaceDisconnected,
       {"no route exists", "unknown ground"},
       {}},
      {"UnknownGroundAcrossTheWholeMap",
       [](Ground& g) {
         g.raise([](double e, double) { return e > 5000.0 && e < 5200.0 ? kNaN : kGround_m; });
       },
       kStart,
       kGoal,
       NoPlanCause::kSearchSpaceDisconnected,
       {"no route exists"},
       {}},
      {"AMesaHigherThanTheEnvelopeHoldsTheGoal",
       [](Ground& g) {
         g.raise([](double e, double n) {
           return from(e, n, kGoal) < 900.0 ? kGround_m + 500.0 : kGround_m;
         });
       },
       kStart,
       kGoal,
       NoPlanCause::kSearchSpaceDisconnected,
       {"no route exists", "130.0 m"},
       {}},
      {"APitTooNarrowToCircleInHoldsTheStart",
       [](Ground& g) {
         g.raise([](double e, double n) {
           const double r = from(e, n, {4000, 4000});
           return kGround_m + std::fmin(std::fmax(r - 400.0, 0.0), 600.0);
         });
       },
       {4000, 4000},
       kGoal,
       NoPlanCause::kClimbLimit,
       {"start", "8.0 degrees", "600.0 m radius"},
       End{4000, 4000},
       {"global.turn_radius_m=600"}},
  };
}

class WhyNot : public ::testing::TestWithParam<Planted> {};

TEST_P(WhyNot, NamesCausePlaceAndNumber) {
  const Planted& problem = GetParam();
  Ground ground;
  problem.change(ground);
  test::finish_map(ground.map);
  const geo::MapProjection projection(ground.map.crs_wkt);
  const auto request_point = [&](const End& end) {
    return flight::RequestPoint{
        projection.to_geodetic({test::kUtmWest_m + end.east_m, test::kUtmSouth_m + end.north_m}),
        end.height_m};
  };
  const flight::PlanRequest request{.start = request_point(problem.start),
                                    .goal = request_point(problem.goal),
                                    .via = {},
                                    .start_heading_true_rad = {},
                                    .speed_mps = {},
                                    .seed = 1,
                                    .work_budget = 0};
  std::vector<std::string> settings = problem.settings;
  settings.emplace_back("global.work_budget=100000");
  const PlanningConfig config =
      read_planning_config(effective_planning_config("", settings), "test");
  SilentObserver observer;
  const auto result = plan(ground.map, request, config, {}, observer);
  const auto* none = std::get_if<flight::NoPlan>(&result);
  ASSERT_NE(none, nullptr);
  EXPECT_EQ(flight::name_of(none->cause), std::string(flight::name_of(problem.cause)))
      << none->explanation;
  for (const std::string& part : problem.says) {
    EXPECT_THAT(none->explanation, HasSubstr(part));
  }
  if (problem.place) {
    ASSERT_TRUE(none->place.has_value());
    EXPECT_LT(std::hypot(none->place->x_m - test::kUtmWest_m - problem.place->east_m,
                         none->place->y_m - test::kUtmSouth_m - problem.place->north_m),
              43.0);
  }
}

INSTANTIATE_TEST_SUITE_P(Problems, WhyNot, ::testing::ValuesIn(planted()),
                         [](const auto& problem) { return problem.param.name; });

}  // namespace
}  // namespace hedgehop::planning
