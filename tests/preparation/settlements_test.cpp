#include "preparation/settlements.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <gdal_priv.h>
#include <gtest/gtest.h>
#include <limits>
#include <random>
#include <string>

#include "support/fresh_seed.hpp"

namespace hedgehop::preparation {
namespace {

using Mask = raster::Grid<std::uint8_t>;

// Squared distance of every cell's centre to the nearest one that is set, in cells; exact, the
// lower envelope of parabolas along rows and then columns.
raster::Grid<float> squared_distances(const Mask& mask) {
  const int columns = mask.columns();
  const int rows = mask.rows();
  raster::Grid<float> result(mask.geometry(), 0.0F);
  const auto envelope = [](int count, const std::function<double(int)>& value,
                           const std::function<void(int, double)>& put) {
    std::vector<int> roots;
    std::vector<double> begins;
    for (int i = 0; i < count; ++i) {
      if (value(i) > 1e11) {
        continue;
      }
      double begin = -1e18;
      while (!roots.empty()) {
        const int r = roots.back();
        begin = ((value(i) + i * 1.0 * i) - (value(r) + r * 1.0 * r)) / (2.0 * (i - r));
        if (begin > begins.back()) {
          break;
        }
        roots.pop_back();
        begins.pop_back();
        begin = -1e18;
      }
      roots.push_back(i);
      begins.push_back(begin);
    }
    std::size_t k = 0;
    for (int i = 0; i < count; ++i) {
      while (k + 1 < roots.size() && begins[k + 1] < i) {
        ++k;
      }
      put(i, roots.empty() ? 1e12 : (i - roots[k]) * 1.0 * (i - roots[k]) + value(roots[k]));
    }
  };
  for (int row = 0; row < rows; ++row) {
    envelope(
        columns, [&](int i) { return mask.at(i, row) != 0 ? 0.0 : 1e12; },
        [&](int i, double d) { result.at(i, row) = static_cast<float>(d); });
  }
  for (int column = 0; column < columns; ++column) {
    std::vector<double> line(static_cast<std::size_t>(rows));
    for (int row = 0; row < rows; ++row) {
      line[static_cast<std::size_t>(row)] = static_cast<double>(result.at(column, row));
    }
    envelope(
        rows, [&](int i) { return line[static_cast<std::size_t>(i)]; },
        [&](int i, double d) { result.at(column, i) = static_cast<float>(d); });
  }
  return result;
}

// Cells nearer than `distance_m` to the mask; a negative distance: further inside than that.
Mask within(const Mask& mask, double distance_m) {
  Mask source = mask;
  if (distance_m < 0.0) {
    for (std::uint8_t& value : source.values()) {
      value = value == 0 ? 1 : 0;
    }
  }
  const raster::Grid<float> squared = squared_distances(source);
  const double limit = distance_m * distance_m / (mask.geometry().cell_m * mask.geometry().cell_m);
  Mask result(mask.geometry(), 0);
  for (std::size_t i = 0; i < result.values().size(); ++i) {
    const bool is_near = static_cast<double>(squared.values()[i]) <= limit;
    result.values()[i] = is_near == (distance_m >= 0.0) ? 1 : 0;
  }
  return result;
}

std::vector<int> areas_of_parts(const Mask& mask, Mask& small, double area_max_m2) {
  std::vector<int> areas;
  Mask seen(mask.geometry(), 0);
  small = seen;
  const double cell_m2 = mask.geometry().cell_m * mask.geometry().cell_m;
  for (int row = 0; row < mask.rows(); ++row) {
    for (int column = 0; column < mask.columns(); ++column) {
      if (mask.at(column, row) == 0 || seen.at(column, row) != 0) {
        continue;
      }
      std::vector<raster::CellIndex> part{{column, row}};
      seen.at(column, row) = 1;
      for (std::size_t i = 0; i < part.size(); ++i) {
        for (const auto& [dx, dy] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
          const raster::CellIndex next{part[i].column + dx, part[i].row + dy};
          if (mask.geometry().contains(next) && mask.at(next) != 0 && seen.at(next) == 0) {
            seen.at(next) = 1;
            part.push_back(next);
          }
        }
      }
      areas.push_back(static_cast<int>(part.size()));
      if (static_cast<double>(part.size()) * cell_m2 <= area_max_m2) {
        for (const raster::CellIndex& cell : part) {
          small.at(cell) = 1;
        }
      }
    }
  }
  return areas;
}

Mask burnt(const std::vector<GeometryPointer>& pieces, const raster::GridGeometry& geometry) {
  raster::Grid<std::uint16_t> bits(geometry, 0);
  std::vector<const OGRGeometry*> pointers;
  for (const GeometryPointer& piece : pieces) {
    pointers.push_back(piece.get());
  }
  SilentObserver observer;
  burn_bit(bits, pointers, 1, Touch::kCentre, observer);
  Mask result(geometry, 0);
  for (std::size_t i = 0; i < bits.values().size(); ++i) {
    result.values()[i] = bits.values()[i] != 0 ? 1 : 0;
  }
  return result;
}

// Cells that differ although they lie further than `margin_m` from the edge of `expected`.
int clear_differences(const Mask& found, const Mask& expected, double margin_m) {
  const Mask surely_in = within(expected, -margin_m);
  const Mask surely_out = within(expected, margin_m);
  int count = 0;
  for (std::size_t i = 0; i < found.values().size(); ++i) {
    count += surely_in.values()[i] != 0 && found.values()[i] == 0 ? 1 : 0;
    count += surely_out.values()[i] == 0 && found.values()[i] != 0 ? 1 : 0;
  }
  return count;
}

// Turned rectangles in groups, as hamlets are.
std::vector<GeometryPointer> random_hamlets(std::mt19937_64& random) {
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  std::vector<GeometryPointer> built;
  for (int i = 0; i < 3; ++i) {
    const double x_m = 200.0 + 550.0 * uniform(random);
    const double y_m = 200.0 + 550.0 * uniform(random);
    for (int k = 0; k < 8; ++k) {
      const double turn_rad = 3.0 * uniform(random);
      const double length_m = 10.0 + 60.0 * uniform(random);
      const double width_m = 10.0 + 30.0 * uniform(random);
      const double centre_x_m = x_m + 120.0 * uniform(random);
      const double centre_y_m = y_m + 120.0 * uniform(random);
      map_sources::MapPolygon polygon;
      for (const auto& [u, v] :
           {std::pair{-0.5, -0.5}, {0.5, -0.5}, {0.5, 0.5}, {-0.5, 0.5}, {-0.5, -0.5}}) {
        polygon.outer.push_back(
            {centre_x_m + u * length_m * std::cos(turn_rad) - v * width_m * std::sin(turn_rad),
             centre_y_m + u * length_m * std::sin(turn_rad) + v * width_m * std::cos(turn_rad)});
      }
      built.push_back(geometry_of({polygon}));
    }
  }
  return built;
}

TEST(Settlements, AreWhatGrowingAndShrinkingARasterGives) {
  GDALAllRegister();
  const auto seed = test::fresh_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937_64 random(seed);
  const raster::GridGeometry geometry{0.0, 0.0, 2.0, 560, 560};
  SettlementOptions options;
  options.grow_m = 25.0;
  options.shrink_m = 25.0;
  options.village_area_max_m2 = 9000.0;
  std::vector<GeometryPointer> built;
  Mask expected;
  Mask expected_small;
  // Drawn anew while what hangs together, or its size, is a matter of a few metres.
  bool is_clear = false;
  for (int attempt = 0; attempt < 40 && !is_clear; ++attempt) {
    built = random_hamlets(random);
    const Mask ground = burnt(built, geometry);
    expected = within(within(ground, 25.0), -25.0);
    Mask other;
    const auto areas = areas_of_parts(expected, expected_small, options.village_area_max_m2);
    // A gap of nearly twice the radius closes or does not.
    is_clear = clear_differences(within(within(ground, 23.0), -23.0), expected, 5.0) == 0 &&
               clear_differences(within(within(ground, 27.0), -27.0), expected, 5.0) == 0 &&
               areas.size() == areas_of_parts(within(expected, 4.0), other, 0.0).size() &&
               areas.size() == areas_of_parts(within(expected, -4.0), other, 0.0).size() &&
               std::none_of(areas.begin(), areas.end(), [&](int area) {
                 return std::fabs(area * 4.0 - options.village_area_max_m2) < 900.0;
               });
  }
  ASSERT_TRUE(is_clear);
  std::vector<const OGRGeometry*> pointers;
  for (const GeometryPointer& piece : built) {
    pointers.push_back(piece.get());
  }
  SilentObserver observer;
  const Settlements found = settlements_of(pointers, options, 0.5, observer);
  Mask all = burnt(found.villages, geometry);
  const Mask large = burnt(found.settlements, geometry);
  for (std::size_t i = 0; i < all.values().size(); ++i) {
    all.values()[i] = all.values()[i] != 0 || large.values()[i] != 0 ? 1 : 0;
  }
  // Cells of 2 m, arcs of 1 %, outlines simplified by 0.5 m.
  EXPECT_EQ(clear_differences(all, expected, 5.0), 0);
  EXPECT_EQ(clear_differences(burnt(found.villages, geometry), expected_small, 5.0), 0);
  const std::vector<GeometryPointer> near = grown(found.settlements, 60.0, observer);
  const std::vector<GeometryPointer> far = grown(near, 60.0, observer);
  Mask expected_large = expected;
  for (std::size_t i = 0; i < expected.values().size(); ++i) {
    expected_large.values()[i] =
        expected.values()[i] != 0 && expected_small.values()[i] == 0 ? 1 : 0;
  }
  EXPECT_EQ(clear_differences(burnt(near, geometry), within(expected_large, 60.0), 6.0), 0);
  EXPECT_EQ(clear_differences(burnt(far, geometry), within(expected_large, 120.0), 8.0), 0);
}

}  // namespace
}  // namespace hedgehop::preparation
