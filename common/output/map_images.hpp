#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "map/map.hpp"

namespace hedgehop::output {

struct Color {
  double red = 0.0;  // in [0, 1]
  double green = 0.0;
  double blue = 0.0;
};

/// "#rrggbb".
std::string hex(const Color& color);

/// Part of the map frame, drawn north up.
struct MapWindow {
  double west_m = 0.0;
  double south_m = 0.0;
  double east_m = 0.0;
  double north_m = 0.0;

  [[nodiscard]] double width_m() const { return east_m - west_m; }
  [[nodiscard]] double height_m() const { return north_m - south_m; }
};

/// Red, green and blue bytes, row by row from the south.
struct Image {
  int columns = 0;
  int rows = 0;
  std::string bytes;
};

/// Lowest and highest surface inside a window; NaN if nothing is known.
struct HeightRange {
  double low_m = 0.0;
  double high_m = 0.0;
};
HeightRange surface_range(const map::Map& map, const MapWindow& window);

/// Surface model: tinted by height, lit from the north-west.
Image surface_image(const map::Map& map, const MapWindow& window, int columns);
Color surface_tint(double share);  // 0 lowest, 1 highest

/// Upper end of a colour scale for the visibility inside a window, in tenths: all but the brightest
/// 0.5 % of the cells lie below.
double visibility_scale(const map::Map& map, const MapWindow& window);

/// Share of the surroundings that sees a place, from 0 to `high`; dark is hidden, bright is seen,
/// grey is unknown.
Image visibility_image(const map::Map& map, const MapWindow& window, int columns, double high);
Color visibility_color(double share_of_scale);

/// Semantic classes over pale relief.
Image semantics_image(const map::Map& map, const MapWindow& window, int columns);

/// Layers to lie over a hillshade, multiplied with it: white changes nothing.
Image hillshade_image(const map::Map& map, const MapWindow& window, int columns);
Image surface_tint_image(const map::Map& map, const MapWindow& window, int columns);
Image semantics_tint_image(const map::Map& map, const MapWindow& window, int columns);
/// Where something at least `height_m` above the surface is seen: red.
Image seen_image(const raster::Grid<float>& lowest_seen_m, const MapWindow& window, int columns,
                 double height_m);

struct LegendEntry {
  Color color;
  std::string text;
};
/// The classes that occur inside the window.
std::vector<LegendEntry> semantics_legend(const map::Map& map, const MapWindow& window);

}  // namespace hedgehop::output
