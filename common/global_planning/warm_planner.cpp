#include "global_planning/warm_planner.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "global_planning/lattice_route.hpp"
#include "global_planning/lattice_search.hpp"
#include "global_planning/low_corridor.hpp"
#include "global_planning/route_finish.hpp"
#include "global_planning/track_profile.hpp"
#include "global_planning/way_around.hpp"

namespace hedgehop::global_planning {
namespace {

using flight::Waypoint;

constexpr double kCostStep_m = 1.0;
constexpr double kCompareStep_m = 4.0;
constexpr double kChangeMargin_m = 300.0;  // a change this near counts
constexpr double kOnRoute_m = 1.0;
constexpr double kBlocks = 2.0;  // of the field, in blocks of the one that leads plan_leg()
constexpr double kProfileStep_m = 10.0;
// So much of the old route on both sides is moved with a new part. Where it climbs or descends as
// steeply as it may there, no moved part fits between its altitudes, but a longer one may.
constexpr std::array<double, 3> kBlends_m = {1500.0, 3000.0, 6000.0};
// A sweep over a corridor, which is repeated while it pays.
struct Pass {
  LowCorridorGrid grid;
  int repeats;
};
constexpr std::array<Pass, 3> kPasses = {
    {{{200.0, 60.0}, 2}, {{150.0, 25.0}, 1}, {{150.0, 10.0}, 1}}};
constexpr double kGainMin = 0.002;  // for a pass to be repeated
constexpr std::int64_t kLatticeWork = 150'000;
constexpr std::int64_t kPartWork = 15'000;
constexpr std::int64_t kFirstPartWork = 9'000;  // nine in ten that are found are found by then
constexpr std::int64_t kWaysWork = 2'500'000;
constexpr std::int64_t kWayAroundWork = 20'000;
struct Elsewhere {
  double earlier_m, farther_m;
};
// Where no way is found from its end, others that leave so much earlier and join so much farther
// are looked for.
constexpr std::array<Elsewhere, 2> kElsewhere = {{{0.0, 0.0}, {1500.0, 1000.0}}};
constexpr double kPartAside_m = 3000.0;
// As of lattice_route().
constexpr std::array<LatticeSpare, 2> kPartSpares = {{{2.0, 0.97}, {6.0, 0.85}}};
constexpr double kHigherMax_m = 100.0;  // where a part leaves the route
constexpr double kHigherShare = 0.07;   // of what was flown until there: half of a climb

void append(std::vector<Waypoint>& to, const std::vector<Waypoint>& more) {
  for (const Waypoint& point : more) {
    if (to.empty() || plan_distance_m(to.back().point(), point.point()) > 0.0) {
      to.push_back(point);
    }
  }
}

// Whether the box around a leg comes as near to cells as that.
bool comes_near(const raster::GridGeometry& geometry, const raster::Window& window, double near_m,
                const geo::MapPoint& a, const geo::MapPoint& b) {
  const double west_m = geometry.west_m + window.column * geometry.cell_m - near_m;
  const double south_m = geometry.south_m + window.row * geometry.cell_m - near_m;
  return std::max(a.x_m, b.x_m) >= west_m && std::max(a.y_m, b.y_m) >= south_m &&
         std::min(a.x_m, b.x_m) <= west_m + window.columns * geometry.cell_m + 2.0 * near_m &&
         std::min(a.y_m, b.y_m) <= south_m + window.rows * geometry.cell_m + 2.0 * near_m;
}

LeadIn leg_between(const Waypoint& a, const Waypoint& b) { return {b.x_m - a.x_m, b.y_m - a.y_m}; }

}  // namespace

WarmPlanner::WarmPlanner(const risk::CostModel& costs, const GlobalOptions& options,
                         const RouteProblem& problem, std::vector<Waypoint> route)
    : options_(options),
      problem_(problem),
      envelope_(costs, options, problem.start, problem.goal),
      field_(envelope_, problem.goal.point(), kBlocks * options.field_block_m),
      route_(std::move(route)),
      first_field_(std::make_shared<const CostField>(field_)) {
  judge_field();
  const CostField from_start(field_, problem.start.point(), problem.goal.point());
  ways_ = std::make_shared<const WaysToGoal>(envelope_, options, from_start, kWaysWork);
}

void WarmPlanner::judge_field() {
  const double field_m = field_.cost_m(route_.front().point());
  cost_per_field_ = envelope_.route_cost_m(route_, kCompareStep_m) / field_m;
  if (!(cost_per_field_ > 0.0) || !std::isfinite(cost_per_field_)) {
    cost_per_field_ = 1.0;
  }
}

void WarmPlanner::costs_changed(const raster::Window& cells) {
  changes_.push_back(cells);
  blocks_renewed_ += field_.repair(envelope_, cells);
}

bool WarmPlanner::is_changed(const geo::MapPoint& a, const geo::MapPoint& b, double near_m) const {
  return std::any_of(changes_.begin(), changes_.end(), [&](const raster::Window& window) {
    return comes_near(envelope_.geometry(), window, near_m, a, b);
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
    route = repaired(start, observer);
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
    judge_field();
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

bool WarmPlanner::improve(std::vector<Waypoint>& route, const Waypoint& from,
                          const Waypoint& to) const {
  // The ends are waypoints of the route; profiles keep them.
  const auto place_of = [&](const Waypoint& end) {
    return std::find_if(route.begin(), route.end(), [&](const Waypoint& waypoint) {
      return waypoint.x_m == end.x_m && waypoint.y_m == end.y_m;
    });
  };
  const auto first = place_of(from);
  const auto last = place_of(to);
  if (first == route.end() || last == route.end() || last - first < 2) {
    return false;
  }
  const auto before = first == route.begin() ? std::nullopt : std::optional(first[-1]);
  const auto after = last + 1 == route.end() ? std::nullopt : std::optional(last[1]);
  std::vector<Waypoint> line(first, last + 1);
  std::vector<geo::MapPoint> track;
  double cost_m = envelope_.route_cost_m(line, kCompareStep_m);
  for (const Pass& pass : kPasses) {
    for (int repeat = 0; repeat < pass.repeats; ++repeat) {
      const std::vector<geo::MapPoint> better =
          low_corridor_track(envelope_, line, pass.grid, before, after);
      if (better.empty()) {
        break;
      }
      std::vector<Waypoint> low = lowest_line(envelope_, better, line.front().altitude_m,
                                              line.back().altitude_m, kProfileStep_m);
      const double before_m = cost_m;
      const double after_m = low.empty() ? before_m : envelope_.route_cost_m(low, kCompareStep_m);
      if (!(after_m < before_m)) {
        break;
      }
      line = std::move(low);
      track = better;
      cost_m = after_m;
      if (!(before_m - after_m > kGainMin * before_m)) {
        break;
      }
    }
  }
  if (track.empty()) {
    return false;
  }
  std::vector<geo::MapPoint> whole;
  for (auto at = route.cbegin(); at != first; ++at) {
    whole.push_back(at->point());
  }
  whole.insert(whole.end(), track.begin(), track.end());
  for (auto at = last + 1; at != route.end(); ++at) {
    whole.push_back(at->point());
  }
  std::vector<Waypoint> better = lowest_profile(envelope_, whole, kProfileStep_m);
  if (better.empty() || !are_turns_allowed(envelope_, better) ||
      !(envelope_.route_cost_m(better, kCompareStep_m) <
        envelope_.route_cost_m(route, kCompareStep_m))) {
    return false;
  }
  route = std::move(better);
  return true;
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
  improve(route, Waypoint(route.front()), Waypoint(route.back()));
  return is_lawful(route) ? route : std::vector<Waypoint>{};
}

std::vector<Waypoint> WarmPlanner::from_start(const RouteLine& old, double along_m) const {
  const auto ahead = static_cast<std::size_t>(
      std::upper_bound(old.along_m().begin(), old.along_m().end(), along_m + kOnRoute_m) -
      old.along_m().begin());
  // A corner soon after the start is left out where there is no room for its turn.
  for (std::size_t first = ahead; first < old.points().size(); ++first) {
    std::vector<Waypoint> line = {problem_.start};
    line.insert(line.end(), old.points().begin() + static_cast<std::ptrdiff_t>(first),
                old.points().end());
    if (are_turns_allowed(envelope_, line)) {
      return line;
    }
    if (old.along_m()[first] > along_m + kBlends_m.front()) {
      break;
    }
  }
  return {};
}

std::vector<Waypoint> WarmPlanner::flown(const std::vector<Waypoint>& line, std::size_t leave,
                                         std::size_t join,
                                         const std::vector<geo::MapPoint>& track) const {
  std::vector<geo::MapPoint> whole;
  for (std::size_t i = 0; i < leave; ++i) {
    whole.push_back(line[i].point());
  }
  whole.insert(whole.end(), track.begin(), track.end());
  for (std::size_t i = join + 1; i < line.size(); ++i) {
    whole.push_back(line[i].point());
  }
  std::vector<Waypoint> route = lowest_profile(envelope_, whole, kProfileStep_m);
  return !route.empty() && are_turns_allowed(envelope_, route) ? route : std::vector<Waypoint>{};
}

std::vector<Waypoint> WarmPlanner::around(const std::vector<Waypoint>& line, std::size_t leave,
                                          std::size_t join, double aside_m, FromEnd from_end,
                                          const Observer& observer) const {
  LatticePart part{line[leave], line[join], std::nullopt, std::nullopt, 0.0, aside_m};
  if (leave > 0) {
    part.lead_in = leg_between(line[leave - 1], line[leave]);
    const double flown_m =
        flight::length_m({line.begin(), line.begin() + static_cast<std::ptrdiff_t>(leave) + 1});
    part.higher_m = std::min(kHigherMax_m, kHigherShare * flown_m);
  }
  if (join + 1 < line.size()) {
    part.lead_out = leg_between(line[join], line[join + 1]);
  }
  const auto should_stop = [&observer] { return observer.stop_requested(); };
  std::optional<CostField> to_from;
  part.is_backward = from_end == FromEnd::kJoin;
  if (part.is_backward) {
    to_from.emplace(field_, part.from.point(), part.to.point());
  }
  for (const LatticeSpare& spare : kPartSpares) {
    const LatticeResult found = search_lattice(envelope_, options_, spare, part,
                                               part.is_backward ? kPartWork : kFirstPartWork,
                                               should_stop, to_from ? *to_from : field_);
    if (found.track.empty()) {
      break;
    }
    if (std::vector<Waypoint> route = flown(line, leave, join, found.track); !route.empty()) {
      return route;
    }
  }
  return {};
}

WarmPlanner::Changed WarmPlanner::around(const std::vector<Waypoint>& line, const Detour& detour,
                                         double old_m, bool is_on_route, FromEnd from_end,
                                         const Observer& observer) const {
  const RouteLine along(line);
  const double behind_m = old_m - along.length_m();  // of the old route, about
  // Corners of the old route take the places of those between which a way is looked for.
  const auto corner_until = [&](double along_m) {
    std::size_t corner = 0;
    while (corner + 2 < line.size() && is_on_route &&
           along.along_m()[corner + 1] + behind_m <= along_m) {
      ++corner;
    }
    return corner;
  };
  const auto corner_from = [&](std::size_t after, double along_m) {
    std::size_t corner = after + 1;
    while (corner + 1 < line.size() && along.along_m()[corner] + behind_m < along_m) {
      ++corner;
    }
    return corner;
  };
  for (const Elsewhere& elsewhere : kElsewhere) {
    // Where the way leads to the end, the last stretch of the old route is one that exists.
    const double join_m = detour.join_m < old_m ? detour.join_m + elsewhere.farther_m
                                                : detour.join_m - 2.0 * elsewhere.farther_m;
    Changed found;
    found.leave = corner_until(detour.leave_m - elsewhere.earlier_m);
    found.join = corner_from(found.leave, join_m);
    found.route =
        around(line, found.leave, found.join, kPartAside_m + detour.aside_m, from_end, observer);
    if (!found.route.empty()) {
      return found;
    }
    if (from_end == FromEnd::kLeave) {
      break;
    }
  }
  return {};
}

WarmPlanner::Changed WarmPlanner::by_ways(const std::vector<Waypoint>& line,
                                          const std::vector<Waypoint>& stay, bool is_on_route,
                                          const Observer& observer) const {
  WayAroundQuestion question;
  question.corners = line;
  question.cost_m = {0.0};
  double cost_m = 0.0;
  for (std::size_t i = 1; i < stay.size(); ++i) {
    cost_m += envelope_.route_cost_m({stay[i - 1], stay[i]}, kCompareStep_m);
    if (stay[i] == line[question.cost_m.size()]) {
      question.cost_m.push_back(cost_m);
    }
  }
  bool has_changed = !is_on_route;
  for (std::size_t i = 1; i + 1 < line.size(); ++i) {
    if (is_changed(line[i - 1].point(), line[i].point(), 0.0)) {
      has_changed = true;
      question.joins_from = i;
    }
    question.leaves = has_changed ? question.leaves : i + 1;
  }
  if (is_changed(line[line.size() - 2].point(), line.back().point(), 0.0)) {
    question.joins_from = line.size() - 1;
  }
  question.is_changed = [&](const geo::MapPoint& a, const geo::MapPoint& b) {
    return !field_.costs_as(*first_field_, a, b);
  };
  question.dearer_m = [&](const geo::MapPoint& at) {
    const double dearer_m = cost_per_field_ * (field_.cost_m(at) - first_field_->cost_m(at));
    return std::isfinite(dearer_m) ? dearer_m : 0.0;  // no way there, then as now
  };
  Changed found;
  find_ways_around(
      envelope_, *ways_, question, kWayAroundWork,
      [&observer] { return observer.stop_requested(); },
      [&](const WayAround& way) {
        found = {flown(line, way.leave, way.join, way.track), way.leave, way.join};
        return !found.route.empty();
      });
  return found;
}

std::vector<Waypoint> WarmPlanner::repaired(const Waypoint& start, const Observer& observer) const {
  const RouteLine old(route_);
  const RouteLine::Nearest now = old.nearest(start.point());
  const bool is_on_route =
      now.distance_m <= kOnRoute_m &&
      std::fabs(old.at(now.along_m).altitude_m - start.altitude_m) <= kOnRoute_m;
  const std::optional<Detour> detour = find_detour(
      envelope_, field_, old,
      {now.along_m, is_on_route, cost_per_field_,
       [&](const geo::MapPoint& point) { return is_changed(point, point, kChangeMargin_m); }});
  std::vector<Waypoint> line = is_on_route ? from_start(old, now.along_m) : std::vector<Waypoint>{};
  if (!detour) {
    return is_lawful(line) ? line : std::vector<Waypoint>{};
  }
  if (line.empty()) {
    line = {start};
    append(line, old.part(std::min(now.along_m + kOnRoute_m, old.length_m()), old.length_m()));
  }
  const std::vector<Waypoint> stay = std::exchange(line, corners_of(line));
  const RouteLine along(line);
  Changed found = around(line, *detour, old.length_m(), is_on_route, FromEnd::kLeave, observer);
  if (found.route.empty()) {
    found = by_ways(line, stay, is_on_route, observer);
  }
  if (found.route.empty()) {
    found = around(line, *detour, old.length_m(), is_on_route, FromEnd::kJoin, observer);
  }
  if (found.route.empty()) {
    return {};
  }
  std::vector<Waypoint>& route = found.route;
  std::size_t from = found.leave;
  std::size_t to = found.join;
  for (const double blend_m : kBlends_m) {
    const std::size_t from_before = from;
    const std::size_t to_before = to;
    while (from > 0 && along.along_m()[from] > along.along_m()[found.leave] - blend_m) {
      --from;
    }
    while (to + 1 < line.size() && along.along_m()[to] < along.along_m()[found.join] + blend_m) {
      ++to;
    }
    const bool is_longer = blend_m == kBlends_m.front() || from < from_before || to > to_before;
    if (is_longer && improve(route, line[from], line[to])) {
      break;
    }
  }
  const auto cost_m = [&](const std::vector<Waypoint>& whole) {
    return envelope_.route_cost_m(whole, kCompareStep_m);
  };
  return is_on_route && cost_m(stay) <= cost_m(route) && is_lawful(stay) ? stay : route;
}

}  // namespace hedgehop::global_planning
