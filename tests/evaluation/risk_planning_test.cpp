#include "evaluation/risk_planning.hpp"

#include <cmath>
#include <gtest/gtest.h>

#include "base/shipped_config.hpp"
#include "support/fresh_seed.hpp"
#include "support/test_map.hpp"
#include "support/utm_map.hpp"

namespace hedgehop::evaluation {
namespace {

// 9 x 6 km of hills in UTM zone 32.
map::Map hills() {
  map::Map map = test::make_map(300, 200, 30.0, [](double x_m, double y_m) {
    return 400.0 + 25.0 * std::sin(x_m / 700.0) + 25.0 * std::cos(y_m / 600.0);
  });
  test::place_in_utm(map);
  map.visibility = raster::Grid<std::uint16_t>(map.geometry, test::stored_visibility(0.1));
  test::finish_map(map);
  return map;
}

flight::PlanRequest request_on(const map::Map& map) {
  const geo::MapProjection projection(map.crs_wkt);
  const auto place = [&](double east_m, double north_m) {
    return flight::RequestPoint{
        projection.to_geodetic({test::kUtmWest_m + east_m, test::kUtmSouth_m + north_m}),
        std::nullopt};
  };
  flight::PlanRequest request;
  request.start = place(1515.0, 1515.0);
  request.goal = place(7515.0, 4515.0);
  return request;
}

planning::PlanningConfig config() {
  return planning::read_planning_config(
      planning::effective_planning_config("", {"global.work_budget=20000"}), "test");
}

std::variant<flight::Plan, flight::NoPlan> planned(const map::Map& map,
                                                   const flight::PlanRequest& request,
                                                   const planning::PlanningConfig& config,
                                                   Observer& observer) {
  return planning::plan(map, request, config, {}, observer);
}

RiskDemand demand(double dem_error_m, double navigation_error_m, double probability) {
  ConfigReader reader = ConfigReader::from_text(shipped_config("uncertainty.yaml"), "uncertainty");
  RiskDemand demand;
  demand.errors = {dem_error_m, navigation_error_m};
  demand.probability = probability;
  demand.options = read_uncertainty_options(reader);
  demand.seed = test::fresh_seed();
  return demand;
}

TEST(PlanWithinRisk, KeepsTheProbabilityOnFreshDraws) {
  const map::Map map = hills();
  SilentObserver observer;
  const RiskDemand wanted = demand(3.0, 2.0, 0.02);
  const auto answer = plan_within_risk(map, request_on(map), config(), wanted, planned, observer);
  ASSERT_TRUE(std::holds_alternative<RiskPlan>(answer));
  const auto& found = std::get<RiskPlan>(answer);
  EXPECT_TRUE(found.is_met);
  EXPECT_TRUE(found.plan.verdict.is_verified);
  EXPECT_GT(found.margin_m, 1.0);
  EXPECT_LE(found.risk.high, 0.02);
  UncertaintyOptions fresh = wanted.options;
  fresh.draws = 4000;
  const ClearanceRisk measured =
      clearance_risk(map, found.plan.trajectory, wanted.errors, 10.0, fresh, test::fresh_seed());
  // Met with 97.5 % confidence; beyond that, five standard deviations of 4000 draws.
  EXPECT_LE(measured.probability, 0.02 + 5.0 * std::sqrt(0.02 * 0.98 / 4000.0));
  // Not needlessly high either: a metre or two lower, the risk would be too great.
  EXPECT_GT(clearance_risk(map, found.plan.trajectory, wanted.errors, 13.0, fresh, 1).probability,
            0.02);
}

TEST(PlanWithinRisk, LeavesAPlanAsItIsWhereErrorsAreSmall) {
  const map::Map map = hills();
  SilentObserver observer;
  const auto answer =
      plan_within_risk(map, request_on(map), config(), demand(0.2, 0.1, 0.02), planned, observer);
  const auto& found = std::get<RiskPlan>(answer);
  EXPECT_TRUE(found.is_met);
  EXPECT_EQ(found.rounds, 1);
  EXPECT_EQ(found.margin_m, 0.0);
}

TEST(PlanWithinRisk, SaysThatAStartAskedForTooLowCannotBeHelped) {
  const map::Map map = hills();
  SilentObserver observer;
  flight::PlanRequest request = request_on(map);
  request.start.height_m = 12.0;  // 2 m above the demand, less than one standard deviation
  const auto answer =
      plan_within_risk(map, request, config(), demand(3.0, 2.0, 0.02), planned, observer);
  ASSERT_TRUE(std::holds_alternative<RiskPlan>(answer));
  const auto& found = std::get<RiskPlan>(answer);
  EXPECT_FALSE(found.is_met);
  EXPECT_LT(found.risk.worst_time_s, 10.0);
  EXPECT_LE(found.rounds, 3);
}

TEST(PlanWithinRisk, RefusesProbabilitiesThatAreNone) {
  const map::Map map = hills();
  SilentObserver observer;
  for (const double probability : {0.0, 1.0, -0.1, std::nan("")}) {
    EXPECT_THROW(plan_within_risk(map, request_on(map), config(), demand(3.0, 2.0, probability),
                                  planned, observer),
                 std::invalid_argument);
  }
}

}  // namespace
}  // namespace hedgehop::evaluation
