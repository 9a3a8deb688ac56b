#include "global_planning/cost_field.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>

#include "base/errors.hpp"

namespace hedgehop::global_planning {
namespace {

using raster::CellIndex;

constexpr float kInfinity = std::numeric_limits<float>::infinity();
// Longest way through sixteen directions for its straight line: 1 / cos(13.3 deg) of the widest
// gap.
constexpr double kMetrication = 1.0275;

struct Neighbour {
  int columns, rows;
  float length;  // in blocks
};
constexpr std::array<Neighbour, 16> kNeighbours = {{
    {1, 0, 1.0F},
    {-1, 0, 1.0F},
    {0, 1, 1.0F},
    {0, -1, 1.0F},
    {1, 1, 1.41421356F},
    {-1, 1, 1.41421356F},
    {1, -1, 1.41421356F},
    {-1, -1, 1.41421356F},
    {2, 1, 2.23606798F},
    {-2, 1, 2.23606798F},
    {2, -1, 2.23606798F},
    {-2, -1, 2.23606798F},
    {1, 2, 2.23606798F},
    {-1, 2, 2.23606798F},
    {1, -2, 2.23606798F},
    {-1, -2, 2.23606798F},
}};

constexpr auto kIsLater = [](const auto& a, const auto& b) {
  return a.cost_m != b.cost_m ? a.cost_m > b.cost_m : a.block > b.block;
};
// Slopes are averaged over blocks up to so far away to each side.
constexpr double kSlopeReach_m = 200.0;
constexpr int kFrame = 2;
// How far a field that ends at a block is known beyond it.
constexpr float kBeyond = 1.25F;
constexpr float kBeyondBlocks = 30.0F;  // at the least cost of a metre
constexpr float kFormRounding = 1e-4F;

// The cheapest entry first, if none is ever pushed that is cheaper than the last one popped:
// entries wait in buckets by the highest bit in which their cost differs from that one's (R. K.
// Ahuja, K. Mehlhorn, J. B. Orlin and R. E. Tarjan, J. ACM 37(2), 1990, doi:10.1145/77600.77615).
// Costs are not negative, so their bits are ordered as they are.
template <typename Entry>
class MonotoneQueue {
 public:
  void push(const Entry& entry) {
    buckets_[bucket_of(entry)].push_back(entry);
    ++count_;
  }
  [[nodiscard]] bool is_empty() const { return count_ == 0; }
  Entry pop() {
    if (buckets_[0].empty()) {
      refill();
    }
    const Entry entry = buckets_[0].back();
    buckets_[0].pop_back();
    --count_;
    return entry;
  }

 private:
  [[nodiscard]] std::size_t bucket_of(const Entry& entry) const {
    return static_cast<std::size_t>(
        std::bit_width(std::bit_cast<std::uint32_t>(entry.cost_m) ^ last_));
  }
  // The cheapest entries become those of the first bucket.
  void refill() {
    std::size_t first = 1;
    while (buckets_[first].empty()) {
      ++first;
    }
    moved_.swap(buckets_[first]);
    last_ = std::bit_cast<std::uint32_t>(
        std::min_element(moved_.begin(), moved_.end(), [](const Entry& a, const Entry& b) {
          return a.cost_m < b.cost_m;
        })->cost_m);
    for (const Entry& entry : moved_) {
      buckets_[bucket_of(entry)].push_back(entry);
    }
    moved_.clear();
  }

