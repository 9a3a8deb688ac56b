#include "global_planning/way_around.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "global_planning/lattice.hpp"
#include "global_planning/lattice_directions.hpp"
#include "global_planning/route_line.hpp"

namespace hedgehop::global_planning {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kLegMax_m = 400.0;  // where the route is left or joined
constexpr double kLeaveStep_m = 300.0;
// What lies ahead counts this many times; more when the search takes long.
constexpr double kInflation = 1.05;
constexpr double kHurriedInflation = 1.2;
constexpr std::int64_t kCalmWork = 4000;
constexpr int kWaysMax = 4;
constexpr std::int64_t kStopInterval = 256;
constexpr std::int8_t kEndMark = 100;

class Search {
 public:
  Search(const FlightEnvelope& envelope, const WaysToGoal& ways, const WayAroundQuestion& question)
      : envelope_(envelope),
        ways_(ways),
        lattice_(ways.lattice()),
        question_(question),
        newest_(lattice_.columns(), lattice_.rows()),
        changes_(ways.label_count(), Change::kUnknown) {}

  void find(std::int64_t work_budget, const std::function<bool()>& should_stop,
            const std::function<bool(const WayAround&)>& accept) {
    begin();
    int found = 0;
    std::int64_t until_asked = 0;
    while (!queue_.empty() && work_units_ < work_budget) {
      if (--until_asked < 0) {
        until_asked = kStopInterval;
        if (should_stop()) {
          return;
        }
      }
      if (!is_hurried_ && work_units_ >= kCalmWork) {
        hurry();
      }
      std::pop_heap(queue_.begin(), queue_.end(), kIsLater);
      const std::int32_t at = queue_.back().label;
      queue_.pop_back();
      const LatticeLabel label = labels_[static_cast<std::size_t>(at)];
      if (label.direction != kEndMark) {
        expand(at, label);
      } else if (accept(way_of(label)) || ++found == kWaysMax) {
        return;
      }
    }
  }

 private:
  enum class Change : std::uint8_t { kUnknown, kNone, kSome };

  // Corners of the route, where other labels have numbers of labels.
  [[nodiscard]] static std::int32_t corner_mark(std::size_t corner) {
    return -1 - static_cast<std::int32_t>(corner);
  }
  [[nodiscard]] static std::size_t corner_of(std::int32_t mark) {
    return static_cast<std::size_t>(-1 - mark);
  }

  [[nodiscard]] geo::MapPoint place(const LatticeLabel& label) const {
    return lattice_.place(label.column, label.row);
  }

  // Whether one of the ways leads through what has changed.
  [[nodiscard]] bool is_changed(std::int32_t way) {
    path_.clear();
    std::int32_t at = way;
    while (at >= 0 && changes_[static_cast<std::size_t>(at)] == Change::kUnknown) {
      path_.push_back(at);
      at = ways_.label(at).before;
    }
    Change change = at >= 0 ? changes_[static_cast<std::size_t>(at)] : Change::kNone;
    for (auto index = path_.rbegin(); index != path_.rend(); ++index) {
      const LatticeLabel& here = ways_.label(*index);
      const geo::MapPoint next =
          here.before < 0 ? envelope_.goal().point() : place(ways_.label(here.before));
      if (change == Change::kNone && question_.is_changed(place(here), next)) {
        change = Change::kSome;
      }
      changes_[static_cast<std::size_t>(*index)] = change;
    }
    return change == Change::kSome;
  }

  FlightEnvelope::Arrival follow(const geo::MapPoint& a, const geo::MapPoint& b,
                                 const AltitudeBand& altitudes, double owed_m, bool is_end_leg) {
    ++work_units_;
    const LatticeSpare spare = WaysToGoal::spare();
    return envelope_.follow(a, b, altitudes,
                            {is_end_leg ? kEndLegStep_m : kLatticeLegStep_m, spare.margin_m,
                             spare.climb_share, is_end_leg, false, true},
                            owed_m);
  }
  FlightEnvelope::Arrival follow(const LatticeLabel& from, const geo::MapPoint& b,
                                 bool is_end_leg) {
    return follow(place(from), b,
                  {static_cast<double>(from.low_m), static_cast<double>(from.high_m)},
                  static_cast<double>(from.owed_m), is_end_leg);
  }
  void queue_last(double key_m, double ahead_m) {
    ahead_m_.resize(labels_.size());
    ahead_m_.back() = ahead_m;
    queue_.push_back({key_m, static_cast<std::int32_t>(labels_.size() - 1)});
    std::push_heap(queue_.begin(), queue_.end(), kIsLater);
  }

