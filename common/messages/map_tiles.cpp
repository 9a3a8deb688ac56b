#include "messages/map_tiles.hpp"

#include <bit>
#include <cmath>
#include <cstring>

#include "base/errors.hpp"
#include "messages/wire.hpp"

#include "hedgehop/map_features_t.hpp"
#include "hedgehop/map_threats_t.hpp"
#include "hedgehop/map_tile_t.hpp"
#include "hedgehop/map_tile_table_t.hpp"

namespace hedgehop::messages {
namespace {

constexpr std::size_t kBlobBytesMax = static_cast<std::size_t>(kMaxContentBytes);
constexpr std::size_t kTileBytesMax = static_cast<std::size_t>(map_tile_t::MAX_PLANE_BYTES) + 64;
constexpr std::size_t kWktBytesMax = 1U << 16;
constexpr std::size_t kLineBytesMax = 4096;

static_assert(static_cast<int>(MapLayer::kThreat) == map_tile_t::LAYER_THREAT);
static_assert(static_cast<int>(MapLayer::kFurtherVisibility) + kMaxFurtherHeights <=
              static_cast<int>(MapLayer::kThreat));
static_assert(kMaxThreats == map_threats_t::MAX_THREATS);

/// The cells of one tile.
struct Window {
  int column = 0;
  int row = 0;
  int columns = 0;
  int rows = 0;
};

Window window_of(const Tiling& tiling, const TileAddress& address) {
  Window window;
  window.column = address.tile_column * tiling.tile_cells;
  window.row = address.tile_row * tiling.tile_cells;
  window.columns = std::min(tiling.tile_cells, tiling.columns - window.column);
  window.rows = std::min(tiling.tile_cells, tiling.rows - window.row);
  return window;
}

template <typename T>
using Bits = std::conditional_t<sizeof(T) == 4, std::uint32_t, std::uint16_t>;

template <typename T>
void put_planes(const raster::Grid<T>& grid, const Window& window,
                std::vector<std::uint8_t>& planes) {
  using U = Bits<T>;
  const std::size_t cells = static_cast<std::size_t>(window.columns) * window.rows;
  planes.resize(cells * sizeof(T));
  std::size_t cell = 0;
  U south = 0;
  for (int r = 0; r < window.rows; ++r) {
    const T* row = grid.row(window.row + r) + window.column;
    U before = south;
    south = std::bit_cast<U>(row[0]);
    for (int c = 0; c < window.columns; ++c, ++cell) {
      const U value = std::bit_cast<U>(row[c]);
      const U difference = static_cast<U>(value - before);
      before = value;
      for (std::size_t b = 0; b < sizeof(T); ++b) {
        planes[b * cells + cell] = static_cast<std::uint8_t>(difference >> (8 * b));
      }
    }
  }
}

template <typename T>
void take_planes(const std::vector<std::uint8_t>& planes, const Window& window,
                 raster::Grid<T>& grid) {
  using U = Bits<T>;
  const std::size_t cells = static_cast<std::size_t>(window.columns) * window.rows;
  std::size_t cell = 0;
  U south = 0;
  for (int r = 0; r < window.rows; ++r) {
    T* row = grid.row(window.row + r) + window.column;
    U before = south;
    for (int c = 0; c < window.columns; ++c, ++cell) {
      U value = before;
      for (std::size_t b = 0; b < sizeof(T); ++b) {
        value = static_cast<U>(value + (static_cast<U>(planes[b * cells + cell]) << (8 * b)));
      }
      before = value;
      if (c == 0) {
        south = value;
      }
      row[c] = std::bit_cast<T>(value);
    }
  }
}

// Place in the exposure volume; negative for the layers that every map has.
int further_height_of(MapLayer layer) {
  return static_cast<int>(layer) - static_cast<int>(MapLayer::kFurtherVisibility);
}

// Place among the named observers; negative for the other layers.
int threat_of(MapLayer layer) {
  return static_cast<int>(layer) - static_cast<int>(MapLayer::kThreat);
}

template <typename MapType, typename Use>
void with_layer(MapType& map, MapLayer layer, const Use& use) {
  switch (layer) {
    case MapLayer::kTerrain:
      return use(map.terrain_m);
    case MapLayer::kSurface:
      return use(map.surface_m);
    case MapLayer::kSemantics:
      return use(map.semantics);
    case MapLayer::kVisibility:
      return use(map.visibility);
    case MapLayer::kFurtherVisibility:
    case MapLayer::kThreat:
      break;
  }
  if (threat_of(layer) >= 0) {
    return use(map.threats.at(static_cast<std::size_t>(threat_of(layer))).height_m);
  }
  const auto further = static_cast<std::size_t>(further_height_of(layer));
  HEDGEHOP_ASSERT(further < map.further_visibility.size());
  use(map.further_visibility[further].share);
}

std::int32_t count_of(std::size_t size) { return static_cast<std::int32_t>(size); }

void put_overhead_lines(const std::vector<map::OverheadLine>& lines, map_features_t& message) {
  message.num_overhead_lines = count_of(lines.size());
  for (const map::OverheadLine& line : lines) {
    message.overhead_line_source_id.push_back(line.source_id);
    message.overhead_line_kind.push_back(static_cast<std::int8_t>(line.kind));
    message.overhead_line_support_count.push_back(count_of(line.supports.size()));
    for (const map::OverheadLine::Support& support : line.supports) {
      message.support_x_m.push_back(support.point.x_m);
      message.support_y_m.push_back(support.point.y_m);
      message.support_height_m.push_back(support.height_m);
      message.support_is_pole.push_back(support.is_pole ? 1 : 0);
    }
  }
  message.num_supports = count_of(message.support_x_m.size());
}

std::vector<map::OverheadLine> overhead_lines_in(const wire::Check& check,
                                                 const map_features_t& message) {
  static_assert(map_features_t::OVERHEAD_LINE_KIND_AERIALWAY ==
                static_cast<std::int8_t>(map::LineKind::kAerialway));
  std::vector<map::OverheadLine> lines;
  std::size_t next = 0;
  for (std::size_t i = 0; i < message.overhead_line_source_id.size(); ++i) {
    map::OverheadLine& line = lines.emplace_back();
    line.source_id = message.overhead_line_source_id[i];
    line.kind = static_cast<map::LineKind>(
        check.within<std::int8_t>("overhead_line_kind", message.overhead_line_kind[i], 0,
                                  map_features_t::OVERHEAD_LINE_KIND_AERIALWAY));
    const auto end =
        next + static_cast<std::size_t>(check.within<std::int64_t>(
                   "overhead_line_support_count", message.overhead_line_support_count[i], 2,
                   message.num_supports - static_cast<std::int64_t>(next)));
    for (; next < end; ++next) {
      line.supports.push_back(
          {{check.finite("support_x_m", message.support_x_m[next]),
            check.finite("support_y_m", message.support_y_m[next])},
           check.not_negative("support_height_m", message.support_height_m[next]),
           check.boolean("support_is_pole", message.support_is_pole[next])});
    }
  }
  check.within<std::int64_t>("num_supports", message.num_supports, static_cast<std::int64_t>(next),
                             static_cast<std::int64_t>(next));
  return lines;
}

void put_obstacles(const std::vector<map::Obstacle>& obstacles, map_features_t& message) {
  message.num_obstacles = count_of(obstacles.size());
  for (const map::Obstacle& obstacle : obstacles) {
    message.obstacle_source_id.push_back(obstacle.source_id);
    message.obstacle_kind.push_back(static_cast<std::int8_t>(obstacle.kind));
    message.obstacle_name.push_back(obstacle.name);
    message.obstacle_x_m.push_back(obstacle.point.x_m);
    message.obstacle_y_m.push_back(obstacle.point.y_m);
    message.obstacle_radius_m.push_back(obstacle.radius_m);
    message.obstacle_height_m.push_back(obstacle.height_m);
    message.obstacle_top_m.push_back(obstacle.top_m);
  }
}

std::vector<map::Obstacle> obstacles_in(const wire::Check& check, const map_features_t& message) {
  static_assert(map_features_t::OBSTACLE_KIND_OTHER ==
                static_cast<std::int8_t>(map::ObstacleKind::kOther));
  std::vector<map::Obstacle> obstacles;
  for (std::size_t i = 0; i < message.obstacle_source_id.size(); ++i) {
    map::Obstacle& obstacle = obstacles.emplace_back();
    obstacle.source_id = message.obstacle_source_id[i];
    obstacle.kind = static_cast<map::ObstacleKind>(check.within<std::int8_t>(
        "obstacle_kind", message.obstacle_kind[i], 0, map_features_t::OBSTACLE_KIND_OTHER));
    obstacle.name = check.text("obstacle_name", message.obstacle_name[i], kLineBytesMax);
    obstacle.point = {check.finite("obstacle_x_m", message.obstacle_x_m[i]),
                      check.finite("obstacle_y_m", message.obstacle_y_m[i])};
    obstacle.radius_m = check.not_negative("obstacle_radius_m", message.obstacle_radius_m[i]);
    obstacle.height_m = check.not_negative("obstacle_height_m", message.obstacle_height_m[i]);
    obstacle.top_m = check.finite_or_nan("obstacle_top_m", message.obstacle_top_m[i]);
  }
  return obstacles;
}

void put_areas(const std::vector<map::Area>& areas, map_features_t& message) {
  message.num_areas = count_of(areas.size());
  const auto is_above_ground = [](const map::AreaLimit& limit) -> std::int8_t {
    return limit.reference == map::AreaLimit::Reference::kAboveGround ? 1 : 0;
  };
  const auto put_ring = [&](const std::vector<geo::MapPoint>& ring, bool is_hole) {
    message.ring_is_hole.push_back(is_hole ? 1 : 0);
    message.ring_corner_count.push_back(count_of(ring.size()));
    for (const geo::MapPoint& corner : ring) {
      message.corner_x_m.push_back(corner.x_m);
      message.corner_y_m.push_back(corner.y_m);
    }
  };
  for (const map::Area& area : areas) {
    message.area_name.push_back(area.name);
    message.area_kind.push_back(area.kind);
    message.area_is_hard.push_back(area.is_hard ? 1 : 0);
    message.area_floor_m.push_back(area.floor.value_m);
    message.area_floor_is_above_ground.push_back(is_above_ground(area.floor));
    message.area_ceiling_m.push_back(area.ceiling.value_m);
    message.area_ceiling_is_above_ground.push_back(is_above_ground(area.ceiling));
    const std::size_t rings_before = message.ring_is_hole.size();
    for (const map::Area::Polygon& polygon : area.polygons) {
      put_ring(polygon.outer, false);
      for (const auto& hole : polygon.holes) {
        put_ring(hole, true);
      }
    }
    message.area_ring_count.push_back(count_of(message.ring_is_hole.size() - rings_before));
  }
  message.num_rings = count_of(message.ring_is_hole.size());
  message.num_corners = count_of(message.corner_x_m.size());
}

std::vector<map::Area> areas_in(const wire::Check& check, const map_features_t& message) {
  const auto limit = [&](const char* field, double value_m, std::int8_t is_above_ground) {
    if (std::isnan(value_m)) {
      check.refuse(field, value_m, "be a number");
    }
    return map::AreaLimit{value_m, check.boolean(field, is_above_ground)
                                       ? map::AreaLimit::Reference::kAboveGround
                                       : map::AreaLimit::Reference::kAmsl};
  };
  std::vector<map::Area> areas;
  std::size_t next_ring = 0;
  std::size_t next_corner = 0;
  for (std::size_t i = 0; i < message.area_name.size(); ++i) {
    map::Area& area = areas.emplace_back();
    area.name = check.text("area_name", message.area_name[i], kLineBytesMax);
    area.kind = check.text("area_kind", message.area_kind[i], kLineBytesMax);
    area.is_hard = check.boolean("area_is_hard", message.area_is_hard[i]);
    area.floor =
        limit("area_floor_m", message.area_floor_m[i], message.area_floor_is_above_ground[i]);
    area.ceiling =
        limit("area_ceiling_m", message.area_ceiling_m[i], message.area_ceiling_is_above_ground[i]);
    const auto rings_end =
        next_ring + static_cast<std::size_t>(check.within<std::int64_t>(
                        "area_ring_count", message.area_ring_count[i], 1,
                        message.num_rings - static_cast<std::int64_t>(next_ring)));
    for (; next_ring < rings_end; ++next_ring) {
      const bool is_hole = check.boolean("ring_is_hole", message.ring_is_hole[next_ring]);
      if (is_hole && area.polygons.empty()) {
        check.refuse("an area begins with a hole");
      }
      auto& ring =
          is_hole ? area.polygons.back().holes.emplace_back() : area.polygons.emplace_back().outer;
      const auto corners_end =
          next_corner + static_cast<std::size_t>(check.within<std::int64_t>(
                            "ring_corner_count", message.ring_corner_count[next_ring], 4,
                            message.num_corners - static_cast<std::int64_t>(next_corner)));
      for (; next_corner < corners_end; ++next_corner) {
        ring.push_back({check.finite("corner_x_m", message.corner_x_m[next_corner]),
                        check.finite("corner_y_m", message.corner_y_m[next_corner])});
      }
    }
  }
  const auto must_be = [&](const char* field, std::int64_t value, std::size_t wanted) {
    check.within<std::int64_t>(field, value, static_cast<std::int64_t>(wanted),
                               static_cast<std::int64_t>(wanted));
  };
  must_be("num_rings", message.num_rings, next_ring);
  must_be("num_corners", message.num_corners, next_corner);
  return areas;
}

// The bytes, if their own decoder takes them.
template <typename Decode>
Bytes sendable(Bytes bytes, const Decode& decode) {
  try {
    decode(bytes);
  } catch (const MessageError& error) {
    throw std::invalid_argument(std::string("the map cannot be sent: ") + error.what());
  }
  return bytes;
}

void must_be(const wire::Check& check, const char* field, std::int32_t value, std::int64_t wanted) {
  if (value != wanted) {
    check.refuse(field, value, "be " + std::to_string(wanted));
  }
}

void check_map_hash(const wire::Check& check, const std::int64_t (&field)[2],
                    const Hash128& map_hash) {
  if (wire::hash_in(field) != map_hash) {
    check.refuse("map_hash", wire::hash_in(field).hex(), "be " + map_hash.hex());
  }
}

std::vector<BlobRef> tiles_in(const wire::Check& check, const std::vector<blob_ref_t>& refs) {
  std::vector<BlobRef> tiles;
  tiles.reserve(refs.size());
  for (const blob_ref_t& ref : refs) {
    tiles.push_back(wire::ref_in(check, "tiles", ref));
    check.within<std::int64_t>("tiles.content_bytes", tiles.back().content_bytes, 1,
                               static_cast<std::int64_t>(kTileBytesMax));
  }
  return tiles;
}

}  // namespace

std::string name_of(MapLayer layer) {
  switch (layer) {
    case MapLayer::kTerrain:
      return "terrain";
    case MapLayer::kSurface:
      return "surface";
    case MapLayer::kSemantics:
      return "semantics";
    case MapLayer::kVisibility:
      return "visibility";
    case MapLayer::kFurtherVisibility:
    case MapLayer::kThreat:
      break;
  }
  if (threat_of(layer) >= 0) {
    return "observer " + std::to_string(threat_of(layer) + 1);
  }
  return "visibility " + std::to_string(further_height_of(layer) + 2);
}

Tiling tiling_of(const MapIndex& index) {
  return {index.geometry.columns, index.geometry.rows, index.tile_cells,
          static_cast<int>(index.further_heights_m.size())};
}

Tiling tiling_of(const map::Map& map, int tile_cells) {
  return {map.geometry.columns, map.geometry.rows, tile_cells,
          static_cast<int>(map.further_visibility.size())};
}

std::string name_of(const TileAddress& address) {
  return "layer " + name_of(address.layer) + ", tile column " +
         std::to_string(address.tile_column) + ", tile row " + std::to_string(address.tile_row);
}

std::size_t tile_index(const Tiling& tiling, const TileAddress& address) {
  const auto layer = static_cast<std::size_t>(address.layer);
  return (layer * static_cast<std::size_t>(tiling.tile_rows()) +
          static_cast<std::size_t>(address.tile_row)) *
             static_cast<std::size_t>(tiling.tile_columns()) +
         static_cast<std::size_t>(address.tile_column);
}

TileAddress tile_address(const Tiling& tiling, std::size_t index) {
  const auto columns = static_cast<std::size_t>(tiling.tile_columns());
  const auto rows = static_cast<std::size_t>(tiling.tile_rows());
  TileAddress address;
  address.tile_column = static_cast<int>(index % columns);
  address.tile_row = static_cast<int>(index / columns % rows);
  const std::size_t layer = index / columns / rows;
  HEDGEHOP_ASSERT(layer < static_cast<std::size_t>(tiling.layer_count()));
  address.layer = static_cast<MapLayer>(layer);
  return address;
}

TileAddress threat_tile_address(const Tiling& tiling, std::size_t index) {
  const auto tiles = static_cast<std::size_t>(tiling.tile_count());
  TileAddress address = tile_address(tiling, index % tiles);
  address.layer =
      static_cast<MapLayer>(static_cast<std::size_t>(MapLayer::kThreat) + index / tiles);
  return address;
}

Bytes encode_map_tile(const map::Map& map, int tile_cells, const TileAddress& address) {
  const Window window = window_of(tiling_of(map, tile_cells), address);
  map_tile_t message{};
  message.version = map_tile_t::VERSION;
  message.layer = static_cast<std::int8_t>(address.layer);
  message.tile_column = address.tile_column;
  message.tile_row = address.tile_row;
  message.column_count = window.columns;
  message.row_count = window.rows;
  with_layer(map, address.layer, [&]<typename T>(const raster::Grid<T>& grid) {
    message.cell_bytes = sizeof(T);
    put_planes(grid, window, message.planes);
  });
  message.num_plane_bytes = static_cast<std::int32_t>(message.planes.size());
  return wire::encoded(message);
}

void decode_map_tile(ByteView bytes, const Tiling& tiling, const TileAddress& address,
                     map::Map& map) {
  const auto message = wire::decoded<map_tile_t>(bytes, kTileBytesMax);
  const wire::Check check(map_tile_t::getTypeName());
  const Window window = window_of(tiling, address);
  const auto must_be = [&](const char* field, std::int32_t value, std::int32_t wanted) {
    if (value != wanted) {
      check.refuse(field, value, "be " + std::to_string(wanted) + " in " + name_of(address));
    }
  };
  must_be("layer", message.layer, static_cast<std::int32_t>(address.layer));
  must_be("tile_column", message.tile_column, address.tile_column);
  must_be("tile_row", message.tile_row, address.tile_row);
  must_be("column_count", message.column_count, window.columns);
  must_be("row_count", message.row_count, window.rows);
  with_layer(map, address.layer, [&]<typename T>(raster::Grid<T>& grid) {
    must_be("cell_bytes", message.cell_bytes, sizeof(T));
    must_be("num_plane_bytes", message.num_plane_bytes,
            window.columns * window.rows * static_cast<std::int32_t>(sizeof(T)));
    take_planes(message.planes, window, grid);
  });
}

Bytes encode_map_features(const map::Map& map, const Hash128& map_hash) {
  map_features_t message{};
  message.version = map_features_t::VERSION;
  wire::put(message.map_hash, map_hash);
  message.crs_wkt = map.crs_wkt;
  message.vertical_datum = map.vertical_datum;
  message.reference_height_m = map.reference_height_m;
  message.visibility_radius_m = map.visibility_radius_m;
  message.label = map.label;
  message.num_attributions = static_cast<std::int32_t>(map.attributions.size());
  message.attributions = map.attributions;
  put_overhead_lines(map.overhead_lines, message);
  put_obstacles(map.obstacles, message);
  put_areas(map.areas, message);
  return sendable(wire::encoded(message), [&](ByteView bytes) {
    map::Map copy;
    decode_map_features(bytes, map_hash, copy);
  });
}

void decode_map_features(ByteView bytes, const Hash128& map_hash, map::Map& map) {
  const auto message = wire::decoded<map_features_t>(bytes, kBlobBytesMax);
  const wire::Check check(map_features_t::getTypeName());
  check_map_hash(check, message.map_hash, map_hash);
  map.crs_wkt = check.text("crs_wkt", message.crs_wkt, kWktBytesMax);
  map.vertical_datum = check.text("vertical_datum", message.vertical_datum, kLineBytesMax);
  map.reference_height_m = check.not_negative("reference_height_m", message.reference_height_m);
  map.visibility_radius_m = check.not_negative("visibility_radius_m", message.visibility_radius_m);
  map.label = check.text("label", message.label, kLineBytesMax);
  map.attributions.clear();
  for (const std::string& line : message.attributions) {
    map.attributions.push_back(check.text("attributions", line, kLineBytesMax));
  }
  map.overhead_lines = overhead_lines_in(check, message);
  map.obstacles = obstacles_in(check, message);
  map.areas = areas_in(check, message);
}

Bytes encode_map_tile_table(const Hash128& map_hash, const Tiling& tiling,
                            const std::vector<BlobRef>& tiles) {
  map_tile_table_t message{};
  message.version = map_tile_table_t::VERSION;
  wire::put(message.map_hash, map_hash);
  message.layer_count = tiling.layer_count();
  message.tile_column_count = tiling.tile_columns();
  message.tile_row_count = tiling.tile_rows();
  message.num_tiles = static_cast<std::int32_t>(tiles.size());
  for (const BlobRef& tile : tiles) {
    wire::put_ref(message.tiles.emplace_back(), tile);
  }
  return sendable(wire::encoded(message),
                  [&](ByteView bytes) { decode_map_tile_table(bytes, map_hash, tiling); });
}

std::vector<BlobRef> decode_map_tile_table(ByteView bytes, const Hash128& map_hash,
                                           const Tiling& tiling) {
  const auto message = wire::decoded<map_tile_table_t>(bytes, kBlobBytesMax);
  const wire::Check check(map_tile_table_t::getTypeName());
  check_map_hash(check, message.map_hash, map_hash);
  must_be(check, "layer_count", message.layer_count, tiling.layer_count());
  must_be(check, "tile_column_count", message.tile_column_count, tiling.tile_columns());
  must_be(check, "tile_row_count", message.tile_row_count, tiling.tile_rows());
  must_be(check, "num_tiles", message.num_tiles,
          static_cast<std::int64_t>(tiling.layer_count()) * tiling.tile_count());
  return tiles_in(check, message.tiles);
}

Bytes encode_map_threats(const Hash128& map_hash, const Tiling& tiling, const MapThreats& threats) {
  map_threats_t message{};
  message.version = map_threats_t::VERSION;
  wire::put(message.map_hash, map_hash);
  message.num_threats = count_of(threats.names.size());
  message.names = threats.names;
  message.tile_column_count = tiling.tile_columns();
  message.tile_row_count = tiling.tile_rows();
  message.num_tiles = count_of(threats.tiles.size());
  for (const BlobRef& tile : threats.tiles) {
    wire::put_ref(message.tiles.emplace_back(), tile);
  }
  return sendable(wire::encoded(message), [&](ByteView bytes) {
    decode_map_threats(bytes, map_hash, tiling, message.num_threats);
  });
}

// One name may stand for several observers: those of patches need none at all.
MapThreats decode_map_threats(ByteView bytes, const Hash128& map_hash, const Tiling& tiling,
                              int count) {
  const auto message = wire::decoded<map_threats_t>(bytes, kBlobBytesMax);
  const wire::Check check(map_threats_t::getTypeName());
  check_map_hash(check, message.map_hash, map_hash);
  must_be(check, "num_threats", message.num_threats, count);
  must_be(check, "tile_column_count", message.tile_column_count, tiling.tile_columns());
  must_be(check, "tile_row_count", message.tile_row_count, tiling.tile_rows());
  must_be(check, "num_tiles", message.num_tiles,
          static_cast<std::int64_t>(count) * tiling.tile_count());
  MapThreats threats;
  for (const std::string& name : message.names) {
    threats.names.push_back(check.text("names", name, kThreatNameBytesMax));
  }
  threats.tiles = tiles_in(check, message.tiles);
  return threats;
}

map::Map begin_map(const MapIndex& index) {
  map::Map map;
  map.geometry = index.geometry;
  map.terrain_m = raster::Grid<float>(index.geometry, 0.0F);
  map.surface_m = raster::Grid<float>(index.geometry, 0.0F);
  map.semantics = raster::Grid<std::uint16_t>(index.geometry, 0);
  map.visibility = raster::Grid<std::uint16_t>(index.geometry, 0);
  for (const double height_m : index.further_heights_m) {
    map.further_visibility.push_back(
        {height_m, raster::Grid<std::uint16_t>(index.geometry, map::kVisibilityUnknown)});
  }
  return map;
}

void finish_map(map::Map& map, const Hash128& map_hash) {
  map.hash = map_hash;
  try {
    map::validate(map);
  } catch (const DataError& error) {
    throw MessageError(error.what());
  }
}

}  // namespace hedgehop::messages
