#include <cstdio>

#include "command_model_service.hpp"
#include "services/shared/service_start.hpp"

int main(int argc, char** argv) {
  using namespace hedgehop;
  bus::install_stop_signals();
  return bus::run_main("command_model", [&] {
    const auto arguments = bus::parse_service_arguments(
        argc, argv, "hedgehop-command-model",
        "Flies trajectories with the command model in real time, and steps it on request", {});
    if (!arguments) {
      return 0;
    }
    const auto config = services::load_config(arguments->config_file, "command_model.yaml");
    const auto options = services::read_command_model_options(config.reader());
    if (arguments->is_check) {
      std::puts("ok");
      return 0;
    }
    bus::Bus bus(arguments->bus);
    bus::BlobExchange exchange({}, bus);
    bus::ServiceLoop loop(bus, exchange, "command_model", config.hash());
    services::CommandModelService service(options, bus, exchange, loop, services::shipped_rotor());
    loop.run(options.tick_period_s, [&](Time now) { service.tick(now); });
    return 0;
  });
}
