#include "output/straight_legs.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <optional>
#include <string>

#include "base/errors.hpp"
#include "verification/area_entry.hpp"
#include "verification/cylinder_distance.hpp"
#include "verification/surface_sweep.hpp"
#include "verification/wire_distance.hpp"

namespace hedgehop::output {
namespace {

using verification::PathPoint;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
using States = std::vector<flight::FlightState>;

PathPoint end_of_leg(const flight::FlightState& state) {
  return {state.x_m, state.y_m, state.altitude_m};
}

struct Box {
  double west_m = kInfinity;
  double east_m = -kInfinity;
  double south_m = kInfinity;
  double north_m = -kInfinity;

  void add(double x_m, double y_m) {
    west_m = std::min(west_m, x_m);
    east_m = std::max(east_m, x_m);
    south_m = std::min(south_m, y_m);
    north_m = std::max(north_m, y_m);
  }
  [[nodiscard]] bool is_within(double distance_m, const Box& other) const {
    return west_m - distance_m <= other.east_m && other.west_m <= east_m + distance_m &&
           south_m - distance_m <= other.north_m && other.south_m <= north_m + distance_m;
  }
};

// What a leg breaks.
struct Fault {
  std::string what;
  double at = 0.5;  // share of the leg
};

// The things of a map that a leg may meet, with the box around each.
class LegCheck {
 public:
  LegCheck(const map::Map& map, double clearance_m) : map_(map), clearance_m_(clearance_m) {
    for (const map::OverheadLine& line : map.overhead_lines) {
      for (std::size_t i = 1; i < line.supports.size(); ++i) {
        add_span(line.supports[i - 1], line.supports[i]);
      }
    }
    for (const map::Area& area : map.areas) {
      if (area.is_hard) {
        Box box;
        for (const map::Area::Polygon& polygon : area.polygons) {
          for (const geo::MapPoint& point : polygon.outer) {
            box.add(point.x_m, point.y_m);
          }
        }
        areas_.push_back({&area, box});
      }
    }
  }

  [[nodiscard]] double clearance_m(const PathPoint& from, const PathPoint& to) const {
    return verification::sweep_surface(map_.surface_m, from, to, 0.0).clearance_min_m;
  }

  std::optional<Fault> fault_of(const PathPoint& from, const PathPoint& to) {
    const verification::Sweep sweep = verification::sweep_surface(map_.surface_m, from, to, 0.0);
    if (!std::isnan(sweep.outside_at)) {
      return Fault{"leaves the map", sweep.outside_at};
    }
    if (!std::isnan(sweep.unknown_at)) {
      return Fault{"passes over unknown terrain", sweep.unknown_at};
    }
    if (!(sweep.clearance_min_m >= clearance_m_)) {
      return Fault{"passes " + metres(sweep.clearance_min_m) + " above the surface",
                   sweep.clearance_min_at};
    }
    Box box;
    box.add(from.x_m, from.y_m);
    box.add(to.x_m, to.y_m);
    for (const Span& span : spans_) {
      if (span.box.is_within(clearance_m_, box)) {
        const double distance_m =
            verification::distance_to_span_m(from, to, span.top_a, span.top_b);
        if (!(distance_m >= clearance_m_)) {
          return Fault{"passes " + metres(distance_m) + " from a wire", kNan};
        }
      }
    }
    for (const map::Obstacle& obstacle : map_.obstacles) {
      Box place;
      place.add(obstacle.point.x_m, obstacle.point.y_m);
      if (place.is_within(obstacle.radius_m + clearance_m_, box)) {
        const double distance_m =
            verification::distance_to_cylinder_m(from, to, cylinder_of(obstacle));
        if (!(distance_m >= clearance_m_)) {
          return Fault{"passes " + metres(distance_m) + " from an obstacle",
                       share_nearest(from, to, obstacle.point)};
        }
      }
    }
    for (const HardArea& hard : areas_) {
      if (hard.box.is_within(0.0, box) && enters(*hard.area, from, to)) {
        return Fault{"enters the no-fly area '" + hard.area->name + "'", kNan};
      }
    }
    return std::nullopt;
  }

 private:
  struct Span {
    PathPoint top_a, top_b;
    Box box;
  };
  struct HardArea {
    const map::Area* area;
    Box box;
  };

  static std::string metres(double value_m) {
    char text[40];
    std::snprintf(text, sizeof text, "%.2f m", value_m);
    return text;
  }

