#include "evaluation/paired_statistics.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <random>
#include <stdexcept>

#include "support/fresh_seed.hpp"

namespace hedgehop::evaluation {
namespace {

TEST(Quantile, IsTheValueThatTheShareDoesNotExceed) {
  const std::vector<double> values = {5.0, 1.0, 4.0, 2.0, 3.0};
  EXPECT_EQ(quantile_of(values, 0.2), 1.0);
  EXPECT_EQ(quantile_of(values, 0.21), 2.0);
  EXPECT_EQ(quantile_of(values, 0.75), 4.0);
  EXPECT_EQ(quantile_of(values, 0.95), 5.0);
  EXPECT_EQ(quantile_of(values, 1.0), 5.0);
  EXPECT_TRUE(std::isnan(quantile_of({}, 0.5)));
}

TEST(PairedChange, HasTheFiguresOfAHandCalculation) {
  const PairedChange change = paired_change({90.0, 110.0, 30.0}, {100.0, 100.0, 50.0}, 1000, 1);
  EXPECT_EQ(change.pairs, 3);
  EXPECT_DOUBLE_EQ(change.sum, 230.0);
  EXPECT_DOUBLE_EQ(change.baseline_sum, 250.0);
  EXPECT_NEAR(change.change, -0.08, 1e-12);
  // Changes of the pairs: -0.1, +0.1, -0.4.
  EXPECT_NEAR(change.mean_change, -0.4 / 3.0, 1e-12);
  EXPECT_NEAR(change.change_deviation, std::sqrt((0.01 + 0.01 + 0.16 - 0.16 / 3.0) / 2.0), 1e-12);
  EXPECT_GE(change.low, -0.4);
  EXPECT_LE(change.high, 0.1 + 1e-12);
  EXPECT_LT(change.low, change.change);
  EXPECT_GT(change.high, change.change);
}

TEST(PairedChange, SameRatioEverywhereHasAnIntervalWithoutWidth) {
  const PairedChange change = paired_change({8.0, 16.0, 4.0}, {10.0, 20.0, 5.0}, 500, 3);
  EXPECT_NEAR(change.low, -0.2, 1e-12);
  EXPECT_NEAR(change.high, -0.2, 1e-12);
  EXPECT_NEAR(change.change_deviation, 0.0, 1e-12);
}

TEST(PairedChange, PairsWithoutABaselineCountInTheSumsAlone) {
  const PairedChange change = paired_change({1.0, 12.0}, {0.0, 10.0}, 100, 3);
  EXPECT_EQ(change.ratio_pairs, 1);
  EXPECT_NEAR(change.mean_change, 0.2, 1e-12);
  EXPECT_NEAR(change.change, 0.3, 1e-12);
  EXPECT_TRUE(std::isnan(paired_change({1.0}, {0.0}, 100, 3).change));
}

TEST(PairedChange, IntervalHoldsTheTruthAboutNinetyFiveTimesInAHundred) {
  std::mt19937_64 random(test::fresh_seed());
  std::normal_distribution<double> noise(0.0, 0.2);
  int held = 0;
  constexpr int kRepeats = 400;
  for (int repeat = 0; repeat < kRepeats; ++repeat) {
    std::vector<double> values;
    for (int i = 0; i < 60; ++i) {
      values.push_back(0.9 + noise(random));
    }
    const PairedChange change = paired_change(values, std::vector<double>(60, 1.0), 400, random());
    held += change.low <= -0.1 && change.high >= -0.1 ? 1 : 0;
  }
  // The percentile interval of a mean of 60 is a little short; 5 standard deviations of the count.
  EXPECT_GE(held, kRepeats * 0.93 - 5.0 * std::sqrt(kRepeats * 0.93 * 0.07));
  EXPECT_LE(held, kRepeats - 1);
}

TEST(PairedChange, SeedDecidesTheIntervalAndNothingElse) {
  const std::vector<double> values{1.0, 2.0, 3.0, 5.0, 4.0};
  const std::vector<double> baseline{2.0, 2.0, 2.0, 4.0, 6.0};
  const PairedChange a = paired_change(values, baseline, 200, 11);
  const PairedChange b = paired_change(values, baseline, 200, 11);
  EXPECT_EQ(a.low, b.low);
  EXPECT_EQ(a.high, b.high);
}

TEST(PairedChange, NonsenseIsRefused) {
  EXPECT_THROW(paired_change({}, {}, 100, 1), std::invalid_argument);
  EXPECT_THROW(paired_change({1.0}, {1.0, 2.0}, 100, 1), std::invalid_argument);
  EXPECT_THROW(paired_change({1.0}, {1.0}, 0, 1), std::invalid_argument);
}

}  // namespace
}  // namespace hedgehop::evaluation
