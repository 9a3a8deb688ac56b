#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "geo/map_projection.hpp"
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
  std::int64_t patch_number = 0;  // newest patch that counts; 0 is the base map
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

enum class PatchKind : std::int8_t { kObstacle = 0, kThreat = 1, kArea = 2 };

/// Channel MAP_PATCH: an obstacle, threat or area that appears over the base map, or goes.
struct MapPatch {
  Hash128 map_hash;
  std::int64_t patch_number = 0;  // given by map_tiler, from 1; 0: not yet
  std::int64_t patch_id = 0;      // chosen by the sender
  PatchKind kind = PatchKind::kObstacle;
  bool is_present = true;
  geo::MapPoint centre;
  double radius_m = 0.0;                 // 0 for an area
  std::optional<double> top_altitude_m;  // none: unlimited
  std::vector<geo::MapPoint> outline;    // of an area: 3 to 64 vertices; else empty
  std::string label;                     // at most 60 bytes
};
Bytes to_message(const MapPatch& patch, const Stamp& stamp);
template <>
MapPatch from_message<MapPatch>(ByteView bytes, Stamp& stamp);

}  // namespace hedgehop::messages
