#pragma once

#include <cstdint>

#include "preparation/prepare.hpp"
#include "raster/grid.hpp"

namespace hedgehop::preparation {

/// How much each cell counts as a place from which is looked, for VisibilityGround::weight:
/// built-up ground first, then water, then forest and trees, else open. Empty if all kinds count
/// fully.
raster::Grid<std::uint8_t> ground_weights(const raster::Grid<std::uint16_t>& semantics,
                                          const GroundWeights& weights);

}  // namespace hedgehop::preparation
