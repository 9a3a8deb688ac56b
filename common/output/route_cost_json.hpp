#pragma once

#include <nlohmann/json.hpp>

#include "flight/route.hpp"

namespace hedgehop::output {

/// The total and all terms, by their names.
inline nlohmann::ordered_json cost_json(const flight::RouteCost& cost) {
  nlohmann::ordered_json json = {{"total_m", cost.total_m()}};
  for (const flight::CostTerm& term : flight::kCostTerms) {
    json[term.name] = cost.*term.value_m;
  }
  return json;
}

}  // namespace hedgehop::output
