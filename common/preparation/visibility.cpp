#include "preparation/visibility.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <stdexcept>
#include <tbb/blocked_range2d.h>
#include <tbb/info.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "map/map.hpp"
#include "preparation/visibility_kernel.hpp"

namespace hedgehop::preparation {
namespace {

constexpr char kStage[] = "visibility";
constexpr int kTileColumns = 128;
constexpr int kTileRows = 16;
// Weights of one ray add up to this, exact in float; those of 1000 rays fit 32 bits.
constexpr double kRayWeight = 2097152.0;

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
}

// A raster with a margin of unknown cells, so that rays need no bounds checks.
struct Padded {
  int margin = 0;
  std::ptrdiff_t stride = 0;
  int columns = 0;
  int rows = 0;
  std::vector<float> values_m;

  [[nodiscard]] const float* at(int column, int row) const {
    return values_m.data() + (row + margin) * stride + column + margin;
  }
  [[nodiscard]] float* at(int column, int row) {
    return values_m.data() + (row + margin) * stride + column + margin;
  }
};

Padded padded(const raster::Grid<float>& surface_m, int margin, bool is_transposed) {
  Padded result;
  result.margin = margin;
  result.columns = is_transposed ? surface_m.rows() : surface_m.columns();
  result.rows = is_transposed ? surface_m.columns() : surface_m.rows();
  result.stride = result.columns + 2 * margin + kLanesMax;
  result.values_m.assign(
      static_cast<std::size_t>(result.stride) * static_cast<std::size_t>(result.rows + 2 * margin),
      kFarBelow_m);
  for (int row = 0; row < surface_m.rows(); ++row) {
    for (int column = 0; column < surface_m.columns(); ++column) {
      const float value_m = surface_m.at(column, row);
      if (!std::isnan(value_m)) {
        *(is_transposed ? result.at(row, column) : result.at(column, row)) = value_m;
      }
    }
  }
  return result;
}

// Rays whose longer component runs along the rows' direction (y), or along x for the transposed
// raster.
std::vector<Ray> rays_along_rows(const VisibilityOptions& options, double cell_m,
                                 std::ptrdiff_t stride, bool is_transposed) {
  std::vector<Ray> rays;
  for (int i = 0; i < options.azimuths; ++i) {
    const double azimuth_rad = (i + 0.5) * kTwoPi / options.azimuths;
    double across = elementary::sin(azimuth_rad);
    double along = elementary::cos(azimuth_rad);
    const bool is_along_x = std::fabs(across) > std::fabs(along);
    if (is_along_x != is_transposed) {
      continue;
    }
    if (is_transposed) {
      std::swap(across, along);
    }
    const double shift = across / std::fabs(along);
    const int direction = along > 0.0 ? 1 : -1;
    const double step_m = cell_m * std::sqrt(1.0 + shift * shift);
    const int count = static_cast<int>(std::floor(options.radius_m / step_m));
    Ray ray;
    for (int k = 1; k <= count; ++k) {
      const double x = k * shift;
      double left = std::floor(x);
      double fraction = x - left;
      if (fraction < 1e-6) {
        fraction = 0.0;
      } else if (fraction > 1.0 - 1e-6) {
        left += 1.0;
        fraction = 0.0;
      }
      const double distance_m = k * step_m;
      const double inner_m = distance_m - 0.5 * step_m;
      const double outer_m =
          k == count ? options.radius_m : std::min(distance_m + 0.5 * step_m, options.radius_m);
      const double share =
          (outer_m * outer_m - inner_m * inner_m) / (options.radius_m * options.radius_m);
      ray.samples.push_back(
          {static_cast<std::ptrdiff_t>(direction) * k * stride + static_cast<std::ptrdiff_t>(left),
           static_cast<float>(fraction), static_cast<float>(1.0 / distance_m),
           static_cast<float>(std::round(kRayWeight * share))});
    }
    rays.push_back(std::move(ray));
  }
  return rays;
}

bool is_known_around(const Padded& raster, int column, int row, int columns, int rows, int reach) {
  for (int r = row - reach; r < row + rows + reach; ++r) {
    const float* line = raster.at(column - reach, r);
    for (int c = 0; c < columns + 2 * reach; ++c) {
      if (line[c] == kFarBelow_m) {
        return false;
      }
    }
  }
  return true;
}

struct Sums {
  std::vector<std::int32_t> seen;
  std::vector<std::int32_t> known;
  std::size_t stride = 0;
};

// One of the two passes: rays along the rows of `raster` from every cell of the block. `eye_m`
// gives the eye over a cell of the raster.
template <typename EyeAt>
Sums sums_of_block(const Padded& raster, const EyeAt& eye_m, const std::vector<Ray>& rays,
                   raster::CellIndex block, int columns, int rows, int reach, double done,
                   Observer& observer) {
  Sums sums;
  sums.stride = static_cast<std::size_t>(columns + kLanesMax);
  sums.seen.assign(sums.stride * static_cast<std::size_t>(rows), 0);
  sums.known.assign(sums.stride * static_cast<std::size_t>(rows), 0);
  std::int32_t all_known = 0;
  for (const Ray& ray : rays) {
    for (const RaySample& sample : ray.samples) {
      all_known += static_cast<std::int32_t>(sample.weight);
    }
  }
  std::atomic<std::int64_t> cells_done = 0;
  const double cells = static_cast<double>(columns) * rows;
  const int tile_columns = (columns + kTileColumns - 1) / kTileColumns;
  const int tile_rows = (rows + kTileRows - 1) / kTileRows;
  tbb::parallel_for(
      tbb::blocked_range2d<int>(0, tile_rows, 1, 0, tile_columns, 1),
      [&](const tbb::blocked_range2d<int>& range) {
        for (int tile_row = range.rows().begin(); tile_row < range.rows().end(); ++tile_row) {
          for (int tile = range.cols().begin(); tile < range.cols().end(); ++tile) {
            const int first_row = tile_row * kTileRows;
            const int first_column = tile * kTileColumns;
            const int row_count = std::min(kTileRows, rows - first_row);
            const int column_count = std::min(kTileColumns, columns - first_column);
            const bool is_all_known =
                is_known_around(raster, block.column + first_column, block.row + first_row,
                                column_count, row_count, reach);
            std::vector<std::int32_t> seen(kTileColumns + kLanesMax);
            std::vector<std::int32_t> known(kTileColumns + kLanesMax);
            std::vector<float> eyes_m(kTileColumns + kLanesMax);
            for (int row = first_row; row < first_row + row_count; ++row) {
              observer.check_stop();
              std::fill(seen.begin(), seen.end(), 0);
              std::fill(known.begin(), known.end(), is_all_known ? all_known : 0);
              for (int i = 0; i < column_count; ++i) {
                eyes_m[static_cast<std::size_t>(i)] =
                    eye_m(block.column + first_column + i, block.row + row);
              }
              add_seen(raster.at(block.column + first_column, block.row + row), eyes_m.data(),
                       column_count, rays, seen.data(), is_all_known ? nullptr : known.data());
              const std::size_t target = static_cast<std::size_t>(row) * sums.stride +
                                         static_cast<std::size_t>(first_column);
              std::copy_n(seen.begin(), column_count, sums.seen.data() + target);
              std::copy_n(known.begin(), column_count, sums.known.data() + target);
            }
            cells_done += static_cast<std::int64_t>(row_count) * column_count;
            observer.progress(kStage, done + 0.5 * static_cast<double>(cells_done) / cells, 1.0);
          }
        }
      });
  return sums;
}

}  // namespace

