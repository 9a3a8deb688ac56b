#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <vector>

#include "geo/map_projection.hpp"
#include "global_planning/flight_envelope.hpp"
#include "global_planning/global_planner.hpp"
#include "global_planning/lattice_directions.hpp"
#include "raster/grid.hpp"

namespace hedgehop::global_planning {

/// How densely the band is looked at on legs between nodes; the profile is exact afterwards.
inline constexpr double kLatticeLegStep_m = 15.0;
/// On the leg at a start or goal, where there is no spare for what lies between the samples; it is
/// looked at on each crest too.
inline constexpr double kEndLegStep_m = 2.5;
/// The leg at a start or goal is free: any direction, up to so long.
inline constexpr double kEndLegMax_m = 600.0;

/// Nodes of a square lattice around one of its places, inside a box, and how tracks run on it: on
/// straight by one node, or by repeats() steps into the next direction, so that
/// FlightEnvelope::is_turn_allowed holds for both legs.
class Lattice {
 public:
  /// @param is_backward  tracks are flown the other way round.
  Lattice(const raster::GridGeometry& geometry, const GlobalOptions& options,
          const geo::MapPoint& origin, const geo::MapPoint& south_west,
          const geo::MapPoint& north_east, bool is_backward);

  [[nodiscard]] int columns() const { return columns_; }
  [[nodiscard]] int rows() const { return rows_; }
  /// Node of the origin.
  [[nodiscard]] int origin_column() const { return origin_column_; }
  [[nodiscard]] int origin_row() const { return origin_row_; }
  [[nodiscard]] double spacing_m() const { return spacing_m_; }
  [[nodiscard]] bool contains(int column, int row) const {
    return column >= 0 && column < columns_ && row >= 0 && row < rows_;
  }
  [[nodiscard]] geo::MapPoint place(int column, int row) const {
    return {origin_.x_m + (column - origin_column_) * spacing_m_,
            origin_.y_m + (row - origin_row_) * spacing_m_};
  }
  [[nodiscard]] int repeats(int direction) const {
    return repeats_[static_cast<std::size_t>(direction)];
  }

 private:
  geo::MapPoint origin_;
  double spacing_m_;
  std::array<int, kLatticeDirections> repeats_{};
  int origin_column_, origin_row_;
  int columns_, rows_;
};

/// An arrival at a node.
struct LatticeLabel {
  double cost_m;
  float low_m, high_m;
  float owed_m;  // see FlightEnvelope::Arrival
  std::int32_t column, row;
  std::int32_t before;      // label, negative: none
  std::int32_t next;        // label of the same node and direction
  double run_x_m, run_y_m;  // straight leg so far
  std::int8_t direction;    // -1: none of the sixteen
};

/// The label that a leg leads to, from one that cost `cost_m`; its links and its run are not set.
LatticeLabel label_of(const FlightEnvelope::Arrival& arrival, double cost_m, int column, int row,
                      int direction);

/// A label that is next to be looked at.
struct LatticeEntry {
  double key_m;
  std::int32_t label;
};
/// For heaps that give the least key first.
inline constexpr auto kIsLater = [](const LatticeEntry& a, const LatticeEntry& b) {
  return a.key_m != b.key_m ? a.key_m > b.key_m : a.label > b.label;
};

/// The newest label of each node and direction; -1: none. Memory only for squares of nodes that the
/// search comes to.
class NewestLabels {
 public:
  NewestLabels(int columns, int rows)
      : squares_wide_((columns + kSide - 1) / kSide),
        squares_(static_cast<std::size_t>(squares_wide_) *
                     static_cast<std::size_t>((rows + kSide - 1) / kSide),
                 -1) {}
  std::int32_t& at(int column, int row, int direction) {
    std::int32_t& square = squares_[square_of(column, row)];
    if (square < 0) {
      square = static_cast<std::int32_t>(labels_.size());
      labels_.emplace_back().fill(-1);
    }
    return labels_[static_cast<std::size_t>(square)][inside(column, row, direction)];
  }
  [[nodiscard]] std::int32_t find(int column, int row, int direction) const {
    const std::int32_t square = squares_[square_of(column, row)];
    return square < 0 ? -1
                      : labels_[static_cast<std::size_t>(square)][inside(column, row, direction)];
  }

 private:
  static constexpr int kSide = 8;

  [[nodiscard]] std::size_t square_of(int column, int row) const {
    return static_cast<std::size_t>((row / kSide) * squares_wide_ + column / kSide);
  }
  [[nodiscard]] static std::size_t inside(int column, int row, int direction) {
    return static_cast<std::size_t>(((row % kSide) * kSide + column % kSide) * kLatticeDirections +
                                    direction);
  }

  int squares_wide_ = 0;
  std::vector<std::int32_t> squares_;  // index in labels_
  std::deque<std::array<std::int32_t, static_cast<std::size_t>(kSide* kSide* kLatticeDirections)>>
      labels_;
};

/// Calls `visit` with each direction into which a track may turn; all where it has none yet (-1).
template <typename Visit>
void for_each_turn(int direction, const Visit& visit) {
  if (direction < 0) {
    for (int d = 0; d < kLatticeDirections; ++d) {
      visit(d);
    }
    return;
  }
  visit((direction + kLatticeDirections - 1) % kLatticeDirections);
  visit((direction + 1) % kLatticeDirections);
}

/// Adds a label to those of its node and direction, whose newest one `chain` is. False if another
/// one costs no more and can do all that it can, or there are too many.
bool add_label(std::vector<LatticeLabel>& labels, std::int32_t& chain, LatticeLabel label);

/// Corners of a track of lattice nodes: nodes on a straight run are none.
std::vector<geo::MapPoint> lattice_corners(const std::vector<geo::MapPoint>& nodes,
                                           double spacing_m);

}  // namespace hedgehop::global_planning
