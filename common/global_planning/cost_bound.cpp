#include "global_planning/cost_bound.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

namespace hedgehop::global_planning {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
// Sums of some thousand floats round up by less than this.
constexpr double kRounding = 1.0 - 2e-4;
// Of limits and shortest ways; a second pass gains half a per cent, later ones next to nothing.
constexpr int kPasses = 2;
constexpr float kUnknownShare = 0.7F;  // of the slope, on both sides of a corner: below sqrt(1/2)

// Nodes in order of their value, by buckets: within a bucket they come in the order of pushing.
class Buckets {
 public:
  Buckets(float width, float step_max)
      : inverse_width_(1.0F / width),
        buckets_(static_cast<std::size_t>(step_max * inverse_width_) + 3) {}

  void push(float value, std::uint32_t node) {
    buckets_[static_cast<std::size_t>(value * inverse_width_) % buckets_.size()].push_back(node);
    ++count_;
  }
  [[nodiscard]] bool is_empty() const { return count_ == 0; }
  std::uint32_t pop() {
    while (next_ == buckets_[current_].size()) {
      buckets_[current_].clear();
      next_ = 0;
      current_ = (current_ + 1) % buckets_.size();
    }
    --count_;
    return buckets_[current_][next_++];
  }

 private:
  float inverse_width_;
  std::vector<std::vector<std::uint32_t>> buckets_;
  std::size_t current_ = 0;
  std::size_t next_ = 0;  // in the current bucket
  std::size_t count_ = 0;
};

// Value of a corner from its two neighbours across a cell where the slope is w [m a cell].
float marched(float a, float b, float w) {
  const float difference = a - b;
  const float square = 2.0F * w * w - difference * difference;
  return std::fabs(difference) >= w ? std::min(a, b) + w : 0.5F * (a + b + std::sqrt(square));
}

// Corners of cells, with a frame of cells that cannot be flown, so that each corner has four. A
// cell, a side along x and a side along y have the index of their south-western corner.
class Corners {
 public:
  explicit Corners(const FlightEnvelope& envelope)
      : cells_(envelope.geometry()),
        wide_(static_cast<std::uint32_t>(cells_.columns) + 3),
        count_(std::size_t{wide_} * (static_cast<std::size_t>(cells_.rows) + 3)),
        slope_(count_, kInfinity),
        along_x_(count_, kInfinity),
        along_y_(count_, kInfinity),
        steepest_x_(count_),
        steepest_y_(count_) {
    for (int row = 0; row < cells_.rows; ++row) {
      for (int column = 0; column < cells_.columns; ++column) {
        const float w = static_cast<float>(envelope.least_density({column, row}) * cells_.cell_m);
        slope_[index(column, row)] = w;
        slope_max_ = w < kInfinity ? std::max(slope_max_, w) : slope_max_;
      }
    }
  }

  [[nodiscard]] std::uint32_t index(int column, int row) const {
    return static_cast<std::uint32_t>(row + 1) * wide_ + static_cast<std::uint32_t>(column + 1);
  }
  [[nodiscard]] std::array<std::uint32_t, 4> of_cell(raster::CellIndex cell) const {
    const std::uint32_t first = index(cell.column, cell.row);
    return {first, first + 1, first + wide_, first + wide_ + 1};
  }

  /// Fast marching from the corners of `target` until those of `from` are reached. Nodes of one
  /// bucket may come out of order, which makes the solution a little worse and nothing else.
  std::vector<float> march(raster::CellIndex target, raster::CellIndex from) const {
    std::vector<std::uint8_t> is_final(count_);
    return spread(
        target, from, [&](const std::vector<float>& value, std::uint32_t node, const auto& offer) {
          is_final[node] = 1;
          const auto towards = [&](std::uint32_t to, std::uint32_t cell_a, std::uint32_t side_a,
                                   std::uint32_t cell_b, std::uint32_t side_b) {
            if (is_final[to] != 0) {
              return;
            }
            float best = value[node] + std::min(slope_[cell_a], slope_[cell_b]);
            if (is_final[side_a] != 0 && slope_[cell_a] < kInfinity) {
              best = std::min(best, marched(value[node], value[side_a], slope_[cell_a]));
            }
            if (is_final[side_b] != 0 && slope_[cell_b] < kInfinity) {
              best = std::min(best, marched(value[node], value[side_b], slope_[cell_b]));
            }
            offer(to, best);
          };
          const std::uint32_t south = node - wide_;
          const std::uint32_t north = node + wide_;
          towards(node + 1, node, north + 1, south, south + 1);
          towards(node - 1, node - 1, north - 1, south - 1, south - 1);
          towards(north, node, north + 1, node - 1, north - 1);
          towards(south, south, south + 1, south - 1, south - 1);
        });
  }

  /// Limits of the sides by the steepness that `value` has in the corners.
  void limit_sides(const std::vector<float>& value) {
    std::fill(steepest_x_.begin(), steepest_x_.end(), 0.0F);
    std::fill(steepest_y_.begin(), steepest_y_.end(), 0.0F);
    for (int row = 0; row < cells_.rows; ++row) {
      for (int column = 0; column < cells_.columns; ++column) {
        const std::uint32_t at = index(column, row);
        const std::uint32_t above = at + wide_;
        if (!(slope_[at] < kInfinity)) {
          continue;
        }
        const auto corner = [&](std::uint32_t x, std::uint32_t y) {
          const float dx = value[x + 1] - value[x];
          const float dy = value[y + wide_] - value[y];
          const float steepness = std::sqrt(dx * dx + dy * dy) / slope_[at];
          steepest_x_[x] = std::max(steepest_x_[x], steepness);
          steepest_y_[y] = std::max(steepest_y_[y], steepness);
        };
        corner(at, at);
        corner(at, at + 1);
        corner(above, at);
        corner(above, at + 1);
      }
    }
    for (std::size_t at = wide_; at + wide_ < count_; ++at) {
      along_x_[at] = limit(value[at + 1] - value[at], steepest_x_[at],
                           std::min(slope_[at], slope_[at - wide_]));
      along_y_[at] = limit(value[at + wide_] - value[at], steepest_y_[at],
                           std::min(slope_[at], slope_[at - 1]));
    }
  }

