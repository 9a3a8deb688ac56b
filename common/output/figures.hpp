#pragma once

#include <filesystem>

#include "base/observer.hpp"
#include "flight/plan.hpp"
#include "map/map.hpp"

namespace hedgehop::output {

/// Draws the paper's figures 9 and 10 for a plan into `folder` (created): `map.png`, both paths on
/// surface, visibility and semantics; `profile.png`, height, bank and heading over distance; with
/// the gnuplot scripts and data beside them. Throws SystemFailure if gnuplot is missing or fails.
void write_figures(const flight::Plan& plan, const map::Map& map,
                   const std::filesystem::path& folder);

}  // namespace hedgehop::output
