#pragma once

#include "base/config_reader.hpp"
#include "console.hpp"

namespace hedgehop::cli {

/// The verbs `evaluate table3` and `evaluate sensitivity`.
void add_framework_evaluation_verbs(CLI::App& evaluate, Console& console);

/// Reads their sections of the evaluation config. Throws ConfigError.
void read_framework_evaluation_config(ConfigReader& reader);

}  // namespace hedgehop::cli
