#pragma once

#include <functional>
#include <string>
#include <variant>
#include <vector>

#include "planning/planning.hpp"

namespace hedgehop::planning {

/// When a flight is to be at its places.
struct TimeDemand {
  struct Target {
    std::size_t place = 0;  // 0: start, 1 and on: via points, one more: goal
    Time time;
  };
  std::vector<Target> targets;  // by place, each place once; times grow
  double tolerance_s = 0.0;     // above 0
};

/// A plan with its times of day.
struct TimedPlan {
  flight::Plan plan;  // with its timetable
  int rounds = 0;     // of planning
  bool is_met = false;
  std::string shortfall;  // if it is not: what is missed by how much, and why
};

/// Plans at a speed; without one at that of the config.
using PlanAtSpeed =
    std::function<std::variant<flight::Plan, flight::NoPlan>(std::optional<double> speed_mps)>;

/// Plans a flight that is at its places in time.
///
/// With one target the flight keeps its speed, and the departure is what follows. With more, the
/// first and the last of them fix the speed: the flight is planned again, at most eight times, at
/// the speed that the one before would have needed, until it fits or until the vehicle's limits
/// are reached. The departure then splits what remains among the targets. The best plan is
/// returned, whether it fits or not.
///
/// A flight passes a place when its path is nearest to it, seen from above, of its first visit
/// (verification::first_pass()); it ends at the goal.
///
/// @throws UsageError  for times that do not grow, or that leave more than a day.
std::variant<TimedPlan, flight::NoPlan> plan_on_time(const TimeDemand& demand,
                                                     const PlanningConfig& config,
                                                     const PlanAtSpeed& plan);

/// Seconds from the start of a flight to each of its places: start, via points, goal.
std::vector<double> pass_times_s(const flight::Plan& plan, double via_radius_m);

}  // namespace hedgehop::planning
