#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "base/config_reader.hpp"
#include "base/time.hpp"
#include "bus/blob_exchange.hpp"
#include "bus/bus.hpp"
#include "bus/map_exchange.hpp"
#include "bus/service.hpp"
#include "map/map.hpp"
#include "messages/map_messages.hpp"
#include "preparation/map_patches.hpp"

namespace hedgehop::services {

/// config/map_tiler.yaml
struct MapTilerOptions {
  double index_period_s = 0.0;
  int tile_cells = 0;
  double send_rate_bytesps = 0.0;
  preparation::PatchOptions patches;
};
MapTilerOptions read_map_tiler_options(ConfigReader reader);

/// The map that the option --map names, with its named observers. Throws UsageError without it,
/// DataError for a damaged one.
map::Map read_map(const bus::ServiceArguments& arguments);

/// Puts one map on the bus: announces MAP_INDEX and serves the chunks of its blobs to whoever asks.
///
/// MAP_PATCH changes it: what passes preparation::reason_against() gets the next number, the
/// patched map takes the place of the one before, and only then is the patch repeated with its
/// number. A patch that is repeated, or changes nothing, keeps its number. Patches for another base
/// map are refused, and observers beyond what the bus carries, if the map has named ones.
///
/// The hash of a map is that without its named observers, here and in all messages; MAP_INDEX names
/// the other one beside it.
class MapTilerService {
 public:
  /// @param journal  file that keeps the patches, an LCM log of MAP_PATCH; read now if it exists,
  /// so
  ///                 that a restart loses none. Empty: none.
  /// @throws DataError  the journal is damaged or belongs to another base map.
  MapTilerService(const MapTilerOptions& options, map::Map map, bus::Bus& bus,
                  bus::BlobExchange& exchange, std::filesystem::path journal = {});

  void tick(Time now);

 private:
  void receive(const messages::MapPatch& message, const messages::Stamp& stamp);
  void refuse(const messages::MapPatch& message, std::int64_t sender_id, const std::string& why);
  [[nodiscard]] std::string reason_against(const map::Patch& patch) const;
  void accept(const messages::MapPatch& message);
  void read_journal();
  void write_journal() const;
  void apply();
  void announce(Time now);

  MapTilerOptions options_;
  bus::Bus& bus_;
  std::filesystem::path journal_;
  std::shared_ptr<const map::Map> base_;
  Hash128 base_hash_;
  bus::MapOffer offer_;
  messages::MapIndex index_;
  std::map<std::int64_t, messages::MapPatch> patches_;  // newest of each id, gone ones too
  std::vector<messages::MapPatch> history_;             // all, in the order of their numbers
  std::vector<messages::MapPatch> repeated_;            // asked for again
  std::size_t applied_ = 0;                             // of history_
  messages::MapPatchState state_;
  bool is_state_due_ = false;
  Time next_index_;
};

}  // namespace hedgehop::services
