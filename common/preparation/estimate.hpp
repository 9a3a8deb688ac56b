#pragma once

#include <cstddef>
#include <cstdint>

#include "map_sources/elevation_source.hpp"
#include "preparation/prepare.hpp"
#include "raster/grid.hpp"

namespace hedgehop::preparation {

/// Where a map lies, and what must be worked on for it.
struct RegionGrids {
  std::string crs;                     // as asked for, or the code of the UTM zone
  geo::GeodeticBox extent;             // asked for, or all of the elevation files
  raster::GridGeometry map;            // the map itself, or its tile
  raster::GridGeometry working;        // with its margin for visibility
  raster::GridGeometry whole_working;  // the same of all tiles together
};

/// Throws as prepare() does for regions that cannot be prepared.
RegionGrids region_grids(const PrepareRequest& request, const PrepareOptions& options,
                         const map_sources::ElevationSource& elevation);

/// How fast this machine is, measured by the caller.
struct MachineSpeed {
  double visibility_s_per_cell = 0.0;  // processor time of visibility_sample() over its cells
  int threads = 1;
};

/// Cells of the sample, and the visibility layer over hills of that size with these options: what a
/// caller times. Pure.
inline constexpr int kSampleCells = 128;
void visibility_sample(const VisibilityOptions& options, double cell_m, int threads);

/// What preparing a map will take. Good to a factor of 3 (tests/cli holds that on a real run); the
/// hills and towns of the region decide.
struct PrepareEstimate {
  RegionGrids grids;
  std::uint64_t input_bytes = 0;
  double disk_bytes = 0.0;
  double memory_bytes = 0.0;  // peak
  double duration_s = 0.0;
};
PrepareEstimate estimate_prepare(const PrepareRequest& request, const PrepareOptions& options,
                                 const MachineSpeed& speed);

}  // namespace hedgehop::preparation
