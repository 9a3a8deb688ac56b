#include "global_planning/cost_bound.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>

namespace hedgehop::global_planning {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
// Sums of some thousand floats round up by less than this.
constexpr double kRounding = 1.0 - 2e-4;
// Of limits and shortest ways; a second and a third gain some tenths of a per cent.
constexpr int kPasses = 3;
constexpr float kUnknownShare = 0.7F;  // of the slope, on both sides of a corner: below sqrt(1/2)

// Whether the right angles of the two triangles of a cell lie south-west and north-east.
bool is_even(int column, int row) { return (column + row) % 2 == 0; }

// Linear over each triangle of a cell, between the values of its corners; u east, v north in [0,
// 1].
double over_triangles(bool even, double u, double v, double south_west, double south_east,
                      double north_west, double north_east) {
  if (even) {
    return u + v <= 1.0 ? south_west + u * (south_east - south_west) + v * (north_west - south_west)
                        : north_east + (1.0 - u) * (north_west - north_east) +
                              (1.0 - v) * (south_east - north_east);
  }
  return v <= u
             ? south_east + (1.0 - u) * (south_west - south_east) + v * (north_east - south_east)
             : north_west + u * (north_east - north_west) + (1.0 - v) * (south_west - north_west);
}

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

constexpr std::size_t kChunk = std::size_t{1} << 16U;  // numbers that one step writes
constexpr int kStepNodes = 2048;
constexpr int kStepRows = 8;

}  // namespace

// Corners of cells, with a frame of cells that cannot be flown, so that each corner has four. A
// cell, a side along x and a side along y have the index of their south-western corner.
struct CostBoundMaking::Corners {
 public:
  Corners(const FlightEnvelope& envelope, raster::CellIndex target, raster::CellIndex from)
      : envelope_(&envelope),
        cells_(envelope.geometry()),
        wide_(static_cast<std::uint32_t>(cells_.columns) + 3),
        count_(std::size_t{wide_} * (static_cast<std::size_t>(cells_.rows) + 3)),
        target_(of_cell(target)),
        from_(of_cell(from)) {
    for (std::vector<float>* each : floats()) {
      each->reserve(count_);
    }
    is_final_.reserve(count_);
  }

  /// Limits are to be taken from the solutions from both ends; before the first step.
  void take_both_ends() { has_both_ends_ = true; }

  bool step() {
    switch (phase_) {
      case Phase::kRoom:
        return advance(make_room(), Phase::kSlopes);
      case Phase::kSlopes:
        return advance(take_slopes(), Phase::kMarch);
      case Phase::kMarch:
        return advance(spread([this](std::uint32_t node) { march(node); }), Phase::kMarchedCap);
      case Phase::kMarchedCap:
        return advance(cap_values(), has_both_ends_ ? Phase::kTurn : Phase::kLimits);
      case Phase::kTurn:
        return advance(turn_around(), Phase::kMarchBack);
      case Phase::kMarchBack:
        return advance(spread([this](std::uint32_t node) { march(node); }), Phase::kMean);
      case Phase::kMean:
        return advance(take_mean(), Phase::kLimits);
      case Phase::kLimits:
        return advance(take_steepness(), Phase::kSides);
      case Phase::kSides:
        return advance(limit_sides(), Phase::kFollow);
      case Phase::kFollow:
        return advance(spread([this](std::uint32_t node) { follow_sides(node); }), Phase::kCap);
      case Phase::kCap:
        if (cap_values()) {
          ++pass_;
          return advance(true, pass_ < kPasses ? Phase::kLimits : Phase::kDone);
        }
        return false;
      case Phase::kDone:
        return true;
    }
    return true;
  }

  /// As CostBound wants them; in pieces, true once all are there.
  bool copy_to(std::vector<float>& to) {
    const std::size_t columns = static_cast<std::size_t>(cells_.columns) + 1;
    const std::size_t rows = static_cast<std::size_t>(cells_.rows) + 1;
    to.reserve(columns * rows);
    for (std::size_t n = 0; n < kChunk && next_ < rows; n += columns, ++next_) {
      const auto begin = value_.begin() + index(0, static_cast<int>(next_));
      to.insert(to.end(), begin, begin + static_cast<std::ptrdiff_t>(columns));
    }
    return next_ == rows;
  }

