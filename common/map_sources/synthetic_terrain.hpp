#pragma once

#include <cstdint>
#include <vector>

#include "raster/grid.hpp"

namespace hedgehop::map_sources {

/// Noise in [0, 1) that depends on its arguments alone: the same on every machine.
double lattice_noise(std::uint64_t seed, std::int64_t column, std::int64_t row);

/// Smooth gradient noise, about [-1, 1], with features of the size `wavelength_m`.
double smooth_noise(std::uint64_t seed, double x_m, double y_m, double wavelength_m);

/// Sum of `octaves` of smooth_noise, each of half the wavelength and `gain` times the amplitude;
/// about
/// [-1, 1].
double fractal_noise(std::uint64_t seed, double x_m, double y_m, double wavelength_m, int octaves,
                     double gain);

/// Hills with a branching, drained valley network.
struct SyntheticTerrain {
  raster::Grid<float> elevation_m;     // multiples of 1/1024 m
  raster::Grid<float> above_stream_m;  // height above the stream that the cell drains into
  raster::Grid<float> catchment_km2;   // area inside the region that drains through the cell
  raster::Grid<float> slope;           // magnitude of the gradient [-]
  std::vector<int> receiver;  // per cell, row by row from the south: index of the cell that it
                              // drains into, -1 on the border
};

/// Makes terrain on `geometry` by stream-power erosion.
///
/// An uplifted, rough plateau is eroded by its own rivers, dz/dt = U - K sqrt(A) S, and rounded by
/// hill slope diffusion, on grids that get finer (200, 100, 50 m, cell size). It is then scaled in
/// height so that the 90th percentile of the slope is `slope_p90`, valley floors are widened, and
/// closed pits are filled: from each cell a strictly falling path over the eight neighbours leads
/// to the border.
///
/// Source: the implicit scheme of J. Braun and S. D. Willett, Geomorphology 180-181, 2013,
/// doi:10.1016/j.geomorph.2012.10.008, with the flow routed by a priority flood, R. Barnes et al.,
/// Computers & Geosciences 62, 2014, doi:10.1016/j.cageo.2013.04.024.
///
/// @param geometry   square, with a side that is a multiple of 8 cells.
/// @param slope_p90  tangent of the wanted 90th percentile of the slope.
/// @throws std::invalid_argument for another geometry or a slope that is not positive.
SyntheticTerrain make_synthetic_terrain(const raster::GridGeometry& geometry, std::uint64_t seed,
                                        double slope_p90);

}  // namespace hedgehop::map_sources
