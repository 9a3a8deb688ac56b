#include "bus/map_exchange.hpp"

#include <stdexcept>
#include <utility>
#include <vector>

#include "base/errors.hpp"
#include "messages/map_tiles.hpp"
#include "messages/message_error.hpp"

namespace hedgehop::bus {

messages::MapIndex offer_map(const map::Map& map, int tile_cells, BlobExchange& exchange) {
  const messages::Tiling tiling = messages::tiling_of(map, tile_cells);
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
  std::vector<messages::BlobRef> tiles;
  tiles.reserve(static_cast<std::size_t>(tiling.layer_count()) *
                static_cast<std::size_t>(tiling.tile_count()));
  for (std::size_t i = 0; i < tiles.capacity(); ++i) {
    tiles.push_back(exchange.offer(
        messages::encode_map_tile(map, tile_cells, messages::tile_address(tiling, i)), false));
  }
  messages::MapIndex index;
  index.map_hash = map.hash;
  index.geometry = map.geometry;
  index.tile_cells = tile_cells;
  index.reference_height_m = map.reference_height_m;
  for (const map::VisibilityBand& band : map.further_visibility) {
    index.further_heights_m.push_back(band.height_m);
  }
  index.tile_table =
      exchange.offer(messages::encode_map_tile_table(map.hash, tiling, tiles), false);
  index.features = exchange.offer(messages::encode_map_features(map), false);
  index.label = map.label;
  return index;
}

struct MapAssembly::Impl {
  BlobExchange& exchange;
  std::optional<messages::MapIndex> index;
  std::vector<messages::BlobRef> tiles;  // empty until the table is there
  std::size_t complete_tiles = 0;        // the first ones, in a row
  bool is_done = false;
  int foreign_indices = 0;  // in a row, while a map is being collected
  std::shared_ptr<const map::Map> map;
  std::string refusal;

  explicit Impl(BlobExchange& exchange_in) : exchange(exchange_in) {}

  void give_up_blobs() {
    if (index) {
      exchange.forget(index->tile_table.id);
      exchange.forget(index->features.id);
    }
    for (const messages::BlobRef& tile : tiles) {
      exchange.forget(tile.id);
    }
    tiles.clear();
    complete_tiles = 0;
  }

  const Bytes& content(const Hash128& id) {
    const Bytes* bytes = exchange.content(id);
    if (bytes == nullptr) {
      throw messages::MessageError("blob " + id.hex() + " stands for two parts of the map");
    }
    return *bytes;
  }

  void go_on() {
    const messages::Tiling tiling = tiling_of(*index);
    if (tiles.empty()) {
      if (!exchange.is_complete(index->tile_table.id)) {
        return;
      }
      tiles =
          messages::decode_map_tile_table(content(index->tile_table.id), index->map_hash, tiling);
      for (std::size_t i = 0; i < tiles.size(); ++i) {
        exchange.want(tiles[i], messages::name_of(messages::tile_address(tiling, i)));
      }
    }
    while (complete_tiles < tiles.size() && exchange.is_complete(tiles[complete_tiles].id)) {
      ++complete_tiles;
    }
    if (complete_tiles < tiles.size() || !exchange.is_complete(index->features.id)) {
      return;
    }
    auto whole = std::make_shared<map::Map>(messages::begin_map(*index));
    messages::decode_map_features(content(index->features.id), index->map_hash, *whole);
    for (std::size_t i = 0; i < tiles.size(); ++i) {
      messages::decode_map_tile(content(tiles[i].id), tiling, messages::tile_address(tiling, i),
                                *whole);
      exchange.forget(tiles[i].id);
    }
    messages::finish_map(*whole, index->map_hash);
    map = std::move(whole);
    is_done = true;
    give_up_blobs();
  }
};

MapAssembly::MapAssembly(BlobExchange& exchange) : impl_(std::make_unique<Impl>(exchange)) {}
MapAssembly::~MapAssembly() = default;

void MapAssembly::receive(const messages::MapIndex& index) {
  Impl& impl = *impl_;
  if (impl.index && impl.index->map_hash == index.map_hash &&
      impl.index->tile_table == index.tile_table && impl.index->features == index.features &&
      impl.index->geometry == index.geometry && impl.index->tile_cells == index.tile_cells &&
      impl.index->further_heights_m == index.further_heights_m) {
    impl.index->patch_number = index.patch_number;
    impl.foreign_indices = 0;
    return;
  }
  constexpr int kForeignIndicesMax = 2;
  if (impl.index && !impl.is_done && impl.refusal.empty() &&
      ++impl.foreign_indices <= kForeignIndicesMax) {
    return;
  }
  impl.foreign_indices = 0;
  impl.give_up_blobs();
  impl.index = index;
  impl.refusal.clear();
  impl.is_done = impl.map && impl.map->hash == index.map_hash;
  if (impl.is_done) {
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
