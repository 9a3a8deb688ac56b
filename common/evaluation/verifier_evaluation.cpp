#include "evaluation/verifier_evaluation.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <nlohmann/json.hpp>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>
#include <optional>
#include <random>
#include <set>

#include "base/errors.hpp"
#include "evaluation/brute_force_judge.hpp"
#include "evaluation/crowd_observer.hpp"
#include "output/plan_bundle.hpp"
#include "verification/plan_check.hpp"

namespace hedgehop::evaluation {
namespace {

// Beyond this neither side of a comparison says anything: the samples look no farther than 300 m.
constexpr double kCompared_m = 250.0;

double drawn(double low, double high, std::mt19937_64& random) {
  return low + (high - low) * static_cast<double>(random() >> 11U) * 0x1p-53;
}

struct Task {
  flight::Waypoint start;
  std::vector<geo::MapPoint> via;
  flight::Waypoint goal;
};

// What became of one problem.
struct Finished {
  bool has_plan = false;
  std::string error;
  std::vector<Judgement> judgements;
  std::int64_t sharp = 0;
  std::int64_t sharp_false_alarms = 0;
  std::int64_t sharp_accepted_wrongly = 0;
  std::vector<std::pair<verification::Hazard, double>> gaps;
};

std::vector<std::string> rules_of(const flight::Verdict& verdict) {
  std::set<std::string> rules;
  for (const flight::Violation& violation : verdict.violations) {
    rules.insert(violation.rule);
  }
  return {rules.begin(), rules.end()};
}

// Masts and squares beside the path: some are flown through, some are missed by metres.
void draw_hazards(const flight::Trajectory& flight, const VerifierOptions& options,
                  std::mt19937_64& random, map::Map& map) {
  const auto place = [&](double& altitude_m) {
    const auto& states = flight.states;
    const flight::FlightState& state = states[random() % states.size()];
    const double azimuth_rad = state.heading_true_rad - state.convergence_rad;
    const double aside_m = drawn(-options.hazard_distance_m, options.hazard_distance_m, random);
    altitude_m = state.altitude_m;
    return geo::MapPoint{state.x_m + aside_m * std::cos(azimuth_rad),
                         state.y_m - aside_m * std::sin(azimuth_rad)};
  };
  for (std::int64_t i = 0; i < options.masts; ++i) {
    map::Obstacle mast;
    double altitude_m = 0.0;
    mast.point = place(altitude_m);
    mast.radius_m = drawn(0.1, 15.0, random);
    mast.height_m = 0.0;
    mast.top_m = altitude_m + drawn(-40.0, 40.0, random);
    map.obstacles.push_back(mast);
  }
  for (std::int64_t i = 0; i < options.areas; ++i) {
    map::Area area;
    double altitude_m = 0.0;
    const geo::MapPoint middle = place(altitude_m);
    const double reach_m = drawn(1.0, 0.7 * options.hazard_distance_m, random);
    const double turn_rad = drawn(0.0, 1.6, random);
    map::Area::Polygon polygon;
    for (int corner = 0; corner <= 4; ++corner) {
      const double angle_rad = turn_rad + (corner % 4) * 1.5707963267948966;
      polygon.outer.push_back(
          {middle.x_m + reach_m * std::cos(angle_rad), middle.y_m + reach_m * std::sin(angle_rad)});
    }
    area.polygons = {polygon};
    const double limit_m = altitude_m + drawn(-20.0, 20.0, random);
    const double none_m = std::numeric_limits<double>::infinity();
    const bool is_above = random() % 2 == 0;
    area.floor.value_m = is_above ? limit_m : -none_m;
    area.ceiling.value_m = is_above ? none_m : limit_m;
    map.areas.push_back(area);
  }
}

class Judge {
 public:
  Judge(const planning::PlanningConfig& config, const VerifierOptions& options,
        const flight::Plan& plan, Task task, Finished& outcome)
      : config_(config),
        options_(options),
        plan_(plan),
        task_(std::move(task)),
        outcome_(outcome) {}

