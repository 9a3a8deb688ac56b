#include "output/map_images.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <span>

namespace hedgehop::output {
namespace {

using map::SemanticClass;

constexpr Color kUnknown{0.62, 0.62, 0.62};

Color rgb(int value) {
  return {((value >> 16) & 255) / 255.0, ((value >> 8) & 255) / 255.0, (value & 255) / 255.0};
}

Color mixed(const Color& a, const Color& b, double t) {
  return {a.red + t * (b.red - a.red), a.green + t * (b.green - a.green),
          a.blue + t * (b.blue - a.blue)};
}

Color scaled(const Color& color, double factor) {
  return {color.red * factor, color.green * factor, color.blue * factor};
}

Color on_scale(std::span<const int> scale, double share) {
  const double place = std::clamp(share, 0.0, 1.0) * static_cast<double>(scale.size() - 1);
  const auto below = std::min(static_cast<std::size_t>(place), scale.size() - 2);
  return mixed(rgb(scale[below]), rgb(scale[below + 1]), place - static_cast<double>(below));
}

struct ClassStyle {
  SemanticClass bit;
  int color;
  const char* text;
};

// What is drawn when bits overlap: the first one that is set.
constexpr std::array<ClassStyle, 15> kClasses = {{
    {SemanticClass::kBuilding, 0x6e3b30, "building"},
    {SemanticClass::kObstacle, 0xb5179e, "obstacle, aerialway"},
    {SemanticClass::kPowerPole, 0x3c1a66, "pole of a power line"},
    {SemanticClass::kPowerLine, 0x7b4fb0, "power line"},
    {SemanticClass::kSettlement, 0xd1495b, "settlement"},
    {SemanticClass::kVillage, 0xe08e36, "village, single building"},
    {SemanticClass::kWater, 0x6aa5dd, "water"},
    {SemanticClass::kSettlementAdequate, 0xe99aa2, "settlement, adequate distance"},
    {SemanticClass::kVillageAdequate, 0xf0bf85, "village, adequate distance"},
    {SemanticClass::kSettlementDesired, 0xf4cdd0, "settlement, desired distance"},
    {SemanticClass::kVillageDesired, 0xf8e2c4, "village, desired distance"},
    {SemanticClass::kBuiltUpArea, 0xd8c3b4, "built-up area"},
    {SemanticClass::kTree, 0x6fa06a, "trees"},
    {SemanticClass::kForest, 0xa9cba1, "forest"},
    {SemanticClass::kUnmapped, 0xcfcfd4, "not mapped"},
}};

bool has(std::uint16_t bits, SemanticClass bit) {
  return (bits & static_cast<std::uint16_t>(bit)) != 0;
}

unsigned char byte_of(double value) {
  return static_cast<unsigned char>(std::lround(255.0 * std::clamp(value, 0.0, 1.0)));
}

/// Light on the slope, about 1 on level ground.
double relief(const map::Map& map, const geo::MapPoint& p, double step_m, double exaggeration) {
  const auto z = [&](double dx_m, double dy_m) {
    return raster::sample_bilinear(map.surface_m, {p.x_m + dx_m, p.y_m + dy_m});
  };
  double gx = exaggeration * (z(step_m, 0.0) - z(-step_m, 0.0)) / (2.0 * step_m);
  double gy = exaggeration * (z(0.0, step_m) - z(0.0, -step_m)) / (2.0 * step_m);
  gx = std::isnan(gx) ? 0.0 : gx;
  gy = std::isnan(gy) ? 0.0 : gy;
  // Lamp in the north-west, 45 degrees high: direction (-1, 1, sqrt 2) / 2.
  const double cosine = (gx - gy + std::sqrt(2.0)) / (2.0 * std::sqrt(1.0 + gx * gx + gy * gy));
  return std::clamp(cosine, 0.0, 1.0) * std::sqrt(2.0);
}

template <typename ColorAt>
Image image_of(const MapWindow& window, int columns, const ColorAt& color_at) {
  Image image;
  image.columns = columns;
  image.rows =
      std::max(1, static_cast<int>(std::lround(columns * window.height_m() / window.width_m())));
  image.bytes.reserve(static_cast<std::size_t>(image.columns) *
                      static_cast<std::size_t>(image.rows) * 3);
  for (int row = 0; row < image.rows; ++row) {
    for (int column = 0; column < image.columns; ++column) {
      const geo::MapPoint p{window.west_m + window.width_m() * (column + 0.5) / image.columns,
                            window.south_m + window.height_m() * (row + 0.5) / image.rows};
      const Color color = color_at(p);
      image.bytes += static_cast<char>(byte_of(color.red));
      image.bytes += static_cast<char>(byte_of(color.green));
      image.bytes += static_cast<char>(byte_of(color.blue));
    }
  }
  return image;
}

template <typename Visit>
void for_each_cell(const map::Map& map, const MapWindow& window, const Visit& visit) {
  const raster::CellIndex first = map.geometry.cell_at({window.west_m, window.south_m});
  const raster::CellIndex last = map.geometry.cell_at({window.east_m, window.north_m});
  for (int row = std::max(0, first.row); row <= std::min(map.geometry.rows - 1, last.row); ++row) {
    for (int column = std::max(0, first.column);
         column <= std::min(map.geometry.columns - 1, last.column); ++column) {
      visit(raster::CellIndex{column, row});
    }
  }
}

}  // namespace

std::string hex(const Color& color) {
  std::array<char, 8> text{};
  std::snprintf(
      text.data(), text.size(), "#%02x%02x%02x", static_cast<unsigned>(byte_of(color.red)),
      static_cast<unsigned>(byte_of(color.green)), static_cast<unsigned>(byte_of(color.blue)));
  return text.data();
}

HeightRange surface_range(const map::Map& map, const MapWindow& window) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  HeightRange range{nan, nan};
  for_each_cell(map, window, [&](raster::CellIndex cell) {
    const auto z = static_cast<double>(map.surface_m.at(cell));
    range.low_m = std::fmin(range.low_m, z);
    range.high_m = std::fmax(range.high_m, z);
  });
  return range;
}

