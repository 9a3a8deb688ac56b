#pragma once

#include "console.hpp"

namespace hedgehop::cli {

/// `hedgehop evaluate flight`: how well plans are kept by what flies them.
void add_flight_evaluation_verb(CLI::App& evaluate, Console& console);

}  // namespace hedgehop::cli
