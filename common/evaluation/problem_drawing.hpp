#pragma once

#include <cstdint>
#include <vector>

#include "base/config_reader.hpp"
#include "geo/map_projection.hpp"
#include "map/map.hpp"

namespace hedgehop::evaluation {

/// Where start and goal of drawn problems may lie.
struct DrawingRules {
  double margin_m = 0.0;        // least distance of a cell's centre from the map's edge
  double distance_min_m = 0.0;  // least straight distance between start and goal
  std::int64_t draws_max = 0;   // pairs to draw at most
};

/// Reads its three keys out of an evaluation's section, which goes on being read. Throws
/// ConfigError.
DrawingRules read_drawing_rules(ConfigReader& reader);

/// Centres of two cells.
struct DrawnProblem {
  geo::MapPoint start;
  geo::MapPoint goal;
};

struct DrawnProblems {
  std::vector<DrawnProblem> problems;
  std::int64_t rejected_unknown = 0;  // draws with a cell without elevation
  std::int64_t rejected_near = 0;     // draws with start and goal too near to each other
};

/// Draws pairs of cells, each uniform over the cells that lie `margin_m` inside the map, until
/// `count` pairs have known elevation and are far enough apart. So start and goal are uniform over
/// the valid cells, given the distance. The same seed gives the same pairs on every machine, and a
/// greater count continues the list.
/// @throws DataError  if the map is too small for the rules, or `draws_max` draws did not do.
DrawnProblems draw_problems(const map::Map& map, const DrawingRules& rules, std::int64_t count,
                            std::uint64_t seed);

}  // namespace hedgehop::evaluation
