#include "evaluation/contestants.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <type_traits>
#include <variant>

#include "base/errors.hpp"
#include "evaluation/child_run.hpp"
#include "global_planning/bit_star_search.hpp"
#include "global_planning/corridor_refinement.hpp"
#include "global_planning/flight_envelope.hpp"
#include "global_planning/roadmap.hpp"
#include "global_planning/route_finish.hpp"
#include "global_planning/stock_planner.hpp"
#include "global_planning/waypoint_moves.hpp"

namespace hedgehop::evaluation {
namespace {

using flight::Waypoint;
using global_planning::FlightEnvelope;
using global_planning::GlobalOptions;
using global_planning::StockMethod;

constexpr std::int64_t kNoLimit = std::numeric_limits<std::int64_t>::max() / 4;
constexpr double kCostStep_m = 1.0;

/// Seconds of processor time since it was made.
class Stopwatch {
 public:
  explicit Stopwatch(const ProcessClock& clock) : clock_(&clock), begin_s_(clock()) {}
  [[nodiscard]] double elapsed_s() const { return (*clock_)() - begin_s_; }

 private:
  const ProcessClock* clock_;
  double begin_s_;
};

/// Asks to stop after a time, or when the user does.
class TimedObserver final : public Observer {
 public:
  TimedObserver(const Observer& whole, const Stopwatch& watch, double limit_s)
      : whole_(&whole), watch_(&watch), limit_s_(limit_s) {}
  void progress(std::string_view, double, double) override {}
  void note(std::string_view) override {}
  [[nodiscard]] bool stop_requested() const override {
    return whole_->stop_requested() || watch_->elapsed_s() >= limit_s_;
  }

 private:
  const Observer* whole_;
  const Stopwatch* watch_;
  double limit_s_;
};

/// Marks of an anytime run that goes through all budgets without a pause.
class Marks {
 public:
  Marks(const std::vector<double>& budgets_s, Attempt& attempt)
      : budgets_s_(&budgets_s), attempt_(&attempt) {}
  /// Says how many edges there are at a time; call often. The last budget is what end() is for.
  void at(double time_s, std::int64_t edges) {
    while (attempt_->marks.size() + 1 < budgets_s_->size() &&
           time_s >= (*budgets_s_)[attempt_->marks.size()]) {
      attempt_->marks.push_back({(*budgets_s_)[attempt_->marks.size()], edges});
    }
  }
  void end(double time_s, std::int64_t edges) {
    while (attempt_->marks.size() < budgets_s_->size()) {
      attempt_->marks.push_back({time_s, edges});
    }
  }

