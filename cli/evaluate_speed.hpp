#pragma once

#include "console.hpp"

namespace CLI {
class App;
}

namespace hedgehop::cli {

/// The verb local-speed below `evaluate`.
void add_local_speed_verb(CLI::App& evaluate, Console& console);

}  // namespace hedgehop::cli
