#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "geo/geodetic_box.hpp"
#include "geo/map_projection.hpp"

namespace hedgehop::map_sources {

/// Shown on everything that is made of the synthetic region.
inline constexpr char kSyntheticLabel[] = "SYNTHETIC REGION";

struct SyntheticOptions {
  std::uint64_t seed = 1;  // another seed, another region
};

/// Where the files of a synthetic region are and what to do with them.
struct SyntheticRegion {
  std::filesystem::path dem_file;  // GeoTIFF, float32 metres, 25 m cells, EPSG:32632
  std::filesystem::path osm_file;  // OSM XML
  std::string label;               // kSyntheticLabel
  std::string attribution;         // one line that says that nothing of it is real
  std::string crs;                 // "EPSG:32632"
  geo::GeodeticBox extent;         // the largest box of parallels and meridians inside the raster
  geo::GeodeticPosition start;     // a flight of about 18 km across the hills
  geo::GeodeticPosition goal;
};

/// Invents a region and writes it into `folder`, which must exist: `synthetic_terrain.tif` and
/// `synthetic_landcover.osm`.
///
/// 24 km x 24 km of hills with a branching, drained valley network and a main river, forests in
/// blocks and on steep slopes, a town, villages, farmsteads, single trees, a power line on towers
/// and a minor one on poles; some objects have a tagged height, others not. It lies in the open
/// North Sea, so that nobody takes it for a real place, and every file, way and relation says that
/// it is synthetic. The same seed gives the same bytes on every machine.
///
/// @throws SystemFailure  a file cannot be written.
/// @note  About 3 s.
SyntheticRegion write_synthetic_region(const std::filesystem::path& folder,
                                       const SyntheticOptions& options);

}  // namespace hedgehop::map_sources
