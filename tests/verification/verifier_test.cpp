#include "verification/verifier.hpp"

#include <cmath>
#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <limits>
#include <random>

#include "base/errors.hpp"
#include "base/shipped_config.hpp"
#include "command_model/command_model.hpp"
#include "support/fresh_seed.hpp"
#include "support/test_map.hpp"
#include "verification/perfect_flight.hpp"

namespace hedgehop::verification {
namespace {

using test::fly;
using test::Integrator;
using test::Manoeuvre;

const double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kCell_m = 30.0;
constexpr int kCells = 200;  // 6 x 6 km

Demands test_demands() {
  Demands demands;
  demands.required_clearance_m = 10.0;
  demands.ceiling_height_m = 120.0;
  demands.share_under_ceiling_min = 0.0;
  demands.goal_radius_m = 60.0;
  demands.start_radius_m = 1.0;
  demands.via_radius_m = 250.0;
  return demands;
}

double hills_m(double x_m, double y_m) {
  return 300.0 + 60.0 * std::sin(x_m / 700.0) * std::cos(y_m / 500.0) +
         8.0 * std::sin(x_m / 90.0 + y_m / 130.0);
}

map::Map hills_with_blocks() {
  map::Map map = test::make_map(kCells, kCells, kCell_m, hills_m);
  for (int row = 20; row < kCells - 8; row += 17) {
    for (int column = 15; column < kCells - 8; column += 13) {
      for (int r = row; r < row + 4; ++r) {
        for (int c = column; c < column + 5; ++c) {
          map.surface_m.at(c, r) += 22.0F;
        }
      }
    }
  }
  test::finish_map(map);
  return map;
}

flight::Waypoint place_of(const flight::FlightState& state) {
  return {state.x_m, state.y_m, state.altitude_m};
}

flight::Verdict verdict_of(const map::Map& map, const flight::Trajectory& trajectory,
                           const Demands& demands = test_demands()) {
  return verify(map, trajectory, place_of(trajectory.states.front()), {},
                place_of(trajectory.states.back()), test::test_limits(), demands);
}

// Least height above the surface at points at most `spacing_m` apart on the chords.
double sampled_clearance_m(const map::Map& map, const flight::Trajectory& trajectory,
                           double spacing_m) {
  double least_m = 1e9;
  for (std::size_t i = 1; i < trajectory.states.size(); ++i) {
    const flight::FlightState& a = trajectory.states[i - 1];
    const flight::FlightState& b = trajectory.states[i];
    const int samples = 1 + static_cast<int>(std::hypot(b.x_m - a.x_m, b.y_m - a.y_m) / spacing_m);
    for (int k = 0; k <= samples; ++k) {
      const double t = static_cast<double>(k) / samples;
      const double surface_m = raster::sample_bilinear(
          map.surface_m, {a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m)});
      least_m = std::min(least_m, a.altitude_m + t * (b.altitude_m - a.altitude_m) - surface_m);
    }
  }
  return least_m;
}

std::string list_of(const flight::Verdict& verdict) {
  std::string text;
  for (const flight::Violation& violation : verdict.violations) {
    text += violation.rule + " at " + std::to_string(violation.time_s) +
            " s: " + std::to_string(violation.value) + " for " + std::to_string(violation.limit) +
            "\n";
  }
  return text;
}

const flight::Violation* worst_of(const flight::Verdict& verdict, const std::string& rule) {
  for (const flight::Violation& violation : verdict.violations) {
    if (violation.rule == rule) {
      return &violation;
    }
  }
  return nullptr;
}

// Turns right, climbs, turns left, descends and changes speed over the hills.
Manoeuvre varied_manoeuvre() {
  Manoeuvre manoeuvre;
  manoeuvre.x_m = 1500.0;
  manoeuvre.y_m = 2000.0;
  manoeuvre.azimuth_grid_rad = 0.6;
  manoeuvre.altitude_m = 410.0;
  manoeuvre.duration_s = 60.0;
  manoeuvre.bank_rad.ramp(5.0, 2.0, 0.35).ramp(15.0, 3.0, -0.45).ramp(25.0, 2.0, 0.0);
  manoeuvre.bank_rad.ramp(40.0, 1.5, 0.2);
  manoeuvre.climb_rate_mps.ramp(2.0, 5.0, 6.0).ramp(20.0, 10.0, -6.0).ramp(35.0, 5.0, 0.0);
  manoeuvre.speed_mps.ramp(10.0, 12.0, 50.0).ramp(30.0, 20.0, 30.0);
  return manoeuvre;
}

class Verify : public testing::Test {
 protected:
  Verify() : map_(hills_with_blocks()), flight_(fly(varied_manoeuvre(), map_)) {
    test::lift(flight_, 14.0 - sampled_clearance_m(map_, flight_, 0.5));
  }

  // The states of `flight_` from `from` on, changed.
  flight::Trajectory changed(std::size_t from, std::size_t to,
                             const std::function<void(flight::FlightState&)>& change) const {
    flight::Trajectory trajectory = flight_;
    for (std::size_t i = from; i < std::min(to, trajectory.states.size()); ++i) {
      change(trajectory.states[i]);
      trajectory.states[i].surface_m =
          raster::sample_bilinear(map_.surface_m, trajectory.states[i].point());
      trajectory.states[i].terrain_m =
          raster::sample_bilinear(map_.terrain_m, trajectory.states[i].point());
    }
    return trajectory;
  }

  // Expects that the planted fault is found under `rule` between two times, and nothing else but
  // `companions`.
  void expect_found(const flight::Verdict& verdict, const std::string& rule, double from_s,
                    double to_s, const std::vector<std::string>& companions = {}) const {
    EXPECT_FALSE(verdict.is_verified);
    const flight::Violation* worst = worst_of(verdict, rule);
    ASSERT_NE(worst, nullptr) << "not found: " << rule << "; found:\n" << list_of(verdict);
    EXPECT_GE(worst->time_s, from_s - 1e-9);
    EXPECT_LE(worst->time_s, to_s + 1e-9);
    for (const flight::Violation& violation : verdict.violations) {
      EXPECT_TRUE(violation.rule == rule ||
                  std::count(companions.begin(), companions.end(), violation.rule) > 0)
          << violation.rule << " at " << violation.time_s;
    }
  }

