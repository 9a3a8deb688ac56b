#include "evaluation/risk_planning.hpp"

#include <algorithm>
#include <boost/math/distributions/binomial.hpp>
#include <cmath>
#include <cstdio>
#include <limits>
#include <stdexcept>

#include "raster/grid.hpp"

namespace hedgehop::evaluation {
namespace {

constexpr std::int64_t kRoundsMax = 6;
constexpr int kRoundsInVainMax = 2;
constexpr double kGainMin = 0.25;  // of a raise: with less, what is too low is not what is raised
constexpr double kRaiseTold_m = 1.0;  // what a smaller one gains cannot be told from chance
constexpr double kSpare_m = 0.1;      // what planning again may lose of a margin

// Violations among so many draws that keep the upper end of the interval at or below a probability.
std::int64_t violations_allowed(std::int64_t draws, double probability, double confidence) {
  const auto upper = [&](std::int64_t violations) {
    return boost::math::binomial_distribution<double>::find_upper_bound_on_p(
        static_cast<double>(draws), static_cast<double>(violations), 0.5 * (1.0 - confidence));
  };
  std::int64_t low = -1;
  std::int64_t high = draws;
  while (high - low > 1) {
    const std::int64_t middle = low + (high - low) / 2;
    (upper(middle) <= probability ? low : high) = middle;
  }
  return low;
}

planning::PlanningConfig raised(const planning::PlanningConfig& config, double margin_m) {
  std::string text = config.text;
  const auto raise = [&](const char* key, double value_m) {
    char setting[120];
    std::snprintf(setting, sizeof setting, "%s=%.3f", key, value_m + margin_m);
    text = set_config_value(text, setting);
  };
  raise("global.envelope_floor_m", config.global.envelope_floor_m);
  raise("local.safety_height_m", config.local.safety_height_m);
  raise("local.vertical_pass.clearance_m", config.local.vertical_pass.clearance_m);
  return planning::read_planning_config(text, "raised configuration");
}

// Places without a height are put where planning would, and then higher.
flight::PlanRequest raised(const map::Map& map, const flight::PlanRequest& request,
                           const planning::PlanningConfig& config, double margin_m) {
  const geo::MapProjection projection(map.crs_wkt);
  flight::PlanRequest result = request;
  const auto raise = [&](flight::RequestPoint& point) {
    const geo::MapPoint place = projection.to_map(point.position);
    if (point.height_m || !map.geometry.contains(place)) {
      return;
    }
    const double highest_m =
        raster::max_within(map.surface_m, place, config.global.lateral_margin_m);
    const double height_m = highest_m + config.reference_height_m -
                            raster::sample_bilinear(map.surface_m, place) + margin_m;
    if (std::isfinite(height_m)) {
      point.height_m = height_m;
    }
  };
  raise(result.start);
  raise(result.goal);
  std::for_each(result.via.begin(), result.via.end(), raise);
  return result;
}

}  // namespace

std::variant<RiskPlan, flight::NoPlan> plan_within_risk(
    const map::Map& map, const flight::PlanRequest& request, const planning::PlanningConfig& config,
    const RiskDemand& demand, const PlanFunction& plan, Observer& observer) {
  if (!(demand.probability > 0.0 && demand.probability < 1.0)) {
    throw std::invalid_argument("a probability must lie between 0 and 1");
  }
  UncertaintyOptions options = demand.options;
  options.draws =
      std::max(options.draws, static_cast<std::int64_t>(std::ceil(20.0 / demand.probability)));
  const std::int64_t allowed = std::max<std::int64_t>(
      violations_allowed(options.draws, demand.probability, options.confidence), 0);
  RiskPlan best;
  double margin_m = 0.0;
  double raise_m = 0.0;
  int rounds_in_vain = 0;
  double before_m = -std::numeric_limits<double>::infinity();
  for (std::int64_t round = 0; round < kRoundsMax; ++round) {
    auto answer = margin_m > 0.0 ? plan(map, raised(map, request, config, margin_m),
                                        raised(config, margin_m), observer)
                                 : plan(map, request, config, observer);
    if (auto* no_plan = std::get_if<flight::NoPlan>(&answer)) {
      if (margin_m > 0.0) {
        char text[80];
        std::snprintf(text, sizeof text, " (with heights raised by %.1f m)", margin_m);
        no_plan->explanation += text;
      }
      return std::move(*no_plan);
    }
    best.plan = std::get<flight::Plan>(std::move(answer));
    best.margin_m = margin_m;
    best.rounds = round + 1;
    best.risk = clearance_risk(map, best.plan.trajectory, demand.errors,
                               config.demands.required_clearance_m, options,
                               demand.seed + static_cast<std::uint64_t>(round));
    best.is_met = best.risk.high <= demand.probability;
    observer.check_stop();
    const double reached_m = best.risk.least_clearances_m[static_cast<std::size_t>(allowed)];
    // Draws differ from round to round: one round without a gain may be chance.
    const bool is_in_vain = raise_m >= kRaiseTold_m && reached_m - before_m < kGainMin * raise_m;
    rounds_in_vain = is_in_vain ? rounds_in_vain + 1 : 0;
    if (best.is_met || !std::isfinite(reached_m) || rounds_in_vain == kRoundsInVainMax) {
      break;
    }
    before_m = reached_m;
    raise_m = std::max(config.demands.required_clearance_m - reached_m, 0.0) + kSpare_m;
    margin_m += raise_m;
  }
  return best;
}

}  // namespace hedgehop::evaluation
