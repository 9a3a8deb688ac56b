#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <numbers>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "base/shipped_config.hpp"
#include "briefing/announcement.hpp"
#include "briefing/cost_profile.hpp"
#include "briefing/exposure.hpp"
#include "briefing/flight_legs.hpp"
#include "briefing/manoeuvres.hpp"
#include "support/test_map.hpp"

namespace hedgehop::briefing {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kStep_s = 0.05;
constexpr double kStepTolerance_s = 1.001 * kStep_s;  // sums of steps are not exact
constexpr double kSpeed_mps = 40.0;

const ManoeuvreOptions kOptions{.announce_ahead_s = 20.0,
                                .bank_min_rad = radians_from_degrees(5.0),
                                .turn_min_rad = radians_from_degrees(20.0),
                                .climb_angle_min_rad = radians_from_degrees(2.0),
                                .climb_min_m = 20.0,
                                .gap_s = 3.0,
                                .obstacle_distance_m = 300.0,
                                .obstacle_height_m = 50.0};

/// A flight put together from pieces of constant bank and climb rate; bank and climb change at
/// once. Azimuths are those of the grid: convergence 0 unless it is set.
class Pilot {
 public:
  explicit Pilot(double x_m = 0.0, double y_m = 0.0, double altitude_m = 100.0,
                 double heading_rad = 0.0) {
    state_.x_m = x_m;
    state_.y_m = y_m;
    state_.altitude_m = altitude_m;
    state_.speed_mps = kSpeed_mps;
    state_.heading_true_rad = heading_rad;
    flown_.step_s = kStep_s;
    flown_.states.push_back(state_);
  }
  Pilot& fly(double duration_s, double bank_rad = 0.0, double climb_mps = 0.0) {
    const auto steps = std::lround(duration_s / kStep_s);
    flown_.states.back().bank_rad = bank_rad;
    flown_.states.back().climb_rate_mps = climb_mps;
    for (long i = 0; i < steps; ++i) {
      const double turn_rad = kGravity_mps2 * std::tan(bank_rad) / kSpeed_mps * kStep_s;
      // The chord of a circle: straight on if there is no bank.
      const double middle_rad = state_.heading_true_rad + 0.5 * turn_rad;
      const double chord_m = turn_rad == 0.0
                                 ? kSpeed_mps * kStep_s
                                 : 2.0 * kSpeed_mps * kStep_s / turn_rad * std::sin(0.5 * turn_rad);
      state_.x_m += chord_m * std::sin(middle_rad);
      state_.y_m += chord_m * std::cos(middle_rad);
      state_.heading_true_rad = wrap_to_two_pi(state_.heading_true_rad + turn_rad);
      state_.altitude_m += climb_mps * kStep_s;
      state_.time_s += kStep_s;
      state_.bank_rad = bank_rad;
      state_.climb_rate_mps = climb_mps;
      flown_.states.push_back(state_);
    }
    return *this;
  }
  [[nodiscard]] const flight::Trajectory& flown() const { return flown_; }
  [[nodiscard]] flight::Trajectory& flown() { return flown_; }

