#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "map/map.hpp"
#include "support/test_map.hpp"

namespace hedgehop::test {

/// Hills of many sizes: sums of smoothly interpolated random lattices (value noise), the amplitude
/// of each octave `roughness` times that of the one before. Different seeds give unrelated terrain.
class FractalTerrain {
 public:
  FractalTerrain(std::uint64_t seed, double largest_m, double relief_m, double roughness = 0.5,
                 int octaves = 7)
      : seed_(seed),
        largest_m_(largest_m),
        relief_m_(relief_m),
        roughness_(roughness),
        octaves_(octaves) {}

  double operator()(double x_m, double y_m) const {
    double sum = 0.0;
    double amplitude = 1.0;
    double all = 0.0;
    double size_m = largest_m_;
    for (int octave = 0; octave < octaves_; ++octave) {
      sum += amplitude * noise(x_m / size_m, y_m / size_m, octave);
      all += amplitude;
      amplitude *= roughness_;
      size_m *= 0.5;
    }
    return relief_m_ * sum / all;
  }

 private:
  double lattice(std::int64_t i, std::int64_t j, int octave) const {
    std::uint64_t mixed = seed_ + 0x9e3779b97f4a7c15U * static_cast<std::uint64_t>(i) +
                          0xc2b2ae3d27d4eb4fU * static_cast<std::uint64_t>(j) +
                          0x165667b19e3779f9U * static_cast<std::uint64_t>(octave + 1);
    mixed = (mixed ^ (mixed >> 30U)) * 0xbf58476d1ce4e5b9U;
    mixed = (mixed ^ (mixed >> 27U)) * 0x94d049bb133111ebU;
    mixed ^= mixed >> 31U;
    return static_cast<double>(mixed >> 11U) * 0x1.0p-53;
  }

  double noise(double u, double v, int octave) const {
    const double iu = std::floor(u);
    const double iv = std::floor(v);
    const auto smooth = [](double t) { return t * t * (3.0 - 2.0 * t); };
    const double su = smooth(u - iu);
    const double sv = smooth(v - iv);
    const auto i = static_cast<std::int64_t>(iu);
    const auto j = static_cast<std::int64_t>(iv);
    return (1.0 - sv) * ((1.0 - su) * lattice(i, j, octave) + su * lattice(i + 1, j, octave)) +
           sv * ((1.0 - su) * lattice(i, j + 1, octave) + su * lattice(i + 1, j + 1, octave));
  }

  std::uint64_t seed_;
  double largest_m_, relief_m_, roughness_;
  int octaves_;
};

/// A square map of fractal terrain; visibility grows from 0 in the lowest to 1 at the highest
/// ground, semantics are empty.
inline map::Map make_fractal_map(std::uint64_t seed, int cells, double cell_m, double largest_m,
                                 double relief_m) {
  map::Map map = make_map(cells, cells, cell_m, FractalTerrain(seed, largest_m, relief_m));
  const auto [low, high] =
      std::minmax_element(map.terrain_m.values().begin(), map.terrain_m.values().end());
  const double bottom_m = static_cast<double>(*low);
  const double span_m = std::max(static_cast<double>(*high) - bottom_m, 1.0);
  for (std::size_t i = 0; i < map.visibility.values().size(); ++i) {
    const double share = (static_cast<double>(map.terrain_m.values()[i]) - bottom_m) / span_m;
    map.visibility.values()[i] = stored_visibility(share);
  }
  finish_map(map);
  return map;
}

}  // namespace hedgehop::test
