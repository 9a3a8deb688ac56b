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

/// Channel MAP_INDEX: which map is on the bus, and the blobs that hold it.
struct MapIndex {
  Hash128 map_hash;
  std::int64_t patch_number = 0;  // newest patch that counts, in map_hash too; 0 is the base map
  raster::GridGeometry geometry;
  int tile_cells = 0;  // side of a tile, 16 to 1024
  double reference_height_m = 0.0;
  std::vector<double> further_heights_m;  // of the exposure volume, ascending; at most 12
  BlobRef tile_table;                     // decode_map_tile_table()
  BlobRef features;                       // decode_map_features()
  std::string label;                      // at most 120 bytes

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
