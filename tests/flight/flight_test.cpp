#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "base/errors.hpp"
#include "base/shipped_config.hpp"
#include "flight/plan.hpp"
#include "flight/plan_request.hpp"
#include "flight/route.hpp"
#include "flight/route_choice.hpp"
#include "flight/vehicle.hpp"

namespace hedgehop::flight {
namespace {

constexpr NoPlanCause kCauses[] = {NoPlanCause::kStartOutsideMap,
                                   NoPlanCause::kGoalOutsideMap,
                                   NoPlanCause::kStartUnknownTerrain,
                                   NoPlanCause::kGoalUnknownTerrain,
                                   NoPlanCause::kStartBelowEnvelope,
                                   NoPlanCause::kGoalBelowEnvelope,
                                   NoPlanCause::kStartAboveEnvelope,
                                   NoPlanCause::kGoalAboveEnvelope,
                                   NoPlanCause::kGoalEqualsStart,
                                   NoPlanCause::kReferenceHeightMismatch,
                                   NoPlanCause::kSearchSpaceDisconnected,
                                   NoPlanCause::kBudgetExhausted,
                                   NoPlanCause::kLocalPlannerStuck,
                                   NoPlanCause::kStopped,
                                   NoPlanCause::kClimbLimit,
                                   NoPlanCause::kStartInsideArea,
                                   NoPlanCause::kGoalInsideArea};

TEST(RouteLength, IsThatOfThreeDimensions) {
  EXPECT_EQ(length_m({}), 0.0);
  EXPECT_EQ(length_m({{1, 2, 3}}), 0.0);
  EXPECT_NEAR(length_m({{0, 0, 0}, {3, 4, 0}, {3, 4, 12}}), 17.0, 1e-12);
}

TEST(NoPlanCause, EveryOneHasItsOwnName) {
  std::set<std::string> names;
  for (const NoPlanCause cause : kCauses) {
    names.insert(name_of(cause));
  }
  EXPECT_EQ(names.size(), std::size(kCauses));
  EXPECT_EQ(names.count(""), 0U);
}

TEST(NoPlanCause, NotFoundStuckAndStoppedNameNoReason) {
  for (const NoPlanCause cause : kCauses) {
    const bool is_excuse = cause == NoPlanCause::kBudgetExhausted ||
                           cause == NoPlanCause::kLocalPlannerStuck ||
                           cause == NoPlanCause::kStopped;
    EXPECT_EQ(is_named_cause(cause), !is_excuse) << name_of(cause);
  }
}

TEST(TurnRadius, FortyMetresPerSecondAtThirtyDegreesNeedTwoHundredAndEightyTwoMetres) {
  // 1600 / (9.80665 * 0.57735)
  EXPECT_NEAR(turn_radius_min_m(40.0, 0.52359877559829887), 282.59, 0.01);
  EXPECT_THROW(turn_radius_min_m(40.0, 0.0), std::invalid_argument);
  EXPECT_THROW(turn_radius_min_m(std::nan(""), 0.5), std::invalid_argument);
}

TEST(Limits, TheShippedVehicleHoldsThem) {
  auto reader = ConfigReader::from_text(shipped_config("vehicles/ec135.yaml"), "ec135.yaml");
  auto section = reader.required_section("limits");
  const Limits limits = read_limits(section);
  EXPECT_NEAR(limits.bank_max_rad, 0.5235987755982988, 1e-12);
  EXPECT_EQ(limits.climb_rate_max_mps, 8.0);
}

TEST(Limits, AnImpossibleValueIsRefusedWithItsPlace) {
  auto reader = ConfigReader::from_text(
      "speed_min_mps: 15\nspeed_max_mps: 10\nbank_max_deg: 30\nroll_rate_max_degps: 35\n"
      "pitch_max_deg: 12\nclimb_rate_max_mps: 8\ndescent_rate_max_mps: 8\n"
      "vertical_acceleration_max_mps2: 2.5\n"
      "load_factor_max: 1.5\n",
      "wrong.yaml");
  try {
    read_limits(reader);
    FAIL() << "accepted a greatest speed below the least";
  } catch (const ConfigError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("wrong.yaml:2:"));
  }
}

TEST(PlanRequestId, ChangesWithEverythingThatIsAsked) {
  PlanRequest request;
  request.start = {{0.87, 0.2}, 20.0};
  request.goal = {{0.871, 0.201}, std::nullopt};
  const Hash128 map{1, 2};
  std::vector<PlanRequest> others(8, request);
  others[0].start.position.latitude_rad = 0.8700001;
  others[1].start.height_m = std::nullopt;
  others[2].goal.height_m = 0.0;  // not the same as none
  others[3].via.push_back(request.goal);
  others[4].start_heading_true_rad = 0.0;
  others[5].speed_mps = 40.0;
  others[6].seed = 2;
  others[7].work_budget = 1;
  std::set<std::string> ids = {plan_request_id(request, map, "config").hex(),
                               plan_request_id(request, {1, 3}, "config").hex(),
                               plan_request_id(request, map, "other").hex()};
  for (const PlanRequest& other : others) {
    ids.insert(plan_request_id(other, map, "config").hex());
  }
  EXPECT_EQ(ids.size(), 11U);
  EXPECT_EQ(plan_request_id(request, map, "config"), plan_request_id(request, map, "config"));
}

TEST(SharedShare, CountsWhatRunsAlongTheOtherRouteAndNoMore) {
  // GIVEN a straight route of 10 km
  const std::vector<Waypoint> straight = {{0, 0, 0}, {10000, 0, 500}};
  // WHEN another runs 200 m beside its first 4 km, then leaves at a right angle
  const std::vector<Waypoint> leaving = {{0, 200, 0}, {4000, 200, 0}, {4000, 6200, 0}};
  // THEN it shares those and 100 m of the way out; the straight one is near to it until
  // sqrt(300^2 - 200^2) = 224 m past the corner
  EXPECT_NEAR(shared_share(leaving, straight, 300.0), 4100.0 / 10000.0, 0.0011);
  EXPECT_NEAR(shared_share(straight, leaving, 300.0), (4000.0 + 223.6) / 10000.0, 0.0011);
  EXPECT_EQ(shared_share(leaving, straight, 199.0), 0.0);
  EXPECT_EQ(shared_share(straight, straight, 0.001), 1.0);
  // A crossing at right angles shares 2 x 300 m.
  EXPECT_NEAR(shared_share({{5000, -3000, 0}, {5000, 3000, 0}}, straight, 300.0), 0.1, 0.002);
}

TEST(SharedShare, NamesTheMiddleOfTheLongestStretch) {
  const std::vector<Waypoint> straight = {{0, 0, 0}, {10000, 0, 0}};
  // Beside it for 1 km, far away, and beside it again for 3 km.
  const std::vector<Waypoint> other = {{0, 0, 0},       {1000, 0, 0}, {1000, 5000, 0},
                                       {7000, 5000, 0}, {7000, 0, 0}, {10000, 0, 0}};
  const geo::MapPoint middle = longest_shared_stretch(other, straight, 300.0);
  EXPECT_NEAR(middle.x_m, 0.5 * (7000.0 - 300.0 + 10000.0), 160.0);
  EXPECT_NEAR(middle.y_m, 0.0, 1e-9);
}

TEST(RouteMeasures, OneMustBeBetterByAShareOfTheOther) {
  const RouteMeasures one{10000, 500, 0};
  EXPECT_FALSE(is_better_in_something(one, one, 0.0));
  EXPECT_FALSE(is_better_in_something(one, {10000, 505, 0}, 0.02));
  EXPECT_TRUE(is_better_in_something(one, {10000, 520, 0}, 0.02));
  EXPECT_TRUE(is_better_in_something(one, {9000, 400, 1}, 0.02)) << "no land use against some";
  EXPECT_FALSE(is_better_in_something({9000, 400, 0}, {8000, 300, 0}, 0.0));
}

}  // namespace
}  // namespace hedgehop::flight
