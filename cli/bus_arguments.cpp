#include "bus_arguments.hpp"

#include <CLI/CLI.hpp>

namespace hedgehop::cli {

void BusArguments::add_to(CLI::App& verb) {
  verb.add_option(
      "--lcm-url", lcm_url,
      std::string("Where the bus is (default: LCM_DEFAULT_URL of the environment, else ") +
          bus::kDefaultUrl + "); ?ttl=1 crosses the local network");
  verb.add_option("--channel-prefix", channel_prefix,
                  "Put before every channel name, so that several aircraft share a network");
}

}  // namespace hedgehop::cli
