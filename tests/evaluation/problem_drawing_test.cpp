#include "evaluation/problem_drawing.hpp"

#include <array>
#include <cmath>
#include <gtest/gtest.h>
#include <limits>

#include "base/errors.hpp"
#include "support/fresh_seed.hpp"
#include "support/test_map.hpp"

namespace hedgehop::evaluation {
namespace {

map::Map flat_map(int columns, int rows) {
  return test::make_map(columns, rows, 30.0, [](double, double) { return 100.0; });
}

TEST(DrawProblems, KeepsTheMarginAndTheDistanceAndHitsCellCentres) {
  const map::Map map = flat_map(400, 300);
  const DrawnProblems drawn =
      draw_problems(map, {1500.0, 6000.0, 1000000}, 3000, test::fresh_seed());
  ASSERT_EQ(drawn.problems.size(), 3000U);
  for (const DrawnProblem& problem : drawn.problems) {
    for (const geo::MapPoint& point : {problem.start, problem.goal}) {
      ASSERT_GE(point.x_m, 1500.0);
      ASSERT_LE(point.x_m, 12000.0 - 1500.0);
      ASSERT_GE(point.y_m, 1500.0);
      ASSERT_LE(point.y_m, 9000.0 - 1500.0);
      ASSERT_EQ(std::fmod(point.x_m, 30.0), 15.0);
      ASSERT_EQ(std::fmod(point.y_m, 30.0), 15.0);
    }
    ASSERT_GE(
        std::hypot(problem.goal.x_m - problem.start.x_m, problem.goal.y_m - problem.start.y_m),
        6000.0);
  }
  EXPECT_GT(drawn.rejected_near, 0);
  EXPECT_EQ(drawn.rejected_unknown, 0);
}

TEST(DrawProblems, IsUniformOverTheInnerCells) {
  // 100 x 80 inner cells in 5 x 4 blocks; a distance that rejects nothing but equal cells.
  const map::Map map = flat_map(200, 180);
  constexpr int kProblems = 20000;
  const DrawnProblems drawn =
      draw_problems(map, {1500.0, 1.0, 10000000}, kProblems, test::fresh_seed());
  std::array<int, 20> starts{};
  std::array<int, 20> goals{};
  for (const DrawnProblem& problem : drawn.problems) {
    const auto block = [](const geo::MapPoint& point) {
      return static_cast<std::size_t>((point.x_m - 1500.0) / 600.0) +
             5 * static_cast<std::size_t>((point.y_m - 1500.0) / 600.0);
    };
    ++starts.at(block(problem.start));
    ++goals.at(block(problem.goal));
  }
  // 19 degrees of freedom: a chi-square above 65 has a chance of 6e-7.
  for (const auto& counts : {starts, goals}) {
    double chi_square = 0.0;
    const double expected = kProblems / 20.0;
    for (const int count : counts) {
      chi_square += (count - expected) * (count - expected) / expected;
    }
    EXPECT_LT(chi_square, 65.0);
  }
}

TEST(DrawProblems, RejectsAndCountsCellsWithoutElevation) {
  map::Map map = flat_map(200, 200);
  for (int row = 0; row < 200; ++row) {
    for (int column = 0; column < 100; ++column) {
      map.terrain_m.at(column, row) = std::numeric_limits<float>::quiet_NaN();
      map.surface_m.at(column, row) = std::numeric_limits<float>::quiet_NaN();
    }
  }
  const DrawnProblems drawn = draw_problems(map, {0.0, 100.0, 1000000}, 2000, test::fresh_seed());
  for (const DrawnProblem& problem : drawn.problems) {
    ASSERT_GT(problem.start.x_m, 3000.0);
    ASSERT_GT(problem.goal.x_m, 3000.0);
  }
  // Both ends are valid in one of four draws: 6000 rejected for 2000 kept, within 5 sigma.
  EXPECT_NEAR(static_cast<double>(drawn.rejected_unknown), 6000.0, 5.0 * std::sqrt(4.0 * 6000.0));
}

TEST(DrawProblems, RepeatsForTheSameSeedAndContinuesForAGreaterCount) {
  const map::Map map = flat_map(400, 400);
  const std::uint64_t seed = test::fresh_seed();
  const DrawnProblems few = draw_problems(map, {1500.0, 6000.0, 100000}, 5, seed);
  const DrawnProblems many = draw_problems(map, {1500.0, 6000.0, 100000}, 9, seed);
  const DrawnProblems other = draw_problems(map, {1500.0, 6000.0, 100000}, 5, seed + 1);
  bool is_different = false;
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_EQ(few.problems[i].start.x_m, many.problems[i].start.x_m);
    EXPECT_EQ(few.problems[i].goal.y_m, many.problems[i].goal.y_m);
    is_different |= few.problems[i].start.x_m != other.problems[i].start.x_m;
  }
  EXPECT_TRUE(is_different);
}

TEST(DrawProblems, SaysWhenTheMapIsTooSmall) {
  EXPECT_THROW(draw_problems(flat_map(100, 100), {1500.0, 8000.0, 1000}, 1, 1), DataError);
  EXPECT_THROW(draw_problems(flat_map(90, 90), {1500.0, 1.0, 1000}, 1, 1), DataError);
}

TEST(DrawProblems, GivesUpAfterTheAllowedDraws) {
  map::Map map = flat_map(300, 300);
  for (float& value : map.surface_m.values()) {
    value = std::numeric_limits<float>::quiet_NaN();
  }
  EXPECT_THROW(draw_problems(map, {0.0, 100.0, 1000}, 1, 1), DataError);
}

}  // namespace
}  // namespace hedgehop::evaluation
