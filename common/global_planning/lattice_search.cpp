#include "global_planning/lattice_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <limits>
#include <numbers>
#include <optional>

#include "base/elementary.hpp"
#include "global_planning/cost_field.hpp"
#include "global_planning/lattice_directions.hpp"

namespace hedgehop::global_planning {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kTurnMax_rad = 0.46364760900080609;  // between (1, 0) and (2, 1)
// The band is sampled this densely; the profile is exact afterwards.
constexpr double kStep_m = 15.0;
// First and last leg, where there is no spare for what lies between the samples; they are sampled
// on each crest too.
constexpr double kEndStep_m = 2.5;
// A label is as good as another whose interval is smaller by this at either end.
constexpr double kIntervalTolerance_m = 3.0;
constexpr int kLabelsMax = 6;  // of one node and direction
constexpr double kEndLegMax_m = 600.0;
// Detours stay this near to the box around both ends, and half of its longer side more.
constexpr double kAsideMin_m = 20000.0;
// The way ahead counts this many times: real flights cost more than the field says, and the first
// track need not be the best, as it is refined. With more the track is found sooner and worse.
constexpr double kInflation = 1.2;
constexpr double kHurriedInflation = 1.4;
constexpr double kPartInflation = 1.4;  // of parts, which are moved most afterwards
constexpr std::int64_t kStopInterval = 256;
// The search from the start is alone, and in no hurry, for so long; most problems need less.
constexpr std::int64_t kAloneWork = 60000;

struct Label {
  double cost_m;
  float low_m, high_m;
  float owed_m;  // see FlightEnvelope::Arrival
  std::int32_t column, row;
  std::int32_t before;      // label, -1: start
  std::int32_t next;        // label of the same node and direction
  double run_x_m, run_y_m;  // straight leg so far
  std::int8_t direction;    // -1: none of the sixteen
};

struct Entry {
  double key_m;
  std::int32_t label;
};
constexpr auto kIsLater = [](const Entry& a, const Entry& b) {
  return a.key_m != b.key_m ? a.key_m > b.key_m : a.label > b.label;
};

/// The newest label of each node and direction; -1: none. Memory only for squares of nodes that the
/// search comes to.
class NewestLabels {
 public:
  void resize(int columns, int rows) {
    squares_wide_ = (columns + kSide - 1) / kSide;
    squares_.assign(static_cast<std::size_t>(squares_wide_) *
                        static_cast<std::size_t>((rows + kSide - 1) / kSide),
                    -1);
  }
  std::int32_t& at(int column, int row, int direction) {
    std::int32_t& square =
        squares_[static_cast<std::size_t>((row / kSide) * squares_wide_ + column / kSide)];
    if (square < 0) {
      square = static_cast<std::int32_t>(labels_.size());
      labels_.emplace_back().fill(-1);
    }
    return labels_[static_cast<std::size_t>(square)][static_cast<std::size_t>(
        ((row % kSide) * kSide + column % kSide) * kLatticeDirections + direction)];
  }

 private:
  static constexpr int kSide = 8;

