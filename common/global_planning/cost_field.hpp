#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "geo/map_projection.hpp"
#include "global_planning/flight_envelope.hpp"
#include "raster/grid.hpp"
#include "raster/window.hpp"

namespace hedgehop::global_planning {

/// Cost of the way from each place of the map to one target, in plan view and as low as the
/// envelope allows: about what a route would cost if there were no turn limit and no wires. What
/// CostModel charges for slopes counts by the direction of each step.
///
/// Cells are joined to blocks of about `block_m` that cost the mean of what their flyable cells
/// cost; Dijkstra's method joins each block with sixteen neighbours. Such paths are up to 2.8 %
/// longer than the straight ones they stand for; the field is divided by that. A step up or down a
/// slope that is steeper than the envelope's limit counts as long as the climb takes at that limit:
/// a flight winds up there, or goes around. Slopes are those of the surface averaged over some 400
/// m, since the height envelope evens out what is narrower. The field guides a search; it is not a
/// strict bound, as means hide what is narrower than a block. O(blocks log blocks).
class CostField {
 public:
  CostField(const FlightEnvelope& envelope, const geo::MapPoint& target, double block_m);

  /// The blocks alone, for fields to many targets; itself infinite everywhere.
  CostField(const FlightEnvelope& envelope, double block_m);
  /// A field over the blocks of another one, as far as a way from `from` needs it: infinite or too
  /// dear where the cost is more than a quarter above that at `from`.
  CostField(const CostField& blocks, const geo::MapPoint& target, const geo::MapPoint& from);

  /// What the blocks are, for files; with_numbers() reverses it, and is null for numbers that
  /// cannot be those of such a map.
  [[nodiscard]] std::vector<float> numbers() const;
  static std::optional<CostField> with_numbers(const raster::GridGeometry& cells, double block_m,
                                               std::vector<float> numbers);

  /// Cost to the target [m], interpolated between block centres; infinity where no way leads there
  /// and outside the map.
  [[nodiscard]] double cost_m(const geo::MapPoint& from) const;

  /// Makes the field anew after costs of cells inside `changed` did: to the last bit what the
  /// constructor gives now. What led through changed blocks is forgotten, as far as no other way is
  /// as cheap (G. Ramalingam and T. Reps, J. Algorithms 21(2), 1996, doi:10.1006/jagm.1996.0046),
  /// and found again from its border; the rest stays. O(forgotten blocks log blocks).
  /// @return  how many blocks were forgotten or made cheaper.
  std::size_t repair(const FlightEnvelope& envelope, const raster::Window& changed);

  [[nodiscard]] std::size_t block_count() const { return blocks_.cell_count(); }

  /// Whether the blocks along a leg cost as much as those of `other`, a field with the same blocks.
  [[nodiscard]] bool costs_as(const CostField& other, const geo::MapPoint& a,
                              const geo::MapPoint& b) const;

  /// Centres of blocks along the cheapest way to the target, from the one that holds a place;
  /// empty where no way leads there.
  [[nodiscard]] std::vector<geo::MapPoint> way_from(const geo::MapPoint& from) const;

 private:
  static constexpr std::uint32_t kNoBlock = 0xFFFFFFFFU;
  struct Entry {
    float cost_m;
    std::uint32_t block;
  };

  CostField(const raster::GridGeometry& cells, double block_m);
  void begin_at(const geo::MapPoint& target);
  [[nodiscard]] std::uint32_t framed(int column, int row) const;
  [[nodiscard]] float mean_density(const FlightEnvelope& envelope, int column, int row) const;
  [[nodiscard]] std::array<float, 3> mean_slope(const FlightEnvelope& envelope, int column,
                                                int row) const;
  void take_climbs(const FlightEnvelope& envelope);
  [[nodiscard]] float step_cost(std::uint32_t from, std::uint32_t to, std::size_t k) const;
  // Dijkstra's method from what is open; ends somewhat beyond the block `last`.
  void spread(std::uint32_t last = kNoBlock);

  raster::GridGeometry blocks_;
  int factor_ = 1;            // cells along the side of a block
  int wide_ = 0;              // blocks of a row with its frame
  std::uint32_t target_ = 0;  // framed; only with has_target_
  bool has_target_ = false;
  // With a frame of blocks that cannot be flown, which saves every test for the border.
  std::vector<float> density_;
  std::vector<float> climb_m_;  // horizontal length that a climb from sea level takes
  // By direction, see risk::CostModel::slope_form(); empty where slopes cost nothing.
  std::vector<std::array<float, 3>> slope_;
  std::vector<float> cost_m_;  // not yet divided by the metrication
  std::vector<std::ptrdiff_t> jump_;
  std::vector<Entry> open_;  // empty but while the field is made
};

}  // namespace hedgehop::global_planning
