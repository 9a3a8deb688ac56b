#pragma once

#include "base/config_reader.hpp"
#include "console.hpp"

namespace hedgehop::cli {

/// The verbs of local planning below `evaluate`: table2 and local-safety.
void add_local_evaluation_verbs(CLI::App& evaluate, Console& console);

/// Reads the sections of the evaluation config that they use. Throws ConfigError.
void read_local_evaluation_config(ConfigReader& reader);

}  // namespace hedgehop::cli