  int squares_wide_ = 0;
  std::vector<std::int32_t> squares_;  // index in labels_
  std::deque<std::array<std::int32_t, static_cast<std::size_t>(kSide* kSide* kLatticeDirections)>>
      labels_;
};

class Search {
 public:
  Search(const FlightEnvelope& envelope, const GlobalOptions& options, const LatticeSpare& spare,
         const flight::Waypoint& from, const flight::Waypoint& to, const CostField* field,
         bool is_backward, const LatticePart* part = nullptr)
      : envelope_(envelope),
        spare_(spare),
        from_(from),
        to_(to),
        is_backward_(is_backward),
        part_(part),
        field_(field) {
    if (part_ != nullptr) {
      inflation_ = kPartInflation;
      beyond_m_ = field->cost_m(to.point());
    }
    if (field_ == nullptr) {
      own_field_.emplace(envelope, to.point(), options.field_block_m);
    }
    const raster::GridGeometry& geometry = envelope.geometry();
    const double turn_tangent = elementary::tan(0.5 * kTurnMax_rad);
    spacing_m_ = std::max(options.turn_radius_m * turn_tangent * 1.001, 2.0 * geometry.cell_m);
    // Legs beside a corner hold the tangents of its arc.
    const double unit_tangent = 2.0 * turn_tangent;
    const double knight_tangent =
        2.0 * elementary::tan(0.5 * (0.25 * std::numbers::pi - kTurnMax_rad));
    const TurnLimit turns = options.turns();
    for (int d = 0; d < kLatticeDirections; ++d) {
      const auto& step = kLatticeStep[static_cast<std::size_t>(d)];
      const double length_m =
          spacing_m_ * std::sqrt(static_cast<double>(step[0] * step[0] + step[1] * step[1]));
      const auto radius_beside_m = [&](int turned) {
        const auto& other = kLatticeStep[static_cast<std::size_t>((d + turned) & 15)];
        const double way = is_backward ? -1.0 : 1.0;
        return turns.radius_m(way * step[0], way * step[1], way * other[0], way * other[1]);
      };
      const double radius_m = std::max(radius_beside_m(1), radius_beside_m(kLatticeDirections - 1));
      const double needed_m = radius_m * (d % 4 == 2 ? knight_tangent : unit_tangent);
      repeats_[static_cast<std::size_t>(d)] =
          std::max(1, static_cast<int>(std::ceil(needed_m / length_m)));
    }
    // Of a large map, what lies around both ends.
    const double aside_m = part_ != nullptr
                               ? part_->aside_m
                               : kAsideMin_m + 0.5 * std::max(std::fabs(to.x_m - from.x_m),
                                                              std::fabs(to.y_m - from.y_m));
    const double west_m = std::max(geometry.west_m, std::min(from.x_m, to.x_m) - aside_m);
    const double south_m = std::max(geometry.south_m, std::min(from.y_m, to.y_m) - aside_m);
    const double east_m = std::min(geometry.east_m(), std::max(from.x_m, to.x_m) + aside_m);
    const double north_m = std::min(geometry.north_m(), std::max(from.y_m, to.y_m) + aside_m);
    west_ = static_cast<int>(std::floor((from.x_m - west_m) / spacing_m_));
    south_ = static_cast<int>(std::floor((from.y_m - south_m) / spacing_m_));
    columns_ = west_ + 1 + static_cast<int>(std::floor((east_m - from.x_m) / spacing_m_));
    rows_ = south_ + 1 + static_cast<int>(std::floor((north_m - from.y_m) / spacing_m_));
    newest_.resize(columns_, rows_);
  }

  /// Goes on until `work_units` in total, the first track, nothing left, or `should_stop`.
  void advance(std::int64_t work_units, const std::function<bool()>& should_stop) {
    if (labels_.empty()) {
      begin();
    }
    std::int64_t until_asked = 0;
    while (!is_finished() && work_units_ < work_units) {
      if (--until_asked < 0) {
        until_asked = kStopInterval;
        if (should_stop()) {
          return;
        }
      }
      if (!is_hurried_ && work_units_ >= kAloneWork) {
        hurry();
      }
      std::pop_heap(queue_.begin(), queue_.end(), kIsLater);
      const Entry entry = queue_.back();
      queue_.pop_back();
      const Label label = labels_[static_cast<std::size_t>(entry.label)];
      if (label.direction == kGoalMark) {
        finish(entry.label);
        return;
      }
      expand(entry.label, label);
    }
  }

  [[nodiscard]] bool is_finished() const { return !track_.empty() || queue_.empty(); }
  /// From `from` to `to`; empty while there is none.
  [[nodiscard]] const std::vector<geo::MapPoint>& track() const { return track_; }
  [[nodiscard]] double cost_m() const { return cost_m_; }
  [[nodiscard]] std::int64_t work_units() const { return work_units_; }

 private:
  static constexpr std::int8_t kGoalMark = 100;

  [[nodiscard]] geo::MapPoint place(int column, int row) const {
    return {from_.x_m + (column - west_) * spacing_m_, from_.y_m + (row - south_) * spacing_m_};
  }

  // Between the run so far and the next one, as it is flown.
  [[nodiscard]] bool is_turn_allowed(const Label& from, double x_m, double y_m) const {
    return is_backward_ ? envelope_.is_turn_allowed(-x_m, -y_m, -from.run_x_m, -from.run_y_m)
                        : envelope_.is_turn_allowed(from.run_x_m, from.run_y_m, x_m, y_m);
  }

  FlightEnvelope::Arrival follow(const geo::MapPoint& a, const geo::MapPoint& b, const Label& from,
                                 bool is_end_leg) {
    ++work_units_;
    return envelope_.follow(a, b,
                            {static_cast<double>(from.low_m), static_cast<double>(from.high_m)},
                            {is_end_leg ? kEndStep_m : kStep_m, spare_.margin_m, spare_.climb_share,
                             is_end_leg, is_backward_, true},
                            static_cast<double>(from.owed_m));
  }

