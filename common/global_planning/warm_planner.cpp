#include "global_planning/warm_planner.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "global_planning/corridor_refinement.hpp"
#include "global_planning/lattice_route.hpp"
#include "global_planning/route_finish.hpp"
#include "global_planning/track_profile.hpp"

namespace hedgehop::global_planning {
namespace {

using flight::Waypoint;

constexpr double kCostStep_m = 1.0;
constexpr double kCompareStep_m = 4.0;
constexpr double kSample_m = 100.0;        // between the places of the old route that are judged
constexpr double kNear_m = 700.0;          // the way down the field keeps to it within this
constexpr double kChangeMargin_m = 300.0;  // a change this near counts
constexpr double kOnRoute_m = 1.0;
constexpr double kAboveFloor_m = 10.0;  // of the line along the way down the field
constexpr double kWayStep_m = 250.0;
constexpr double kBlocks = 2.0;  // of the field, in blocks of the one that leads plan_leg()
constexpr double kClimbShare = 0.95;
constexpr double kProfileStep_m = 10.0;
constexpr double kBlend_m = 1500.0;  // of the old route on both sides is replaced with a stretch
constexpr CorridorGrid kFirstGrid{250.0, 120.0, 30.0};
// Sideways moves with two heights, each followed by the lowest profile where the list says so.
struct Pass {
  CorridorGrid grid;
  int repeats;
  bool is_lowered;
};
constexpr std::array<Pass, 5> kPasses = {{{{250.0, 120.0, 25.0, true}, 3, false},
                                          {{200.0, 60.0, 15.0, true}, 3, true},
                                          {{200.0, 30.0, 10.0, true}, 2, false},
                                          {{150.0, 40.0, 8.0, true}, 2, false},
                                          {{150.0, 15.0, 5.0, true}, 1, true}}};
constexpr CorridorGrid kLatticeGrid{200.0, 60.0, 15.0};
constexpr double kGainMin = 0.002;  // for a pass to be repeated
constexpr std::int64_t kNoLimit = std::numeric_limits<std::int64_t>::max() / 2;
constexpr std::int64_t kLatticeWork = 150'000;

double plan_distance_m(const geo::MapPoint& a, const geo::MapPoint& b) {
  const double dx_m = b.x_m - a.x_m;
  const double dy_m = b.y_m - a.y_m;
  return std::sqrt(dx_m * dx_m + dy_m * dy_m);
}

/// A polyline that is asked for places by their distance along it, seen from above.
class Line {
 public:
  explicit Line(std::vector<Waypoint> points) : points_(std::move(points)), along_m_{0.0} {
    for (std::size_t i = 1; i < points_.size(); ++i) {
      along_m_.push_back(along_m_.back() +
                         plan_distance_m(points_[i - 1].point(), points_[i].point()));
    }
  }
  [[nodiscard]] double length_m() const { return along_m_.back(); }
  [[nodiscard]] Waypoint at(double along_m) const {
    const std::size_t leg = leg_at(along_m);
    const double leg_m = along_m_[leg] - along_m_[leg - 1];
    const double t =
        leg_m > 0.0 ? std::clamp((along_m - along_m_[leg - 1]) / leg_m, 0.0, 1.0) : 0.0;
    const Waypoint& a = points_[leg - 1];
    const Waypoint& b = points_[leg];
    if (t >= 1.0) {
      return b;  // to the last bit
    }
    return {a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m),
            a.altitude_m + t * (b.altitude_m - a.altitude_m)};
  }
  /// From one place to another, corners between them included.
  [[nodiscard]] std::vector<Waypoint> part(double from_m, double to_m) const {
    std::vector<Waypoint> part = {at(from_m)};
    for (std::size_t i = 0; i < points_.size(); ++i) {
      if (along_m_[i] > from_m + kOnRoute_m && along_m_[i] < to_m - kOnRoute_m) {
        part.push_back(points_[i]);
      }
    }
    part.push_back(at(to_m));
    return part;
  }
  struct Nearest {
    double along_m = 0.0;
    double distance_m = std::numeric_limits<double>::infinity();
  };
  [[nodiscard]] Nearest nearest(const geo::MapPoint& point) const {
    Nearest nearest;
    for (std::size_t i = 1; i < points_.size(); ++i) {
      const Waypoint& a = points_[i - 1];
      const double dx_m = points_[i].x_m - a.x_m;
      const double dy_m = points_[i].y_m - a.y_m;
      const double square_m2 = dx_m * dx_m + dy_m * dy_m;
      const double t =
          square_m2 > 0.0
              ? std::clamp(((point.x_m - a.x_m) * dx_m + (point.y_m - a.y_m) * dy_m) / square_m2,
                           0.0, 1.0)
              : 0.0;
      const double distance_m = plan_distance_m(point, {a.x_m + t * dx_m, a.y_m + t * dy_m});
      if (distance_m < nearest.distance_m) {
        nearest = {along_m_[i - 1] + t * std::sqrt(square_m2), distance_m};
      }
    }
    return nearest;
  }

