#include <filesystem>
#include <fstream>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "planning/planning.hpp"

namespace hedgehop::planning {
namespace {

using ::testing::HasSubstr;

class PlanningConfigTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::path(::testing::TempDir()) /
              ("planning_config_" +
               std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::string write(const std::string& name, const std::string& text) {
    const std::string path = (folder_ / name).string();
    std::ofstream(path) << text;
    return path;
  }

  static std::string error_of(const std::function<void()>& action) {
    try {
      action();
    } catch (const ConfigError& error) {
      return std::string(error.what()) + " | " + error.hint();
    }
    return "no error";
  }

  std::filesystem::path folder_;
};

TEST_F(PlanningConfigTest, ShippedConfigAloneIsComplete) {
  const PlanningConfig config = read_planning_config(effective_planning_config("", {}), "shipped");

  EXPECT_DOUBLE_EQ(config.reference_height_m, 15.24);
  EXPECT_NEAR(config.vehicle.limits.bank_max_rad, radians_from_degrees(30.0), 1e-12);
}

TEST_F(PlanningConfigTest, OverlayReplacesOneKeyAndLeavesItsNeighbours) {
  const std::string file = write("mine.yaml", "weights:\n  visibility: 7.5\n");

  const PlanningConfig shipped = read_planning_config(effective_planning_config("", {}), "shipped");
  const PlanningConfig config = read_planning_config(effective_planning_config(file, {}), "mine");

  EXPECT_DOUBLE_EQ(config.weights.visibility, 7.5);
  EXPECT_DOUBLE_EQ(config.weights.semantics, shipped.weights.semantics);
  EXPECT_DOUBLE_EQ(config.speed_mps, shipped.speed_mps);
}

TEST_F(PlanningConfigTest, SettingWinsOverTheFileAndReachesTheVehicle) {
  const std::string file = write("mine.yaml", "speed_mps: 30.0\n");

  const PlanningConfig config = read_planning_config(
      effective_planning_config(file, {"speed_mps=35.0", "vehicle.limits.bank_max_deg=20"}),
      "mine");

  EXPECT_DOUBLE_EQ(config.speed_mps, 35.0);
  EXPECT_NEAR(config.vehicle.limits.bank_max_rad, radians_from_degrees(20.0), 1e-12);
}

TEST_F(PlanningConfigTest, UnknownKeyIsRefusedWithFileLineAndTheNearestName) {
  const std::string file = write("mine.yaml", "speed_mps: 30.0\nweights:\n  visibilty: 7.5\n");

  const std::string error = error_of([&] { effective_planning_config(file, {}); });

  EXPECT_THAT(error, HasSubstr(file + ":3: unknown key 'visibilty'"));
  EXPECT_THAT(error, HasSubstr("did you mean 'visibility'?"));
}

TEST_F(PlanningConfigTest, VehicleFileBesideTheConfigIsTaken) {
  write("slow.yaml",
        "name: slow\n"
        "limits: {speed_min_mps: 5, speed_max_mps: 45, bank_max_deg: 25, "
        "roll_rate_max_degps: 30, pitch_max_deg: 10, climb_rate_max_mps: 5, "
        "descent_rate_max_mps: 5, vertical_acceleration_max_mps2: 2, load_factor_max: 1.5}\n");
  const std::string file = write("mine.yaml", "vehicle_file: slow.yaml\n");

  // The file is found; it lacks its command model, which must be named.
  const std::string error =
      error_of([&] { read_planning_config(effective_planning_config(file, {}), "mine"); });

  EXPECT_THAT(error, HasSubstr("vehicle.command_model"));
}

TEST_F(PlanningConfigTest, MissingVehicleFileIsRefusedByName) {
  const std::string file = write("mine.yaml", "vehicle_file: vehicles/ufo.yaml\n");

  EXPECT_THAT(error_of([&] { effective_planning_config(file, {}); }),
              HasSubstr("vehicles/ufo.yaml"));
}

TEST_F(PlanningConfigTest, SpeedBeyondTheVehicleIsRefused) {
  EXPECT_THAT(error_of([&] {
                read_planning_config(effective_planning_config("", {"speed_mps=300"}), "set");
              }),
              HasSubstr("'speed_mps' must lie within the vehicle's speed limits"));
}

TEST_F(PlanningConfigTest, ConfigOfAnEarlierVersionIsReadWithWhatItLacksAsShipped) {
  // As if the demands' clearance, and all of TVFH+'s goal indicator, had come later.
  std::string text = effective_planning_config("", {"weights.visibility=7.5"});
  const auto without_line = [&text](const std::string& key) {
    const std::size_t at = text.find(key + ":");
    ASSERT_NE(at, std::string::npos);
    const std::size_t begin = text.rfind('\n', at) + 1;
    text.erase(begin, text.find('\n', at) + 1 - begin);
  };
  without_line("required_clearance_m");
  without_line("look_ahead_m");
  EXPECT_THROW((void)read_planning_config(text, "old"), ConfigError);
  const PlanningConfig shipped = read_planning_config(effective_planning_config("", {}), "new");
  const PlanningConfig config = read_recorded_config(text, "old");
  EXPECT_EQ(config.weights.visibility, 7.5);
  EXPECT_EQ(config.demands.required_clearance_m, shipped.demands.required_clearance_m);
  EXPECT_EQ(config.local.look_ahead_m, shipped.local.look_ahead_m);
  const std::string error =
      error_of([&] { (void)read_recorded_config(text + "forgotten: 3\n", "old"); });
  EXPECT_THAT(error, HasSubstr("unknown key 'forgotten'"));
}

TEST_F(PlanningConfigTest, HeadingLabelsOfAnEarlierVersionBecomeTheTurnRule) {
  using global_planning::TurnRule;
  std::string text = effective_planning_config("", {"global.batch_size=77"});
  const std::size_t at = text.find("turn_rule: heading_labels");
  ASSERT_NE(at, std::string::npos);
  for (const auto& [word, rule] :
       {std::pair{"true", TurnRule::kHeadingLabels}, std::pair{"false", TurnRule::kInsertion}}) {
    std::string old = text;
    old.replace(at, std::string("turn_rule: heading_labels").size(),
                std::string("heading_labels: ") + word);
    EXPECT_THROW((void)read_planning_config(old, "old"), ConfigError);
    const PlanningConfig config = read_recorded_config(old, "old");
    EXPECT_EQ(config.global.turn_rule, rule);
    EXPECT_EQ(config.global.batch_size, 77);
  }
}

TEST_F(PlanningConfigTest, TheSwitchesOfBitStarAreWordsFromAList) {
  using global_planning::SamplingRegion;
  using global_planning::SearchHeuristic;
  using global_planning::TurnRule;
  const auto with = [](const std::string& setting) {
    return read_planning_config(effective_planning_config("", {setting}), "set").global;
  };
  EXPECT_EQ(with("global.heuristic=cost_field").heuristic, SearchHeuristic::kCostField);
  EXPECT_EQ(with("global.sampler=level_set").sampler, SamplingRegion::kLevelSet);
  EXPECT_EQ(with("global.turn_rule=none").turn_rule, TurnRule::kNone);
  EXPECT_EQ(with("global.turn_rule=insertion").turn_rule, TurnRule::kInsertion);
  EXPECT_THAT(error_of([&] { (void)with("global.heuristic=lengths"); }),
              HasSubstr("'global.heuristic' must be one of length, cost_field"));
  EXPECT_THAT(error_of([&] { (void)with("global.turn_rule=labels"); }),
              HasSubstr("'global.turn_rule' must be one of none, insertion, heading_labels"));
}

TEST_F(PlanningConfigTest, EffectiveConfigReadsBackToItself) {
  const std::string text = effective_planning_config("", {"global.work_budget=1234"});

  EXPECT_EQ(read_planning_config(text, "again").text, text);
}

}  // namespace
}  // namespace hedgehop::planning
