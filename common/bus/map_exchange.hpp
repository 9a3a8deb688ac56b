#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "base/hash.hpp"
#include "bus/blob_exchange.hpp"
#include "map/map.hpp"
#include "messages/map_messages.hpp"

namespace hedgehop::bus {

/// Offers every tile, the features and the tile table of a map, and returns the MAP_INDEX to
/// publish. The map may go afterwards. Throws UsageError when it is too large for the bus.
messages::MapIndex offer_map(const map::Map& map, int tile_cells, BlobExchange& exchange);

/// Puts the newest map on the bus together, in memory.
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
  /// collected. A map that is being collected gives way only to the third index in a row that names
  /// another one, so that two tilers on one bus do not keep each other from being heard out.
  void receive(const messages::MapIndex& index);

  /// Goes on with what has arrived.
  void tick();

  /// The complete, verified map; nullptr before. Stays valid and unchanged while the caller holds
  /// it.
  [[nodiscard]] std::shared_ptr<const map::Map> map() const;
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
