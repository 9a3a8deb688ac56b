#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "base/observer.hpp"
#include "geo/geodetic_box.hpp"
#include "raster/grid.hpp"

namespace hedgehop::map_sources {

/// What an elevation file says about itself.
struct ElevationFile {
  std::string name;         // without its folder
  std::string format;       // GDAL's name of it: "GTiff", "SRTMHGT"
  std::string crs;          // code or name of its horizontal coordinate system
  std::string vertical;     // name of the vertical datum if the file states one, else empty
  std::string copyright;    // its metadata's line, if any
  geo::GeodeticBox extent;  // smallest box that holds it
  int columns = 0;
  int rows = 0;
  double sample_spacing_m = 0.0;  // at its centre, the smaller of both directions
};

/// Ground elevations on a map grid. NaN where no file knows it.
struct ElevationLayers {
  raster::Grid<float> terrain_m;  // interpolated at the cells' centres
  /// What a safe surface starts from, >= terrain. No cell is lower than a sample of the sources
  /// that lies in it, and the bilinear surface through the cells' centres passes over every sample.
  raster::Grid<float> upper_terrain_m;
};

/// Elevation rasters: SRTM tiles (.hgt, .hgt.zip), GeoTIFF and whatever else GDAL reads, in any
/// coordinate system.
///
/// Voids are the file's no-data value, -32768, NaN, and anything below -1000 m or above 9500 m;
/// they never become a height. Units other than metres are converted where the file names them.
/// Files of one lattice (neighbouring tiles) are joined before they are interpolated, so that there
/// is no seam. Heights are taken as they are: no change of vertical datum.
class ElevationSource {
 public:
  /// Opens every file. Earlier ones win where they overlap. Throws DataError naming the file:
  /// missing, damaged archive, wrong name of an SRTM tile, no raster, no coordinate system, unknown
  /// unit.
  explicit ElevationSource(const std::vector<std::filesystem::path>& files);
  ~ElevationSource();
  ElevationSource(const ElevationSource&) = delete;
  ElevationSource& operator=(const ElevationSource&) = delete;

  [[nodiscard]] const std::vector<ElevationFile>& files() const;
  /// Smallest box that holds every file.
  [[nodiscard]] geo::GeodeticBox extent() const;

  /// Terrain by GDAL's bilinear warper with the exact transformer (wider kernel where the source is
  /// finer than the cells); the result does not depend on `threads`. Values are multiples of 1/64
  /// m, the upper terrain rounded up. Throws DataError if a file cannot be read or has too many
  /// samples in the region, Interrupted.
  [[nodiscard]] ElevationLayers on_grid(const raster::GridGeometry& geometry,
                                        const std::string& crs_wkt, int threads,
                                        Observer& observer) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace hedgehop::map_sources