  void push(const Label& label, double key_m) {
    labels_.push_back(label);
    queue_.push_back({key_m, static_cast<std::int32_t>(labels_.size() - 1)});
    std::push_heap(queue_.begin(), queue_.end(), kIsLater);
  }

  [[nodiscard]] double key_m(const Label& label, double onwards_m) const {
    return label.cost_m + inflation_ * onwards_m;
  }

  void hurry() {
    is_hurried_ = true;
    inflation_ = std::max(inflation_, kHurriedInflation);
    for (Entry& entry : queue_) {
      const Label& label = labels_[static_cast<std::size_t>(entry.label)];
      if (label.direction != kGoalMark) {
        entry.key_m = key_m(label, ahead_m(place(label.column, label.row)));
      }
    }
    std::make_heap(queue_.begin(), queue_.end(), kIsLater);
  }

  [[nodiscard]] double ahead_m(const geo::MapPoint& at) const {
    const double ahead_m = (field_ != nullptr ? *field_ : *own_field_).cost_m(at);
    if (part_ == nullptr) {
      return ahead_m;
    }
    const double dx_m = to_.x_m - at.x_m;
    const double dy_m = to_.y_m - at.y_m;
    return std::max(ahead_m - beyond_m_, std::sqrt(dx_m * dx_m + dy_m * dy_m));
  }

  // Whether the search begins or ends where the envelope has a funnel, and at one altitude.
  [[nodiscard]] bool is_own_end(const flight::Waypoint& end) const {
    return part_ == nullptr || end == envelope_.start() || end == envelope_.goal();
  }

  // Whether a first leg to somewhere may be flown, or backward a leg from there.
  [[nodiscard]] bool may_begin(double x_m, double y_m) const {
    if (is_backward_) {
      return part_ == nullptr || !part_->lead_out ||
             envelope_.is_turn_allowed(-x_m, -y_m, part_->lead_out->x_m, part_->lead_out->y_m);
    }
    return part_ == nullptr || from_ == envelope_.start()
               ? envelope_.may_leave_start(x_m, y_m)
               : !part_->lead_in ||
                     envelope_.is_turn_allowed(part_->lead_in->x_m, part_->lead_in->y_m, x_m, y_m);
  }

  [[nodiscard]] bool may_end(double x_m, double y_m) const {
    if (is_backward_) {
      return part_ == nullptr || to_ == envelope_.start()
                 ? envelope_.may_leave_start(-x_m, -y_m)
                 : !part_->lead_in || envelope_.is_turn_allowed(part_->lead_in->x_m,
                                                                part_->lead_in->y_m, -x_m, -y_m);
    }
    return part_ == nullptr || !part_->lead_out ||
           envelope_.is_turn_allowed(x_m, y_m, part_->lead_out->x_m, part_->lead_out->y_m);
  }

  [[nodiscard]] AltitudeBand first_altitudes() const {
    const double z_m = from_.altitude_m;
    if (is_own_end(from_)) {
      return {z_m, z_m};
    }
    const AltitudeBand band = envelope_.band_at(from_.point());
    const double low_m = std::max(z_m, band.low_m + spare_.margin_m);
    return {low_m, std::min(low_m + part_->higher_m, band.high_m - spare_.margin_m)};
  }

  // Whether the altitudes at the end let the flight go on, or backward come there.
  [[nodiscard]] bool may_end_at(const AltitudeBand& altitudes) const {
    const double z_m = to_.altitude_m;
    if (is_own_end(to_)) {
      return altitudes.low_m <= z_m && z_m <= altitudes.high_m;
    }
    // What follows can be flown from above: it was as low as it may be.
    return altitudes.is_flyable() && z_m <= altitudes.high_m &&
           (!is_backward_ || altitudes.low_m <= z_m + part_->higher_m);
  }

  // The free first leg, to every node around the start, and straight to the goal.
  void begin() {
    const AltitudeBand altitudes = first_altitudes();
    if (!altitudes.is_flyable()) {
      return;
    }
    const Label start{0.0,
                      static_cast<float>(altitudes.low_m),
                      static_cast<float>(altitudes.high_m),
                      0.0F,
                      west_,
                      south_,
                      -1,
                      -1,
                      0.0,
                      0.0,
                      -1};
    labels_.push_back(start);
    const int reach = static_cast<int>(kEndLegMax_m / spacing_m_);
    for (int row = south_ - reach; row <= south_ + reach; ++row) {
      for (int column = west_ - reach; column <= west_ + reach; ++column) {
        if (column == west_ && row == south_) {
          continue;
        }
        step(0, start, column, row, -1);
      }
    }
    try_goal(0, start);
  }

