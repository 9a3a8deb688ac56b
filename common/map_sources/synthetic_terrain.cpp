#include "map_sources/synthetic_terrain.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <queue>
#include <stdexcept>

namespace hedgehop::map_sources {
namespace {

constexpr double kMargin_m = 3200.0;     // eroded around the region, then cut off
constexpr double kErodibility = 1.0e-3;  // K, in units of uplift per time and metre
constexpr double kDiffusivity_m2 = 8.0;  // per unit of time
constexpr double kFloodPlain_m = 170.0;  // half width, of the main river
constexpr double kWarp_m = 260.0;
constexpr double kStreamCatchment_m2 = 1.2e6;
constexpr double kValleyFloor_m = 11.0;  // relief that is turned into valley floors
constexpr double kSteps_per_m = 1024.0;  // elevations are multiples of 1 / kSteps_per_m
constexpr double kLowest_m = 312.0;

struct Neighbour {
  int column, row;
  double distance;  // in cells
};
constexpr double kDiagonal = 1.4142135623730951;
constexpr std::array<Neighbour, 8> kNeighbours = {{{1, 0, 1.0},
                                                   {0, 1, 1.0},
                                                   {-1, 0, 1.0},
                                                   {0, -1, 1.0},
                                                   {1, 1, kDiagonal},
                                                   {-1, 1, kDiagonal},
                                                   {-1, -1, kDiagonal},
                                                   {1, -1, kDiagonal}}};

std::uint64_t mixed(std::uint64_t x) {
  x ^= x >> 30U;
  x *= 0xbf58476d1ce4e5b9ULL;
  x ^= x >> 27U;
  x *= 0x94d049bb133111ebULL;
  x ^= x >> 31U;
  return x;
}

std::uint64_t hashed(std::uint64_t seed, std::int64_t column, std::int64_t row) {
  std::uint64_t x = mixed(seed + 0x9e3779b97f4a7c15ULL);
  x = mixed(x ^ (static_cast<std::uint64_t>(column) * 0xd1b54a32d192ed03ULL));
  return mixed(x ^ (static_cast<std::uint64_t>(row) * 0x8cb92ba72f3d8dd7ULL));
}

/// A square of heights, row by row from the south.
struct Field {
  int side = 0;
  double cell_m = 0.0;
  double west_m = 0.0;
  double south_m = 0.0;
  std::vector<double> z;

