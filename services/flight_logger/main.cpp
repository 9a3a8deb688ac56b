#include <cstdio>

#include "flight_logger_service.hpp"
#include "services/shared/service_start.hpp"

int main(int argc, char** argv) {
  using namespace hedgehop;
  bus::install_stop_signals();
  return bus::run_main("flight_logger", [&] {
    const auto arguments = bus::parse_service_arguments(
        argc, argv, "hedgehop-flight-logger", "Records everything on the bus in an LCM log",
        {{"--out", "FILE", "The log; it must not exist yet"}});
    if (!arguments) {
      return 0;
    }
    const auto config = services::load_config(arguments->config_file, "flight_logger.yaml");
    const auto options = services::read_flight_logger_options(config.reader());
    if (arguments->is_check) {
      std::puts("ok");
      return 0;
    }
    bus::Bus bus(arguments->bus);
    bus::BlobExchange exchange({}, bus);
    bus::ServiceLoop loop(bus, exchange, "flight_logger", config.hash());
    services::FlightLoggerService service(options, services::log_file(*arguments), bus, exchange,
                                          loop);
    loop.run(options.tick_period_s, [&](Time now) { service.tick(now); });
    return 0;
  });
}
