#include "local_planning/surroundings.hpp"

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

namespace hedgehop::local_planning {

Surroundings::Surroundings(const risk::CostModel& costs, double window_m, double disc_radius_m,
                           double semantics_weight, double visibility_weight)
    : map_geometry_(costs.map().geometry) {
  const double cell_m = map_geometry_.cell_m;
  const int padding = static_cast<int>(std::ceil(window_m / cell_m)) + 2;
  raster::GridGeometry padded = map_geometry_;
  padded.west_m -= padding * cell_m;
  padded.south_m -= padding * cell_m;
  padded.columns += 2 * padding;
  padded.rows += 2 * padding;
  surface_m_ = raster::Grid<float>(padded, kBlockedAltitude_m);
  risk_ = raster::Grid<float>(padded, static_cast<float>(semantics_weight + visibility_weight));
  dilated_m_ = raster::Grid<float>(padded, -std::numeric_limits<float>::infinity());
  float risk_max = risk_.at(0, 0);

  std::vector<std::pair<int, int>> disc;
  const int reach = static_cast<int>(disc_radius_m / cell_m);
  for (int row = -reach; row <= reach; ++row) {
    for (int column = -reach; column <= reach; ++column) {
      if (cell_m * cell_m * (row * row + column * column) <= disc_radius_m * disc_radius_m) {
        disc.emplace_back(column, row);
      }
    }
  }
  const raster::Grid<float>& surface_m = costs.map().surface_m;
  for (int row = 0; row < map_geometry_.rows; ++row) {
    for (int column = 0; column < map_geometry_.columns; ++column) {
      float here_m = surface_m.at(column, row);
      if (std::isnan(here_m)) {
        continue;
      }
      const double wall_m = costs.areas().wall_top_m({column, row}, kAreaFloor_m);
      if (wall_m > static_cast<double>(here_m)) {
        if (wall_m > static_cast<double>(here_m) + kAreaClimb_m) {
          continue;  // stays a wall
        }
        here_m = static_cast<float>(wall_m);
      }
      surface_m_.at(column + padding, row + padding) = here_m;
      const auto risk = static_cast<float>(
          semantics_weight * static_cast<double>(costs.semantics_layer().at(column, row)) +
          visibility_weight * static_cast<double>(costs.visibility_layer().at(column, row)));
      risk_.at(column + padding, row + padding) = risk;
      risk_max = std::max(risk_max, risk);
      for (const auto& [right, up] : disc) {
        const raster::CellIndex cell{column + padding + right, row + padding + up};
        if (padded.contains(cell)) {
          dilated_m_.at(cell) = std::max(dilated_m_.at(cell), here_m);
        }
      }
    }
  }
  risk_max_ = static_cast<double>(risk_max);
}

}  // namespace hedgehop::local_planning
