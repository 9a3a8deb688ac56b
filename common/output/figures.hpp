#pragma once

#include <filesystem>

#include "flight/plan.hpp"
#include "flight/route_choice.hpp"
#include "map/map.hpp"

namespace hedgehop::output {

/// Draws the paper's figures 9 and 10 for a plan into `folder`, which is created if it is missing:
/// `map.png`, both paths on surface, visibility and semantics; `profile.png`, altitude, height,
/// bank and heading over distance; `plan.png`, both together; each as SVG and PDF too. The gnuplot
/// scripts and data that made them stay beside them, so that they can be drawn again in another
/// style.
///
/// Label and attribution lines of the map stand on each figure. Angles are in degrees, headings
/// from true north, as people read them.
///
/// @throws SystemFailure  gnuplot is missing or fails, a file cannot be written.
/// @throws DataError      the plan has fewer than two states or waypoints, or lies outside the map.
/// @note  About 4 s, most of it gnuplot.
void write_figures(const flight::Plan& plan, const map::Map& map,
                   const std::filesystem::path& folder);

/// Draws routes to choose from into `folder`/alternatives: `alternatives.png`, `.svg` and `.pdf`,
/// the maps of `map.png` with each route in a colour of its own and, below the title, what it is
/// chosen by. `plan` is the one that they are alternatives to. Errors as above.
void write_choice_figure(const flight::Plan& plan, const map::Map& map,
                         const flight::RouteChoices& choices, const std::filesystem::path& folder);

}  // namespace hedgehop::output
