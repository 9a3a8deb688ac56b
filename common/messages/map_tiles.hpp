#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "base/hash.hpp"
#include "map/map.hpp"
#include "messages/blob.hpp"
#include "messages/map_messages.hpp"

/// A map cut into blobs and put together again, bit for bit (the sign of a zero and the payload of
/// a NaN included). Nothing here touches a bus.
namespace hedgehop::messages {

/// Raster layers in the order of the tile table.
/// From kFurtherVisibility on, one for each further height of the exposure volume; from kThreat on,
/// one for each named observer, in the table of their own.
enum class MapLayer : std::int8_t {
  kTerrain = 0,
  kSurface = 1,
  kSemantics = 2,
  kVisibility = 3,
  kFurtherVisibility = 4,
  kThreat = 16,
};
/// Layers that every map has.
inline constexpr std::array<MapLayer, 4> kMapLayers = {MapLayer::kTerrain, MapLayer::kSurface,
                                                       MapLayer::kSemantics, MapLayer::kVisibility};
/// "surface"; "visibility 4" for the further heights, "observer 2" for named observers.
std::string name_of(MapLayer layer);

/// How a raster is cut: tiles of `tile_cells` squared from the south-west corner; the last column
/// and row of tiles may be narrower.
struct Tiling {
  int columns = 0;  // cells of the raster
  int rows = 0;
  int tile_cells = 0;
  int further_heights = 0;  // of the exposure volume

  [[nodiscard]] int layer_count() const {
    return static_cast<int>(kMapLayers.size()) + further_heights;
  }
  [[nodiscard]] int tile_columns() const { return (columns + tile_cells - 1) / tile_cells; }
  [[nodiscard]] int tile_rows() const { return (rows + tile_cells - 1) / tile_cells; }
  [[nodiscard]] int tile_count() const { return tile_columns() * tile_rows(); }  // of one layer
  bool operator==(const Tiling&) const = default;
};
Tiling tiling_of(const MapIndex& index);
Tiling tiling_of(const map::Map& map, int tile_cells);

struct TileAddress {
  MapLayer layer = MapLayer::kTerrain;
  int tile_column = 0;
  int tile_row = 0;

  bool operator==(const TileAddress&) const = default;
};
/// "layer surface, tile column 3, tile row 0".
std::string name_of(const TileAddress& address);

/// Place of a tile in the table, and back.
std::size_t tile_index(const Tiling& tiling, const TileAddress& address);
TileAddress tile_address(const Tiling& tiling, std::size_t index);
/// The same of a place in the table of named observers.
TileAddress threat_tile_address(const Tiling& tiling, std::size_t index);

/// One tile of a map, encoded. Cells are stored as differences to their neighbours, byte planes
/// apart, which packs well.
Bytes encode_map_tile(const map::Map& map, int tile_cells, const TileAddress& address);
/// Writes a tile into `map`, whose layers must have been sized by begin_map(), those of named
/// observers by their reader. Throws MessageError if the bytes are not the tile of that address.
void decode_map_tile(ByteView bytes, const Tiling& tiling, const TileAddress& address,
                     map::Map& map);

/// Everything of a map that is not a raster, nor about named observers; `map_hash` is that of
/// MAP_INDEX.
Bytes encode_map_features(const map::Map& map, const Hash128& map_hash);
/// Fills these members of `map`; `map_hash` is what the content must claim to belong to.
void decode_map_features(ByteView bytes, const Hash128& map_hash, map::Map& map);

/// The blobs of all tiles, in the order of tile_index().
Bytes encode_map_tile_table(const Hash128& map_hash, const Tiling& tiling,
                            const std::vector<BlobRef>& tiles);
std::vector<BlobRef> decode_map_tile_table(ByteView bytes, const Hash128& map_hash,
                                           const Tiling& tiling);

inline constexpr std::size_t kThreatNameBytesMax = 200;
/// The named observers of a map and the blobs of their tiles, in the order of
/// threat_tile_address().
struct MapThreats {
  std::vector<std::string> names;
  std::vector<BlobRef> tiles;
};
/// `map_hash` is that of the map with its named observers.
Bytes encode_map_threats(const Hash128& map_hash, const Tiling& tiling, const MapThreats& threats);
/// Of `count` observers.
MapThreats decode_map_threats(ByteView bytes, const Hash128& map_hash, const Tiling& tiling,
                              int count);

/// A map with its geometry and with layers of the right size, nothing in them.
map::Map begin_map(const MapIndex& index);

/// Checks the whole: map_hash() equals what the index says, layers are consistent. Throws
/// MessageError.
void finish_map(map::Map& map, const Hash128& map_hash);

}  // namespace hedgehop::messages
