#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "geo/map_projection.hpp"
#include "map/patch.hpp"
#include "messages/blob.hpp"
#include "messages/message.hpp"
#include "raster/grid.hpp"

namespace hedgehop::messages {

inline constexpr int kMaxMapSideCells = 30000;
/// Most bytes of the raster layers of a map that goes over the bus: what a reader allocates.
inline constexpr std::int64_t kMaxMapBytes = 1'200'000'000;
inline constexpr int kMaxFurtherHeights = 12;
/// Of a map's raster layers: 12 bytes a cell, and 2 for each further height.
std::int64_t raster_bytes(const raster::GridGeometry& geometry, std::size_t further_heights);
/// Most named observers that the bus carries of a map in such tiles: kMaxThreats, and fewer where
/// their layers, 4 bytes a cell each, would be more than kMaxMapBytes, or their tiles too many.
inline constexpr int kMaxThreats = 100;
int threats_max(const raster::GridGeometry& geometry, int tile_cells);

/// The layers of a map's named observers. They travel apart from the map, so that only those get
/// them who are asked to weigh them.
struct ThreatLayers {
  int count = 0;     // 1 to threats_max()
  Hash128 map_hash;  // of the map with them
  BlobRef table;     // decode_map_threats()

  bool operator==(const ThreatLayers&) const = default;
};

/// Channel MAP_INDEX: which map is on the bus, and the blobs that hold it. Messages of the first
/// form of this type, which knew no named observers, are read too.
struct MapIndex {
  Hash128 map_hash;               // named observers left out
  std::int64_t patch_number = 0;  // newest patch that counts, in map_hash too; 0 is the base map
  raster::GridGeometry geometry;
  int tile_cells = 0;  // side of a tile, 16 to 1024
  double reference_height_m = 0.0;
  std::vector<double> further_heights_m;  // of the exposure volume, ascending; at most 12
  BlobRef tile_table;                     // decode_map_tile_table()
  BlobRef features;                       // decode_map_features()
  std::optional<ThreatLayers> threats;    // none: the map has no named observers
  std::string label;                      // at most 120 bytes

  /// The map that a request belongs to. One that weighs named observers is for the map with them;
  /// where there are none for the map as it is, so that its planner says what is missing.
  [[nodiscard]] Hash128 hash_for(bool weighs_threats) const {
    return weighs_threats && threats ? threats->map_hash : map_hash;
  }
  /// Whether a hash is that of this map, with its named observers or without.
  [[nodiscard]] bool offers(const Hash128& hash) const {
    return hash == map_hash || (threats && hash == threats->map_hash);
  }
  bool operator==(const MapIndex&) const = default;
};
Bytes to_message(const MapIndex& index, const Stamp& stamp);
template <>
MapIndex from_message<MapIndex>(ByteView bytes, Stamp& stamp);

/// Channel MAP_PATCH: a thing that appears over the base map, or goes. Messages of the first form
/// of this type are read too.
struct MapPatch {
  Hash128 base_map_hash;
  std::int64_t patch_number = 0;  // given by map_tiler, from 1; 0: not yet
  bool is_present = true;
  map::Patch patch;  // its id alone counts when it has gone
};
Bytes to_message(const MapPatch& patch, const Stamp& stamp);
template <>
MapPatch from_message<MapPatch>(ByteView bytes, Stamp& stamp);

/// Channel MAP_PATCH_STATE: which patches count, and the map that comes of them.
struct MapPatchState {
  Hash128 base_map_hash;
  Hash128 map_hash;
  std::int64_t patch_number = 0;
  std::int32_t patch_count = 0;
  // Of the newest patch that was refused
  std::int64_t refused_sender_id = 0;
  std::int64_t refused_patch_id = 0;
  std::string refusal;  // at most 700 bytes

  bool operator==(const MapPatchState&) const = default;
};
Bytes to_message(const MapPatchState& state, const Stamp& stamp);
template <>
MapPatchState from_message<MapPatchState>(ByteView bytes, Stamp& stamp);

}  // namespace hedgehop::messages