  map::Map map_;
  flight::Trajectory flight_;
};

constexpr std::size_t kEnd = std::numeric_limits<std::size_t>::max();

TEST_F(Verify, PassesAPerfectFlightAndMeasuresIt) {
  const flight::Verdict verdict = verdict_of(map_, flight_);
  EXPECT_TRUE(verdict.is_verified) << list_of(verdict);
  EXPECT_EQ(verdict.violation_count, 0);
  EXPECT_NEAR(verdict.clearance_min_m, 14.0, 0.05);
  EXPECT_LE(verdict.clearance_min_m, 14.0);
  EXPECT_NEAR(verdict.bank_max_rad, 0.45, 1e-9);
  EXPECT_NEAR(verdict.roll_rate_max_radps, 1.875 * 0.8 / 3.0, 1e-3);
  EXPECT_NEAR(verdict.climb_rate_max_mps, 6.0, 1e-9);
  EXPECT_NEAR(verdict.descent_rate_max_mps, 6.0, 1e-9);
  EXPECT_NEAR(verdict.speed_min_mps, 30.0, 1e-9);
  EXPECT_NEAR(verdict.speed_max_mps, 50.0, 1e-9);
  EXPECT_EQ(verdict.goal_distance_m, 0.0);
}

TEST_F(Verify, RaisesNoFalseAlarmOverRandomPerfectFlights) {
  std::mt19937_64 random(test::fresh_seed());
  for (int round = 0; round < 60; ++round) {
    Manoeuvre manoeuvre = test::random_manoeuvre(random, test::test_limits());
    manoeuvre.x_m = 3000.0;
    manoeuvre.y_m = 3000.0;
    const double step_s = std::vector<double>{0.02, 0.05, 0.1}[random() % 3];
    const auto integrator = static_cast<Integrator>(random() % 3);
    flight::Trajectory flight = fly(manoeuvre, map_, step_s, integrator);
    const double sampled_m = sampled_clearance_m(map_, flight, 0.5);
    test::lift(flight, 10.5 - sampled_m);
    const flight::Verdict verdict = verdict_of(map_, flight);
    ASSERT_TRUE(verdict.is_verified) << "round " << round << ", step " << step_s << ", integrator "
                                     << static_cast<int>(integrator) << "\n"
                                     << list_of(verdict);
    // The closed form lies below the samples, by no more than half a sample distance may hide.
    EXPECT_LE(verdict.clearance_min_m, 10.5 + 1e-9);
    EXPECT_GE(verdict.clearance_min_m, 10.5 - 0.6);
  }
}

TEST_F(Verify, TakesTheHeightOfTheWholeFlightOffTheClearance) {
  for (const double by_m : {-3.0, -4.1, -8.0}) {
    flight::Trajectory lowered = flight_;
    test::lift(lowered, by_m);
    const flight::Verdict verdict = verdict_of(map_, lowered);
    EXPECT_NEAR(verdict.clearance_min_m, verdict_of(map_, flight_).clearance_min_m + by_m, 1e-9);
    EXPECT_EQ(verdict.is_verified, by_m == -3.0);
  }
}

TEST_F(Verify, FindsTheRidgeThatLiesBetweenTwoStates) {
  // Ridge of one row of half-metre cells across the path, 5 m high; states lie 2 m apart, the
  // nearest 1 m from its crest, where the surface is flat again.
  map::Map map = test::make_map(
      400, 400, 0.5, [](double, double y_m) { return std::fabs(y_m - 101.25) < 0.1 ? 5.0 : 0.0; });
  Manoeuvre manoeuvre;
  manoeuvre.x_m = 100.0;
  manoeuvre.y_m = 100.25;
  manoeuvre.altitude_m = 14.0;
  manoeuvre.duration_s = 2.0;
  const flight::Trajectory flight = fly(manoeuvre, map);
  for (const flight::FlightState& state : flight.states) {
    ASSERT_GE(state.altitude_m - state.surface_m, 14.0);
  }
  const flight::Verdict verdict = verdict_of(map, flight);
  EXPECT_NEAR(verdict.clearance_min_m, 9.0, 1e-6);
  EXPECT_NEAR(verdict.clearance_min_place.y_m, 101.25, 1e-6);
  expect_found(verdict, "clearance", 0.0, 0.05);
  EXPECT_EQ(verdict.violation_count, 1);
}

TEST_F(Verify, FindsASinkOfOneMetreBelowTheRequiredClearance) {
  // The whole flight clears by 10.5 m at its lowest; there it dips by 1 m within 4 s.
  const flight::Verdict before = verdict_of(map_, flight_);
  std::size_t lowest = 0;
  double least_m = 1e9;
  for (std::size_t i = 0; i < flight_.states.size(); ++i) {
    const double height_m = flight_.states[i].altitude_m - flight_.states[i].surface_m;
    if (height_m < least_m) {
      least_m = height_m;
      lowest = i;
    }
  }
  ASSERT_GT(lowest, 45U);
  ASSERT_LT(lowest + 45, flight_.states.size());
  flight::Trajectory dip = flight_;
  test::lift(dip, 10.5 - before.clearance_min_m);
  for (std::size_t i = lowest - 40; i <= lowest + 40; ++i) {
    // 1 m (1 + cos) / 2 over 4 s, with its rates: a smooth, flyable dip.
    const double angle = test::kPi * (static_cast<double>(i) - static_cast<double>(lowest)) / 40.0;
    const double rate_radps = test::kPi / 2.0;
    dip.states[i].altitude_m -= 0.5 * (1.0 + std::cos(angle));
    dip.states[i].climb_rate_mps += 0.5 * std::sin(angle) * rate_radps;
    dip.states[i].vertical_acceleration_mps2 += 0.5 * std::cos(angle) * rate_radps * rate_radps;
  }
  const double at_s = dip.states[lowest].time_s;
  const flight::Verdict verdict = verdict_of(map_, dip);
  EXPECT_NEAR(verdict.clearance_min_m, 9.5, 0.05);
  expect_found(verdict, "clearance", at_s - 1.0, at_s + 1.0, {"continuity_climb_rate"});
}

TEST_F(Verify, FindsATeleport) {
  expect_found(verdict_of(map_, changed(500, kEnd, [](auto& state) { state.x_m += 0.05; })),
               "continuity_position", 25.0, 25.0);
}

TEST_F(Verify, FindsSpeedWithoutMovement) {
  const flight::FlightState held = flight_.states[500];
  expect_found(verdict_of(map_, changed(501, 520,
                                        [&](auto& state) {
                                          state.x_m = held.x_m;
                                          state.y_m = held.y_m;
                                        })),
               "continuity_position", 25.05, 26.0);
}

TEST_F(Verify, FindsASpeedColumnThatIsTwoPercentWrong) {
  expect_found(verdict_of(map_, changed(0, kEnd, [](auto& state) { state.speed_mps *= 1.02; })),
               "continuity_position", 0.0, 60.0, {"continuity_heading"});
}

TEST_F(Verify, FindsAnAltitudeStepOfTwoCentimetres) {
  expect_found(verdict_of(map_, changed(700, kEnd, [](auto& state) { state.altitude_m += 0.02; })),
               "continuity_altitude", 35.0, 35.0);
}

TEST_F(Verify, FindsAClimbRateThatIsNotFlown) {
  expect_found(verdict_of(map_, changed(0, kEnd, [](auto& state) { state.climb_rate_mps += 0.1; })),
               "continuity_altitude", 0.0, 60.0);
}

TEST_F(Verify, FindsTheSignOfBankFlipped) {
  expect_found(verdict_of(map_, changed(0, kEnd,
                                        [](auto& state) {
                                          state.bank_rad = -state.bank_rad;
                                          state.roll_rate_radps = -state.roll_rate_radps;
                                        })),
               "continuity_heading", 0.0, 60.0);
}

TEST_F(Verify, FindsTheSignOfRollRateFlipped) {
  expect_found(
      verdict_of(
          map_,
          changed(0, kEnd, [](auto& state) { state.roll_rate_radps = -state.roll_rate_radps; })),
      "continuity_bank", 0.0, 60.0);
}

TEST_F(Verify, FindsAHeadingJumpOfATenthOfADegree) {
  expect_found(verdict_of(map_, changed(900, kEnd,
                                        [](auto& state) {
                                          state.heading_true_rad += 0.1 * test::kPi / 180.0;
                                        })),
               "continuity_heading", 45.0, 45.0, {"continuity_position"});
}

TEST_F(Verify, FindsHeadingsThatAreGridInsteadOfTrue) {
  expect_found(
      verdict_of(
          map_,
          changed(0, kEnd, [](auto& state) { state.heading_true_rad -= test::kConvergence_rad; })),
      "continuity_position", 0.0, 60.0);
}

TEST_F(Verify, FindsARollRateSpike) {
  expect_found(
      verdict_of(map_, changed(300, 301, [](auto& state) { state.roll_rate_radps = 0.9; })),
      "roll_rate", 15.0, 15.0, {"continuity_roll_rate", "continuity_bank"});
}

TEST_F(Verify, FindsARollRateSpikeWithinTheLimit) {
  const flight::Verdict verdict =
      verdict_of(map_, changed(1000, 1001, [](auto& state) { state.roll_rate_radps += 0.55; }));
  expect_found(verdict, "continuity_roll_rate", 50.0, 50.05);
}

TEST_F(Verify, FindsAPitchThatDoesNotFollowItsRate) {
  expect_found(verdict_of(map_, changed(300, kEnd, [](auto& state) { state.pitch_rad += 0.005; })),
               "continuity_pitch", 15.0, 15.0);
}

TEST_F(Verify, FindsASpeedJump) {
  const flight::Verdict verdict =
      verdict_of(map_, changed(1000, kEnd, [](auto& state) { state.speed_mps += 0.2; }));
  expect_found(verdict, "continuity_speed", 50.0, 50.0,
               {"continuity_position", "continuity_heading"});
}

TEST_F(Verify, FindsAWrongSurfaceColumn) {
  flight::Trajectory trajectory = flight_;
  trajectory.states[432].surface_m += 0.01;
  expect_found(verdict_of(map_, trajectory), "surface_column", 21.6, 21.6);
}

TEST_F(Verify, FindsAWrongTerrainColumn) {
  flight::Trajectory trajectory = flight_;
  trajectory.states[433].terrain_m -= 0.01;
  expect_found(verdict_of(map_, trajectory), "terrain_column", 21.65, 21.65);
}

TEST_F(Verify, FindsAMissingState) {
  flight::Trajectory trajectory = flight_;
  trajectory.states.erase(trajectory.states.begin() + 200);
  expect_found(verdict_of(map_, trajectory), "time_step", 10.05, 10.05,
               {"continuity_position", "continuity_altitude", "continuity_heading",
                "continuity_bank", "continuity_pitch", "continuity_climb_rate"});
}

TEST_F(Verify, FindsTimesThatDoNotBeginAtZero) {
  flight::Trajectory trajectory = flight_;
  for (flight::FlightState& state : trajectory.states) {
    state.time_s += 1.0;
  }
  expect_found(verdict_of(map_, trajectory), "time_step", 1.0, 1.0);
}

TEST_F(Verify, RefusesAStepThatSaysTooLittle) {
  const flight::Verdict verdict = verdict_of(map_, fly(varied_manoeuvre(), map_, 0.5));
  expect_found(verdict, "time_step", 0.0, 0.0);
}

TEST_F(Verify, FindsANanInEachColumn) {
  using Column = double flight::FlightState::*;
  using State = flight::FlightState;
  for (const Column column :
       {&State::time_s, &State::x_m, &State::y_m, &State::altitude_m, &State::speed_mps,
        &State::heading_true_rad, &State::convergence_rad, &State::bank_rad,
        &State::roll_rate_radps, &State::pitch_rad, &State::pitch_rate_radps,
        &State::climb_rate_mps, &State::vertical_acceleration_mps2, &State::target_heading_true_rad,
        &State::commanded_heading_true_rad, &State::commanded_climb_angle_rad,
        &State::commanded_speed_mps, &State::surface_m, &State::terrain_m}) {
    flight::Trajectory trajectory = flight_;
    trajectory.states[77].*column = kNan;
    const flight::Verdict verdict = verdict_of(map_, trajectory);
    EXPECT_FALSE(verdict.is_verified);
    ASSERT_EQ(verdict.violations.size(), 1U);
    EXPECT_EQ(verdict.violations[0].rule, "finite");
    trajectory.states[77].*column = std::numeric_limits<double>::infinity();
    EXPECT_FALSE(verdict_of(map_, trajectory).is_verified);
  }
}

TEST_F(Verify, FindsEachLimitThatIsBrokenByAThousandth) {
  const flight::Limits limits = test::test_limits();
  struct Case {
    const char* rule;
    std::function<void(flight::FlightState&)> change;
  };
  const std::vector<Case> cases = {
      {"bank", [&](auto& s) { s.bank_rad = -1.001 * limits.bank_max_rad; }},
      {"roll_rate", [&](auto& s) { s.roll_rate_radps = -1.001 * limits.roll_rate_max_radps; }},
      {"pitch", [&](auto& s) { s.pitch_rad = -1.001 * limits.pitch_max_rad; }},
      {"climb_rate", [&](auto& s) { s.climb_rate_mps = 1.001 * limits.climb_rate_max_mps; }},
      {"descent_rate", [&](auto& s) { s.climb_rate_mps = -1.001 * limits.descent_rate_max_mps; }},
      {"vertical_acceleration",
       [&](auto& s) {
         s.vertical_acceleration_mps2 = -1.001 * limits.vertical_acceleration_max_mps2;
       }},
      {"load_factor",
       [&](auto& s) {
         // sqrt((1 + a / g)^2 + tan^2 bank) with pitch 0, a thousandth above the limit.
         const double across = std::tan(s.bank_rad);
         s.pitch_rad = 0.0;
         s.vertical_acceleration_mps2 =
             test::kG_mps2 * (std::sqrt(1.5015 * 1.5015 - across * across) - 1.0);
       }},
      {"speed_max", [&](auto& s) { s.speed_mps = 1.001 * limits.speed_max_mps; }},
      {"speed_min", [&](auto& s) { s.speed_mps = 0.999 * limits.speed_min_mps; }},
  };
  for (const Case& planted : cases) {
    const flight::Verdict verdict = verdict_of(map_, changed(640, 641, planted.change));
    const flight::Violation* worst = worst_of(verdict, planted.rule);
    ASSERT_NE(worst, nullptr) << planted.rule;
    EXPECT_EQ(worst->time_s, flight_.states[640].time_s);
    EXPECT_EQ(worst->place.x_m, flight_.states[640].x_m);
  }
}

TEST_F(Verify, FindsAFlightThatClimbsTooSteeplyThroughout) {
  Manoeuvre manoeuvre = varied_manoeuvre();
  manoeuvre.climb_rate_mps = test::Schedule(0.0).ramp(5.0, 8.0, 8.5);
  const flight::Verdict verdict = verdict_of(map_, fly(manoeuvre, map_));
  expect_found(verdict, "climb_rate", 5.0, 60.0);
  EXPECT_NEAR(verdict.climb_rate_max_mps, 8.5, 1e-9);
}

TEST_F(Verify, FindsAGoalThatIsMissed) {
  flight::Waypoint goal = place_of(flight_.states.back());
  goal.x_m += 61.0;
  const flight::Verdict verdict = verify(map_, flight_, place_of(flight_.states.front()), {}, goal,
                                         test::test_limits(), test_demands());
  expect_found(verdict, "goal", 60.0, 60.0);
  EXPECT_NEAR(verdict.goal_distance_m, 61.0, 1e-9);
}

TEST_F(Verify, FindsAStartThatIsOffInPlaceOrAltitude) {
  const flight::Waypoint start = place_of(flight_.states.front());
  for (const flight::Waypoint& asked :
       {flight::Waypoint{start.x_m + 1.1, start.y_m, start.altitude_m},
        flight::Waypoint{start.x_m, start.y_m, start.altitude_m - 1.1}}) {
    expect_found(verify(map_, flight_, asked, {}, place_of(flight_.states.back()),
                        test::test_limits(), test_demands()),
                 "start", 0.0, 0.0);
  }
}

TEST_F(Verify, KnowsTheLoadFactorOfALevelTurnAndOfAPullUp) {
  flight::FlightState state;
  state.bank_rad = test::kPi / 3.0;
  EXPECT_NEAR(load_factor_of(state), 2.0, 1e-12);
  state.bank_rad = 0.0;
  state.vertical_acceleration_mps2 = 0.25 * test::kG_mps2;
  EXPECT_NEAR(load_factor_of(state), 1.25, 1e-12);
  state.pitch_rad = std::atan(0.75);
  EXPECT_NEAR(load_factor_of(state), std::hypot(1.25, 0.75), 1e-12);
}

TEST_F(Verify, WantsViaPointsPassedInTheirOrder) {
  // Straight to the north at 40 m/s: y = 1000 + 40 t.
  Manoeuvre manoeuvre;
  manoeuvre.x_m = 3000.0;
  manoeuvre.y_m = 1000.0;
  manoeuvre.altitude_m = 450.0;
  manoeuvre.duration_s = 60.0;
  const flight::Trajectory flight = fly(manoeuvre, map_);
  const auto via = [&](const std::vector<geo::MapPoint>& points) {
    return verify(map_, flight, place_of(flight.states.front()), points,
                  place_of(flight.states.back()), test::test_limits(), test_demands());
  };
  EXPECT_TRUE(via({{3249.0, 1500.0}, {2751.0, 2500.0}}).is_verified);
  EXPECT_TRUE(via({{3000.0, 1500.0}, {3000.0, 1500.0}, {3000.0, 1300.0}}).is_verified);
  // Missed by 251 m, passed after 12.5 s.
  const flight::Verdict missed = via({{3251.0, 1500.0}, {3000.0, 2500.0}});
  expect_found(missed, "via", 12.4, 12.5);
  EXPECT_NEAR(missed.violations[0].value, 251.0, 1e-6);
  EXPECT_EQ(missed.violation_count, 1);
  // In the wrong order: 1000 m back from where the first one is entered, 250 m before it.
  const flight::Verdict back = via({{3000.0, 2500.0}, {3000.0, 1500.0}});
  expect_found(back, "via", 31.2, 31.3);
  EXPECT_NEAR(back.violations[0].value, 750.0, 2.0);
}

TEST_F(Verify, FindsWhereTheFlightLeavesTheMap) {
  Manoeuvre manoeuvre;
  manoeuvre.x_m = 3000.0;
  manoeuvre.y_m = 5801.0;  // the map ends 199 m on: after 4.975 s at 40 m/s
  manoeuvre.altitude_m = 450.0;
  manoeuvre.duration_s = 6.0;
  flight::Trajectory trajectory = fly(manoeuvre, map_);
  for (flight::FlightState& state : trajectory.states) {
    if (std::isnan(state.surface_m)) {
      state.surface_m = 300.0;
      state.terrain_m = 300.0;
    }
  }
  const flight::Verdict verdict = verdict_of(map_, trajectory);
  EXPECT_FALSE(verdict.is_verified);
  double first_s = 1e9;
  for (const flight::Violation& violation : verdict.violations) {
    EXPECT_EQ(violation.rule, "outside_map");
    first_s = std::min(first_s, violation.time_s);
  }
  EXPECT_NEAR(first_s, 4.975, 1e-9);
}

TEST_F(Verify, FindsAFlightOverAVoidThatItsStatesJumpOver) {
  map::Map map = test::make_map(400, 400, 0.5, [](double, double) { return 0.0; });
  map.surface_m.at(200, 202) = std::numeric_limits<float>::quiet_NaN();
  map.terrain_m.at(200, 202) = std::numeric_limits<float>::quiet_NaN();
  test::finish_map(map);
  Manoeuvre manoeuvre;
  manoeuvre.x_m = 100.1;
  manoeuvre.y_m = 100.25;
  manoeuvre.altitude_m = 20.0;
  manoeuvre.duration_s = 2.0;
  const flight::Verdict verdict = verdict_of(map, fly(manoeuvre, map));
  expect_found(verdict, "unknown_surface", 0.0, 0.05);
}

TEST_F(Verify, FindsAPassThroughAWireWhereItIs) {
  map::Map map = test::make_map(kCells, kCells, kCell_m, [](double, double) { return 100.0; });
  map::OverheadLine line;
  line.supports = {{{2000.0, 3000.0}, 30.0}, {{2600.0, 3000.0}, 30.0}, {{3200.0, 3000.0}, 30.0}};
  map.overhead_lines = {line};
  test::finish_map(map);
  Manoeuvre manoeuvre;
  manoeuvre.x_m = 2300.0;
  manoeuvre.y_m = 2801.0;
  manoeuvre.duration_s = 10.0;
  // Crosses y = 3000 after 199 m, 4.975 s.
  for (const double altitude_m : {141.0, 139.0, 130.0, 115.0}) {
    manoeuvre.altitude_m = altitude_m;
    const flight::Trajectory flight = fly(manoeuvre, map);
    const flight::Verdict verdict = verdict_of(map, flight);
    if (altitude_m > 140.0) {
      EXPECT_TRUE(verdict.is_verified) << list_of(verdict);
      continue;
    }
    expect_found(verdict, "wire_clearance", 4.9, 5.0);
    EXPECT_NEAR(worst_of(verdict, "wire_clearance")->value, std::max(altitude_m - 130.0, 0.0),
                1e-6);
  }
}

TEST_F(Verify, FindsAMastThatTheInterpolatedSurfaceLoses) {
  // GIVEN a mast of 60 m between four cell centres of a flat map whose surface knows nothing of it
  map::Map map = test::make_map(kCells, kCells, kCell_m, [](double, double) { return 100.0; });
  map::Obstacle mast;
  mast.kind = map::ObstacleKind::kMast;
  mast.point = {2300.0, 3000.0};
  mast.radius_m = 12.0;
  mast.height_m = 60.0;
  mast.top_m = 160.0;
  map.obstacles = {mast};
  test::finish_map(map);
  Manoeuvre manoeuvre;
  manoeuvre.y_m = 2801.0;
  manoeuvre.duration_s = 10.0;
  // WHEN a flight to the north passes it at different distances and heights
  struct Pass {
    double x_m, altitude_m, clear_m;
  };
  for (const Pass& pass :
       {Pass{2300.0, 130.0, 0.0}, Pass{2320.0, 130.0, 8.0}, Pass{2323.0, 130.0, 11.0},
        Pass{2305.0, 165.0, 5.0}, Pass{2305.0, 171.0, 11.0}, Pass{2318.0, 168.0, 10.0}}) {
    manoeuvre.x_m = pass.x_m;
    manoeuvre.altitude_m = pass.altitude_m;
    const flight::Verdict verdict = verdict_of(map, fly(manoeuvre, map));
    // THEN it is found where less than the required 10 m are left, at y = 3000 after 4.975 s
    if (pass.clear_m > 10.0) {
      EXPECT_TRUE(verdict.is_verified) << list_of(verdict);
    } else if (pass.clear_m < 10.0) {
      expect_found(verdict, "obstacle_clearance", 4.6, 5.3);
      EXPECT_NEAR(worst_of(verdict, "obstacle_clearance")->value, pass.clear_m, 1e-3);
    }
  }
  // AND one of unknown height is a barrier
  map.obstacles[0].top_m = kNan;
  map.obstacles[0].height_m = kNan;
  manoeuvre.x_m = 2300.0;
  manoeuvre.altitude_m = 400.0;
  expect_found(verdict_of(map, fly(manoeuvre, map)), "obstacle_clearance", 4.6, 5.3);
}

TEST_F(Verify, FindsAnAreaThatIsEnteredBetweenItsLimits) {
  map::Map map = test::make_map(kCells, kCells, kCell_m,
                                [](double x_m, double) { return 100.0 + 0.02 * x_m; });
  map::Area area;
  area.name = "R 1";
  const double infinity = std::numeric_limits<double>::infinity();
  using Reference = map::AreaLimit::Reference;
  area.polygons = {{{{2000, 3000}, {2600, 3000}, {2600, 3200}, {2000, 3200}, {2000, 3000}}, {}}};
  Manoeuvre manoeuvre;
  manoeuvre.y_m = 2801.0;
  manoeuvre.duration_s = 10.0;  // crosses y = 3000 after 4.975 s and 3200 after 9.975 s
  const auto verdict_with = [&](map::AreaLimit floor, map::AreaLimit ceiling, double x_m,
                                double altitude_m, bool is_hard = true) {
    area.floor = floor;
    area.ceiling = ceiling;
    area.is_hard = is_hard;
    map.areas = {area};
    test::finish_map(map);
    manoeuvre.x_m = x_m;
    manoeuvre.altitude_m = altitude_m;
    return verdict_of(map, fly(manoeuvre, map));
  };
  const map::AreaLimit ground{-infinity, Reference::kAboveGround};
  const map::AreaLimit no_end{infinity, Reference::kAmsl};
  // The ground at x = 2300 lies at 146 m.
  expect_found(verdict_with(ground, no_end, 2300.0, 200.0), "no_fly_area", 4.9, 10.1);
  expect_found(verdict_with({190.0, Reference::kAmsl}, no_end, 2300.0, 200.0), "no_fly_area", 4.9,
               10.1);
  expect_found(
      verdict_with({50.0, Reference::kAboveGround}, {60.0, Reference::kAboveGround}, 2300.0, 200.0),
      "no_fly_area", 4.9, 10.1);
  // 100 m inside the western and eastern edges at the middle of the crossing, at most.
  EXPECT_NEAR(worst_of(verdict_with(ground, no_end, 2300.0, 200.0), "no_fly_area")->value, -100.0,
              1.5);
  for (const auto& verdict :
       {verdict_with({201.0, Reference::kAmsl}, no_end, 2300.0, 200.0),
        verdict_with(ground, {199.0, Reference::kAmsl}, 2300.0, 200.0),
        verdict_with({56.0, Reference::kAboveGround}, no_end, 2300.0, 200.0),
        verdict_with(ground, {52.0, Reference::kAboveGround}, 2300.0, 200.0),
        verdict_with(ground, no_end, 1999.0, 200.0), verdict_with(ground, no_end, 2601.0, 200.0),
        verdict_with(ground, no_end, 2300.0, 200.0, false)}) {
    EXPECT_TRUE(verdict.is_verified) << list_of(verdict);
  }
  // A corner cut by centimetres, between two states.
  area.polygons = {
      {{{2299.98, 3000}, {2600, 3000}, {2600, 3000.5}, {2299.98, 3000.5}, {2299.98, 3000}}, {}}};
  EXPECT_NE(worst_of(verdict_with(ground, no_end, 2300.0, 200.0), "no_fly_area"), nullptr);
  // Flown through a hole.
  area.polygons = {{{{2000, 2000}, {2600, 2000}, {2600, 4000}, {2000, 4000}, {2000, 2000}},
                    {{{2250, 2100}, {2350, 2100}, {2350, 3900}, {2250, 3900}, {2250, 2100}}}}};
  EXPECT_TRUE(verdict_with(ground, no_end, 2300.0, 200.0).is_verified);
  EXPECT_FALSE(verdict_with(ground, no_end, 2240.0, 200.0).is_verified);
}

TEST_F(Verify, TakesAWireOfUnknownHeightForABarrier) {
  map::Map map = test::make_map(kCells, kCells, kCell_m, [](double, double) { return 100.0; });
  map::OverheadLine line;
  line.supports = {{{2000.0, 3000.0}, kNan}, {{2600.0, 3000.0}, 30.0}};
  map.overhead_lines = {line};
  test::finish_map(map);
  Manoeuvre manoeuvre;
  manoeuvre.x_m = 2300.0;
  manoeuvre.y_m = 2801.0;
  manoeuvre.altitude_m = 400.0;
  manoeuvre.duration_s = 10.0;
  expect_found(verdict_of(map, fly(manoeuvre, map)), "wire_clearance", 4.9, 5.0);
}

TEST_F(Verify, MeasuresTheShareUnderTheCeilingByLength) {
  const map::Map map = test::make_map(kCells, kCells, kCell_m, [](double, double) { return 0.0; });
  Manoeuvre manoeuvre;
  manoeuvre.x_m = 1000.0;
  manoeuvre.y_m = 1000.0;
  manoeuvre.altitude_m = 100.0;
  manoeuvre.duration_s = 40.0;
  // Climbs steadily at 1 m/s from the start: 120 m is reached after 20 of 40 s.
  manoeuvre.climb_rate_mps = test::Schedule(1.0);
  Demands demands = test_demands();
  EXPECT_NEAR(verdict_of(map, fly(manoeuvre, map), demands).share_under_ceiling, 0.5, 1e-9);
  EXPECT_TRUE(verdict_of(map, fly(manoeuvre, map), demands).is_verified);
  demands.share_under_ceiling_min = 0.51;
  expect_found(verdict_of(map, fly(manoeuvre, map), demands), "share_under_ceiling", 40.0, 40.0);
}

TEST_F(Verify, RefusesATrajectoryWithoutAStep) {
  flight::Trajectory trajectory = flight_;
  trajectory.states.resize(1);
  EXPECT_FALSE(verdict_of(map_, trajectory).is_verified);
  trajectory.states.clear();
  const flight::Verdict verdict =
      verify(map_, trajectory, {}, {}, {}, test::test_limits(), test_demands());
  EXPECT_FALSE(verdict.is_verified);
  EXPECT_EQ(verdict.violations[0].rule, "states");
}

TEST_F(Verify, KeepsTheWorstOfEachRuleWhenThereAreThousands) {
  flight::Trajectory trajectory = flight_;
  for (std::size_t i = 0; i < trajectory.states.size(); ++i) {
    trajectory.states[i].surface_m += 1.0 + static_cast<double>(i);
    trajectory.states[i].terrain_m += 1.0;
  }
  trajectory.states[5].vertical_acceleration_mps2 = 9.0;
  const flight::Verdict verdict = verdict_of(map_, trajectory);
  EXPECT_GT(verdict.violation_count, 2000);
  EXPECT_EQ(verdict.violations.size(), 100U);
  EXPECT_NE(worst_of(verdict, "terrain_column"), nullptr);
  EXPECT_NE(worst_of(verdict, "vertical_acceleration"), nullptr);
  const flight::Violation* worst = worst_of(verdict, "surface_column");
  ASSERT_NE(worst, nullptr);
  double greatest = 0.0;
  for (const flight::FlightState& state : trajectory.states) {
    const double true_m = raster::sample_bilinear(map_.surface_m, state.point());
    greatest = std::max(greatest, std::fabs(state.surface_m - true_m) / true_m);
  }
  EXPECT_NEAR(std::fabs(worst->value - worst->limit) / worst->limit, greatest, 1e-9);
  EXPECT_TRUE(std::is_sorted(verdict.violations.begin(), verdict.violations.end(),
                             [](const auto& a, const auto& b) { return a.rule < b.rule; }));
}

TEST_F(Verify, DoesNotStumbleOverAbsurdNumbers) {
  for (const double absurd : {1e300, -1e300, 1e18, -1e9}) {
    using Column = double flight::FlightState::*;
    for (const Column column :
         {&flight::FlightState::x_m, &flight::FlightState::y_m, &flight::FlightState::altitude_m,
          &flight::FlightState::speed_mps, &flight::FlightState::heading_true_rad,
          &flight::FlightState::time_s, &flight::FlightState::bank_rad}) {
      flight::Trajectory trajectory = flight_;
      trajectory.states[100].*column = absurd;
      EXPECT_FALSE(verdict_of(map_, trajectory).is_verified);
    }
  }
}

// Flies the command model under commands that jump about, as a planner's would at worst.
flight::Trajectory flown_at_random(const map::Map& map, const command_model::CommandModel& model,
                                   std::mt19937_64& random, double step_s) {
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  command_model::ModelState state = command_model::trimmed_state(
      3000.0, 3000.0, 500.0, uniform(20.0, 60.0), uniform(-3.0, 3.0), uniform(-5.0, 5.0));
  command_model::Command command;
  flight::Trajectory trajectory;
  trajectory.step_s = step_s;
  double next_change_s = 0.0;
  for (int i = 0; i * step_s <= 40.0; ++i) {
    if (i * step_s >= next_change_s) {
      command = {uniform(10.0, 70.0), uniform(-3.1, 3.1), uniform(-12.0, 12.0)};
      next_change_s += uniform(0.05, 8.0);
    }
    flight::FlightState flown;
    flown.time_s = i * step_s;
    flown.x_m = state.x_m;
    flown.y_m = state.y_m;
    flown.altitude_m = state.altitude_m;
    flown.speed_mps = state.speed_mps;
    const double azimuth_rad = 0.5 * test::kPi - state.heading_math_rad;
    flown.heading_true_rad =
        azimuth_rad - 2.0 * test::kPi * std::floor(azimuth_rad / 2.0 / test::kPi);
    flown.bank_rad = -state.bank_left_rad;
    flown.roll_rate_radps = -state.roll_rate_left_radps;
    flown.pitch_rad = state.pitch_rad;
    flown.pitch_rate_radps = state.pitch_rate_radps;
    flown.climb_rate_mps = state.climb_rate_mps;
    flown.vertical_acceleration_mps2 = state.vertical_acceleration_mps2;
    flown.surface_m = raster::sample_bilinear(map.surface_m, flown.point());
    flown.terrain_m = raster::sample_bilinear(map.terrain_m, flown.point());
    trajectory.states.push_back(flown);
    state = model.step(state, command, step_s);
  }
  return trajectory;
}

TEST_F(Verify, HasNothingToSayAgainstTheCommandModel) {
  std::mt19937_64 random(test::fresh_seed());
  ConfigReader file =
      ConfigReader::from_text(shipped_config("vehicles/ec135.yaml"), "vehicles/ec135.yaml");
  const command_model::Vehicle vehicle = command_model::read_vehicle(file);
  const command_model::CommandModel model(vehicle);
  for (int round = 0; round < 60; ++round) {
    flight::Trajectory flight =
        flown_at_random(map_, model, random, std::vector<double>{0.02, 0.05, 0.1}[random() % 3]);
    test::lift(flight, 12.0 - sampled_clearance_m(map_, flight, 0.5));
    const flight::Verdict verdict =
        verify(map_, flight, place_of(flight.states.front()), {}, place_of(flight.states.back()),
               vehicle.limits, test_demands());
    ASSERT_TRUE(verdict.is_verified) << "round " << round << "\n" << list_of(verdict);
  }
}

TEST(ReadDemands, ReadsTheShippedConfigAndRefusesNonsense) {
  ConfigReader shipped = ConfigReader::from_text(shipped_config("planning.yaml"), "planning.yaml")
                             .required_section("verification");
  const Demands demands = read_demands(shipped);
  EXPECT_GT(demands.required_clearance_m, 0.0);
  ConfigReader bad = ConfigReader::from_text(
      "{required_clearance_m: 10, ceiling_height_m: 5, share_under_ceiling_min: 0, "
      "goal_radius_m: 60, start_radius_m: 1, via_radius_m: 250}",
      "bad.yaml");
  EXPECT_THROW(read_demands(bad), ConfigError);
}

// A flight through the air, carried along: what a plan made in wind says of itself.
flight::Trajectory carried(flight::Trajectory trajectory, const flight::Wind& wind,
                           const map::Map& map) {
  for (flight::FlightState& state : trajectory.states) {
    const double azimuth_rad = state.heading_true_rad - state.convergence_rad;
    const double east_mps = state.speed_mps * std::sin(azimuth_rad) + wind.east_mps;
    const double north_mps = state.speed_mps * std::cos(azimuth_rad) + wind.north_mps;
    state.x_m += wind.east_mps * state.time_s;
    state.y_m += wind.north_mps * state.time_s;
    state.speed_mps = std::hypot(east_mps, north_mps);
    const double true_rad = std::atan2(east_mps, north_mps) + state.convergence_rad;
    state.heading_true_rad = true_rad - 2.0 * test::kPi * std::floor(true_rad / (2.0 * test::kPi));
    state.surface_m = raster::sample_bilinear(map.surface_m, state.point());
    state.terrain_m = raster::sample_bilinear(map.terrain_m, state.point());
  }
  return trajectory;
}

TEST(VerifierInWind, AFlightThatTheWindCarriesAlongIsVerifiedInThatWindAlone) {
  const map::Map map = test::make_map(kCells, kCells, kCell_m, [](double, double) { return 0.0; });
  const std::uint64_t seed = test::fresh_seed();
  std::mt19937_64 random(seed);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  int refused = 0;
  for (int i = 0; i < 30; ++i) {
    Manoeuvre manoeuvre = test::random_manoeuvre(random, test::test_limits());
    manoeuvre.x_m = manoeuvre.y_m = 3000.0;
    manoeuvre.altitude_m = 400.0;
    const double to_rad = uniform(0.0, 6.28);
    const flight::Wind wind{12.0 * std::cos(to_rad), 12.0 * std::sin(to_rad)};
    const flight::Trajectory flown = carried(fly(manoeuvre, map), wind, map);
    Demands demands = test_demands();
    demands.share_under_ceiling_min = 0.0;
    refused += verdict_of(map, flown, demands).is_verified ? 0 : 1;
    demands.wind = wind;
    const flight::Verdict verdict = verdict_of(map, flown, demands);
    EXPECT_TRUE(verdict.is_verified) << seed << ": " << list_of(verdict);
    EXPECT_GE(verdict.speed_min_mps, test::test_limits().speed_min_mps * (1.0 - 1e-9));
  }
  EXPECT_EQ(refused, 30) << seed;
}

// The same circle over the ground of 330 m radius, flown at an airspeed of 40 m/s: without wind it
// takes atan(40^2 / (330 g)) = 26.3 degrees of bank. With 10 m/s the speed over ground is 50 m/s
// where the wind is behind, and 37.7 degrees are needed there, 30 are allowed.
flight::Trajectory circled(double wind_mps, const map::Map& map) {
  constexpr double kRadius_m = 330.0;
  flight::Trajectory trajectory;
  trajectory.step_s = 0.05;
  double angle_rad = 0.0;                     // of the place, from the middle, counter-clockwise
  const auto speed_at = [&](double at_rad) {  // course at_rad + 90 degrees, wind to the north
    const double along = wind_mps * std::cos(at_rad);
    const double across = wind_mps * std::sin(at_rad);
    return along + std::sqrt(1600.0 - across * across);
  };
  const auto bank_at = [&](double at_rad) {
    const double speed = speed_at(at_rad);
    const double cos_crab = std::sqrt(1.0 - std::pow(wind_mps * std::sin(at_rad) / 40.0, 2.0));
    return -std::atan(speed * speed / (kRadius_m * test::kG_mps2 * cos_crab));  // left
  };
  for (int i = 0; i <= 600; ++i) {
    flight::FlightState state;
    state.time_s = 0.05 * i;
    state.x_m = 3000.0 + kRadius_m * std::cos(angle_rad);
    state.y_m = 3000.0 + kRadius_m * std::sin(angle_rad);
    state.altitude_m = 50.0;
    state.speed_mps = speed_at(angle_rad);
    const double azimuth_rad = -angle_rad;  // of the course angle_rad + 90 degrees
    state.heading_true_rad =
        azimuth_rad - 2.0 * test::kPi * std::floor(azimuth_rad / (2.0 * test::kPi));
    state.bank_rad = bank_at(angle_rad);
    state.roll_rate_radps = (bank_at(angle_rad + 1e-5) - bank_at(angle_rad - 1e-5)) / 2e-5 *
                            state.speed_mps / kRadius_m;
    state.surface_m = state.terrain_m = raster::sample_bilinear(map.surface_m, state.point());
    trajectory.states.push_back(state);
    for (int k = 0; k < 50; ++k) {
      angle_rad +=
          0.001 * speed_at(angle_rad + 0.0005 * speed_at(angle_rad) / kRadius_m) / kRadius_m;
    }
  }
  return trajectory;
}

TEST(VerifierInWind, ATurnThatIsTooSteepOnlyBecauseOfTheWindIsFound) {
  const map::Map map = test::make_map(kCells, kCells, kCell_m, [](double, double) { return 0.0; });
  const flight::Verdict calm = verdict_of(map, circled(0.0, map));
  EXPECT_TRUE(calm.is_verified) << list_of(calm);

  Demands demands = test_demands();
  demands.wind = {0.0, 10.0};
  const flight::Trajectory honest = circled(10.0, map);
  const flight::Verdict steep = verdict_of(map, honest, demands);
  ASSERT_FALSE(steep.is_verified);
  for (const flight::Violation& violation : steep.violations) {
    EXPECT_THAT(violation.rule, ::testing::AnyOf("bank", "load_factor"));
  }
  EXPECT_NEAR(steep.bank_max_rad, std::atan(50.0 * 50.0 / (330.0 * test::kG_mps2)), 1e-3);

  // The same flight that claims the bank of calm air turns more than that bank turns it.
  flight::Trajectory claimed = honest;
  for (flight::FlightState& state : claimed.states) {
    state.bank_rad = calm.bank_max_rad * -1.0;
    state.roll_rate_radps = 0.0;
  }
  const flight::Verdict found = verdict_of(map, claimed, demands);
  ASSERT_FALSE(found.is_verified);
  EXPECT_EQ(found.violations.front().rule, "continuity_heading");
}

}  // namespace
}  // namespace hedgehop::verification
