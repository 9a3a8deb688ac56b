#include "global_planning/bit_star.hpp"

#include <gtest/gtest.h>
#include <limits>
#include <ompl/base/PlannerData.h>
#include <ompl/base/PlannerTerminationCondition.h>
#include <ompl/base/ProblemDefinition.h>
#include <ompl/base/ScopedState.h>
#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/geometric/PathGeometric.h>
#include <ompl/geometric/SimpleSetup.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/tools/benchmark/Benchmark.h>
#include <ompl/util/Console.h>
#include <stdexcept>

#include "global_planning/planning_case.hpp"

namespace hedgehop::global_planning {
namespace {

namespace ob = ompl::base;
namespace og = ompl::geometric;
using flight::Waypoint;
using test::PlanningCase;
using test::shipped_global_options;

using test::kWeights;

struct OmplCase {
  PlanningCase in{test::make_fractal_map(5, 200, 30.0, 3000.0, 100.0), kWeights};
  GlobalOptions options = shipped_global_options();
  FlightEnvelope envelope{in.costs, options, in.above(800, 800), in.above(5000, 5200)};
  std::shared_ptr<ob::SpaceInformation> space =
      make_space_information(envelope, options.check_step_m);

  OmplCase() { ompl::msg::setLogLevel(ompl::msg::LOG_NONE); }

