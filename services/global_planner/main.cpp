#include <cstdio>

#include "global_planner_service.hpp"
#include "services/shared/service_start.hpp"

int main(int argc, char** argv) {
  using namespace hedgehop;
  bus::install_stop_signals();
  return bus::run_main("global_planner", [&] {
    const auto arguments = bus::parse_service_arguments(
        argc, argv, "hedgehop-global-planner",
        "Plans routes for the requests that come over the bus", {services::threads_option()});
    if (!arguments) {
      return 0;
    }
    const auto config = services::load_config(arguments->config_file, "global_planner.yaml");
    const auto options = services::read_planner_options(config.reader());
    if (arguments->is_check) {
      std::puts("ok");
      return 0;
    }
    services::keep_freed_memory();
    const services::ThreadLimit threads(*arguments);
    bus::Bus bus(arguments->bus);
    bus::BlobExchange exchange({.send_rate_bytesps = options.send_rate_bytesps}, bus);
    bus::ServiceLoop loop(bus, exchange, "global_planner", config.hash());
    services::GlobalPlannerService service(options, bus, exchange, loop);
    loop.run(options.tick_period_s, [&](Time now) { service.tick(now); });
    return 0;
  });
}
