#include <cstdio>

#include "bus/service.hpp"
#include "map_tiler_service.hpp"
#include "services/shared/service_start.hpp"

int main(int argc, char** argv) {
  using namespace hedgehop;
  bus::install_stop_signals();
  return bus::run_main("map_tiler", [&] {
    const auto arguments = bus::parse_service_arguments(
        argc, argv, "hedgehop-map-tiler", "Puts a map bundle on the bus, tile by tile",
        {{"--map", "MAP", "Map bundle, a folder made by `hedgehop prepare`"},
         {"--patches", "FILE", "Keeps patches over a restart: an LCM log, made when needed"}});
    if (!arguments) {
      return 0;
    }
    const auto config = services::load_config(arguments->config_file, "map_tiler.yaml");
    const auto options = services::read_map_tiler_options(config.reader());
    if (arguments->is_check) {
      std::puts("ok");
      return 0;
    }
    bus::Bus bus(arguments->bus);
    bus::BlobExchange exchange({.send_rate_bytesps = options.send_rate_bytesps}, bus);
    bus::ServiceLoop loop(bus, exchange, "map_tiler", config.hash());
    services::MapTilerService service(options, services::read_map(*arguments), bus, exchange,
                                      arguments->value("--patches"));
    loop.run(options.index_period_s, [&](Time now) { service.tick(now); });
    return 0;
  });
}