 private:
  const std::vector<double>* budgets_s_;
  Attempt* attempt_;
};

Attempt run_recommended(const risk::CostModel& costs, const GlobalOptions& options,
                        const OptimalityTask& task, const ProcessClock& clock,
                        const Observer& observer) {
  Attempt attempt;
  Marks marks(task.budgets_s, attempt);
  const Stopwatch watch(clock);
  const TimedObserver timed(observer, watch, task.budgets_s.back());
  double best_m = std::numeric_limits<double>::infinity();
  std::int64_t work_units = 0;
  const auto hear = [&](const global_planning::RouteProgress& progress) {
    const double time_s = watch.elapsed_s();
    work_units = progress.work_units;
    marks.at(time_s, work_units);
    attempt.lower_bound_m = std::max(attempt.lower_bound_m, progress.lower_bound_m);
    if (progress.best_route != nullptr && progress.best_cost_m < best_m) {
      best_m = progress.best_cost_m;
      attempt.routes.push_back({time_s, *progress.best_route});
    }
  };
  const auto found = global_planning::plan_leg(
      costs, options, {task.start, task.goal, task.seed, options.work_budget}, hear, timed);
  const double time_s = watch.elapsed_s();
  observer.check_stop();
  if (const auto* route = std::get_if<flight::Route>(&found)) {
    attempt.routes.push_back({time_s, route->waypoints});
    attempt.lower_bound_m = std::max(attempt.lower_bound_m, route->lower_bound_m);
    work_units = route->work_units;
  } else if (const auto& none = std::get<flight::NoPlan>(found);
             flight::is_named_cause(none.cause) && none.cause != flight::NoPlanCause::kStopped) {
    attempt.no_route_cause = std::string(flight::name_of(none.cause)) + ": " + none.explanation;
  }
  marks.end(time_s, work_units);
  return attempt;
}

std::vector<Waypoint> with_legs_up_to(double most_m, const std::vector<Waypoint>& route) {
  std::vector<Waypoint> result = {route.front()};
  for (std::size_t i = 1; i < route.size(); ++i) {
    const Waypoint& a = route[i - 1];
    const Waypoint& b = route[i];
    const int parts = std::max(1, static_cast<int>(std::ceil(flight::length_m({a, b}) / most_m)));
    for (int part = 1; part < parts; ++part) {
      const double t = static_cast<double>(part) / parts;
      result.push_back({a.x_m + t * (b.x_m - a.x_m), a.y_m + t * (b.y_m - a.y_m),
                        a.altitude_m + t * (b.altitude_m - a.altitude_m)});
    }
    result.push_back(b);
  }
  return result;
}

/// Plans without any rule about turns, and then moves every piece of the route for itself.
Attempt run_free_turns(const risk::CostModel& costs, GlobalOptions options,
                       const OptimalityTask& task, const ProcessClock& clock,
                       const Observer& observer) {
  constexpr double kAnyTurn_rad = 3.1415;
  constexpr std::array<double, 3> kPieces_m = {60.0, 40.0, 30.0};
  options.turn_radius_m = 0.0;
  options.turn_angle_max_rad = kAnyTurn_rad;
  Attempt attempt;
  Marks marks(task.budgets_s, attempt);
  const Stopwatch watch(clock);
  const auto found = global_planning::plan_leg(
      costs, options, {task.start, task.goal, task.seed, options.work_budget}, {}, observer);
  observer.check_stop();
  std::int64_t work_units = 0;
  if (const auto* planned = std::get_if<flight::Route>(&found)) {
    const FlightEnvelope envelope(costs, options, task.start, task.goal);
    std::vector<Waypoint> route = planned->waypoints;
    for (const double piece_m : kPieces_m) {
      observer.check_stop();
      route = with_legs_up_to(piece_m, route);
      global_planning::move_waypoints(envelope, kNoLimit, work_units, route,
                                      envelope.route_cost_m(route, kCostStep_m));
    }
    attempt.routes.push_back({watch.elapsed_s(), std::move(route)});
    work_units += planned->work_units;
  }
  marks.end(watch.elapsed_s(), work_units);
  return attempt;
}

/// Queries on one roadmap. What is made once, for all of them, is not counted.
class RoadmapQueries {
 public:
  RoadmapQueries(const risk::CostModel& costs, const GlobalOptions& options)
      : costs_(&costs), options_(options) {}

  Attempt run(const OptimalityTask& task, const ProcessClock& clock, const Observer& observer) {
    if (!roadmap_) {
      SilentObserver silent;
      roadmap_.emplace(*costs_, options_, silent);
      envelope_.emplace(*costs_, options_, task.start, task.goal);
    }
    Attempt attempt;
    Marks marks(task.budgets_s, attempt);
    const Stopwatch watch(clock);
    const TimedObserver timed(observer, watch, task.budgets_s.back());
    envelope_->move_start(task.start);
    envelope_->move_goal(task.goal);
    std::int64_t work_units = 0;
    std::vector<Waypoint> route;
    if (envelope_->contains(task.start) && envelope_->contains(task.goal)) {
      route = global_planning::roadmap_route(*envelope_, *roadmap_, kNoLimit, work_units,
                                             [&] { return timed.stop_requested(); });
    }
    const double time_s = watch.elapsed_s();
    observer.check_stop();
    if (!route.empty()) {
      attempt.routes.push_back({time_s, std::move(route)});
    }
    marks.end(time_s, work_units);
    return attempt;
  }

