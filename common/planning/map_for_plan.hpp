#pragma once

#include <filesystem>
#include <string>

#include "map/map.hpp"
#include "planning/planning.hpp"

namespace hedgehop::planning {

/// A bundle as plans under this config need it: with the layers of its named observers, and the
/// hash that belongs to them, if the config gives these a weight (weights.threats); else as it is.
///
/// @throws DataError, UsageError  as map::read_map_bundle(); the weight is given and the bundle has
///                                no threats.tif.
map::Map read_map_for(const std::filesystem::path& bundle, const PlanningConfig& config);

/// The layers of the named observers of a bundle added to its map, and the hash that belongs to it;
/// the map as it is if the bundle has none.
///
/// @throws DataError  threats.tif does not lie on the map's cells or holds what is no height.
map::Map with_threats(map::Map map, const std::filesystem::path& bundle);

/// Whether an effective planning config, as text, gives named observers a weight. False for a text
/// that cannot be read.
bool weighs_threats(const std::string& config_text);

/// Throws UsageError if the config weighs named observers and the map knows none.
void require_threats(const map::Map& map, const PlanningConfig& config);

}  // namespace hedgehop::planning
