#include "bus/map_exchange.hpp"

#include <algorithm>
#include <cstring>
#include <stdexcept>
#include <unordered_set>
#include <utility>
#include <vector>

#include "base/errors.hpp"
#include "messages/map_tiles.hpp"
#include "messages/message_error.hpp"

namespace hedgehop::bus {

namespace {

constexpr int kForeignIndicesMax = 2;

// Whether the cells of a tile have the same bits in both maps, which have the same geometry.
bool is_same_tile(const map::Map& a, const map::Map& b, const messages::Tiling& tiling,
                  const messages::TileAddress& address) {
  const int column = address.tile_column * tiling.tile_cells;
  const int row = address.tile_row * tiling.tile_cells;
  const int columns = std::min(tiling.tile_cells, tiling.columns - column);
  const int rows = std::min(tiling.tile_cells, tiling.rows - row);
  const auto is_same = [&](const auto& grid_a, const auto& grid_b) {
    for (int r = row; r < row + rows; ++r) {
      if (std::memcmp(grid_a.row(r) + column, grid_b.row(r) + column,
                      static_cast<std::size_t>(columns) * sizeof(*grid_a.row(r))) != 0) {
        return false;
      }
    }
    return true;
  };
  switch (address.layer) {
    case messages::MapLayer::kTerrain:
      return is_same(a.terrain_m, b.terrain_m);
    case messages::MapLayer::kSurface:
      return is_same(a.surface_m, b.surface_m);
    case messages::MapLayer::kSemantics:
      return is_same(a.semantics, b.semantics);
    case messages::MapLayer::kVisibility:
      return is_same(a.visibility, b.visibility);
    default: {
      const auto band = static_cast<std::size_t>(address.layer) -
                        static_cast<std::size_t>(messages::MapLayer::kFurtherVisibility);
      return is_same(a.further_visibility[band].share, b.further_visibility[band].share);
    }
  }
}

void check_size(const map::Map& map) {
  const std::size_t further_heights = map.further_visibility.size();
  if (map.geometry.columns > messages::kMaxMapSideCells ||
      map.geometry.rows > messages::kMaxMapSideCells ||
      messages::raster_bytes(map.geometry, further_heights) > messages::kMaxMapBytes) {
    throw UsageError("a map of " + std::to_string(map.geometry.columns) + " x " +
                         std::to_string(map.geometry.rows) + " cells is too large for the bus",
                     "prepare a smaller region or larger cells; 'hedgehop plan' needs no bus");
  }
  if (further_heights > messages::kMaxFurtherHeights) {
    throw UsageError("an exposure volume of " + std::to_string(further_heights) +
                         " further heights is too large for the bus, which carries " +
                         std::to_string(messages::kMaxFurtherHeights),
                     "prepare the map with fewer further_heights_m; 'hedgehop plan' needs no bus");
  }
}

}  // namespace

void NewestIndex::hear(const messages::MapIndex& index, std::int64_t sender_id) {
  const bool is_same = index_ && index_->map_hash == index.map_hash;
  if (index_ && !is_same && sender_id != sender_id_ && ++foreign_indices_ <= kForeignIndicesMax) {
    return;
  }
  foreign_indices_ = 0;
  index_ = index;
  sender_id_ = sender_id;
}

MapOffer::MapOffer(int tile_cells, BlobExchange& exchange)
    : tile_cells_(tile_cells), exchange_(exchange) {}

messages::MapIndex MapOffer::offer(std::shared_ptr<const map::Map> map) {
  check_size(*map);
  const messages::Tiling tiling = messages::tiling_of(*map, tile_cells_);
  const std::size_t tile_count = static_cast<std::size_t>(tiling.layer_count()) *
                                 static_cast<std::size_t>(tiling.tile_count());
  const bool is_comparable = map_ && map_->geometry == map->geometry &&
                             map_->further_visibility.size() == map->further_visibility.size();
  std::vector<messages::BlobRef> blobs;
  blobs.reserve(tile_count + 2);
  for (std::size_t i = 0; i < tile_count; ++i) {
    const messages::TileAddress address = messages::tile_address(tiling, i);
    blobs.push_back(
        is_comparable && is_same_tile(*map_, *map, tiling, address)
            ? blobs_[i]
            : exchange_.offer(messages::encode_map_tile(*map, tile_cells_, address), false));
  }
  messages::MapIndex index;
  index.map_hash = map->hash;
  index.geometry = map->geometry;
  index.tile_cells = tile_cells_;
  index.reference_height_m = map->reference_height_m;
  for (const map::VisibilityBand& band : map->further_visibility) {
    index.further_heights_m.push_back(band.height_m);
  }
  index.tile_table =
      exchange_.offer(messages::encode_map_tile_table(map->hash, tiling, blobs), false);
  index.features = exchange_.offer(messages::encode_map_features(*map), false);
  index.label = map->label;
  blobs.push_back(index.tile_table);
  blobs.push_back(index.features);

  std::unordered_set<std::uint64_t> kept;
  const auto keep = [&](const std::vector<messages::BlobRef>& refs) {
    for (const messages::BlobRef& ref : refs) {
      kept.insert(ref.id.low);
    }
  };
  keep(blobs);
  keep(blobs_);
  for (const messages::BlobRef& ref : older_) {
    if (!kept.contains(ref.id.low)) {
      exchange_.withdraw(ref.id);
    }
  }
  older_ = std::move(blobs_);
  blobs_ = std::move(blobs);
  map_ = std::move(map);
  return index;
}

messages::MapIndex offer_map(const map::Map& map, int tile_cells, BlobExchange& exchange) {
  return MapOffer(tile_cells, exchange)
      .offer(std::shared_ptr<const map::Map>(std::shared_ptr<const map::Map>(), &map));
}

struct MapAssembly::Impl {
  BlobExchange& exchange;
  std::optional<messages::MapIndex> index;
  std::int64_t sender_id = 0;            // of index
  std::vector<messages::BlobRef> tiles;  // empty until the table is there
  std::vector<char> is_held;             // tiles[i] stands in `map` already
  std::size_t complete_tiles = 0;        // the first ones, in a row
  bool is_done = false;
  std::optional<messages::MapIndex> rival;
  int foreign_indices = 0;  // of the rival, in a row
  int own_indices = 0;      // since the rival was heard
  std::shared_ptr<const map::Map> map;
  std::int64_t map_patch_number = 0;
  std::optional<messages::MapIndex> map_index;  // of map
  std::vector<messages::BlobRef> map_tiles;     // of map
  std::vector<messages::BlobRef> left_over;     // of a map that gave way while it was collected
  std::string refusal;

