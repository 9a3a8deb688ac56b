#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace hedgehop {

/// A value of a document: "weights.visibility", "25.0" and its line from 1. Lists are one value.
struct ConfigEntry {
  std::string key;
  std::string value;
  int line = 0;
};
/// All of them, in the order of the document.
std::vector<ConfigEntry> config_entries(std::string_view text, const std::string& name);

}  // namespace hedgehop
