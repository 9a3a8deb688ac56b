#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/config_reader.hpp"
#include "base/observer.hpp"
#include "command_model/path_flight.hpp"
#include "evaluation/problem_drawing.hpp"
#include "map/map.hpp"
#include "planning/planning.hpp"

namespace hedgehop::evaluation {

/// Section `bus` of the evaluation config.
struct BusOptions {
  std::int64_t lockstep_steps = 0;
  std::int64_t plans = 0;    // after the first one
  std::int64_t repeats = 0;  // of each of them, with seeds of their own
  DrawingRules drawing;
  std::vector<double> loss_percents;
  double timeout_s = 0.0;  // longest wait for a service
  double cell_m = 0.0;     // of a map that is made for the purpose
};
BusOptions read_bus_options(ConfigReader& reader);

/// Section `flight` of the evaluation config.
struct FlightOptions {
  std::int64_t plans = 0;
  DrawingRules drawing;
  double wind_mps = 0.0;                // from a drawn direction, another one for each plan
  double turbulence_wind_6m_mps = 0.0;  // of command_model::Turbulence; 0: no rows with turbulence
  double horizontal_margin_m = 0.0;     // how far a flight may stray beside its path,
  double below_margin_m = 0.0;          // below it,
  double above_margin_m = 0.0;          // and above it, with feed-forward
};
FlightOptions read_flight_options(ConfigReader& reader);

/// Plans flown by one plant in one way.
struct FlightRow {
  std::string plant;  // "closed_loop" or "rotor"
  bool has_feed_forward = false;
  bool has_wind = false;
  bool has_turbulence = false;
  std::int64_t flights = 0;
  std::int64_t arrived = 0;
  std::int64_t within_margins = 0;  // and arrived
  double horizontal_max_m = 0.0;    // of all flights
  double horizontal_rms_m = 0.0;    // mean of the flights'
  double below_max_m = 0.0;
  double above_max_m = 0.0;
  double vertical_rms_m = 0.0;
  // Of a rotor; NaN otherwise
  double power_share_max = 0.0;    // of the power that there is
  double torque_margin_min = 0.0;  // 1 - that: at constant rotor speed torque and power go together
  std::int64_t power_limited_flights = 0;  // asked for more than there was at some time
};

struct FlightResult {
  std::uint64_t seed = 0;
  std::int64_t problems = 0;  // drawn for so many plans
  std::int64_t plans = 0;
  double wind_mps = 0.0;
  double turbulence_wind_6m_mps = 0.0;
  double horizontal_margin_m = 0.0;
  double below_margin_m = 0.0;
  double above_margin_m = 0.0;
  double rotor_power_kw = 0.0;
  std::vector<FlightRow> rows;
  // Without turbulence: every flight was within the margins, every one with feed-forward within the
  // power that there is.
  bool is_held = false;
};
/// JSON, schema_version first.
std::string flight_result_json(const FlightResult& result);

/// Flies verified plans of drawn problems again: by the closed-loop model of the planner and by an
/// independent rotor plant, with the path-following controllers of the service command_model, with
/// and without the plan's states as feed-forward, with and without wind beside the one that they
/// were made for, and by switch in turbulence too.
///
/// @throws DataError    too few of the drawn problems have a verified plan.
/// @throws Interrupted
FlightResult evaluate_flight(const map::Map& map, const planning::PlanningConfig& config,
                             const FlightOptions& options,
                             const command_model::RotorParameters& rotor,
                             const command_model::FollowerOptions& follower, std::uint64_t seed,
                             Observer& observer);

}  // namespace hedgehop::evaluation