 private:
  const risk::CostModel* costs_;
  GlobalOptions options_;
  std::optional<global_planning::Roadmap> roadmap_;
  std::optional<FlightEnvelope> envelope_;
};

GlobalOptions paper_options(GlobalOptions options) {
  options.use_lattice = false;
  options.refine = false;
  options.heuristic = global_planning::SearchHeuristic::kLength;
  options.sampler = global_planning::SamplingRegion::kEllipse;
  options.turn_rule = global_planning::TurnRule::kInsertion;
  options.turn_radius_m = 0.0;
  return options;
}

Attempt run_bit_star(const risk::CostModel& costs, const GlobalOptions& options,
                     const OptimalityTask& task, const ProcessClock& clock,
                     const Observer& observer) {
  Attempt attempt;
  Marks marks(task.budgets_s, attempt);
  const Stopwatch watch(clock);
  const TimedObserver timed(observer, watch, task.budgets_s.back());
  const FlightEnvelope envelope(costs, options, task.start, task.goal);
  if (!envelope.contains(task.start) || !envelope.contains(task.goal)) {
    attempt.failure = "start or goal lies outside the flight envelope";
    return attempt;
  }
  global_planning::BitStarSearch search(envelope, options, task.seed);
  double best_m = std::numeric_limits<double>::infinity();
  search.run(
      kNoLimit,
      [&] {
        marks.at(watch.elapsed_s(), search.counts().work_units);
        return timed.stop_requested();
      },
      [&] {
        if (search.best_cost_m() < best_m) {
          best_m = search.best_cost_m();
          attempt.routes.push_back({watch.elapsed_s(), search.best_route()});
        }
      });
  marks.end(watch.elapsed_s(), search.counts().work_units);
  attempt.lower_bound_m = search.lower_bound_m();
  observer.check_stop();
  return attempt;
}

// --- messages of the child: a kind, then plain numbers

struct MarkMessage {
  char kind = 'm';
  double stopped_s = 0.0;
  std::int64_t edges = 0;
};
struct RouteMessage {
  char kind = 'r';
  double time_s = 0.0;
  std::uint64_t waypoints = 0;  // follow
};
static_assert(std::is_trivially_copyable_v<Waypoint> && sizeof(Waypoint) == 3 * sizeof(double));

template <typename Message>
Message message_of(std::string_view bytes) {
  HEDGEHOP_ASSERT(bytes.size() >= sizeof(Message));
  Message message;
  std::memcpy(&message, bytes.data(), sizeof message);
  return message;
}

template <typename Message>
std::string_view bytes_of(const Message& message) {
  return {reinterpret_cast<const char*>(&message), sizeof message};
}

void hear_child(std::string_view bytes, Attempt& attempt) {
  HEDGEHOP_ASSERT(!bytes.empty());
  if (bytes.front() == 'm') {
    const auto mark = message_of<MarkMessage>(bytes);
    attempt.marks.push_back({mark.stopped_s, mark.edges});
    return;
  }
  const auto head = message_of<RouteMessage>(bytes);
  const std::size_t rest = bytes.size() - sizeof head;
  HEDGEHOP_ASSERT(rest == head.waypoints * sizeof(Waypoint));
  TimedRoute route{head.time_s, std::vector<Waypoint>(head.waypoints)};
  std::memcpy(route.waypoints.data(), bytes.data() + sizeof head, rest);
  attempt.routes.push_back(std::move(route));
}

std::string message_of_route(double time_s, const std::vector<Waypoint>& route) {
  const RouteMessage head{'r', time_s, route.size()};
  std::string message(bytes_of(head));
  message.append(reinterpret_cast<const char*>(route.data()), route.size() * sizeof(Waypoint));
  return message;
}

double turn_radius_m_of(const planning::PlanningConfig& config) {
  return config.global.turn_radius_m > 0.0
             ? config.global.turn_radius_m
             : flight::turn_radius_min_m(config.speed_mps, config.vehicle.limits.bank_max_rad);
}

}  // namespace

Attempt run_stock(const risk::CostModel& costs, const GlobalOptions& options, const StockRun& run,
                  const OptimalityTask& task, const ProcessClock& clock, const Observer& observer) {
  const auto work = [&](const SendMessage& send) {
    const Stopwatch watch(clock);
    const FlightEnvelope envelope(costs, options, task.start, task.goal);
    global_planning::StockPlanner planner(envelope, options, run.method, run.turn_radius_m,
                                          task.seed, run.headings);
    for (const double budget_s : task.budgets_s) {
      planner.run([&] { return watch.elapsed_s() >= budget_s; },
                  [&](const std::vector<Waypoint>& route) {
                    send(message_of_route(watch.elapsed_s(), route));
                  });
      send(bytes_of(MarkMessage{'m', watch.elapsed_s(), planner.edge_evaluations()}));
    }
  };
  Attempt attempt;
  attempt.failure = run_in_child(
      work, [&](std::string_view bytes) { hear_child(bytes, attempt); },
      task.budgets_s.back() + run.overrun_s, observer);
  return attempt;
}

Attempt run_paper_planner(const risk::CostModel& costs, const GlobalOptions& options,
                          const OptimalityTask& task, double overrun_s, const ProcessClock& clock,
                          const Observer& observer) {
  const auto work = [&](const SendMessage& send) {
    const Attempt inner =
        run_bit_star(costs, paper_options(options), task, clock, SilentObserver());
    for (const TimedRoute& route : inner.routes) {
      send(message_of_route(route.time_s, route.waypoints));
    }
    for (const BudgetMark& mark : inner.marks) {
      send(bytes_of(MarkMessage{'m', mark.stopped_s, mark.edges}));
    }
    if (!inner.failure.empty()) {
      throw std::runtime_error(inner.failure);
    }
  };
  Attempt attempt;
  attempt.failure = run_in_child(
      work, [&](std::string_view bytes) { hear_child(bytes, attempt); },
      task.budgets_s.back() + overrun_s, observer);
  return attempt;
}

std::vector<std::string> contestant_names() {
  std::vector<std::string> names = {"recommended",    "roadmap",       "bitstar",
                                    "bitstar_labels", "bitstar_field", "free_turns"};
  for (const StockMethod method : global_planning::kStockMethods) {
    names.emplace_back(name_of(method));
  }
  return names;
}

std::vector<Contestant> make_contestants(const std::vector<std::string>& names,
                                         const risk::CostModel& costs,
                                         const planning::PlanningConfig& config, double overrun_s,
                                         const ProcessClock& clock) {
  std::vector<Contestant> contestants;
  const auto add = [&](const std::string& name, const char* turn_rule, bool is_stock, auto run) {
    contestants.push_back({name, turn_rule, is_stock, std::move(run)});
  };
  for (const std::string& name : names) {
    if (std::count(names.begin(), names.end(), name) > 1) {
      throw UsageError("the planner '" + name + "' is named twice", "name each planner once");
    }
    if (name == "recommended") {
      add(name, config.global.turn_radius_m > 0.0 ? "radius" : "angle", false,
          [&costs, &config, clock](const OptimalityTask& task, const Observer& observer) {
            return run_recommended(costs, config.global, task, clock, observer);
          });
      continue;
    }
    if (name == "roadmap") {
      add(name, config.global.turn_radius_m > 0.0 ? "radius" : "angle", false,
          [queries = std::make_shared<RoadmapQueries>(costs, config.global), clock](
              const OptimalityTask& task, const Observer& observer) {
            return queries->run(task, clock, observer);
          });
      continue;
    }
    if (name == "bitstar" || name == "bitstar_field" || name == "bitstar_labels") {
      GlobalOptions options = paper_options(config.global);
      if (name == "bitstar_field") {
        options.heuristic = global_planning::SearchHeuristic::kCostField;
        options.sampler = global_planning::SamplingRegion::kLevelSet;
      }
      if (name != "bitstar") {
        options.turn_rule = global_planning::TurnRule::kHeadingLabels;
      }
      add(name, "angle", false,
          [&costs, options, clock](const OptimalityTask& task, const Observer& observer) {
            return run_bit_star(costs, options, task, clock, observer);
          });
      continue;
    }
    if (name == "free_turns") {
      add(name, "none", true,
          [&costs, &config, clock](const OptimalityTask& task, const Observer& observer) {
            return run_free_turns(costs, config.global, task, clock, observer);
          });
      continue;
    }
    const auto* const method =
        std::find_if(global_planning::kStockMethods.begin(), global_planning::kStockMethods.end(),
                     [&](StockMethod candidate) { return name_of(candidate) == name; });
    if (method == global_planning::kStockMethods.end()) {
      std::string known;
      for (const std::string& other : contestant_names()) {
        known += (known.empty() ? "" : ", ") + other;
      }
      throw UsageError("no planner is called '" + name + "'", "choose from " + known);
    }
    add(name, *method == StockMethod::kDubins ? "curves" : "none", true,
        [&costs, &config, method = *method, overrun_s, clock](const OptimalityTask& task,
                                                              const Observer& observer) {
          return run_stock(costs, config.global, {method, turn_radius_m_of(config), {}, overrun_s},
                           task, clock, observer);
        });
  }
  return contestants;
}

Polish make_polish(const risk::CostModel& costs, const planning::PlanningConfig& config,
                   const ProcessClock& clock) {
  return [&costs, &config, clock](const OptimalityTask& task,
                                  const std::vector<std::vector<Waypoint>>& candidates,
                                  double seconds, const Observer& observer) {
    const Stopwatch watch(clock);
    const TimedObserver timed(observer, watch, seconds);
    const FlightEnvelope envelope(costs, config.global, task.start, task.goal);
    std::vector<Waypoint> best;
    double best_m = std::numeric_limits<double>::infinity();
    const auto offer = [&](const std::vector<Waypoint>& route) {
      const double cost_m = costs.route_cost(route, kCostStep_m).total_m();
      if (cost_m < best_m) {
        best_m = cost_m;
        best = route;
      }
    };
    for (std::vector<Waypoint> route : candidates) {
      if (timed.stop_requested()) {
        break;
      }
      std::int64_t work_units = 0;
      refine(envelope, kNoLimit, work_units, route,
             [&](double, std::int64_t) { return timed.stop_requested(); });
      cut_short(envelope, config.global.final_check_step_m, kNoLimit, work_units, route);
      offer(route);
    }
    constexpr std::array<double, 4> kBlocks_m = {30.0, 120.0, 90.0, 45.0};
    constexpr std::int64_t kBitStarWork = 400'000;
    for (std::size_t round = 0; !timed.stop_requested(); ++round) {
      GlobalOptions options = config.global;
      options.refine = true;
      options.work_budget = kNoLimit;
      options.use_lattice = round < kBlocks_m.size();
      if (options.use_lattice) {
        options.field_block_m = kBlocks_m[round];
      } else {
        options.work_budget =
            kBitStarWork * static_cast<std::int64_t>(1 + (round - kBlocks_m.size()) / 4);
      }
      const auto found = plan_leg(
          costs, options, {task.start, task.goal, task.seed + 1000 + round, options.work_budget},
          {}, timed);
      if (const auto* route = std::get_if<flight::Route>(&found)) {
        offer(route->waypoints);
      } else if (flight::is_named_cause(std::get<flight::NoPlan>(found).cause)) {
        break;
      }
    }
    return best;
  };
}

}  // namespace hedgehop::evaluation
