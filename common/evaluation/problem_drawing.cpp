#include "evaluation/problem_drawing.hpp"

#include <algorithm>
#include <cmath>
#include <random>
#include <sstream>

#include "base/errors.hpp"

namespace hedgehop::evaluation {
namespace {

// Uniform over [0, bound); std::uniform_int_distribution differs between standard libraries.
std::uint64_t drawn_below(std::uint64_t bound, std::mt19937_64& random) {
  const std::uint64_t unfair = (std::mt19937_64::max() % bound + 1) % bound;
  std::uint64_t value = random();
  while (value > std::mt19937_64::max() - unfair) {
    value = random();
  }
  return value % bound;
}

}  // namespace

DrawingRules read_drawing_rules(ConfigReader& reader) {
  DrawingRules rules;
  rules.margin_m = reader.required_double("margin_m");
  rules.distance_min_m = reader.required_double("distance_min_m");
  rules.draws_max = reader.required_integer("draws_max");
  reader.require(rules.margin_m >= 0.0, "margin_m", "must not be negative");
  reader.require(rules.distance_min_m > 0.0, "distance_min_m", "must be above 0");
  reader.require(rules.draws_max >= 1, "draws_max", "must be above 0");
  return rules;
}

DrawnProblems draw_problems(const map::Map& map, const DrawingRules& rules, std::int64_t count,
                            std::uint64_t seed) {
  const raster::GridGeometry& geometry = map.geometry;
  // The centre of cell k lies (k + 1/2) cells from the edge.
  const int inset =
      std::max(0, static_cast<int>(std::ceil(rules.margin_m / geometry.cell_m - 0.5)));
  const int columns = geometry.columns - 2 * inset;
  const int rows = geometry.rows - 2 * inset;
  const double width_m = (columns - 1) * geometry.cell_m;
  const double height_m = (rows - 1) * geometry.cell_m;
  if (columns < 1 || rows < 1 ||
      std::sqrt(width_m * width_m + height_m * height_m) < rules.distance_min_m) {
    std::ostringstream what;
    what << "the map (" << geometry.columns * geometry.cell_m << " by "
         << geometry.rows * geometry.cell_m << " m) has no two places " << rules.distance_min_m
         << " m apart and " << rules.margin_m << " m inside it";
    throw DataError(what.str(), "prepare a larger map");
  }

  std::mt19937_64 random(seed);
  const auto drawn_cell = [&] {
    const auto column = static_cast<int>(drawn_below(static_cast<std::uint64_t>(columns), random));
    const auto row = static_cast<int>(drawn_below(static_cast<std::uint64_t>(rows), random));
    return raster::CellIndex{inset + column, inset + row};
  };
  const auto is_known = [&](raster::CellIndex cell) {
    return !std::isnan(map.terrain_m.at(cell)) && !std::isnan(map.surface_m.at(cell));
  };
  DrawnProblems drawn;
  for (std::int64_t draw = 0; static_cast<std::int64_t>(drawn.problems.size()) < count; ++draw) {
    if (draw == rules.draws_max) {
      std::ostringstream what;
      what << "only " << drawn.problems.size() << " of " << count << " problems found in " << draw
           << " draws: " << drawn.rejected_unknown << " hit cells without elevation, "
           << drawn.rejected_near << " were too near to each other";
      throw DataError(what.str(), "prepare a larger map, or one with fewer voids");
    }
    const raster::CellIndex start = drawn_cell();
    const raster::CellIndex goal = drawn_cell();
    if (!is_known(start) || !is_known(goal)) {
      ++drawn.rejected_unknown;
      continue;
    }
    const DrawnProblem problem{geometry.centre(start), geometry.centre(goal)};
    const double dx_m = problem.goal.x_m - problem.start.x_m;
    const double dy_m = problem.goal.y_m - problem.start.y_m;
    if (std::sqrt(dx_m * dx_m + dy_m * dy_m) < rules.distance_min_m) {
      ++drawn.rejected_near;
      continue;
    }
    drawn.problems.push_back(problem);
  }
  return drawn;
}

}  // namespace hedgehop::evaluation
