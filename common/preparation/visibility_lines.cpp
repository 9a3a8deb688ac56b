#include "preparation/visibility_lines.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "map/map.hpp"

namespace hedgehop::preparation {

void validate(const VisibilityOptions& options, double cell_m) {
  if (options.azimuths < 8 || options.azimuths % 4 != 0 || options.azimuths > 1000) {
    throw std::invalid_argument("visibility: azimuths must be a multiple of 4 in 8..1000, not " +
                                std::to_string(options.azimuths));
  }
  if (!(options.radius_m >= 2.0 * cell_m) || !(options.radius_m <= 2000.0 * cell_m)) {
    throw std::invalid_argument("visibility: radius must span 2 to 2000 cells");
  }
  if (!(options.reference_height_m >= 0.0)) {
    throw std::invalid_argument("visibility: reference height must not be negative");
  }
  for (const double height_m : options.further_heights_m) {
    if (!(height_m >= 0.0 && height_m <= 10000.0)) {
      throw std::invalid_argument("visibility: further heights must lie in 0 to 10000 m");
    }
  }
  if (!(options.refraction >= 0.0 && options.refraction < 1.0)) {
    throw std::invalid_argument("visibility: refraction must lie in 0 to 1");
  }
}

namespace {

RaySteps ray_steps(const VisibilityOptions& options, double step_m, double ray_weight) {
  RaySteps steps;
  steps.count = static_cast<int>(std::floor(options.radius_m / step_m));
  const double drop_1pm = drop_per_square_1pm(options);
  const auto weight_within = [&](double distance_m) {
    const double share = std::clamp(distance_m / options.radius_m, 0.0, 1.0);
    return std::round(ray_weight * share * share);
  };
  double before = 0.0;
  for (int k = 1 - kBlockRows; k <= steps.count + 2 * kBlockRows; ++k) {
    const double distance_m = k * step_m;
    double weight = 0.0;
    if (k >= 1 && k <= steps.count) {
      const double outer_m = k == steps.count ? options.radius_m : distance_m + 0.5 * step_m;
      weight = weight_within(outer_m) - weight_within(distance_m - 0.5 * step_m);
    }
    steps.weight.push_back(static_cast<float>(weight));
    const double line_weight = k > kExactSteps ? weight : 0.0;
    steps.line_weight.push_back(static_cast<float>(line_weight));
    steps.line_weight_before.push_back(static_cast<float>(before));
    before += line_weight;
    // Behind the eye all slopes are the lowest, so that the greatest stays.
    steps.inverse_distance_1pm.push_back(k < 1 ? 0.0F : static_cast<float>(1.0 / distance_m));
    steps.drop_slope.push_back(k < 1 ? -kLowestSlope : static_cast<float>(drop_1pm * distance_m));
    for (const double height_m : options.further_heights_m) {
      steps.further_slopes.push_back(
          k < 1 ? 0.0F : static_cast<float>((height_m - options.reference_height_m) / distance_m));
    }
  }
  return steps;
}

}  // namespace

std::vector<SightLine> sight_lines(const VisibilityOptions& options, double cell_m,
                                   bool is_transposed, bool has_ground_weights) {
  std::vector<SightLine> lines;
  const int a = options.azimuths;
  for (int i = 0; i < a; ++i) {
    // Azimuth (2 i + 1) pi / a; whole numbers decide which pass takes the diagonals.
    const int position = 2 * i + 1;
    const bool is_northward = 4 * position <= a || 4 * (2 * a - position) <= a;
    const bool is_eastward = 4 * position > a && 4 * position < 3 * a;
    if (is_transposed ? !is_eastward : !is_northward) {
      continue;
    }
    const double azimuth_rad = position * (0.5 * kTwoPi) / a;
    const double east = elementary::sin(azimuth_rad);
    const double north = elementary::cos(azimuth_rad);
    const double shift = is_transposed ? north / east : east / north;
    SightLine line;
    line.slope = std::llround(shift * 4294967296.0);
    line.has_further = !options.further_heights_m.empty() && i % (a / 2) % kFurtherLineStride == 0;
    const double step_m = cell_m * std::sqrt(1.0 + shift * shift);
    const double ray_weight = has_ground_weights ? kWeightedRayWeight : kRayWeight;
    line.steps = ray_steps(options, step_m, ray_weight);
    const double full_weight = has_ground_weights ? kGroundWeightMax : 1.0;
    line.ray_weight = static_cast<std::uint32_t>(
        full_weight * std::accumulate(line.steps.weight.begin(), line.steps.weight.end(), 0.0));
    lines.push_back(std::move(line));
  }
  return lines;
}

std::int64_t rows_from_origin(double first_edge_m, double cell_m) {
  return static_cast<std::int64_t>(std::floor(first_edge_m / cell_m + 0.5));
}

std::uint16_t stored_share(double share) {
  return static_cast<std::uint16_t>(
      std::lround(std::clamp(share, 0.0, 1.0) * map::kVisibilityScale));
}

std::uint16_t further_share(double share, std::int64_t more, std::int64_t known) {
  return stored_share(known == 0 ? share
                                 : share + static_cast<double>(more) / static_cast<double>(known));
}

void order_by_height(const VisibilityOptions& options,
                     std::vector<raster::Grid<std::uint16_t>>& shares) {
  std::vector<double> heights_m = {options.reference_height_m};
  heights_m.insert(heights_m.end(), options.further_heights_m.begin(),
                   options.further_heights_m.end());
  std::vector<std::size_t> order(heights_m.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return heights_m[a] < heights_m[b]; });
  const auto reference =
      static_cast<std::size_t>(std::find(order.begin(), order.end(), 0U) - order.begin());
  // Outwards from the reference height, whose share stays.
  for (std::size_t cell = 0; cell < shares[0].values().size(); ++cell) {
    if (shares[0].values()[cell] == map::kVisibilityUnknown) {
      continue;
    }
    for (std::size_t i = reference + 1; i < order.size(); ++i) {
      std::uint16_t& value = shares[order[i]].values()[cell];
      value = std::max(value, shares[order[i - 1]].values()[cell]);
    }
    for (std::size_t i = reference; i-- > 0;) {
      std::uint16_t& value = shares[order[i]].values()[cell];
      value = std::min(value, shares[order[i + 1]].values()[cell]);
    }
  }
}

