#include "evaluation/parameter_search.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <set>
#include <stdexcept>

namespace hedgehop::evaluation {
namespace {

// Counts, and stops when told to.
class Counting final : public Observer {
 public:
  void progress(std::string_view, double done, double /*total*/) override { done_ = done; }
  void note(std::string_view) override {}
  [[nodiscard]] bool stop_requested() const override { return done_ >= stop_after; }
  double stop_after = 1e9;

 private:
  double done_ = 0.0;
};

const std::vector<ParameterRange> kPlane{{"x", -5.0, 5.0, false}, {"y", 10.0, 1000.0, true}};
constexpr SearchOptions kGenerous{400, 0.15};

// Least, 0, at x = 2 and y = 50; steep along a diagonal.
double valley(const std::vector<double>& values) {
  const double u = values[0] - 2.0;
  const double v = std::log(values[1] / 50.0);
  return (u + v) * (u + v) + 0.05 * (u - v) * (u - v);
}

TEST(SearchParameters, FindsTheLowestPointOfASlantedValley) {
  SilentObserver observer;
  const SearchResult found = search_parameters(kPlane, {-1.0, 400.0}, kGenerous, valley, observer);
  EXPECT_NEAR(found.values[0], 2.0, 0.05);
  EXPECT_NEAR(found.values[1], 50.0, 2.5);
  EXPECT_LT(found.least, 1e-3);
  EXPECT_EQ(found.at_start, valley({-1.0, 400.0}));
  EXPECT_FALSE(found.is_stopped);
}

TEST(SearchParameters, FindsTheLowestStepOfAStaircase) {
  SilentObserver observer;
  const auto stairs = [](const std::vector<double>& values) {
    return std::floor(4.0 * std::abs(values[0] - 2.0)) +
           std::floor(4.0 * std::abs(std::log(values[1] / 50.0)));
  };
  const SearchResult found = search_parameters(kPlane, {-1.0, 400.0}, kGenerous, stairs, observer);
  EXPECT_LE(found.least, 1.0) << "from a start of 20";
}

TEST(SearchParameters, GoesToABoundAndNotBeyond) {
  SilentObserver observer;
  const auto slope = [](const std::vector<double>& values) {
    EXPECT_GE(values[0], -5.0);
    EXPECT_LE(values[0], 5.0);
    EXPECT_GE(values[1], 10.0);
    EXPECT_LE(values[1], 1000.0);
    return values[0] - values[1];
  };
  const SearchResult found = search_parameters(kPlane, {5.0, 10.0}, kGenerous, slope, observer);
  EXPECT_NEAR(found.values[0], -5.0, 0.02);
  EXPECT_NEAR(found.values[1], 1000.0, 10.0);
}

TEST(SearchParameters, NeverAnswersWithAPointBehindACliff) {
  SilentObserver observer;
  // Down towards x = 5, but from 3 on all is forbidden.
  const auto cliff = [](const std::vector<double>& values) {
    return values[0] > 3.0 ? 1000.0 : -values[0];
  };
  const SearchResult found = search_parameters(kPlane, {0.0, 100.0}, kGenerous, cliff, observer);
  EXPECT_LE(found.values[0], 3.0);
  EXPECT_GT(found.values[0], 2.5);
}

TEST(SearchParameters, JudgesTheStartFirstAndRoundedPointsOnceEach) {
  SilentObserver observer;
  std::vector<std::vector<double>> judged;
  constexpr SearchOptions kShort{37, 0.15};
  const auto note = [&](const std::vector<double>& values) {
    judged.push_back(values);
    return valley(values);
  };
  const SearchResult found =
      search_parameters(kPlane, {1.23456789, 123.456789}, kShort, note, observer);
  EXPECT_EQ(found.evaluations, 37);
  ASSERT_EQ(judged.size(), 37U);
  EXPECT_EQ(judged.front(), (std::vector<double>{1.23456789, 123.456789}));
  EXPECT_EQ(std::set(judged.begin(), judged.end()).size(), judged.size());
  for (std::size_t i = 1; i < judged.size(); ++i) {
    if (judged[i][1] != 123.456789) {  // four digits of a number between 10 and 1000
      const double unit = judged[i][1] < 100.0 ? 0.01 : 0.1;
      EXPECT_NEAR(judged[i][1] / unit, std::round(judged[i][1] / unit), 1e-6);
    }
  }
}

TEST(SearchParameters, LeavesTheBestSoFarWhenItIsStopped) {
  Counting observer;
  observer.stop_after = 6.0;
  double least = 1e9;
  std::vector<double> best;
  const auto note = [&](const std::vector<double>& values) {
    const double value = valley(values);
    if (value < least) {
      least = value;
      best = values;
    }
    return value;
  };
  const SearchResult found = search_parameters(kPlane, {-1.0, 400.0}, kGenerous, note, observer);
  EXPECT_TRUE(found.is_stopped);
  EXPECT_EQ(found.evaluations, 6);
  EXPECT_EQ(found.values, best);
  EXPECT_EQ(found.least, least);

  Counting at_once;
  at_once.stop_after = 0.0;
  EXPECT_THROW(search_parameters(kPlane, {-1.0, 400.0}, kGenerous, valley, at_once), Interrupted);
}

TEST(SearchParameters, LetsAnErrorOfTheObjectiveThrough) {
  SilentObserver observer;
  const auto broken = [](const std::vector<double>& values) -> double {
    return values[0] == -1.0 ? 0.0 : throw DataError("no flight");
  };
  EXPECT_THROW(search_parameters(kPlane, {-1.0, 400.0}, kGenerous, broken, observer), DataError);
}

TEST(SearchParameters, RefusesWhatItCannotSearch) {
  SilentObserver observer;
  EXPECT_THROW(search_parameters({}, {}, kGenerous, valley, observer), std::invalid_argument);
  EXPECT_THROW(search_parameters(kPlane, {6.0, 400.0}, kGenerous, valley, observer),
               std::invalid_argument);
  EXPECT_THROW(search_parameters({{"x", 1.0, 1.0, false}}, {1.0}, kGenerous, valley, observer),
               std::invalid_argument);
  EXPECT_THROW(search_parameters({{"x", 0.0, 1.0, true}}, {1.0}, kGenerous, valley, observer),
               std::invalid_argument);
}

TEST(ParameterRange, MeasuresInRatiosWhereItIsLogarithmic) {
  const ParameterRange ratios{"x", 0.1, 10.0, true};
  EXPECT_NEAR(ratios.share_of(1.0), 0.5, 1e-12);
  EXPECT_EQ(ratios.value_at(0.0), 0.1);
  EXPECT_EQ(ratios.value_at(0.5), 1.0);
  EXPECT_EQ(ratios.value_at(1.0), 10.0);
  const ParameterRange plain{"x", 0.0, 10.0, false};
  EXPECT_EQ(plain.share_of(1.0), 0.1);
  EXPECT_EQ(plain.value_at(1.0 / 3.0), 3.333);
}

}  // namespace
}  // namespace hedgehop::evaluation
