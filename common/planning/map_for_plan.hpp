#pragma once

#include <filesystem>

#include "map/map.hpp"
#include "planning/planning.hpp"

namespace hedgehop::planning {

/// A bundle as plans under this config need it: with the layers of its named observers, and the
/// hash that belongs to them, if the config gives these a weight (weights.threats); else as it is.
///
/// @throws DataError, UsageError  as map::read_map_bundle(); the weight is given and the bundle has
///                                no threats.tif.
map::Map read_map_for(const std::filesystem::path& bundle, const PlanningConfig& config);

/// The layers of the named observers of a bundle added to its map, and the hash that belongs to it.
map::Map with_threats(map::Map map, const std::filesystem::path& bundle);

/// Throws UsageError if the config weighs named observers and the map knows none.
void require_threats(const map::Map& map, const PlanningConfig& config);

}  // namespace hedgehop::planning