 private:
  flight::FlightState state_;
  flight::Trajectory flown_;
};

map::Map flat_map(double elevation_m = 0.0) {
  return test::make_map(200, 200, 50.0, [=](double, double) { return elevation_m; });
}

std::vector<Manoeuvre> found_on(const map::Map& map, const flight::Trajectory& flown,
                                const ManoeuvreOptions& options = kOptions) {
  return manoeuvres(map, flown, {}, {}, options);
}

TEST(Manoeuvres, ASteadyTurnIsToldWithTheHeadingOfTheCoordinatedTurn) {
  // 25 degrees of bank at 40 m/s turn g tan(bank) / v = 6.55 deg/s; 10 s of it turn 65.5 degrees.
  const double bank_rad = radians_from_degrees(25.0);
  const double rate_radps = kGravity_mps2 * std::tan(bank_rad) / kSpeed_mps;
  const Pilot pilot = Pilot(1000, 1000, 100, 6.0).fly(30).fly(10, bank_rad).fly(30);

  const auto found = found_on(flat_map(), pilot.flown());

  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].kind, ManoeuvreKind::kTurn);
  EXPECT_NEAR(found[0].time_s, 30.0, kStepTolerance_s);
  EXPECT_NEAR(found[0].along_m, 1200.0, 2.0);
  EXPECT_NEAR(found[0].duration_s, 10.0, kStepTolerance_s);
  const double of_a_step_rad = 1.001 * rate_radps * kStep_s;
  EXPECT_NEAR(found[0].heading_change_rad, 10.0 * rate_radps, of_a_step_rad);
  EXPECT_NEAR(found[0].heading_to_rad, 6.0 + 10.0 * rate_radps - 2.0 * kPi, of_a_step_rad);
  EXPECT_DOUBLE_EQ(found[0].bank_max_rad, bank_rad);
  EXPECT_NEAR(found[0].announced_time_s, 10.0, kStepTolerance_s);
  EXPECT_NEAR(found[0].announced_distance_m, 800.0, 2.0);
}

TEST(Manoeuvres, AMirroredFlightTurnsAsMuchToTheOtherSide) {
  const double bank_rad = radians_from_degrees(20.0);
  const auto right = found_on(flat_map(), Pilot(5000, 1000).fly(5).fly(9, bank_rad).fly(5).flown());
  const auto left = found_on(flat_map(), Pilot(5000, 1000).fly(5).fly(9, -bank_rad).fly(5).flown());
  ASSERT_EQ(right.size(), 1U);
  ASSERT_EQ(left.size(), 1U);
  EXPECT_GT(right[0].heading_change_rad, 0.0);
  EXPECT_NEAR(left[0].heading_change_rad, -right[0].heading_change_rad, 1e-9);
  EXPECT_NEAR(wrap_to_pi(left[0].heading_to_rad + right[0].heading_to_rad), 0.0, 1e-12);
}

TEST(Manoeuvres, AShortInterruptionDoesNotEndATurnButTheOtherSideDoes) {
  const double bank_rad = radians_from_degrees(25.0);
  const auto interrupted = found_on(
      flat_map(), Pilot(3000, 1000).fly(5, bank_rad).fly(2.5).fly(5, bank_rad).fly(5).flown());
  ASSERT_EQ(interrupted.size(), 1U);
  EXPECT_NEAR(interrupted[0].duration_s, 12.5, 2 * kStepTolerance_s);

  const auto parted = found_on(
      flat_map(), Pilot(3000, 1000).fly(5, bank_rad).fly(3.5).fly(5, bank_rad).fly(5).flown());
  EXPECT_EQ(parted.size(), 2U);

  const auto reversed =
      found_on(flat_map(), Pilot(3000, 1000).fly(5, bank_rad).fly(5, -bank_rad).fly(5).flown());
  ASSERT_EQ(reversed.size(), 2U);
  EXPECT_GT(reversed[0].heading_change_rad, 0.0);
  EXPECT_LT(reversed[1].heading_change_rad, 0.0);
}

TEST(Manoeuvres, SmallTurnsAndClimbsAreNotTold) {
  // 3 s at 25 degrees turn 19.6 degrees; 4 s at 4.9 m/s climb 19.6 m.
  EXPECT_TRUE(found_on(flat_map(),
                       Pilot(3000, 1000).fly(5).fly(3, radians_from_degrees(25.0)).fly(5).flown())
                  .empty());
  EXPECT_TRUE(found_on(flat_map(), Pilot(3000, 1000).fly(5).fly(4, 0, 4.9).fly(5).flown()).empty());
}