 private:
  enum class Phase : std::uint8_t {
    kRoom,
    kSlopes,
    kMarch,
    kMarchedCap,
    kTurn,
    kMarchBack,
    kMean,
    kLimits,
    kSides,
    kFollow,
    kCap,
    kDone
  };

  [[nodiscard]] std::array<std::vector<float>*, 7> floats() {
    return {&slope_, &along_x_, &along_y_, &value_, &taken_, &steepest_x_, &steepest_y_};
  }
  [[nodiscard]] std::uint32_t index(int column, int row) const {
    return static_cast<std::uint32_t>(row + 1) * wide_ + static_cast<std::uint32_t>(column + 1);
  }
  [[nodiscard]] std::array<std::uint32_t, 4> of_cell(raster::CellIndex cell) const {
    const std::uint32_t first = index(cell.column, cell.row);
    return {first, first + 1, first + wide_, first + wide_ + 1};
  }
  // From one phase to the next; never the end of all.
  bool advance(bool is_complete, Phase next) {
    if (is_complete) {
      phase_ = next;
      next_ = 0;
      is_begun_ = false;
    }
    return phase_ == Phase::kDone;
  }

  bool make_room() {
    const std::size_t size = std::min(next_ + kChunk / 4, count_);
    for (std::vector<float>* each : floats()) {
      each->resize(size, kInfinity);
    }
    is_final_.resize(size);
    next_ = size;
    return size == count_;
  }

  bool take_slopes() {
    for (int n = 0; n < kStepRows && next_ < static_cast<std::size_t>(cells_.rows); ++n, ++next_) {
      const int row = static_cast<int>(next_);
      for (int column = 0; column < cells_.columns; ++column) {
        const float w = static_cast<float>(envelope_->least_density({column, row}) * cells_.cell_m);
        slope_[index(column, row)] = w;
        slope_max_ = w < kInfinity ? std::max(slope_max_, w) : slope_max_;
      }
    }
    return next_ == static_cast<std::size_t>(cells_.rows);
  }

  // From now on from the other end, with the values so far in other_.
  bool turn_around() {
    const std::size_t end = std::min(next_ + kChunk, count_);
    other_.reserve(count_);
    for (; next_ < end; ++next_) {
      other_.push_back(value_[next_]);
      is_final_[next_] = 0;
    }
    if (next_ < count_) {
      return false;
    }
    std::swap(target_, from_);
    return true;
  }

  // Half of the difference of both solutions; neither is looked at beyond the other end.
  bool take_mean() {
    const std::size_t end = std::min(next_ + kChunk, count_);
    for (; next_ < end; ++next_) {
      value_[next_] = 0.5F * (other_[next_] - std::min(value_[next_], cap_));
    }
    if (next_ < count_) {
      return false;
    }
    std::swap(target_, from_);
    return true;
  }

  // Nodes of one bucket may come out of order, which makes the solution a little worse and nothing
  // else.
  void march(std::uint32_t node) {
    is_final_[node] = 1;
    const auto towards = [&](std::uint32_t to, std::uint32_t cell_a, std::uint32_t side_a,
                             std::uint32_t cell_b, std::uint32_t side_b) {
      if (is_final_[to] != 0) {
        return;
      }
      float best = value_[node] + std::min(slope_[cell_a], slope_[cell_b]);
      if (is_final_[side_a] != 0 && slope_[cell_a] < kInfinity) {
        best = std::min(best, marched(value_[node], value_[side_a], slope_[cell_a]));
      }
      if (is_final_[side_b] != 0 && slope_[cell_b] < kInfinity) {
        best = std::min(best, marched(value_[node], value_[side_b], slope_[cell_b]));
      }
      offer(to, best);
    };
    const std::uint32_t south = node - wide_;
    const std::uint32_t north = node + wide_;
    towards(node + 1, node, north + 1, south, south + 1);
    towards(node - 1, node - 1, north - 1, south - 1, south - 1);
    towards(north, node, north + 1, node - 1, north - 1);
    towards(south, south, south + 1, south - 1, south - 1);
  }

  // Shortest ways along the sides.
  void follow_sides(std::uint32_t node) {
    const float here = value_[node];
    offer(node + 1, here + along_x_[node]);
    offer(node - 1, here + along_x_[node - 1]);
    offer(node + wide_, here + along_y_[node]);
    offer(node - wide_, here + along_y_[node - wide_]);
  }

