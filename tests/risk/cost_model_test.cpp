#include "risk/cost_model.hpp"

#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>
#include <stdexcept>

#include "support/fractal_terrain.hpp"
#include "support/fresh_seed.hpp"
#include "support/test_map.hpp"

namespace hedgehop::risk {
namespace {

using flight::Waypoint;
using map::SemanticClass;

constexpr double kReference_m = 15.24;

std::uint16_t bits(std::initializer_list<SemanticClass> classes) {
  std::uint16_t sum = 0;
  for (const SemanticClass one : classes) {
    sum = static_cast<std::uint16_t>(sum | static_cast<std::uint16_t>(one));
  }
  return sum;
}

const SemanticCostTable kFree({}, 0.0);

// Level ground at 100 m, everything half visible.
map::Map half_seen_plain() {
  map::Map map = test::make_map(100, 100, 30.0, [](double, double) { return 100.0; });
  for (std::uint16_t& value : map.visibility.values()) {
    value = test::stored_visibility(0.5);
  }
  test::finish_map(map);
  return map;
}

TEST(SemanticCostTable, TheFirstRuleWhoseClassesAreAllPresentWins) {
  auto reader = ConfigReader::from_text(
      "rules:\n"
      "  - {classes: [village, forest], cost: 0.9}\n"
      "  - {classes: [forest], cost: 0.2}\n"
      "  - {classes: [village], cost: 0.7}\n"
      "otherwise: 0.1\nsoft_area: 0.5\n",
      "test.yaml");
  const SemanticCostTable table = SemanticCostTable::read(reader);
  EXPECT_FLOAT_EQ(static_cast<float>(table.cost(bits({SemanticClass::kForest}))), 0.2F);
  EXPECT_FLOAT_EQ(static_cast<float>(table.cost(bits({SemanticClass::kVillage}))), 0.7F);
  EXPECT_FLOAT_EQ(static_cast<float>(table.cost(bits(
                      {SemanticClass::kForest, SemanticClass::kVillage, SemanticClass::kWater}))),
                  0.9F);
  EXPECT_FLOAT_EQ(static_cast<float>(table.cost(bits({SemanticClass::kWater}))), 0.1F);
  EXPECT_FLOAT_EQ(static_cast<float>(table.cost(0)), 0.1F);
}

TEST(SemanticCostTable, AnUnknownClassIsRefusedWithItsLineAndTheNearestName) {
  auto reader = ConfigReader::from_text(
      "rules:\n"
      "  - {classes: [vilage], cost: 0.9}\n"
      "otherwise: 0.1\nsoft_area: 0.5\n",
      "test.yaml");
  try {
    SemanticCostTable::read(reader);
    FAIL() << "accepted a class that does not exist";
  } catch (const ConfigError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("test.yaml:2:"));
    EXPECT_THAT(error.what(), testing::HasSubstr("did you mean 'village'"));
  }
}

TEST(SemanticCostTable, CostsOutsideZeroToOneAreRefused) {
  for (const char* text :
       {"rules: [{classes: [forest], cost: 1.5}]\notherwise: 0\nsoft_area: 0\n",
        "rules: [{classes: [forest], cost: -0.1}]\notherwise: 0\nsoft_area: 0\n",
        "rules: [{classes: [], cost: 0.5}]\notherwise: 0\nsoft_area: 0\n",
        "rules: []\notherwise: 2\nsoft_area: 0\n", "rules: []\notherwise: 0\nsoft_area: 1.1\n"}) {
    auto reader = ConfigReader::from_text(text, "test.yaml");
    EXPECT_THROW(SemanticCostTable::read(reader), ConfigError) << text;
  }
}

TEST(Weights, NegativeOnesAreRefused) {
  auto reader = ConfigReader::from_text(
      "visibility: 25\nvisibility_per_height_1pm: 0.02\nsemantics: -4\nheight_1pm: 0.01\n"
      "soft_ceiling_m: 60\nsoft_ceiling_1pm: 0\nthreats: 0\nwire_crossing_m: 0\nslope_along: 0\n",
      "test.yaml");
  EXPECT_THROW(read_weights(reader), ConfigError);
}

TEST(CostModel, DensityIsTheIntegrandOfEquationOneByHand) {
  map::Map map = half_seen_plain();
  map.semantics.at(50, 50) = bits({SemanticClass::kForest});
  const SemanticCostTable forest({{bits({SemanticClass::kForest}), 0.25}}, 0.0);
  const CostModel costs(map, {25.0, 0.02, 4.0, 0.01}, forest, 1.0);
  const geo::MapPoint point = map.geometry.centre({50, 50});
  // 1 + 25 (1.2 * 0.5)^2 + 4 * 0.25 + 0.01 * 10, ten metres above the reference height
  EXPECT_NEAR(costs.density(point, kReference_m + 10.0), 1.0 + 9.0 + 1.0 + 0.1, 1e-3);
  // Below it visibility does not fall, but the height term grows: 1 + 25 * 0.25 + 1 + 0.05
  EXPECT_NEAR(costs.density(point, kReference_m - 5.0), 1.0 + 6.25 + 1.0 + 0.05, 1e-3);
}

// Half visible at the reference height, 0.7 at 40 m, 0.9 at 100 m; 0.3 at 10 m.
map::Map plain_with_exposure_volume() {
  map::Map map = half_seen_plain();
  for (const auto& [height_m, share] :
       {std::pair{10.0, 0.3}, std::pair{40.0, 0.7}, std::pair{100.0, 0.9}}) {
    map.further_visibility.push_back(
        {height_m, raster::Grid<std::uint16_t>(map.geometry, test::stored_visibility(share))});
  }
  test::finish_map(map);
  map::validate(map);
  return map;
}

TEST(CostModel, AnExposureVolumeTakesThePlaceOfTheFactorThatGrowsWithHeight) {
  const map::Map map = plain_with_exposure_volume();
  const CostModel costs(map, {25.0, 0.02, 0.0, 0.0}, kFree, 1.0);
  const geo::MapPoint point = map.geometry.centre({50, 50});
  EXPECT_NEAR(costs.seen(point, 2.0), 0.3, 1e-4);  // below the lowest: as there
  EXPECT_NEAR(costs.seen(point, kReference_m), 0.5, 1e-4);
  EXPECT_NEAR(costs.seen(point, 40.0), 0.7, 1e-4);
  EXPECT_NEAR(costs.seen(point, 70.0), 0.8, 1e-4);         // half way from 40 to 100 m
  EXPECT_NEAR(costs.seen(point, 110.0), 0.9 * 1.2, 1e-4);  // the factor above the highest
  EXPECT_NEAR(costs.density(point, 70.0), 1.0 + 25.0 * 0.8 * 0.8, 0.01);
  const flight::RouteCost cost = costs.route_cost({{300, 300, 170.0}, {900, 300, 170.0}}, 5.0);
  EXPECT_NEAR(cost.visibility_m, 600.0 * 25.0 * 0.64, 5.0);
}

TEST(CostModel, AnotherReferenceHeightNeedsAnExposureVolumeThatCoversIt) {
  const map::Map map = plain_with_exposure_volume();
  const CostModel costs(map, {25.0, 0.02, 0.0, 0.01}, kFree, 1.0, 70.0);
  const geo::MapPoint point = map.geometry.centre({50, 50});
  EXPECT_EQ(costs.reference_height_m(), 70.0);
  EXPECT_NEAR(costs.visibility(point), 0.8, 1e-4);
  EXPECT_NEAR(costs.density(point, 100.0), 1.0 + 25.0 * 0.81 + 0.01 * 30.0, 0.01);
  EXPECT_THROW(CostModel(map, {}, kFree, 1.0, 101.0), std::invalid_argument);
  EXPECT_THROW(CostModel(half_seen_plain(), {}, kFree, 1.0, 16.0), std::invalid_argument);
}

TEST(CostModel, TheRuleForKernelsIsTheDensity) {
  map::Map map = plain_with_exposure_volume();
  map.visibility.at(3, 4) = map::kVisibilityUnknown;
  const CostModel costs(map, {25.0, 0.02, 4.0, 0.01}, kFree, 0.95);
  for (const double height_m : {0.0, 12.0, 15.24, 33.0, 100.0, 300.0}) {
    for (const raster::CellIndex cell : {raster::CellIndex{3, 4}, raster::CellIndex{70, 80}}) {
      EXPECT_EQ(
          costs.density_rule()(costs.visibilities(cell),
                               static_cast<double>(costs.semantics_layer().at(cell)), height_m),
          costs.density(map.geometry.centre(cell), height_m));
    }
  }
  EXPECT_THROW(CostDensity({}, 15.0, {}), std::invalid_argument);
  EXPECT_THROW(CostDensity({}, 15.0, {15.0, 15.0}), std::invalid_argument);
}

TEST(CostModel, ReweightedIsTheModelMadeWithThoseWeights) {
  const std::uint64_t seed = test::fresh_seed();
  map::Map map = test::make_fractal_map(seed, 40, 30.0, 600.0, 100.0);
  for (std::size_t i = 0; i < map.semantics.values().size(); i += 3) {
    map.semantics.values()[i] = bits({SemanticClass::kVillage});
  }
  test::finish_map(map);
  const SemanticCostTable villages({{bits({SemanticClass::kVillage}), 0.7}}, 0.1);
  const CostModel first(map, {25.0, 0.02, 4.0, 0.01}, villages, 1.0);
  const CostModel wanted(map, {80.0, 0.02, 0.5, 0.01}, villages, 1.0);
  const CostModel found = first.reweighted(80.0, 0.5);
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> place(0.0, 1200.0);
  for (int i = 0; i < 200; ++i) {
    const geo::MapPoint point{place(random), place(random)};
    const double height_m = 0.1 * place(random);
    EXPECT_EQ(found.density(point, height_m), wanted.density(point, height_m)) << seed;
    const std::vector<Waypoint> leg = {{point.x_m, point.y_m, 200.0}, {600.0, 600.0, 150.0}};
    EXPECT_EQ(found.route_cost(leg, 10.0), wanted.route_cost(leg, 10.0)) << seed;
  }
}

TEST(CostModel, UnknownVisibilityCountsAsConfigured) {
  map::Map map = half_seen_plain();
  map.visibility.at(3, 4) = map::kVisibilityUnknown;
  const CostModel costs(map, {}, kFree, 0.75);
  EXPECT_EQ(costs.visibility(map.geometry.centre({3, 4})), 0.75);
  EXPECT_NEAR(costs.visibility(map.geometry.centre({4, 4})), 0.5, 1e-4);
}

TEST(CostModel, OutsideTheMapNothingIsKnown) {
  const map::Map map = half_seen_plain();
  const CostModel costs(map, {25.0, 0.02, 4.0, 0.01}, kFree, 1.0);
  EXPECT_TRUE(std::isnan(costs.visibility({-1.0, 10.0})));
  EXPECT_TRUE(std::isnan(costs.semantics({10.0, 3000.0})));
  EXPECT_TRUE(std::isnan(costs.density({1e6, 1e6}, 20.0)));
}

TEST(CostModel, ALevelLegOverAnEvenPlainCostsItsLengthTimesTheDensity) {
  const map::Map map = half_seen_plain();
  const CostModel costs(map, {25.0, 0.02, 4.0, 0.01}, kFree, 1.0);
  const double altitude_m = 100.0 + kReference_m + 10.0;
  const flight::RouteCost cost =
      costs.route_cost({{300, 300, altitude_m}, {1500, 1200, altitude_m}}, 7.0);
  EXPECT_NEAR(cost.length_m, 1500.0, 1e-9);
  EXPECT_NEAR(cost.visibility_m, 1500.0 * 9.0, 1.0);
  EXPECT_NEAR(cost.height_m, 150.0, 1e-9);
  EXPECT_EQ(cost.semantics_m, 0.0);
}

TEST(CostModel, TheHeightTermOfAClimbIsTheAreaUnderIt) {
  const map::Map map = half_seen_plain();
  const CostModel costs(map, {0.0, 0.0, 0.0, 0.01}, kFree, 1.0);
  // From the reference height to 80 m above it over 600 m: mean 40 m along a leg of sqrt(600^2 +
  // 80^2).
  const flight::RouteCost cost =
      costs.route_cost({{300, 300, 100.0 + kReference_m}, {900, 300, 180.0 + kReference_m}}, 5.0);
  EXPECT_NEAR(cost.height_m, 0.01 * 40.0 * std::sqrt(600.0 * 600.0 + 80.0 * 80.0), 1e-9);
}

TEST(CostModel, ALegThatCrossesFromSeenToHiddenGroundPaysForTheSeenPartOnly) {
  map::Map map = half_seen_plain();
  for (int row = 0; row < 100; ++row) {
    for (int column = 50; column < 100; ++column) {
      map.visibility.at(column, row) = 0;
    }
  }
  const CostModel costs(map, {16.0, 0.0, 0.0, 0.0}, kFree, 1.0);
  // 600 m on each side of the edge at x = 1500; density 16 * 0.25 = 4 on the western side
  const double altitude_m = 100.0 + kReference_m;
  const flight::RouteCost cost =
      costs.route_cost({{900, 1500, altitude_m}, {2100, 1500, altitude_m}}, 1.0);
  EXPECT_NEAR(cost.visibility_m, 2400.0, 1.0);
}

TEST(CostModel, RouteCostIsTheSumOverItsLegs) {
  const std::uint64_t seed = test::fresh_seed();
  const map::Map map = test::make_fractal_map(seed, 100, 30.0, 1500.0, 300.0);
  const CostModel costs(map, {25.0, 0.02, 4.0, 0.01}, kFree, 1.0);
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> place_m(100.0, 2900.0);
  std::vector<Waypoint> route;
  double sum_m = 0.0;
  for (int k = 0; k < 12; ++k) {
    route.push_back({place_m(random), place_m(random), 400.0});
    if (k > 0) {
      sum_m += costs.route_cost({route[route.size() - 2], route.back()}, 5.0).total_m();
    }
  }
  EXPECT_NEAR(costs.route_cost(route, 5.0).total_m(), sum_m, 1e-9 * sum_m);
  EXPECT_GE(costs.route_cost(route, 5.0).total_m(), flight::length_m(route));
}

TEST(CostModel, AStepThatIsNotPositiveIsRefused) {
  const map::Map map = half_seen_plain();
  const CostModel costs(map, {}, kFree, 1.0);
  EXPECT_THROW(static_cast<void>(costs.route_cost({{0, 0, 0}, {1, 1, 1}}, 0.0)),
               std::invalid_argument);
}

TEST(CostModel, SoftAreasCostBetweenTheirLimitsAndOnlyThere) {
  map::Map map = half_seen_plain();
  map::Area area;
  area.is_hard = false;
  area.floor = {30.0, map::AreaLimit::Reference::kAboveGround};
  area.ceiling = {200.0, map::AreaLimit::Reference::kAmsl};
  area.polygons = {{{{600, 0}, {1500, 0}, {1500, 3000}, {600, 3000}, {600, 0}}, {}}};
  map.areas = {area};
  test::finish_map(map);
  const CostModel costs(map, {0.0, 0.0, 4.0, 0.0}, SemanticCostTable({}, 0.1, 0.75), 1.0);
  const geo::MapPoint inside{1000.0, 1500.0};
  EXPECT_NEAR(costs.semantics(inside, 140.0), 0.75, 1e-6);
  EXPECT_NEAR(costs.semantics(inside, 129.0), 0.1, 1e-6);
  EXPECT_NEAR(costs.semantics(inside, 201.0), 0.1, 1e-6);
  EXPECT_NEAR(costs.semantics({1600.0, 1500.0}, 140.0), 0.1, 1e-6);
  EXPECT_NEAR(costs.density(inside, 40.0), 1.0 + 4.0 * 0.75, 1e-6);
  EXPECT_NEAR(costs.density(inside, 20.0), 1.0 + 4.0 * 0.1, 1e-6);
  // 900 of 1200 m of a leg lie inside; below the floor none.
  EXPECT_NEAR(costs.route_cost({{450, 900, 150.0}, {1650, 900, 150.0}}, 1.0).semantics_m,
              4.0 * (900.0 * 0.75 + 300.0 * 0.1), 1e-2);
  EXPECT_NEAR(costs.route_cost({{450, 900, 120.0}, {1650, 900, 120.0}}, 1.0).semantics_m,
              4.0 * 1200.0 * 0.1, 1e-2);
  // The layer answers for the reference height, which lies below the floor.
  EXPECT_NEAR(costs.semantics(inside), 0.1, 1e-6);
  map.areas[0].floor.value_m = 10.0;
  test::finish_map(map);
  const CostModel lower(map, {0.0, 0.0, 4.0, 0.0}, SemanticCostTable({}, 0.1, 0.75), 1.0);
  EXPECT_NEAR(lower.semantics(inside), 0.75, 1e-6);
  EXPECT_NEAR(lower.semantics({1600.0, 1500.0}), 0.1, 1e-6);
}

TEST(CostModel, PlannersDoNotSeeALureButMeasuresDo) {
  map::Map map = half_seen_plain();
  map.visibility.at(50, 50) = 0;
  const geo::MapPoint lure = map.geometry.centre({50, 50});
  const CostModel costs(map, {16.0, 0.0, 0.0, 0.0}, kFree, 1.0, std::nullopt, 90.0);
  EXPECT_NEAR(costs.visibility(lure), 0.5, 1e-4);
  EXPECT_NEAR(costs.density(lure, kReference_m), 1.0 + 16.0 * 0.25, 1e-3);
  EXPECT_EQ(CostModel(map, {16.0, 0.0, 0.0, 0.0}, kFree, 1.0).visibility(lure), 0.0);
  flight::Trajectory trajectory;
  trajectory.step_s = 0.5;
  for (int k = 0; k <= 2; ++k) {  // 20 m inside the cell
    flight::FlightState state;
    state.time_s = 0.5 * k;
    state.x_m = lure.x_m - 10.0 + 10.0 * k;
    state.y_m = lure.y_m;
    state.surface_m = 100.0;
    state.altitude_m = 100.0 + kReference_m;
    trajectory.states.push_back(state);
  }
  EXPECT_EQ(costs.measures(trajectory, 120.0).visibility_m, 0.0);
}

TEST(CostModel, MeasuresOfASteadyFlightAreItsIntegrals) {
  const map::Map map = half_seen_plain();
  const CostModel costs(map, {25.0, 0.02, 4.0, 0.01}, kFree, 1.0);
  flight::Trajectory trajectory;
  trajectory.step_s = 0.5;
  for (int k = 0; k <= 100; ++k) {  // 40 m/s east for 50 s, climbing from 100 to 150 m above ground
    flight::FlightState state;
    state.time_s = 0.5 * k;
    state.x_m = 300.0 + 20.0 * k;
    state.y_m = 1500.0;
    state.surface_m = 100.0;
    state.altitude_m = 200.0 + 0.5 * k;
    state.bank_rad = -0.1;
    trajectory.states.push_back(state);
  }
  const flight::PathMeasures measures = costs.measures(trajectory, 120.0);
  EXPECT_NEAR(measures.length_m, 2000.0, 1e-9);
  EXPECT_NEAR(measures.duration_s, 50.0, 1e-12);
  EXPECT_NEAR(measures.mean_height_m, 125.0, 1e-9);
  EXPECT_NEAR(measures.max_height_m, 150.0, 1e-12);
  EXPECT_NEAR(measures.bank_rad_m, 200.0, 1e-9);
  EXPECT_NEAR(measures.share_under_ceiling, 0.4, 0.011);  // 120 m is reached after 40 %
  // mean of (1 + 0.02 (h - 15.24)) * 0.5 over h = 100..150, times 2000 m
  EXPECT_NEAR(measures.visibility_m, 2000.0 * 0.5 * (1.0 + 0.02 * (125.0 - kReference_m)), 0.5);
}

}  // namespace
}  // namespace hedgehop::risk
