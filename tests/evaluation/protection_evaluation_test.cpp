#include "evaluation/protection_evaluation.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "base/errors.hpp"
#include "base/shipped_config.hpp"
#include "support/fractal_terrain.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::evaluation {
namespace {

using preparation::Simd;

const preparation::VisibilityOptions kVisibility{900.0, 15.24, 180, true, 0.13, {}};
const ProtectionOptions kOptions{20, 5, 16, {30.0, 60.0, 100.0, 150.0}};

// A clock that moves on by a second a look, and memory that grows by a million bytes.
ProcessMeters counting_meters() {
  auto looks = std::make_shared<double>(0.0);
  auto bytes = std::make_shared<double>(0.0);
  return {[looks] { return *looks += 1.0; }, [bytes] { return *bytes += 1e6; }};
}

TEST(ProtectionEvaluation, ComparesWithBruteForceAndWithGdal) {
  const std::uint64_t seed = test::fresh_seed();
  const map::Map map = test::make_fractal_map(seed, 190, 30.0, 2000.0, 500.0);
  SilentObserver observer;
  const ProtectionResult result = evaluate_protection(map, kVisibility, kOptions, {1, Simd::kBest},
                                                      seed, counting_meters(), observer);
  // 190 cells less 32 on each side: 30 for the radius and 2 for interpolation.
  EXPECT_EQ(result.timed_cells, 126 * 126);
  EXPECT_TRUE(result.is_surroundings_complete);
  EXPECT_EQ(result.error.cells, 20);
  EXPECT_EQ(result.gdal_cells, 5);
  // Discs of 30 cells are coarse; both ways are right, so both are near.
  EXPECT_LE(result.error.mean_abs, 0.01);
  EXPECT_GT(result.error.mean_abs, 0.0);
  EXPECT_LE(result.error.mean_abs, result.error.p95_abs);
  EXPECT_LE(result.error.p95_abs, result.error.max_abs);
  EXPECT_LE(std::fabs(result.error.bias), result.error.mean_abs);
  EXPECT_LE(result.gdal_mean_abs_error, 0.03);
  EXPECT_EQ(result.is_update_exact, true);
  ASSERT_EQ(result.exposure_errors.size(), 4U);
  for (const ErrorStatistics& error : result.exposure_errors) {
    EXPECT_EQ(error.cells, 4);
    EXPECT_LE(error.mean_abs, 0.03);
  }
}

TEST(ProtectionEvaluation, FiguresAreThoseOfTheMeters) {
  const map::Map map = test::make_fractal_map(3, 190, 30.0, 2000.0, 500.0);
  SilentObserver observer;
  const ProtectionResult result = evaluate_protection(map, kVisibility, kOptions, {1, Simd::kBest},
                                                      1, counting_meters(), observer);
  // Each work lies between two looks at the clock, one second apart.
  const double million_cells = 126 * 126 * 1e-6;
  EXPECT_NEAR(result.cpu_s_per_million_cells, 1.0 / million_cells, 1e-9);
  EXPECT_NEAR(result.one_thread_cpu_s_per_million_cells, 1.0 / million_cells, 1e-9);
  EXPECT_NEAR(result.gdal_cpu_s_per_million_cells, 1e6, 1e-6);
  EXPECT_NEAR(result.update_cpu_s, 1.0, 1e-12);
  EXPECT_NEAR(result.exposure_ratio, 1.0, 1e-12);
  EXPECT_NEAR(result.memory_bytes_per_cell, 1e6 / (126 * 126), 1e-9);
}

TEST(ProtectionEvaluation, TheSameSeedDrawsTheSameCellsWhateverTheThreads) {
  const map::Map map = test::make_fractal_map(4, 120, 30.0, 2000.0, 500.0);
  SilentObserver observer;
  const auto run = [&](std::uint64_t seed, int threads) {
    return evaluate_protection(map, kVisibility, kOptions, {threads, Simd::kBest}, seed,
                               counting_meters(), observer)
        .error;
  };
  const ErrorStatistics one = run(5, 1);
  EXPECT_EQ(run(5, 2).bias, one.bias);
  EXPECT_EQ(run(5, 2).max_abs, one.max_abs);
  EXPECT_NE(run(6, 1).bias, one.bias);
}

TEST(ProtectionEvaluation, ASmallMapIsEvaluatedWhole) {
  const map::Map map = test::make_fractal_map(8, 90, 30.0, 1000.0, 200.0);
  SilentObserver observer;
  const ProtectionResult result = evaluate_protection(map, kVisibility, kOptions, {1, Simd::kBest},
                                                      1, counting_meters(), observer);
  EXPECT_EQ(result.timed_cells, 90 * 90);
  EXPECT_FALSE(result.is_surroundings_complete);
}

TEST(ProtectionEvaluation, AMapWithoutElevationIsRefused) {
  map::Map map = test::make_fractal_map(8, 50, 30.0, 1000.0, 200.0);
  for (float& value : map.surface_m.values()) {
    value = std::numeric_limits<float>::quiet_NaN();
  }
  SilentObserver observer;
  EXPECT_THROW(evaluate_protection(map, kVisibility, kOptions, {1, Simd::kBest}, 1,
                                   counting_meters(), observer),
               DataError);
}

TEST(ProtectionEvaluation, JsonHoldsWhatTheVerbPromises) {
  ProtectionResult result;
  result.simd = "avx2";
  result.threads = 2;
  result.cpu_s_per_million_cells = 1.5;
  result.error = {200, 0.25, 0.5, 0.75, -0.125};
  result.gdal_cpu_s_per_million_cells = 700.0;
  result.gdal_mean_abs_error = 0.0625;
  const auto json = nlohmann::json::parse(protection_result_json(result));
  EXPECT_EQ(json["simd"], "avx2");
  EXPECT_EQ(json["threads"], 2);
  EXPECT_EQ(json["cpu_s_per_million_cells"], 1.5);
  EXPECT_EQ(json["error"]["mean_abs"], 0.25);
  EXPECT_EQ(json["error"]["p95_abs"], 0.5);
  EXPECT_EQ(json["error"]["max_abs"], 0.75);
  EXPECT_EQ(json["error"]["bias"], -0.125);
  EXPECT_EQ(json["gdal"]["cpu_s_per_million_cells"], 700.0);
  EXPECT_EQ(json["gdal"]["mean_abs_error"], 0.0625);
}

TEST(ProtectionEvaluation, OptionsOutOfRangeAreRefused) {
  const std::string good =
      "{error_cells: 5, gdal_cells: 0, patch_cells: 4, further_heights_m: [30]}";
  ConfigReader reader = ConfigReader::from_text(good, "test.yaml");
  EXPECT_EQ(read_protection_options(reader).error_cells, 5);
  for (const char* bad :
       {"{error_cells: 0, gdal_cells: 0, patch_cells: 4, further_heights_m: [30]}",
        "{error_cells: 5, gdal_cells: -1, patch_cells: 4, further_heights_m: [30]}",
        "{error_cells: 5, gdal_cells: 0, patch_cells: 0, further_heights_m: [30]}",
        "{error_cells: 5, gdal_cells: 0, patch_cells: 4, further_heights_m: [-1]}"}) {
    ConfigReader refused = ConfigReader::from_text(bad, "test.yaml");
    EXPECT_THROW(read_protection_options(refused), ConfigError) << bad;
  }
}

}  // namespace
}  // namespace hedgehop::evaluation