  // The steepness that the values have over the triangles.
  bool take_steepness() {
    if (!is_begun_) {
      // Rows are cleared before a cell of theirs, or of the one below, is looked at.
      std::fill_n(steepest_x_.begin(), 2 * wide_, 0.0F);
      std::fill_n(steepest_y_.begin(), 2 * wide_, 0.0F);
      is_begun_ = true;
    }
    for (int n = 0; n < kStepRows && next_ < static_cast<std::size_t>(cells_.rows); ++n, ++next_) {
      const int row = static_cast<int>(next_);
      std::fill_n(steepest_x_.begin() + index(-1, row + 1), wide_, 0.0F);
      std::fill_n(steepest_y_.begin() + index(-1, row + 1), wide_, 0.0F);
      for (int column = 0; column < cells_.columns; ++column) {
        const std::uint32_t at = index(column, row);
        const std::uint32_t above = at + wide_;
        if (!(slope_[at] < kInfinity)) {
          continue;
        }
        const auto corner = [&](std::uint32_t x, std::uint32_t y) {
          const float dx = value_[x + 1] - value_[x];
          const float dy = value_[y + wide_] - value_[y];
          const float steepness = std::sqrt(dx * dx + dy * dy) / slope_[at];
          steepest_x_[x] = std::max(steepest_x_[x], steepness);
          steepest_y_[y] = std::max(steepest_y_[y], steepness);
        };
        if (is_even(column, row)) {
          corner(at, at);
          corner(above, at + 1);
        } else {
          corner(at, at + 1);
          corner(above, at);
        }
      }
    }
    if (next_ < static_cast<std::size_t>(cells_.rows)) {
      return false;
    }
    const std::uint32_t last = index(-1, cells_.rows + 1);
    std::fill(steepest_x_.begin() + last, steepest_x_.end(), 0.0F);
    std::fill(steepest_y_.begin() + last, steepest_y_.end(), 0.0F);
    return true;
  }

  bool limit_sides() {
    next_ = std::max<std::size_t>(next_, wide_);
    const std::size_t end = std::min(next_ + kChunk, count_ - wide_);
    for (; next_ < end; ++next_) {
      const std::size_t at = next_;
      along_x_[at] = limit(value_[at + 1] - value_[at], steepest_x_[at],
                           std::min(slope_[at], slope_[at - wide_]));
      along_y_[at] = limit(value_[at + wide_] - value_[at], steepest_y_[at],
                           std::min(slope_[at], slope_[at - 1]));
    }
    return next_ == count_ - wide_;
  }

  // NaN, between nodes that were never reached, has no limit: only what cannot be flown is there,
  // or what lies beyond the value that ends the search.
  static float limit(float rise, float steepest, float slope) {
    if (steepest > 0.0F) {
      return std::fabs(rise) / steepest;
    }
    return kUnknownShare * slope;
  }

  void offer(std::uint32_t to, float offered) {
    if (offered < value_[to]) {
      value_[to] = offered;
      open_->push(offered, to);
    }
  }

  // Values from the corners of the target outwards.
  template <typename Relax>
  bool spread(const Relax& relax) {
    if (!is_begun_) {
      const std::size_t end = std::min(next_ + kChunk, count_);
      std::fill(value_.begin() + static_cast<std::ptrdiff_t>(next_),
                value_.begin() + static_cast<std::ptrdiff_t>(end), kInfinity);
      std::fill(taken_.begin() + static_cast<std::ptrdiff_t>(next_),
                taken_.begin() + static_cast<std::ptrdiff_t>(end), kInfinity);
      next_ = end;
      if (next_ < count_) {
        return false;
      }
      open_.emplace(0.5F * static_cast<float>(cells_.cell_m), 1.5F * slope_max_);
      for (const std::uint32_t node : target_) {
        value_[node] = 0.0F;
        open_->push(0.0F, node);
      }
      cap_ = kInfinity;
      is_begun_ = true;
    }
    // A node that comes later has at most one bucket less.
    const float slack = static_cast<float>(cells_.cell_m);
    for (int n = 0; n < kStepNodes && !open_->is_empty(); ++n) {
      const std::uint32_t node = open_->pop();
      if (value_[node] >= taken_[node]) {
        continue;
      }
      if (value_[node] > cap_ + slack) {
        return true;
      }
      taken_[node] = value_[node];
      if (std::find(from_.begin(), from_.end(), node) != from_.end()) {
        cap_ = 0.0F;
        for (const std::uint32_t corner : from_) {
          cap_ = std::max(cap_, value_[corner]);
        }
      }
      relax(node);
    }
    return open_->is_empty();
  }