raster::GridGeometry geometry_of_block(const raster::GridGeometry& geometry,
                                       raster::CellIndex block, int columns, int rows) {
  return {geometry.west_m + block.column * geometry.cell_m,
          geometry.south_m + block.row * geometry.cell_m, geometry.cell_m, columns, rows};
}

raster::Grid<std::uint8_t> partial_surroundings(const raster::Grid<float>& opaque_m,
                                                raster::CellIndex block, int columns, int rows,
                                                double radius_m) {
  const double radius = radius_m / opaque_m.geometry().cell_m;
  const int reach = static_cast<int>(std::floor(radius));
  // Half width of the disc at each distance from its middle row.
  std::vector<int> half_width(static_cast<std::size_t>(reach) + 1);
  for (int d = 0; d <= reach; ++d) {
    half_width[static_cast<std::size_t>(d)] =
        static_cast<int>(std::floor(std::sqrt(radius * radius - static_cast<double>(d) * d)));
  }
  // Rows to the nearest unknown cell above or below, at most reach + 1.
  const int wide = columns + 2 * reach;
  const auto width = static_cast<std::size_t>(wide);
  std::vector<int> distance(width * static_cast<std::size_t>(rows), reach + 1);
  std::vector<int> run(width, reach + 1);
  const auto step_to = [&](int row) {
    for (int i = 0; i < wide; ++i) {
      const raster::CellIndex cell{block.column - reach + i, block.row + row};
      int& rows_since = run[static_cast<std::size_t>(i)];
      const bool is_known = opaque_m.geometry().contains(cell) && !std::isnan(opaque_m.at(cell));
      rows_since = is_known ? std::min(rows_since + 1, reach + 1) : 0;
      if (row >= 0 && row < rows) {
        int& least = distance[static_cast<std::size_t>(row) * width + static_cast<std::size_t>(i)];
        least = std::min(least, rows_since);
      }
    }
  };
  for (int row = -reach; row < rows; ++row) {
    step_to(row);
  }
  run.assign(width, reach + 1);
  for (int row = rows + reach; row-- > 0;) {
    step_to(row);
  }
  raster::Grid<std::uint8_t> result(geometry_of_block(opaque_m.geometry(), block, columns, rows),
                                    0);
  std::vector<int> change(width + 1);
  for (int row = 0; row < rows; ++row) {
    std::fill(change.begin(), change.end(), 0);
    for (int i = 0; i < wide; ++i) {
      const int d = distance[static_cast<std::size_t>(row) * width + static_cast<std::size_t>(i)];
      if (d <= reach) {
        const int half = half_width[static_cast<std::size_t>(d)];
        ++change[static_cast<std::size_t>(std::max(i - half, 0))];
        --change[static_cast<std::size_t>(std::min(i + half + 1, wide))];
      }
    }
    int covered = 0;
    for (int i = 0; i < reach + columns; ++i) {
      covered += change[static_cast<std::size_t>(i)];
      if (i >= reach) {
        result.at(i - reach, row) = covered > 0 ? 1 : 0;
      }
    }
  }
  return result;
}

void validate(const VisibilityGround& ground, raster::CellIndex block, int columns, int rows) {
  const raster::GridGeometry& g = ground.surface_m.geometry();
  if (ground.opaque_m.geometry() != g ||
      (ground.weight != nullptr && ground.weight->geometry() != g)) {
    throw std::invalid_argument("visibility: all layers of the ground need the same geometry");
  }
  if (block.column < 0 || block.row < 0 || columns < 1 || rows < 1 ||
      block.column + columns > g.columns || block.row + rows > g.rows) {
    throw std::invalid_argument("visibility: the block does not lie inside the raster");
  }
}

}  // namespace hedgehop::preparation
