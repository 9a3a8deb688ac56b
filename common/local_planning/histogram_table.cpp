#include "local_planning/histogram_table.hpp"

#include <algorithm>
#include <cmath>

namespace hedgehop::local_planning {
namespace {

constexpr int kCellsMax = 60000;
constexpr std::size_t kInterleaved = 512;
constexpr int kCellsForWidth = 24;  // that make a width of windows worth resolving

int cells_with_padding(const PolarConstants& constants) {
  const double side = 2.0 * std::ceil(constants.window_m / constants.cell_m) + 2.0;
  const double cells = side * (side + 1.5 * kLanes);
  return cells > 1e9 ? 1000000000 : static_cast<int>(cells);
}

// Neighbours go to the same sectors; stores to the same place in a row wait for each other.
void interleave(std::vector<std::uint64_t>& entries) {
  std::vector<std::uint64_t> from;
  for (std::size_t begin = 0; begin < entries.size(); begin += kInterleaved) {
    const std::size_t count = std::min(kInterleaved, entries.size() - begin);
    from.assign(entries.begin() + static_cast<std::ptrdiff_t>(begin),
                entries.begin() + static_cast<std::ptrdiff_t>(begin + count));
    std::size_t at = begin;
    constexpr std::size_t kStride = 37;
    for (std::size_t first = 0; first < kStride; ++first) {
      for (std::size_t i = first; i < count; i += kStride) {
        entries[at++] = from[i];
      }
    }
  }
}

}  // namespace

HistogramTable::HistogramTable(const Surroundings& surroundings, const HistogramOptions& options,
                               Kernel kernel)
    : surroundings_(&surroundings),
      plain_(surroundings, options),
      is_plain_(cells_with_padding(plain_.constants()) > kCellsMax),
      kernels_(step_kernels(kernel)) {
  const auto subcells = static_cast<std::size_t>(plain_.constants().subcells);
  tables_.resize(subcells * subcells);
  if (!is_plain_) {
    choose_widths();
  }
}

// Powers of two, and widths that so many cells have that a window of their own pays.
void HistogramTable::choose_widths() {
  const PolarConstants& c = plain_.constants();
  const Sectors& sectors = plain_.sectors();
  const int widest = sectors.count() / 2 + 2;
  std::vector<int> cells(static_cast<std::size_t>(widest + 1));
  const int reach = static_cast<int>(c.window_m / c.cell_m) + 1;
  const double within_m = c.within_cell_m(c.subcells / 2);
  for (int row = -reach; row <= reach; ++row) {
    for (int column = -reach; column <= reach; ++column) {
      const double dx_m = (column + 0.5) * c.cell_m - within_m;
      const double dy_m = (row + 0.5) * c.cell_m - within_m;
      if (dx_m * dx_m + dy_m * dy_m > c.window_m * c.window_m) {
        continue;
      }
      const PolarCell cell = polar_cell(c, sectors, dx_m, dy_m, false);
      if (cell.distance_m > c.disc) {
        ++cells[static_cast<std::size_t>(std::min(widest, cell.high - cell.low + 1))];
      }
    }
  }
  window_.assign(static_cast<std::size_t>(widest + 1), 0);
  for (int width = widest; width >= 1; --width) {
    const bool is_power_of_two = (width & (width - 1)) == 0;
    if (is_power_of_two ||
        cells[static_cast<std::size_t>(width)] > kCellsForWidth + sectors.count() / 5) {
      widths_.push_back(width);
    }
  }
  std::size_t index = widths_.size() - 1;
  for (int width = 1; width <= widest; ++width) {
    while (index > 0 && widths_[index - 1] <= width) {
      --index;
    }
    window_[static_cast<std::size_t>(width)] = static_cast<std::uint16_t>(index);
  }
}

const PolarTable& HistogramTable::table_at(const Viewpoint& view) {
  const PolarConstants& c = plain_.constants();
  std::unique_ptr<PolarTable>& made =
      tables_[static_cast<std::size_t>(view.sub_row * c.subcells + view.sub_column)];
  if (made) {
    return *made;
  }
  made = std::make_unique<PolarTable>();
  PolarTable& table = *made;
  const Sectors& sectors = plain_.sectors();
  const int count = sectors.count();
  const int reach = static_cast<int>(c.window_m / c.cell_m) + 1;
  const double window_m2 = c.window_m * c.window_m;
  const double within_x_m = c.within_cell_m(view.sub_column);
  const double within_y_m = c.within_cell_m(view.sub_row);
  const int stride = surroundings_->geometry().columns;
  for (int row = -reach; row <= reach; ++row) {
    const double dy_m = (row + 0.5) * c.cell_m - within_y_m;
    const std::size_t begin = table.distance_m.size();
    for (int column = -reach; column <= reach; ++column) {
      const double dx_m = (column + 0.5) * c.cell_m - within_x_m;
      if (dx_m * dx_m + dy_m * dy_m > window_m2) {
        continue;
      }
      if (table.distance_m.size() == begin) {
        table.rows.push_back({row * stride + column, 0});
      }
      const PolarCell cell = polar_cell(c, sectors, dx_m, dy_m, true);
      const auto at = static_cast<std::uint16_t>(table.distance_m.size());
      table.distance_m.push_back(cell.distance_m);
      table.azimuth_rad.push_back(cell.azimuth_rad);
      if (cell.distance_m <= c.disc) {
        table.near.push_back(at);
        continue;
      }
      const int end = cell.high + 1;
      const std::size_t index = window_[static_cast<std::size_t>(end - cell.low)];
      const int width = widths_[index];
      const auto slot_of = [&](int first) {
        return static_cast<std::uint16_t>(static_cast<int>(index) * padded_to_lanes(count) +
                                          (first >= count ? first - count : first));
      };
      table.entries.push_back(PolarEntry::packed(
          at, static_cast<std::uint64_t>(cell.low),
          static_cast<std::uint64_t>(end > count ? end - count : end), slot_of(cell.low)));
      if (width < end - cell.low) {
        table.further.push_back({at, slot_of(end - width)});
      }
      if (end > count) {
        table.wrapped.push_back(at);
      }
    }
    if (table.distance_m.size() == begin) {
      continue;
    }
    const auto cells = static_cast<int>(table.distance_m.size() - begin);
    table.rows.back().vectors = padded_to_lanes(cells) / kLanes;
    table.distance_m.resize(begin + static_cast<std::size_t>(padded_to_lanes(cells)), kFarAway_m);
    table.azimuth_rad.resize(table.distance_m.size(), 0.0F);
  }
  interleave(table.entries);
  return table;
}

void HistogramTable::compute(const geo::MapPoint& place, double altitude_m, double heading_math_rad,
                             double turn_radius_min_m, PolarHistogram& histogram, double reach_m) {
  if (is_plain_ || !surroundings_->is_on_map(place)) {
    plain_.compute(place, altitude_m, heading_math_rad, turn_radius_min_m, histogram, reach_m);
    return;
  }
  const PolarConstants& c = plain_.constants();
  const PolarQuestion question(c, altitude_m, heading_math_rad, turn_radius_min_m, reach_m);
  const Viewpoint view = c.viewpoint(place.x_m, place.y_m);
  histogram.resize(sectors().count());
  HistogramTask task;
  task.constants = &c;
  task.question = &question;
  task.table = &table_at(view);
  task.surface_m = surroundings_->surface_m().row(view.row) + view.column;
  task.risk = surroundings_->risk().row(view.row) + view.column;
  task.widths = widths_.data();
  task.width_count = static_cast<int>(widths_.size());
  task.sectors = sectors().count();
  task.heading_sector = sectors().of_angle(heading_math_rad);
  task.tan_climb = histogram.tan_climb.data();
  task.tan_masked = histogram.tan_masked.data();
  task.tan_mask = histogram.tan_mask.data();
  task.risk_of_sectors = histogram.risk.data();
  task.risk_weight = histogram.risk_weight.data();
  kernels_.histogram(task, scratch_);
  histogram.tan_climb_near = task.tan_climb_near;
}

}  // namespace hedgehop::local_planning
