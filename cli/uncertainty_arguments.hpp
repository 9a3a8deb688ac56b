#pragma once

#include <cstdint>
#include <optional>

#include "console.hpp"
#include "evaluation/clearance_risk.hpp"
#include "evaluation_arguments.hpp"
#include "flight/plan.hpp"
#include "map/map.hpp"

namespace hedgehop::cli {

/// --dem-error-m, --navigation-error-m, --draws and --error-seed. Must outlive the parsing.
struct UncertaintyArguments {
  evaluation::ErrorSizes errors;
  std::int64_t draws = 0;  // 0: config/uncertainty.yaml
  std::uint64_t seed = 1;
  std::optional<double> clearance_m;  // default: the plan's demand

  void add_to(CLI::App& verb);
  [[nodiscard]] bool is_asked_for() const {
    return errors.dem_m > 0.0 || errors.navigation_m > 0.0;
  }
  [[nodiscard]] evaluation::UncertaintyOptions options() const;
  /// Nothing if no errors were given, or along a flight that has no two finite states.
  [[nodiscard]] std::optional<evaluation::ClearanceRisk> risk_of(const Console& console,
                                                                 const map::Map& map,
                                                                 const flight::Plan& plan) const;
};

}  // namespace hedgehop::cli