  [[nodiscard]] std::size_t size() const { return z.size(); }
  [[nodiscard]] double x_m(int column) const { return west_m + (column + 0.5) * cell_m; }
  [[nodiscard]] double y_m(int row) const { return south_m + (row + 0.5) * cell_m; }
};

struct Drainage {
  std::vector<double> level;  // height with pits filled
  std::vector<int> order;     // cells, each after its receiver
  std::vector<int> receiver;  // -1 at outlets
  std::vector<double> area_m2;
};

template <typename IsOutlet>
Drainage drain(const Field& field, std::uint64_t seed, double rise, const IsOutlet& is_outlet) {
  struct Entry {
    double level;
    int cell;
    bool operator>(const Entry& other) const {
      return level != other.level ? level > other.level : cell > other.cell;
    }
  };
  const int side = field.side;
  Drainage drainage;
  drainage.level = field.z;
  drainage.receiver.assign(field.size(), -1);
  drainage.order.reserve(field.size());
  std::vector<char> is_reached(field.size(), 0);
  std::vector<Entry> storage;
  storage.reserve(field.size() / 4);
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open(std::greater<>(),
                                                                      std::move(storage));
  for (int row = 0; row < side; ++row) {
    for (int column = 0; column < side; ++column) {
      if (is_outlet(column, row)) {
        const int cell = row * side + column;
        is_reached[static_cast<std::size_t>(cell)] = 1;
        open.push({field.z[static_cast<std::size_t>(cell)], cell});
      }
    }
  }
  while (!open.empty()) {
    const Entry entry = open.top();
    open.pop();
    drainage.order.push_back(entry.cell);
    const int column = entry.cell % side;
    const int row = entry.cell / side;
    const bool is_an_outlet = is_outlet(column, row);
    double steepest = 0.0;
    for (std::size_t k = 0; k < kNeighbours.size(); ++k) {
      const int c = column + kNeighbours[k].column;
      const int r = row + kNeighbours[k].row;
      if (c < 0 || r < 0 || c >= side || r >= side) {
        continue;
      }
      const int other = r * side + c;
      const auto index = static_cast<std::size_t>(other);
      if (is_reached[index] == 0) {
        is_reached[index] = 1;
        drainage.level[index] = std::max(field.z[index], entry.level + rise);
        open.push({drainage.level[index], other});
      } else if (!is_an_outlet && drainage.level[index] < entry.level) {
        // A little chance in the choice breaks the straight lines of eight directions.
        const double chance = 0.4 + 1.2 * lattice_noise(seed + k, entry.cell, 0);
        const double fall =
            (entry.level - drainage.level[index]) / kNeighbours[k].distance * chance;
        if (fall > steepest) {
          steepest = fall;
          drainage.receiver[static_cast<std::size_t>(entry.cell)] = other;
        }
      }
    }
  }
  drainage.area_m2.assign(field.size(), field.cell_m * field.cell_m);
  for (auto cell = drainage.order.rbegin(); cell != drainage.order.rend(); ++cell) {
    const int receiver = drainage.receiver[static_cast<std::size_t>(*cell)];
    if (receiver >= 0) {
      drainage.area_m2[static_cast<std::size_t>(receiver)] +=
          drainage.area_m2[static_cast<std::size_t>(*cell)];
    }
  }
  return drainage;
}

void diffuse(Field& field, double coefficient, std::vector<double>& next) {
  const int side = field.side;
  next = field.z;
  for (int row = 1; row + 1 < side; ++row) {
    const std::size_t first = static_cast<std::size_t>(row) * static_cast<std::size_t>(side);
    for (std::size_t i = first + 1; i + 1 < first + static_cast<std::size_t>(side); ++i) {
      next[i] = field.z[i] +
                coefficient *
                    (field.z[i - 1] + field.z[i + 1] + field.z[i - static_cast<std::size_t>(side)] +
                     field.z[i + static_cast<std::size_t>(side)] - 4.0 * field.z[i]);
    }
  }
  std::swap(field.z, next);
}

Field refined(const Field& coarse, std::uint64_t seed, double roughness) {
  Field fine{coarse.side * 2, coarse.cell_m / 2.0, coarse.west_m, coarse.south_m, {}};
  fine.z.resize(coarse.size() * 4);
  const auto at = [&](int column, int row) {
    column = std::clamp(column, 0, coarse.side - 1);
    row = std::clamp(row, 0, coarse.side - 1);
    return coarse.z[static_cast<std::size_t>(row * coarse.side + column)];
  };
  for (int row = 0; row < fine.side; ++row) {
    for (int column = 0; column < fine.side; ++column) {
      const int c = (column - 1) >> 1;
      const int r = (row - 1) >> 1;
      const double u = column % 2 == 0 ? 0.75 : 0.25;
      const double v = row % 2 == 0 ? 0.75 : 0.25;
      const double smooth = (1.0 - v) * ((1.0 - u) * at(c, r) + u * at(c + 1, r)) +
                            v * ((1.0 - u) * at(c, r + 1) + u * at(c + 1, r + 1));
      fine.z[static_cast<std::size_t>(row * fine.side + column)] =
          smooth + roughness * (lattice_noise(seed, column, row) - 0.5);
    }
  }
  return fine;
}

/// The same heights at places shifted smoothly, by up to about 200 m: bends away the axes of the
/// grid.
void warp(Field& field, std::uint64_t seed) {
  const Field before = field;
  const auto at = [&](int column, int row) {
    column = std::clamp(column, 0, before.side - 1);
    row = std::clamp(row, 0, before.side - 1);
    return before.z[static_cast<std::size_t>(row * before.side + column)];
  };
  for (int row = 0; row < field.side; ++row) {
    for (int column = 0; column < field.side; ++column) {
      const double x_m = field.x_m(column);
      const double y_m = field.y_m(row);
      const double u =
          column + (kWarp_m / field.cell_m) * fractal_noise(seed, x_m, y_m, 1900.0, 2, 0.5);
      const double v =
          row + (kWarp_m / field.cell_m) * fractal_noise(seed + 31, x_m, y_m, 1900.0, 2, 0.5);
      const int c = static_cast<int>(std::floor(u));
      const int r = static_cast<int>(std::floor(v));
      const double fu = u - c;
      const double fv = v - r;
      field.z[static_cast<std::size_t>(row * field.side + column)] =
          (1.0 - fv) * ((1.0 - fu) * at(c, r) + fu * at(c + 1, r)) +
          fv * ((1.0 - fu) * at(c, r + 1) + fu * at(c + 1, r + 1));
    }
  }
}

/// The main river, which comes from far away: enters in the north, leaves in the south.
double main_river_x_m(std::uint64_t seed, double y_m, double extent_m) {
  return (0.38 + 0.14 * (y_m / extent_m)) * extent_m +
         2600.0 * smooth_noise(seed + 21, y_m, 500.0, 9000.0) +
         700.0 * smooth_noise(seed + 22, y_m, 500.0, 2300.0);
}

/// What is not eroded: the flood plain of the main river and the border. NaN elsewhere, else its
/// height.
std::vector<double> base_levels(const Field& field, std::uint64_t seed) {
  std::vector<double> levels(field.size(), std::numeric_limits<double>::quiet_NaN());
  const double extent_m = 2.0 * field.west_m + field.side * field.cell_m;
  for (int row = 0; row < field.side; ++row) {
    const double y_m = field.y_m(row);
    const double centre_m = main_river_x_m(seed, y_m, extent_m);
    const double drift =
        (main_river_x_m(seed, y_m + 50.0, extent_m) - main_river_x_m(seed, y_m - 50.0, extent_m)) /
        100.0;
    const double half_m =
        std::max(kFloodPlain_m * (1.0 + 0.5 * smooth_noise(seed + 23, y_m, 0.5, 1500.0)),
                 0.75 * field.cell_m) *
        std::sqrt(1.0 + drift * drift);
    for (int column = 0; column < field.side; ++column) {
      const double off_m = std::fabs(field.x_m(column) - centre_m);
      double& level = levels[static_cast<std::size_t>(row * field.side + column)];
      if (off_m <= half_m) {
        level = 0.0012 * y_m + 0.004 * off_m;
      } else if (column == 0 || row == 0 || column == field.side - 1 || row == field.side - 1) {
        level = 40.0 * (1.0 + smooth_noise(seed + 24, field.x_m(column), y_m, 6000.0));
      }
    }
  }
  return levels;
}

void erode(Field& field, std::uint64_t seed, std::uint64_t first_step_seed, int steps,
           double step_time) {
  const double cell_m = field.cell_m;
  const double coefficient = kDiffusivity_m2 * step_time / (cell_m * cell_m);
  const int passes = std::max(1, static_cast<int>(std::ceil(coefficient / 0.2)));
  const std::vector<double> levels = base_levels(field, seed);
  const auto is_outlet = [&](int column, int row) {
    return !std::isnan(levels[static_cast<std::size_t>(row * field.side + column)]);
  };
  std::vector<double> uplift(field.size());
  std::vector<double> erodibility(field.size());
  for (int row = 0; row < field.side; ++row) {
    for (int column = 0; column < field.side; ++column) {
      const double x_m = field.x_m(column);
      const double y_m = field.y_m(row);
      const auto i = static_cast<std::size_t>(row * field.side + column);
      uplift[i] = std::max(0.3, 1.0 + 0.8 * fractal_noise(seed + 11, x_m, y_m, 9000.0, 2, 0.4));
      erodibility[i] = kErodibility * std::max(0.4, 1.0 + 0.9 * fractal_noise(seed + 12, x_m, y_m,
                                                                              3500.0, 3, 0.5));
    }
  }
  std::vector<double> scratch;
  for (int step = 0; step < steps; ++step) {
    for (std::size_t i = 0; i < field.size(); ++i) {
      field.z[i] = std::isnan(levels[i]) ? field.z[i] : levels[i];
    }
    const Drainage drainage =
        drain(field, first_step_seed + static_cast<std::uint64_t>(step) * 8U, 1e-6, is_outlet);
    for (const int cell : drainage.order) {
      const auto i = static_cast<std::size_t>(cell);
      const int receiver = drainage.receiver[i];
      if (receiver < 0) {
        continue;
      }
      const bool is_straight =
          cell % field.side == receiver % field.side || cell / field.side == receiver / field.side;
      const double distance_m = is_straight ? cell_m : kDiagonal * cell_m;
      const double factor =
          erodibility[i] * step_time * std::sqrt(drainage.area_m2[i]) / distance_m;
      const double raised = drainage.level[i] + step_time * uplift[i];
      const double below = field.z[static_cast<std::size_t>(receiver)];
      field.z[i] = raised > below ? (raised + factor * below) / (1.0 + factor) : raised;
    }
    for (int pass = 0; pass < passes; ++pass) {
      diffuse(field, coefficient / passes, scratch);
    }
  }
}

/// Magnitude of the gradient after Horn, one cell from the border replicated outwards.
raster::Grid<float> slopes(const raster::Grid<float>& elevation_m) {
  raster::Grid<float> slope(elevation_m.geometry(), 0.0F);
  const int columns = elevation_m.columns();
  const int rows = elevation_m.rows();
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const int c = std::clamp(column, 1, columns - 2);
      const int r = std::clamp(row, 1, rows - 2);
      const auto z = [&](int dc, int dr) {
        return static_cast<double>(elevation_m.at(c + dc, r + dr));
      };
      const double per_m = 1.0 / (8.0 * elevation_m.geometry().cell_m);
      const double gx =
          (z(1, -1) + 2.0 * z(1, 0) + z(1, 1) - z(-1, -1) - 2.0 * z(-1, 0) - z(-1, 1)) * per_m;
      const double gy =
          (z(-1, 1) + 2.0 * z(0, 1) + z(1, 1) - z(-1, -1) - 2.0 * z(0, -1) - z(1, -1)) * per_m;
      slope.at(column, row) = static_cast<float>(std::sqrt(gx * gx + gy * gy));
    }
  }
  return slope;
}

