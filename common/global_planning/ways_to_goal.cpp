#include "global_planning/ways_to_goal.hpp"

#include <algorithm>
#include <limits>

#include "global_planning/lattice_directions.hpp"

namespace hedgehop::global_planning {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr LatticeSpare kSpare{2.0, 0.97};
constexpr double kFar_m = 1e7;  // from the map

}  // namespace

LatticeSpare WaysToGoal::spare() { return kSpare; }

WaysToGoal::WaysToGoal(FlightEnvelope envelope, const GlobalOptions& options,
                       const CostField& from_start, std::int64_t work_budget)
    : lattice_(envelope.geometry(), options, envelope.goal().point(),
               {envelope.geometry().west_m, envelope.geometry().south_m},
               {envelope.geometry().east_m(), envelope.geometry().north_m()}, true),
      newest_(lattice_.columns(), lattice_.rows()) {
  envelope.move_start({envelope.geometry().west_m - kFar_m, envelope.geometry().south_m, 0.0});
  begin(envelope, from_start);
  while (!queue_.empty() && work_units_ < work_budget) {
    std::pop_heap(queue_.begin(), queue_.end(), kIsLater);
    const std::int32_t at = queue_.back().label;
    queue_.pop_back();
    expand(envelope, from_start, at);
  }
  queue_ = {};
  labels_.shrink_to_fit();
}

// The free last leg, from every node around the goal.
void WaysToGoal::begin(const FlightEnvelope& envelope, const CostField& from_start) {
  const auto z_m = static_cast<float>(envelope.goal().altitude_m);
  const int goal_column = lattice_.origin_column();
  const int goal_row = lattice_.origin_row();
  const LatticeLabel goal{0.0, z_m, z_m, 0.0F, goal_column, goal_row, -1, -1, 0.0, 0.0, -1};
  const int reach = static_cast<int>(kEndLegMax_m / lattice_.spacing_m());
  for (int row = goal_row - reach; row <= goal_row + reach; ++row) {
    for (int column = goal_column - reach; column <= goal_column + reach; ++column) {
      if (column != goal_column || row != goal_row) {
        step(envelope, from_start, goal, -1, column, row, -1);
      }
    }
  }
}

void WaysToGoal::expand(const FlightEnvelope& envelope, const CostField& from_start,
                        std::int32_t index) {
  const LatticeLabel label = labels_[static_cast<std::size_t>(index)];
  const auto step_to = [&](int direction, int times) {
    const auto& offset = kLatticeStep[static_cast<std::size_t>(direction)];
    step(envelope, from_start, label, index, label.column + times * offset[0],
         label.row + times * offset[1], direction);
  };
  if (label.direction >= 0) {
    step_to(label.direction, 1);
  }
  for_each_turn(label.direction, [&](int d) { step_to(d, lattice_.repeats(d)); });
}

void WaysToGoal::step(const FlightEnvelope& envelope, const CostField& from_start,
                      const LatticeLabel& from, std::int32_t index, int column, int row,
                      int direction) {
  if (!lattice_.contains(column, row)) {
    return;
  }
  const geo::MapPoint a = lattice_.place(from.column, from.row);
  const geo::MapPoint b = lattice_.place(column, row);
  double run_x_m = b.x_m - a.x_m;
  double run_y_m = b.y_m - a.y_m;
  if (direction >= 0 && direction == from.direction) {
    run_x_m += from.run_x_m;
    run_y_m += from.run_y_m;
  } else if (index >= 0 &&
             !envelope.is_turn_allowed(-run_x_m, -run_y_m, -from.run_x_m, -from.run_y_m)) {
    return;
  }
  const double onwards_m = from_start.cost_m(b);
  if (!(onwards_m < kInfinity)) {
    return;
  }
  const bool is_end_leg = index < 0;
  ++work_units_;
  const FlightEnvelope::Arrival arrival =
      envelope.follow(a, b, {static_cast<double>(from.low_m), static_cast<double>(from.high_m)},
                      {is_end_leg ? kEndLegStep_m : kLatticeLegStep_m, kSpare.margin_m,
                       kSpare.climb_share, is_end_leg, true, true},
                      static_cast<double>(from.owed_m));
  LatticeLabel label = label_of(arrival, from.cost_m, column, row, direction);
  label.before = index;
  label.run_x_m = run_x_m;
  label.run_y_m = run_y_m;
  if (!arrival.altitudes.is_flyable() || !(label.low_m <= label.high_m)) {
    return;
  }
  if (direction < 0) {
    labels_.push_back(label);
  } else if (!add_label(labels_, newest_.at(column, row, direction), label)) {
    return;
  }
  queue_.push_back({label.cost_m + onwards_m, static_cast<std::int32_t>(labels_.size() - 1)});
  std::push_heap(queue_.begin(), queue_.end(), kIsLater);
}

}  // namespace hedgehop::global_planning