  void expand(std::int32_t index, const Label& label) {
    if (label.direction >= 0) {
      const auto& onwards = kLatticeStep[static_cast<std::size_t>(label.direction)];
      step(index, label, label.column + onwards[0], label.row + onwards[1], label.direction);
    }
    const int from = label.direction >= 0 ? label.direction - 1 : 0;
    const int to = label.direction >= 0 ? label.direction + 1 : kLatticeDirections - 1;
    for (int turned = from; turned <= to; ++turned) {
      if (turned == label.direction) {
        continue;
      }
      const int d = (turned + kLatticeDirections) % kLatticeDirections;
      const int times = repeats_[static_cast<std::size_t>(d)];
      step(index, label, label.column + times * kLatticeStep[static_cast<std::size_t>(d)][0],
           label.row + times * kLatticeStep[static_cast<std::size_t>(d)][1], d);
    }
    try_goal(index, label);
  }

  void step(std::int32_t index, const Label& from, int column, int row, int direction) {
    if (column < 0 || column >= columns_ || row < 0 || row >= rows_) {
      return;
    }
    const geo::MapPoint a = place(from.column, from.row);
    const geo::MapPoint b = place(column, row);
    double run_x_m = b.x_m - a.x_m;
    double run_y_m = b.y_m - a.y_m;
    if (direction >= 0 && direction == from.direction) {
      run_x_m += from.run_x_m;
      run_y_m += from.run_y_m;
    } else if (from.before >= 0) {
      if (!is_turn_allowed(from, run_x_m, run_y_m)) {
        return;
      }
    } else if (!may_begin(run_x_m, run_y_m)) {
      return;
    }
    const double onwards_m = ahead_m(b);
    if (!(onwards_m < kInfinity)) {
      return;
    }
    std::int32_t* chain = nullptr;
    if (direction >= 0) {
      chain = &newest_.at(column, row, direction);
    }
    const FlightEnvelope::Arrival arrival =
        follow(a, b, from, from.before < 0 && is_own_end(from_));
    if (!arrival.altitudes.is_flyable()) {
      return;
    }
    Label label{from.cost_m + arrival.cost_m,
                static_cast<float>(arrival.altitudes.low_m),
                static_cast<float>(arrival.altitudes.high_m),
                static_cast<float>(arrival.owed_m),
                column,
                row,
                index,
                -1,
                run_x_m,
                run_y_m,
                static_cast<std::int8_t>(direction)};
    if (!(label.low_m <= label.high_m)) {
      return;
    }
    if (chain != nullptr) {
      int count = 0;
      for (std::int32_t at = *chain; at >= 0; at = labels_[static_cast<std::size_t>(at)].next) {
        const Label& other = labels_[static_cast<std::size_t>(at)];
        if (other.cost_m <= label.cost_m &&
            static_cast<double>(other.low_m) <=
                static_cast<double>(label.low_m) + kIntervalTolerance_m &&
            static_cast<double>(other.high_m) >=
                static_cast<double>(label.high_m) - kIntervalTolerance_m) {
          return;
        }
        ++count;
      }
      if (count >= kLabelsMax) {
        return;
      }
      label.next = *chain;
      *chain = static_cast<std::int32_t>(labels_.size());
    }
    push(label, key_m(label, onwards_m));
  }

  void try_goal(std::int32_t index, const Label& from) {
    const geo::MapPoint a = place(from.column, from.row);
    const geo::MapPoint b = to_.point();
    const double dx_m = b.x_m - a.x_m;
    const double dy_m = b.y_m - a.y_m;
    if (dx_m * dx_m + dy_m * dy_m > kEndLegMax_m * kEndLegMax_m || (dx_m == 0.0 && dy_m == 0.0) ||
        (index > 0 && !is_turn_allowed(from, dx_m, dy_m)) || !may_end(dx_m, dy_m) ||
        (index == 0 && !may_begin(dx_m, dy_m))) {
      return;
    }
    const FlightEnvelope::Arrival arrival = follow(a, b, from, is_own_end(to_));
    if (may_end_at(arrival.altitudes)) {
      Label label = from;
      label.before = index;
      label.direction = kGoalMark;
      label.cost_m = from.cost_m + arrival.cost_m;
      push(label, label.cost_m);
    }
  }