  std::array<std::vector<Entry>, 33> buckets_;
  std::vector<Entry> moved_;
  std::uint32_t last_ = 0;
  std::size_t count_ = 0;
};

}  // namespace

CostField::CostField(const raster::GridGeometry& cells, double block_m) {
  factor_ = std::max(1, static_cast<int>(std::floor(block_m / cells.cell_m + 0.5)));
  blocks_ = {cells.west_m, cells.south_m, cells.cell_m * factor_,
             (cells.columns + factor_ - 1) / factor_, (cells.rows + factor_ - 1) / factor_};
  wide_ = blocks_.columns + 2 * kFrame;
  density_.assign(
      static_cast<std::size_t>(wide_) * static_cast<std::size_t>(blocks_.rows + 2 * kFrame),
      kInfinity);
  for (std::size_t k = 0; k < kNeighbours.size(); ++k) {
    jump_.push_back(static_cast<std::ptrdiff_t>(kNeighbours[k].rows) * wide_ +
                    kNeighbours[k].columns);
  }
  climb_m_.assign(density_.size(), 0.0F);
  cost_m_.assign(density_.size(), kInfinity);
}

CostField::CostField(const FlightEnvelope& envelope, double block_m)
    : CostField(envelope.geometry(), block_m) {
  for (int row = 0; row < blocks_.rows; ++row) {
    for (int column = 0; column < blocks_.columns; ++column) {
      density_[framed(column, row)] = mean_density(envelope, column, row);
    }
  }
  take_climbs(envelope);
  if (!envelope.costs().has_slope()) {
    return;
  }
  slope_.assign(density_.size(), {});
  for (int row = 0; row < blocks_.rows; ++row) {
    for (int column = 0; column < blocks_.columns; ++column) {
      slope_[framed(column, row)] = mean_slope(envelope, column, row);
    }
  }
}

CostField::CostField(const FlightEnvelope& envelope, const geo::MapPoint& target, double block_m)
    : CostField(envelope, block_m) {
  begin_at(target);
  spread();
}

CostField::CostField(const CostField& blocks, const geo::MapPoint& target,
                     const geo::MapPoint& from)
    : CostField(blocks) {
  std::fill(cost_m_.begin(), cost_m_.end(), kInfinity);
  begin_at(target);
  const CellIndex last = blocks_.cell_at(from);
  spread(blocks_.contains(last) ? framed(last.column, last.row) : kNoBlock);
}

std::optional<CostField> CostField::with_numbers(const raster::GridGeometry& cells, double block_m,
                                                 std::vector<float> numbers) {
  CostField field(cells, block_m);
  const std::size_t blocks = field.density_.size();
  if (numbers.size() == 5 * blocks) {
    for (std::size_t i = 0; i < blocks; ++i) {
      const float* form = numbers.data() + 2 * blocks + 3 * i;
      // No direction may cost less than nothing.
      if (!(form[0] >= 0.0F && form[2] >= 0.0F && std::isfinite(form[0]) &&
            std::isfinite(form[2]) &&
            form[1] * form[1] <= 4.0F * form[0] * form[2] * (1.0F + kFormRounding))) {
        return std::nullopt;
      }
      field.slope_.push_back({form[0], form[1], form[2]});
    }
    numbers.resize(2 * blocks);
  }
  if (numbers.size() != 2 * blocks) {
    return std::nullopt;
  }
  const auto densities = numbers.begin() + static_cast<std::ptrdiff_t>(blocks);
  if (!std::all_of(numbers.begin(), densities,
                   [](float climb_m) { return std::isfinite(climb_m); })) {
    return std::nullopt;
  }
  field.climb_m_.assign(numbers.begin(), densities);
  // A metre costs at least 1, and nothing leads through the frame.
  for (int row = -kFrame; row < field.blocks_.rows + kFrame; ++row) {
    for (int column = -kFrame; column < field.blocks_.columns + kFrame; ++column) {
      const float density = densities[field.framed(column, row)];
      if (!(density >= 1.0F) ||
          (!field.blocks_.contains(CellIndex{column, row}) && density < kInfinity)) {
        return std::nullopt;
      }
    }
  }
  field.density_.assign(densities, numbers.end());
  return field;
}

std::vector<float> CostField::numbers() const {
  std::vector<float> numbers = climb_m_;
  numbers.insert(numbers.end(), density_.begin(), density_.end());
  for (const std::array<float, 3>& form : slope_) {
    numbers.insert(numbers.end(), form.begin(), form.end());
  }
  return numbers;
}

void CostField::begin_at(const geo::MapPoint& target) {
  const CellIndex first = blocks_.cell_at(target);
  has_target_ = blocks_.contains(first);
  if (has_target_) {
    target_ = framed(first.column, first.row);
    cost_m_[target_] = 0.0F;
    open_.push_back({0.0F, target_});
    if (density_[target_] == kInfinity) {
      density_[target_] = 1.0F;  // the funnel around an end may reach where the floor does not
    }
  }
}

std::uint32_t CostField::framed(int column, int row) const {
  return static_cast<std::uint32_t>((row + kFrame) * wide_ + column + kFrame);
}

float CostField::mean_density(const FlightEnvelope& envelope, int column, int row) const {
  const raster::GridGeometry& cells = envelope.geometry();
  double sum = 0.0;
  int flyable = 0;
  for (int y = row * factor_; y < std::min((row + 1) * factor_, cells.rows); ++y) {
    for (int x = column * factor_; x < std::min((column + 1) * factor_, cells.columns); ++x) {
      const double here = envelope.low_density({x, y});
      if (here < std::numeric_limits<double>::infinity()) {
        sum += here;
        ++flyable;
      }
    }
  }
  return flyable > 0 ? static_cast<float>(sum / flyable) : kInfinity;
}

std::array<float, 3> CostField::mean_slope(const FlightEnvelope& envelope, int column,
                                           int row) const {
  const raster::GridGeometry& cells = envelope.geometry();
  std::array<double, 3> sum{};
  int known = 0;
  for (int y = row * factor_; y < std::min((row + 1) * factor_, cells.rows); ++y) {
    for (int x = column * factor_; x < std::min((column + 1) * factor_, cells.columns); ++x) {
      const std::array<double, 3> form = envelope.costs().slope_form(
          static_cast<std::size_t>(y) * static_cast<std::size_t>(cells.columns) +
          static_cast<std::size_t>(x));
      if (!std::isnan(form[0])) {
        for (std::size_t i = 0; i < form.size(); ++i) {
          sum[i] += form[i];
        }
        ++known;
      }
    }
  }
  const double share = known > 0 ? 1.0 / known : 0.0;
  return {static_cast<float>(share * sum[0]), static_cast<float>(share * sum[1]),
          static_cast<float>(share * sum[2])};
}

// Sums over the cells of each block, then over the blocks around, column by column and row by row.
void CostField::take_climbs(const FlightEnvelope& envelope) {
  const raster::Grid<float>& surface_m = envelope.costs().map().surface_m;
  struct Sum {
    double height_m = 0.0;
    double cells = 0.0;
    void add(const Sum& other, double sign) {
      height_m += sign * other.height_m;
      cells += sign * other.cells;
    }
  };
  raster::Grid<Sum> sums(blocks_, {});
  for (int row = 0; row < surface_m.geometry().rows; ++row) {
    for (int column = 0; column < surface_m.geometry().columns; ++column) {
      if (const auto height_m = static_cast<double>(surface_m.at(column, row));
          !std::isnan(height_m)) {
        sums.at(column / factor_, row / factor_).add({height_m, 1.0}, 1.0);
      }
    }
  }
  const int around = std::max(1, static_cast<int>(std::floor(kSlopeReach_m / blocks_.cell_m)));
  std::vector<Sum> line;
  const auto spread_line = [&](int count, const auto& at) {
    line.assign(static_cast<std::size_t>(count), {});
    for (int i = 0; i < count; ++i) {
      line[static_cast<std::size_t>(i)] = at(i);
    }
    Sum sum;
    for (int i = -around; i < count; ++i) {
      if (i + around < count) {
        sum.add(line[static_cast<std::size_t>(i + around)], 1.0);
      }
      if (i - around > 0) {
        sum.add(line[static_cast<std::size_t>(i - around - 1)], -1.0);
      }
      if (i >= 0) {
        at(i) = sum;
      }
    }
  };
  for (int row = 0; row < blocks_.rows; ++row) {
    spread_line(blocks_.columns, [&](int i) -> Sum& { return sums.at(i, row); });
  }
  for (int column = 0; column < blocks_.columns; ++column) {
    spread_line(blocks_.rows, [&](int i) -> Sum& { return sums.at(column, i); });
  }
  const SlopeLimits::Tangents limits = envelope.slopes().greatest();
  const double tangent = std::max(limits.up, limits.down);
  if (!(tangent > 0.0)) {
    return;
  }
  for (int row = 0; row < blocks_.rows; ++row) {
    for (int column = 0; column < blocks_.columns; ++column) {
      const Sum& sum = sums.at(column, row);
      if (sum.cells > 0.5) {
        climb_m_[framed(column, row)] = static_cast<float>(sum.height_m / (sum.cells * tangent));
      }
    }
  }
}

float CostField::step_cost(std::uint32_t from, std::uint32_t to, std::size_t k) const {
  const Neighbour& step = kNeighbours[k];
  const float half_m = 0.5F * std::max(static_cast<float>(blocks_.cell_m) * step.length,
                                       std::fabs(climb_m_[from] - climb_m_[to]));
  const float densities = density_[from] + density_[to];
  if (slope_.empty()) {
    return densities * half_m;
  }
  const auto dx = static_cast<float>(step.columns);
  const auto dy = static_cast<float>(step.rows);
  const std::array<float, 3>& a = slope_[from];
  const std::array<float, 3>& b = slope_[to];
  const float slopes =
      std::max((a[0] + b[0]) * (dx * dx) + (a[1] + b[1]) * (dx * dy) + (a[2] + b[2]) * (dy * dy),
               0.0F) /
      (step.length * step.length);
  return (densities + slopes) * half_m;
}

void CostField::spread(std::uint32_t last) {
  MonotoneQueue<Entry> queue;
  for (const Entry& entry : open_) {
    queue.push(entry);
  }
  open_.clear();
  float limit_m = kInfinity;
  while (!queue.is_empty()) {
    const Entry entry = queue.pop();
    if (entry.cost_m > cost_m_[entry.block]) {
      continue;
    }
    if (entry.cost_m > limit_m) {
      return;
    }
    if (entry.block == last) {
      limit_m = entry.cost_m * kBeyond + kBeyondBlocks * static_cast<float>(blocks_.cell_m);
    }
    for (std::size_t k = 0; k < kNeighbours.size(); ++k) {
      const auto to =
          static_cast<std::uint32_t>(static_cast<std::ptrdiff_t>(entry.block) + jump_[k]);
      if (!(entry.cost_m < cost_m_[to])) {
        continue;
      }
      const float cost_m = entry.cost_m + step_cost(entry.block, to, k);
      if (cost_m < cost_m_[to]) {
        cost_m_[to] = cost_m;
        queue.push({cost_m, to});
      }
    }
  }
}

bool CostField::costs_as(const CostField& other, const geo::MapPoint& a,
                         const geo::MapPoint& b) const {
  const double length_m = std::hypot(b.x_m - a.x_m, b.y_m - a.y_m);
  const int steps = static_cast<int>(4.0 * length_m / blocks_.cell_m) + 1;
  for (int i = 0; i <= steps; ++i) {
    const double t = static_cast<double>(i) / steps;
    const CellIndex at =
        blocks_.cell_at({a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m)});
    if (blocks_.contains(at)) {
      const std::uint32_t block = framed(at.column, at.row);
      if (density_[block] != other.density_[block]) {
        return false;
      }
    }
  }
  return true;
}

