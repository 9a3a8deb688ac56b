#pragma once

#include <functional>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include "base/hash.hpp"
#include "base/observer.hpp"
#include "command_model/command_model.hpp"
#include "flight/plan.hpp"
#include "global_planning/global_planner.hpp"
#include "global_planning/roadmap.hpp"
#include "local_planning/local_planner.hpp"
#include "map/map.hpp"
#include "risk/cost_model.hpp"
#include "verification/verifier.hpp"

namespace hedgehop::planning {

/// A roadmap and what it was made of (roadmap_key()).
struct KeptRoadmap {
  std::shared_ptr<const global_planning::Roadmap> roadmap;  // may be null
  Hash128 key;
};

/// Everything that shapes a plan besides the map and the request; read from one YAML document that
/// holds the vehicle too.
struct PlanningConfig {
  std::string text;  // canonical
  double reference_height_m = 0.0;
  double speed_mps = 0.0;
  double unknown_visibility = 0.0;
  double small_patch_m = 0.0;
  risk::CostWeights weights;
  risk::SemanticCostTable semantics;
  global_planning::GlobalOptions global;
  local_planning::LocalOptions local;
  verification::Demands demands;
  command_model::Vehicle
      vehicle;  // with power_limits, if the conditions say so; calm, see in_wind()
  flight::Conditions conditions = {};
  // Shapes nothing: saves plan_route() the making, if it is the one of the map and this config.
  KeptRoadmap roadmap = {};
};

/// Throws ConfigError. `name` is what errors call the document.
PlanningConfig read_planning_config(const std::string& text, const std::string& name);

/// A config that was recorded with a plan, perhaps by an earlier version: keys that it lacks are
/// taken from the shipped config, since they came with what the earlier version did not do. For
/// looking at plans, not for making them. Throws ConfigError for keys that are not known any more.
PlanningConfig read_recorded_config(const std::string& text, const std::string& name);

/// The shipped planning config with the shipped vehicle, overlaid by a user's file (may be empty:
/// none) and by `key=value` settings.
std::string effective_planning_config(const std::string& config_file,
                                      const std::vector<std::string>& settings);

/// What flying over the map costs with this config. Keeps a pointer to the map. Throws UsageError
/// if the config weighs named observers and the map knows none, see read_map_for().
risk::CostModel cost_model(const map::Map& map, const PlanningConfig& config);

/// The config with the wind of its conditions, in the grid at the start of a flight: known to the
/// vehicle, to global planning and to verification. Flights are never slower than twice the wind.
/// Whatever plans or judges a flight takes its config from here; without wind it is the same.
PlanningConfig in_wind(const PlanningConfig& config, const std::string& crs_wkt,
                       const geo::MapPoint& start);

/// Section `global` for flights at this airspeed: with the power curve, if the conditions ask for
/// it, legs climb and sink no more steeply than the vehicle at this speed; in the wind that
/// in_wind() left.
global_planning::GlobalOptions global_options(const PlanningConfig& config, double speed_mps);

/// Request -> route: what the global_planner service does. Throws UsageError for a speed that the
/// vehicle does not fly.
std::variant<flight::RoutePlan, flight::NoPlan> plan_route(
    const map::Map& map, const flight::PlanRequest& request, const PlanningConfig& config,
    const global_planning::OnProgress& on_progress, Observer& observer);

/// Route -> verified trajectory: what the local_planner service does. `step_model` may be empty:
/// the command model is then stepped in process. `watch` is shown the decisions it wants to see.
std::variant<flight::Plan, flight::NoPlan> plan_flight(
    const map::Map& map, const flight::RoutePlan& route_plan, const PlanningConfig& config,
    const local_planning::StepModel& step_model, Observer& observer,
    const local_planning::DecisionWatch& watch = {});

/// Both: what `hedgehop plan` does.
std::variant<flight::Plan, flight::NoPlan> plan(const map::Map& map,
                                                const flight::PlanRequest& request,
                                                const PlanningConfig& config,
                                                const global_planning::OnProgress& on_progress,
                                                Observer& observer);

}  // namespace hedgehop::planning
