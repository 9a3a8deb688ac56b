#pragma once

#include <string>

#include "base/shipped_config.hpp"
#include "local_planning/local_planner.hpp"
#include "risk/cost_model.hpp"

namespace hedgehop::test {

inline local_planning::LocalOptions shipped_local_options(const std::string& setting = {}) {
  std::string text(shipped_config("planning.yaml"));
  if (!setting.empty()) {
    text = set_config_value(text, setting);
  }
  ConfigReader root = ConfigReader::from_text(text, "planning.yaml");
  ConfigReader local = root.required_section("local");
  return local_planning::read_local_options(local);
}

inline command_model::Vehicle shipped_vehicle() {
  ConfigReader reader =
      ConfigReader::from_text(shipped_config("vehicles/ec135.yaml"), "vehicles/ec135.yaml");
  return command_model::read_vehicle(reader);
}

/// Costs of a map: settlements cost 1, visibility as stored.
inline risk::CostModel test_costs(const map::Map& map) {
  return {map,
          {25.0, 0.02, 4.0, 0.01},
          risk::SemanticCostTable(
              {{static_cast<std::uint16_t>(map::SemanticClass::kSettlement), 1.0}}, 0.0),
          1.0};
}

}  // namespace hedgehop::test