  static double share_nearest(const PathPoint& from, const PathPoint& to,
                              const geo::MapPoint& point) {
    const double dx_m = to.x_m - from.x_m;
    const double dy_m = to.y_m - from.y_m;
    const double length2_m2 = dx_m * dx_m + dy_m * dy_m;
    return length2_m2 > 0.0
               ? std::clamp(
                     ((point.x_m - from.x_m) * dx_m + (point.y_m - from.y_m) * dy_m) / length2_m2,
                     0.0, 1.0)
               : 0.0;
  }

  void add_span(const map::OverheadLine::Support& a, const map::OverheadLine::Support& b) {
    const auto top_of = [&](const map::OverheadLine::Support& support) {
      return PathPoint{
          support.point.x_m, support.point.y_m,
          verification::interpolated_height_m(map_.terrain_m, support.point) + support.height_m};
    };
    Span span{top_of(a), top_of(b), {}};
    if (!std::isfinite(span.top_a.altitude_m) || !std::isfinite(span.top_b.altitude_m)) {
      span.top_a.altitude_m = kInfinity;  // unknown: as high as may be
      span.top_b.altitude_m = kInfinity;
    }
    span.box.add(a.point.x_m, a.point.y_m);
    span.box.add(b.point.x_m, b.point.y_m);
    spans_.push_back(span);
  }

  [[nodiscard]] verification::Cylinder cylinder_of(const map::Obstacle& obstacle) const {
    const double top_m = std::fmax(
        obstacle.top_m,
        verification::interpolated_height_m(map_.terrain_m, obstacle.point) + obstacle.height_m);
    return {obstacle.point.x_m, obstacle.point.y_m, obstacle.radius_m,
            std::isnan(top_m) ? kInfinity : top_m};
  }

  bool enters(const map::Area& area, const PathPoint& from, const PathPoint& to) {
    if (!verification::depth_in_area_m(area, from, to, 0.0)) {
      return false;
    }
    const verification::HeightRange altitude{std::min(from.altitude_m, to.altitude_m),
                                             std::max(from.altitude_m, to.altitude_m)};
    verification::HeightRange height{kNan, kNan};
    const auto is_above_ground = [](const map::AreaLimit& limit) {
      return limit.reference == map::AreaLimit::Reference::kAboveGround &&
             std::isfinite(limit.value_m);
    };
    if (is_above_ground(area.floor) || is_above_ground(area.ceiling)) {
      const verification::Sweep low = verification::sweep_surface(map_.terrain_m, from, to, 0.0);
      // The greatest height is the least one with all signs turned.
      if (!turned_terrain_m_) {
        turned_terrain_m_ = map_.terrain_m;
        for (float& value : turned_terrain_m_->values()) {
          value = -value;
        }
      }
      PathPoint turned_from = from;
      PathPoint turned_to = to;
      turned_from.altitude_m = -from.altitude_m;
      turned_to.altitude_m = -to.altitude_m;
      const verification::Sweep high =
          verification::sweep_surface(*turned_terrain_m_, turned_from, turned_to, 0.0);
      if (std::isnan(low.unknown_at) && std::isnan(low.outside_at)) {
        height = {low.clearance_min_m, -high.clearance_min_m};
      }
    }
    return verification::may_lie_within(area, altitude, height);
  }

