#pragma once

#include <filesystem>
#include <vector>

#include "flight/plan.hpp"
#include "map/map.hpp"

namespace hedgehop::planning {

/// The map with the areas of a request among its own, and the hash that belongs to it.
///
/// @throws DataError  a corner has no place on the map.
map::Map map_with_areas(map::Map map, const std::vector<flight::RequestArea>& areas);

/// The map that a plan was made on: a bundle, with the areas of the plan's request and, if its
/// config weighs them, the layers of named observers.
///
/// @param plan_name  what errors call the plan.
/// @throws UsageError  it is another map.
map::Map read_map_of_plan(const std::filesystem::path& bundle, const flight::Plan& plan,
                          const std::string& plan_name);
/// The same with a map that was read before, and what errors call it.
map::Map map_of_plan(map::Map map, const flight::Plan& plan, const std::string& plan_name,
                     const std::string& map_name);

/// Areas of a map as a request states them.
std::vector<flight::RequestArea> request_areas_of(const std::vector<map::Area>& areas,
                                                  const geo::MapProjection& projection);

}  // namespace hedgehop::planning
