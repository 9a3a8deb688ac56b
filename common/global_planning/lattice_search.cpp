#include "global_planning/lattice_search.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "global_planning/cost_field.hpp"
#include "global_planning/lattice.hpp"
#include "global_planning/lattice_directions.hpp"

namespace hedgehop::global_planning {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Detours stay this near to the box around both ends, and half of its longer side more.
constexpr double kAsideMin_m = 20000.0;
// The way ahead counts this many times: real flights cost more than the field says, and the first
// track need not be the best, as it is refined. With more the track is found sooner and worse.
constexpr double kInflation = 1.2;
constexpr double kHurriedInflation = 1.4;
constexpr double kPartInflation = 1.4;  // of parts, which are moved most afterwards
constexpr std::int64_t kStopInterval = 256;
// The search from the start is in no hurry for so long; most problems need less.
constexpr std::int64_t kCalmWork = 60000;
// It is alone for so long: before the one from the goal can begin, its field has to be made, which
// takes as long as 100,000 legs.
constexpr std::int64_t kAloneWork = 100000;

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
        field_(field),
        lattice_(lattice_around(envelope, options, from, to, is_backward, part)),
        newest_(lattice_.columns(), lattice_.rows()) {
    if (part_ != nullptr) {
      inflation_ = kPartInflation;
      beyond_m_ = field->cost_m(to.point());
    }
    if (field_ == nullptr) {
      own_field_.emplace(envelope, to.point(), options.field_block_m);
    }
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
      if (!is_hurried_ && work_units_ >= kCalmWork) {
        hurry();
      }
      std::pop_heap(queue_.begin(), queue_.end(), kIsLater);
      const LatticeEntry entry = queue_.back();
      queue_.pop_back();
      const LatticeLabel label = labels_[static_cast<std::size_t>(entry.label)];
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

  // Of a large map, what lies around both ends.
  static Lattice lattice_around(const FlightEnvelope& envelope, const GlobalOptions& options,
                                const flight::Waypoint& from, const flight::Waypoint& to,
                                bool is_backward, const LatticePart* part) {
    const double aside_m = part != nullptr
                               ? part->aside_m
                               : kAsideMin_m + 0.5 * std::max(std::fabs(to.x_m - from.x_m),
                                                              std::fabs(to.y_m - from.y_m));
    return {envelope.geometry(),
            options,
            from.point(),
            {std::min(from.x_m, to.x_m) - aside_m, std::min(from.y_m, to.y_m) - aside_m},
            {std::max(from.x_m, to.x_m) + aside_m, std::max(from.y_m, to.y_m) + aside_m},
            is_backward};
  }

  [[nodiscard]] geo::MapPoint place(int column, int row) const {
    return lattice_.place(column, row);
  }

  // Between the run so far and the next one, as it is flown.
  [[nodiscard]] bool is_turn_allowed(const LatticeLabel& from, double x_m, double y_m) const {
    return is_backward_ ? envelope_.is_turn_allowed(-x_m, -y_m, -from.run_x_m, -from.run_y_m)
                        : envelope_.is_turn_allowed(from.run_x_m, from.run_y_m, x_m, y_m);
  }

  FlightEnvelope::Arrival follow(const geo::MapPoint& a, const geo::MapPoint& b,
                                 const LatticeLabel& from, bool is_end_leg) {
    ++work_units_;
    return envelope_.follow(a, b,
                            {static_cast<double>(from.low_m), static_cast<double>(from.high_m)},
                            {is_end_leg ? kEndLegStep_m : kLatticeLegStep_m, spare_.margin_m,
                             spare_.climb_share, is_end_leg, is_backward_, true},
                            static_cast<double>(from.owed_m));
  }

  void queue_last(double key_m) {
    queue_.push_back({key_m, static_cast<std::int32_t>(labels_.size() - 1)});
    std::push_heap(queue_.begin(), queue_.end(), kIsLater);
  }

  [[nodiscard]] double key_m(const LatticeLabel& label, double onwards_m) const {
    return label.cost_m + inflation_ * onwards_m;
  }

  void hurry() {
    is_hurried_ = true;
    inflation_ = std::max(inflation_, kHurriedInflation);
    for (LatticeEntry& entry : queue_) {
      const LatticeLabel& label = labels_[static_cast<std::size_t>(entry.label)];
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
    const LatticeLabel start{0.0,
                             static_cast<float>(altitudes.low_m),
                             static_cast<float>(altitudes.high_m),
                             0.0F,
                             lattice_.origin_column(),
                             lattice_.origin_row(),
                             -1,
                             -1,
                             0.0,
                             0.0,
                             -1};
    labels_.push_back(start);
    const int west = lattice_.origin_column();
    const int south = lattice_.origin_row();
    const int reach = static_cast<int>(kEndLegMax_m / lattice_.spacing_m());
    for (int row = south - reach; row <= south + reach; ++row) {
      for (int column = west - reach; column <= west + reach; ++column) {
        if (column == west && row == south) {
          continue;
        }
        step(0, start, column, row, -1);
      }
    }
    try_goal(0, start);
  }

  void expand(std::int32_t index, const LatticeLabel& label) {
    if (label.direction >= 0) {
      const auto& onwards = kLatticeStep[static_cast<std::size_t>(label.direction)];
      step(index, label, label.column + onwards[0], label.row + onwards[1], label.direction);
    }
    for_each_turn(label.direction, [&](int d) {
      const auto& turned = kLatticeStep[static_cast<std::size_t>(d)];
      const int times = lattice_.repeats(d);
      step(index, label, label.column + times * turned[0], label.row + times * turned[1], d);
    });
    try_goal(index, label);
  }

  void step(std::int32_t index, const LatticeLabel& from, int column, int row, int direction) {
    if (!lattice_.contains(column, row)) {
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
    const FlightEnvelope::Arrival arrival =
        follow(a, b, from, from.before < 0 && is_own_end(from_));
    if (!arrival.altitudes.is_flyable()) {
      return;
    }
    LatticeLabel label = label_of(arrival, from.cost_m, column, row, direction);
    label.before = index;
    label.run_x_m = run_x_m;
    label.run_y_m = run_y_m;
    if (!(label.low_m <= label.high_m)) {
      return;
    }
    if (direction < 0) {
      labels_.push_back(label);
    } else if (!add_label(labels_, newest_.at(column, row, direction), label)) {
      return;
    }
    queue_last(key_m(label, onwards_m));
  }

  void try_goal(std::int32_t index, const LatticeLabel& from) {
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
      LatticeLabel label = from;
      label.before = index;
      label.direction = kGoalMark;
      label.cost_m = from.cost_m + arrival.cost_m;
      labels_.push_back(label);
      queue_last(label.cost_m);
    }
  }

  void finish(std::int32_t goal) {
    cost_m_ = labels_[static_cast<std::size_t>(goal)].cost_m;
    std::vector<geo::MapPoint> points = {to_.point()};
    for (std::int32_t at = labels_[static_cast<std::size_t>(goal)].before; at >= 0;
         at = labels_[static_cast<std::size_t>(at)].before) {
      const LatticeLabel& label = labels_[static_cast<std::size_t>(at)];
      points.push_back(place(label.column, label.row));
    }
    std::reverse(points.begin(), points.end());
    track_ = lattice_corners(points, lattice_.spacing_m());
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
  Lattice lattice_;
  NewestLabels newest_;
  std::vector<LatticeLabel> labels_;
  std::vector<LatticeEntry> queue_;
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
