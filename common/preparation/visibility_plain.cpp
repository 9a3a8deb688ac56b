#include <algorithm>
#include <cmath>
#include <limits>

#include "map/map.hpp"
#include "preparation/visibility.hpp"
#include "preparation/visibility_lines.hpp"

namespace hedgehop::preparation {
namespace {

// What is added up over the rays of one cell; `further` as in the kernel.
struct PlainSums {
  std::uint32_t seen = 0;
  std::uint32_t known = 0;
  std::uint32_t further_known = 0;
  std::vector<std::uint32_t> further;  // at reference height, then at each further one
};

float known_or_far_below(const raster::Grid<float>& grid, int column, int row) {
  const raster::CellIndex cell{column, row};
  return grid.geometry().contains(cell) ? padded_height_m(grid.at(cell)) : kFarBelow_m;
}

void add_plain_line(const VisibilityGround& ground, const SightLine& line, bool is_transposed,
                    raster::CellIndex cell, float eye_m, PlainSums& sums) {
  const raster::GridGeometry& g = ground.surface_m.geometry();
  const std::int64_t origin = rows_from_origin(is_transposed ? g.west_m : g.south_m, g.cell_m);
  const int column = is_transposed ? cell.row : cell.column;
  const int row = is_transposed ? cell.column : cell.row;
  const Foot foot = foot_on_line(line.slope, origin + row);
  const std::size_t heights = line.has_further ? sums.further.size() - 1 : 0;
  for (const int direction : {1, -1}) {
    float greatest = kLowestSlope;
    std::vector<float> further_greatest(heights, kLowestSlope);
    for (int k = 1; k <= line.steps.count; ++k) {
      const auto step = static_cast<std::size_t>(k - 1 + kBlockRows);
      const int r = row + direction * k;
      const bool is_exact = k <= kExactSteps;
      const Crossing crossing = is_exact ? crossing_beside(line.slope, direction * k)
                                         : crossing_of_line(line.slope, foot.phase, origin + r);
      const int c = column + (is_exact ? 0 : foot.shift) + crossing.left;
      const auto at = [&](int beside) {
        return is_transposed ? known_or_far_below(ground.opaque_m, r, c + beside)
                             : known_or_far_below(ground.opaque_m, c + beside, r);
      };
      const float left_m = at(0);
      const float z_m = std::fma(crossing.fraction, at(1) - left_m, left_m);
      const bool is_left = crossing.fraction < 0.5F;
      const float edge_m =
          is_exact ? 0.0F
                   : edge_height_m(crossing.fraction, left_m, at(1), at(is_left ? -1 : 2), z_m);
      float counts = line.steps.weight[step];
      if (ground.weight != nullptr) {
        const int beside = is_left ? 0 : 1;
        const raster::CellIndex seer =
            is_transposed ? raster::CellIndex{r, c + beside} : raster::CellIndex{c + beside, r};
        counts *= g.contains(seer) ? std::min(ground.weight->at(seer), kGroundWeightMax) : 0.0F;
      }
      const auto add = static_cast<std::uint32_t>(counts);
      const float inverse_distance = line.steps.inverse_distance_1pm[step];
      const float slope = std::fma(z_m - eye_m, inverse_distance, -line.steps.drop_slope[step]);
      const float looked_at = std::fma(edge_m, inverse_distance, slope);
      if (looked_at >= greatest) {
        sums.seen += add;
        if (line.has_further) {
          sums.further[0] += add;
        }
      }
      greatest = std::max(greatest, slope);
      if (z_m > kUnknownBelow_m) {
        sums.known += add;
        sums.further_known += line.has_further ? add : 0;
      }
      for (std::size_t i = 0; i < heights; ++i) {
        const float further = line.steps.further_slopes[step * heights + i];
        if (looked_at - further >= further_greatest[i]) {
          sums.further[i + 1] += add;
        }
        further_greatest[i] = std::max(further_greatest[i], slope - further);
      }
    }
  }
}

}  // namespace

VisibilityLayers plain_visibility_of_block(const VisibilityGround& ground, raster::CellIndex block,
                                           int columns, int rows,
                                           const VisibilityOptions& options) {
  const raster::GridGeometry& g = ground.surface_m.geometry();
  validate(options, g.cell_m);
  validate(ground, block, columns, rows);
  const raster::GridGeometry geometry = geometry_of_block(g, block, columns, rows);
  VisibilityLayers layers;
  layers.shares.assign(options.further_heights_m.size() + 1,
                       raster::Grid<std::uint16_t>(geometry, map::kVisibilityUnknown));
  layers.is_partial = partial_surroundings(ground.opaque_m, block, columns, rows, options.radius_m);
  const bool has_weights = ground.weight != nullptr;
  const std::vector<SightLine> along_y = sight_lines(options, g.cell_m, false, has_weights);
  const std::vector<SightLine> along_x = sight_lines(options, g.cell_m, true, has_weights);
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const raster::CellIndex cell{block.column + column, block.row + row};
      const float ground_m = padded_height_m(ground.surface_m.at(cell));
      if (ground_m < kUnknownBelow_m) {
        continue;
      }
      const float eye_m = ground_m + static_cast<float>(options.reference_height_m);
      PlainSums sums;
      sums.further.assign(options.further_heights_m.size() + 1, 0);
      for (const SightLine& line : along_y) {
        add_plain_line(ground, line, false, cell, eye_m, sums);
      }
      for (const SightLine& line : along_x) {
        add_plain_line(ground, line, true, cell, eye_m, sums);
      }
      if (sums.known == 0) {
        continue;
      }
      const double share = static_cast<double>(sums.seen) / static_cast<double>(sums.known);
      layers.shares[0].at(column, row) = stored_share(share);
      for (std::size_t i = 1; i < layers.shares.size(); ++i) {
        layers.shares[i].at(column, row) = further_share(
            share, std::int64_t{sums.further[i]} - sums.further[0], sums.further_known);
      }
    }
  }
  order_by_height(options, layers.shares);
  return layers;
}

