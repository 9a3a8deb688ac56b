#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace hedgehop {

/// Text of a file in config/ as it was at build time, by its path below config/: "planning.yaml".
/// Throws std::invalid_argument for a name that does not exist.
std::string_view shipped_config(std::string_view name);

/// Names of all of them, sorted.
std::vector<std::string> shipped_config_names();

}  // namespace hedgehop