  explicit Impl(BlobExchange& exchange_in) : exchange(exchange_in) {}

  void give_up(const messages::BlobRef& ref, const std::unordered_set<std::uint64_t>& kept) {
    if (!kept.contains(ref.id.low)) {
      exchange.forget(ref.id);
    }
  }

  void give_up_blobs() {
    if (index) {
      exchange.forget(index->tile_table.id);
      exchange.forget(index->features.id);
    }
    for (const auto* refs : {&tiles, &left_over}) {
      for (const messages::BlobRef& tile : *refs) {
        exchange.forget(tile.id);
      }
    }
    tiles.clear();
    left_over.clear();
    is_held.clear();
    complete_tiles = 0;
  }

  const Bytes& content(const Hash128& id) {
    const Bytes* bytes = exchange.content(id);
    if (bytes == nullptr) {
      throw messages::MessageError("blob " + id.hex() + " stands for two parts of the map");
    }
    return *bytes;
  }

  [[nodiscard]] bool has_cells_of_map() const {
    return map && map_index->geometry == index->geometry &&
           map_index->tile_cells == index->tile_cells &&
           map_index->further_heights_m == index->further_heights_m;
  }

  // What the old map had and the new one has again is neither asked for nor thrown away.
  void take_table(const messages::Tiling& tiling) {
    tiles = messages::decode_map_tile_table(content(index->tile_table.id), index->map_hash, tiling);
    const bool is_comparable = has_cells_of_map() && map_tiles.size() == tiles.size();
    is_held.assign(tiles.size(), 0);
    std::unordered_set<std::uint64_t> kept;
    for (std::size_t i = 0; i < tiles.size(); ++i) {
      is_held[i] = is_comparable && tiles[i] == map_tiles[i] ? 1 : 0;
      if (is_held[i] == 0) {
        kept.insert(tiles[i].id.low);
        exchange.want(tiles[i], messages::name_of(messages::tile_address(tiling, i)));
      }
    }
    for (const messages::BlobRef& ref : left_over) {
      give_up(ref, kept);
    }
    left_over.clear();
  }

  [[nodiscard]] bool is_there(std::size_t tile) const {
    return is_held[tile] != 0 || exchange.is_complete(tiles[tile].id);
  }