raster::Grid<std::uint16_t> visibility_of_block(const raster::Grid<float>& opaque_m,
                                                const raster::Grid<float>& surface_m,
                                                raster::CellIndex block, int columns, int rows,
                                                const VisibilityOptions& options, int threads,
                                                Observer& observer) {
  const raster::GridGeometry& g = surface_m.geometry();
  validate(options, g.cell_m);
  if (opaque_m.geometry() != g) {
    throw std::invalid_argument("visibility: both surfaces need the same geometry");
  }
  if (block.column < 0 || block.row < 0 || columns < 1 || rows < 1 ||
      block.column + columns > g.columns || block.row + rows > g.rows) {
    throw std::invalid_argument("visibility: the block does not lie inside the raster");
  }
  observer.progress(kStage, 0.0, 1.0);
  const int reach = static_cast<int>(std::ceil(options.radius_m / g.cell_m)) + 1;
  const auto pass = [&](bool is_transposed) {
    const Padded raster = padded(opaque_m, reach + 1, is_transposed);
    const std::vector<Ray> rays = rays_along_rows(options, g.cell_m, raster.stride, is_transposed);
    const auto eye_m = [&](int column, int row) {
      const float ground_m = is_transposed ? surface_m.at(row, column) : surface_m.at(column, row);
      return ground_m + static_cast<float>(options.reference_height_m);
    };
    return is_transposed
               ? sums_of_block(raster, eye_m, rays, {block.row, block.column}, rows, columns, reach,
                               0.5, observer)
               : sums_of_block(raster, eye_m, rays, block, columns, rows, reach, 0.0, observer);
  };
  Sums along_y;
  Sums along_x;
  const int processors = tbb::info::default_concurrency();
  tbb::task_arena arena(threads > 0 ? std::min(threads, processors) : processors);
  arena.execute([&] {
    along_y = pass(false);
    observer.check_stop();
    along_x = pass(true);
  });
  raster::GridGeometry block_geometry = g;
  block_geometry.west_m = g.west_m + block.column * g.cell_m;
  block_geometry.south_m = g.south_m + block.row * g.cell_m;
  block_geometry.columns = columns;
  block_geometry.rows = rows;
  raster::Grid<std::uint16_t> result(block_geometry, map::kVisibilityUnknown);
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      if (std::isnan(surface_m.at(block.column + column, block.row + row))) {
        continue;
      }
      const std::size_t y =
          static_cast<std::size_t>(row) * along_y.stride + static_cast<std::size_t>(column);
      const std::size_t x =
          static_cast<std::size_t>(column) * along_x.stride + static_cast<std::size_t>(row);
      const std::int64_t seen = std::int64_t{along_y.seen[y]} + along_x.seen[x];
      const std::int64_t known = std::int64_t{along_y.known[y]} + along_x.known[x];
      if (known > 0) {
        result.at(column, row) = static_cast<std::uint16_t>(std::floor(
            map::kVisibilityScale * static_cast<double>(seen) / static_cast<double>(known) + 0.5));
      }
    }
  }
  observer.progress(kStage, 1.0, 1.0);
  return result;
}

double reference_visibility_share(const raster::Grid<float>& opaque_m,
                                  const raster::Grid<float>& surface_m, raster::CellIndex cell,
                                  const VisibilityOptions& options) {
  const raster::GridGeometry& g = surface_m.geometry();
  validate(options, g.cell_m);
  if (!g.contains(cell) || std::isnan(surface_m.at(cell))) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  const double eye_m = static_cast<double>(surface_m.at(cell)) + options.reference_height_m;
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
      ++known;
      const double target_slope = (static_cast<double>(opaque_m.at(target)) - eye_m) / distance;
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
        is_seen = !((z_m - eye_m) / (t * distance) > target_slope);
      }
      seen += is_seen ? 1 : 0;
    }
  }
  return known == 0 ? std::numeric_limits<double>::quiet_NaN()
                    : static_cast<double>(seen) / static_cast<double>(known);
}

}  // namespace hedgehop::preparation