 private:
  [[nodiscard]] std::size_t leg_at(double along_m) const {
    const auto after = std::lower_bound(along_m_.begin() + 1, along_m_.end() - 1, along_m);
    return static_cast<std::size_t>(after - along_m_.begin());
  }

  std::vector<Waypoint> points_;
  std::vector<double> along_m_;
};

void append(std::vector<Waypoint>& to, const std::vector<Waypoint>& more) {
  for (const Waypoint& point : more) {
    if (to.empty() || plan_distance_m(to.back().point(), point.point()) > 0.0) {
      to.push_back(point);
    }
  }
}

}  // namespace

WarmPlanner::WarmPlanner(const risk::CostModel& costs, const GlobalOptions& options,
                         const RouteProblem& problem, std::vector<Waypoint> route)
    : options_(options),
      problem_(problem),
      envelope_(costs, options, problem.start, problem.goal),
      field_(envelope_, problem.goal.point(), kBlocks * options.field_block_m),
      route_(std::move(route)) {}

void WarmPlanner::costs_changed(const raster::Window& cells) {
  changes_.push_back(cells);
  blocks_renewed_ += field_.repair(envelope_, cells);
}

bool WarmPlanner::is_changed(const geo::MapPoint& point) const {
  const raster::GridGeometry& g = envelope_.geometry();
  return std::any_of(changes_.begin(), changes_.end(), [&](const raster::Window& window) {
    const double west_m = g.west_m + window.column * g.cell_m - kChangeMargin_m;
    const double south_m = g.south_m + window.row * g.cell_m - kChangeMargin_m;
    return point.x_m >= west_m && point.y_m >= south_m &&
           point.x_m <= west_m + window.columns * g.cell_m + 2.0 * kChangeMargin_m &&
           point.y_m <= south_m + window.rows * g.cell_m + 2.0 * kChangeMargin_m;
  });
}

std::variant<WarmRoute, flight::NoPlan> WarmPlanner::replan(const Waypoint& start,
                                                            const Observer& observer) {
  problem_.start = start;
  problem_.lead_in.reset();
  envelope_.move_start(start);
  WarmRoute result;
  result.blocks_renewed = std::exchange(blocks_renewed_, 0);
  std::vector<Waypoint> route;
  if (envelope_.contains(start)) {
    route = repaired(start);
    if (route.empty()) {
      route = searched(observer);
    }
  }
  changes_.clear();
  if (route.empty()) {
    auto planned = plan_leg(envelope_.costs(), options_, problem_, {}, observer);
    if (auto* none = std::get_if<flight::NoPlan>(&planned)) {
      return std::move(*none);
    }
    result.route = std::get<flight::Route>(std::move(planned));
    result.is_cold = true;
    route_ = result.route.waypoints;
    return result;
  }
  route_ = route;
  result.route.waypoints = std::move(route);
  result.route.guide = equidistant(route_, options_.guide_spacing_m, result.route.guide_spacing_m);
  result.route.cost = envelope_.costs().route_cost(route_, kCostStep_m);
  result.route.lower_bound_m = std::min(flight::length_m({start, problem_.goal}) * (1.0 - 1e-9),
                                        result.route.cost.total_m());
  return result;
}

bool WarmPlanner::is_lawful(const std::vector<Waypoint>& route) const {
  for (std::size_t i = 1; i < route.size(); ++i) {
    if (!envelope_.is_clear(route[i - 1], route[i])) {
      return false;
    }
  }
  return are_turns_allowed(envelope_, route);
}

bool WarmPlanner::lower(std::vector<Waypoint>& route) const {
  std::vector<Waypoint> lowest = cheaper_profile(envelope_, route, kProfileStep_m, kCompareStep_m);
  if (lowest.empty() || !is_lawful(lowest)) {
    return false;
  }
  route = std::move(lowest);
  return true;
}

