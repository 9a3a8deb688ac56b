#include "global_planning/bit_star.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <ompl/base/MotionValidator.h>
#include <ompl/base/Planner.h>
#include <ompl/base/PlannerData.h>
#include <ompl/base/ProblemDefinition.h>
#include <ompl/base/ScopedState.h>
#include <ompl/base/SpaceInformation.h>
#include <ompl/base/goals/GoalState.h>
#include <ompl/base/objectives/PathLengthOptimizationObjective.h>
#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/geometric/PathGeometric.h>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

namespace hedgehop::global_planning {
namespace {

namespace ob = ompl::base;
namespace og = ompl::geometric;

using VectorState = ob::RealVectorStateSpace::StateType;

flight::Waypoint waypoint_of(const ob::State* state) {
  const auto* vector = state->as<VectorState>();
  return {vector->values[0], vector->values[1], vector->values[2]};
}

void assign(ob::State* state, const flight::Waypoint& waypoint) {
  auto* vector = state->as<VectorState>();
  vector->values[0] = waypoint.x_m;
  vector->values[1] = waypoint.y_m;
  vector->values[2] = waypoint.altitude_m;
}

class EnvelopeValidity final : public ob::StateValidityChecker {
 public:
  EnvelopeValidity(ob::SpaceInformation* space, const FlightEnvelope& envelope)
      : ob::StateValidityChecker(space), envelope_(&envelope) {}
  bool isValid(const ob::State* state) const override {
    return envelope_->contains(waypoint_of(state));
  }

 private:
  const FlightEnvelope* envelope_;
};

class EnvelopeMotion final : public ob::MotionValidator {
 public:
  EnvelopeMotion(ob::SpaceInformation* space, const FlightEnvelope& envelope)
      : ob::MotionValidator(space), envelope_(&envelope) {}
  bool checkMotion(const ob::State* from, const ob::State* to) const override {
    return envelope_->leg_cost_m(waypoint_of(from), waypoint_of(to)) <
           std::numeric_limits<double>::infinity();
  }
  bool checkMotion(const ob::State* from, const ob::State* to,
                   std::pair<ob::State*, double>& last_valid) const override {
    if (last_valid.first != nullptr) {
      si_->copyState(last_valid.first, from);
    }
    last_valid.second = 0.0;
    return checkMotion(from, to);
  }

 private:
  const FlightEnvelope* envelope_;
};

/// Eq. (1) along straight legs; their length is the heuristic.
class RouteObjective final : public ob::PathLengthOptimizationObjective {
 public:
  RouteObjective(const ob::SpaceInformationPtr& space, const FlightEnvelope& envelope)
      : ob::PathLengthOptimizationObjective(space), envelope_(&envelope) {
    description_ = "eq. (1)";
  }
  ob::Cost motionCost(const ob::State* from, const ob::State* to) const override {
    return ob::Cost(envelope_->leg_cost_m(waypoint_of(from), waypoint_of(to)));
  }
  ob::Cost motionCostHeuristic(const ob::State* from, const ob::State* to) const override {
    return ob::Cost(si_->distance(from, to));
  }

