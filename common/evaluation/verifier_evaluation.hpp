#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "base/config_reader.hpp"
#include "base/observer.hpp"
#include "evaluation/problem_drawing.hpp"
#include "evaluation/random_evaluation.hpp"
#include "map/map.hpp"
#include "planning/planning.hpp"

namespace hedgehop::evaluation {

/// Section `verifier` of the evaluation config.
struct VerifierOptions {
  std::int64_t plans = 0;  // problems drawn; some may have no plan
  DrawingRules drawing;
  std::int64_t work_budget = 0;    // per problem
  std::int64_t via_every = 0;      // each so-manieth problem has a via point; 0: none
  double sample_m = 0.0;           // of the brute-force check
  double sampling_error_m = 0.0;   // by how much a distance at the samples may exceed the true one
  std::int64_t masts = 0;          // drawn beside the path, for a second judgement
  std::int64_t areas = 0;          // likewise
  double hazard_distance_m = 0.0;  // greatest distance of their middle from the path
};
VerifierOptions read_verifier_options(ConfigReader& reader);

/// One flight, judged twice.
struct Judgement {
  std::int64_t problem = 0;
  bool has_hazards = false;  // masts and areas drawn beside the path stand in the map
  bool is_accepted_by_brute_force = false;
  bool is_accepted_by_verifier = false;
  std::vector<std::string> brute_force_rules;
  std::vector<std::string> verifier_rules;
  double spare_m = 0.0;  // least distance beyond what is demanded, by brute force
};

/// How far distances at the samples lie above those of the verifier, which must never be the
/// greater ones. Infinite, in the wrong direction, for none.
struct Gap {
  std::int64_t count = 0;
  double least_m = std::numeric_limits<double>::infinity();
  double greatest_m = -std::numeric_limits<double>::infinity();

  void add(double gap_m);
};

struct VerifierResult {
  std::uint64_t seed = 0;
  bool is_stopped = false;  // by the observer; then `problems` are those that were finished
  std::int64_t problems = 0;
  std::int64_t plans = 0;
  std::int64_t no_plan = 0;
  std::vector<std::string> errors;  // what a planner or a judge threw

  std::int64_t judgements = 0;
  std::int64_t both_accept = 0;
  std::int64_t both_refuse = 0;
  std::int64_t false_alarms = 0;      // refused by the verifier alone,
  std::int64_t between_samples = 0;   // of those: by distances that the samples may have missed
  std::int64_t accepted_wrongly = 0;  // refused by brute force alone

  // With the demanded clearance moved to just below and just above what brute force measured.
  std::int64_t sharp = 0;
  std::int64_t sharp_false_alarms = 0;
  std::int64_t sharp_accepted_wrongly = 0;

  Gap ground, wire, obstacle, area;
  std::vector<Judgement> disagreements;
};

/// Plans drawn problems and judges each plan by the verifier and by brute force: as planned (the
/// verifier with all it knows of a plan's files), with masts and areas drawn beside the path, and
/// under demands just below and just above the clearance that was measured.
///
/// Problem i is planned with seed + i; the same seed gives the same result for any number of
/// threads.
/// @param plan  as of evaluate_random()
/// @throws Interrupted  if the observer says so.
VerifierResult evaluate_verifier(const map::Map& map, const planning::PlanningConfig& config,
                                 const VerifierOptions& options, std::uint64_t seed,
                                 const PlanFunction& plan, Observer& observer);

std::string verifier_result_json(const VerifierResult& result);

}  // namespace hedgehop::evaluation
