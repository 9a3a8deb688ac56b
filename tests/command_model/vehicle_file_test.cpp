#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <string>

#include "base/errors.hpp"
#include "base/shipped_config.hpp"
#include "command_model/command_model.hpp"

namespace hedgehop::command_model {
namespace {

using ::testing::HasSubstr;

std::string replaced(const std::string& what, const std::string& by) {
  std::string text(shipped_config("vehicles/ec135.yaml"));
  const auto at = text.find(what);
  EXPECT_NE(at, std::string::npos) << what;
  return text.replace(at, what.size(), by);
}

std::string error_of(const std::string& text) {
  try {
    ConfigReader reader = ConfigReader::from_text(text, "v.yaml");
    read_vehicle(reader);
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "no error";
}

TEST(VehicleFile, ShippedVehicleLoadsWithAnglesInRadians) {
  ConfigReader reader =
      ConfigReader::from_text(shipped_config("vehicles/ec135.yaml"), "vehicles/ec135.yaml");
  const Vehicle vehicle = read_vehicle(reader);
  EXPECT_EQ(vehicle.name, "EC135 class");
  EXPECT_NEAR(vehicle.limits.bank_max_rad, std::numbers::pi / 6.0, 1e-15);
  EXPECT_NEAR(vehicle.model.pitch_rate_max_radps, std::numbers::pi / 12.0, 1e-15);
  EXPECT_EQ(vehicle.model.heave_time_constant_s, 1.0);
}

TEST(VehicleFile, MisspeltKeyIsRefusedWithItsLine) {
  const std::string text = replaced("climb_gain:", "climb_gian:");
  EXPECT_THAT(error_of(text), HasSubstr("climb_gain"));
  const std::string extra = replaced("climb_gain:", "climb_gian: 1\n  climb_gain:");
  EXPECT_THAT(error_of(extra), HasSubstr("unknown key 'command_model.climb_gian'"));
}

TEST(VehicleFile, HeadingGainBeyondTheRouthBoundIsRefused) {
  // 2 * 0.85 * 2.5 * 1.3 = 5.525
  EXPECT_EQ(error_of(replaced("heading_gain_1ps: 0.8", "heading_gain_1ps: 5.52")), "no error");
  EXPECT_THAT(error_of(replaced("heading_gain_1ps: 0.8", "heading_gain_1ps: 5.53")),
              HasSubstr("makes the heading loop unstable"));
}

TEST(VehicleFile, NonPositiveConstantsAreRefused) {
  EXPECT_THAT(error_of(replaced("heave_time_constant_s: 1.0", "heave_time_constant_s: 0")),
              HasSubstr("'command_model.heave_time_constant_s' must be above 0"));
  EXPECT_THAT(error_of(replaced("attitude_damping: 0.85", "attitude_damping: 1.5")),
              HasSubstr("attitude_damping"));
}

}  // namespace
}  // namespace hedgehop::command_model
