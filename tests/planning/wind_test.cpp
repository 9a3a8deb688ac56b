#include <cmath>
#include <cstring>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <memory>
#include <numbers>

#include "base/errors.hpp"
#include "base/shipped_config.hpp"
#include "command_model/path_flight.hpp"
#include "output/plan_bundle.hpp"
#include "planning/planning.hpp"
#include "support/test_map.hpp"
#include "support/utm_map.hpp"
#include "verification/plan_check.hpp"

namespace hedgehop::planning {
namespace {

using ::testing::HasSubstr;

PlanningConfig config_with(const std::vector<std::string>& settings) {
  return read_planning_config(effective_planning_config("", settings), "test");
}

std::vector<std::string> wind(double speed_mps, double from_deg) {
  return {"global.work_budget=60000", "conditions.wind_mps=" + std::to_string(speed_mps),
          "conditions.wind_from_deg=" + std::to_string(from_deg)};
}

class PlanInWind : public ::testing::Test {
 protected:
  PlanInWind() {
    map_ = test::make_map(600, 400, 30.0, [](double x_m, double y_m) {
      return 400.0 + 40.0 * std::sin(x_m / 600.0) + 40.0 * std::cos(y_m / 500.0);
    });
    test::place_in_utm(map_);
    map_.visibility = raster::Grid<std::uint16_t>(map_.geometry, test::stored_visibility(0.1));
    test::finish_map(map_);
    request_.start = place(3000.0, 3000.0);
    request_.goal = place(14000.0, 9000.0);
  }
  flight::RequestPoint place(double east_m, double north_m) const {
    const geo::MapProjection projection(map_.crs_wkt);
    return {projection.to_geodetic({test::kUtmWest_m + east_m, test::kUtmSouth_m + north_m}), {}};
  }
  flight::Plan planned(const std::vector<std::string>& settings) const {
    SilentObserver observer;
    auto result = plan(map_, request_, config_with(settings), {}, observer);
    const auto* none = std::get_if<flight::NoPlan>(&result);
    EXPECT_EQ(none, nullptr) << (none == nullptr ? "" : none->explanation);
    return none == nullptr ? std::get<flight::Plan>(std::move(result)) : flight::Plan{};
  }

