#pragma once

#include <filesystem>
#include <optional>

#include "base/observer.hpp"
#include "map/map.hpp"
#include "map_sources/synthetic_region.hpp"

namespace hedgehop::cli {

/// Prepares a synthetic region with the shipped preparation config and writes the bundle into
/// `folder`, which it makes.
///
/// @param cell_m  none: as the config says
map::Map prepare_synthetic_map(const map_sources::SyntheticRegion& region,
                               const std::filesystem::path& folder, std::optional<double> cell_m,
                               int threads, Observer& observer);

}  // namespace hedgehop::cli
