#pragma once

#include <filesystem>
#include <string>

#include "geo/map_projection.hpp"
#include "map/map.hpp"

namespace hedgehop::map {

/// What a bundle is, for people: place, size, CRS, datum, sources, unknown parts, land use,
/// attributions. `manifest_json` is read_map_manifest() of the same bundle.
std::string map_description_text(const Map& map, const std::string& manifest_json);

/// The same as a JSON object: the manifest's entries, and "statistics" of the layers.
std::string map_description_json(const Map& map, const std::string& manifest_json);

/// What the map says about the cell that holds a place: elevations, height of what stands there,
/// semantic classes, visibility; NaN of a layer is null in JSON and "unknown" in text. Areas that
/// lie over or under the place itself, and obstacles whose radius holds it.
/// With the bundle's folder also where those heights come from: the elevation file, and whether the
/// height of what stands there is stated, counted by storeys or guessed.
/// Throws DataError if the place lies outside the map or the map has no coordinate system.
std::string place_description_text(const Map& map, const geo::GeodeticPosition& position,
                                   const std::filesystem::path& folder = {});
std::string place_description_json(const Map& map, const geo::GeodeticPosition& position,
                                   const std::filesystem::path& folder = {});

}  // namespace hedgehop::map