TEST(Manoeuvres, ClimbAndDescentAreToldWithTheirAltitudes) {
  const Pilot pilot = Pilot(3000, 500, 400).fly(10).fly(8, 0, 5).fly(10).fly(12, 0, -4).fly(5);
  const auto found = found_on(flat_map(), pilot.flown());
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0].kind, ManoeuvreKind::kClimb);
  EXPECT_NEAR(found[0].time_s, 10.0, kStepTolerance_s);
  EXPECT_NEAR(found[0].altitude_from_m, 400.0, 0.3);
  EXPECT_NEAR(found[0].altitude_to_m, 440.0, 0.3);
  EXPECT_DOUBLE_EQ(found[0].rate_max_mps, 5.0);
  EXPECT_EQ(found[1].kind, ManoeuvreKind::kDescent);
  EXPECT_NEAR(found[1].time_s, 28.0, kStepTolerance_s);
  EXPECT_NEAR(found[1].altitude_to_m, 392.0, 0.3);
  EXPECT_DOUBLE_EQ(found[1].rate_max_mps, 4.0);
}

TEST(Manoeuvres, AWireIsCrossedWhereTrackAndSpanMeet) {
  // Ground at 100 m. The conductor hangs straight from 130 m at x = 1000 m to 150 m at x = 1400 m,
  // at y = 2000 m; the flight comes north along x = 1100 m: a quarter of the span, 135 m.
  map::Map map = flat_map(100.0);
  map.overhead_lines.push_back({77, {{{1000, 2000}, 30}, {{1400, 2000}, 50}, {{1800, 2600}, 50}}});
  const Pilot pilot = Pilot(1100, 1001, 160).fly(60);

  const auto found = found_on(map, pilot.flown());

  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].kind, ManoeuvreKind::kWireCrossing);
  EXPECT_NEAR(found[0].time_s, 999.0 / 40.0, 1e-9);
  EXPECT_NEAR(found[0].along_m, 999.0, 1e-9);
  EXPECT_NEAR(found[0].place.y_m, 2000.0, 1e-9);
  EXPECT_NEAR(found[0].top_m, 135.0, 1e-9);
  EXPECT_NEAR(found[0].above_m, 25.0, 1e-9);
  EXPECT_NEAR(found[0].support_m, 100.0, 1e-9);
  EXPECT_EQ(found[0].name, "power line 77");
}

TEST(Manoeuvres, ACrossingOverASupportCountsOnce) {
  map::Map map = flat_map();
  map.overhead_lines.push_back({1, {{{1000, 2000}, 30}, {{1400, 2000}, 30}, {{1800, 2000}, 30}}});
  const auto over_the_middle = found_on(map, Pilot(1400, 1000).fly(60).flown());
  ASSERT_EQ(over_the_middle.size(), 1U);
  EXPECT_NEAR(over_the_middle[0].support_m, 0.0, 1e-9);
  EXPECT_EQ(found_on(map, Pilot(1800, 1000).fly(60).flown()).size(), 1U);
  // A state that lies exactly on the wire: 1000 m are 500 steps of 2 m.
  EXPECT_EQ(found_on(map, Pilot(1200, 1000).fly(60).flown()).size(), 1U);
  EXPECT_TRUE(found_on(map, Pilot(1801, 1000).fly(60).flown()).empty());
}

TEST(Manoeuvres, AnObstacleIsToldOnItsSideWhereItIsNearest) {
  // North along x = 1000 m; a mast 200 m to the east with a radius of 20 m, its top 30 m below.
  map::Map map = flat_map();
  map::Obstacle mast;
  mast.kind = map::ObstacleKind::kMast;
  mast.name = "Tall <one>";
  mast.point = {1200, 2000};
  mast.radius_m = 20;
  mast.height_m = mast.top_m = 70;
  map.obstacles.push_back(mast);
  const auto found = found_on(map, Pilot(1000, 1000, 100).fly(60).flown());
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].kind, ManoeuvreKind::kObstacle);
  EXPECT_NEAR(found[0].time_s, 25.0, kStepTolerance_s);
  EXPECT_NEAR(found[0].distance_m, 180.0, 0.01);
  EXPECT_NEAR(found[0].above_m, 30.0, 1e-9);
  EXPECT_NEAR(found[0].bearing_rad, kPi / 2.0, 0.01);
  EXPECT_EQ(found[0].name, "mast Tall <one>");

  map.obstacles[0].top_m = 49.0;  // 51 m below: nobody needs to know
  EXPECT_TRUE(found_on(map, Pilot(1000, 1000, 100).fly(60).flown()).empty());
  map.obstacles[0].top_m = 70.0;
  map.obstacles[0].point.x_m = 1321.0;  // its side 301 m off
  EXPECT_TRUE(found_on(map, Pilot(1000, 1000, 100).fly(60).flown()).empty());
}

