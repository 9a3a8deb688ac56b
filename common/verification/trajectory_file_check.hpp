#pragma once

#include <string>
#include <vector>

#include "flight/trajectory.hpp"
#include "geo/map_projection.hpp"
#include "verification/findings.hpp"

namespace hedgehop::verification {

/// Checks the columns of trajectory.csv that follow from others and that nobody reads back:
/// `latitude_deg` and `longitude_deg` against x and y (rule `position_columns`, 1 cm),
/// `height_above_surface_m` (`height_column`, 1e-6 m) and `heading_grid_rad`
/// (`heading_grid_column`, 1e-9 rad). A file without them, or that has not one line for each state,
/// breaks the rule `trajectory_file`.
/// @param projection  of the map; null for a map without coordinate system
void check_trajectory_file(const std::string& csv, const geo::MapProjection* projection,
                           const std::vector<flight::FlightState>& states, Findings& findings);

}  // namespace hedgehop::verification
