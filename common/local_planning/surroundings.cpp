#include "local_planning/surroundings.hpp"

#include <algorithm>
#include <cstdlib>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

namespace hedgehop::local_planning {
namespace {

constexpr float kNoGround_m = -std::numeric_limits<float>::infinity();

// What counts as ground: no ground is as high as a wall.
float ground_of(float surface_m) {
  return surface_m == Surroundings::kBlockedAltitude_m ? kNoGround_m : surface_m;
}

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

std::optional<Surroundings::Cell> Surroundings::cell_of(const risk::CostModel& costs,
                                                        raster::CellIndex cell) const {
  float here_m = costs.map().surface_m.at(cell);
  if (std::isnan(here_m)) {
    return std::nullopt;
  }
  const double wall_m = costs.areas().wall_top_m(cell, kAreaFloor_m);
  if (wall_m > static_cast<double>(here_m)) {
    if (wall_m > static_cast<double>(here_m) + kAreaClimb_m) {
      return std::nullopt;
    }
    here_m = static_cast<float>(wall_m);
  }
  return Cell{here_m,
              static_cast<float>(
                  semantics_weight_ * static_cast<double>(costs.semantics_layer().at(cell)) +
                  visibility_weight_ * static_cast<double>(costs.visibility_layer().at(cell)))};
}

Surroundings::Surroundings(const risk::CostModel& costs, double window_m, double disc_radius_m,
                           double semantics_weight, double visibility_weight)
    : window_m_(window_m),
      disc_radius_m_(disc_radius_m),
      semantics_weight_(semantics_weight),
      visibility_weight_(visibility_weight),
      padding_(static_cast<int>(std::ceil(window_m / costs.map().geometry.cell_m)) + 2),
      map_geometry_(costs.map().geometry) {
  const double cell_m = map_geometry_.cell_m;
  raster::GridGeometry padded = map_geometry_;
  padded.west_m -= padding_ * cell_m;
  padded.south_m -= padding_ * cell_m;
  padded.columns += 2 * padding_;
  padded.rows += 2 * padding_;
  surface_m_ = raster::Grid<float>(padded, kBlockedAltitude_m);
  risk_ = raster::Grid<float>(padded, static_cast<float>(semantics_weight + visibility_weight));
  dilated_m_ = raster::Grid<float>(padded, kNoGround_m);
  float risk_max = risk_.at(0, 0);

  raster::Grid<float> ground_m = dilated_m_;  // what counts there
  for (int row = 0; row < map_geometry_.rows; ++row) {
    for (int column = 0; column < map_geometry_.columns; ++column) {
      const std::optional<Cell> cell = cell_of(costs, {column, row});
      if (!cell) {
        continue;
      }
      const raster::CellIndex at{column + padding_, row + padding_};
      surface_m_.at(at) = cell->surface_m;
      risk_.at(at) = cell->risk;
      risk_max = std::max(risk_max, cell->risk);
      ground_m.at(at) = ground_of(cell->surface_m);
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

float Surroundings::greatest_in_disc_m(raster::CellIndex cell) const {
  const double cell_m = map_geometry_.cell_m;
  const int reach = static_cast<int>(disc_radius_m_ / cell_m);
  float greatest_m = kNoGround_m;
  for (int up = -reach; up <= reach; ++up) {
    for (int right = -reach; right <= reach; ++right) {
      const raster::CellIndex other{cell.column + right, cell.row + up};
      if (cell_m * cell_m * (up * up + right * right) <= disc_radius_m_ * disc_radius_m_ &&
          geometry().contains(other)) {
        greatest_m = std::max(greatest_m, ground_of(surface_m_.at(other)));
      }
    }
  }
  return greatest_m;
}

float Surroundings::greatest_in_tube_m(raster::CellIndex cell) const {
  const int reach = static_cast<int>(tube_widths_.size()) - 1;
  float greatest_m = surface_m_.at(cell);
  for (int up = -reach; up <= reach; ++up) {
    const int width = tube_widths_[static_cast<std::size_t>(std::abs(up))];
    for (int right = -width; right <= width; ++right) {
      const raster::CellIndex other{cell.column + right, cell.row + up};
      greatest_m = std::max(greatest_m,
                            geometry().contains(other) ? surface_m_.at(other) : kBlockedAltitude_m);
    }
  }
  return greatest_m;
}

std::uint32_t Surroundings::word(float greatest_m, float risk) const {
  const float risk_scale =
      risk_max_ > 0.0 ? static_cast<float>(PackedGround::kRiskMax / risk_max_) : 0.0F;
  // In double precision: rounding must not make the ground lower.
  const double above_m =
      static_cast<double>(std::clamp(greatest_m, PackedGround::kLowest_m, kBlockedAltitude_m)) -
      static_cast<double>(PackedGround::kLowest_m);
  const double steps = std::ceil(above_m * static_cast<double>(PackedGround::kStepsPerMetre));
  const auto share = static_cast<std::uint32_t>(risk * risk_scale + 0.5F);
  return static_cast<std::uint32_t>(steps) << PackedGround::kRiskBits |
         std::min(share, PackedGround::kRiskMax);
}

void Surroundings::surface_changed(const risk::CostModel& costs,
                                   const std::vector<raster::CellIndex>& cells) {
  const float padding_risk = static_cast<float>(semantics_weight_ + visibility_weight_);
  const auto greatest_risk = static_cast<float>(risk_max_);
  std::vector<raster::CellIndex> changed;  // of the surface, padded
  for (const raster::CellIndex& cell : cells) {
    const raster::CellIndex at{cell.column + padding_, cell.row + padding_};
    const Cell now = cell_of(costs, cell).value_or(Cell{kBlockedAltitude_m, padding_risk});
    const float before = risk_.at(at);
    risk_.at(at) = now.risk;
    if (now.risk > greatest_risk ||
        (before != now.risk && before == greatest_risk && padding_risk < greatest_risk)) {
      Surroundings anew(costs, window_m_, disc_radius_m_, semantics_weight_, visibility_weight_);
      if (!packed_.is_empty()) {
        anew.pack(tube_radius_m_);
      }
      *this = std::move(anew);
      return;
    }
    if (surface_m_.at(at) != now.surface_m || before != now.risk) {
      surface_m_.at(at) = now.surface_m;
      changed.push_back(at);
    }
  }
  const auto for_each_near = [&](raster::CellIndex middle, int reach, const auto& visit) {
    for (int row = middle.row - reach; row <= middle.row + reach; ++row) {
      for (int column = middle.column - reach; column <= middle.column + reach; ++column) {
        if (geometry().contains(raster::CellIndex{column, row})) {
          visit(raster::CellIndex{column, row});
        }
      }
    }
  };
  const int disc_reach = static_cast<int>(disc_radius_m_ / map_geometry_.cell_m);
  const int tube_reach = tube_widths_.empty() ? 0 : tube_widths_.front();
  for (const raster::CellIndex& middle : changed) {
    for_each_near(middle, disc_reach,
                  [&](raster::CellIndex cell) { dilated_m_.at(cell) = greatest_in_disc_m(cell); });
    if (!packed_.is_empty()) {
      for_each_near(middle, tube_reach, [&](raster::CellIndex cell) {
        packed_.at(cell) = word(greatest_in_tube_m(cell), risk_.at(cell));
      });
    }
  }
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
  tube_radius_m_ = tube_radius_m;
  std::vector<int>& widths = tube_widths_;
  widths.clear();
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
  packed_ = raster::Grid<std::uint32_t>(g, 0);
  for (std::size_t i = 0; i < packed_.values().size(); ++i) {
    packed_.values()[i] = word(greatest.values()[i], risk_.values()[i]);
  }
}

}  // namespace hedgehop::local_planning