TEST(Manoeuvres, AreInTheOrderOfTimeAndViaPointsAreAmongThem) {
  const Pilot pilot =
      Pilot(3000, 500, 400).fly(10).fly(8, 0, 5).fly(10).fly(9, radians_from_degrees(20)).fly(9);
  const auto found = manoeuvres(flat_map(), pilot.flown(), {400}, {35.0}, kOptions);
  ASSERT_EQ(found.size(), 3U);
  EXPECT_EQ(found[0].kind, ManoeuvreKind::kClimb);
  EXPECT_EQ(found[1].kind, ManoeuvreKind::kVia);
  EXPECT_NEAR(found[1].time_s, 20.0, 1e-9);
  EXPECT_EQ(found[1].number, 1U);
  EXPECT_EQ(found[1].distance_m, 35.0);
  EXPECT_EQ(found[2].kind, ManoeuvreKind::kTurn);
}

TEST(Manoeuvres, AFlightWithoutStatesHasNone) { EXPECT_TRUE(found_on(flat_map(), {}).empty()); }

Manoeuvre a_turn() {
  Manoeuvre turn;
  turn.kind = ManoeuvreKind::kTurn;
  turn.time_s = 45.0;
  turn.announced_time_s = 25.0;
  turn.announced_distance_m = 803.0;
  turn.duration_s = 9.4;
  turn.heading_change_rad = 1.0;
  turn.heading_to_rad = radians_from_degrees(214.3);
  turn.bank_max_rad = radians_from_degrees(24.8);
  return turn;
}

TEST(Announcement, ATurnSaysWhenWhereToAndHowSteep) {
  EXPECT_EQ(announcement_text(a_turn(), std::nullopt),
            "in 20 s, 800 m: turn right to 214° true; bank 25°, 9 s");
}

TEST(Announcement, AnEasterlyDeclinationMakesTheMagneticHeadingSmaller) {
  // "Variation east, magnetic least."
  EXPECT_EQ(announcement_text(a_turn(), radians_from_degrees(3.5)),
            "in 20 s, 800 m: turn right to 214° true, 211° magnetic; bank 25°, 9 s");
  EXPECT_NEAR(magnetic_from_true_azimuth_rad(radians_from_degrees(2.0), radians_from_degrees(5.0)),
              radians_from_degrees(357.0), 1e-12);
}

TEST(Announcement, HeadingsHaveThreeDigitsAndNo360) {
  EXPECT_EQ(heading_text(radians_from_degrees(4.2)), "004°");
  EXPECT_EQ(heading_text(radians_from_degrees(359.7)), "000°");
  EXPECT_EQ(heading_text(radians_from_degrees(-90.0)), "270°");
  EXPECT_EQ(heading_text(std::numeric_limits<double>::quiet_NaN()), "unknown");
}

TEST(Announcement, WhatComesAtOnceIsToldNow) {
  Manoeuvre climb;
  climb.kind = ManoeuvreKind::kClimb;
  climb.altitude_from_m = 400.4;
  climb.altitude_to_m = 461.0;
  climb.rate_max_mps = 5.25;
  climb.duration_s = 12.0;
  EXPECT_EQ(announcement_text(climb, {}), "now: climb from 400 m to 461 m; up to 5.2 m/s, 12 s");
}