  [[nodiscard]] std::shared_ptr<ob::Planner> planner(std::int64_t work_budget = 20000) const {
    return make_bit_star(space, envelope, options, 1, {work_budget, {}});
  }
};

ob::PlannerStatus::StatusType status_of(ob::PlannerStatus status) { return status; }

Waypoint waypoint_of(const ob::State* state) {
  const auto* values = state->as<ob::RealVectorStateSpace::StateType>()->values;
  return {values[0], values[1], values[2]};
}

TEST(BitStarPlanner, SolvesAProblemThroughSimpleSetup) {
  const OmplCase in;
  og::SimpleSetup setup(in.space);
  const auto problem = make_problem(in.space, in.envelope);
  setup.setStartAndGoalStates(
      *std::make_unique<ob::ScopedState<>>(in.space->getStateSpace(), problem->getStartState(0)),
      [&] {
        ob::ScopedState<> goal(in.space);
        auto* values = goal->as<ob::RealVectorStateSpace::StateType>()->values;
        values[0] = in.envelope.goal().x_m;
        values[1] = in.envelope.goal().y_m;
        values[2] = in.envelope.goal().altitude_m;
        return goal;
      }());
  setup.setOptimizationObjective(problem->getOptimizationObjective());
  setup.setPlanner(in.planner());
  ASSERT_EQ(status_of(setup.solve(ob::plannerNonTerminatingCondition())),
            ob::PlannerStatus::EXACT_SOLUTION);
  og::PathGeometric& path = setup.getSolutionPath();
  EXPECT_TRUE(path.check());
  EXPECT_EQ(waypoint_of(path.getStates().front()), in.envelope.start());
  EXPECT_EQ(waypoint_of(path.getStates().back()), in.envelope.goal());
  // The library adds up motionCost along the path: the same sum as ours.
  const double cost_m = path.cost(problem->getOptimizationObjective()).value();
  EXPECT_NEAR(cost_m, search_of(*setup.getPlanner())->best_cost_m(), 1e-6 * cost_m);
}

TEST(BitStarPlanner, ReportsIntermediateSolutionsThatGetCheaper) {
  const OmplCase in;
  const auto problem = make_problem(in.space, in.envelope);
  std::vector<double> costs_m;
  problem->setIntermediateSolutionCallback(
      [&](const ob::Planner*, const std::vector<const ob::State*>& states, const ob::Cost cost) {
        EXPECT_GE(states.size(), 2U);
        costs_m.push_back(cost.value());
      });
  const auto planner = in.planner();
  planner->setProblemDefinition(problem);
  planner->setup();
  EXPECT_TRUE(planner->solve(ob::plannerNonTerminatingCondition()));
  ASSERT_GE(costs_m.size(), 2U);
  for (std::size_t k = 1; k < costs_m.size(); ++k) {
    EXPECT_LT(costs_m[k], costs_m[k - 1]);
  }
  EXPECT_EQ(problem->getSolutionCount(), 1U);
}

TEST(BitStarPlanner, StopsAtOnceWhenTheConditionSaysSoAndGoesOnLater) {
  const OmplCase in;
  const auto planner = in.planner();
  planner->setProblemDefinition(make_problem(in.space, in.envelope));
  planner->setup();
  EXPECT_EQ(status_of(planner->solve(ob::plannerAlwaysTerminatingCondition())),
            ob::PlannerStatus::TIMEOUT);
  EXPECT_EQ(search_of(*planner)->counts().work_units, 0);
  EXPECT_TRUE(planner->solve(ob::plannerNonTerminatingCondition()));
  planner->clear();
  EXPECT_EQ(search_of(*planner), nullptr);
}

TEST(BitStarPlanner, HandsOutItsTree) {
  const OmplCase in;
  const auto planner = in.planner(8000);
  planner->setProblemDefinition(make_problem(in.space, in.envelope));
  planner->setup();
  planner->solve(ob::plannerNonTerminatingCondition());
  ob::PlannerData graph(in.space);
  planner->getPlannerData(graph);
  EXPECT_GT(graph.numVertices(), 10U);
  EXPECT_EQ(graph.numEdges(), graph.numVertices() - 1);  // a tree
}

TEST(BitStarPlanner, RefusesAStartThatIsNotTheEnvelopes) {
  const OmplCase in;
  const auto problem = std::make_shared<ob::ProblemDefinition>(in.space);
  ob::ScopedState<> start(in.space);
  auto* values = start->as<ob::RealVectorStateSpace::StateType>()->values;
  const Waypoint other = in.in.above(900.0, 900.0, 40.0);
  values[0] = other.x_m;
  values[1] = other.y_m;
  values[2] = other.altitude_m;
  problem->setStartAndGoalStates(start, start);
  const auto planner = in.planner();
  planner->setProblemDefinition(problem);
  planner->setup();
  EXPECT_EQ(status_of(planner->solve(ob::plannerNonTerminatingCondition())),
            ob::PlannerStatus::INVALID_START);
}

TEST(BitStarPlanner, RunsBesideStockPlannersInALibraryBenchmark) {
  const OmplCase in;
  og::SimpleSetup setup(in.space);
  const auto problem = make_problem(in.space, in.envelope);
  ob::ScopedState<> start(in.space->getStateSpace(), problem->getStartState(0));
  ob::ScopedState<> goal(in.space);
  auto* values = goal->as<ob::RealVectorStateSpace::StateType>()->values;
  values[0] = in.envelope.goal().x_m;
  values[1] = in.envelope.goal().y_m;
  values[2] = in.envelope.goal().altitude_m;
  setup.setStartAndGoalStates(start, goal);
  setup.setOptimizationObjective(problem->getOptimizationObjective());
  ompl::tools::Benchmark benchmark(setup, "one problem");
  benchmark.addPlanner(in.planner(20000));
  const auto led = in.planner(20000);
  led->setName("hedgehop BIT* with fields");
  led->params().setParam("heuristic", "cost_field");
  led->params().setParam("sampler", "level_set");
  led->params().setParam("turn_rule", "none");
  led->params().setParam("batch_size", "1000");
  benchmark.addPlanner(led);
  benchmark.addPlanner(std::make_shared<og::RRTConnect>(in.space));
  benchmark.benchmark(ompl::tools::Benchmark::Request(20.0, 4000.0, 1, 0.05, false, false, true));
  const auto& experiment = benchmark.getRecordedExperimentData();
  ASSERT_EQ(experiment.planners.size(), 3U);
  EXPECT_EQ(experiment.planners[2].runs.at(0).at("solved BOOLEAN"), "1");
  EXPECT_EQ(experiment.planners[0].runs.at(0).at("solved BOOLEAN"), "1");
  EXPECT_EQ(experiment.planners[1].runs.at(0).at("solved BOOLEAN"), "1");
}

TEST(BitStarPlanner, OnlyOursHasASearchInside) {
  const OmplCase in;
  const og::RRTConnect other(in.space);
  EXPECT_THROW(search_of(other), std::invalid_argument);
}

TEST(BitStarSpace, PassesTheLibrarysSanityChecks) {
  const OmplCase in;
  EXPECT_NO_THROW(in.space->getStateSpace()->sanityChecks());
}

}  // namespace
}  // namespace hedgehop::global_planning
