#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "local_planning/polar_histogram.hpp"
#include "local_planning/step_kernels.hpp"

namespace hedgehop::local_planning {

/// The polar histogram from tables, with SIMD: the same bits as HistogramKernel.
///
/// What a cell contributes to depends only on where in its own cell the helicopter is, told apart
/// by sub-cells. For each sub-cell, when it is first visited, distances, azimuths and sectors of
/// all cells of the window are written down row by row. A histogram then takes two passes:
///
/// - along the rows, many cells at a time: climb angle, weighted risk, arc mask;
/// - over the cells one by one: the climb angle goes to the window of sectors of its width that
///   begins at its first sector, the risk to both ends of its interval. Windows of a width are
///   resolved into those of the next smaller one, all sectors at a time. Widths that few cells have
///   are made of two windows.
///
/// Greatest values and sums of integers do not depend on the order. Windows of more than 60000
/// cells are left to the plain form.
class HistogramTable {
 public:
  /// Holds a reference to `surroundings`, whose padding must suit the window.
  /// @throws std::invalid_argument  if the processor lacks the instructions asked for.
  HistogramTable(const Surroundings& surroundings, const HistogramOptions& options, Kernel kernel);

  /// As HistogramKernel::compute().
  void compute(const geo::MapPoint& place, double altitude_m, double heading_math_rad,
               double turn_radius_min_m, PolarHistogram& histogram,
               double reach_m = std::numeric_limits<double>::infinity());

  [[nodiscard]] const Sectors& sectors() const { return plain_.sectors(); }

 private:
  const PolarTable& table_at(const Viewpoint& view);
  void choose_widths();

  const Surroundings* surroundings_;
  HistogramKernel plain_;
  bool is_plain_;
  StepKernels kernels_;
  std::vector<int> widths_;            // of windows of sectors, descending, the last one is 1
  std::vector<std::uint16_t> window_;  // greatest width not above this one, as index into widths_
  std::vector<std::unique_ptr<PolarTable>> tables_;
  HistogramScratch scratch_;
};

}  // namespace hedgehop::local_planning