TEST(Announcement, AWireAboveTheFlightIsShouted) {
  Manoeuvre wire;
  wire.kind = ManoeuvreKind::kWireCrossing;
  wire.time_s = 20.0;
  wire.announced_distance_m = 1234.0;
  wire.name = "power line 7";
  wire.above_m = 31.6;
  wire.support_m = 42.0;
  EXPECT_EQ(announcement_text(wire, {}),
            "in 20 s, 1.2 km: cross power line 7, 32 m above the wire; nearest support 42 m away");
  wire.above_m = -3.0;
  EXPECT_NE(announcement_text(wire, {}).find("3 m BELOW the wire"), std::string::npos);
  wire.above_m = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE(announcement_text(wire, {}).find("height of the wire unknown"), std::string::npos);
}

TEST(FlightLegs, AStraightFlightIsOneLeg) {
  const Pilot pilot = Pilot(1000, 1000, 250, radians_from_degrees(90)).fly(50);
  const auto legs = flight_legs(pilot.flown(), {}, {100.0});
  ASSERT_EQ(legs.size(), 1U);
  EXPECT_NEAR(legs[0].length_m, 2000.0, 1e-6);
  EXPECT_NEAR(legs[0].course_grid_rad, kPi / 2.0, 1e-9);
  EXPECT_NEAR(legs[0].duration_s, 50.0, 1e-9);
  EXPECT_NEAR(legs[0].speed_mps, 40.0, 1e-9);
  EXPECT_NEAR(legs[0].height_min_m, 250.0, 1e-9);
}

TEST(FlightLegs, ARightAngleIsTwoLegsThatMeetAtItsCorner) {
  flight::Trajectory flown = Pilot(1000, 1000).fly(40).flown();
  Pilot east(1000, 2600, 100, kPi / 2.0);
  for (flight::FlightState state : east.fly(30).flown().states) {
    state.time_s += 40.0;
    flown.states.push_back(state);
  }
  const auto legs = flight_legs(flown, {}, {100.0});
  ASSERT_EQ(legs.size(), 2U);
  EXPECT_NEAR(legs[0].length_m, 1600.0, 1e-6);
  EXPECT_NEAR(legs[0].course_grid_rad, 0.0, 1e-9);
  EXPECT_NEAR(legs[1].start_along_m, 1600.0, 1e-6);
  EXPECT_NEAR(legs[1].start_time_s, 40.0, 1e-9);
  EXPECT_NEAR(legs[1].length_m, 1200.0, 1e-6);
  EXPECT_NEAR(legs[1].course_grid_rad, kPi / 2.0, 1e-9);
}

TEST(FlightLegs, ALooseToleranceLeavesOutWhatATightOneKeeps) {
  // A bulge of a circle of 2000 m radius flown for 20 s: 0.4 rad, sagitta 2000 (1 - cos 0.2) = 40
  // m.
  const double bank_rad = std::atan(kSpeed_mps * kSpeed_mps / kGravity_mps2 / 2000.0);
  const Pilot pilot = Pilot(5000, 1000).fly(20, bank_rad);
  EXPECT_EQ(flight_legs(pilot.flown(), {}, {40.5}).size(), 1U);
  EXPECT_EQ(flight_legs(pilot.flown(), {}, {39.0}).size(), 2U);
}

TEST(FlightLegs, ViaPointsEndALegAndTheTrueCourseHasTheConvergence) {
  flight::Trajectory flown = Pilot(1000, 1000).fly(40).flown();
  for (flight::FlightState& state : flown.states) {
    state.convergence_rad = 0.02;
  }
  const auto legs = flight_legs(flown, {300}, {100.0});
  ASSERT_EQ(legs.size(), 2U);
  EXPECT_EQ(legs[0].last, 300U);
  EXPECT_NEAR(legs[1].course_true_rad, legs[1].course_grid_rad + 0.02, 1e-12);
  EXPECT_TRUE(flight_legs({}, {}, {100.0}).empty());
}

