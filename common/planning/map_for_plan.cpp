#include "planning/map_for_plan.hpp"

#include <cstdlib>

#include "base/config_entries.hpp"
#include "base/errors.hpp"
#include "map/map_bundle.hpp"

namespace hedgehop::planning {

map::Map with_threats(map::Map map, const std::filesystem::path& bundle) {
  const std::filesystem::path file = bundle / map::kThreatsFile;
  std::error_code error;
  if (std::filesystem::exists(file, error)) {
    map.threats = map::read_height_bands(map, file);
    map::validate_threats(map);
    map.hash = map::map_hash(map);
  }
  return map;
}

map::Map read_map_for(const std::filesystem::path& bundle, const PlanningConfig& config) {
  map::Map map = map::read_map_bundle(bundle);
  if (config.weights.threats > 0.0) {
    map = with_threats(std::move(map), bundle);
    require_threats(map, config);
  }
  return map;
}

bool weighs_threats(const std::string& config_text) {
  try {
    for (const ConfigEntry& entry : config_entries(config_text, "config")) {
      if (entry.key == "weights.threats") {
        return std::strtod(entry.value.c_str(), nullptr) > 0.0;
      }
    }
  } catch (const ConfigError&) {  // is told where the config is needed
  }
  return false;
}

void require_threats(const map::Map& map, const PlanningConfig& config) {
  if (config.weights.threats > 0.0 && map.threats.empty()) {
    throw UsageError(
        "weights.threats gives a weight to being seen by named observers, but the map knows none",
        "hedgehop prepare --observers FILE makes their layer, threats.tif; services have it where "
        "hedgehop serve --map MAP found it beside the map. Or set weights.threats=0");
  }
}

}  // namespace hedgehop::planning