  void hurry() {
    is_hurried_ = true;
    inflation_ = kHurriedInflation;
    for (LatticeEntry& entry : queue_) {
      const auto at = static_cast<std::size_t>(entry.label);
      entry.key_m = labels_[at].cost_m +
                    (labels_[at].direction == kEndMark ? 0.0 : inflation_ * ahead_m_[at]);
    }
    std::make_heap(queue_.begin(), queue_.end(), kIsLater);
  }

  // Free first legs from the start and from corners of the route, with the altitudes that can be
  // had there.
  void begin() {
    const std::vector<flight::Waypoint>& corners = question_.corners;
    AltitudeBand altitudes{corners.front().altitude_m, corners.front().altitude_m};
    double since_m = 0.0;
    for (std::size_t corner = 0; corner < question_.leaves; ++corner) {
      if (corner > 0) {
        const geo::MapPoint before = corners[corner - 1].point();
        const geo::MapPoint here = corners[corner].point();
        altitudes = follow(before, here, altitudes, 0.0, corner == 1).altitudes;
        if (!altitudes.is_flyable()) {
          return;
        }
        since_m += plan_distance_m(before, here);
        if (since_m < kLeaveStep_m) {
          continue;
        }
        since_m = 0.0;
      }
      leave(corner, altitudes);
    }
  }

  void leave(std::size_t corner, const AltitudeBand& altitudes) {
    const double spacing_m = lattice_.spacing_m();
    const double most_m = corner == 0 ? kEndLegMax_m : kLegMax_m;
    const int reach = static_cast<int>(most_m / spacing_m) + 1;
    const flight::Waypoint& from = question_.corners[corner];
    const geo::MapPoint origin = lattice_.place(0, 0);
    const int column = static_cast<int>(std::floor((from.x_m - origin.x_m) / spacing_m));
    const int row = static_cast<int>(std::floor((from.y_m - origin.y_m) / spacing_m));
    for (int r = row - reach; r <= row + reach; ++r) {
      for (int c = column - reach; c <= column + reach; ++c) {
        const geo::MapPoint to = lattice_.place(c, r);
        const double x_m = to.x_m - from.x_m;
        const double y_m = to.y_m - from.y_m;
        const double square_m2 = x_m * x_m + y_m * y_m;
        if (!lattice_.contains(c, r) || square_m2 > most_m * most_m || !(square_m2 > 0.0) ||
            !may_leave(corner, x_m, y_m)) {
          continue;
        }
        const FlightEnvelope::Arrival arrival =
            follow(from.point(), to, altitudes, 0.0, corner == 0);
        if (arrival.altitudes.is_flyable()) {
          LatticeLabel label = label_of(arrival, question_.cost_m[corner], c, r, -1);
          label.before = corner_mark(corner);
          label.run_x_m = x_m;
          label.run_y_m = y_m;
          add(label);
        }
      }
    }
  }

  [[nodiscard]] bool may_leave(std::size_t corner, double x_m, double y_m) const {
    if (corner == 0) {
      return envelope_.may_leave_start(x_m, y_m);
    }
    const flight::Waypoint& before = question_.corners[corner - 1];
    const flight::Waypoint& here = question_.corners[corner];
    return envelope_.is_turn_allowed(here.x_m - before.x_m, here.y_m - before.y_m, x_m, y_m);
  }

  // What the ways say from an arrival on.
  struct Ahead {
    double cost_m = kInfinity;       // about, on whatever way
    double unchanged_m = kInfinity;  // on one through nothing that has changed
    std::int32_t unchanged = -1;     // that way
  };
  [[nodiscard]] Ahead ahead_of(const LatticeLabel& label) {
    Ahead ahead;
    const double dearer_m = question_.dearer_m(place(label));
    const auto look = [&](int direction) {
      for (std::int32_t at = ways_.newest(label.column, label.row, direction); at >= 0;
           at = ways_.label(at).next) {
        const LatticeLabel& way = ways_.label(at);
        if (way.low_m > label.high_m || way.high_m < label.low_m ||
            (way.cost_m >= ahead.unchanged_m && way.cost_m + dearer_m >= ahead.cost_m) ||
            (direction != label.direction &&
             !envelope_.is_turn_allowed(label.run_x_m, label.run_y_m, -way.run_x_m,
                                        -way.run_y_m))) {
          continue;
        }
        if (is_changed(at)) {
          ahead.cost_m = std::min(ahead.cost_m, std::max(0.0, way.cost_m + dearer_m));
          continue;
        }
        // Where all has become cheaper there may be a better one.
        ahead.cost_m = std::min(ahead.cost_m, way.cost_m + std::min(dearer_m, 0.0));
        if (way.cost_m < ahead.unchanged_m) {
          ahead.unchanged_m = way.cost_m;
          ahead.unchanged = at;
        }
      }
    };
    if (label.direction >= 0) {
      look(label.direction);
    }
    for_each_turn(label.direction, look);
    return ahead;
  }