  /// Shortest ways along the sides.
  std::vector<float> follow_sides(raster::CellIndex target, raster::CellIndex from) const {
    return spread(target, from,
                  [&](const std::vector<float>& value, std::uint32_t node, const auto& offer) {
                    const float here = value[node];
                    offer(node + 1, here + along_x_[node]);
                    offer(node - 1, here + along_x_[node - 1]);
                    offer(node + wide_, here + along_y_[node]);
                    offer(node - wide_, here + along_y_[node - wide_]);
                  });
  }

 private:
  // NaN, between nodes that were never reached, has no limit: only what cannot be flown is there,
  // or what lies beyond the value that ends the search.
  static float limit(float rise, float steepest, float slope) {
    if (steepest > 0.0F) {
      return std::fabs(rise) / steepest;
    }
    return kUnknownShare * slope;
  }

  // Values from the corners of `target` outwards, capped at the greatest of the corners of `from`.
  template <typename Relax>
  std::vector<float> spread(raster::CellIndex target, raster::CellIndex from,
                            const Relax& relax) const {
    std::vector<float> value(count_, kInfinity);
    std::vector<float> taken(count_, kInfinity);  // with which a node was last passed on
    Buckets open(0.5F * static_cast<float>(cells_.cell_m), 1.5F * slope_max_);
    for (const std::uint32_t node : of_cell(target)) {
      value[node] = 0.0F;
      open.push(0.0F, node);
    }
    const std::array<std::uint32_t, 4> last = of_cell(from);
    // A node that comes later has at most one bucket less.
    const float slack = static_cast<float>(cells_.cell_m);
    float cap = kInfinity;
    while (!open.is_empty()) {
      const std::uint32_t node = open.pop();
      if (value[node] >= taken[node]) {
        continue;
      }
      if (value[node] > cap + slack) {
        break;
      }
      taken[node] = value[node];
      if (std::find(last.begin(), last.end(), node) != last.end()) {
        cap = 0.0F;
        for (const std::uint32_t corner : last) {
          cap = std::max(cap, value[corner]);
        }
      }
      relax(value, node, [&](std::uint32_t to, float offered) {
        if (offered < value[to]) {
          value[to] = offered;
          open.push(offered, to);
        }
      });
    }
    for (float& each : value) {
      each = std::min(each, cap);
    }
    return value;
  }

  raster::GridGeometry cells_;
  std::uint32_t wide_;
  std::size_t count_;
  std::vector<float> slope_;  // w of a cell times its side
  std::vector<float> along_x_, along_y_;
  std::vector<float> steepest_x_, steepest_y_;
  float slope_max_ = 1.0F;
};

}  // namespace

CostBound::CostBound(const FlightEnvelope& envelope, const geo::MapPoint& target,
                     const geo::MapPoint& from)
    : cells_(envelope.geometry()) {
  const auto columns = static_cast<std::size_t>(cells_.columns) + 1;
  const auto rows = static_cast<std::size_t>(cells_.rows) + 1;
  cost_m_.assign(columns * rows, 0.0F);
  if (!cells_.contains(target) || !cells_.contains(from)) {
    return;
  }
  Corners corners(envelope);
  const raster::CellIndex target_cell = cells_.cell_at(target);
  const raster::CellIndex from_cell = cells_.cell_at(from);
  std::vector<float> value = corners.march(target_cell, from_cell);
  for (int pass = 0; pass < kPasses; ++pass) {
    corners.limit_sides(value);
    value = corners.follow_sides(target_cell, from_cell);
  }
  for (std::size_t row = 0; row < rows; ++row) {
    for (std::size_t column = 0; column < columns; ++column) {
      cost_m_[row * columns + column] =
          value[corners.index(static_cast<int>(column), static_cast<int>(row))];
    }
  }
}

double CostBound::cost_m(const geo::MapPoint& from) const {
  if (!cells_.contains(from)) {
    return 0.0;
  }
  const raster::CellIndex cell = cells_.cell_at(from);
  const double u = (from.x_m - cells_.west_m) / cells_.cell_m - cell.column;
  const double v = (from.y_m - cells_.south_m) / cells_.cell_m - cell.row;
  const auto at = [&](int column, int row) {
    return static_cast<double>(
        cost_m_[static_cast<std::size_t>(row) * static_cast<std::size_t>(cells_.columns + 1) +
                static_cast<std::size_t>(column)]);
  };
  const double south_m = (1.0 - u) * at(cell.column, cell.row) + u * at(cell.column + 1, cell.row);
  const double north_m =
      (1.0 - u) * at(cell.column, cell.row + 1) + u * at(cell.column + 1, cell.row + 1);
  return ((1.0 - v) * south_m + v * north_m) * kRounding;
}

}  // namespace hedgehop::global_planning
