#include "planning/timetable.hpp"

#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>

#include "base/errors.hpp"
#include "support/fresh_seed.hpp"
#include "support/utm_map.hpp"

namespace hedgehop::planning {
namespace {

using ::testing::HasSubstr;

constexpr Time kSix{1'777'615'200'000'000};

// Straight to the east, with a via point after each of these lengths but the last; the flight takes
// its length over its speed, and a flat share more.
class StraightFlights {
 public:
  explicit StraightFlights(std::vector<double> lengths_m, double slower = 1.0)
      : lengths_m_(std::move(lengths_m)), slower_(slower) {}

  std::variant<flight::Plan, flight::NoPlan> operator()(std::optional<double> speed_mps) {
    ++flights_;
    const geo::MapProjection projection("EPSG:32632");
    flight::Plan plan;
    plan.route_plan.map.crs_wkt = projection.wkt();
    plan.route_plan.request.speed_mps = speed_mps;
    const double flown_mps = speed_mps.value_or(config_.speed_mps) / slower_;
    double length_m = 0.0;
    for (const double piece_m : lengths_m_) {
      length_m += piece_m;
      plan.route_plan.request.via.push_back(
          {projection.to_geodetic({test::kUtmWest_m + length_m, test::kUtmSouth_m}), {}});
    }
    plan.route_plan.request.via.pop_back();
    plan.trajectory.step_s = 0.05;
    const auto steps = static_cast<std::int64_t>(std::lround(length_m / flown_mps / 0.05));
    for (std::int64_t i = 0; i <= steps; ++i) {
      flight::FlightState state;
      state.time_s = 0.05 * static_cast<double>(i);
      state.x_m = test::kUtmWest_m + flown_mps * state.time_s;
      state.y_m = test::kUtmSouth_m;
      plan.trajectory.states.push_back(state);
    }
    return plan;
  }
  [[nodiscard]] int flights() const { return flights_; }
  [[nodiscard]] const PlanningConfig& config() const { return config_; }

  TimedPlan timed(const TimeDemand& demand) {
    return std::get<TimedPlan>(
        plan_on_time(demand, config_, [this](std::optional<double> v) { return (*this)(v); }));
  }

 private:
  std::vector<double> lengths_m_;
  double slower_;
  int flights_ = 0;
  PlanningConfig config_ = read_planning_config(effective_planning_config("", {}), "test");
};

double after_six_s(Time time) { return seconds_between(kSix, time); }

TEST(PlanOnTime, OneTimeKeepsTheSpeedAndFixesTheDeparture) {
  StraightFlights flights({4000.0, 8000.0});
  const TimedPlan goal = flights.timed({{{2, kSix}}, 1.0});
  EXPECT_TRUE(goal.is_met);
  EXPECT_EQ(flights.flights(), 1);
  ASSERT_EQ(goal.plan.timetable->entries.size(), 3U);
  EXPECT_NEAR(after_six_s(goal.plan.timetable->entries[0].expected), -300.0,
              0.06);  // 12 km, 40 m/s
  EXPECT_NEAR(after_six_s(goal.plan.timetable->entries[1].expected), -200.0, 0.06);
  EXPECT_EQ(goal.plan.timetable->entries[2].expected, kSix);
  EXPECT_EQ(goal.plan.timetable->entries[2].wanted, kSix);
  EXPECT_FALSE(goal.plan.timetable->entries[1].wanted);

  const TimedPlan via = flights.timed({{{1, kSix}}, 1.0});
  EXPECT_NEAR(after_six_s(via.plan.timetable->entries[2].expected), 200.0, 0.06);
}

TEST(PlanOnTime, TwoTimesFixTheSpeedWhateverTheFlightTakes) {
  std::mt19937_64 generator(test::fresh_seed());
  std::uniform_real_distribution<double> speed(18.0, 58.0);
  std::uniform_real_distribution<double> slower(1.0, 1.05);
  for (int i = 0; i < 20; ++i) {
    const double wanted_mps = speed(generator);
    StraightFlights flights({3000.0, 9000.0, 2000.0}, slower(generator));
    const TimedPlan plan = flights.timed({{{1, kSix}, {3, kSix + 11000.0 / wanted_mps}}, 1.0});
    EXPECT_TRUE(plan.is_met) << plan.shortfall;
    EXPECT_LE(plan.plan.timetable->greatest_error_s(), 0.5);
    EXPECT_LE(plan.rounds, 4);
    EXPECT_NEAR(after_six_s(plan.plan.timetable->entries[3].expected), 11000.0 / wanted_mps, 0.6);
  }
}

TEST(PlanOnTime, SaysHowMuchTheVehicleLacks) {
  StraightFlights flights({12000.0});
  const double fastest_mps = flights.config().vehicle.limits.speed_max_mps;
  const TimedPlan late = flights.timed({{{0, kSix}, {1, kSix + 100.0}}, 2.0});
  EXPECT_FALSE(late.is_met);
  EXPECT_EQ(late.plan.route_plan.request.speed_mps, fastest_mps);
  EXPECT_THAT(late.shortfall, HasSubstr("they leave 100.0 s"));
  EXPECT_THAT(late.shortfall, HasSubstr("the vehicle flies no faster"));
  // what is missing is split: late at the goal by as much as early at the start
  const auto& entries = late.plan.timetable->entries;
  EXPECT_NEAR(after_six_s(entries[0].expected), -(12000.0 / fastest_mps - 100.0) / 2.0, 0.1);
  EXPECT_NEAR(seconds_between(kSix + 100.0, entries[1].expected),
              (12000.0 / fastest_mps - 100.0) / 2.0, 0.1);
  const TimedPlan early = flights.timed({{{0, kSix}, {1, kSix + 3000.0}}, 2.0});
  EXPECT_FALSE(early.is_met);
  EXPECT_THAT(early.shortfall, HasSubstr("the vehicle flies no slower"));
}

TEST(PlanOnTime, ThreeTimesAreKeptOnlyIfOneSpeedFitsThemAll) {
  StraightFlights flights({6000.0, 6000.0});
  EXPECT_TRUE(flights.timed({{{0, kSix}, {1, kSix + 200.0}, {2, kSix + 401.0}}, 2.0}).is_met);
  const TimedPlan uneven = flights.timed({{{0, kSix}, {1, kSix + 150.0}, {2, kSix + 400.0}}, 2.0});
  EXPECT_FALSE(uneven.is_met);
  EXPECT_THAT(uneven.shortfall, HasSubstr("a flight has one speed"));
  // half of 200 - 150 s, split between the via point and the ends
  EXPECT_NEAR(uneven.plan.timetable->greatest_error_s(), 25.0, 1.0);
}

TEST(PlanOnTime, TimesThatDoNotGrowAreRefusedAndNoPlanIsPassedOn) {
  StraightFlights flights({6000.0});
  EXPECT_THROW((void)flights.timed({{{0, kSix}, {1, kSix}}, 2.0}), UsageError);
  EXPECT_THROW((void)flights.timed({{{0, kSix}, {1, kSix + 90000.0}}, 2.0}), UsageError);
  EXPECT_EQ(flights.flights(), 0);
  const auto none = plan_on_time({{{1, kSix}}, 2.0}, flights.config(), [](std::optional<double>) {
    return flight::NoPlan{flight::NoPlanCause::kClimbLimit, std::nullopt, "too steep"};
  });
  EXPECT_EQ(std::get<flight::NoPlan>(none).cause, flight::NoPlanCause::kClimbLimit);
}

}  // namespace
}  // namespace hedgehop::planning
