#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "local_planning/polar_histogram.hpp"
#include "local_planning/step_kernels.hpp"

namespace hedgehop::local_planning {

/// What the polar histogram needs to know of the cells of a window, whatever the map: for each
/// sub-cell that a place may be in, distances, azimuths and sectors of all cells, row by row.
/// Immutable: flights share it.
class PolarTables {
 public:
  /// For rasters whose rows are `stride` cells apart. Windows of more than 60000 cells have none.
  PolarTables(PolarUse use, const PolarConstants& constants, const Sectors& sectors, int stride);

  [[nodiscard]] bool is_empty() const { return tables_.empty(); }
  [[nodiscard]] const PolarTable& at(const Viewpoint& view) const {
    return tables_[static_cast<std::size_t>(view.sub_row * subcells_ + view.sub_column)];
  }
  /// Of windows of sectors, descending, the last one is 1.
  [[nodiscard]] const std::vector<int>& widths() const { return widths_; }

 private:
  void choose_widths(const PolarConstants& constants, const Sectors& sectors);
  [[nodiscard]] PolarTable made(const PolarConstants& constants, const Sectors& sectors, int stride,
                                int sub_column, int sub_row) const;

  PolarUse use_;
  int subcells_;
  std::vector<int> widths_;
  std::vector<std::uint16_t> window_;  // greatest width not above this one, as index into widths_
  std::vector<PolarTable> tables_;
};

/// Tables for a histogram over `surroundings`.
struct HistogramTables {
  PolarTables climb;
  PolarTables risk;
};
std::shared_ptr<const HistogramTables> histogram_tables(const Surroundings& surroundings,
                                                        const HistogramOptions& options);

/// The polar histogram from tables, with SIMD: the same bits as HistogramKernel.
///
/// A histogram takes two passes:
///
/// - along the rows, many cells at a time: climb angle, arc mask;
/// - over the cells one by one: the climb angle goes to the window of sectors of its width that
///   begins at its first sector. Windows of a width are resolved into those of the next smaller
///   one, all sectors at a time. Widths that few cells have are made of two windows.
///
/// Risks are summed likewise, into both ends of each cell's interval, when the helicopter enters
/// another square.
///
/// Greatest values and sums of integers do not depend on the order. Without tables, and for places
/// outside the map, the plain form is used.
class HistogramTable {
 public:
  /// Holds a reference to `surroundings`, whose padding must suit the window.
  /// @param tables  histogram_tables() of the same arguments
  /// @throws std::invalid_argument  if the processor lacks the instructions asked for.
  HistogramTable(const Surroundings& surroundings, const HistogramOptions& options,
                 std::shared_ptr<const HistogramTables> tables, Kernel kernel);

  /// As HistogramKernel::compute().
  void compute(const geo::MapPoint& place, double altitude_m, double heading_math_rad,
               double turn_radius_min_m, PolarHistogram& histogram,
               double reach_m = std::numeric_limits<double>::infinity());

  [[nodiscard]] const Sectors& sectors() const { return plain_.sectors(); }

 private:
  const Surroundings* surroundings_;
  HistogramKernel plain_;
  StepKernels kernels_;
  std::shared_ptr<const HistogramTables> tables_;
  HistogramScratch scratch_;
  std::optional<Viewpoint> risk_view_;  // that of the risks below
  std::vector<float> sector_risk_;
  std::vector<float> sector_weight_;
};

}  // namespace hedgehop::local_planning
