#include "verification/area_entry.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace hedgehop::verification {
namespace {

struct Vector {
  double x = 0.0;
  double y = 0.0;
};

double dot(const Vector& a, const Vector& b) { return a.x * b.x + a.y * b.y; }
double cross(const Vector& a, const Vector& b) { return a.x * b.y - a.y * b.x; }
Vector between(const Vector& a, const Vector& b) { return {b.x - a.x, b.y - a.y}; }

double distance_to_piece(const Vector& point, const Vector& a, const Vector& b) {
  const Vector along = between(a, b);
  const double square = dot(along, along);
  const double t =
      square > 0.0 ? std::clamp(dot(between(a, point), along) / square, 0.0, 1.0) : 0.0;
  const Vector off = between({a.x + t * along.x, a.y + t * along.y}, point);
  return std::sqrt(dot(off, off));
}

double distance_of_pieces(const Vector& a, const Vector& b, const Vector& p, const Vector& q) {
  const double side_p = cross(between(a, b), between(a, p));
  const double side_q = cross(between(a, b), between(a, q));
  const double side_a = cross(between(p, q), between(p, a));
  const double side_b = cross(between(p, q), between(p, b));
  if (side_p * side_q < 0.0 && side_a * side_b < 0.0) {
    return 0.0;
  }
  return std::min({distance_to_piece(a, p, q), distance_to_piece(b, p, q),
                   distance_to_piece(p, a, b), distance_to_piece(q, a, b)});
}

// Sum of the signed quarter turns of a ring around a point, in whole turns: not 0 inside.
int winding_number(const std::vector<geo::MapPoint>& ring, const Vector& point) {
  int turns = 0;
  for (std::size_t i = 1; i < ring.size(); ++i) {
    const Vector a{ring[i - 1].x_m, ring[i - 1].y_m};
    const Vector b{ring[i].x_m, ring[i].y_m};
    const double side = cross(between(a, b), between(a, point));
    if (a.y <= point.y && b.y > point.y && side > 0.0) {
      ++turns;
    } else if (a.y > point.y && b.y <= point.y && side < 0.0) {
      --turns;
    }
  }
  return turns;
}

}  // namespace

std::optional<double> depth_in_area_m(const map::Area& area, const PathPoint& from,
                                      const PathPoint& to, double margin_m) {
  const Vector a{from.x_m, from.y_m};
  const Vector b{to.x_m, to.y_m};
  bool is_touched = false;
  bool is_inside = false;
  double nearest_m = std::numeric_limits<double>::infinity();
  for (const map::Area::Polygon& polygon : area.polygons) {
    const auto look_at = [&](const std::vector<geo::MapPoint>& ring) {
      for (std::size_t i = 1; i < ring.size(); ++i) {
        const Vector p{ring[i - 1].x_m, ring[i - 1].y_m};
        const Vector q{ring[i].x_m, ring[i].y_m};
        nearest_m = std::min(nearest_m, distance_to_piece(a, p, q));
        is_touched = is_touched || distance_of_pieces(a, b, p, q) <= margin_m;
      }
    };
    look_at(polygon.outer);
    std::for_each(polygon.holes.begin(), polygon.holes.end(), look_at);
    is_inside = is_inside || (winding_number(polygon.outer, a) != 0 &&
                              std::none_of(polygon.holes.begin(), polygon.holes.end(),
                                           [&](const std::vector<geo::MapPoint>& hole) {
                                             return winding_number(hole, a) != 0;
                                           }));
  }
  if (is_inside) {
    return nearest_m;
  }
  return is_touched ? std::optional(0.0) : std::nullopt;
}

double distance_to_polygons_m(const map::Area& area, const PathPoint& from, const PathPoint& to) {
  if (depth_in_area_m(area, from, to, 0.0)) {
    return 0.0;
  }
  const Vector a{from.x_m, from.y_m};
  const Vector b{to.x_m, to.y_m};
  double nearest_m = std::numeric_limits<double>::infinity();
  const auto look_at = [&](const std::vector<geo::MapPoint>& ring) {
    for (std::size_t i = 1; i < ring.size(); ++i) {
      nearest_m = std::min(nearest_m, distance_of_pieces(a, b, {ring[i - 1].x_m, ring[i - 1].y_m},
                                                         {ring[i].x_m, ring[i].y_m}));
    }
  };
  for (const map::Area::Polygon& polygon : area.polygons) {
    look_at(polygon.outer);
    std::for_each(polygon.holes.begin(), polygon.holes.end(), look_at);
  }
  return nearest_m;
}

bool may_lie_within(const map::Area& area, const HeightRange& altitude, const HeightRange& height) {
  const auto range_for = [&](const map::AreaLimit& limit) {
    return limit.reference == map::AreaLimit::Reference::kAboveGround ? height : altitude;
  };
  // Written so that NaN is within. A limit that is infinite holds nothing back.
  const bool is_above =
      std::isfinite(area.ceiling.value_m) && range_for(area.ceiling).low_m > area.ceiling.value_m;
  const bool is_below =
      std::isfinite(area.floor.value_m) && range_for(area.floor).high_m < area.floor.value_m;
  return !is_above && !is_below;
}

double distance_to_band_m(const map::Area& area, const HeightRange& altitude,
                          const HeightRange& height) {
  const auto range_for = [&](const map::AreaLimit& limit) {
    return limit.reference == map::AreaLimit::Reference::kAboveGround ? height : altitude;
  };
  double gap_m = 0.0;  // fmax passes over NaN
  if (std::isfinite(area.ceiling.value_m)) {
    gap_m = std::fmax(gap_m, range_for(area.ceiling).low_m - area.ceiling.value_m);
  }
  if (std::isfinite(area.floor.value_m)) {
    gap_m = std::fmax(gap_m, area.floor.value_m - range_for(area.floor).high_m);
  }
  return gap_m;
}

}  // namespace hedgehop::verification