double percentile(std::vector<float> values, double share) {
  const auto nth =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), nth, values.end());
  return static_cast<double>(*nth);
}

}  // namespace

double lattice_noise(std::uint64_t seed, std::int64_t column, std::int64_t row) {
  return static_cast<double>(hashed(seed, column, row) >> 11U) * 0x1p-53;
}

double smooth_noise(std::uint64_t seed, double x_m, double y_m, double wavelength_m) {
  const double x = x_m / wavelength_m;
  const double y = y_m / wavelength_m;
  const double column = std::floor(x);
  const double row = std::floor(y);
  const double u = x - column;
  const double v = y - row;
  const auto corner = [&](int dc, int dr) {
    static constexpr double kHalf = 0.70710678118654752;
    static constexpr std::array<std::array<double, 2>, 8> kGradients = {{{1.0, 0.0},
                                                                         {kHalf, kHalf},
                                                                         {0.0, 1.0},
                                                                         {-kHalf, kHalf},
                                                                         {-1.0, 0.0},
                                                                         {-kHalf, -kHalf},
                                                                         {0.0, -1.0},
                                                                         {kHalf, -kHalf}}};
    const auto& gradient = kGradients[hashed(seed, static_cast<std::int64_t>(column) + dc,
                                             static_cast<std::int64_t>(row) + dr) >>
                                      61U];
    return gradient[0] * (u - dc) + gradient[1] * (v - dr);
  };
  const double fu = u * u * u * (u * (u * 6.0 - 15.0) + 10.0);
  const double fv = v * v * v * (v * (v * 6.0 - 15.0) + 10.0);
  return 1.5 * ((1.0 - fv) * ((1.0 - fu) * corner(0, 0) + fu * corner(1, 0)) +
                fv * ((1.0 - fu) * corner(0, 1) + fu * corner(1, 1)));
}

