#pragma once

#include <filesystem>
#include <vector>

#include "flight/route.hpp"
#include "map/map.hpp"

namespace hedgehop::cli {

/// The waypoints of a mission file, in the map's frame and vertical datum: a QGroundControl `.plan`
/// or a waypoint list "QGC WPL 110", whose heights must be above mean sea level (EGM96, frame 0).
/// The home position is no waypoint; commands without a place are passed over. Read without the
/// code that writes such files.
/// @throws DataError  naming file and item: no such file, damaged, heights relative to home or
///                    terrain, commands that are not flown as straight legs, too many of them.
std::vector<flight::Waypoint> read_leg_file(const std::filesystem::path& file, const map::Map& map);

}  // namespace hedgehop::cli
