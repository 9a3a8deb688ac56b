#pragma once

#include <string>

#include "bus/bus.hpp"

namespace CLI {
class App;
}

namespace hedgehop::cli {

/// The options of every verb that goes on the bus: --lcm-url and --channel-prefix.
struct BusArguments {
  std::string lcm_url;
  std::string channel_prefix;

  void add_to(CLI::App& verb);
  [[nodiscard]] bus::BusOptions options() const { return {lcm_url, channel_prefix}; }
};

}  // namespace hedgehop::cli
