#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "base/observer.hpp"
#include "map_sources/land_use_source.hpp"
#include "map_sources/vector_mapping.hpp"

namespace hedgehop::map_sources {

/// A vector file of any kind that OGR reads, and what its layers mean.
struct VectorInput {
  std::filesystem::path file;
  VectorMapping mapping;
};

/// What was found in one of them.
struct VectorFindings {
  std::string format;                         // OGR's name of it: "GPKG"
  std::vector<std::filesystem::path> parts;   // files it consists of
  std::vector<std::int64_t> objects_of_rule;  // in the order of the mapping's rules
  std::int64_t unmapped_feature_count = 0;    // of the mapping's layers, that no rule fits
  std::int64_t unusable_feature_count = 0;    // coordinates not finite, wrong kind of geometry
};

/// Adds a vector file's objects that touch `region`, and what it has mapped, to `land_use`.
///
/// Areas of any class may be polygons, lines or points; overhead lines must be lines, each vertex
/// is a support. Curves become chords. Heights: the rule's attribute, if it states one in (0, 1000]
/// m (other values count as unreadable, missing ones do not), else storeys, else the default.
/// Coordinates are rounded to 1 mm.
///
/// @throws DataError    the file is missing, damaged or no vector file, a layer states no
/// coordinate
///                      system.
/// @throws ConfigError  the mapping names a layer or attribute that the file lacks; with the place
///                      of the rule and what the file has.
/// @throws Interrupted
VectorFindings read_vectors(const VectorInput& input, const geo::MapProjection& projection,
                            const geo::GeodeticBox& region, LandUse& land_use, Observer& observer);

}  // namespace hedgehop::map_sources