 private:
  const FlightEnvelope* envelope_;
};

class BitStar final : public ob::Planner {
 public:
  BitStar(const ob::SpaceInformationPtr& space, const FlightEnvelope& envelope,
          const GlobalOptions& options, std::uint64_t seed, BitStarHooks hooks)
      : ob::Planner(space, "hedgehop BIT*"),
        envelope_(&envelope),
        options_(options),
        seed_(seed),
        hooks_(std::move(hooks)) {
    specs_.approximateSolutions = false;
    specs_.optimizingPaths = true;
    specs_.directed = false;
    specs_.canReportIntermediateSolutions = true;
    const auto declare = [this]<typename Value>(const char* name, Value GlobalOptions::*member,
                                                std::array<const char*, 3> words) {
      std::string range;
      for (const char* word : words) {
        range += word == nullptr ? "" : (range.empty() ? "" : ",") + std::string(word);
      }
      params_.declareParam<std::string>(
          name,
          [this, member, words](const std::string& word) {
            for (std::size_t i = 0; i < words.size(); ++i) {
              if (words[i] != nullptr && word == words[i]) {
                options_.*member = static_cast<Value>(i);
                return;
              }
            }
            throw std::invalid_argument("no such choice: " + word);
          },
          [this, member, words] {
            return std::string(words[static_cast<std::size_t>(options_.*member)]);
          });
      params_[name].setRangeSuggestion(range);
    };
    declare("heuristic", &GlobalOptions::heuristic, {"length", "cost_field", nullptr});
    declare("sampler", &GlobalOptions::sampler, {"ellipse", "level_set", nullptr});
    declare("turn_rule", &GlobalOptions::turn_rule, {"none", "insertion", "heading_labels"});
    params_.declareParam<std::int64_t>(
        "batch_size", [this](std::int64_t value) { options_.batch_size = value; },
        [this] { return options_.batch_size; });
    addPlannerProgressProperty("best cost REAL", [this] {
      return std::to_string(search_ ? search_->best_cost_m()
                                    : std::numeric_limits<double>::infinity());
    });
    addPlannerProgressProperty("edge evaluations INTEGER", [this] {
      return std::to_string(search_ ? search_->counts().work_units : 0);
    });
  }

  ~BitStar() override { free_exported(); }
  BitStar(const BitStar&) = delete;
  BitStar& operator=(const BitStar&) = delete;

  ob::PlannerStatus solve(const ob::PlannerTerminationCondition& terminate) override {
    checkValidity();
    while (const ob::State* start = pis_.nextStart()) {
      if (!(waypoint_of(start) == envelope_->start())) {
        return ob::PlannerStatus::INVALID_START;
      }
      has_start_ = true;
    }
    if (!has_start_) {
      return ob::PlannerStatus::INVALID_START;
    }
    if (!has_goal_) {
      const ob::State* goal = pis_.nextGoal(terminate);
      if (goal == nullptr || !(waypoint_of(goal) == envelope_->goal())) {
        return ob::PlannerStatus::INVALID_GOAL;
      }
      has_goal_ = true;
    }
    if (!search_) {
      search_.emplace(*envelope_, options_, seed_);
    }
    double reported_m = std::numeric_limits<double>::infinity();
    search_->run(
        hooks_.work_budget, [&terminate] { return static_cast<bool>(terminate); },
        [&] {
          if (hooks_.on_event) {
            hooks_.on_event(*search_);
          }
          const auto& report = getProblemDefinition()->getIntermediateSolutionCallback();
          if (report && search_->best_cost_m() < reported_m) {
            reported_m = search_->best_cost_m();
            report_route(report);
          }
        });
    if (!search_->has_route()) {
      return ob::PlannerStatus::TIMEOUT;
    }
    auto path = std::make_shared<og::PathGeometric>(si_);
    ob::ScopedState<ob::RealVectorStateSpace> state(si_);
    for (const flight::Waypoint& waypoint : search_->best_route()) {
      assign(state.get(), waypoint);
      path->append(state.get());
    }
    ob::PlannerSolution solution(path);
    solution.setPlannerName(getName());
    solution.setOptimized(getProblemDefinition()->getOptimizationObjective(),
                          ob::Cost(search_->best_cost_m()), search_->is_optimal());
    getProblemDefinition()->addSolutionPath(solution);
    return ob::PlannerStatus::EXACT_SOLUTION;
  }

  void clear() override {
    ob::Planner::clear();
    free_exported();
    search_.reset();
    has_start_ = false;
    has_goal_ = false;
  }

  void getPlannerData(ob::PlannerData& graph) const override {
    if (!search_) {
      return;
    }
    // The graph keeps pointers to states; they live until the planner is cleared.
    while (exported_.size() < search_->state_count()) {
      exported_.push_back(si_->allocState());
      assign(exported_.back(), search_->state(exported_.size() - 1));
    }
    for (std::size_t i = 0; i < exported_.size(); ++i) {
      if (const int parent = search_->parent(i); parent >= 0) {
        graph.addEdge(ob::PlannerDataVertex(exported_[static_cast<std::size_t>(parent)], parent),
                      ob::PlannerDataVertex(exported_[i], static_cast<int>(i)));
      }
    }
  }