  void finish(std::int32_t goal) {
    cost_m_ = labels_[static_cast<std::size_t>(goal)].cost_m;
    std::vector<geo::MapPoint> points = {to_.point()};
    for (std::int32_t at = labels_[static_cast<std::size_t>(goal)].before; at >= 0;
         at = labels_[static_cast<std::size_t>(at)].before) {
      const Label& label = labels_[static_cast<std::size_t>(at)];
      points.push_back(place(label.column, label.row));
    }
    std::reverse(points.begin(), points.end());
    // Nodes on a straight run are no corners.
    for (const geo::MapPoint& point : points) {
      std::vector<geo::MapPoint>& track = track_;
      if (track.size() >= 2) {
        const geo::MapPoint& a = track[track.size() - 2];
        const geo::MapPoint& b = track.back();
        const double cross =
            (b.x_m - a.x_m) * (point.y_m - b.y_m) - (b.y_m - a.y_m) * (point.x_m - b.x_m);
        if (std::fabs(cross) <= 1e-6 * spacing_m_ * spacing_m_ &&
            (b.x_m - a.x_m) * (point.x_m - b.x_m) + (b.y_m - a.y_m) * (point.y_m - b.y_m) > 0.0) {
          track.pop_back();
        }
      }
      track.push_back(point);
    }
  }

  const FlightEnvelope& envelope_;
  LatticeSpare spare_;
  flight::Waypoint from_;
  flight::Waypoint to_;
  bool is_backward_;         // flown from `to`
  const LatticePart* part_;  // null: the ends are those of the envelope
  double beyond_m_ = 0.0;    // of a part: from `to` to the goal
  const CostField* field_;   // null: own_field_
  std::optional<CostField> own_field_;
  double spacing_m_ = 0.0;
  std::array<int, kLatticeDirections> repeats_{};
  int west_ = 0;   // column of the start
  int south_ = 0;  // its row
  int columns_ = 0;
  int rows_ = 0;
  NewestLabels newest_;
  std::vector<Label> labels_;
  std::vector<Entry> queue_;
  std::vector<geo::MapPoint> track_;
  double cost_m_ = kInfinity;
  std::int64_t work_units_ = 0;
  bool is_hurried_ = false;
  double inflation_ = kInflation;
};

}  // namespace

LatticeResult search_lattice(const FlightEnvelope& envelope, const GlobalOptions& options,
                             const LatticeSpare& spare, const LatticePart& part,
                             std::int64_t work_budget, const std::function<bool()>& should_stop,
                             const CostField& ahead) {
  Search search(envelope, options, spare, part.is_backward ? part.to : part.from,
                part.is_backward ? part.from : part.to, &ahead, part.is_backward, &part);
  search.advance(work_budget, should_stop);
  LatticeResult result;
  result.track = search.track();
  if (part.is_backward) {
    std::reverse(result.track.begin(), result.track.end());
  }
  result.cost_m = search.cost_m();
  result.work_units = search.work_units();
  result.is_exhausted = result.track.empty() && search.is_finished();
  return result;
}

LatticeResult search_lattice(const FlightEnvelope& envelope, const GlobalOptions& options,
                             const LatticeSpare& spare, std::int64_t work_budget,
                             const std::function<bool()>& should_stop, const CostField* to_goal) {
  Search forward(envelope, options, spare, envelope.start(), envelope.goal(), to_goal, false);
  forward.advance(std::min(kAloneWork, work_budget), should_stop);
  std::optional<Search> backward;
  std::int64_t share = kAloneWork;
  LatticeResult result;
  const auto spent = [&] { return forward.work_units() + (backward ? backward->work_units() : 0); };
  // In turns, each twice as long as the one before; a side that has nothing left ends the search.
  while (!forward.is_finished() && !(backward && backward->is_finished()) &&
         spent() < work_budget && !should_stop()) {
    if (!backward) {
      backward.emplace(envelope, options, spare, envelope.goal(), envelope.start(), nullptr, true);
    }
    backward->advance(std::min(share, work_budget - forward.work_units()), should_stop);
    if (!backward->is_finished()) {
      share *= 2;
      forward.advance(std::min(share, work_budget - backward->work_units()), should_stop);
    }
  }
  result.work_units = spent();
  if (!forward.track().empty()) {
    result.track = forward.track();
    result.cost_m = forward.cost_m();
  } else if (backward && !backward->track().empty()) {
    result.track.assign(backward->track().rbegin(), backward->track().rend());
    result.cost_m = backward->cost_m();
  } else {
    result.cost_m = kInfinity;
    result.is_exhausted = forward.is_finished() || (backward && backward->is_finished());
  }
  return result;
}

}  // namespace hedgehop::global_planning
