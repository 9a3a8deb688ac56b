#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "global_planning/cost_field.hpp"
#include "global_planning/flight_envelope.hpp"
#include "global_planning/global_planner.hpp"
#include "global_planning/lattice.hpp"
#include "global_planning/lattice_search.hpp"

namespace hedgehop::global_planning {

/// The cheapest ways from all around to the goal of an envelope, worked out once.
///
/// What search_lattice() does backward from the goal, without an end: each label is a way, with the
/// altitudes from which it can be flown, what it costs from the lowest of them, and the label that
/// it goes on with (LatticeLabel::before, negative for the leg to the goal). Costs may change
/// later; what can be flown stays. The start of the envelope sinks the floor nowhere here.
///
/// Places where a way from the start through them is cheap come first, `from_start` being the field
/// of costs to there, and the search ends after `work_budget` legs, or when `from_start` knows no
/// more places. About 1 us and 25 bytes a leg. Deterministic. Immutable, safe for concurrent use.
class WaysToGoal {
 public:
  WaysToGoal(FlightEnvelope envelope, const GlobalOptions& options, const CostField& from_start,
             std::int64_t work_budget);

  [[nodiscard]] const Lattice& lattice() const { return lattice_; }
  [[nodiscard]] const LatticeLabel& label(std::int32_t index) const {
    return labels_[static_cast<std::size_t>(index)];
  }
  [[nodiscard]] std::size_t label_count() const { return labels_.size(); }
  /// The newest way that leaves a node in one of the directions, older ones by LatticeLabel::next;
  /// -1: none.
  [[nodiscard]] std::int32_t newest(int column, int row, int direction) const {
    return newest_.find(column, row, (direction + kLatticeDirections / 2) % kLatticeDirections);
  }
  /// What all ways keep.
  [[nodiscard]] static LatticeSpare spare();

 private:
  void begin(const FlightEnvelope& envelope, const CostField& from_start);
  void expand(const FlightEnvelope& envelope, const CostField& from_start, std::int32_t index);
  void step(const FlightEnvelope& envelope, const CostField& from_start, const LatticeLabel& from,
            std::int32_t index, int column, int row, int direction);

  Lattice lattice_;
  NewestLabels newest_;
  std::vector<LatticeLabel> labels_;
  std::vector<LatticeEntry> queue_;  // empty but while they are worked out
  std::int64_t work_units_ = 0;
};

}  // namespace hedgehop::global_planning
