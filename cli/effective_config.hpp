#pragma once

#include <string>
#include <vector>

#include "base/config_reader.hpp"

namespace hedgehop::cli {

/// A shipped config file with a user's file (empty: none) and `key=value` settings on top. Throws
/// ConfigError, and DataError if the user's file cannot be read.
ConfigReader effective_config(const std::string& shipped_file, const std::string& config_file,
                              const std::vector<std::string>& settings);

}  // namespace hedgehop::cli
