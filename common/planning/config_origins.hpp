#pragma once

#include <string>
#include <vector>

namespace hedgehop::planning {

/// Where a value of the effective planning config comes from.
struct ConfigOrigin {
  std::string key;  // "weights.visibility"
  std::string value;
  std::string source;  // "config/planning.yaml" or "config/vehicles/..." as shipped, a file, or
                       // "--set key=value"
  int line = 0;        // in that file; 0 for a setting
};
/// Of every value of effective_planning_config(), in its order. Throws as that.
std::vector<ConfigOrigin> planning_config_origins(const std::string& config_file,
                                                  const std::vector<std::string>& settings);

}  // namespace hedgehop::planning