std::size_t CostField::repair(const FlightEnvelope& envelope, const raster::Window& changed) {
  std::vector<std::uint32_t> touched;
  const int west = std::max(changed.column / factor_, 0);
  const int south = std::max(changed.row / factor_, 0);
  const int east = std::min((changed.column + changed.columns - 1) / factor_, blocks_.columns - 1);
  const int north = std::min((changed.row + changed.rows - 1) / factor_, blocks_.rows - 1);
  for (int row = south; row <= north; ++row) {
    for (int column = west; column <= east; ++column) {
      const std::uint32_t at = framed(column, row);
      float density = mean_density(envelope, column, row);
      if (has_target_ && at == target_ && density == kInfinity) {
        density = 1.0F;
      }
      if (density != density_[at]) {
        density_[at] = density;
        touched.push_back(at);
      }
    }
  }
  // Blocks by the cost they had, those nearest to the target first: whatever carries a block costs
  // less than it, so it is known by then whether it stays.
  const auto neighbour = [&](std::uint32_t block, std::size_t k) {
    return static_cast<std::uint32_t>(static_cast<std::ptrdiff_t>(block) + jump_[k]);
  };
  std::vector<Entry> doubtful;
  std::vector<std::uint8_t> is_doubted(cost_m_.size());
  const auto doubt = [&](std::uint32_t block) {
    if (is_doubted[block] == 0 && cost_m_[block] < kInfinity && block != target_) {
      is_doubted[block] = 1;
      doubtful.push_back({cost_m_[block], block});
      std::push_heap(doubtful.begin(), doubtful.end(), kIsLater);
    }
  };
  for (const std::uint32_t block : touched) {
    doubt(block);
    for (std::size_t k = 0; k < kNeighbours.size(); ++k) {
      doubt(neighbour(block, k));
    }
  }
  std::vector<std::uint32_t> forgotten;
  while (!doubtful.empty()) {
    std::pop_heap(doubtful.begin(), doubtful.end(), kIsLater);
    const Entry entry = doubtful.back();
    doubtful.pop_back();
    bool is_carried = false;
    for (std::size_t k = 0; k < kNeighbours.size() && !is_carried; ++k) {
      const std::uint32_t from = neighbour(entry.block, k);
      is_carried = cost_m_[from] + step_cost(from, entry.block, k) == entry.cost_m;
    }
    if (is_carried) {
      continue;
    }
    cost_m_[entry.block] = kInfinity;
    forgotten.push_back(entry.block);
    for (std::size_t k = 0; k < kNeighbours.size(); ++k) {
      const std::uint32_t to = neighbour(entry.block, k);
      if (cost_m_[to] > entry.cost_m) {
        doubt(to);
      }
    }
  }
  // Each forgotten or changed block takes the best that its neighbours offer.
  std::size_t made_cheaper = 0;
  const auto take = [&](std::uint32_t block, bool counts) {
    if (!(density_[block] < kInfinity)) {
      return;  // the frame too
    }
    float best_m = cost_m_[block];
    for (std::size_t k = 0; k < kNeighbours.size(); ++k) {
      const std::uint32_t from = neighbour(block, k);
      best_m = std::min(best_m, cost_m_[from] + step_cost(from, block, k));
    }
    if (best_m < cost_m_[block]) {
      cost_m_[block] = best_m;
      open_.push_back({best_m, block});
      made_cheaper += counts ? 1 : 0;
    }
  };
  for (const std::uint32_t block : forgotten) {
    take(block, false);
  }
  for (const std::uint32_t block : touched) {
    take(block, true);
    for (std::size_t k = 0; k < kNeighbours.size(); ++k) {
      take(neighbour(block, k), true);
    }
  }
  spread();
  return forgotten.size() + made_cheaper;
}

