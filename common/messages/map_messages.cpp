#include "messages/map_messages.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "messages/map_tiles.hpp"
#include "messages/wire.hpp"

#include "hedgehop/map_index_t.hpp"
#include "hedgehop/map_index_v2_t.hpp"
#include "hedgehop/map_patch_state_t.hpp"
#include "hedgehop/map_patch_t.hpp"
#include "hedgehop/map_patch_v2_t.hpp"
#include "hedgehop/map_threats_t.hpp"

namespace hedgehop::messages {
namespace {

constexpr std::size_t kIndexLabelBytesMax = 120;
constexpr std::size_t kPatchLabelBytesMax = 60;
constexpr std::size_t kRefusalBytesMax = 700;
/// No map frame reaches further [m].
constexpr double kCoordinateMax_m = 1e9;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

static_assert(static_cast<int>(map::PatchKind::kObstacle) == map_patch_v2_t::KIND_OBSTACLE);
static_assert(static_cast<int>(map::PatchKind::kThreat) == map_patch_v2_t::KIND_THREAT);
static_assert(static_cast<int>(map::PatchKind::kArea) == map_patch_v2_t::KIND_AREA);
static_assert(kMaxMapSideCells == map_index_v2_t::MAX_SIDE_CELLS);
static_assert(static_cast<int>(MapLayer::kTerrain) == map_index_v2_t::LAYERS_TERRAIN);
static_assert(static_cast<int>(MapLayer::kSurface) == map_index_v2_t::LAYERS_SURFACE);
static_assert(static_cast<int>(MapLayer::kSemantics) == map_index_v2_t::LAYERS_SEMANTICS);
static_assert(static_cast<int>(MapLayer::kVisibility) == map_index_v2_t::LAYERS_VISIBILITY);
static_assert(static_cast<int>(MapLayer::kFurtherVisibility) ==
              map_index_v2_t::LAYERS_FURTHER_VISIBILITY);
static_assert(static_cast<int>(kMapLayers.size()) + kMaxFurtherHeights ==
              map_index_v2_t::MAX_LAYERS);
static_assert(kMaxThreats == map_index_v2_t::MAX_THREAT_COUNT);

double coordinate(const wire::Check& check, std::string_view field, double value) {
  return check.within(field, value, -kCoordinateMax_m, kCoordinateMax_m);
}

}  // namespace

std::int64_t raster_bytes(const raster::GridGeometry& geometry, std::size_t further_heights) {
  return static_cast<std::int64_t>(geometry.columns) * geometry.rows *
         (12 + 2 * static_cast<std::int64_t>(further_heights));
}

int threats_max(const raster::GridGeometry& geometry, int tile_cells) {
  const auto cells = static_cast<std::int64_t>(geometry.columns) * geometry.rows;
  const Tiling tiling{geometry.columns, geometry.rows, tile_cells};
  return std::min({kMaxThreats, static_cast<int>(kMaxMapBytes / (4 * cells)),
                   map_threats_t::MAX_TILES / tiling.tile_count()});
}

Bytes to_message(const MapIndex& index, const Stamp& stamp) {
  map_index_v2_t message{};
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
  if (index.threats) {
    message.threat_count = index.threats->count;
    wire::put(message.threats_map_hash, index.threats->map_hash);
    wire::put_ref(message.threats, index.threats->table);
  }
  message.label = wire::cut_text(index.label, kIndexLabelBytesMax);
  return wire::published<MapIndex>(message);
}

namespace {

// What both forms say.
template <typename Wire>
MapIndex index_of(const wire::Check& check, const Wire& message) {
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

}  // namespace

template <>
MapIndex from_message<MapIndex>(ByteView bytes, Stamp& stamp) {
  if (wire::is_of_type<map_index_t>(bytes)) {
    const wire::Check check(map_index_t::getTypeName());
    return index_of(check, wire::decoded<map_index_t>(bytes, stamp));
  }
  const auto message = wire::decoded<map_index_v2_t>(bytes, stamp);
  const wire::Check check(map_index_v2_t::getTypeName());
  MapIndex index = index_of(check, message);
  const int threats = check.within("threat_count", message.threat_count, 0,
                                   threats_max(index.geometry, index.tile_cells));
  if (threats > 0) {
    index.threats = ThreatLayers{threats, wire::hash_in(message.threats_map_hash),
                                 wire::ref_in(check, "threats", message.threats)};
    if (index.threats->map_hash == index.map_hash) {
      check.refuse("threats_map_hash", index.map_hash.hex(), "differ from map_hash");
    }
  }
  return index;
}

Bytes to_message(const MapPatch& patch, const Stamp& stamp) {
  const map::Patch& thing = patch.patch;
  const bool is_area = thing.kind == map::PatchKind::kArea;
  map_patch_v2_t message{};
  wire::put_stamp(message, stamp);
  wire::put(message.base_map_hash, patch.base_map_hash);
  message.patch_number = patch.patch_number;
  message.patch_id = thing.id;
  message.kind = static_cast<std::int8_t>(thing.kind);
  message.is_present = patch.is_present ? 1 : 0;
  message.x_m = thing.centre.x_m;
  message.y_m = thing.centre.y_m;
  message.radius_m = thing.radius_m;
  message.height_m = wire::value_or_nan(thing.height_m);
  message.top_altitude_m = wire::value_or_nan(thing.top_m);
  message.is_hard = thing.is_hard ? 1 : 0;
  message.floor_m = thing.floor.value_m;
  message.floor_is_above_ground =
      thing.floor.reference == map::AreaLimit::Reference::kAboveGround ? 1 : 0;
  message.ceiling_m = thing.ceiling.value_m;
  message.ceiling_is_above_ground =
      thing.ceiling.reference == map::AreaLimit::Reference::kAboveGround ? 1 : 0;
  message.num_vertices = is_area ? static_cast<std::int32_t>(thing.outline.size()) : 0;
  for (std::int32_t i = 0; i < message.num_vertices; ++i) {
    const geo::MapPoint& corner = thing.outline[static_cast<std::size_t>(i)];
    message.vertex_x_m.push_back(corner.x_m);
    message.vertex_y_m.push_back(corner.y_m);
  }
  message.label = wire::cut_text(thing.label, kPatchLabelBytesMax);
  return wire::published<MapPatch>(message);
}

namespace {

template <typename Wire>
void put_outline(const wire::Check& check, const Wire& message, map::Patch& patch) {
  const bool is_area = patch.kind == map::PatchKind::kArea;
  check.within("num_vertices", message.num_vertices, is_area ? 3 : 0,
               is_area ? Wire::MAX_VERTICES : 0);
  for (std::size_t i = 0; i < message.vertex_x_m.size(); ++i) {
    patch.outline.push_back({coordinate(check, "vertex_x_m", message.vertex_x_m[i]),
                             coordinate(check, "vertex_y_m", message.vertex_y_m[i])});
  }
}

// The first form has no floor, and neither soft areas nor heights above ground.
MapPatch patch_of_first_form(const map_patch_t& message) {
  const wire::Check check(map_patch_t::getTypeName());
  MapPatch patch;
  map::Patch& thing = patch.patch;
  patch.base_map_hash = wire::hash_in(message.map_hash);
  patch.patch_number = check.count("patch_number", message.patch_number);
  thing.id = message.patch_id;
  thing.kind = static_cast<map::PatchKind>(check.within<std::int8_t>(
      "kind", message.kind, map_patch_t::KIND_OBSTACLE, map_patch_t::KIND_AREA));
  patch.is_present = check.boolean("is_present", message.is_present);
  thing.centre.x_m = coordinate(check, "x_m", message.x_m);
  thing.centre.y_m = coordinate(check, "y_m", message.y_m);
  thing.radius_m = check.not_negative("radius_m", message.radius_m);
  thing.top_m = check.optional(message.top_altitude_m,
                               [&](double value) { return check.finite("top_altitude_m", value); });
  thing.floor = {-std::numeric_limits<double>::infinity(), map::AreaLimit::Reference::kAboveGround};
  thing.ceiling.value_m = thing.top_m.value_or(std::numeric_limits<double>::infinity());
  put_outline(check, message, thing);
  thing.label = check.text("label", message.label, kPatchLabelBytesMax);
  return patch;
}

bool is_first_form(ByteView bytes) {
  std::uint64_t fingerprint = 0;
  for (std::size_t i = 0; i < 8 && i < bytes.size(); ++i) {
    fingerprint = (fingerprint << 8) | std::to_integer<std::uint64_t>(bytes[i]);
  }
  return static_cast<std::int64_t>(fingerprint) == map_patch_t::getHash();
}

map::AreaLimit area_limit(const wire::Check& check, const std::string& name, double value_m,
                          std::int8_t is_above_ground) {
  constexpr double kAltitudeMax_m = 1e6;
  if (!std::isinf(value_m)) {
    check.within(name + "_m", value_m, -kAltitudeMax_m, kAltitudeMax_m);  // refuses NaN
  }
  return {value_m, check.boolean(name + "_is_above_ground", is_above_ground)
                       ? map::AreaLimit::Reference::kAboveGround
                       : map::AreaLimit::Reference::kAmsl};
}

}  // namespace

template <>
MapPatch from_message<MapPatch>(ByteView bytes, Stamp& stamp) {
  if (is_first_form(bytes)) {
    return patch_of_first_form(wire::decoded<map_patch_t>(bytes, stamp));
  }
  constexpr double kRadiusMax_m = 200'000.0;
  constexpr double kHeightMax_m = 20'000.0;
  const auto message = wire::decoded<map_patch_v2_t>(bytes, stamp);
  const wire::Check check(map_patch_v2_t::getTypeName());
  MapPatch patch;
  map::Patch& thing = patch.patch;
  patch.base_map_hash = wire::hash_in(message.base_map_hash);
  patch.patch_number = check.count("patch_number", message.patch_number);
  thing.id = check.within<std::int64_t>("patch_id", message.patch_id, 1,
                                        std::numeric_limits<std::int64_t>::max());
  thing.kind = static_cast<map::PatchKind>(check.within<std::int8_t>(
      "kind", message.kind, map_patch_v2_t::KIND_OBSTACLE, map_patch_v2_t::KIND_AREA));
  patch.is_present = check.boolean("is_present", message.is_present);
  thing.centre.x_m = coordinate(check, "x_m", message.x_m);
  thing.centre.y_m = coordinate(check, "y_m", message.y_m);
  thing.radius_m = check.within("radius_m", message.radius_m, 0.0, kRadiusMax_m);
  thing.height_m = check.optional(message.height_m, [&](double value) {
    return check.within("height_m", value, 0.0, kHeightMax_m);
  });
  thing.top_m = check.optional(message.top_altitude_m, [&](double value) {
    return check.within("top_altitude_m", value, -kHeightMax_m, kHeightMax_m);
  });
  thing.is_hard = check.boolean("is_hard", message.is_hard);
  thing.floor = area_limit(check, "floor", message.floor_m, message.floor_is_above_ground);
  thing.ceiling = area_limit(check, "ceiling", message.ceiling_m, message.ceiling_is_above_ground);
  thing.label = check.text("label", message.label, kPatchLabelBytesMax);
  if (patch.is_present) {
    put_outline(check, message, thing);
    if (thing.kind != map::PatchKind::kArea && !thing.height_m && !thing.top_m) {
      check.refuse("neither height_m nor top_altitude_m is stated");
    }
    if (thing.kind == map::PatchKind::kThreat && !(thing.radius_m > 0.0)) {
      check.refuse("radius_m", thing.radius_m, "be above 0 for an observer");
    }
  } else {
    check.within("num_vertices", message.num_vertices, 0, 0);
  }
  return patch;
}

Bytes to_message(const MapPatchState& state, const Stamp& stamp) {
  map_patch_state_t message{};
  wire::put_stamp(message, stamp);
  wire::put(message.base_map_hash, state.base_map_hash);
  wire::put(message.map_hash, state.map_hash);
  message.patch_number = state.patch_number;
  message.patch_count = state.patch_count;
  message.refused_sender_id = state.refused_sender_id;
  message.refused_patch_id = state.refused_patch_id;
  message.refusal = wire::cut_text(state.refusal, kRefusalBytesMax);
  return wire::published<MapPatchState>(message);
}

template <>
MapPatchState from_message<MapPatchState>(ByteView bytes, Stamp& stamp) {
  const auto message = wire::decoded<map_patch_state_t>(bytes, stamp);
  const wire::Check check(map_patch_state_t::getTypeName());
  MapPatchState state;
  state.base_map_hash = wire::hash_in(message.base_map_hash);
  state.map_hash = wire::hash_in(message.map_hash);
  state.patch_number = check.count("patch_number", message.patch_number);
  state.patch_count =
      check.within("patch_count", message.patch_count, 0, std::numeric_limits<std::int32_t>::max());
  state.refused_sender_id = message.refused_sender_id;
  state.refused_patch_id = message.refused_patch_id;
  state.refusal = check.text("refusal", message.refusal, kRefusalBytesMax);
  return state;
}

}  // namespace hedgehop::messages
