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
    default:
      break;
  }
  const auto layer = static_cast<std::size_t>(address.layer);
  if (address.layer >= messages::MapLayer::kThreat) {
    const std::size_t threat = layer - static_cast<std::size_t>(messages::MapLayer::kThreat);
    return is_same(a.threats[threat].height_m, b.threats[threat].height_m);
  }
  const std::size_t band = layer - static_cast<std::size_t>(messages::MapLayer::kFurtherVisibility);
  return is_same(a.further_visibility[band].share, b.further_visibility[band].share);
}

void check_size(const map::Map& map, int tile_cells) {
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
  const auto threats_max =
      static_cast<std::size_t>(messages::threats_max(map.geometry, tile_cells));
  if (map.threats.size() > threats_max) {
    throw UsageError("a map with " + std::to_string(map.threats.size()) +
                         " named observers is too large for the bus, which carries " +
                         std::to_string(threats_max) + " over so many cells",
                     "prepare the map with fewer --observers; 'hedgehop plan' needs no bus");
  }
  for (const map::HeightLayer& threat : map.threats) {
    if (threat.name.size() > messages::kThreatNameBytesMax) {
      throw UsageError("the name of observer '" + threat.name +
                           "' is too long for the bus, which carries " +
                           std::to_string(messages::kThreatNameBytesMax) + " bytes",
                       "shorten it in the file of --observers and prepare the map again");
    }
  }
}

// Tiles that are collected, in the order of their table.
class TileCollection {
 public:
  explicit TileCollection(BlobExchange& exchange) : exchange_(exchange) {}

  [[nodiscard]] bool has_begun() const { return !tiles_.empty(); }
  [[nodiscard]] std::size_t size() const { return tiles_.size(); }
  [[nodiscard]] const messages::BlobRef& operator[](std::size_t i) const { return tiles_[i]; }
  /// Whether the tile is what the earlier map has in its place.
  [[nodiscard]] bool is_held(std::size_t i) const { return is_held_[i] != 0; }
  [[nodiscard]] bool is_any_held() const {
    return std::find(is_held_.begin(), is_held_.end(), 1) != is_held_.end();
  }

  /// Asks for what `held`, the tiles of an earlier map, does not have in the same places. What
  /// set_aside() left and this table has again is not thrown away.
  /// @param name_of  of a tile, by its place in the table
  template <typename NameOf>
  void begin(std::vector<messages::BlobRef> tiles, const std::vector<messages::BlobRef>& held,
             const NameOf& name_of) {
    tiles_ = std::move(tiles);
    is_held_.assign(tiles_.size(), 0);
    std::unordered_set<std::uint64_t> kept;
    for (std::size_t i = 0; i < tiles_.size(); ++i) {
      is_held_[i] = i < held.size() && tiles_[i] == held[i] ? 1 : 0;
      if (is_held_[i] == 0) {
        kept.insert(tiles_[i].id.low);
        exchange_.want(tiles_[i], name_of(i));
      }
    }
    for (const messages::BlobRef& ref : left_over_) {
      if (!kept.contains(ref.id.low)) {
        exchange_.forget(ref.id);
      }
    }
    left_over_.clear();
  }

  [[nodiscard]] bool is_complete() {
    while (complete_ < tiles_.size() &&
           (is_held(complete_) || exchange_.is_complete(tiles_[complete_].id))) {
      ++complete_;
    }
    return has_begun() && complete_ == tiles_.size();
  }
  [[nodiscard]] bool lacks(const Hash128& blob_id) const {
    return std::any_of(tiles_.begin() + static_cast<std::ptrdiff_t>(complete_), tiles_.end(),
                       [&](const messages::BlobRef& tile) { return tile.id == blob_id; });
  }

  /// Another table is to come, which may have some of these tiles.
  void set_aside() {
    for (std::size_t i = 0; i < tiles_.size(); ++i) {
      if (!is_held(i)) {
        left_over_.push_back(tiles_[i]);
      }
    }
    clear();
  }
  void give_up() {
    for (const auto* refs : {&tiles_, &left_over_}) {
      for (const messages::BlobRef& tile : *refs) {
        exchange_.forget(tile.id);
      }
    }
    left_over_.clear();
    clear();
  }
  /// Gives up too; the table, for begin() of a later map.
  std::vector<messages::BlobRef> finish() {
    std::vector<messages::BlobRef> table = tiles_;
    give_up();
    return table;
  }

