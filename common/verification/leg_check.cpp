#include "verification/leg_check.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>

#include "verification/area_entry.hpp"
#include "verification/cylinder_distance.hpp"
#include "verification/path_pieces.hpp"
#include "verification/surface_sweep.hpp"
#include "verification/wire_distance.hpp"

namespace hedgehop::verification {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kReach_m = 2000.0;
constexpr double kPlaceLength_m = 0.5;  // to which the place of a distance is found
constexpr double kAreaPiece_m = 1.0;

PathPoint at(const PathPoint& a, const PathPoint& b, double t) {
  return {a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m),
          a.altitude_m + t * (b.altitude_m - a.altitude_m)};
}

double length_m(const PathPoint& a, const PathPoint& b) {
  return distance_m({a.x_m, a.y_m}, {b.x_m, b.y_m});
}

flight::Waypoint waypoint(const PathPoint& point) {
  return {point.x_m, point.y_m, point.altitude_m};
}

using DistanceOf = std::function<double(const PathPoint&, const PathPoint&)>;

// Where a distance that is exact for every piece is least: in the half that is as near as the
// whole.
PathPoint nearest_place(PathPoint a, PathPoint b, const DistanceOf& distance_of) {
  while (length_m(a, b) > kPlaceLength_m) {
    const PathPoint middle = at(a, b, 0.5);
    (distance_of(a, middle) <= distance_of(middle, b) ? b : a) = middle;
  }
  return at(a, b, 0.5);
}

class Nearest {
 public:
  Nearest(Hazard hazard, double required_m) {
    miss_.hazard = hazard;
    miss_.required_m = required_m;
    miss_.distance_m = kReach_m;
    miss_.time_s = kNan;
  }
  [[nodiscard]] double distance_m() const { return miss_.distance_m; }
  void set(double distance_m, const std::string& name, const PathPoint& place) {
    miss_.distance_m = distance_m;
    miss_.name = name;
    miss_.place = {place.x_m, place.y_m};
    miss_.altitude_m = place.altitude_m;
  }
  void tell(LegCheck& check) const {
    if (miss_.distance_m < kReach_m) {
      check.nearest.push_back(miss_);
    }
  }

 private:
  NearMiss miss_;
};

class Checker {
 public:
  Checker(const map::Map& map, double required_m)
      : map_(map),
        required_m_(required_m),
        ground_(Hazard::kGround, required_m),
        wire_(Hazard::kWire, required_m),
        obstacle_(Hazard::kObstacle, required_m),
        area_(Hazard::kArea, 0.0) {
    check_.clearance_min_m = kNan;
    for (const map::OverheadLine& line : map.overhead_lines) {
      for (std::size_t end = 1; end < line.supports.size(); ++end) {
        spans_.push_back({span_of(map, line, end), std::to_string(line.source_id)});
      }
    }
    if (std::any_of(map.areas.begin(), map.areas.end(), needs_ground)) {
      turned_terrain_m_ = turned(map.terrain_m);
    }
  }

  void check_leg(std::size_t leg, const PathPoint& a, const PathPoint& b) {
    leg_ = leg;
    check_.length_m += length_m(a, b);
    check_ground(a, b);
    Box box;
    box.add({a.x_m, a.y_m});
    box.add({b.x_m, b.y_m});
    double least_m = std::numeric_limits<double>::infinity();
    PathPoint place;
    for (const auto& [span, name] : spans_) {
      if (span.box.is_within(wire_.distance_m() + required_m_, box)) {
        measure(a, b, wire_, name, least_m, place,
                [&span = span](const PathPoint& from, const PathPoint& to) {
                  return distance_to_span_m(from, to, span.top_a, span.top_b);
                });
      }
    }
    tell_if_near("wire_clearance", place, least_m);
    least_m = std::numeric_limits<double>::infinity();
    for (const map::Obstacle& obstacle : map_.obstacles) {
      Box mast;
      mast.add(obstacle.point);
      if (mast.is_within(obstacle_.distance_m() + required_m_ + obstacle.radius_m, box)) {
        const Cylinder cylinder = cylinder_of(map_, obstacle);
        measure(a, b, obstacle_,
                obstacle.name.empty() ? std::to_string(obstacle.source_id) : obstacle.name, least_m,
                place, [&](const PathPoint& from, const PathPoint& to) {
                  return distance_to_cylinder_m(from, to, cylinder);
                });
      }
    }
    tell_if_near("obstacle_clearance", place, least_m);
    check_areas(a, b, box);
  }

  LegCheck finished() {
    for (const Nearest* nearest : {&ground_, &wire_, &obstacle_, &area_}) {
      nearest->tell(check_);
    }
    check_.is_verified = check_.violations.empty();
    return std::move(check_);
  }

  void tell(const char* rule, const PathPoint& place, double value, double limit) {
    check_.violations.push_back({rule, leg_, waypoint(place), value, limit});
  }