  void judge(const map::Map& map, std::int64_t problem, bool has_hazards) {
    const BruteForceVerdict brute = by_brute_force(map);
    const flight::Verdict verdict =
        has_hazards ? verdict_of(map, config_.demands)
                    : verification::check_plan(map, plan_, output::trajectory_csv(plan_)).verdict;
    Judgement judgement;
    judgement.problem = problem;
    judgement.has_hazards = has_hazards;
    judgement.is_accepted_by_brute_force = brute.accepts();
    judgement.is_accepted_by_verifier = verdict.is_verified;
    judgement.brute_force_rules = brute.broken;
    judgement.verifier_rules = rules_of(verdict);
    judgement.spare_m = brute.distances.spare_m(config_.demands.required_clearance_m);
    outcome_.judgements.push_back(std::move(judgement));
    compare_distances(map, brute.distances);
    if (!has_hazards && brute.accepts()) {
      sharpen(map, brute.distances);
    }
  }

 private:
  [[nodiscard]] BruteForceVerdict by_brute_force(const map::Map& map) const {
    return judge_by_brute_force(map, plan_.trajectory, task_.start, task_.via, task_.goal,
                                config_.vehicle.limits, config_.demands, options_.sample_m);
  }
  [[nodiscard]] flight::Verdict verdict_of(const map::Map& map,
                                           const verification::Demands& demands) const {
    return verification::verify(map, plan_.trajectory, task_.start, task_.via, task_.goal,
                                config_.vehicle.limits, demands);
  }

  void sharpen(const map::Map& map, const SampledDistances& distances) const {
    const double least_m = std::min({distances.ground_m, distances.wire_m, distances.obstacle_m});
    verification::Demands demands = config_.demands;
    ++outcome_.sharp;
    demands.required_clearance_m = least_m - options_.sampling_error_m;
    outcome_.sharp_false_alarms += verdict_of(map, demands).is_verified ? 0 : 1;
    demands.required_clearance_m = least_m + 1e-3;
    outcome_.sharp_accepted_wrongly += verdict_of(map, demands).is_verified ? 1 : 0;
  }

  void compare_distances(const map::Map& map, const SampledDistances& sampled) const {
    const verification::Margins margins = verification::measure_margins(
        map, plan_.trajectory, task_.via, config_.vehicle.limits, config_.demands);
    for (const verification::NearMiss& miss : margins.nearest) {
      const double sampled_m = miss.hazard == verification::Hazard::kGround     ? sampled.ground_m
                               : miss.hazard == verification::Hazard::kWire     ? sampled.wire_m
                               : miss.hazard == verification::Hazard::kObstacle ? sampled.obstacle_m
                                                                                : sampled.area_m;
      if (std::min(sampled_m, miss.distance_m) < kCompared_m) {
        outcome_.gaps.emplace_back(miss.hazard, sampled_m - miss.distance_m);
      }
    }
  }