void WarmPlanner::improve(std::vector<Waypoint>& route, Waypoint from, Waypoint to,
                          std::int64_t& work_units) const {
  for (const Pass& pass : kPasses) {
    for (int repeat = 0; repeat < pass.repeats; ++repeat) {
      // The ends are waypoints of every route on the way; profiles change their altitudes.
      const auto place_of = [&](const Waypoint& end) {
        return std::find_if(route.begin(), route.end(), [&](const Waypoint& waypoint) {
          return waypoint.x_m == end.x_m && waypoint.y_m == end.y_m;
        });
      };
      const auto first = place_of(from);
      const auto last = place_of(to);
      if (first == route.end() || last == route.end() || last - first < 1) {
        return;
      }
      const std::vector<Waypoint> piece(first, last + 1);
      std::vector<Waypoint> better = corridor_route(
          envelope_, piece, pass.grid,
          first == route.begin() ? std::nullopt : std::optional(first[-1]),
          last + 1 == route.end() ? std::nullopt : std::optional(last[1]), work_units);
      if (better.empty()) {
        // A corner is too sharp for equal stations.
        const double before_m = envelope_.route_cost_m(route, kCostStep_m);
        const double after_m =
            sweep_corridor(envelope_, pass.grid, kNoLimit, work_units, route, before_m);
        if (!(before_m - after_m > kGainMin * before_m)) {
          break;
        }
        continue;
      }
      const double before_m = envelope_.route_cost_m(piece, kCompareStep_m);
      const double after_m = envelope_.route_cost_m(better, kCompareStep_m);
      std::vector<Waypoint> whole(route.begin(), first);
      whole.insert(whole.end(), better.begin(), better.end());
      whole.insert(whole.end(), last + 1, route.end());
      if (!(after_m < before_m) || !are_turns_allowed(envelope_, whole)) {
        break;
      }
      route = std::move(whole);
      if (!(before_m - after_m > kGainMin * before_m)) {
        break;
      }
    }
    if (pass.is_lowered) {
      lower(route);
    }
  }
}

// From the start to the goal on the lattice.
std::vector<Waypoint> WarmPlanner::searched(const Observer& observer) const {
  std::int64_t work_units = 0;
  std::vector<Waypoint> route = lattice_route(
      envelope_, options_, kLatticeWork, work_units,
      [&observer] { return observer.stop_requested(); }, &field_);
  if (route.empty()) {
    return {};
  }
  // Its corners are as sharp as they may be, which takes many heights and pieces.
  sweep_corridor(envelope_, kLatticeGrid, kNoLimit, work_units, route,
                 envelope_.route_cost_m(route, kCostStep_m));
  lower(route);
  improve(route, route.front(), route.back(), work_units);
  return is_lawful(route) ? route : std::vector<Waypoint>{};
}