 private:
  void clear() {
    tiles_.clear();
    is_held_.clear();
    complete_ = 0;
  }

  BlobExchange& exchange_;
  std::vector<messages::BlobRef> tiles_;
  std::vector<char> is_held_;
  std::size_t complete_ = 0;  // the first ones, in a row
  std::vector<messages::BlobRef> left_over_;
};

}  // namespace

void NewestIndex::hear(const messages::MapIndex& index, std::int64_t sender_id) {
  const bool is_same = index_ && index_->map_hash == index.map_hash &&
                       index_->hash_for(true) == index.hash_for(true);
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
  check_size(*map, tile_cells_);
  const messages::Tiling tiling = messages::tiling_of(*map, tile_cells_);
  const auto layer_tiles = static_cast<std::size_t>(tiling.tile_count());
  const bool is_comparable = map_ && map_->geometry == map->geometry &&
                             map_->further_visibility.size() == map->further_visibility.size();
  const auto offered_tile = [&](const messages::TileAddress& address, bool is_in_both,
                                const std::vector<messages::BlobRef>& before, std::size_t i) {
    return is_in_both && is_same_tile(*map_, *map, tiling, address)
               ? before[i]
               : exchange_.offer(messages::encode_map_tile(*map, tile_cells_, address), false);
  };
  std::vector<messages::BlobRef> tiles;
  for (std::size_t i = 0; i < static_cast<std::size_t>(tiling.layer_count()) * layer_tiles; ++i) {
    tiles.push_back(offered_tile(messages::tile_address(tiling, i), is_comparable, tiles_, i));
  }
  messages::MapThreats threats;
  for (std::size_t i = 0; i < map->threats.size() * layer_tiles; ++i) {
    threats.tiles.push_back(offered_tile(messages::threat_tile_address(tiling, i),
                                         is_comparable && i < threat_tiles_.size(), threat_tiles_,
                                         i));
  }
  messages::MapIndex index;
  index.map_hash = map->threats.empty() ? map->hash : map::map_hash_without_threats(*map);
  index.geometry = map->geometry;
  index.tile_cells = tile_cells_;
  index.reference_height_m = map->reference_height_m;
  for (const map::VisibilityBand& band : map->further_visibility) {
    index.further_heights_m.push_back(band.height_m);
  }
  index.tile_table =
      exchange_.offer(messages::encode_map_tile_table(index.map_hash, tiling, tiles), false);
  index.features = exchange_.offer(messages::encode_map_features(*map, index.map_hash), false);
  index.label = map->label;
  std::vector<messages::BlobRef> tables = {index.tile_table, index.features};
  if (!map->threats.empty()) {
    for (const map::HeightLayer& threat : map->threats) {
      threats.names.push_back(threat.name);
    }
    index.threats = messages::ThreatLayers{
        static_cast<int>(threats.names.size()), map->hash,
        exchange_.offer(messages::encode_map_threats(map->hash, tiling, threats), false)};
    tables.push_back(index.threats->table);
  }

  std::unordered_set<std::uint64_t> kept;
  const auto keep = [&](const std::vector<messages::BlobRef>& refs) {
    for (const messages::BlobRef& ref : refs) {
      kept.insert(ref.id.low);
    }
  };
  for (const auto* refs : {&tiles, &threats.tiles, &tables, &tiles_, &threat_tiles_, &tables_}) {
    keep(*refs);
  }
  for (const messages::BlobRef& ref : older_) {
    if (!kept.contains(ref.id.low)) {
      exchange_.withdraw(ref.id);
    }
  }
  older_.clear();
  for (const auto* refs : {&tiles_, &threat_tiles_, &tables_}) {
    older_.insert(older_.end(), refs->begin(), refs->end());
  }
  tiles_ = std::move(tiles);
  threat_tiles_ = std::move(threats.tiles);
  tables_ = std::move(tables);
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
  std::int64_t sender_id = 0;  // of index
  TileCollection tiles;        // not begun until the table is there
  bool is_done = false;
  std::optional<messages::MapIndex> rival;
  int foreign_indices = 0;  // of the rival, in a row
  int own_indices = 0;      // since the rival was heard
  std::shared_ptr<const map::Map> map;
  std::int64_t map_patch_number = 0;
  std::optional<messages::MapIndex> map_index;  // of map
  std::vector<messages::BlobRef> map_tiles;     // of map
  std::string refusal;

  Hash128 needed;  // the newest
  bool needs_threats = false;
  TileCollection threat_tiles;  // likewise
  std::vector<std::string> threat_names;
  std::shared_ptr<const map::Map> map_with_threats;
  Hash128 hash_without_threats;                     // of map_with_threats
  int threat_tile_cells = 0;                        // likewise
  std::vector<messages::BlobRef> map_threat_tiles;  // likewise
  std::string threats_refusal;

  explicit Impl(BlobExchange& exchange_in)
      : exchange(exchange_in), tiles(exchange_in), threat_tiles(exchange_in) {}

  void give_up_blobs() {
    if (index) {
      exchange.forget(index->tile_table.id);
      exchange.forget(index->features.id);
    }
    tiles.give_up();
  }

  void give_up_threats() {
    exchange.forget(index->threats->table.id);
    threat_tiles.give_up();
    threat_names.clear();
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
    auto table =
        messages::decode_map_tile_table(content(index->tile_table.id), index->map_hash, tiling);
    tiles.begin(std::move(table), has_cells_of_map() ? map_tiles : std::vector<messages::BlobRef>(),
                [&](std::size_t i) { return name_of(messages::tile_address(tiling, i)); });
  }

  void go_on() {
    const messages::Tiling tiling = tiling_of(*index);
    if (!tiles.has_begun()) {
      if (!exchange.is_complete(index->tile_table.id)) {
        return;
      }
      take_table(tiling);
    }
    if (!tiles.is_complete() || !exchange.is_complete(index->features.id)) {
      return;
    }
    auto whole = std::make_shared<map::Map>(messages::begin_map(*index));
    if (tiles.is_any_held()) {
      whole->terrain_m = map->terrain_m;
      whole->surface_m = map->surface_m;
      whole->semantics = map->semantics;
      whole->visibility = map->visibility;
      whole->further_visibility = map->further_visibility;
    }
    messages::decode_map_features(content(index->features.id), index->map_hash, *whole);
    for (std::size_t i = 0; i < tiles.size(); ++i) {
      if (!tiles.is_held(i)) {
        messages::decode_map_tile(content(tiles[i].id), tiling, messages::tile_address(tiling, i),
                                  *whole);
        exchange.forget(tiles[i].id);
      }
    }
    messages::finish_map(*whole, index->map_hash);
    map = std::move(whole);
    map_index = index;
    map_patch_number = index->patch_number;
    is_done = true;
    map_tiles = tiles.finish();
    give_up_blobs();
  }

  void note_need() {
    needs_threats =
        needs_threats || (index && index->threats && index->threats->map_hash == needed);
  }

  [[nodiscard]] bool lacks_threats() const {
    return needs_threats && index && index->threats &&
           !(map_with_threats && map_with_threats->hash == index->threats->map_hash);
  }

  [[nodiscard]] bool has_cells_of_map_with_threats() const {
    return map_with_threats && map_with_threats->geometry == index->geometry &&
           threat_tile_cells == index->tile_cells;
  }

  void go_on_with_threats() {
    const messages::Tiling tiling = tiling_of(*index);
    if (!threat_tiles.has_begun()) {
      const messages::BlobRef& table = index->threats->table;
      exchange.want(table, "table of named observers");
      if (!exchange.is_complete(table.id)) {
        return;
      }
      messages::MapThreats threats = messages::decode_map_threats(
          content(table.id), index->threats->map_hash, tiling, index->threats->count);
      threat_names = std::move(threats.names);
      threat_tiles.begin(
          std::move(threats.tiles),
          has_cells_of_map_with_threats() ? map_threat_tiles : std::vector<messages::BlobRef>(),
          [&](std::size_t i) { return name_of(messages::threat_tile_address(tiling, i)); });
    }
    if (!threat_tiles.is_complete()) {
      return;
    }
    auto whole = std::make_shared<map::Map>(*map);
    const bool is_any_held = threat_tiles.is_any_held();
    for (std::size_t i = 0; i < threat_names.size(); ++i) {
      const bool is_before = is_any_held && i < map_with_threats->threats.size();
      whole->threats.push_back({threat_names[i], is_before
                                                     ? map_with_threats->threats[i].height_m
                                                     : raster::Grid<float>(index->geometry, 0.0F)});
    }
    for (std::size_t i = 0; i < threat_tiles.size(); ++i) {
      if (!threat_tiles.is_held(i)) {
        messages::decode_map_tile(content(threat_tiles[i].id), tiling,
                                  messages::threat_tile_address(tiling, i), *whole);
        exchange.forget(threat_tiles[i].id);
      }
    }
    messages::finish_map(*whole, index->threats->map_hash);
    map_with_threats = std::move(whole);
    hash_without_threats = map->hash;
    threat_tile_cells = index->tile_cells;
    map_threat_tiles = threat_tiles.finish();
    give_up_threats();
  }
};

