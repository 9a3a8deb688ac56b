#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/observer.hpp"
#include "geo/geodetic_box.hpp"
#include "geo/vertical_datum.hpp"
#include "raster/grid.hpp"

namespace hedgehop::map_sources {

/// What the heights of an elevation file are heights of.
enum class ElevationKind {
  kTerrain,  // the ground: what stands on it has still to be added
  kSurface,  // as a radar or a pair of images sees it: trees and houses are in it
};
std::string_view word_of(ElevationKind kind);

/// An elevation file and what its user knows better than the file.
struct ElevationInput {
  ElevationInput(std::filesystem::path path)  // NOLINT(google-explicit-constructor): a path is one
      : file(std::move(path)) {}

  std::filesystem::path file;
  std::optional<ElevationKind> kind;
  std::optional<geo::VerticalDatum> datum;
  std::string crs;  // of a file that states none; empty: as the file says

  /// FILE[:terrain|:surface][:datum=NAME][:crs=EPSG:CODE]; the last parts in any order. A file
  /// whose name is the whole text is taken as it is. Throws UsageError for a datum that is not
  /// known.
  static ElevationInput parse(const std::string& text);
};

/// What an elevation file says about itself, and how it is used.
struct ElevationFile {
  std::string name;       // without its folder
  std::string format;     // GDAL's name of it: "GTiff", "SRTMHGT"
  std::string crs;        // code or name of its horizontal coordinate system
  std::string copyright;  // its metadata's line, if any
  ElevationKind kind = ElevationKind::kTerrain;
  std::string kind_from;  // "command line", "product", "name" or "default"
  geo::VerticalDatum datum;
  std::string datum_from;        // "command line", "file", "product" or "assumed"
  std::string datum_conversion;  // the operation that was used, empty: none
  geo::GeodeticBox extent;       // smallest box that holds it
  int columns = 0;
  int rows = 0;
  double sample_spacing_m = 0.0;             // at its centre, the smaller of both directions
  std::vector<std::filesystem::path> parts;  // files that it consists of
};

/// Elevations on a map grid. NaN where no file knows it and none could be filled in.
struct ElevationLayers {
  /// The ground, interpolated at the cells' centres. Where the first file is a surface, the ground
  /// of the first terrain file there, if it lies below; else that surface.
  raster::Grid<float> terrain_m;
  /// What a safe surface starts from, >= terrain. No cell is lower than a sample that lies in it,
  /// of the file that the cell is taken from, and the bilinear surface through the cells' centres
  /// passes over every such sample.
  raster::Grid<float> upper_terrain_m;
  /// 1 where upper_terrain_m is of a surface file, so that what stands there is in it already.
  raster::Grid<std::uint8_t> is_surface;
  /// Number of the file, from 1, that upper_terrain_m comes from; 0: unknown; kFilled.
  raster::Grid<std::uint16_t> source;
  static constexpr std::uint16_t kFilled = 65535;
};

/// Elevation rasters: SRTM tiles (.hgt, .hgt.zip), GeoTIFF, DTED, ASCII grids, virtual mosaics and
/// whatever else GDAL reads, in any mixture of coordinate systems, resolutions and datums.
///
/// Voids are the file's no-data value, -32768, NaN, and anything below -1000 m or above 9500 m;
/// they never become a height. In each cell the first file that knows a height there holds. Files
/// of one lattice (neighbouring tiles) are joined before they are interpolated, so that there is no
/// seam.
///
/// Kind: as the user says, else surface for the products of radar and stereo images that its name
/// tells (Copernicus DEM, AW3D30, ASTER GDEM, TanDEM-X) and for names with the word "dsm", else
/// terrain; SRTM counts as terrain.
///
/// Datum: as the user says, else as the file states, else that of the product, else the map's.
/// Heights are converted by a geoid grid, never by a ballpark; units other than metres where the
/// file names them.
///
/// A void cell is filled in where known cells lie within `void_fill_radius_m` on both sides of it,
/// in at least two of the directions E-W, N-S and the diagonals: terrain linearly between them,
/// upper terrain at the greatest of them. Nothing is filled in beyond the edge of what is known.
class ElevationSource {
 public:
  /// Opens every file. Throws DataError naming the file: missing, damaged archive, wrong name of an
  /// SRTM tile, no raster, no coordinate system, unknown unit or datum, missing geoid grid.
  ElevationSource(const std::vector<ElevationInput>& inputs, const geo::VerticalDatum& map_datum,
                  double void_fill_radius_m);
  ~ElevationSource();
  ElevationSource(const ElevationSource&) = delete;
  ElevationSource& operator=(const ElevationSource&) = delete;

  [[nodiscard]] const std::vector<ElevationFile>& files() const;
  /// Smallest box that holds every file.
  [[nodiscard]] geo::GeodeticBox extent() const;

  /// Interpolation by GDAL's bilinear warper with the exact transformer (wider kernel where the
  /// source is finer than the cells). A cell's values depend neither on `threads` nor on how far
  /// the grid reaches. Values are multiples of 1/64 m, the upper terrain rounded up. Throws
  /// DataError if a file cannot be read or has too many samples in the region, Interrupted.
  [[nodiscard]] ElevationLayers on_grid(const raster::GridGeometry& geometry,
                                        const std::string& crs_wkt, int threads,
                                        Observer& observer) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace hedgehop::map_sources
