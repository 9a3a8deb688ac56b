#pragma once

#include "console.hpp"

namespace hedgehop::cli {

/// The verbs `evaluate table3` and `evaluate sensitivity`.
void add_framework_evaluation_verbs(CLI::App& evaluate, Console& console);

}  // namespace hedgehop::cli
