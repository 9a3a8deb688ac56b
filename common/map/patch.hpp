#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "geo/map_projection.hpp"
#include "map/map.hpp"

namespace hedgehop::map {

enum class PatchKind : std::int8_t { kObstacle = 0, kThreat = 1, kArea = 2 };
/// "obstacle", "threat", "area".
const char* name_of(PatchKind kind);

/// Something that appears over a base map: an obstacle to fly around, an observer who looks, or an
/// area that must not be entered or that costs.
struct Patch {
  std::int64_t id = 0;  // from 1; chosen by whoever says so, the same when the thing changes
  PatchKind kind = PatchKind::kObstacle;
  // Of an obstacle or a threat
  geo::MapPoint centre;
  double radius_m = 0.0;  // of the cylinder that holds an obstacle; how far an observer sees
  // Top of an obstacle, eye of an observer. At least one is stated; with both the higher one counts
  std::optional<double> height_m;  // above the ground
  std::optional<double> top_m;     // AMSL
  // Of an area
  bool is_hard = true;
  AreaLimit floor;
  AreaLimit ceiling;
  std::vector<geo::MapPoint> outline;  // 3 corners and more, the first one not repeated
  std::string label;                   // shown to people

  bool operator==(const Patch& other) const;
};

}  // namespace hedgehop::map
