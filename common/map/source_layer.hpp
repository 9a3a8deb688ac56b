#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string_view>

#include "map/map.hpp"

namespace hedgehop::map {

inline constexpr char kSourceLayerFile[] = "sources.tif";

/// Why the surface of a cell is as high as it is.
enum class HeightOrigin : std::uint8_t {
  kElevation = 0,     // nothing stands there, or the elevation file holds it
  kStated = 1,        // height of the highest object there, as its source states it
  kStoreys = 2,       // counted by storeys
  kClassDefault = 3,  // guessed by the class of the object
  kThin = 4,          // a wire or a thin obstacle
};
std::string_view words_of(HeightOrigin origin);

/// Where the heights of a cell come from. Not part of the map's hash: planners do not read it.
struct CellSource {
  /// Number of the elevation file among the manifest's inputs of kind "elevation", from 1; 0:
  /// unknown; kFilled: filled in from neighbouring cells; kLater: that one or a later one.
  int elevation = 0;
  HeightOrigin origin = HeightOrigin::kElevation;

  static constexpr int kFilled = 4095;
  static constexpr int kLater = 4094;
};
std::uint16_t packed(const CellSource& source);
CellSource unpacked_source(std::uint16_t value);

/// Writes sources.tif into a bundle's folder: 16 bits a cell, elevation + 4096 x origin. Throws
/// SystemFailure.
void write_source_layer(const Map& map, const raster::Grid<std::uint16_t>& sources,
                        const std::filesystem::path& folder);

/// The value at a cell; nullopt if the bundle has no such layer. Throws DataError if the layer is
/// damaged or of another size than the map.
std::optional<CellSource> read_cell_source(const Map& map, const std::filesystem::path& folder,
                                           raster::CellIndex cell);

}  // namespace hedgehop::map