  const map::Map& map_;
  double clearance_m_;
  std::vector<Span> spans_;
  std::vector<HardArea> areas_;
  std::optional<raster::Grid<float>> turned_terrain_m_;
};

struct Stray {
  double lateral_m = 0.0;
  double vertical_m = 0.0;
};

// Of a state from the leg between two others, at the nearest place of the leg seen from above.
Stray stray_of(const flight::FlightState& state, const flight::FlightState& from,
               const flight::FlightState& to) {
  const double dx_m = to.x_m - from.x_m;
  const double dy_m = to.y_m - from.y_m;
  const double length2_m2 = dx_m * dx_m + dy_m * dy_m;
  const double t =
      length2_m2 > 0.0
          ? std::clamp(((state.x_m - from.x_m) * dx_m + (state.y_m - from.y_m) * dy_m) / length2_m2,
                       0.0, 1.0)
          : 0.0;
  const double x_m = state.x_m - from.x_m - t * dx_m;
  const double y_m = state.y_m - from.y_m - t * dy_m;
  return {std::sqrt(x_m * x_m + y_m * y_m),
          std::fabs(state.altitude_m - from.altitude_m - t * (to.altitude_m - from.altitude_m))};
}

struct Leg {
  std::size_t from = 0;
  std::size_t to = 0;
};

// The state that strays most from a leg, if any strays too far.
std::optional<std::size_t> worst_state(const States& states, const Leg& leg,
                                       const LegOptions& options) {
  std::optional<std::size_t> worst;
  double greatest = 1.0;
  for (std::size_t i = leg.from + 1; i < leg.to; ++i) {
    const Stray stray = stray_of(states[i], states[leg.from], states[leg.to]);
    const double share = std::max(stray.lateral_m / options.lateral_tolerance_m,
                                  stray.vertical_m / options.vertical_tolerance_m);
    if (!(share <= greatest)) {
      greatest = share;
      worst = i;
    }
  }
  return worst;
}

// The state between the ends of a leg that is nearest to a place on it; the middle one if the place
// is not known.
std::size_t state_near(const States& states, const Leg& leg, double share) {
  if (std::isnan(share)) {
    return (leg.from + leg.to) / 2;
  }
  const flight::FlightState& from = states[leg.from];
  const flight::FlightState& to = states[leg.to];
  const double x_m = from.x_m + share * (to.x_m - from.x_m);
  const double y_m = from.y_m + share * (to.y_m - from.y_m);
  std::size_t nearest = leg.from + 1;
  double least_m2 = kInfinity;
  for (std::size_t i = leg.from + 1; i < leg.to; ++i) {
    const double dx_m = states[i].x_m - x_m;
    const double dy_m = states[i].y_m - y_m;
    if (dx_m * dx_m + dy_m * dy_m < least_m2) {
      least_m2 = dx_m * dx_m + dy_m * dy_m;
      nearest = i;
    }
  }
  return nearest;
}

}  // namespace

LegOptions read_leg_options(ConfigReader& reader) {
  LegOptions options;
  options.lateral_tolerance_m = reader.required_double("lateral_tolerance_m");
  options.vertical_tolerance_m = reader.required_double("vertical_tolerance_m");
  for (const char* key : {"lateral_tolerance_m", "vertical_tolerance_m"}) {
    const double value = key[0] == 'l' ? options.lateral_tolerance_m : options.vertical_tolerance_m;
    reader.require(value > 0.0 && value <= 1000.0, key, "must lie in (0, 1000]");
  }
  reader.finish();
  return options;
}

StraightLegs straight_legs(const flight::Trajectory& trajectory, const map::Map& map,
                           double clearance_m, const LegOptions& options) {
  const States& states = trajectory.states;
  if (states.size() < 2) {
    throw DataError("the flight has fewer than 2 states, so there are no legs",
                    "plan again, or restore the plan");
  }
  StraightLegs result;
  result.clearance_demanded_m = clearance_m;

  // Legs still to be looked at, the earliest on top.
  std::vector<Leg> open{{0, states.size() - 1}};
  std::vector<Leg> within;
  while (!open.empty()) {
    const Leg leg = open.back();
    open.pop_back();
    if (const auto worst = worst_state(states, leg, options)) {
      open.push_back({*worst, leg.to});
      open.push_back({leg.from, *worst});
    } else {
      within.push_back(leg);
    }
  }

  LegCheck check(map, clearance_m);
  open.assign(within.rbegin(), within.rend());
  result.states.push_back(0);
  result.clearance_min_m = kInfinity;
  while (!open.empty()) {
    const Leg leg = open.back();
    const auto split_at = [&](std::size_t state) {
      open.back() = {state, leg.to};
      open.push_back({leg.from, state});
      ++result.added;
    };
    // The halves of a leg that was split may stray where the whole did not.
    if (const auto worst = worst_state(states, leg, options)) {
      split_at(*worst);
      continue;
    }
    const PathPoint from = end_of_leg(states[leg.from]);
    const PathPoint to = end_of_leg(states[leg.to]);
    if (const auto fault = check.fault_of(from, to)) {
      if (leg.to == leg.from + 1) {
        char place[120];
        std::snprintf(place, sizeof place, " at %.2f s (x %.0f m, y %.0f m)",
                      states[leg.from].time_s, from.x_m, from.y_m);
        char demanded[40];
        std::snprintf(demanded, sizeof demanded, "%.2f m", clearance_m);
        throw UserError(ExitCode::kNotVerified,
                        "straight legs cannot hold a clearance of " + std::string(demanded) +
                            ": the flight itself " + fault->what + place,
                        "plan a flight that is verified, or ask for less with --clearance-m");
      }
      split_at(state_near(states, leg, fault->at));
      continue;
    }
    open.pop_back();
    result.states.push_back(leg.to);
    result.clearance_min_m = std::min(result.clearance_min_m, check.clearance_m(from, to));
    for (std::size_t i = leg.from + 1; i < leg.to; ++i) {
      const Stray stray = stray_of(states[i], states[leg.from], states[leg.to]);
      result.lateral_max_m = std::max(result.lateral_max_m, stray.lateral_m);
      result.vertical_max_m = std::max(result.vertical_max_m, stray.vertical_m);
    }
  }
  return result;
}

}  // namespace hedgehop::output
