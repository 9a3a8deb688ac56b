#include "verification/wire_distance.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace hedgehop::verification {
namespace {

struct Vector {
  double x = 0.0;
  double y = 0.0;
  double z = 0.0;
};

Vector between(const PathPoint& from, const PathPoint& to) {
  return {to.x_m - from.x_m, to.y_m - from.y_m, to.altitude_m - from.altitude_m};
}

double dot(const Vector& a, const Vector& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

// Squared distance of the points at shares t and s of two pieces that start `offset` apart.
double squared_distance(const Vector& path, const Vector& span, const Vector& offset, double t,
                        double s) {
  const Vector d{offset.x + t * path.x - s * span.x, offset.y + t * path.y - s * span.y,
                 offset.z + t * path.z - s * span.z};
  return dot(d, d);
}

// Share of `direction` that comes nearest to the point `offset` away from its start.
double nearest_share(const Vector& direction, const Vector& offset) {
  const double squared = dot(direction, direction);
  return squared > 0.0 ? std::clamp(dot(offset, direction) / squared, 0.0, 1.0) : 0.0;
}

struct Pair {
  double t = 0.0;  // share of the path
  double s = 0.0;  // share of the span
};

// Pairs of shares among which a nearest pair of two straight pieces is: where their lines come
// nearest, if within both, and each end with the point nearest to it on the other piece. For
// parallel pieces that overlap these hold both ends of the overlap.
std::array<Pair, 5> candidates(const Vector& path, const Vector& span, const Vector& offset) {
  const Vector back{-offset.x, -offset.y, -offset.z};
  const Vector from_end{offset.x + path.x, offset.y + path.y, offset.z + path.z};
  const Vector to_end{back.x + span.x, back.y + span.y, back.z + span.z};
  std::array<Pair, 5> pairs{
      Pair{0.0, nearest_share(span, offset)}, Pair{1.0, nearest_share(span, from_end)},
      Pair{nearest_share(path, back), 0.0}, Pair{nearest_share(path, to_end), 1.0}, Pair{0.0, 0.0}};
  pairs[4] = pairs[0];
  const double a = dot(path, path);
  const double b = dot(path, span);
  const double c = dot(span, span);
  const double determinant = a * c - b * b;
  if (determinant > 0.0) {
    const double t = (b * dot(span, offset) - c * dot(path, offset)) / determinant;
    const double s = (a * dot(span, offset) - b * dot(path, offset)) / determinant;
    if (t >= 0.0 && t <= 1.0 && s >= 0.0 && s <= 1.0) {
      pairs[4] = {t, s};
    }
  }
  return pairs;
}

}  // namespace

double distance_to_span_m(const PathPoint& from, const PathPoint& to, const PathPoint& top_a,
                          const PathPoint& top_b) {
  Vector path = between(from, to);
  Vector span = between(top_a, top_b);
  Vector offset = between(top_a, from);

  const Vector flat_path{path.x, path.y, 0.0};
  const Vector flat_span{span.x, span.y, 0.0};
  const Vector flat_offset{offset.x, offset.y, 0.0};
  const auto flat_pairs = candidates(flat_path, flat_span, flat_offset);
  double flat_squared = std::numeric_limits<double>::infinity();
  for (const Pair& pair : flat_pairs) {
    flat_squared =
        std::min(flat_squared, squared_distance(flat_path, flat_span, flat_offset, pair.t, pair.s));
  }
  const double flat_m = std::sqrt(flat_squared);
  if (std::isinf(top_a.altitude_m) || std::isinf(top_b.altitude_m)) {
    return flat_m;
  }
  constexpr double kSamePlace_m = 1e-9;
  for (const Pair& pair : flat_pairs) {
    const double squared = squared_distance(flat_path, flat_span, flat_offset, pair.t, pair.s);
    const double above_m = offset.z + pair.t * path.z - pair.s * span.z;
    if (std::sqrt(squared) <= flat_m + kSamePlace_m && above_m <= 0.0) {
      return flat_m;
    }
  }
  double squared = std::numeric_limits<double>::infinity();
  for (const Pair& pair : candidates(path, span, offset)) {
    squared = std::min(squared, squared_distance(path, span, offset, pair.t, pair.s));
  }
  return std::sqrt(squared);
}

}  // namespace hedgehop::verification
