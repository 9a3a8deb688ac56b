#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "base/observer.hpp"
#include "local_planning/step_kernels.hpp"
#include "map/map.hpp"
#include "planning/planning.hpp"

namespace hedgehop::evaluation {

struct LocalSpeedOptions {
  int repeats = 0;            // the least time of so many counts, >= 1
  int reference_repeats = 0;  // likewise of the plain form, >= 1
  double length_m = 0.0;      // of the flight, at least 1000
  local_planning::Kernel kernel = local_planning::Kernel::kBest;
};

/// One setting of the local planner. Times are processor time of one thread for a kilometre at 40
/// m/s with a decision every 50 ms: 500 steps of the closed loop.
struct LocalSpeedRow {
  std::string planner;
  double cell_m = 0.0;
  double window_m = 0.0;  // of rollouts: how far they look
  int sectors = 0;        // of rollouts: candidates
  double ms_per_km = 0.0;
  // In the same run: of TVFH+ its plain form; of rollouts the plain form of the TVFH+ that they
  // replace, 350 m and 64 sectors over the same cells.
  double reference_ms_per_km = 0.0;
  double plain_form_ms_per_km = 0.0;  // of the same planner
  // NaN: not in the paper's table. Rollouts over its cells of 30 m stand beside 350 m, 64 sectors.
  double paper_ms_per_km = 0.0;
  double setup_ms = 0.0;  // padded and dilated layers, made once for a map
  double length_km = 0.0;
  bool is_same_bytes = false;  // flight of the plain form
};

struct LocalSpeedResult {
  std::string kernel;
  std::string map;
  std::vector<LocalSpeedRow> rows;
  bool is_stopped = false;  // early: rows are missing
};

/// Hills of 0 to 500 m with valleys 1 to 6 km apart, blobs of visibility and some settlements;
/// cells of any size cut up the same land. Always the same bytes.
map::Map synthetic_hills(double cell_m, double east_m, double north_m);

/// Times the closed loop of the local planner along one guide: TVFH+ over the windows and numbers
/// of sectors of the paper's table 1, then the other modes.
///
/// Fast and plain forms take turns, so that both meet the same disturbances.
///
/// @param map       null: synthetic hills, the shipped mode with finer cells as well
/// @param config    its window and number of sectors are replaced for the table
/// @param thread_cpu_s  clock, since rooms own none
/// @throws DataError  no guide on the map could be flown
/// @throws Interrupted
LocalSpeedResult evaluate_local_speed(const map::Map* map, const planning::PlanningConfig& config,
                                      const LocalSpeedOptions& options,
                                      const std::function<double()>& thread_cpu_s,
                                      Observer& observer);

std::string local_speed_json(const LocalSpeedResult& result);

}  // namespace hedgehop::evaluation