  // At the greatest of the corners of `from`.
  bool cap_values() {
    const std::size_t end = std::min(next_ + kChunk, count_);
    for (; next_ < end; ++next_) {
      value_[next_] = std::min(value_[next_], cap_);
    }
    return next_ == count_;
  }

  const FlightEnvelope* envelope_;
  raster::GridGeometry cells_;
  std::uint32_t wide_;
  std::size_t count_;
  std::array<std::uint32_t, 4> target_, from_;
  std::vector<float> slope_;  // w of a cell times its side
  std::vector<float> along_x_, along_y_;
  std::vector<float> steepest_x_, steepest_y_;
  std::vector<float> value_;
  std::vector<float> other_;  // values from the other end, until the mean is taken
  std::vector<float> taken_;  // with which a node was last passed on
  std::vector<std::uint8_t> is_final_;
  std::optional<Buckets> open_;
  float slope_max_ = 1.0F;
  float cap_ = kInfinity;
  bool has_both_ends_ = false;
  // Where the making stands.
  Phase phase_ = Phase::kRoom;
  int pass_ = 0;
  std::size_t next_ = 0;
  bool is_begun_ = false;
};

CostBoundMaking::CostBoundMaking(const FlightEnvelope& envelope, const geo::MapPoint& target,
                                 const geo::MapPoint& from)
    : bound_(envelope.geometry()) {
  const raster::GridGeometry& cells = bound_.cells_;
  if (!cells.contains(target) || !cells.contains(from)) {
    bound_.cost_m_.assign(
        (static_cast<std::size_t>(cells.columns) + 1) * (static_cast<std::size_t>(cells.rows) + 1),
        0.0F);
    return;
  }
  corners_ = std::make_unique<Corners>(envelope, cells.cell_at(target), cells.cell_at(from));
}

CostBoundMaking::~CostBoundMaking() = default;
CostBoundMaking::CostBoundMaking(CostBoundMaking&&) noexcept = default;
CostBoundMaking& CostBoundMaking::operator=(CostBoundMaking&&) noexcept = default;

bool CostBoundMaking::step() {
  if (corners_ && corners_->step() && corners_->copy_to(bound_.cost_m_)) {
    corners_.reset();
  }
  return !corners_;
}

CostBound CostBoundMaking::take() && { return std::move(bound_); }

double least_cost_m(const FlightEnvelope& envelope) {
  const geo::MapPoint start = envelope.start().point();
  const geo::MapPoint goal = envelope.goal().point();
  CostBoundMaking making(envelope, goal, start);
  if (making.corners_) {
    making.corners_->take_both_ends();
  }
  while (!making.step()) {
  }
  return std::move(making).take().cost_m(start);
}

CostBound::CostBound(const FlightEnvelope& envelope, const geo::MapPoint& target,
                     const geo::MapPoint& from)
    : CostBound(envelope.geometry()) {
  CostBoundMaking making(envelope, target, from);
  while (!making.step()) {
  }
  *this = std::move(making).take();
}

CostBound::CostBound(const raster::GridGeometry& cells) : cells_(cells) {}

double CostBound::corner_value_m(int column, int row) const {
  return static_cast<double>(
      cost_m_[static_cast<std::size_t>(row) * static_cast<std::size_t>(cells_.columns + 1) +
              static_cast<std::size_t>(column)]);
}

double CostBound::corner_cost_m(int column, int row) const {
  return corner_value_m(column, row) * kRounding;
}

double CostBound::cost_m(const geo::MapPoint& from) const {
  if (!cells_.contains(from)) {
    return 0.0;
  }
  const raster::CellIndex cell = cells_.cell_at(from);
  return over_triangles(is_even(cell.column, cell.row),
                        (from.x_m - cells_.west_m) / cells_.cell_m - cell.column,
                        (from.y_m - cells_.south_m) / cells_.cell_m - cell.row,
                        corner_value_m(cell.column, cell.row),
                        corner_value_m(cell.column + 1, cell.row),
                        corner_value_m(cell.column, cell.row + 1),
                        corner_value_m(cell.column + 1, cell.row + 1)) *
         kRounding;
}

}  // namespace hedgehop::global_planning
