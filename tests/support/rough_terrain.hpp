#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "flight/route.hpp"
#include "support/test_map.hpp"

namespace hedgehop::test {

/// Fractal hills: octaves of gradient noise, scaled so that a tenth of the cells is steeper than
/// asked.
inline map::Map make_rough_map(int columns, int rows, double cell_m, std::uint64_t seed,
                               double slope_p90_deg) {
  std::mt19937_64 random(seed);
  struct Octave {
    double wavelength_m, amplitude_m;
    int size;
    std::vector<double> gradients;
  };
  std::vector<Octave> octaves;
  const double extent_m = cell_m * std::max(columns, rows);
  for (double wavelength_m = 6000.0; wavelength_m >= 4.0 * cell_m; wavelength_m *= 0.5) {
    Octave octave{wavelength_m,
                  std::pow(wavelength_m / 6000.0, 1.05),
                  static_cast<int>(extent_m / wavelength_m) + 2,
                  {}};
    for (int i = 0; i < octave.size * octave.size; ++i) {
      const double angle_rad = std::uniform_real_distribution<double>(0.0, 6.283185307)(random);
      octave.gradients.push_back(std::cos(angle_rad));
      octave.gradients.push_back(std::sin(angle_rad));
    }
    octaves.push_back(std::move(octave));
  }
  const auto shape = [&](double x_m, double y_m) {
    double sum = 0.0;
    for (const Octave& octave : octaves) {
      const double u = x_m / octave.wavelength_m;
      const double v = y_m / octave.wavelength_m;
      const int i = static_cast<int>(u);
      const int j = static_cast<int>(v);
      const auto fade = [](double t) { return t * t * t * (t * (t * 6.0 - 15.0) + 10.0); };
      const auto corner = [&](int di, int dj) {
        const auto at = static_cast<std::size_t>(2 * ((j + dj) * octave.size + i + di));
        return octave.gradients[at] * (u - i - di) + octave.gradients[at + 1] * (v - j - dj);
      };
      const double fu = fade(u - i);
      const double fv = fade(v - j);
      sum += octave.amplitude_m * ((1 - fv) * ((1 - fu) * corner(0, 0) + fu * corner(1, 0)) +
                                   fv * ((1 - fu) * corner(0, 1) + fu * corner(1, 1)));
    }
    return sum;
  };
  map::Map map = make_map(columns, rows, cell_m, shape);
  std::vector<double> slopes;
  for (int row = 1; row + 1 < rows; ++row) {
    for (int column = 1; column + 1 < columns; ++column) {
      const double dx = map.terrain_m.at(column + 1, row) - map.terrain_m.at(column - 1, row);
      const double dy = map.terrain_m.at(column, row + 1) - map.terrain_m.at(column, row - 1);
      slopes.push_back(std::hypot(dx, dy) / (2.0 * cell_m));
    }
  }
  const auto tenth = slopes.begin() + static_cast<std::ptrdiff_t>(slopes.size() * 9 / 10);
  std::nth_element(slopes.begin(), tenth, slopes.end());
  const double scale = std::tan(slope_p90_deg * 0.017453292519943295) / *tenth;
  for (float& height_m : map.terrain_m.values()) {
    height_m = static_cast<float>(500.0 + scale * static_cast<double>(height_m));
  }
  map.surface_m = map.terrain_m;
  finish_map(map);
  return map;
}

/// A stand-in for a global route: the corners joined by straight legs, points every `spacing_m`,
/// altitudes the lowest that keep `height_m` above the surface within `margin_m` and a slope limit.
/// The ends stand `end_height_m` above the surface if the slope limit lets them.
inline std::vector<flight::Waypoint> stand_in_guide(const map::Map& map,
                                                    const std::vector<geo::MapPoint>& corners,
                                                    double spacing_m, double height_m,
                                                    double margin_m, double slope_max,
                                                    double end_height_m) {
  constexpr double kFine_m = 5.0;
  std::vector<flight::Waypoint> fine;
  for (std::size_t i = 1; i < corners.size(); ++i) {
    const double dx_m = corners[i].x_m - corners[i - 1].x_m;
    const double dy_m = corners[i].y_m - corners[i - 1].y_m;
    const int steps = std::max(1, static_cast<int>(std::hypot(dx_m, dy_m) / kFine_m));
    for (int k = fine.empty() ? 0 : 1; k <= steps; ++k) {
      const geo::MapPoint point{corners[i - 1].x_m + dx_m * k / steps,
                                corners[i - 1].y_m + dy_m * k / steps};
      fine.push_back(
          {point.x_m, point.y_m, raster::max_within(map.surface_m, point, margin_m) + height_m});
    }
  }
  for (flight::Waypoint* end : {&fine.front(), &fine.back()}) {
    end->altitude_m = raster::sample_bilinear(map.surface_m, end->point()) + end_height_m;
  }
  const auto limit = [&](const flight::Waypoint& from, flight::Waypoint& to) {
    const double run_m = std::hypot(to.x_m - from.x_m, to.y_m - from.y_m);
    to.altitude_m = std::max(to.altitude_m, from.altitude_m - slope_max * run_m);
  };
  for (std::size_t i = 1; i < fine.size(); ++i) {
    limit(fine[i - 1], fine[i]);
  }
  for (std::size_t i = fine.size() - 1; i > 0; --i) {
    limit(fine[i], fine[i - 1]);
  }
  std::vector<flight::Waypoint> guide;
  double since_m = spacing_m;
  for (std::size_t i = 0; i < fine.size(); ++i) {
    if (i > 0) {
      since_m += std::hypot(fine[i].x_m - fine[i - 1].x_m, fine[i].y_m - fine[i - 1].y_m);
    }
    if (since_m >= spacing_m || i + 1 == fine.size()) {
      guide.push_back(fine[i]);
      since_m = 0.0;
    }
  }
  return guide;
}

}  // namespace hedgehop::test