Color surface_tint(double share) {
  static constexpr std::array<int, 7> kTints = {0x7fa382, 0xa3bd8c, 0xcdd09b, 0xdcc892,
                                                0xc7a877, 0xb59a82, 0xefebe6};
  return on_scale(kTints, share);
}

Image surface_image(const map::Map& map, const MapWindow& window, int columns) {
  const HeightRange range = surface_range(map, window);
  const double step_m = std::max(window.width_m() / columns, 1.5 * map.geometry.cell_m);
  return image_of(window, columns, [&](const geo::MapPoint& p) {
    const double z = raster::sample_bilinear(map.surface_m, p);
    if (std::isnan(z)) {
      return kUnknown;
    }
    const Color tint = surface_tint((z - range.low_m) / std::max(range.high_m - range.low_m, 1.0));
    const double light = relief(map, p, step_m, 1.7);
    return light < 1.0 ? scaled(tint, 0.30 + 0.70 * light)
                       : mixed(tint, {1.0, 1.0, 0.96}, 1.1 * (light - 1.0));
  });
}

double visibility_scale(const map::Map& map, const MapWindow& window) {
  std::vector<std::uint16_t> known;
  for_each_cell(map, window, [&](raster::CellIndex cell) {
    if (map.visibility.at(cell) != map::kVisibilityUnknown) {
      known.push_back(map.visibility.at(cell));
    }
  });
  if (known.empty()) {
    return 1.0;
  }
  const auto nth =
      known.begin() + static_cast<std::ptrdiff_t>(0.995 * static_cast<double>(known.size() - 1));
  std::nth_element(known.begin(), nth, known.end());
  return std::clamp(std::ceil(10.0 * map::visibility_share(*nth)) / 10.0, 0.1, 1.0);
}

Color visibility_color(double share_of_scale) {
  // The scale "magma" of S. van der Walt and N. Smith: even steps of lightness, dark to bright.
  static constexpr std::array<int, 9> kMagma = {0x000004, 0x1d1147, 0x51127c, 0x832681, 0xb73779,
                                                0xe75263, 0xfc8961, 0xfec488, 0xfcfdbf};
  return on_scale(kMagma, share_of_scale);
}

