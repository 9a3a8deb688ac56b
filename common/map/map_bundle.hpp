#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "base/observer.hpp"
#include "map/map.hpp"

namespace hedgehop::map {

inline constexpr int kMapSchemaVersion = 2;
inline constexpr char kMapManifestFile[] = "manifest.json";

/// Writes manifest.json, terrain.tif, surface.tif, semantics.tif, visibility.tif and features.gpkg
/// into an existing, empty folder. `provenance_json` is a JSON object (inputs, settings, tool
/// version, statistics) that becomes part of the manifest. Same map and provenance, same bytes.
/// Throws SystemFailure when a file cannot be written, Interrupted when `observer`, if there is
/// one, asks to stop.
void write_map_bundle(const Map& map, const std::string& provenance_json,
                      const std::filesystem::path& folder, const Observer* observer = nullptr);

/// Of a bundle: from which height on each named observer sees something over a cell.
inline constexpr char kThreatsFile[] = "threats.tif";

/// Writes heights [m, NaN unknown], one named band each, as a GeoTIFF over the map's cells. Throws
/// as write_map_bundle().
struct NamedBand {
  std::string name;
  const raster::Grid<float>* height_m = nullptr;
};
void write_height_bands(const Map& map, const std::vector<NamedBand>& bands,
                        const std::filesystem::path& file, const Observer* observer = nullptr);

/// Reads them back: every band of the file, which must lie on the map's cells. Throws DataError.
std::vector<HeightLayer> read_height_bands(const Map& map, const std::filesystem::path& file);

/// Reads a bundle and checks its schema version, layers and hash. Throws DataError.
Map read_map_bundle(const std::filesystem::path& folder);

/// The manifest of a bundle as JSON text. Throws DataError.
std::string read_map_manifest(const std::filesystem::path& folder);

}  // namespace hedgehop::map