std::vector<geo::MapPoint> CostField::way_from(const geo::MapPoint& from) const {
  std::vector<geo::MapPoint> way;
  if (!has_target_ || !blocks_.contains(from)) {
    return way;
  }
  const CellIndex first = blocks_.cell_at(from);
  std::uint32_t at = framed(first.column, first.row);
  const auto centre = [&](std::uint32_t block) {
    const int column = static_cast<int>(block) % wide_ - kFrame;
    const int row = static_cast<int>(block) / wide_ - kFrame;
    return blocks_.centre({column, row});
  };
  if (!(cost_m_[at] < kInfinity)) {
    return way;
  }
  way.push_back(centre(at));
  while (at != target_) {
    std::uint32_t next = at;
    float best_m = kInfinity;
    for (std::size_t k = 0; k < kNeighbours.size(); ++k) {
      const auto to = static_cast<std::uint32_t>(static_cast<std::ptrdiff_t>(at) + jump_[k]);
      const float cost_m = cost_m_[to] + step_cost(to, at, k);
      if (cost_m_[to] < cost_m_[at] && cost_m < best_m) {
        best_m = cost_m;
        next = to;
      }
    }
    HEDGEHOP_ASSERT(next != at);
    at = next;
    way.push_back(centre(at));
  }
  return way;
}

