#include "local_planning/surroundings.hpp"

#include <algorithm>
#include <limits>
#include <numbers>
#include <vector>

namespace hedgehop::local_planning {
namespace {

// Raises each cell to the one `right` and `up` cells from it, within the grid.
void raise_by_neighbour(const raster::Grid<float>& from, int right, int up,
                        raster::Grid<float>& to) {
  const raster::GridGeometry& g = to.geometry();
  const int first = std::max(0, -right);
  const int end = std::min(g.columns, g.columns - right);
  for (int row = std::max(0, -up); row < std::min(g.rows, g.rows - up); ++row) {
    const float* const source = from.row(row + up);
    float* const target = to.row(row);
    for (int column = first; column < end; ++column) {
      target[column] = std::max(target[column], source[column + right]);
    }
  }
}

}  // namespace

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

  raster::Grid<float> ground_m = dilated_m_;  // what counts there
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
      ground_m.at(column + padding, row + padding) = here_m;
    }
  }
  const int reach = static_cast<int>(disc_radius_m / cell_m);
  for (int up = -reach; up <= reach; ++up) {
    for (int right = -reach; right <= reach; ++right) {
      if (cell_m * cell_m * (up * up + right * right) <= disc_radius_m * disc_radius_m) {
        raise_by_neighbour(ground_m, right, up, dilated_m_);
      }
    }
  }
  risk_max_ = static_cast<double>(risk_max);
}

void Surroundings::pack(double tube_radius_m) {
  const raster::GridGeometry& g = geometry();
  // The centres that a place is interpolated between lie within a cell of it on both axes; as seen
  // from the square of a place at most half a cell away, within half a cell of that.
  const bool is_wide = tube_radius_m >= 0.5 * std::numbers::sqrt2 * g.cell_m;
  sure_reach_m_ =
      std::max(is_wide ? 0.5 * g.cell_m : -1.0, tube_radius_m - std::numbers::sqrt2 * g.cell_m);
  // Half the width of the part of each row that counts, from the row of the
  // cell itself outwards.
  const double half_m = 0.5 * g.cell_m;
  std::vector<int> widths;
  for (int up = 0;; ++up) {
    const double up_m = std::max(0.0, up * g.cell_m - half_m);
    if (up_m > tube_radius_m) {
      break;
    }
    const double aside_m = std::sqrt(tube_radius_m * tube_radius_m - up_m * up_m);
    widths.push_back(static_cast<int>((aside_m + half_m) / g.cell_m));
  }
  raster::Grid<float> greatest = surface_m_;
  raster::Grid<float> along = surface_m_;  // greatest of each row within `width` cells
  std::vector<float> before(static_cast<std::size_t>(g.columns));
  int width = 0;
  for (int up = static_cast<int>(widths.size()) - 1; up >= 0; --up) {
    for (; width < widths[static_cast<std::size_t>(up)]; ++width) {
      for (int row = 0; row < g.rows; ++row) {
        float* const values = along.row(row);
        std::copy_n(values, g.columns, before.data());
        for (int column = 0; column < g.columns; ++column) {
          const float left =
              column > 0 ? before[static_cast<std::size_t>(column) - 1] : kBlockedAltitude_m;
          const float right = column + 1 < g.columns ? before[static_cast<std::size_t>(column) + 1]
                                                     : kBlockedAltitude_m;
          values[column] = std::max(values[column], std::max(left, right));
        }
      }
    }
    for (int row = 0; row < g.rows; ++row) {
      float* const values = greatest.row(row);
      for (const int from : {row - up, row + up}) {
        if (from < 0 || from >= g.rows) {
          std::fill_n(values, g.columns, kBlockedAltitude_m);
          continue;
        }
        const float* const other = along.row(from);
        for (int column = 0; column < g.columns; ++column) {
          values[column] = std::max(values[column], other[column]);
        }
      }
    }
  }
  const float risk_scale =
      risk_max_ > 0.0 ? static_cast<float>(PackedGround::kRiskMax / risk_max_) : 0.0F;
  packed_ = raster::Grid<std::uint32_t>(g, 0);
  for (std::size_t i = 0; i < packed_.values().size(); ++i) {
    // In double precision: rounding must not make the ground lower.
    const double above_m = static_cast<double>(std::clamp(
                               greatest.values()[i], PackedGround::kLowest_m, kBlockedAltitude_m)) -
                           static_cast<double>(PackedGround::kLowest_m);
    const double steps = std::ceil(above_m * static_cast<double>(PackedGround::kStepsPerMetre));
    const auto risk = static_cast<std::uint32_t>(risk_.values()[i] * risk_scale + 0.5F);
    packed_.values()[i] = static_cast<std::uint32_t>(steps) << PackedGround::kRiskBits |
                          std::min(risk, PackedGround::kRiskMax);
  }
}

}  // namespace hedgehop::local_planning