  map::Map map_;
  flight::PlanRequest request_;
};

TEST_F(PlanInWind, NoWindFromAnyDirectionGivesTheSameBytes) {
  const flight::Plan one = planned(wind(0.0, 0.0));
  const flight::Plan other = planned(wind(0.0, 217.0));
  ASSERT_EQ(one.trajectory.states.size(), other.trajectory.states.size());
  static_assert(std::is_trivially_copyable_v<flight::FlightState>);
  EXPECT_EQ(std::memcmp(one.trajectory.states.data(), other.trajectory.states.data(),
                        one.trajectory.states.size() * sizeof(flight::FlightState)),
            0);
  EXPECT_EQ(one.route_plan.route.waypoints, other.route_plan.route.waypoints);
}

TEST_F(PlanInWind, FlightsIn15MetresASecondFromAllSidesVerifyAndTakeTheTimeThatTheWindLeaves) {
  double headwind_s = 0.0;
  double tailwind_s = 0.0;
  for (const double from_deg : {61.0, 151.0, 241.0, 331.0}) {
    const std::vector<std::string> settings = wind(15.0, from_deg);
    const flight::Plan plan = planned(settings);
    EXPECT_TRUE(plan.verdict.is_verified)
        << from_deg << ' '
        << (plan.verdict.violations.empty() ? "" : plan.verdict.violations.front().rule);
    EXPECT_TRUE(plan.warnings.empty()) << from_deg << ' ' << plan.warnings.front();
    // The verifier, from the plan's own config.
    const PlanningConfig config = config_with(settings);
    const flight::Wind here =
        in_wind(config, map_.crs_wkt, plan.route_plan.start.point()).vehicle.wind;
    EXPECT_NEAR(plan.verdict.speed_max_mps, 40.0, 1.0);
    EXPECT_GT(plan.verdict.speed_min_mps, 29.9);
    double steps_m = 0.0;
    for (std::size_t i = 1; i < plan.trajectory.states.size(); ++i) {
      steps_m += std::hypot(plan.trajectory.states[i].x_m - plan.trajectory.states[i - 1].x_m,
                            plan.trajectory.states[i].y_m - plan.trajectory.states[i - 1].y_m);
    }
    EXPECT_NEAR(plan.measures.length_m / steps_m, 1.0, 1e-4);
    EXPECT_NEAR(here.speed_mps(), 15.0, 1e-9);
    if (from_deg == 61.0) {
      headwind_s = plan.measures.duration_s;
    } else if (from_deg == 241.0) {
      tailwind_s = plan.measures.duration_s;
    }
  }
  // The way runs towards 61 degrees: 25 m/s against the wind, 55 with it.
  EXPECT_GT(headwind_s, 1.8 * tailwind_s);
}

TEST_F(PlanInWind, AnotherWindThanThePlanSaysIsFoundByTheVerifier) {
  request_.start_heading_true_rad = 2.6;  // so that the flight turns
  flight::Plan plan = planned(wind(12.0, 90.0));
  const auto judged = [&] {
    return verification::check_plan(map_, plan, output::trajectory_csv(plan)).verdict;
  };
  EXPECT_TRUE(judged().is_verified) << judged().violations.front().rule;
  const std::size_t at = plan.route_plan.config_text.find("wind_mps: 12");
  ASSERT_NE(at, std::string::npos);
  plan.route_plan.config_text.replace(at, 12, "wind_mps: 2");
  const flight::Verdict found = judged();
  EXPECT_FALSE(found.is_verified);
  std::string rules;
  for (const flight::Violation& violation : found.violations) {
    rules += violation.rule + " ";
  }
  EXPECT_THAT(rules, HasSubstr("continuity_heading"));
}

TEST_F(PlanInWind, BothPlantsFlyAPlanMadeForTheWindInItWithinTheMarginsOfCalmAir) {
  const std::vector<std::string> settings = wind(10.0, 130.0);
  const flight::Plan plan = planned(settings);
  const PlanningConfig config =
      in_wind(config_with(settings), map_.crs_wkt, plan.route_plan.start.point());
  ConfigReader rotor_file =
      ConfigReader::from_text(shipped_config("rotor_plant.yaml"), "rotor_plant.yaml");
  ConfigReader service =
      ConfigReader::from_text(shipped_config("command_model.yaml"), "command_model.yaml");
  ConfigReader section = service.required_section("path_following");
  const command_model::FollowerOptions follower = command_model::read_follower_options(section);
  const std::vector<command_model::Plant> plants = {
      std::make_shared<const command_model::CommandModel>(config.vehicle),
      std::make_shared<const command_model::RotorPlant>(
          command_model::read_rotor_parameters(rotor_file))};
  for (const command_model::Plant& plant : plants) {
    const command_model::PathFlight flight = command_model::flown_path(
        plan.trajectory, plant, follower, true, config.vehicle.wind, config.vehicle.wind);
    EXPECT_TRUE(flight.has_arrived()) << plant.index();
    EXPECT_LT(flight.record().horizontal_max_m, 4.0) << plant.index();
    EXPECT_LT(flight.record().below_max_m, 2.0) << plant.index();
    EXPECT_LT(flight.record().above_max_m, 2.0) << plant.index();
    // At the airspeed of the plan, so as long as the plan.
    EXPECT_NEAR(
        static_cast<double>(flight.steps()) / static_cast<double>(plan.trajectory.states.size()),
        1.0, 0.01)
        << plant.index();
  }
}

TEST_F(PlanInWind, AStartHeadingIsACourse) {
  request_.start_heading_true_rad = 1.0;
  const flight::Plan plan = planned(wind(12.0, 350.0));
  EXPECT_NEAR(plan.trajectory.states.front().heading_true_rad, 1.0, 1e-9);
  EXPECT_TRUE(plan.verdict.is_verified);
}

TEST_F(PlanInWind, TooMuchWindForTheSpeedIsRefusedWithTheSpeedThatItTakes) {
  SilentObserver observer;
  request_.speed_mps = 35.0;
  try {
    plan(map_, request_, config_with(wind(18.0, 0.0)), {}, observer);
    FAIL() << "accepted";
  } catch (const UsageError& error) {
    EXPECT_THAT(error.what(), HasSubstr("18.0 m/s"));
    EXPECT_THAT(error.what(), HasSubstr("35.0 m/s"));
  }
}

TEST(WindConfig, ARoadmapWithWindIsRefused) {
  EXPECT_THROW(config_with({"global.planner=roadmap", "conditions.wind_mps=3"}), ConfigError);
}

TEST(WindConfig, FlightsAreNeverSlowerThanTwiceTheWind) {
  PlanningConfig config = config_with(wind(13.0, 0.0));
  const PlanningConfig windy =
      in_wind(config, geo::MapProjection("EPSG:32632").wkt(), {500000.0, 5500000.0});
  EXPECT_GE(windy.local.slow_speed_mps, 26.0);
  EXPECT_EQ(windy.local.retry_speeds_mps, std::vector<double>{30.0});
  EXPECT_EQ(windy.vehicle.wind, windy.demands.wind);
  EXPECT_EQ(windy.vehicle.wind, windy.global.wind);
  // On the zone's middle meridian grid north is true north.
  EXPECT_NEAR(windy.vehicle.wind.north_mps, -13.0, 1e-6);
}

}  // namespace
}  // namespace hedgehop::planning