std::vector<Waypoint> WarmPlanner::repaired(const Waypoint& start) const {
  const std::vector<geo::MapPoint> centres = field_.way_from(start.point());
  if (centres.empty()) {
    return {};
  }
  const Waypoint& goal = problem_.goal;
  // As low as the climb limit lets one fly there, start and goal left aside.
  std::vector<Waypoint> low = {start};
  for (const geo::MapPoint& centre : centres) {
    if (plan_distance_m(start.point(), centre) >= kWayStep_m &&
        plan_distance_m(centre, goal.point()) >= kWayStep_m) {
      low.push_back({centre.x_m, centre.y_m, envelope_.band_at(centre).low_m + kAboveFloor_m});
    }
  }
  low.push_back(goal);
  const auto raise = [&](Waypoint& point, const Waypoint& beside, bool is_beside_ahead) {
    const double way = is_beside_ahead ? 1.0 : -1.0;
    const SlopeLimits::Tangents limit = envelope_.slopes().at(
        beside.altitude_m, way * (beside.x_m - point.x_m), way * (beside.y_m - point.y_m));
    const double tangent = kClimbShare * (is_beside_ahead ? limit.up : limit.down);
    point.altitude_m =
        std::max(point.altitude_m,
                 beside.altitude_m - tangent * plan_distance_m(point.point(), beside.point()));
  };
  for (std::size_t i = 1; i + 1 < low.size(); ++i) {
    raise(low[i], low[i - 1], false);
  }
  for (std::size_t i = low.size() - 2; i > 0; --i) {
    raise(low[i], low[i + 1], true);
  }
  std::vector<Waypoint> down = {start};
  for (std::size_t i = 1; i + 1 < low.size(); ++i) {
    if (plan_distance_m(down.back().point(), low[i].point()) >= kWayStep_m) {
      down.push_back(low[i]);
      Waypoint& last = down.back();
      last.altitude_m = std::min(last.altitude_m, envelope_.band_at(last.point()).high_m);
    }
  }
  down.push_back(goal);
  const Line way(down);
  const Line old(route_);
  const Line::Nearest now = old.nearest(start.point());
  const bool is_on_route =
      now.distance_m <= kOnRoute_m &&
      std::fabs(old.at(now.along_m).altitude_m - start.altitude_m) <= kOnRoute_m;

  // Where the old route is good: from the start up to `good_until_m`, and again from `good_from_m`.
  const double length_m = old.length_m();
  const auto is_good = [&](double along_m) {
    const geo::MapPoint point = old.at(along_m).point();
    return !is_changed(point) && way.nearest(point).distance_m <= kNear_m;
  };
  double good_until_m = now.along_m;
  if (is_on_route) {
    while (good_until_m < length_m && is_good(std::min(good_until_m + kSample_m, length_m))) {
      good_until_m = std::min(good_until_m + kSample_m, length_m);
    }
  }
  double good_from_m = length_m;
  while (good_from_m > good_until_m && is_good(std::max(good_from_m - kSample_m, good_until_m))) {
    good_from_m = std::max(good_from_m - kSample_m, good_until_m);
  }
  std::vector<Waypoint> rest = old.part(now.along_m, length_m);
  rest.front() = start;
  const auto cost_m = [&](const std::vector<Waypoint>& line) {
    return envelope_.route_cost_m(line, kCostStep_m);
  };
  const bool may_stay = is_on_route && is_lawful(rest);
  if (may_stay && good_until_m >= length_m) {
    return rest;
  }

  const double leave_m =
      is_on_route && good_until_m - kBlend_m > now.along_m ? good_until_m - kBlend_m : now.along_m;
  const double join_m = good_from_m + kBlend_m < length_m ? good_from_m + kBlend_m : length_m;
  const bool keeps_head = leave_m > now.along_m;
  const bool keeps_tail = join_m < length_m;
  std::vector<Waypoint> head;
  if (keeps_head) {
    head = old.part(now.along_m, leave_m);
    head.front() = start;
  }
  std::vector<Waypoint> tail;
  if (keeps_tail) {
    tail = old.part(join_m, length_m);
  }
  // The line that is moved: old route, way down the field, old route.
  std::vector<Waypoint> line;
  if (keeps_head) {
    append(line, old.part(leave_m, good_until_m));
  } else {
    line.push_back(start);
    if (is_on_route && good_until_m > now.along_m + kSample_m) {
      append(line, old.part(now.along_m + kSample_m, good_until_m));
    }
  }
  const double way_from_m = way.nearest(line.back().point()).along_m;
  const Waypoint again = old.at(good_from_m);
  const double way_to_m =
      good_from_m < length_m ? way.nearest(again.point()).along_m : way.length_m();
  if (way_to_m > way_from_m + 2.0 * kWayStep_m) {
    append(line, way.part(way_from_m + kWayStep_m, way_to_m - kWayStep_m));
  }
  append(line, old.part(good_from_m, join_m));
  if (line.size() < 2) {
    line = {line.front(), keeps_tail ? tail.front() : goal};
  }
  const auto before = head.size() >= 2 ? std::optional(head[head.size() - 2]) : std::nullopt;
  const auto after = tail.size() >= 2 ? std::optional(tail[1]) : std::nullopt;
  const auto joined = [&](const std::vector<Waypoint>& piece) {
    std::vector<Waypoint> whole = head;
    append(whole, piece);
    append(whole, tail);
    return whole;
  };
  std::int64_t work_units = 0;
  const std::vector<Waypoint> piece =
      corridor_route(envelope_, line, kFirstGrid, before, after, work_units);
  if (piece.empty()) {
    return {};
  }
  std::vector<Waypoint> route = joined(piece);
  if (!is_lawful(route)) {
    return {};
  }
  improve(route, piece.front(), piece.back(), work_units);
  return may_stay && cost_m(rest) <= cost_m(route) ? rest : route;
}

}  // namespace hedgehop::global_planning
