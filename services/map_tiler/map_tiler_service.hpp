#pragma once

#include "base/config_reader.hpp"
#include "base/time.hpp"
#include "bus/blob_exchange.hpp"
#include "bus/bus.hpp"
#include "bus/service.hpp"
#include "map/map.hpp"
#include "messages/map_messages.hpp"

namespace hedgehop::services {

/// config/map_tiler.yaml
struct MapTilerOptions {
  double index_period_s = 0.0;
  int tile_cells = 0;
  double send_rate_bytesps = 0.0;
};
MapTilerOptions read_map_tiler_options(ConfigReader reader);

/// The map that the option --map names. Throws UsageError without it, DataError for a damaged one.
map::Map read_map(const bus::ServiceArguments& arguments);

/// Puts one map on the bus: announces MAP_INDEX and serves the chunks of its blobs to whoever asks.
class MapTilerService {
 public:
  MapTilerService(const MapTilerOptions& options, const map::Map& map, bus::Bus& bus,
                  bus::BlobExchange& exchange);

  void tick(Time now);

 private:
  MapTilerOptions options_;
  bus::Bus& bus_;
  messages::MapIndex index_;
  Time next_index_;
};

}  // namespace hedgehop::services
