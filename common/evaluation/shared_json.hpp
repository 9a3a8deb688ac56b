#pragma once

#include <nlohmann/json.hpp>

#include "evaluation/optimality_evaluation.hpp"
#include "evaluation/paired_statistics.hpp"

namespace hedgehop::evaluation {

/// Pieces of results that several evaluations print.
inline nlohmann::ordered_json machine_json(const MachineRecord& machine) {
  return {{"processor", machine.processor}, {"simd", machine.simd}, {"version", machine.version}};
}

inline nlohmann::ordered_json change_json(const PairedChange& change) {
  return {{"change", change.change},
          {"low", change.low},
          {"high", change.high},
          {"mean_change", change.mean_change},
          {"change_deviation", change.change_deviation},
          {"ratio_pairs", change.ratio_pairs},
          {"sum", change.sum},
          {"baseline_sum", change.baseline_sum}};
}

}  // namespace hedgehop::evaluation
