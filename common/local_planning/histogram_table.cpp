#include "local_planning/histogram_table.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/angles.hpp"

namespace hedgehop::local_planning {
namespace {

constexpr int kCellsMax = 60000;
constexpr int kCellsForWidth = 4;  // that make a width of windows worth resolving

int cells_with_padding(const PolarConstants& constants) {
  const double side = 2.0 * std::ceil(constants.window_m / constants.cell_m) + 2.0;
  const double cells = side * (side + 1.5 * kLanes);
  return cells > 1e9 ? 1000000000 : static_cast<int>(cells);
}

// Fills the last run up.
void pad(PolarTable& table) {
  const auto size = static_cast<std::size_t>(kLanes) * table.runs.size();
  table.distance_m.resize(size, kFarAway_m);
  table.azimuth_rad.resize(size, 0.0F);
  table.rise_1pm.resize(size, 0.0F);
  table.fall_1pm.resize(size, 0.0F);
}

// Where the cells of each run lie that may mask, and which runs are truncated.
void bound_runs(const PolarConstants& c, PolarTable& table) {
  constexpr float kMargin_rad = 1e-3F;
  constexpr float kNowhere_rad = -100.0F;
  const auto padded =
      static_cast<std::size_t>(padded_to_lanes(static_cast<int>(table.runs.size())));
  table.middle_rad.assign(padded, 0.0F);
  table.spread_rad.assign(padded, kNowhere_rad);
  table.farthest_m.assign(padded, 0.0F);
  for (std::size_t run = 0; run < table.runs.size(); ++run) {
    double first_rad = 0.0;
    double least_rad = 0.0;  // from the first one
    double greatest_rad = 0.0;
    bool is_truncated = false;
    float farthest_m = 0.0F;
    for (std::size_t at = kLanes * run; at < kLanes * (run + 1); ++at) {
      const float distance_m = table.distance_m[at];
      if (distance_m <= c.disc || distance_m == kFarAway_m) {
        continue;
      }
      const auto azimuth_rad = static_cast<double>(table.azimuth_rad[at]);
      if (farthest_m == 0.0F) {
        first_rad = azimuth_rad;
      }
      const double from_first_rad = wrap_to_pi(azimuth_rad - first_rad);
      least_rad = std::min(least_rad, from_first_rad);
      greatest_rad = std::max(greatest_rad, from_first_rad);
      farthest_m = std::max(farthest_m, distance_m);
      is_truncated = is_truncated || distance_m < c.truncation_distance;
    }
    if (farthest_m > 0.0F) {
      table.middle_rad[run] =
          static_cast<float>(wrap_to_pi(first_rad + 0.5 * (least_rad + greatest_rad)));
      table.spread_rad[run] = static_cast<float>(0.5 * (greatest_rad - least_rad)) + kMargin_rad;
      table.farthest_m[run] = farthest_m;
    }
    if (is_truncated) {
      table.truncated.push_back(static_cast<std::uint16_t>(run));
    }
  }
}

// Stores to the same place in a row wait for each other: spreads those of each place evenly over
// all.
template <typename Entry, typename PlaceOf>
void spread_out(std::vector<Entry>& entries, const PlaceOf& place_of) {
  std::vector<std::size_t> counts;
  for (const Entry& entry : entries) {
    const std::size_t place = place_of(entry);
    counts.resize(std::max(counts.size(), place + 1));
    ++counts[place];
  }
  std::vector<std::size_t> seen(counts.size());
  std::vector<std::vector<Entry>> turns(entries.size());
  for (const Entry& entry : entries) {
    const std::size_t place = place_of(entry);
    const std::size_t i = seen[place]++;
    turns[(2 * i + 1) * entries.size() / (2 * counts[place])].push_back(entry);
  }
  entries.clear();
  for (const std::vector<Entry>& turn : turns) {
    entries.insert(entries.end(), turn.begin(), turn.end());
  }
}

}  // namespace

PolarTables::PolarTables(PolarUse use, const PolarConstants& constants, const Sectors& sectors,
                         int stride)
    : use_(use), subcells_(constants.subcells) {
  if (cells_with_padding(constants) > kCellsMax) {
    return;
  }
  choose_widths(constants, sectors);
  for (int row = 0; row < subcells_; ++row) {
    for (int column = 0; column < subcells_; ++column) {
      tables_.push_back(made(constants, sectors, stride, column, row));
    }
  }
}

std::shared_ptr<const HistogramTables> histogram_tables(const Surroundings& surroundings,
                                                        const HistogramOptions& options) {
  const Sectors sectors(options.sectors);
  const raster::GridGeometry& geometry = surroundings.geometry();
  const auto tables = [&](PolarUse use) {
    return PolarTables(use, PolarConstants(use, options, geometry, surroundings.risk_max()),
                       sectors, geometry.columns);
  };
  return std::make_shared<const HistogramTables>(
      HistogramTables{tables(PolarUse::kClimb), tables(PolarUse::kRisk)});
}

HistogramTable::HistogramTable(const Surroundings& surroundings, const HistogramOptions& options,
                               std::shared_ptr<const HistogramTables> tables, Kernel kernel)
    : surroundings_(&surroundings),
      plain_(surroundings, options),
      kernels_(step_kernels(kernel)),
      tables_(std::move(tables)) {}

// Powers of two, and widths that so many cells have that a window of their own pays.
void PolarTables::choose_widths(const PolarConstants& c, const Sectors& sectors) {
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

PolarTable PolarTables::made(const PolarConstants& c, const Sectors& sectors, int stride,
                             int sub_column, int sub_row) const {
  PolarTable table;
  const int count = sectors.count();
  const int reach = static_cast<int>(c.window_m / c.cell_m) + 1;
  const double window_m2 = c.window_m * c.window_m;
  const double within_x_m = c.within_cell_m(sub_column);
  const double within_y_m = c.within_cell_m(sub_row);
  for (int row = -reach; row <= reach; ++row) {
    const double dy_m = (row + 0.5) * c.cell_m - within_y_m;
    for (int column = -reach; column <= reach; ++column) {
      const double dx_m = (column + 0.5) * c.cell_m - within_x_m;
      if (dx_m * dx_m + dy_m * dy_m > window_m2) {
        continue;
      }
      const int cell_number = row * stride + column;
      if (table.runs.empty() || cell_number - table.runs.back() >= kLanes) {
        pad(table);
        table.runs.push_back(cell_number);
      }
      const PolarCell cell = polar_cell(c, sectors, dx_m, dy_m, use_ == PolarUse::kClimb);
      const auto at = static_cast<std::uint16_t>(table.distance_m.size());
      table.distance_m.push_back(cell.distance_m);
      table.azimuth_rad.push_back(cell.azimuth_rad);
      table.rise_1pm.push_back(cell.rise_1pm);
      table.fall_1pm.push_back(cell.fall_1pm);
      if (cell.distance_m <= c.disc) {
        table.near.push_back(at);
        continue;
      }
      const int end = cell.high + 1;
      if (use_ == PolarUse::kRisk) {
        table.entries.push_back({at, static_cast<std::uint16_t>(cell.low),
                                 static_cast<std::uint16_t>(end > count ? end - count : end)});
        if (end > count) {
          table.wrapped.push_back(at);
        }
        continue;
      }
      const std::size_t index = window_[static_cast<std::size_t>(end - cell.low)];
      const int width = widths_[index];
      const auto slot_of = [&](int first) {
        return static_cast<std::uint16_t>(static_cast<int>(index) * padded_to_lanes(count) +
                                          (first >= count ? first - count : first));
      };
      table.slots.push_back({at, slot_of(cell.low)});
      if (width < end - cell.low) {
        table.slots.push_back({at, slot_of(end - width)});
      }
    }
  }
  pad(table);
  if (use_ == PolarUse::kClimb) {
    bound_runs(c, table);
  }
  spread_out(table.slots, [](const PolarSlot& slot) { return std::size_t{slot.slot}; });
  spread_out(table.entries, [](const PolarEntry& entry) { return std::size_t{entry.low}; });
  return table;
}

void HistogramTable::compute(const geo::MapPoint& place, double altitude_m, double heading_math_rad,
                             double turn_radius_min_m, PolarHistogram& histogram, double reach_m) {
  if (tables_->climb.is_empty() || !surroundings_->is_on_map(place)) {
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
  task.table = &tables_->climb.at(view);
  task.surface_m = surroundings_->surface_m().row(view.row) + view.column;
  task.widths = tables_->climb.widths().data();
  task.width_count = static_cast<int>(tables_->climb.widths().size());
  task.sectors = sectors().count();
  task.heading_sector = sectors().of_angle(heading_math_rad);
  task.tan_climb = histogram.tan_climb.data();
  task.tan_masked = histogram.tan_masked.data();
  task.tan_mask = histogram.tan_mask.data();
  kernels_.histogram(task, scratch_);
  histogram.tan_climb_near = task.tan_climb_near;

  const Viewpoint risk_view = plain_.risk_constants().viewpoint(place.x_m, place.y_m);
  if (risk_view_ != risk_view) {
    sector_risk_.resize(histogram.risk.size());
    sector_weight_.resize(histogram.risk.size());
    RiskTask risk;
    risk.constants = &plain_.risk_constants();
    risk.table = &tables_->risk.at(risk_view);
    risk.risk = surroundings_->risk().row(risk_view.row) + risk_view.column;
    risk.sectors = sectors().count();
    risk.sector_risk = sector_risk_.data();
    risk.sector_weight = sector_weight_.data();
    kernels_.risk(risk, scratch_);
    risk_view_ = risk_view;
  }
  std::copy(sector_risk_.begin(), sector_risk_.end(), histogram.risk.begin());
  std::copy(sector_weight_.begin(), sector_weight_.end(), histogram.risk_weight.begin());
}

}  // namespace hedgehop::local_planning
