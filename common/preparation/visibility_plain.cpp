#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "map/map.hpp"
#include "preparation/visibility.hpp"
#include "preparation/visibility_lines.hpp"

namespace hedgehop::preparation {
namespace {

// What is added up over the rays of one cell; `further` as in the kernel.
struct PlainSums {
  std::int64_t seen = 0;
  std::int64_t known = 0;
  std::int64_t further_known = 0;
  std::vector<std::int64_t> further;  // at reference height, then at each further one
};

// What one ray has seen from one height.
struct PlainView {
  std::int64_t greatest = 0;
  std::int64_t seen = 0;
};

void add_plain_line(const VisibilityGround& ground, const SightLine& line, bool is_transposed,
                    raster::CellIndex cell, int eye, PlainSums& sums) {
  const raster::GridGeometry& g = ground.surface_m.geometry();
  const std::int64_t origin = rows_from_origin(is_transposed ? g.west_m : g.south_m, g.cell_m);
  const int column = is_transposed ? cell.row : cell.column;
  const int row = is_transposed ? cell.column : cell.row;
  const Foot foot = foot_on_line(line.slope, origin + row);
  const RaySteps& steps = line.steps;
  const std::int64_t limit = steps.limit;
  const auto saturated = [limit](std::int64_t value) {
    return std::clamp(value, -limit - 1, limit);
  };
  const auto scaled = [](std::int64_t value, int ratio) {
    return (value * ratio + kOne / 2) >> 15;
  };
  // Heights in units; nothing where unknown.
  const auto ground_at = [&](raster::CellIndex of) -> std::optional<std::int64_t> {
    if (!g.contains(of) || std::isnan(ground.opaque_m.at(of))) {
      return std::nullopt;
    }
    return ground_in_units(ground.opaque_m.at(of), steps.units_per_metre);
  };
  const std::size_t heights = line.has_further ? sums.further.size() - 1 : 0;
  for (const int direction : {1, -1}) {
    std::vector<PlainView> views(1 + heights, {-limit - 1, 0});
    int ring = 1;
    std::int64_t raised = 0;  // what has been seen is, in place of the far block being lowered
    for (int k = 1; k <= steps.count; ++k) {
      const int r = row + direction * k;
      // Blocks lie where multiples of kBlockRows in the map frame are.
      const auto row_in_block = static_cast<int>((origin + r) & (kBlockRows - 1));
      const int in_block = direction > 0 ? row_in_block : kBlockRows - 1 - row_in_block;
      const bool is_in_far_block = is_far(k - in_block);
      const int first = is_in_far_block ? k - in_block : k;
      const auto at = static_cast<std::size_t>(
          is_in_far_block ? steps.block_at[static_cast<std::size_t>(first)] + in_block : k);
      const bool is_entering_block = is_in_far_block && first == k;
      for (PlainView& view : views) {
        if (is_entering_block) {
          view.greatest = saturated(view.greatest - raised);
        }
        if (ring_of(first) > ring) {
          view.greatest = std::max(saturated(2 * view.greatest), -limit);
        }
        if (is_entering_block) {
          view.greatest = saturated(view.greatest + steps.numbers.drop[at]);
        }
      }
      ring = ring_of(first);
      raised = is_entering_block ? steps.numbers.drop[at] : raised;

      const bool is_exact = k <= kExactSteps;
      const Crossing crossing = is_exact ? crossing_beside(line.slope, direction * k)
                                         : crossing_of_line(line.slope, foot.phase, origin + r);
      const int c = column + (is_exact ? 0 : foot.shift) + crossing.left;
      const auto cell_beside = [&](int beside) {
        return is_transposed ? raster::CellIndex{r, c + beside} : raster::CellIndex{c + beside, r};
      };
      const auto height = [&](int beside) { return ground_at(cell_beside(beside)); };
      const int near = to_nearest(crossing.fraction);
      const std::optional<std::int64_t> left = height(0);
      const std::optional<std::int64_t> right = height(to_right(crossing.fraction));
      if (!left || !right) {
        continue;
      }
      const std::int64_t z = *left + scaled(saturated(*right - *left), crossing.fraction);
      std::int64_t looked_at_z = z;
      if (!is_exact) {
        const std::optional<std::int64_t> nearest = height(near);
        const std::optional<std::int64_t> before = height(near - 1);
        const std::optional<std::int64_t> after = height(near + 1);
        if (nearest && before && after) {
          const std::int64_t bend =
              saturated(saturated(*before - *nearest) + saturated(*after - *nearest));
          const bool is_edge = std::abs(bend) > kEdge_m * steps.units_per_metre;
          const bool is_smooth = std::abs(bend) <= kSmoothBendUnits;
          const bool is_level = *before == *nearest && *after == *nearest;
          const int raise = is_level ? steps.level_raise : is_smooth ? steps.smooth_raise : 0;
          looked_at_z = is_edge ? *nearest : z + raise;
        }
      }
      int counts = steps.numbers.weight[at];
      if (ground.weight != nullptr) {
        const raster::CellIndex seer = cell_beside(near);
        counts =
            counted_weight(counts, g.contains(seer) ? weight_in_units(ground.weight->at(seer)) : 0);
      }
      sums.known += counts;
      sums.further_known += line.has_further ? counts : 0;
      const std::int64_t lowered =
          is_in_far_block ? steps.numbers.rest_of_drop[at] : steps.numbers.drop[at];
      const auto slope_of = [&](std::int64_t looked_at) {
        return saturated(scaled(saturated(looked_at - eye), steps.numbers.ratio[at]) - lowered);
      };
      const bool counts_tie = k % 2 == 1;
      for (std::size_t i = 0; i < views.size(); ++i) {
        PlainView& view = views[i];
        const std::int64_t lower = i == 0 ? 0 : steps.numbers.lower[at * heights + i - 1];
        const std::int64_t looked_at = saturated(slope_of(looked_at_z) - lower);
        if (looked_at > view.greatest || (counts_tie && looked_at == view.greatest)) {
          view.seen += counts;
        }
        view.greatest = std::max(view.greatest, saturated(slope_of(z) - lower));
      }
    }
    sums.seen += views[0].seen;
    for (std::size_t i = 0; line.has_further && i < views.size(); ++i) {
      sums.further[i] += views[i].seen;
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
  const std::vector<SightLine> along_y = sight_lines(options, g.cell_m, false);
  const std::vector<SightLine> along_x = sight_lines(options, g.cell_m, true);
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const raster::CellIndex cell{block.column + column, block.row + row};
      if (std::isnan(ground.surface_m.at(cell))) {
        continue;
      }
      const int eye =
          eye_in_units(ground.surface_m.at(cell), static_cast<float>(options.reference_height_m),
                       units_per_metre(options));
      PlainSums sums;
      sums.further.assign(options.further_heights_m.size() + 1, 0);
      for (const SightLine& line : along_y) {
        add_plain_line(ground, line, false, cell, eye, sums);
      }
      for (const SightLine& line : along_x) {
        add_plain_line(ground, line, true, cell, eye, sums);
      }
      if (sums.known == 0) {
        continue;
      }
      const double share = static_cast<double>(sums.seen) / static_cast<double>(sums.known);
      layers.shares[0].at(column, row) = stored_share(share);
      for (std::size_t i = 1; i < layers.shares.size(); ++i) {
        layers.shares[i].at(column, row) =
            further_share(share, sums.further[i] - sums.further[0], sums.further_known);
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
