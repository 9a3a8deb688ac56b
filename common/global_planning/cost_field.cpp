#include "global_planning/cost_field.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

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

struct Entry {
  float cost_m;
  std::uint32_t block;
};
constexpr auto kIsLater = [](const Entry& a, const Entry& b) {
  return a.cost_m != b.cost_m ? a.cost_m > b.cost_m : a.block > b.block;
};

}  // namespace

CostField::CostField(const FlightEnvelope& envelope, const geo::MapPoint& target, double block_m) {
  const raster::GridGeometry& cells = envelope.geometry();
  const int factor = std::max(1, static_cast<int>(std::floor(block_m / cells.cell_m + 0.5)));
  blocks_ = {cells.west_m, cells.south_m, cells.cell_m * factor,
             (cells.columns + factor - 1) / factor, (cells.rows + factor - 1) / factor};
  // A frame of blocks that cannot be flown saves every test for the border.
  constexpr int kFrame = 2;
  const int wide = blocks_.columns + 2 * kFrame;
  std::vector<float> density(
      static_cast<std::size_t>(wide) * static_cast<std::size_t>(blocks_.rows + 2 * kFrame),
      kInfinity);
  const auto framed = [&](int column, int row) {
    return static_cast<std::size_t>(row + kFrame) * static_cast<std::size_t>(wide) +
           static_cast<std::size_t>(column + kFrame);
  };
  for (int row = 0; row < blocks_.rows; ++row) {
    for (int column = 0; column < blocks_.columns; ++column) {
      double sum = 0.0;
      int flyable = 0;
      for (int y = row * factor; y < std::min((row + 1) * factor, cells.rows); ++y) {
        for (int x = column * factor; x < std::min((column + 1) * factor, cells.columns); ++x) {
          const double here = envelope.low_density({x, y});
          if (here < std::numeric_limits<double>::infinity()) {
            sum += here;
            ++flyable;
          }
        }
      }
      if (flyable > 0) {
        density[framed(column, row)] = static_cast<float>(sum / flyable);
      }
    }
  }
  std::array<std::ptrdiff_t, kNeighbours.size()> jump{};
  for (std::size_t k = 0; k < kNeighbours.size(); ++k) {
    jump[k] = static_cast<std::ptrdiff_t>(kNeighbours[k].rows) * wide + kNeighbours[k].columns;
  }
  std::vector<float> cost(density.size(), kInfinity);
  std::vector<Entry> queue;
  const CellIndex first = blocks_.cell_at(target);
  if (blocks_.contains(first)) {
    const auto at = static_cast<std::uint32_t>(framed(first.column, first.row));
    cost[at] = 0.0F;
    queue.push_back({0.0F, at});
    if (density[at] == kInfinity) {
      density[at] = 1.0F;  // the funnel around an end may reach where the floor does not
    }
  }
  const auto half_block_m = static_cast<float>(0.5 * blocks_.cell_m);
  while (!queue.empty()) {
    std::pop_heap(queue.begin(), queue.end(), kIsLater);
    const Entry entry = queue.back();
    queue.pop_back();
    if (entry.cost_m > cost[entry.block]) {
      continue;
    }
    const float here = density[entry.block];
    for (std::size_t k = 0; k < kNeighbours.size(); ++k) {
      const auto to =
          static_cast<std::uint32_t>(static_cast<std::ptrdiff_t>(entry.block) + jump[k]);
      const float there = density[to];
      const float cost_m = entry.cost_m + (here + there) * (half_block_m * kNeighbours[k].length);
      if (cost_m < cost[to]) {
        cost[to] = cost_m;
        queue.push_back({cost_m, to});
        std::push_heap(queue.begin(), queue.end(), kIsLater);
      }
    }
  }
  cost_m_.reserve(blocks_.cell_count());
  for (int row = 0; row < blocks_.rows; ++row) {
    for (int column = 0; column < blocks_.columns; ++column) {
      cost_m_.push_back(cost[framed(column, row)] / static_cast<float>(kMetrication));
    }
  }
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
    return static_cast<double>(
        cost_m_[static_cast<std::size_t>(r) * static_cast<std::size_t>(blocks_.columns) +
                static_cast<std::size_t>(c)]);
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
