#pragma once

#include <chrono>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "console.hpp"
#include "flight/plan.hpp"
#include "global_planning/global_planner.hpp"
#include "output/route_choices.hpp"

namespace hedgehop::cli {

/// Wall and CPU seconds of the stages of a run; written apart from everything that must repeat.
class StageTimer {
 public:
  StageTimer();
  /// Ends a stage that began with the last lap (or the construction).
  void lap(const std::string& stage);
  /// Writes timings.json.
  void write(const std::filesystem::path& folder) const;

 private:
  struct Lap {
    std::string stage;
    double wall_s, cpu_s;
  };
  std::vector<Lap> laps_;
  std::chrono::steady_clock::time_point wall_;
  double cpu_s_ = 0.0;
};

/// Shows the global planner's progress on an observer.
global_planning::OnProgress route_progress(Observer& observer);

/// Prints why there is no plan. Returns 2 for a request that cannot be meant on this map, 3
/// otherwise.
ExitCode report_no_plan(const Console& console, const flight::NoPlan& no_plan);

/// Prints the result of a plan. Returns 0, or 4 when it is not verified. `is_stopped`: the search
/// for its route was ended early. `choices` may be null.
ExitCode report_plan(const Console& console, const flight::Plan& plan, const std::string& folder,
                     bool is_stopped = false, const flight::RouteChoices* choices = nullptr,
                     const std::vector<output::FlownChoice>& flown = {});

}  // namespace hedgehop::cli