double reference_visibility_share(const VisibilityGround& ground, raster::CellIndex cell,
                                  double height_m, const VisibilityOptions& options) {
  const raster::Grid<float>& opaque_m = ground.opaque_m;
  const raster::Grid<float>& surface_m = ground.surface_m;
  const raster::GridGeometry& g = surface_m.geometry();
  validate(options, g.cell_m);
  // In heights: a cell d away looks lower by this times d^2 [1/m].
  const double drop_1pm = drop_per_square_1pm(options);
  if (!g.contains(cell) || std::isnan(surface_m.at(cell))) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  const double eye_m = static_cast<double>(surface_m.at(cell)) + height_m;
  const int reach = static_cast<int>(std::ceil(options.radius_m / g.cell_m));
  std::int64_t seen = 0;
  std::int64_t known = 0;
  for (int dy = -reach; dy <= reach; ++dy) {
    for (int dx = -reach; dx <= reach; ++dx) {
      const raster::CellIndex target{cell.column + dx, cell.row + dy};
      const double distance = std::hypot(dx, dy);
      if ((dx == 0 && dy == 0) || distance * g.cell_m > options.radius_m || !g.contains(target) ||
          std::isnan(opaque_m.at(target))) {
        continue;
      }
      const std::int64_t weight =
          ground.weight == nullptr ? 1 : std::min(ground.weight->at(target), kGroundWeightMax);
      known += weight;
      const auto slope_to = [&](double z_m, double cells) {
        const double distance_m = cells * g.cell_m;
        return (z_m - drop_1pm * distance_m * distance_m - eye_m) / distance_m;
      };
      const double target_slope = slope_to(static_cast<double>(opaque_m.at(target)), distance);
      const int steps = std::max(std::abs(dx), std::abs(dy));
      bool is_seen = true;
      for (int k = 1; k < steps && is_seen; ++k) {
        const double t = static_cast<double>(k) / steps;
        const double x = cell.column + t * dx;
        const double y = cell.row + t * dy;
        const bool is_along_x = std::abs(dx) >= std::abs(dy);
        const int column =
            is_along_x ? cell.column + (dx > 0 ? k : -k) : static_cast<int>(std::floor(x));
        const int row = is_along_x ? static_cast<int>(std::floor(y)) : cell.row + (dy > 0 ? k : -k);
        const double fraction = is_along_x ? y - row : x - column;
        double z_m = static_cast<double>(opaque_m.at(column, row));
        if (fraction > 1e-9) {
          const double next_m = is_along_x ? static_cast<double>(opaque_m.at(column, row + 1))
                                           : static_cast<double>(opaque_m.at(column + 1, row));
          z_m += fraction * (next_m - z_m);
        }
        is_seen = !(slope_to(z_m, t * distance) > target_slope);
      }
      seen += is_seen ? weight : 0;
    }
  }
  return known == 0 ? std::numeric_limits<double>::quiet_NaN()
                    : static_cast<double>(seen) / static_cast<double>(known);
}

}  // namespace hedgehop::preparation