 private:
  void check_ground(const PathPoint& a, const PathPoint& b) {
    const Sweep sweep = sweep_surface(map_.surface_m, a, b, 0.0);
    if (!std::isnan(sweep.outside_at)) {
      tell("outside_map", at(a, b, sweep.outside_at), kNan, 0.0);
    }
    if (!std::isnan(sweep.unknown_at)) {
      tell("unknown_surface", at(a, b, sweep.unknown_at), kNan, 0.0);
    }
    if (std::isnan(sweep.clearance_min_m)) {
      return;
    }
    const PathPoint lowest = at(a, b, sweep.clearance_min_at);
    check_.clearance_min_m = std::fmin(check_.clearance_min_m, sweep.clearance_min_m);
    if (sweep.clearance_min_m < ground_.distance_m()) {
      ground_.set(sweep.clearance_min_m, "", lowest);
    }
    if (!(sweep.clearance_min_m >= required_m_)) {
      tell("clearance", lowest, sweep.clearance_min_m, required_m_);
    }
  }

  // The nearest thing of a leg, and of all legs so far.
  void measure(const PathPoint& a, const PathPoint& b, Nearest& nearest, const std::string& name,
               double& least_m, PathPoint& place, const DistanceOf& distance_of) const {
    const double here_m = distance_of(a, b);
    if (here_m < least_m && (here_m < required_m_ || here_m < nearest.distance_m())) {
      least_m = here_m;
      place = nearest_place(a, b, distance_of);
      if (here_m < nearest.distance_m()) {
        nearest.set(here_m, name, place);
      }
    }
  }

  void tell_if_near(const char* rule, const PathPoint& place, double distance_m) {
    if (distance_m < required_m_) {
      tell(rule, place, distance_m, required_m_);
    }
  }

  void check_areas(const PathPoint& a, const PathPoint& b, const Box& box) {
    double depth_m = -1.0;
    PathPoint deepest;
    for (const map::Area& area : map_.areas) {
      if (!area.is_hard || !box_of(area).is_within(area_.distance_m(), box)) {
        continue;
      }
      const int pieces = std::max(1, static_cast<int>(std::ceil(length_m(a, b) / kAreaPiece_m)));
      for (int i = 0; i < pieces; ++i) {
        const PathPoint from = at(a, b, static_cast<double>(i) / pieces);
        const PathPoint to = at(a, b, static_cast<double>(i + 1) / pieces);
        const double aside_m = distance_to_polygons_m(area, from, to);
        if (aside_m > 0.0 && aside_m >= area_.distance_m()) {
          continue;
        }
        const HeightRange altitude{std::min(from.altitude_m, to.altitude_m),
                                   std::max(from.altitude_m, to.altitude_m)};
        const HeightRange height =
            needs_ground(area) ? heights_over(map_.terrain_m, *turned_terrain_m_, from, to, 0.0)
                               : HeightRange{kNan, kNan};
        const double off_m = std::hypot(aside_m, distance_to_band_m(area, altitude, height));
        if (off_m < area_.distance_m()) {
          area_.set(off_m, area.name, from);
        }
        if (const auto depth = depth_in_area_m(area, from, to, 0.0);
            depth && may_lie_within(area, altitude, height) && *depth > depth_m) {
          depth_m = *depth;
          deepest = from;
        }
      }
    }
    if (depth_m >= 0.0) {
      tell("no_fly_area", deepest, -depth_m, 0.0);
    }
  }

  const map::Map& map_;
  double required_m_;
  std::vector<std::pair<Span, std::string>> spans_;
  std::optional<raster::Grid<float>> turned_terrain_m_;
  LegCheck check_;
  std::size_t leg_ = 0;
  Nearest ground_, wire_, obstacle_, area_;
};

}  // namespace

LegCheck check_legs(const map::Map& map, const std::vector<flight::Waypoint>& waypoints,
                    double required_clearance_m) {
  Checker checker(map, required_clearance_m);
  const bool is_finite =
      std::all_of(waypoints.begin(), waypoints.end(), [](const flight::Waypoint& point) {
        return std::isfinite(point.x_m) && std::isfinite(point.y_m) &&
               std::isfinite(point.altitude_m);
      });
  if (waypoints.size() < 2 || !is_finite) {
    checker.tell("states", {kNan, kNan, kNan}, static_cast<double>(waypoints.size()), 2.0);
    return checker.finished();
  }
  for (std::size_t leg = 1; leg < waypoints.size(); ++leg) {
    const flight::Waypoint& a = waypoints[leg - 1];
    const flight::Waypoint& b = waypoints[leg];
    checker.check_leg(leg, {a.x_m, a.y_m, a.altitude_m}, {b.x_m, b.y_m, b.altitude_m});
  }
  return checker.finished();
}

}  // namespace hedgehop::verification