double fractal_noise(std::uint64_t seed, double x_m, double y_m, double wavelength_m, int octaves,
                     double gain) {
  double sum = 0.0;
  double amplitude = 1.0;
  double total = 0.0;
  for (int octave = 0; octave < octaves; ++octave) {
    sum += amplitude * smooth_noise(seed + static_cast<std::uint64_t>(octave) * 1000003U, x_m, y_m,
                                    wavelength_m);
    total += amplitude;
    amplitude *= gain;
    wavelength_m /= 2.0;
  }
  return sum / total;
}

SyntheticTerrain make_synthetic_terrain(const raster::GridGeometry& geometry, std::uint64_t seed,
                                        double slope_p90) {
  const int margin_cells = static_cast<int>(kMargin_m / geometry.cell_m) / 8 * 8;
  if (geometry.columns != geometry.rows || geometry.columns % 8 != 0 || geometry.columns < 64) {
    throw std::invalid_argument("synthetic terrain needs a square of a multiple of 8 cells");
  }
  if (!(slope_p90 > 0.0) || !(geometry.cell_m > 0.0)) {
    throw std::invalid_argument("synthetic terrain needs a slope and a cell size above 0");
  }
  const int fine_side = geometry.columns + 2 * margin_cells;

  Field field{fine_side / 8,
              geometry.cell_m * 8.0,
              -margin_cells * geometry.cell_m,
              -margin_cells * geometry.cell_m,
              {}};
  field.z.resize(static_cast<std::size_t>(field.side) * static_cast<std::size_t>(field.side));
  for (int row = 0; row < field.side; ++row) {
    for (int column = 0; column < field.side; ++column) {
      field.z[static_cast<std::size_t>(row * field.side + column)] =
          400.0 +
          300.0 * fractal_noise(seed + 1, field.x_m(column), field.y_m(row), 8000.0, 5, 0.6);
    }
  }
  erode(field, seed, seed + 1000, 70, 300.0);
  field = refined(field, seed + 2, 30.0);
  erode(field, seed, seed + 2000, 30, 150.0);
  field = refined(field, seed + 3, 10.0);
  erode(field, seed, seed + 3000, 7, 60.0);
  warp(field, seed + 30);
  field = refined(field, seed + 4, 2.0);
  std::vector<double> scratch;
  diffuse(field, 0.15, scratch);

  // The slope decides the scale: rivers do not mind, the equation is linear in z.
  raster::Grid<float> inside(geometry, 0.0F);
  for (int row = 0; row < geometry.rows; ++row) {
    for (int column = 0; column < geometry.columns; ++column) {
      inside.at(column, row) = static_cast<float>(field.z[static_cast<std::size_t>(
          (row + margin_cells) * fine_side + column + margin_cells)]);
    }
  }
  const double scale = slope_p90 / percentile(slopes(inside).values(), 0.9);
  for (double& z : field.z) {
    z *= scale;
  }

  // Wider valley floors: height above the own stream h becomes h^2 / (h + floor), which grows with
  // h.
  const auto is_edge = [&](int column, int row) {
    return column == 0 || row == 0 || column == fine_side - 1 || row == fine_side - 1;
  };
  const Drainage drainage = drain(field, seed + 5, 1e-4, is_edge);
  std::vector<double> stream_z(field.size());
  for (const int cell : drainage.order) {
    const auto i = static_cast<std::size_t>(cell);
    const bool is_stream = drainage.receiver[i] < 0 || drainage.area_m2[i] >= kStreamCatchment_m2;
    stream_z[i] =
        is_stream ? drainage.level[i] : stream_z[static_cast<std::size_t>(drainage.receiver[i])];
    const double h = drainage.level[i] - stream_z[i];
    field.z[i] = stream_z[i] + h * h / (h + kValleyFloor_m);
  }
  for (int pass = 0; pass < 3; ++pass) {
    diffuse(field, 0.2, scratch);
  }

  // Cut out the region, add what is too small for rivers, put it on the lattice of heights, fill
  // pits.
  Field region{geometry.columns, geometry.cell_m, 0.0, 0.0, {}};
  region.z.resize(geometry.cell_count());
  double lowest = field.z[static_cast<std::size_t>(margin_cells * fine_side + margin_cells)];
  for (int row = 0; row < region.side; ++row) {
    for (int column = 0; column < region.side; ++column) {
      const double z = field.z[static_cast<std::size_t>((row + margin_cells) * fine_side + column +
                                                        margin_cells)];
      region.z[static_cast<std::size_t>(row * region.side + column)] = z;
      lowest = std::min(lowest, z);
    }
  }
  for (int row = 0; row < region.side; ++row) {
    for (int column = 0; column < region.side; ++column) {
      double& z = region.z[static_cast<std::size_t>(row * region.side + column)];
      z += kLowest_m - lowest +
           1.2 * fractal_noise(seed + 6, region.x_m(column), region.y_m(row), 220.0, 2, 0.5);
      z = std::floor(z * kSteps_per_m);
    }
  }
  const auto is_border = [&](int column, int row) {
    return column == 0 || row == 0 || column == region.side - 1 || row == region.side - 1;
  };
  const Drainage final_drainage = drain(region, seed + 7, 8.0, is_border);

  SyntheticTerrain terrain;
  terrain.elevation_m = raster::Grid<float>(geometry, 0.0F);
  terrain.above_stream_m = raster::Grid<float>(geometry, 0.0F);
  terrain.catchment_km2 = raster::Grid<float>(geometry, 0.0F);
  terrain.receiver = final_drainage.receiver;
  std::vector<double> stream_level(region.size());
  for (const int cell : final_drainage.order) {
    const auto i = static_cast<std::size_t>(cell);
    const int column = cell % region.side;
    const int row = cell / region.side;
    const double area_m2 = final_drainage.area_m2[i];
    const int receiver = final_drainage.receiver[i];
    const bool is_stream = receiver < 0 || area_m2 >= kStreamCatchment_m2;
    stream_level[i] =
        is_stream ? final_drainage.level[i] : stream_level[static_cast<std::size_t>(receiver)];
    terrain.elevation_m.at(column, row) =
        static_cast<float>(final_drainage.level[i] / kSteps_per_m);
    terrain.above_stream_m.at(column, row) =
        static_cast<float>((final_drainage.level[i] - stream_level[i]) / kSteps_per_m);
    terrain.catchment_km2.at(column, row) = static_cast<float>(area_m2 * 1e-6);
  }
  terrain.slope = slopes(terrain.elevation_m);
  return terrain;
}

}  // namespace hedgehop::map_sources