  [[nodiscard]] const BitStarSearch* search() const { return search_ ? &*search_ : nullptr; }

 private:
  void free_exported() {
    for (ob::State* state : exported_) {
      si_->freeState(state);
    }
    exported_.clear();
  }

  void report_route(const ob::ReportIntermediateSolutionFn& report) {
    std::vector<ob::State*> states;
    for (const flight::Waypoint& waypoint : search_->best_route()) {
      states.push_back(si_->allocState());
      assign(states.back(), waypoint);
    }
    report(this, std::vector<const ob::State*>(states.begin(), states.end()),
           ob::Cost(search_->best_cost_m()));
    for (ob::State* state : states) {
      si_->freeState(state);
    }
  }

  const FlightEnvelope* envelope_;
  GlobalOptions options_;
  std::uint64_t seed_;
  BitStarHooks hooks_;
  bool has_start_ = false;
  bool has_goal_ = false;
  std::optional<BitStarSearch> search_;
  mutable std::vector<ob::State*> exported_;
};

}  // namespace

std::shared_ptr<ob::SpaceInformation> make_space_information(const FlightEnvelope& envelope,
                                                             double check_step_m) {
  const raster::GridGeometry& geometry = envelope.geometry();
  auto states = std::make_shared<ob::RealVectorStateSpace>(3);
  ob::RealVectorBounds bounds(3);
  double low_m = std::min(envelope.start().altitude_m, envelope.goal().altitude_m);
  double high_m = std::max(envelope.start().altitude_m, envelope.goal().altitude_m);
  for (int row = 0; row < geometry.rows; ++row) {
    for (int column = 0; column < geometry.columns; ++column) {
      const AltitudeBand band = envelope.band_at(geometry.centre({column, row}));
      if (band.is_flyable()) {
        low_m = std::min(low_m, band.low_m);
        high_m = std::max(high_m, band.high_m);
      }
    }
  }
  bounds.setLow(0, geometry.west_m);
  bounds.setHigh(0, geometry.east_m());
  bounds.setLow(1, geometry.south_m);
  bounds.setHigh(1, geometry.north_m());
  bounds.setLow(2, low_m);
  bounds.setHigh(2, high_m);
  states->setBounds(bounds);
  auto space = std::make_shared<ob::SpaceInformation>(states);
  space->setStateValidityChecker(std::make_shared<EnvelopeValidity>(space.get(), envelope));
  space->setMotionValidator(std::make_shared<EnvelopeMotion>(space.get(), envelope));
  space->setStateValidityCheckingResolution(
      std::min(check_step_m / states->getMaximumExtent(), 1.0));
  space->setup();
  return space;
}

std::shared_ptr<ob::ProblemDefinition> make_problem(
    const std::shared_ptr<ob::SpaceInformation>& space, const FlightEnvelope& envelope) {
  auto problem = std::make_shared<ob::ProblemDefinition>(space);
  ob::ScopedState<ob::RealVectorStateSpace> start(space);
  ob::ScopedState<ob::RealVectorStateSpace> goal(space);
  assign(start.get(), envelope.start());
  assign(goal.get(), envelope.goal());
  problem->setStartAndGoalStates(start, goal);
  problem->setOptimizationObjective(std::make_shared<RouteObjective>(space, envelope));
  return problem;
}

std::shared_ptr<ob::Planner> make_bit_star(const std::shared_ptr<ob::SpaceInformation>& space,
                                           const FlightEnvelope& envelope,
                                           const GlobalOptions& options, std::uint64_t seed,
                                           BitStarHooks hooks) {
  return std::make_shared<BitStar>(space, envelope, options, seed, std::move(hooks));
}

const BitStarSearch* search_of(const ob::Planner& planner) {
  const auto* bit_star = dynamic_cast<const BitStar*>(&planner);
  if (bit_star == nullptr) {
    throw std::invalid_argument("search_of() needs a planner of make_bit_star(), not '" +
                                planner.getName() + "'");
  }
  return bit_star->search();
}

}  // namespace hedgehop::global_planning