  void go_on() {
    const messages::Tiling tiling = tiling_of(*index);
    if (tiles.empty()) {
      if (!exchange.is_complete(index->tile_table.id)) {
        return;
      }
      take_table(tiling);
    }
    while (complete_tiles < tiles.size() && is_there(complete_tiles)) {
      ++complete_tiles;
    }
    if (complete_tiles < tiles.size() || !exchange.is_complete(index->features.id)) {
      return;
    }
    auto whole = std::make_shared<map::Map>(messages::begin_map(*index));
    if (std::find(is_held.begin(), is_held.end(), 1) != is_held.end()) {
      whole->terrain_m = map->terrain_m;
      whole->surface_m = map->surface_m;
      whole->semantics = map->semantics;
      whole->visibility = map->visibility;
      whole->further_visibility = map->further_visibility;
    }
    messages::decode_map_features(content(index->features.id), index->map_hash, *whole);
    for (std::size_t i = 0; i < tiles.size(); ++i) {
      if (is_held[i] == 0) {
        messages::decode_map_tile(content(tiles[i].id), tiling, messages::tile_address(tiling, i),
                                  *whole);
        exchange.forget(tiles[i].id);
      }
    }
    messages::finish_map(*whole, index->map_hash);
    map = std::move(whole);
    map_index = index;
    map_patch_number = index->patch_number;
    std::vector<messages::BlobRef> table = std::move(tiles);
    is_done = true;
    tiles.clear();
    give_up_blobs();
    map_tiles = std::move(table);
  }
};

MapAssembly::MapAssembly(BlobExchange& exchange) : impl_(std::make_unique<Impl>(exchange)) {}
MapAssembly::~MapAssembly() = default;

void MapAssembly::receive(const messages::MapIndex& index, std::int64_t sender_id) {
  Impl& impl = *impl_;
  if (impl.index && impl.index->map_hash == index.map_hash &&
      impl.index->tile_table == index.tile_table && impl.index->features == index.features &&
      impl.index->geometry == index.geometry && impl.index->tile_cells == index.tile_cells &&
      impl.index->further_heights_m == index.further_heights_m) {
    impl.index->patch_number = index.patch_number;
    if (impl.is_done) {
      impl.map_patch_number = index.patch_number;
    }
    impl.sender_id = sender_id;
    impl.foreign_indices = 0;
    if (++impl.own_indices > kForeignIndicesMax) {
      impl.rival.reset();
    }
    return;
  }
  const bool is_foreign = sender_id != impl.sender_id || (sender_id == 0 && !impl.is_done);
  if (impl.index && impl.refusal.empty() && is_foreign) {
    impl.rival = index;
    impl.own_indices = 0;
    if (++impl.foreign_indices <= kForeignIndicesMax) {
      return;
    }
  }
  impl.foreign_indices = 0;
  impl.rival.reset();
  if (impl.index && !impl.is_done) {
    impl.exchange.forget(impl.index->tile_table.id);
    impl.exchange.forget(impl.index->features.id);
    for (std::size_t i = 0; i < impl.tiles.size(); ++i) {
      if (impl.is_held[i] == 0) {
        impl.left_over.push_back(impl.tiles[i]);
      }
    }
    impl.tiles.clear();
    impl.is_held.clear();
    impl.complete_tiles = 0;
  }
  impl.index = index;
  impl.sender_id = sender_id;
  impl.refusal.clear();
  impl.is_done = impl.map && impl.map->hash == index.map_hash;
  if (impl.is_done) {
    impl.map_patch_number = index.patch_number;
    impl.give_up_blobs();
    return;
  }
  try {
    impl.exchange.want(index.tile_table, "tile table");
    impl.exchange.want(index.features, "map features");
  } catch (const messages::MessageError& error) {
    impl.refusal = error.what();
    impl.give_up_blobs();
  }
}

void MapAssembly::tick() {
  Impl& impl = *impl_;
  if (!impl.index || impl.is_done || !impl.refusal.empty()) {
    return;
  }
  try {
    impl.go_on();
  } catch (const messages::MessageError& error) {
    impl.refusal = error.what();
    impl.give_up_blobs();
  }
}

std::shared_ptr<const map::Map> MapAssembly::map() const { return impl_->map; }
std::int64_t MapAssembly::packed_bytes() const {
  std::int64_t bytes = 0;
  for (const messages::BlobRef& tile : impl_->map_tiles) {
    bytes += tile.packed_bytes;
  }
  return bytes;
}
std::int64_t MapAssembly::patch_number() const { return impl_->map_patch_number; }
const std::optional<messages::MapIndex>& MapAssembly::rival() const { return impl_->rival; }
const std::optional<messages::MapIndex>& MapAssembly::index() const { return impl_->index; }
const std::string& MapAssembly::refusal() const { return impl_->refusal; }

std::string MapAssembly::missing() const {
  const Impl& impl = *impl_;
  if (!impl.index) {
    return "no MAP_INDEX heard";
  }
  if (impl.is_done) {
    return {};
  }
  if (!impl.refusal.empty()) {
    return "map refused: " + impl.refusal;
  }
  constexpr std::size_t kShown = 4;
  std::string text;
  std::size_t count = 0;
  const auto add = [&](const MissingChunks& part) {
    if (++count <= kShown) {
      text += (count > 1 ? "; " : "") + to_text(part);
    }
  };
  for (const MissingChunks& part : impl.exchange.missing()) {
    bool is_ours =
        part.blob_id == impl.index->tile_table.id || part.blob_id == impl.index->features.id;
    for (std::size_t i = impl.complete_tiles; i < impl.tiles.size() && !is_ours; ++i) {
      is_ours = impl.tiles[i].id == part.blob_id;
    }
    if (is_ours) {
      add(part);
    }
  }
  if (count > kShown) {
    text += "; and " + std::to_string(count - kShown) + " more";
  }
  return text;
}

}  // namespace hedgehop::bus
