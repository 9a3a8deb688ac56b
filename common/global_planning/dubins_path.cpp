#include "global_planning/dubins_path.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>

#include "base/angles.hpp"
#include "base/elementary.hpp"

namespace hedgehop::global_planning {
namespace {

// Turns this close to a full circle are none: rounding made them negative.
constexpr double kNoTurn_rad = 1e-9;
// Lengths that differ by this share of the radius differ by rounding.
constexpr double kSame = 1e-9;

double turn_rad(double angle_rad) {
  double turn = std::fmod(angle_rad, kTwoPi);
  if (turn < 0.0) {
    turn += kTwoPi;
  }
  return turn > kTwoPi - kNoTurn_rad ? 0.0 : turn;
}

struct Side {
  double sine, cosine;
};
struct Ends {
  const DubinsPose* from;
  const DubinsPose* to;
  Side start, goal;
};

struct Vector {
  double x_m, y_m;
  [[nodiscard]] double square_m2() const { return x_m * x_m + y_m * y_m; }
  [[nodiscard]] double angle_rad() const { return elementary::atan2(y_m, x_m); }
};

// From the centre of the first circle to that of the last; `first` and `last` are their turns.
Vector between_centres(const Ends& ends, int first, int last, double radius_m) {
  return {(ends.to->x_m - ends.from->x_m) -
              radius_m * (last * ends.goal.sine - first * ends.start.sine),
          (ends.to->y_m - ends.from->y_m) +
              radius_m * (last * ends.goal.cosine - first * ends.start.cosine)};
}

std::optional<DubinsPath> path_of(DubinsWord word, const Ends& ends, double radius_m) {
  const int first = turn_of(word, 0);
  const int last = turn_of(word, 2);
  const Vector way = between_centres(ends, first, last, radius_m);
  const double square_m2 = way.square_m2();
  const double from_rad = ends.from->heading_math_rad;
  const double to_rad = ends.to->heading_math_rad;
  DubinsPath path{word, radius_m, {}};
  if (turn_of(word, 1) != 0) {
    // The middle circle touches both others; its centre lies on the side that makes its arc long.
    const double share = std::sqrt(square_m2) / (4.0 * radius_m);
    if (share > 1.0 + kSame) {
      return std::nullopt;
    }
    // Angle at the first centre between the two others.
    const double base_rad =
        elementary::atan2(std::sqrt(std::max((1.0 - share) * (1.0 + share), 0.0)), share);
    const double way_rad = way.angle_rad();
    const double leave_rad = way_rad + first * (0.5 * std::numbers::pi + base_rad);
    const double join_rad = way_rad + first * (1.5 * std::numbers::pi - base_rad);
    path.parts_m = {radius_m * turn_rad(first * (leave_rad - from_rad)),
                    radius_m * turn_rad(first * (leave_rad - join_rad)),
                    radius_m * turn_rad(first * (to_rad - join_rad))};
    return path;
  }
  double straight_rad = 0.0;
  double straight_m = 0.0;
  if (first == last) {
    straight_m = std::sqrt(square_m2);
    const bool is_one_circle = straight_m <= kSame * radius_m;
    straight_rad = is_one_circle ? from_rad : way.angle_rad();
  } else {
    const double rest_m2 = square_m2 - 4.0 * radius_m * radius_m;
    if (rest_m2 < -kSame * radius_m * radius_m) {
      return std::nullopt;
    }
    straight_m = std::sqrt(std::max(rest_m2, 0.0));
    straight_rad = way.angle_rad() + first * elementary::atan2(2.0 * radius_m, straight_m);
  }
  path.parts_m = {radius_m * turn_rad(first * (straight_rad - from_rad)), straight_m,
                  radius_m * turn_rad(last * (to_rad - straight_rad))};
  return path;
}

Ends ends_of(const DubinsPose& from, const DubinsPose& to, double radius_m) {
  if (!(radius_m > 0.0)) {
    throw std::invalid_argument("the radius of a Dubins path must be above 0, not " +
                                std::to_string(radius_m));
  }
  const auto side = [](const DubinsPose& pose) {
    return Side{elementary::sin(pose.heading_math_rad), elementary::cos(pose.heading_math_rad)};
  };
  return {&from, &to, side(from), side(to)};
}

}  // namespace

int turn_of(DubinsWord word, int part) {
  constexpr std::array<std::array<int, 3>, 6> kTurns = {
      {{1, 0, 1}, {-1, 0, -1}, {1, 0, -1}, {-1, 0, 1}, {-1, 1, -1}, {1, -1, 1}}};
  return kTurns[static_cast<std::size_t>(word)][static_cast<std::size_t>(part)];
}

std::optional<DubinsPath> dubins_path(DubinsWord word, const DubinsPose& from, const DubinsPose& to,
                                      double radius_m) {
  return path_of(word, ends_of(from, to, radius_m), radius_m);
}

DubinsPath shortest_dubins_path(const DubinsPose& from, const DubinsPose& to, double radius_m) {
  const Ends ends = ends_of(from, to, radius_m);
  std::optional<DubinsPath> best;
  for (const DubinsWord word : kDubinsWords) {
    const auto path = path_of(word, ends, radius_m);
    if (path && (!best || path->length_m() < best->length_m())) {
      best = path;
    }
  }
  return *best;  // two of the words always exist
}

DubinsPose pose_at(const DubinsPath& path, const DubinsPose& from, double along_m) {
  DubinsPose pose = from;
  double rest_m = along_m;
  for (int part = 0; part < 3; ++part) {
    const double part_m = std::min(rest_m, path.parts_m[static_cast<std::size_t>(part)]);
    const int turn = turn_of(path.word, part);
    if (turn == 0) {
      pose.x_m += part_m * elementary::cos(pose.heading_math_rad);
      pose.y_m += part_m * elementary::sin(pose.heading_math_rad);
    } else {
      const double signed_m = turn * path.radius_m;
      const double end_rad = pose.heading_math_rad + part_m / signed_m;
      pose.x_m += signed_m * (elementary::sin(end_rad) - elementary::sin(pose.heading_math_rad));
      pose.y_m -= signed_m * (elementary::cos(end_rad) - elementary::cos(pose.heading_math_rad));
      pose.heading_math_rad = end_rad;
    }
    rest_m -= part_m;
  }
  return pose;
}

}  // namespace hedgehop::global_planning
