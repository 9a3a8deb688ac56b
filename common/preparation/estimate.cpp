#include "preparation/estimate.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "base/errors.hpp"
#include "base/observer.hpp"

namespace hedgehop::preparation {
namespace {

// Measured on prepared regions of 0.1 to 5 million cells; what is not visibility runs in one
// thread for the most part.
constexpr double kOtherWork_s_per_cell = 1.6e-6;  // warping, burning, hashing, writing
constexpr double kFixedWork_s = 0.3;              // projections, geoid grids
constexpr double kMemoryBytesPerCell = 90.0;      // of the working raster
constexpr double kMemoryFixedBytes = 90e6;        // the program and its libraries
constexpr double kDiskBytesPerCell = 7.0;         // five layers, packed
constexpr double kHeightBandMemoryBytesPerCell = 8.0;
constexpr double kDiskFixedBytes = 150e3;  // manifest and an empty GeoPackage

/// Land-use files are read as a whole, whatever the region.
double reading_s(const std::filesystem::path& file, double bytes) {
  const std::string name = file.string();
  const bool is_packed = name.ends_with(".pbf") || name.ends_with(".gz") || name.ends_with(".bz2");
  return bytes * (is_packed ? 1.2e-7 : 3.0e-8);
}

std::uint64_t bytes_of_file(const std::filesystem::path& file) {
  std::error_code error;
  const std::uintmax_t bytes = std::filesystem::file_size(file, error);
  if (error) {
    throw DataError(file.string() + ": " + error.message(), "check the file's name and place");
  }
  return bytes;
}

double hills_m(double x_m, double y_m) {
  // Parabolas in place of sines: what is timed is the kernel, not the hills.
  const auto wave = [](double u) {
    const double t = u - std::floor(u);
    return 4.0 * t * (1.0 - t);
  };
  return 400.0 + 120.0 * wave(x_m / 2300.0) * wave(y_m / 1900.0) + 25.0 * wave((x_m + y_m) / 400.0);
}

}  // namespace

void visibility_sample(const VisibilityOptions& options, double cell_m, int threads) {
  const int margin = static_cast<int>(std::ceil(options.radius_m / cell_m)) + 2;
  const int side = kSampleCells + 2 * margin;
  raster::Grid<float> surface_m({0.0, 0.0, cell_m, side, side}, 0.0F);
  for (int row = 0; row < side; ++row) {
    for (int column = 0; column < side; ++column) {
      surface_m.at(column, row) = static_cast<float>(hills_m(column * cell_m, row * cell_m));
    }
  }
  const VisibilityGround ground{surface_m, surface_m};
  SilentObserver silent;
  visibility_of_block(ground, {margin, margin}, kSampleCells, kSampleCells, options,
                      {threads, Simd::kBest}, silent);
}

PrepareEstimate estimate_prepare(const PrepareRequest& request, const PrepareOptions& options,
                                 const MachineSpeed& speed) {
  PrepareEstimate estimate;
  const map_sources::ElevationSource elevation(request.dem_files, options.vertical_datum,
                                               options.void_fill_radius_m);
  estimate.grids = region_grids(request, options, elevation);
  double reading = 0.0;
  double land_use_bytes = 0.0;
  const auto add = [&](const std::filesystem::path& file, bool is_land_use) {
    const std::uint64_t bytes = bytes_of_file(file);
    estimate.input_bytes += bytes;
    if (is_land_use) {
      reading += reading_s(file, static_cast<double>(bytes));
      land_use_bytes += static_cast<double>(bytes);
    }
  };
  for (const map_sources::ElevationFile& file : elevation.files()) {
    for (const auto& part : file.parts) {
      add(part, false);
    }
  }
  for (const auto& file : request.osm_files) {
    add(file, true);
  }
  for (const map_sources::VectorInput& input : request.vectors) {
    add(input.file, true);
  }
  const auto cells = static_cast<double>(estimate.grids.map.cell_count());
  const auto working_cells = static_cast<double>(estimate.grids.working.cell_count());
  const auto bands = static_cast<double>(options.visibility.further_heights_m.size());
  estimate.disk_bytes = kDiskFixedBytes + cells * (kDiskBytesPerCell + 2.0 * bands);
  estimate.memory_bytes =
      kMemoryFixedBytes + 3.0 * land_use_bytes +
      working_cells * (kMemoryBytesPerCell + kHeightBandMemoryBytesPerCell * bands);
  estimate.duration_s = kFixedWork_s + reading + working_cells * kOtherWork_s_per_cell +
                        cells * speed.visibility_s_per_cell / std::max(1, speed.threads);
  return estimate;
}

}  // namespace hedgehop::preparation