/// Visibility 0.5 west of x = 5000 m and 0 east of it; a village from y = 6000 m on.
class CostProfileTest : public testing::Test {
 protected:
  CostProfileTest()
      : map_(flat_map()),
        model_((paint(), map_),
               {.visibility = 20.0,
                .visibility_per_height_1pm = 0.0,
                .semantics = 4.0,
                .height_1pm = 0.01},
               risk::SemanticCostTable(
                   {{static_cast<std::uint16_t>(map::SemanticClass::kVillage), 0.8}}, 0.0),
               1.0) {}
  void paint() {
    for (int row = 0; row < 200; ++row) {
      for (int column = 0; column < 200; ++column) {
        map_.visibility.at(column, row) = test::stored_visibility(column < 100 ? 0.5 : 0.0);
        map_.semantics.at(column, row) =
            row >= 120 ? static_cast<std::uint16_t>(map::SemanticClass::kVillage) : 0;
      }
    }
    test::finish_map(map_);
  }
  map::Map map_;
  risk::CostModel model_;
};

TEST_F(CostProfileTest, TermsAreThoseOfEquationOne) {
  // East along y = 3000 m from x = 4000 to 6000 m, 35.24 m high: 20 m above reference height.
  // Seen half of the way: 20 x 0.25 = 5 per metre; height 0.01 x 20 = 0.2 everywhere.
  const Pilot pilot = Pilot(4000, 3000, 35.24, kPi / 2.0).fly(50);
  const CostProfile profile = cost_profile(model_, pilot.flown(), {25.0, 500.0});
  ASSERT_EQ(profile.places.size(), 80U);
  EXPECT_NEAR(profile.step_m, 25.0, 1e-9);
  EXPECT_NEAR(profile.places.front().along_m, 12.5, 1e-9);
  const flight::RouteCost total = profile.total();
  EXPECT_NEAR(total.length_m, 2000.0, 1e-6);
  EXPECT_NEAR(total.visibility_m, 5000.0, 1.0);  // 0.5 is stored in 16 bits
  EXPECT_NEAR(total.semantics_m, 0.0, 1e-9);
  EXPECT_NEAR(total.height_m, 400.0, 1e-4);
  EXPECT_NEAR(mean_cost(profile, 0.0, 1000.0, &CostPlace::here).total_m(), 6.2, 1e-3);
  EXPECT_NEAR(mean_cost(profile, 1000.0, 2000.0, &CostPlace::here).total_m(), 1.2, 1e-3);
}

TEST_F(CostProfileTest, WhatLiesBesideIsToldOnItsSide) {
  // North along x = 5200 m: dark here and on the right, seen 500 m to the left.
  const Pilot pilot = Pilot(5200, 1000, 15.24).fly(50);
  const CostProfile profile = cost_profile(model_, pilot.flown(), {25.0, 500.0});
  EXPECT_NEAR(mean_cost(profile, 0, 2000, &CostPlace::here).total_m(), 1.0, 1e-3);
  EXPECT_NEAR(mean_cost(profile, 0, 2000, &CostPlace::left).visibility_m, 5.0, 1e-3);
  EXPECT_NEAR(mean_cost(profile, 0, 2000, &CostPlace::right).total_m(), 1.0, 1e-3);
}

TEST_F(CostProfileTest, PlacesBesideTheMapAreLeftOutOfTheMean) {
  const Pilot pilot = Pilot(300, 1000, 15.24).fly(50);
  const CostProfile profile = cost_profile(model_, pilot.flown(), {25.0, 500.0});
  EXPECT_TRUE(std::isnan(mean_cost(profile, 0, 2000, &CostPlace::left).total_m()));
  EXPECT_NEAR(mean_cost(profile, 0, 2000, &CostPlace::right).total_m(), 6.0, 1e-3);
}

