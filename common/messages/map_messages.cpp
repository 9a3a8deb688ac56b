#include "messages/map_messages.hpp"

#include <limits>

#include "messages/map_tiles.hpp"
#include "messages/wire.hpp"

#include "hedgehop/map_index_t.hpp"
#include "hedgehop/map_patch_t.hpp"

namespace hedgehop::messages {
namespace {

constexpr std::size_t kIndexLabelBytesMax = 120;
constexpr std::size_t kPatchLabelBytesMax = 60;
/// No map frame reaches further [m].
constexpr double kCoordinateMax_m = 1e9;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

static_assert(kMaxMapSideCells == map_index_t::MAX_SIDE_CELLS);
static_assert(static_cast<int>(MapLayer::kTerrain) == map_index_t::LAYERS_TERRAIN);
static_assert(static_cast<int>(MapLayer::kSurface) == map_index_t::LAYERS_SURFACE);
static_assert(static_cast<int>(MapLayer::kSemantics) == map_index_t::LAYERS_SEMANTICS);
static_assert(static_cast<int>(MapLayer::kVisibility) == map_index_t::LAYERS_VISIBILITY);
static_assert(static_cast<int>(MapLayer::kFurtherVisibility) ==
              map_index_t::LAYERS_FURTHER_VISIBILITY);
static_assert(static_cast<int>(kMapLayers.size()) + kMaxFurtherHeights == map_index_t::MAX_LAYERS);

double coordinate(const wire::Check& check, std::string_view field, double value) {
  return check.within(field, value, -kCoordinateMax_m, kCoordinateMax_m);
}

}  // namespace

std::int64_t raster_bytes(const raster::GridGeometry& geometry, std::size_t further_heights) {
  return static_cast<std::int64_t>(geometry.columns) * geometry.rows *
         (12 + 2 * static_cast<std::int64_t>(further_heights));
}

Bytes to_message(const MapIndex& index, const Stamp& stamp) {
  map_index_t message{};
  wire::put_stamp(message, stamp);
  wire::put(message.map_hash, index.map_hash);
  message.patch_number = index.patch_number;
  message.west_m = index.geometry.west_m;
  message.south_m = index.geometry.south_m;
  message.cell_m = index.geometry.cell_m;
  message.column_count = index.geometry.columns;
  message.row_count = index.geometry.rows;
  message.tile_cell_count = index.tile_cells;
  message.reference_height_m = index.reference_height_m;
  for (const MapLayer layer : kMapLayers) {
    message.layers.push_back(static_cast<std::uint8_t>(layer));
    message.layer_height_m.push_back(layer == MapLayer::kVisibility ? index.reference_height_m
                                                                    : kNaN);
  }
  for (const double height_m : index.further_heights_m) {
    message.layers.push_back(static_cast<std::uint8_t>(MapLayer::kFurtherVisibility));
    message.layer_height_m.push_back(height_m);
  }
  message.num_layers = static_cast<std::int32_t>(message.layers.size());
  wire::put_ref(message.tile_table, index.tile_table);
  wire::put_ref(message.features, index.features);
  message.label = wire::cut_text(index.label, kIndexLabelBytesMax);
  return wire::published<MapIndex>(message);
}

template <>
MapIndex from_message<MapIndex>(ByteView bytes, Stamp& stamp) {
  const auto message = wire::decoded<map_index_t>(bytes, stamp);
  const wire::Check check(map_index_t::getTypeName());
  MapIndex index;
  index.map_hash = wire::hash_in(message.map_hash);
  index.patch_number = check.count("patch_number", message.patch_number);
  raster::GridGeometry& geometry = index.geometry;
  geometry.west_m = coordinate(check, "west_m", message.west_m);
  geometry.south_m = coordinate(check, "south_m", message.south_m);
  check.positive("cell_m", message.cell_m);
  geometry.cell_m = check.within("cell_m", message.cell_m, 1e-3, 1e6);
  geometry.columns = check.within("column_count", message.column_count, 1, kMaxMapSideCells);
  geometry.rows = check.within("row_count", message.row_count, 1, kMaxMapSideCells);
  index.tile_cells = check.within("tile_cell_count", message.tile_cell_count, 16, 1024);
  index.reference_height_m = check.not_negative("reference_height_m", message.reference_height_m);
  const auto layer_count = static_cast<std::int32_t>(kMapLayers.size());
  check.within("num_layers", message.num_layers, layer_count, layer_count + kMaxFurtherHeights);
  for (std::size_t i = 0; i < message.layers.size(); ++i) {
    const auto layer = static_cast<std::uint8_t>(
        i < kMapLayers.size() ? kMapLayers[i] : MapLayer::kFurtherVisibility);
    check.within("layers", message.layers[i], layer, layer);
    if (layer == static_cast<std::uint8_t>(MapLayer::kFurtherVisibility)) {
      const double height_m = check.positive("layer_height_m", message.layer_height_m[i]);
      if (!index.further_heights_m.empty() && height_m <= index.further_heights_m.back()) {
        check.refuse("layer_height_m", height_m, "ascend");
      }
      index.further_heights_m.push_back(height_m);
    }
  }
  if (raster_bytes(geometry, index.further_heights_m.size()) > kMaxMapBytes) {
    check.refuse("row_count", geometry.rows,
                 "give layers of at most " + std::to_string(kMaxMapBytes) +
                     " bytes with column_count and num_layers");
  }
  index.tile_table = wire::ref_in(check, "tile_table", message.tile_table);
  index.features = wire::ref_in(check, "features", message.features);
  index.label = check.text("label", message.label, kIndexLabelBytesMax);
  return index;
}

Bytes to_message(const MapPatch& patch, const Stamp& stamp) {
  map_patch_t message{};
  wire::put_stamp(message, stamp);
  wire::put(message.map_hash, patch.map_hash);
  message.patch_number = patch.patch_number;
  message.patch_id = patch.patch_id;
  message.kind = static_cast<std::int8_t>(patch.kind);
  message.is_present = patch.is_present ? 1 : 0;
  message.x_m = patch.centre.x_m;
  message.y_m = patch.centre.y_m;
  message.radius_m = patch.radius_m;
  message.top_altitude_m = wire::value_or_nan(patch.top_altitude_m);
  message.num_vertices = static_cast<std::int32_t>(patch.outline.size());
  for (const geo::MapPoint& vertex : patch.outline) {
    message.vertex_x_m.push_back(vertex.x_m);
    message.vertex_y_m.push_back(vertex.y_m);
  }
  message.label = wire::cut_text(patch.label, kPatchLabelBytesMax);
  return wire::published<MapPatch>(message);
}

template <>
MapPatch from_message<MapPatch>(ByteView bytes, Stamp& stamp) {
  const auto message = wire::decoded<map_patch_t>(bytes, stamp);
  const wire::Check check(map_patch_t::getTypeName());
  MapPatch patch;
  patch.map_hash = wire::hash_in(message.map_hash);
  patch.patch_number = check.count("patch_number", message.patch_number);
  patch.patch_id = message.patch_id;
  patch.kind = static_cast<PatchKind>(check.within<std::int8_t>(
      "kind", message.kind, map_patch_t::KIND_OBSTACLE, map_patch_t::KIND_AREA));
  patch.is_present = check.boolean("is_present", message.is_present);
  patch.centre.x_m = coordinate(check, "x_m", message.x_m);
  patch.centre.y_m = coordinate(check, "y_m", message.y_m);
  patch.radius_m = check.not_negative("radius_m", message.radius_m);
  patch.top_altitude_m = check.optional(
      message.top_altitude_m, [&](double value) { return check.finite("top_altitude_m", value); });
  const int vertices_min = patch.kind == PatchKind::kArea ? 3 : 0;
  const int vertices_max = patch.kind == PatchKind::kArea ? map_patch_t::MAX_VERTICES : 0;
  check.within("num_vertices", message.num_vertices, vertices_min, vertices_max);
  for (std::size_t i = 0; i < message.vertex_x_m.size(); ++i) {
    patch.outline.push_back({coordinate(check, "vertex_x_m", message.vertex_x_m[i]),
                             coordinate(check, "vertex_y_m", message.vertex_y_m[i])});
  }
  patch.label = check.text("label", message.label, kPatchLabelBytesMax);
  return patch;
}

}  // namespace hedgehop::messages
