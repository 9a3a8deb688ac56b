#include "global_planning/dubins_path.hpp"

#include <array>
#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <numbers>
#include <random>

#include "support/fresh_seed.hpp"

namespace hedgehop::global_planning {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kRadius_m = 282.0;

double distance_m(const DubinsPose& a, const DubinsPose& b) {
  return std::hypot(b.x_m - a.x_m, b.y_m - a.y_m);
}

DubinsPose random_pose(std::mt19937_64& random, double extent_m) {
  std::uniform_real_distribution<double> place(-extent_m, extent_m);
  std::uniform_real_distribution<double> heading(-kPi, kPi);
  return {place(random), place(random), heading(random)};
}

// Follows the parts in small steps with the midpoint rule, without sines of whole arcs.
DubinsPose integrated(const DubinsPath& path, const DubinsPose& from, int steps) {
  DubinsPose pose = from;
  for (int part = 0; part < 3; ++part) {
    const double step_m = path.parts_m[static_cast<std::size_t>(part)] / steps;
    const double turn_rad = turn_of(path.word, part) * step_m / path.radius_m;
    for (int k = 0; k < steps; ++k) {
      const double middle_rad = pose.heading_math_rad + 0.5 * turn_rad;
      pose.x_m += step_m * std::cos(middle_rad);
      pose.y_m += step_m * std::sin(middle_rad);
      pose.heading_math_rad += turn_rad;
    }
  }
  return pose;
}

void expect_same(const DubinsPose& a, const DubinsPose& b, double tolerance_m) {
  EXPECT_NEAR(a.x_m, b.x_m, tolerance_m);
  EXPECT_NEAR(a.y_m, b.y_m, tolerance_m);
  EXPECT_NEAR(std::cos(a.heading_math_rad - b.heading_math_rad), 1.0, 1e-9);
}

TEST(DubinsPath, StraightAheadIsAStraightLine) {
  const DubinsPath path = shortest_dubins_path(
      {100.0, 50.0, 0.5}, {100.0 + 3000.0 * std::cos(0.5), 50.0 + 3000.0 * std::sin(0.5), 0.5},
      kRadius_m);
  EXPECT_NEAR(path.length_m(), 3000.0, 1e-6);
  EXPECT_NEAR(path.parts_m[1], 3000.0, 1e-6);
}

TEST(DubinsPath, SamePoseTakesNoWay) {
  EXPECT_NEAR(shortest_dubins_path({6e5, 5.5e6, 2.0}, {6e5, 5.5e6, 2.0}, kRadius_m).length_m(), 0.0,
              1e-6);
}

TEST(DubinsPath, HalfCircleIsOneArc) {
  // From the origin heading north; two radii to the east, heading south: half a circle to the
  // right.
  const DubinsPath path =
      shortest_dubins_path({0.0, 0.0, 0.5 * kPi}, {2.0 * kRadius_m, 0.0, -0.5 * kPi}, kRadius_m);
  EXPECT_NEAR(path.length_m(), kPi * kRadius_m, 1e-6);
}

TEST(DubinsPath, SideStepAheadIsTwoTurnsAndTheirInnerTangent) {
  // Heading east at both ends, one radius up. The line between the circles' centres, (0, R) and
  // (L, 0), has the length d; the inner tangent is sqrt(d^2 - 4 R^2) long and turned by
  // atan(2 R / straight) - atan(R / L) against east.
  const double ahead_m = 10.0 * kRadius_m;
  const double side_m = kRadius_m;
  const double rise_m = side_m - 2.0 * kRadius_m;  // of the second centre over the first
  const double straight_m =
      std::sqrt(ahead_m * ahead_m + rise_m * rise_m - 4.0 * kRadius_m * kRadius_m);
  const double turn_rad = std::atan2(2.0 * kRadius_m, straight_m) + std::atan2(rise_m, ahead_m);
  const DubinsPath path = shortest_dubins_path({0.0, 0.0, 0.0}, {ahead_m, side_m, 0.0}, kRadius_m);
  EXPECT_EQ(path.word, DubinsWord::kLsr);
  EXPECT_NEAR(path.length_m(), straight_m + 2.0 * turn_rad * kRadius_m, 1e-6);
}

TEST(DubinsPath, TurningBackOnTheSpotTakesThreeArcs) {
  // Same place, opposite heading: the three centres form an equilateral triangle of side 2 R, so
  // the arcs are 60, 300 and 60 degrees: 7/3 pi R.
  const DubinsPath path = shortest_dubins_path({0.0, 0.0, 0.0}, {0.0, 0.0, kPi}, kRadius_m);
  EXPECT_TRUE(path.word == DubinsWord::kLrl || path.word == DubinsWord::kRlr);
  EXPECT_NEAR(path.length_m(), 7.0 / 3.0 * kPi * kRadius_m, 1e-6);
}

TEST(DubinsPath, EachWordEndsAtTheGoalWhenIntegrated) {
  std::mt19937_64 random(test::fresh_seed());
  std::array<int, 6> seen{};
  for (int i = 0; i < 300; ++i) {
    const double extent_m = i % 3 == 0 ? 6.0 * kRadius_m : 1.5 * kRadius_m;
    const DubinsPose from = random_pose(random, extent_m);
    const DubinsPose to = random_pose(random, extent_m);
    for (const DubinsWord word : kDubinsWords) {
      const auto path = dubins_path(word, from, to, kRadius_m);
      if (!path) {
        continue;
      }
      ++seen[static_cast<std::size_t>(word)];
      expect_same(integrated(*path, from, 400), to, 0.02);
      expect_same(pose_at(*path, from, path->length_m()), to, 1e-6);
      for (const double part_m : path->parts_m) {
        EXPECT_GE(part_m, 0.0);
      }
    }
  }
  for (const int count : seen) {
    EXPECT_GT(count, 20);
  }
}

TEST(DubinsPath, ArcsAndStraightLinesThatWereFlownAreNeverBeaten) {
  // Any curve of arcs and lines that reaches the goal is at least as long as the shortest one, and
  // when its three parts are of a word, that word finds it or a shorter one.
  std::mt19937_64 random(test::fresh_seed());
  std::uniform_real_distribution<double> share(0.0, 1.0);
  for (int i = 0; i < 2000; ++i) {
    const DubinsPose from = random_pose(random, 5000.0);
    const DubinsWord word = kDubinsWords[static_cast<std::size_t>(i) % 6];
    DubinsPath flown{word, kRadius_m, {}};
    for (int part = 0; part < 3; ++part) {
      flown.parts_m[static_cast<std::size_t>(part)] =
          kRadius_m * (turn_of(word, part) == 0 ? 8.0 * share(random)
                       : part == 1              ? kPi * (1.0 + share(random))
                                                : 2.0 * kPi * share(random));
    }
    const DubinsPose to = pose_at(flown, from, flown.length_m());
    const auto same = dubins_path(word, from, to, kRadius_m);
    ASSERT_TRUE(same.has_value());
    EXPECT_NEAR(same->length_m(), flown.length_m(), 1e-3);
    EXPECT_LE(shortest_dubins_path(from, to, kRadius_m).length_m(), flown.length_m() + 1e-3);
  }
}

// Shortest curve of an arc, a line and an arc by trying: the first arc grows until the line ahead
// touches one of the circles at the goal.
double tried_length_m(const DubinsPose& from, const DubinsPose& to) {
  constexpr int kSteps = 720;
  double best_m = std::numeric_limits<double>::infinity();
  for (const int first : {1, -1}) {
    for (const int last : {1, -1}) {
      const double centre_x_m = to.x_m - last * kRadius_m * std::sin(to.heading_math_rad);
      const double centre_y_m = to.y_m + last * kRadius_m * std::cos(to.heading_math_rad);
      struct Line {
        double miss_m, ahead_m, heading_rad;
      };
      const auto after = [&](double first_rad) {
        const double heading_rad = from.heading_math_rad + first * first_rad;
        const double x_m = from.x_m + first * kRadius_m *
                                          (std::sin(heading_rad) - std::sin(from.heading_math_rad));
        const double y_m = from.y_m - first * kRadius_m *
                                          (std::cos(heading_rad) - std::cos(from.heading_math_rad));
        const double dx_m = centre_x_m - x_m;
        const double dy_m = centre_y_m - y_m;
        return Line{dy_m * std::cos(heading_rad) - dx_m * std::sin(heading_rad) - last * kRadius_m,
                    dx_m * std::cos(heading_rad) + dy_m * std::sin(heading_rad), heading_rad};
      };
      for (int i = 0; i < kSteps; ++i) {
        double low_rad = 2.0 * kPi * i / kSteps;
        double high_rad = 2.0 * kPi * (i + 1) / kSteps;
        const bool is_above = after(low_rad).miss_m > 0.0;
        if (is_above == (after(high_rad).miss_m > 0.0)) {
          continue;
        }
        for (int halving = 0; halving < 50; ++halving) {
          const double middle_rad = 0.5 * (low_rad + high_rad);
          (is_above == (after(middle_rad).miss_m > 0.0) ? low_rad : high_rad) = middle_rad;
        }
        const Line line = after(low_rad);
        if (line.ahead_m < 0.0) {
          continue;
        }
        double rest_rad = std::fmod(last * (to.heading_math_rad - line.heading_rad), 2.0 * kPi);
        rest_rad = rest_rad < 0.0 ? rest_rad + 2.0 * kPi : rest_rad;
        best_m = std::min(best_m, (low_rad + rest_rad) * kRadius_m + line.ahead_m);
      }
    }
  }
  return best_m;
}

TEST(DubinsPath, FarEndsAgreeWithTryingAllFirstArcs) {
  std::mt19937_64 random(test::fresh_seed());
  int compared = 0;
  for (int i = 0; i < 200; ++i) {
    const DubinsPose from = random_pose(random, 3000.0);
    const DubinsPose to = random_pose(random, 3000.0);
    if (distance_m(from, to) < 4.5 * kRadius_m) {
      continue;  // three arcs may be shorter
    }
    ++compared;
    EXPECT_NEAR(shortest_dubins_path(from, to, kRadius_m).length_m(), tried_length_m(from, to),
                1e-5);
  }
  EXPECT_GT(compared, 50);
}

TEST(DubinsPath, IsAtLeastAsLongAsTheStraightLineAndAsTheTurnNeeded) {
  std::mt19937_64 random(test::fresh_seed());
  for (int i = 0; i < 2000; ++i) {
    const DubinsPose from = random_pose(random, 2000.0);
    const DubinsPose to = random_pose(random, 2000.0);
    const double length_m = shortest_dubins_path(from, to, kRadius_m).length_m();
    EXPECT_GE(length_m, distance_m(from, to) - 1e-9);
    const double turn_rad =
        std::fabs(std::remainder(to.heading_math_rad - from.heading_math_rad, 2.0 * kPi));
    EXPECT_GE(length_m, kRadius_m * turn_rad - 1e-6);
  }
}

TEST(DubinsPath, LengthDoesNotChangeUnderRotationReflectionReversalAndScaling) {
  std::mt19937_64 random(test::fresh_seed());
  std::uniform_real_distribution<double> angle(-kPi, kPi);
  for (int i = 0; i < 500; ++i) {
    const DubinsPose from = random_pose(random, 1500.0);
    const DubinsPose to = random_pose(random, 1500.0);
    const double length_m = shortest_dubins_path(from, to, kRadius_m).length_m();
    const double turn_rad = angle(random);
    const auto turned = [&](const DubinsPose& pose) {
      return DubinsPose{6e5 + pose.x_m * std::cos(turn_rad) - pose.y_m * std::sin(turn_rad),
                        5.5e6 + pose.x_m * std::sin(turn_rad) + pose.y_m * std::cos(turn_rad),
                        pose.heading_math_rad + turn_rad};
    };
    const auto mirrored = [](const DubinsPose& pose) {
      return DubinsPose{pose.x_m, -pose.y_m, -pose.heading_math_rad};
    };
    const auto reversed = [](const DubinsPose& pose) {
      return DubinsPose{pose.x_m, pose.y_m, pose.heading_math_rad + kPi};
    };
    const auto scaled = [](const DubinsPose& pose) {
      return DubinsPose{3.0 * pose.x_m, 3.0 * pose.y_m, pose.heading_math_rad};
    };
    const auto length_of = [](const DubinsPose& a, const DubinsPose& b, double radius_m) {
      return shortest_dubins_path(a, b, radius_m).length_m();
    };
    EXPECT_NEAR(length_of(turned(from), turned(to), kRadius_m), length_m, 1e-4);
    EXPECT_NEAR(length_of(mirrored(from), mirrored(to), kRadius_m), length_m, 1e-6);
    EXPECT_NEAR(length_of(reversed(to), reversed(from), kRadius_m), length_m, 1e-6);
    EXPECT_NEAR(length_of(scaled(from), scaled(to), 3.0 * kRadius_m), 3.0 * length_m, 1e-5);
  }
}

TEST(DubinsPath, RefusesARadiusThatIsNone) {
  EXPECT_THROW(shortest_dubins_path({}, {}, 0.0), std::invalid_argument);
  EXPECT_THROW(shortest_dubins_path({}, {}, std::nan("")), std::invalid_argument);
}

}  // namespace
}  // namespace hedgehop::global_planning
