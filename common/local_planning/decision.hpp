#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "command_model/command_model.hpp"

namespace hedgehop::local_planning {

/// What keeps a direction from being chosen.
enum class DirectionMask : std::uint8_t { kFree, kClimb, kTurn, kUnknown };

/// A decision of the local planner, for displays: what the terrain asked for, sector by sector, and
/// what was chosen. Sector k is centred on 2 pi k / sectors, counter-clockwise from east.
struct Decision {
  struct Sector {
    double climb_tangent = 0.0;  // NaN: no known cell
    float cost = 0.0F;           // of cheapest_direction_rad(); NaN: not feasible
    DirectionMask mask = DirectionMask::kFree;
  };
  std::int64_t number = 0;  // from 0, through all passes
  command_model::ModelState state;
  std::vector<Sector> sectors;       // empty when directions are judged by rollouts
  std::optional<int> chosen_sector;  // none: no direction was feasible
};

/// Looks at decisions while they are made; changes none.
struct DecisionWatch {
  std::function<bool()> is_wanted;  // asked at each decision; empty: never
  std::function<void(const Decision&)> show;
};

}  // namespace hedgehop::local_planning
