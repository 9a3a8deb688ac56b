#pragma once

#include "console.hpp"

namespace hedgehop::cli {

/// `hedgehop evaluate bus`: what the bus costs.
void add_bus_evaluation_verb(CLI::App& evaluate, Console& console);

}  // namespace hedgehop::cli