  void add(const LatticeLabel& label) {
    const Ahead ahead = label.low_m <= label.high_m ? ahead_of(label) : Ahead{};
    if (!(ahead.cost_m < kInfinity)) {
      return;
    }
    if (label.direction < 0) {
      labels_.push_back(label);
    } else if (!add_label(labels_, newest_.at(label.column, label.row, label.direction), label)) {
      return;
    }
    const auto index = static_cast<std::int32_t>(labels_.size() - 1);
    if (ahead.cost_m < ahead.unchanged_m) {
      queue_last(label.cost_m + inflation_ * ahead.cost_m, ahead.cost_m);
    }
    if (ahead.unchanged >= 0) {
      add_end(index, ahead.unchanged, label.cost_m + ahead.unchanged_m);
    }
  }

  // A whole route: `onto` is one of the ways, or the mark of a corner.
  void add_end(std::int32_t index, std::int32_t onto, double cost_m) {
    LatticeLabel end = labels_[static_cast<std::size_t>(index)];
    end.direction = kEndMark;
    end.before = index;
    end.next = onto;
    end.cost_m = cost_m;
    labels_.push_back(end);
    queue_last(cost_m, 0.0);
  }

  void expand(std::int32_t index, const LatticeLabel& label) {
    const auto step_to = [&](int direction, int times) {
      const auto& offset = kLatticeStep[static_cast<std::size_t>(direction)];
      step(index, label, label.column + times * offset[0], label.row + times * offset[1],
           direction);
    };
    if (label.direction >= 0) {
      step_to(label.direction, 1);
    }
    for_each_turn(label.direction, [&](int d) { step_to(d, lattice_.repeats(d)); });
    if (const Join join = cheapest_join(label); join.cost_m < kInfinity) {
      add_end(index, corner_mark(join.corner), join.cost_m);
    }
  }

  void step(std::int32_t index, const LatticeLabel& from, int column, int row, int direction) {
    if (!lattice_.contains(column, row)) {
      return;
    }
    const geo::MapPoint a = place(from);
    const geo::MapPoint b = lattice_.place(column, row);
    double run_x_m = b.x_m - a.x_m;
    double run_y_m = b.y_m - a.y_m;
    if (direction == from.direction) {
      run_x_m += from.run_x_m;
      run_y_m += from.run_y_m;
    } else if (!envelope_.is_turn_allowed(from.run_x_m, from.run_y_m, run_x_m, run_y_m)) {
      return;
    }
    const FlightEnvelope::Arrival arrival = follow(from, b, false);
    if (arrival.altitudes.is_flyable()) {
      LatticeLabel label = label_of(arrival, from.cost_m, column, row, direction);
      label.before = index;
      label.run_x_m = run_x_m;
      label.run_y_m = run_y_m;
      add(label);
    }
  }

  struct Join {
    std::size_t corner = 0;
    double cost_m = kInfinity;  // of the whole route
  };
  [[nodiscard]] Join cheapest_join(const LatticeLabel& label) {
    const std::vector<flight::Waypoint>& corners = question_.corners;
    const geo::MapPoint a = place(label);
    Join best;
    for (std::size_t corner = question_.joins_from; corner < corners.size(); ++corner) {
      const flight::Waypoint& to = corners[corner];
      const double x_m = to.x_m - a.x_m;
      const double y_m = to.y_m - a.y_m;
      const double square_m2 = x_m * x_m + y_m * y_m;
      const double without_leg_m =
          label.cost_m + question_.cost_m.back() - question_.cost_m[corner];
      const bool is_goal = corner + 1 == corners.size();
      if (square_m2 > kLegMax_m * kLegMax_m || !(square_m2 > 0.0) ||
          !(without_leg_m + std::sqrt(square_m2) < best.cost_m) ||
          !envelope_.is_turn_allowed(label.run_x_m, label.run_y_m, x_m, y_m) ||
          (!is_goal && !envelope_.is_turn_allowed(x_m, y_m, corners[corner + 1].x_m - to.x_m,
                                                  corners[corner + 1].y_m - to.y_m))) {
        continue;
      }
      const FlightEnvelope::Arrival arrival = follow(label, to.point(), is_goal);
      // What follows can be flown from above: it was as low as it may be.
      if (arrival.altitudes.is_flyable() && to.altitude_m <= arrival.altitudes.high_m &&
          (!is_goal || arrival.altitudes.low_m <= to.altitude_m) &&
          without_leg_m + arrival.cost_m < best.cost_m) {
        best = {corner, without_leg_m + arrival.cost_m};
      }
    }
    return best;
  }

