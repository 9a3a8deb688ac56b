#include "map_tiler_service.hpp"

#include "base/errors.hpp"
#include "bus/map_exchange.hpp"
#include "map/map_bundle.hpp"

namespace hedgehop::services {

MapTilerOptions read_map_tiler_options(ConfigReader reader) {
  MapTilerOptions options;
  options.index_period_s = reader.required_double("index_period_s");
  options.tile_cells = static_cast<int>(reader.required_integer("tile_cells"));
  options.send_rate_bytesps = reader.required_double("send_rate_bytesps");
  reader.finish();
  reader.require(options.index_period_s >= 0.05 && options.index_period_s <= 10.0, "index_period_s",
                 "must lie between 0.05 and 10");
  reader.require(options.tile_cells >= 16 && options.tile_cells <= 1024, "tile_cells",
                 "must lie between 16 and 1024");
  reader.require(options.send_rate_bytesps >= 1e4 && options.send_rate_bytesps <= 1e9,
                 "send_rate_bytesps", "must lie between 1e4 and 1e9");
  return options;
}

map::Map read_map(const bus::ServiceArguments& arguments) {
  const std::string folder = arguments.value("--map");
  if (folder.empty()) {
    throw UsageError("no map given", "--map MAP, a folder made by `hedgehop prepare`");
  }
  return map::read_map_bundle(folder);
}

MapTilerService::MapTilerService(const MapTilerOptions& options, const map::Map& map, bus::Bus& bus,
                                 bus::BlobExchange& exchange)
    : options_(options), bus_(bus), index_(bus::offer_map(map, options.tile_cells, exchange)) {}

void MapTilerService::tick(Time now) {
  if (now >= next_index_) {
    next_index_ = now + options_.index_period_s;
    bus_.publish(messages::kMapIndexChannel, index_, now);
  }
}

}  // namespace hedgehop::services
