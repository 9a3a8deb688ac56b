#pragma once

#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

#include "raster/grid.hpp"
#include "risk/cost_model.hpp"

namespace hedgehop::local_planning {

/// A word of packed ground: height above kLowest_m in steps, rounded up, and
/// the risk as a share of the greatest.
struct PackedGround {
  static constexpr float kLowest_m = -1000.0F;
  static constexpr float kStepsPerMetre = 64.0F;
  static constexpr int kRiskBits = 12;
  static constexpr std::uint32_t kRiskMax = (1U << kRiskBits) - 1U;
};

/// Padded layers of a map, ready for kernels that look around without asking for bounds.
///
/// The padding and every void count as a wall of kBlockedAltitude_m; they never count as ground to
/// be climbed over in `dilated`, where they are left out. So does a hard area of the map that
/// begins within kAreaFloor_m above the surface, unless its ceiling is at most kAreaClimb_m above
/// it: then it is ground up to its ceiling.
class Surroundings {
 public:
  static constexpr float kBlockedAltitude_m = 9000.0F;
  static constexpr double kAreaFloor_m = 60.0;
  static constexpr double kAreaClimb_m = 150.0;

  /// @param window_m           how far kernels look from a point on the map
  /// @param disc_radius_m      of the discs in `dilated`
  /// @param semantics_weight   weight of the semantic cost in the risk
  /// @param visibility_weight  weight of the visibility share in the risk
  Surroundings(const risk::CostModel& costs, double window_m, double disc_radius_m,
               double semantics_weight, double visibility_weight);

  [[nodiscard]] const raster::GridGeometry& geometry() const { return surface_m_.geometry(); }
  /// Surface; padded.
  [[nodiscard]] const raster::Grid<float>& surface_m() const { return surface_m_; }
  /// c_sem semantics + c_vis visibility; the greatest possible value in the
  /// padding.
  [[nodiscard]] const raster::Grid<float>& risk() const { return risk_; }
  /// The greatest value in `risk`.
  [[nodiscard]] double risk_max() const { return risk_max_; }
  /// Greatest known surface of the cells whose centres lie within disc_radius_m
  /// of the centre of the cell that holds the point; -infinity if there is none
  /// or the point is outside.
  [[nodiscard]] double dilated_m(const geo::MapPoint& point) const {
    const raster::CellIndex cell = geometry().cell_at(point);
    return geometry().contains(cell) ? static_cast<double>(dilated_m_.at(cell))
                                     : -std::numeric_limits<double>::infinity();
  }
  /// The same for kernels; padded.
  [[nodiscard]] const raster::Grid<float>& dilated_layer_m() const { return dilated_m_; }
  /// What flights ahead are rolled out over: for each cell, in one word, the
  /// greatest surface of the cells whose centres are within `tube_radius_m` of
  /// anywhere in it, and its own risk. Voids and padding are walls here.
  void pack(double tube_radius_m);
  /// Takes in what the surface of the map has become at these cells: the same then, bit by bit, as
  /// made anew from `costs`, which has taken it in before.
  /// @param costs  of a map of the same geometry, with the weights of the same layers
  /// @note  O(cells, times the fourth power of the disc's or the tube's radius in cells); all is
  ///        made anew in the rare case that a soft area there makes another risk_max().
  void surface_changed(const risk::CostModel& costs, const std::vector<raster::CellIndex>& cells);

  /// Empty without pack(); padded. See PackedGround.
  [[nodiscard]] const raster::Grid<std::uint32_t>& packed() const { return packed_; }
  /// Whether what is packed alone shows that no surface within `reach_m` of a point on the map,
  /// interpolated between cells or not, is as high as `altitude_m`. False says nothing.
  [[nodiscard]] bool is_surely_above(const geo::MapPoint& point, double reach_m,
                                     double altitude_m) const {
    const raster::CellIndex cell = geometry().cell_at(point);
    return reach_m <= sure_reach_m_ && geometry().contains(cell) &&
           altitude_m > static_cast<double>(PackedGround::kLowest_m) +
                            (packed_.at(cell) >> PackedGround::kRiskBits) /
                                static_cast<double>(PackedGround::kStepsPerMetre) +
                            1e-3;
  }
  /// Whether the point lies on the map itself, not on the padding.
  [[nodiscard]] bool is_on_map(const geo::MapPoint& point) const {
    return map_geometry_.contains(point);
  }

 private:
  // What a cell of the map is to flights; nothing: a void or a wall.
  struct Cell {
    float surface_m = 0.0F;
    float risk = 0.0F;
  };
  [[nodiscard]] std::optional<Cell> cell_of(const risk::CostModel& costs,
                                            raster::CellIndex cell) const;
  [[nodiscard]] float greatest_in_disc_m(raster::CellIndex cell) const;
  [[nodiscard]] float greatest_in_tube_m(raster::CellIndex cell) const;
  [[nodiscard]] std::uint32_t word(float greatest_m, float risk) const;

  double window_m_;
  double disc_radius_m_;
  double semantics_weight_;
  double visibility_weight_;
  int padding_;
  raster::GridGeometry map_geometry_;
  raster::Grid<float> surface_m_;
  raster::Grid<float> risk_;
  raster::Grid<float> dilated_m_;
  raster::Grid<std::uint32_t> packed_;
  double risk_max_ = 0.0;
  double tube_radius_m_ = 0.0;
  std::vector<int> tube_widths_;  // cells to each side, by row from that of the cell outwards
  double sure_reach_m_ = -1.0;    // of is_surely_above()
};

}  // namespace hedgehop::local_planning
