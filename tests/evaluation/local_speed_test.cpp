#include "evaluation/local_speed.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "base/errors.hpp"
#include "support/test_map.hpp"

namespace hedgehop::evaluation {
namespace {

planning::PlanningConfig shipped_config() {
  return planning::read_planning_config(planning::effective_planning_config("", {}), "shipped");
}

TEST(LocalSpeed, CoversThePapersTableWithItsNumbersAndFliesTheSameBytes) {
  double clock_s = 0.0;
  SilentObserver observer;
  const LocalSpeedResult result = evaluate_local_speed(
      nullptr, shipped_config(), {1, 1, 2000.0}, [&] { return clock_s += 0.001; }, observer);
  const auto json = nlohmann::json::parse(local_speed_json(result));
  int in_table = 0;
  for (const auto& row : json.at("rows")) {
    EXPECT_TRUE(row.at("same_bytes").get<bool>()) << row.dump();
    // The clock ticks a millisecond at every look.
    EXPECT_NEAR(row.at("ms_per_km").get<double>(), 1.0 / row.at("length_km").get<double>(), 1e-9);
    EXPECT_NEAR(row.at("length_km").get<double>(), 2.0, 0.3);
    in_table += row.at("planner") == "tvfh" && !row.at("paper_ms_per_km").is_null() ? 1 : 0;
    if (row.at("window_m") == 350.0 && row.at("sectors") == 64 && row.at("planner") == "tvfh") {
      EXPECT_EQ(row.at("paper_ms_per_km"), 149.5);
    }
    if (row.at("window_m") == 450.0 && row.at("sectors") == 256) {
      EXPECT_EQ(row.at("paper_ms_per_km"), 473.4);
    }
  }
  EXPECT_EQ(in_table, 28);
}

TEST(LocalSpeed, MapWithoutAFlyableLineIsRefused) {
  const auto map = test::make_map(60, 60, 30.0, [](double, double) { return std::nan(""); });
  SilentObserver observer;
  EXPECT_THROW(evaluate_local_speed(
                   &map, shipped_config(), {1, 1, 2000.0}, [] { return 0.0; }, observer),
               DataError);
}

TEST(SyntheticHills, FinerCellsCutUpTheSameLand) {
  const map::Map coarse = synthetic_hills(30.0, 3000.0, 1500.0);
  const map::Map fine = synthetic_hills(10.0, 3000.0, 1500.0);
  // The middle of three by three fine cells is the middle of the coarse one.
  for (int row = 0; row < coarse.geometry.rows; ++row) {
    for (int column = 0; column < coarse.geometry.columns; ++column) {
      EXPECT_NEAR(coarse.surface_m.at(column, row), fine.surface_m.at(3 * column + 1, 3 * row + 1),
                  1e-3);
    }
  }
  EXPECT_EQ(synthetic_hills(30.0, 3000.0, 1500.0).hash, coarse.hash);
}

}  // namespace
}  // namespace hedgehop::evaluation
