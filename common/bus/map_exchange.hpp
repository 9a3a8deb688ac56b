#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/hash.hpp"
#include "bus/blob_exchange.hpp"
#include "map/map.hpp"
#include "messages/map_messages.hpp"

namespace hedgehop::bus {

/// Offers every tile, the features and the tile table of a map, and those of its named observers,
/// and returns the MAP_INDEX to publish. The map may go afterwards. Throws UsageError when it is
/// too large for the bus, or has more observers than it carries.
messages::MapIndex offer_map(const map::Map& map, int tile_cells, BlobExchange& exchange);

/// The map that counts for somebody who only needs to know which one it is: that of the first
/// map_tiler, or of another one that is heard three times in a row.
class NewestIndex {
 public:
  void hear(const messages::MapIndex& index, std::int64_t sender_id);
  [[nodiscard]] const std::optional<messages::MapIndex>& index() const { return index_; }

 private:
  std::optional<messages::MapIndex> index_;
  std::int64_t sender_id_ = 0;
  int foreign_indices_ = 0;  // in a row
};

/// Keeps one map on offer, which may change: tiles in which nothing has changed are neither encoded
/// nor sent again, and those that are gone are withdrawn one change later, so that whoever still
/// collects them gets them.
class MapOffer {
 public:
  MapOffer(int tile_cells, BlobExchange& exchange);

  /// Like offer_map(). The map is kept for comparison.
  messages::MapIndex offer(std::shared_ptr<const map::Map> map);

 private:
  int tile_cells_;
  BlobExchange& exchange_;
  std::shared_ptr<const map::Map> map_;
  // Of map_
  std::vector<messages::BlobRef> tiles_;
  std::vector<messages::BlobRef> threat_tiles_;
  std::vector<messages::BlobRef> tables_;  // and features
  std::vector<messages::BlobRef> older_;
};

/// Puts the newest map on the bus together, in memory: without its named observers, and beside that
/// with them, a second copy, from the first time on that somebody needs it.
///
///     MapAssembly assembly(exchange);
///     bus.subscribe(kMapIndexChannel, [&](const MapIndex& index, const Stamp&) {
///     assembly.receive(index); });
///     ... each tick:  assembly.tick();  if (auto map = assembly.map()) ...
class MapAssembly {
 public:
  explicit MapAssembly(BlobExchange& exchange);
  ~MapAssembly();

  /// Starts over when the map hash or the blobs differ from what is held, refused or being
  /// collected; of a map with the same tiling only the tiles that differ from the held one are
  /// asked for.
  ///
  /// Another map of the same sender, one with other patches, counts at once. To another sender's a
  /// map gives way only with the third index in a row, so that two tilers on one bus neither keep
  /// each other from being heard out nor mix; meanwhile rival() names it.
  void receive(const messages::MapIndex& index, std::int64_t sender_id = 0);

  /// Says which map somebody needs. If the index, this one or the next, offers it with named
  /// observers, their layers are collected from then on, of later maps too.
  void need(const Hash128& map_hash);

  /// Goes on with what has arrived.
  void tick();

  /// The complete, verified map without named observers; nullptr before. Stays valid and unchanged
  /// while the caller holds it.
  [[nodiscard]] std::shared_ptr<const map::Map> map() const;
  /// map() with its named observers; nullptr before, and where it has none or nobody needs them.
  [[nodiscard]] std::shared_ptr<const map::Map> map_with_threats() const;
  /// Whether map() is that of the index, and only the named observers that somebody needs are not
  /// there.
  [[nodiscard]] bool lacks_only_threats() const;
  /// The complete, verified map of this hash, with named observers or without; nullptr if it is not
  /// held.
  [[nodiscard]] std::shared_ptr<const map::Map> map_of(const Hash128& map_hash) const;
  /// What the tiles of map() have on the wire [bytes]; 0 before. Named observers do not count.
  [[nodiscard]] std::int64_t packed_bytes() const;
  /// Newest patch in map(); 0 before.
  [[nodiscard]] std::int64_t patch_number() const;
  /// Another map that somebody else offers meanwhile; none while all tilers agree.
  [[nodiscard]] const std::optional<messages::MapIndex>& rival() const;
  /// Index of the map being collected or held.
  [[nodiscard]] const std::optional<messages::MapIndex>& index() const;

  /// What is missing, for people: tiles by layer, column, row and chunk numbers (the first few,
  /// then a count). Empty when complete; "no MAP_INDEX heard" before the first.
  [[nodiscard]] std::string missing() const;
  /// Why the last map was refused, or empty. It is not tried again until another index comes.
  [[nodiscard]] const std::string& refusal() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace hedgehop::bus