double CostField::cost_m(const geo::MapPoint& from) const {
  if (!blocks_.contains(from)) {
    return std::numeric_limits<double>::infinity();
  }
  const double u = std::clamp((from.x_m - blocks_.west_m) / blocks_.cell_m - 0.5, 0.0,
                              static_cast<double>(blocks_.columns - 1));
  const double v = std::clamp((from.y_m - blocks_.south_m) / blocks_.cell_m - 0.5, 0.0,
                              static_cast<double>(blocks_.rows - 1));
  const int column = std::min(static_cast<int>(u), std::max(blocks_.columns - 2, 0));
  const int row = std::min(static_cast<int>(v), std::max(blocks_.rows - 2, 0));
  const int right = std::min(column + 1, blocks_.columns - 1);
  const int up = std::min(row + 1, blocks_.rows - 1);
  const auto at = [&](int c, int r) {
    return static_cast<double>(cost_m_[framed(c, r)] / static_cast<float>(kMetrication));
  };
  const double fu = u - column;
  const double fv = v - row;
  // Blocks that cannot be flown do not take part.
  double sum = 0.0;
  double weights = 0.0;
  const auto add = [&](double value, double weight) {
    if (value < std::numeric_limits<double>::infinity()) {
      sum += weight * value;
      weights += weight;
    }
  };
  add(at(column, row), (1.0 - fu) * (1.0 - fv));
  add(at(right, row), fu * (1.0 - fv));
  add(at(column, up), (1.0 - fu) * fv);
  add(at(right, up), fu * fv);
  return weights > 0.0 ? sum / weights : std::numeric_limits<double>::infinity();
}

}  // namespace hedgehop::global_planning
