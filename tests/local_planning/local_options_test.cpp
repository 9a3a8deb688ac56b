#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <string>

#include "base/errors.hpp"
#include "local_planning/local_planning_setup.hpp"

namespace hedgehop::local_planning {
namespace {

using ::testing::HasSubstr;

std::string error_of(const std::string& setting) {
  try {
    test::shipped_local_options(setting);
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "no error";
}

TEST(LocalOptions, ShippedOptionsLoadWithAnglesInRadians) {
  const LocalOptions options = test::shipped_local_options();
  EXPECT_EQ(options.sectors, 64);
  EXPECT_NEAR(options.climb_angle_min_rad, -std::numbers::pi / 18.0, 1e-15);
  EXPECT_EQ(options.weights.goal_cost, GoalCost::kQuadratic);
}

TEST(LocalOptions, ValuesOutOfRangeAreRefusedByName) {
  for (const auto& [setting, key] : std::vector<std::pair<std::string, std::string>>{
           {"local.step_s=0.21", "local.step_s"},
           {"local.sectors=7", "local.sectors"},
           {"local.sectors=1025", "local.sectors"},
           {"local.window_m=0", "local.window_m"},
           {"local.safety_radius_m=351", "local.safety_radius_m"},
           {"local.near_distance_m=0", "local.near_distance_m"},
           {"local.truncation_angle_deg=59", "local.truncation_angle_deg"},
           {"local.climb_share=1.1", "local.climb_share"},
           {"local.climb_angle_min_deg=1", "local.climb_angle_min_deg"},
           {"local.passes=0", "local.passes"},
           {"local.steering=some", "local.steering"},
           {"local.opening_wide_deg=181", "local.opening_wide_deg"},
           {"local.repulsion_width_deg=0", "local.repulsion_width_deg"},
           {"local.weights.goal_cost=cubic", "local.weights.goal_cost"},
           {"local.weights.goal=0", "local.weights.goal"},
           {"local.weights.polar_offset_rad3=0", "local.weights.polar_offset_rad3"},
           {"local.heading_indicator.inertia=0", "local.heading_indicator.inertia"},
           {"local.climb_indicator.spring_1ps2=-1", "local.climb_indicator.spring_1ps2"},
           {"local.climb_ahead.sample_s=0", "local.climb_ahead.sample_s"},
           {"local.climb_ahead.use=7", "local.climb_ahead.use"},
           {"local.rollout_escape.use=7", "local.rollout_escape.use"},
           {"local.rollout_escape.clearance_m=0", "local.rollout_escape.clearance_m"},
           {"local.rollout_escape.back_s=0", "local.rollout_escape.back_s"},
           {"local.vertical_pass.knot_s=0", "local.vertical_pass.knot_s"},
           {"local.vertical_pass.clearance_m=0", "local.vertical_pass.clearance_m"},
           {"local.vertical_pass.rate_share=1.1", "local.vertical_pass.rate_share"},
           {"local.compare_with_following=2", "local.compare_with_following"},
           {"local.bank_weight_1prad=-1", "local.bank_weight_1prad"},
           {"local.retry_speeds_mps=[20, 30]", "local.retry_speeds_mps"},
           {"local.sectors=64.5", "local.sectors"}}) {
    EXPECT_THAT(error_of(setting), HasSubstr("'" + key + "'")) << setting;
  }
}

TEST(LocalOptions, PassesMayNotShrinkTheWindowAway) {
  std::string text = set_config_value(shipped_config("planning.yaml"), "local.passes=8");
  ConfigReader root = ConfigReader::from_text(text, "planning.yaml");
  ConfigReader local = root.required_section("local");
  EXPECT_THROW(read_local_options(local), ConfigError);
}

TEST(LocalOptions, UnknownKeyIsRefusedWithItsLine) {
  std::string text(shipped_config("planning.yaml"));
  const auto at = text.find("  look_ahead_m:");
  ASSERT_NE(at, std::string::npos);
  text.insert(at, "  look_ahed_m: 1\n");
  const auto line =
      std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(at), '\n') + 1;
  ConfigReader root = ConfigReader::from_text(text, "planning.yaml");
  ConfigReader local = root.required_section("local");
  try {
    read_local_options(local);
    FAIL() << "not refused";
  } catch (const ConfigError& error) {
    EXPECT_THAT(error.what(), HasSubstr("planning.yaml:" + std::to_string(line) +
                                        ": unknown key 'local.look_ahed_m'"));
    EXPECT_THAT(error.hint(), HasSubstr("look_ahead_m"));
  }
}

}  // namespace
}  // namespace hedgehop::local_planning
