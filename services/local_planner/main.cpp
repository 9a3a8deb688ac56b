#include <cstdio>

#include "local_planner_service.hpp"
#include "services/shared/service_start.hpp"

int main(int argc, char** argv) {
  using namespace hedgehop;
  bus::install_stop_signals();
  return bus::run_main("local_planner", [&] {
    const auto arguments = bus::parse_service_arguments(
        argc, argv, "hedgehop-local-planner", "Flies the command model along routes from the bus",
        {services::threads_option(),
         {"--lockstep", "", "Fly the command model of the service command_model, step by step"}});
    if (!arguments) {
      return 0;
    }
    const auto config = services::load_config(arguments->config_file, "local_planner.yaml");
    const auto options = services::LocalPlannerService::read_options(config.reader());
    if (arguments->is_check) {
      std::puts("ok");
      return 0;
    }
    services::keep_freed_memory();
    const services::ThreadLimit threads(*arguments);
    bus::Bus bus(arguments->bus);
    bus::BlobExchange exchange({.send_rate_bytesps = options.send_rate_bytesps}, bus);
    bus::ServiceLoop loop(bus, exchange, "local_planner", config.hash());
    services::LocalPlannerService service(options, bus, exchange, loop,
                                          !arguments->value("--lockstep").empty());
    loop.run(options.tick_period_s, [&](Time now) { service.tick(now); });
    return 0;
  });
}