TEST_F(CostProfileTest, AStraightLineCostsWhatItCrosses) {
  // From (6000, 5000) north to (6000, 8000): 1000 m of nothing, 2000 m of village at 4 x 0.8.
  const auto cost = straight_cost(model_, {{6000, 5000}, {6000, 8000}}, 15.24, 10.0);
  EXPECT_NEAR(cost.length_m, 3000.0, 1e-9);
  EXPECT_NEAR(cost.semantics_m, 6400.0, 1e-3);
  EXPECT_NEAR(cost.visibility_m, 0.0, 1e-9);
  EXPECT_NEAR(cost.height_m, 0.0, 1e-9);
  EXPECT_TRUE(std::isnan(straight_cost(model_, {{6000, 5000}, {6000, 18000}}, 15, 10).total_m()));
}

TEST_F(CostProfileTest, AFlightWithoutLengthHasNoPlaces) {
  EXPECT_TRUE(cost_profile(model_, {}, {25.0, 500.0}).places.empty());
  EXPECT_TRUE(cost_profile(model_, Pilot(5000, 5000).flown(), {25.0, 500.0}).places.empty());
}

TEST(Exposures, AFlightIsSeenWhereItFliesAsHighAsTheObserverSees) {
  // The observer sees everything above 20 m between x = 3000 and 5000 m, nothing elsewhere.
  const map::Map map = flat_map();
  map::HeightLayer layer{"tower", raster::Grid<float>(map.geometry, std::nanf(""))};
  for (int row = 0; row < 200; ++row) {
    for (int column = 60; column < 100; ++column) {
      layer.height_m.at(column, row) = 20.0F;
    }
  }
  const Pilot high = Pilot(2000, 5000, 25, kPi / 2).fly(100);
  const auto seen = exposures({layer}, high.flown());
  ASSERT_EQ(seen.size(), 1U);
  EXPECT_EQ(seen[0].name, "tower");
  ASSERT_EQ(seen[0].stretches.size(), 1U);
  EXPECT_NEAR(seen[0].stretches[0].from_m, 1000.0, 2.0);
  EXPECT_NEAR(seen[0].seen_m, 2000.0, 2.0);
  EXPECT_NEAR(seen[0].seen_s, 50.0, kStepTolerance_s);
  EXPECT_NEAR(seen[0].share, 0.5, 1e-3);

  const Pilot low = Pilot(2000, 5000, 19.5, kPi / 2).fly(100);
  EXPECT_TRUE(exposures({layer}, low.flown())[0].stretches.empty());
  EXPECT_EQ(exposures({layer}, low.flown())[0].share, 0.0);
  EXPECT_EQ(exposures({layer}, {})[0].seen_s, 0.0);
}

TEST(ReportConfig, IsReadAndRefusesWhatCannotBeMeant) {
  const auto read = [](const std::string& text) {
    ConfigReader reader = ConfigReader::from_text(text, "report.yaml");
    ConfigReader legs = reader.required_section("legs");
    read_leg_options(legs);
    ConfigReader moves = reader.required_section("manoeuvres");
    const ManoeuvreOptions options = read_manoeuvre_options(moves);
    ConfigReader costs = reader.required_section("costs");
    read_cost_options(costs);
    return options;
  };
  const std::string shipped(shipped_config("report.yaml"));
  EXPECT_NEAR(read(shipped).bank_min_rad, radians_from_degrees(5.0), 1e-12);
  for (const char* wrong :
       {"legs.tolerance_m=0", "manoeuvres.bank_min_deg=0", "manoeuvres.gap_s=-1", "costs.step_m=0",
        "costs.beside_m=-5", "manoeuvres.climb_angle_min_deg=0"}) {
    EXPECT_THROW(read(set_config_value(shipped, wrong)), ConfigError) << wrong;
  }
}

}  // namespace
}  // namespace hedgehop::briefing
