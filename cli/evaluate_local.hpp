#pragma once

#include "console.hpp"

namespace hedgehop::cli {

/// The verbs of local planning below `evaluate`: table2 and local-safety.
void add_local_evaluation_verbs(CLI::App& evaluate, Console& console);

}  // namespace hedgehop::cli