  const planning::PlanningConfig& config_;
  const VerifierOptions& options_;
  const flight::Plan& plan_;
  Task task_;
  Finished& outcome_;
};

bool is_between_samples(const Judgement& judgement, double sampling_error_m) {
  return judgement.spare_m < sampling_error_m &&
         std::all_of(judgement.verifier_rules.begin(), judgement.verifier_rules.end(),
                     [](const std::string& rule) {
                       return rule == "clearance" || rule == "wire_clearance" ||
                              rule == "obstacle_clearance" || rule == "no_fly_area";
                     });
}

void count(const Finished& outcome, const VerifierOptions& options, VerifierResult& result) {
  if (!outcome.error.empty()) {
    result.errors.push_back(outcome.error);
    return;
  }
  ++(outcome.has_plan ? result.plans : result.no_plan);
  for (const Judgement& judgement : outcome.judgements) {
    ++result.judgements;
    if (judgement.is_accepted_by_brute_force == judgement.is_accepted_by_verifier) {
      ++(judgement.is_accepted_by_verifier ? result.both_accept : result.both_refuse);
      continue;
    }
    if (judgement.is_accepted_by_verifier) {
      ++result.accepted_wrongly;
    } else {
      ++result.false_alarms;
      result.between_samples += is_between_samples(judgement, options.sampling_error_m) ? 1 : 0;
    }
    result.disagreements.push_back(judgement);
  }
  result.sharp += outcome.sharp;
  result.sharp_false_alarms += outcome.sharp_false_alarms;
  result.sharp_accepted_wrongly += outcome.sharp_accepted_wrongly;
  for (const auto& [hazard, gap_m] : outcome.gaps) {
    Gap& gap = hazard == verification::Hazard::kGround     ? result.ground
               : hazard == verification::Hazard::kWire     ? result.wire
               : hazard == verification::Hazard::kObstacle ? result.obstacle
                                                           : result.area;
    gap.add(gap_m);
  }
}

}  // namespace

void Gap::add(double gap_m) {
  ++count;
  least_m = std::min(least_m, gap_m);
  greatest_m = std::max(greatest_m, gap_m);
}

VerifierOptions read_verifier_options(ConfigReader& reader) {
  VerifierOptions options;
  options.plans = reader.required_integer("plans");
  options.drawing = read_drawing_rules(reader);
  options.work_budget = reader.required_integer("work_budget");
  options.via_every = reader.required_integer("via_every");
  options.sample_m = reader.required_double("sample_m");
  options.sampling_error_m = reader.required_double("sampling_error_m");
  options.masts = reader.required_integer("masts");
  options.areas = reader.required_integer("areas");
  options.hazard_distance_m = reader.required_double("hazard_distance_m");
  reader.require(options.plans >= 1 && options.plans <= 1000000, "plans",
                 "must lie between 1 and 1000000");
  reader.require(options.work_budget >= 0, "work_budget", "must not be negative");
  reader.require(options.via_every >= 0, "via_every", "must not be negative");
  reader.require(options.sample_m > 0.0, "sample_m", "must be above 0");
  reader.require(options.sampling_error_m > 0.0, "sampling_error_m", "must be above 0");
  reader.require(options.masts >= 0 && options.masts <= 1000, "masts",
                 "must lie between 0 and 1000");
  reader.require(options.areas >= 0 && options.areas <= 1000, "areas",
                 "must lie between 0 and 1000");
  reader.require(options.hazard_distance_m > 2.0, "hazard_distance_m", "must be above 2");
  reader.finish();
  return options;
}

VerifierResult evaluate_verifier(const map::Map& map, const planning::PlanningConfig& config,
                                 const VerifierOptions& options, std::uint64_t seed,
                                 const PlanFunction& plan, Observer& observer) {
  const DrawnProblems problems = draw_problems(map, options.drawing, options.plans, seed);
  const auto total = static_cast<std::size_t>(options.plans);
  std::vector<Finished> outcomes(total);
  std::vector<char> is_done(total, 0);
  std::atomic<std::size_t> done{0};
  const auto run_one = [&](std::size_t index) {
    if (observer.stop_requested()) {
      return;
    }
    Finished& outcome = outcomes[index];
    const DrawnProblem& problem = problems.problems[index];
    const geo::MapProjection projection(map.crs_wkt);
    flight::PlanRequest request;
    request.start.position = projection.to_geodetic(problem.start);
    request.goal.position = projection.to_geodetic(problem.goal);
    request.seed = seed + index;
    request.work_budget = options.work_budget;
    if (options.via_every > 0 && index % static_cast<std::size_t>(options.via_every) == 0) {
      // A third of the way off the middle: a detour with a turn.
      const double dx_m = problem.goal.x_m - problem.start.x_m;
      const double dy_m = problem.goal.y_m - problem.start.y_m;
      request.via.push_back({projection.to_geodetic({problem.start.x_m + 0.5 * dx_m - 0.33 * dy_m,
                                                     problem.start.y_m + 0.5 * dy_m + 0.33 * dx_m}),
                             std::nullopt});
    }
    CrowdObserver crowd(observer);
    try {
      // Without isolation a thread that waits inside one plan would begin another on its stack.
      const auto answer =
          oneapi::tbb::this_task_arena::isolate([&] { return plan(map, request, config, crowd); });
      if (const auto* found = std::get_if<flight::Plan>(&answer)) {
        outcome.has_plan = true;
        Task task{found->route_plan.start, {}, found->route_plan.goal};
        for (const flight::RequestPoint& point : request.via) {
          task.via.push_back(projection.to_map(point.position));
        }
        Judge judge(config, options, *found, task, outcome);
        const auto number = static_cast<std::int64_t>(index);
        judge.judge(map, number, false);
        if (options.masts + options.areas > 0) {
          std::mt19937_64 random(seed + 0x9e3779b97f4a7c15U * (index + 1));
          map::Map with_hazards = map;
          draw_hazards(found->trajectory, options, random, with_hazards);
          judge.judge(with_hazards, number, true);
        }
      }
    } catch (const Interrupted&) {
      return;
    } catch (const std::exception& error) {
      outcome.error = "problem " + std::to_string(index) + ": " + error.what();
    }
    if (observer.stop_requested()) {
      return;  // it may have ended early
    }
    is_done[index] = 1;
    observer.progress("planning and judging", static_cast<double>(++done),
                      static_cast<double>(total));
  };
  oneapi::tbb::parallel_for(std::size_t{0}, total, run_one);
  VerifierResult result;
  result.seed = seed;
  result.is_stopped = observer.stop_requested();
  for (std::size_t i = 0; i < total; ++i) {
    if (is_done[i] != 0) {
      ++result.problems;
      count(outcomes[i], options, result);
    }
  }
  if (result.problems == 0) {
    throw Interrupted();
  }
  return result;
}

std::string verifier_result_json(const VerifierResult& result) {
  using Json = nlohmann::ordered_json;
  Json json;
  json["schema"] = "hedgehop evaluate verifier";
  json["schema_version"] = 1;
  json["is_stopped"] = result.is_stopped;
  json["seed"] = result.seed;
  json["problems"] = result.problems;
  json["plans"] = result.plans;
  json["no_plan"] = result.no_plan;
  json["errors"] = result.errors;
  json["judgements"] = result.judgements;
  json["both_accept"] = result.both_accept;
  json["both_refuse"] = result.both_refuse;
  json["false_alarms"] = result.false_alarms;
  json["false_alarms_between_samples"] = result.between_samples;
  json["accepted_wrongly"] = result.accepted_wrongly;
  json["sharp"] = {{"judgements", 2 * result.sharp},
                   {"false_alarms", result.sharp_false_alarms},
                   {"accepted_wrongly", result.sharp_accepted_wrongly}};
  const auto gap_json = [](const Gap& gap) -> Json {
    return {{"count", gap.count},
            {"least_m", gap.count > 0 ? Json(gap.least_m) : Json()},
            {"greatest_m", gap.count > 0 ? Json(gap.greatest_m) : Json()}};
  };
  json["sampled_less_verified_distance"] = {{"ground", gap_json(result.ground)},
                                            {"wire", gap_json(result.wire)},
                                            {"obstacle", gap_json(result.obstacle)},
                                            {"area", gap_json(result.area)}};
  json["disagreements"] = Json::array();
  for (const Judgement& judgement : result.disagreements) {
    json["disagreements"].push_back(
        {{"problem", judgement.problem},
         {"has_hazards", judgement.has_hazards},
         {"is_accepted_by_brute_force", judgement.is_accepted_by_brute_force},
         {"is_accepted_by_verifier", judgement.is_accepted_by_verifier},
         {"brute_force_rules", judgement.brute_force_rules},
         {"verifier_rules", judgement.verifier_rules},
         {"spare_m", judgement.spare_m}});
  }
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace hedgehop::evaluation
