#pragma once

#include <cstdint>
#include <string>
#include <variant>

#include "base/shipped_config.hpp"
#include "global_planning/global_planner.hpp"
#include "support/fractal_terrain.hpp"
#include "support/test_map.hpp"

namespace hedgehop::test {

/// Weights as shipped, and none: cost is length.
inline constexpr risk::CostWeights kWeights{25.0, 0.02, 4.0, 0.01};
inline constexpr risk::CostWeights kLengthOnly{};

/// The shipped options of the global planner, with a smaller budget.
inline global_planning::GlobalOptions shipped_global_options(std::int64_t work_budget = 60000) {
  auto reader = ConfigReader::from_text(shipped_config("planning.yaml"), "planning.yaml");
  auto section = reader.required_section("global");
  global_planning::GlobalOptions options = global_planning::read_global_options(section);
  options.work_budget = work_budget;
  return options;
}

/// A map with its cost model; keeps both alive together.
struct PlanningCase {
  map::Map map;
  risk::CostModel costs;

  PlanningCase(map::Map made, const risk::CostWeights& weights)
      : map(std::move(made)),
        costs(map, weights, risk::SemanticCostTable({{0xFFFF, 1.0}}, 0.0), 1.0) {}
  PlanningCase(map::Map made, const risk::CostWeights& weights, risk::SemanticCostTable semantics)
      : map(std::move(made)), costs(map, weights, semantics, 1.0) {}
  PlanningCase(const PlanningCase&) = delete;
  PlanningCase& operator=(const PlanningCase&) = delete;

  [[nodiscard]] flight::Waypoint above(double x_m, double y_m, double height_m = 15.24) const {
    return {x_m, y_m, raster::sample_bilinear(map.surface_m, {x_m, y_m}) + height_m};
  }
};

inline std::variant<flight::Route, flight::NoPlan> plan(
    const PlanningCase& in, const global_planning::GlobalOptions& options,
    const flight::Waypoint& start, const flight::Waypoint& goal, std::uint64_t seed = 1) {
  const SilentObserver observer;
  return plan_leg(in.costs, options, {start, goal, seed, options.work_budget}, {}, observer);
}

}  // namespace hedgehop::test
