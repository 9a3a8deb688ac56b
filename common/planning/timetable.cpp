#include "planning/timetable.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "base/errors.hpp"
#include "geo/map_projection.hpp"
#include "verification/via_pass.hpp"

namespace hedgehop::planning {
namespace {

constexpr int kRoundsMax = 8;
constexpr double kDay_s = 86400.0;
constexpr double kFit = 0.5;  // of the tolerance: where the search for a speed ends

void require_usable(const TimeDemand& demand) {
  HEDGEHOP_ASSERT(!demand.targets.empty() && demand.tolerance_s > 0.0);
  for (std::size_t i = 1; i < demand.targets.size(); ++i) {
    const double between_s = seconds_between(demand.targets[i - 1].time, demand.targets[i].time);
    if (!(between_s > 0.0 && between_s <= kDay_s)) {
      throw UsageError("the times of the places do not follow on each other: place " +
                           std::to_string(demand.targets[i].place) + " comes " +
                           std::to_string(std::lround(between_s)) + " s after the one before",
                       "let times grow from the start to the goal, by a day at most");
    }
  }
}

struct Fit {
  double departure_s = 0.0;  // since the first target
  double error_s = 0.0;      // greatest
};

// The departure that splits the errors evenly.
Fit fit_of(const TimeDemand& demand, const std::vector<double>& passes_s) {
  double earliest_s = 0.0;
  double latest_s = 0.0;
  for (std::size_t i = 0; i < demand.targets.size(); ++i) {
    const TimeDemand::Target& target = demand.targets[i];
    const double departure_s =
        seconds_between(demand.targets.front().time, target.time) - passes_s[target.place];
    earliest_s = i == 0 ? departure_s : std::min(earliest_s, departure_s);
    latest_s = i == 0 ? departure_s : std::max(latest_s, departure_s);
  }
  return {0.5 * (earliest_s + latest_s), 0.5 * (latest_s - earliest_s)};
}

flight::Timetable timetable_of(const TimeDemand& demand, const std::vector<double>& passes_s,
                               const Fit& fit) {
  const auto microseconds = [](double seconds) {
    return static_cast<std::int64_t>(std::llround(1e6 * seconds));
  };
  flight::Timetable table;
  table.tolerance_s = demand.tolerance_s;
  for (std::size_t place = 0; place < passes_s.size(); ++place) {
    flight::Timetable::Entry entry;
    entry.place = place;
    entry.expected = {demand.targets.front().time.utime_us +
                      microseconds(fit.departure_s + passes_s[place])};
    for (const TimeDemand::Target& target : demand.targets) {
      if (target.place == place) {
        entry.wanted = target.time;
      }
    }
    table.entries.push_back(entry);
  }
  return table;
}

}  // namespace

std::vector<double> pass_times_s(const flight::Plan& plan, double via_radius_m) {
  const auto& states = plan.trajectory.states;
  HEDGEHOP_ASSERT(!states.empty());
  const geo::MapProjection projection(plan.route_plan.map.crs_wkt);
  std::vector<double> times_s = {0.0};
  std::size_t begin = 0;
  for (const flight::RequestPoint& via : plan.route_plan.request.via) {
    const verification::Pass pass =
        verification::first_pass(states, begin, projection.to_map(via.position), via_radius_m);
    times_s.push_back(states[pass.piece].time_s - states.front().time_s);
    if (pass.distance_m <= via_radius_m) {
      begin = pass.entry;
    }
  }
  times_s.push_back(states.back().time_s - states.front().time_s);
  return times_s;
}

std::variant<TimedPlan, flight::NoPlan> plan_on_time(const TimeDemand& demand,
                                                     const PlanningConfig& config,
                                                     const PlanAtSpeed& plan) {
  require_usable(demand);
  const TimeDemand::Target& first = demand.targets.front();
  const TimeDemand::Target& last = demand.targets.back();
  const double wanted_s = seconds_between(first.time, last.time);
  const flight::Limits& limits = config.vehicle.limits;
  const double speed_min_mps =
      std::max(limits.speed_min_mps, config.conditions.wind_mps / flight::kWindShareMax);
  std::optional<TimedPlan> best;
  double best_error_s = 0.0;
  double best_flown_s = 0.0;
  std::optional<double> speed_mps;
  for (int round = 1; round <= kRoundsMax; ++round) {
    auto answer = plan(speed_mps);
    if (auto* no_plan = std::get_if<flight::NoPlan>(&answer)) {
      if (best) {
        break;  // at another speed there is one
      }
      return std::move(*no_plan);
    }
    auto& found = std::get<flight::Plan>(answer);
    const std::vector<double> passes_s = pass_times_s(found, config.demands.via_radius_m);
    HEDGEHOP_ASSERT(last.place < passes_s.size());
    const Fit fit = fit_of(demand, passes_s);
    const double flown_s = passes_s[last.place] - passes_s[first.place];
    const double flown_mps = found.route_plan.request.speed_mps.value_or(config.speed_mps);
    if (!best || fit.error_s < best_error_s) {
      best_error_s = fit.error_s;
      best_flown_s = flown_s;
      found.timetable = timetable_of(demand, passes_s, fit);
      best = TimedPlan{std::move(found), round, false, ""};
    }
    best->rounds = round;
    if (demand.targets.size() < 2 || fit.error_s <= kFit * demand.tolerance_s) {
      break;
    }
    const double next_mps =
        std::clamp(flown_mps * flown_s / wanted_s, speed_min_mps, limits.speed_max_mps);
    if (next_mps == flown_mps) {
      break;
    }
    speed_mps = next_mps;
  }
  best->is_met = best_error_s <= demand.tolerance_s;
  if (!best->is_met) {
    const double speed = best->plan.route_plan.request.speed_mps.value_or(config.speed_mps);
    char text[300];
    std::snprintf(text, sizeof text,
                  "the wanted times are missed by %.1f s, %.1f s are allowed: from place %zu to "
                  "place %zu they leave %.1f s, the flight at %.1f m/s takes %.1f s%s",
                  best_error_s, demand.tolerance_s, first.place, last.place, wanted_s, speed,
                  best_flown_s,
                  speed >= limits.speed_max_mps ? ", and the vehicle flies no faster"
                  : speed <= speed_min_mps      ? ", and the vehicle flies no slower"
                  : demand.targets.size() > 2   ? "; a flight has one speed"
                                                : "");
    best->shortfall = text;
  }
  return std::move(*best);
}

}  // namespace hedgehop::planning
