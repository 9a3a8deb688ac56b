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

// Rounding of heights hides ground whose slopes rise less than this from step to step, in units.
constexpr double kSteadyRise = 0.75;

RaySteps ray_steps(const VisibilityOptions& options, double step_m) {
  RaySteps steps;
  steps.count = static_cast<int>(std::floor(options.radius_m / step_m));
  steps.units_per_metre = units_per_metre(options);
  const bool is_fine = steps.units_per_metre == kFineUnitsPerMetre;
  // By so many units slopes of an even plane rise from step to step where they rise least.
  const int last_ring = ring_of(steps.count);
  const double least_rise =
      options.reference_height_m * steps.units_per_metre *
      std::min(static_cast<double>(last_ring) / (steps.count * steps.count), 0.5 / last_ring);
  steps.smooth_raise = is_fine ? 0 : least_rise < kSteadyRise ? 2 : 1;
  steps.level_raise = is_fine ? 0 : 2;
  steps.limit = limit_in_units(steps.units_per_metre);
  const auto weight_within = [&](double distance_m) {
    const double share = std::clamp(distance_m / options.radius_m, 0.0, 1.0);
    return static_cast<int>(std::lround(kRayWeight * share * share));
  };
  const auto weight_of = [&](int k) {
    if (k < 1 || k > steps.count) {
      return 0;
    }
    const double outer_m = k == steps.count ? options.radius_m : (k + 0.5) * step_m;
    return weight_within(outer_m) - weight_within((k - 0.5) * step_m);
  };
  const double drop_1pm = drop_per_square_1pm(options);
  const auto rounded = [](double value, int limit) {
    return static_cast<std::int32_t>(std::lround(std::clamp(value, -1.0 * limit, 1.0 * limit)));
  };
  const auto add_step = [&](int k, int ring, bool is_far) {
    const double ring_ratio = static_cast<double>(ring) / std::max(k, 1);
    const auto drop_of = [&](double step) {
      return rounded(drop_1pm * step_m * step_m * step * ring * steps.units_per_metre, steps.limit);
    };
    const int block_drop = is_far && is_fine ? 0 : drop_of(is_far ? k + 0.5 * (kBlockRows - 1) : k);
    steps.numbers.ratio.push_back(rounded(kOne * ring_ratio, kOne - 1));
    steps.numbers.drop.push_back(block_drop);
    steps.numbers.rest_of_drop.push_back(is_far && is_fine ? drop_of(k) : 0);
    steps.numbers.weight.push_back(weight_of(k));
    for (const double height_m : options.further_heights_m) {
      steps.numbers.lower.push_back(
          rounded((height_m - options.reference_height_m) * steps.units_per_metre * ring_ratio,
                  steps.limit));
    }
  };
  for (int k = 0; k < kNearRows + kBlockRows; ++k) {
    add_step(k, ring_of(k), false);
  }
  // Two blocks are asked about at once, of which the second may lie beyond the ray.
  const int last = steps.count + kBlockRows;
  steps.block_at.assign(static_cast<std::size_t>(last) + 1, 0);
  for (int ring = ring_of(kNearRows); ring <= steps.count; ring *= 2) {
    const int begin = std::max(ring, kNearRows + 1);
    const int end = 2 * ring <= steps.count ? 2 * ring : last + 1;
    const auto at = static_cast<int>(steps.numbers.ratio.size()) - begin;
    // The last block of a ring runs on into the next one, and so do two blocks.
    for (int k = begin; k < end + 2 * kBlockRows; ++k) {
      add_step(k, ring, true);
      if (k < end) {
        steps.block_at[static_cast<std::size_t>(k)] = at + k;
      }
    }
  }
  int before = 0;
  for (int k = -kBlockRows; k <= steps.count + 2 * kBlockRows; ++k) {
    const int line_weight = k > kExactSteps ? weight_of(k) : 0;
    steps.line_weight.push_back(line_weight);
    steps.line_weight_before.push_back(before);
    before += line_weight;
  }
  const auto pairs_of = [](std::vector<std::int32_t> numbers) {
    for (std::int32_t& number : numbers) {
      number = static_cast<std::int32_t>((static_cast<std::uint32_t>(number) & 0xffff) * 0x10001U);
    }
    return numbers;
  };
  steps.pairs = {pairs_of(steps.numbers.ratio), pairs_of(steps.numbers.drop),
                 pairs_of(steps.numbers.rest_of_drop), pairs_of(steps.numbers.weight),
                 pairs_of(steps.numbers.lower)};
  return steps;
}

}  // namespace

std::vector<SightLine> sight_lines(const VisibilityOptions& options, double cell_m,
                                   bool is_transposed) {
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
    line.steps = ray_steps(options, step_m);
    line.ray_weight = line.steps.line_weight_before.back();
    for (int k = 1; k <= std::min(kExactSteps, line.steps.count); ++k) {
      line.ray_weight += line.steps.numbers.weight[static_cast<std::size_t>(k)];
    }
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