  [[nodiscard]] WayAround way_of(const LatticeLabel& end) {
    WayAround way;
    std::vector<geo::MapPoint> nodes;
    std::int32_t at = end.before;
    for (; at >= 0; at = labels_[static_cast<std::size_t>(at)].before) {
      nodes.push_back(place(labels_[static_cast<std::size_t>(at)]));
    }
    way.leave = corner_of(at);
    nodes.push_back(question_.corners[way.leave].point());
    std::reverse(nodes.begin(), nodes.end());
    way.join = end.next < 0 ? corner_of(end.next) : go_on(end, nodes);
    nodes.push_back(question_.corners[way.join].point());
    way.track = lattice_corners(nodes, lattice_.spacing_m());
    return way;
  }

  // Adds nodes along one of the ways until the corner that is joined at the least cost.
  std::size_t go_on(const LatticeLabel& end, std::vector<geo::MapPoint>& nodes) {
    LatticeLabel here = labels_[static_cast<std::size_t>(end.before)];
    double last_run_x_m = 0.0;  // before the last corner
    double last_run_y_m = 0.0;
    bool has_turned = false;
    bool is_followed = true;
    Join best{question_.corners.size() - 1, end.cost_m};
    std::size_t best_nodes = 0;
    for (std::int32_t at = end.next; ways_.label(at).before >= 0; at = ways_.label(at).before) {
      const LatticeLabel& there = ways_.label(ways_.label(at).before);
      const geo::MapPoint b = place(there);
      nodes.push_back(b);
      if (!is_followed) {
        continue;
      }
      const geo::MapPoint a = place(here);
      const FlightEnvelope::Arrival arrival = follow(here, b, false);
      is_followed = arrival.altitudes.is_flyable();
      LatticeLabel next = label_of(arrival, here.cost_m, there.column, there.row, -1);
      next.run_x_m = b.x_m - a.x_m;
      next.run_y_m = b.y_m - a.y_m;
      if (std::fabs(here.run_x_m * next.run_y_m - here.run_y_m * next.run_x_m) > 1e-3) {
        last_run_x_m = here.run_x_m;
        last_run_y_m = here.run_y_m;
        has_turned = true;
      } else {
        next.run_x_m += here.run_x_m;
        next.run_y_m += here.run_y_m;
      }
      here = next;
      // The way turned for a run that goes on; one that ends here may be too short.
      if (!is_followed || (has_turned && !envelope_.is_turn_allowed(last_run_x_m, last_run_y_m,
                                                                    here.run_x_m, here.run_y_m))) {
        continue;
      }
      if (const Join join = cheapest_join(here); join.cost_m < best.cost_m) {
        best = join;
        best_nodes = nodes.size();
      }
    }
    if (best_nodes > 0) {
      nodes.resize(best_nodes);
    }
    return best.corner;
  }

  const FlightEnvelope& envelope_;
  const WaysToGoal& ways_;
  const Lattice& lattice_;
  const WayAroundQuestion& question_;
  NewestLabels newest_;
  std::vector<Change> changes_;     // of the ways
  std::vector<std::int32_t> path_;  // while one of them is looked at
  std::vector<LatticeLabel> labels_;
  std::vector<double> ahead_m_;  // of labels_
  std::vector<LatticeEntry> queue_;
  std::int64_t work_units_ = 0;
  bool is_hurried_ = false;
  double inflation_ = kInflation;
};

}  // namespace

void find_ways_around(const FlightEnvelope& envelope, const WaysToGoal& ways,
                      const WayAroundQuestion& question, std::int64_t work_budget,
                      const std::function<bool()>& should_stop,
                      const std::function<bool(const WayAround&)>& accept) {
  Search(envelope, ways, question).find(work_budget, should_stop, accept);
}

}  // namespace hedgehop::global_planning