MapAssembly::MapAssembly(BlobExchange& exchange) : impl_(std::make_unique<Impl>(exchange)) {}
MapAssembly::~MapAssembly() = default;

void MapAssembly::receive(const messages::MapIndex& index, std::int64_t sender_id) {
  Impl& impl = *impl_;
  if (impl.index && impl.index->map_hash == index.map_hash &&
      impl.index->tile_table == index.tile_table && impl.index->features == index.features &&
      impl.index->geometry == index.geometry && impl.index->tile_cells == index.tile_cells &&
      impl.index->further_heights_m == index.further_heights_m &&
      impl.index->threats == index.threats) {
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
    impl.tiles.set_aside();
  }
  if (impl.index && impl.index->threats) {
    impl.exchange.forget(impl.index->threats->table.id);
    impl.threat_tiles.set_aside();
  }
  impl.index = index;
  impl.sender_id = sender_id;
  impl.refusal.clear();
  impl.threats_refusal.clear();
  impl.note_need();
  if (!impl.lacks_threats()) {
    impl.threat_tiles.give_up();
  }
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

void MapAssembly::need(const Hash128& map_hash) {
  impl_->needed = map_hash;
  impl_->note_need();
}

void MapAssembly::tick() {
  Impl& impl = *impl_;
  if (!impl.index) {
    return;
  }
  if (!impl.is_done && impl.refusal.empty()) {
    try {
      impl.go_on();
    } catch (const messages::MessageError& error) {
      impl.refusal = error.what();
      impl.give_up_blobs();
    }
  }
  if (lacks_only_threats() && impl.threats_refusal.empty()) {
    try {
      impl.go_on_with_threats();
    } catch (const messages::MessageError& error) {
      impl.threats_refusal = error.what();
      impl.give_up_threats();
    }
  }
}

std::shared_ptr<const map::Map> MapAssembly::map() const { return impl_->map; }
std::shared_ptr<const map::Map> MapAssembly::map_with_threats() const {
  const bool is_of_map = impl_->map && impl_->map->hash == impl_->hash_without_threats;
  return is_of_map ? impl_->map_with_threats : nullptr;
}
bool MapAssembly::lacks_only_threats() const { return impl_->is_done && impl_->lacks_threats(); }
std::shared_ptr<const map::Map> MapAssembly::map_of(const Hash128& map_hash) const {
  for (const auto& map : {impl_->map, impl_->map_with_threats}) {
    if (map && map->hash == map_hash) {
      return map;
    }
  }
  return nullptr;
}
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
const std::string& MapAssembly::refusal() const {
  return impl_->refusal.empty() ? impl_->threats_refusal : impl_->refusal;
}

std::string MapAssembly::missing() const {
  const Impl& impl = *impl_;
  if (!impl.index) {
    return "no MAP_INDEX heard";
  }
  if (impl.is_done && !impl.lacks_threats()) {
    return {};
  }
  if (!refusal().empty()) {
    return "map refused: " + refusal();
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
    const auto& threats = impl.index->threats;
    if (part.blob_id == impl.index->tile_table.id || part.blob_id == impl.index->features.id ||
        impl.tiles.lacks(part.blob_id) || (threats && part.blob_id == threats->table.id) ||
        impl.threat_tiles.lacks(part.blob_id)) {
      add(part);
    }
  }
  if (count > kShown) {
    text += "; and " + std::to_string(count - kShown) + " more";
  }
  return text;
}

}  // namespace hedgehop::bus