Image visibility_image(const map::Map& map, const MapWindow& window, int columns, double high) {
  return image_of(window, columns, [&](const geo::MapPoint& p) {
    const raster::CellIndex cell = map.geometry.cell_at(p);
    if (!map.geometry.contains(cell)) {
      return kUnknown;
    }
    const double share = map::visibility_share(map.visibility.at(cell));
    return std::isnan(share) ? kUnknown : visibility_color(share / high);
  });
}

Image semantics_image(const map::Map& map, const MapWindow& window, int columns) {
  const double step_m = std::max(window.width_m() / columns, 1.5 * map.geometry.cell_m);
  return image_of(window, columns, [&](const geo::MapPoint& p) {
    const raster::CellIndex cell = map.geometry.cell_at(p);
    if (!map.geometry.contains(cell) || std::isnan(map.surface_m.at(cell))) {
      return kUnknown;
    }
    const std::uint16_t bits = map.semantics.at(cell);
    Color color{0.965, 0.96, 0.945};
    for (const ClassStyle& style : kClasses) {
      if (has(bits, style.bit)) {
        color = rgb(style.color);
        break;
      }
    }
    const double z_free_light = relief(map, p, step_m, 1.2);
    return scaled(color, std::clamp(0.62 + 0.38 * z_free_light, 0.0, 1.03));
  });
}

Image hillshade_image(const map::Map& map, const MapWindow& window, int columns) {
  const double step_m = std::max(window.width_m() / columns, 1.5 * map.geometry.cell_m);
  return image_of(window, columns, [&](const geo::MapPoint& p) {
    if (std::isnan(raster::sample_bilinear(map.surface_m, p))) {
      return kUnknown;
    }
    const double light = relief(map, p, step_m, 1.7);
    const double grey = light < 1.0 ? 0.35 + 0.5 * light : 0.85 + 0.36 * (light - 1.0);
    return Color{grey, grey, grey};
  });
}

Image surface_tint_image(const map::Map& map, const MapWindow& window, int columns) {
  const HeightRange range = surface_range(map, window);
  return image_of(window, columns, [&](const geo::MapPoint& p) {
    const double z = raster::sample_bilinear(map.surface_m, p);
    return std::isnan(z)
               ? kUnknown
               : surface_tint((z - range.low_m) / std::max(range.high_m - range.low_m, 1.0));
  });
}

Image semantics_tint_image(const map::Map& map, const MapWindow& window, int columns) {
  return image_of(window, columns, [&](const geo::MapPoint& p) {
    const raster::CellIndex cell = map.geometry.cell_at(p);
    if (map.geometry.contains(cell)) {
      const std::uint16_t bits = map.semantics.at(cell);
      for (const ClassStyle& style : kClasses) {
        if (has(bits, style.bit)) {
          return rgb(style.color);
        }
      }
    }
    return Color{1.0, 1.0, 1.0};
  });
}

Image seen_image(const raster::Grid<float>& lowest_seen_m, const MapWindow& window, int columns,
                 double height_m) {
  const raster::GridGeometry& geometry = lowest_seen_m.geometry();
  return image_of(window, columns, [&](const geo::MapPoint& p) {
    const raster::CellIndex cell = geometry.cell_at(p);
    const bool is_seen =
        geometry.contains(cell) && static_cast<double>(lowest_seen_m.at(cell)) <= height_m;
    return is_seen ? Color{1.0, 0.55, 0.5} : Color{1.0, 1.0, 1.0};
  });
}

std::vector<LegendEntry> semantics_legend(const map::Map& map, const MapWindow& window) {
  std::uint16_t all = 0;
  for_each_cell(map, window, [&](raster::CellIndex cell) { all |= map.semantics.at(cell); });
  std::vector<LegendEntry> legend;
  for (const ClassStyle& style : kClasses) {
    if (has(all, style.bit)) {
      legend.push_back({rgb(style.color), style.text});
    }
  }
  return legend;
}

}  // namespace hedgehop::output
