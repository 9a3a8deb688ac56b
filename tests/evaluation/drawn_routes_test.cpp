#include "evaluation/drawn_routes.hpp"

#include <atomic>
#include <cmath>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>

#include "base/errors.hpp"
#include "base/files.hpp"
#include "support/fresh_seed.hpp"
#include "support/shipped_options.hpp"
#include "support/temporary_folder.hpp"
#include "support/test_map.hpp"
#include "support/utm_map.hpp"

namespace hedgehop::evaluation {
namespace {

map::Map flat_map() {
  map::Map map = test::make_map(500, 400, 30.0, [](double, double) { return 200.0; });
  test::place_in_utm(map);
  test::finish_map(map);
  return map;
}

const DrawingRules kRules{1500.0, 8000.0, 100000};

class DrawnRoutesTest : public ::testing::Test {
 protected:
  // A planner whose route is the straight line; every `failing`-th problem has none.
  RouteFunction planner(std::uint64_t failing = 0) {
    return [this, failing](const map::Map&, const flight::PlanRequest& request,
                           const planning::PlanningConfig&,
                           Observer&) -> std::variant<flight::RoutePlan, flight::NoPlan> {
      ++planned_;
      if (failing > 0 && (request.seed - seed_) % failing == 0) {
        return flight::NoPlan{flight::NoPlanCause::kBudgetExhausted, std::nullopt, "hard"};
      }
      const geo::MapPoint start = projection_.to_map(request.start.position);
      const geo::MapPoint goal = projection_.to_map(request.goal.position);
      flight::RoutePlan plan;
      plan.start = {start.x_m, start.y_m, 230.0 + 1.0 / 3.0};
      plan.goal = {goal.x_m, goal.y_m, 240.0};
      plan.route.guide = {plan.start, plan.goal};
      plan.route.cost = {1000.0, 2000.0, 1.0 / 7.0, 0.5};
      return plan;
    };
  }
  DrawnRoutes draw(std::int64_t count, const RouteFunction& plan,
                   const planning::PlanningConfig& config, std::uint64_t seed) {
    SilentObserver observer;
    return draw_routes(map_, config, kRules, count, seed, folder_.path(), plan, observer);
  }

  map::Map map_ = flat_map();
  geo::MapProjection projection_{map_.crs_wkt};
  planning::PlanningConfig config_ = test::shipped_planning({});
  test::TemporaryFolder folder_;
  std::uint64_t seed_ = test::fresh_seed() % 1000000;
  std::atomic<int> planned_{0};
};

TEST_F(DrawnRoutesTest, SecondRunTakesEveryNumberFromTheCache) {
  const DrawnRoutes first = draw(6, planner(), config_, seed_);
  EXPECT_EQ(planned_, 6);
  EXPECT_EQ(first.from_cache, 0);
  const DrawnRoutes second = draw(6, planner(), config_, seed_);
  EXPECT_EQ(planned_, 6);
  EXPECT_EQ(second.from_cache, 6);
  ASSERT_EQ(second.routes.size(), 6U);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(first.routes[i].problem, static_cast<std::int64_t>(i));
    EXPECT_EQ(first.routes[i].start, second.routes[i].start);
    EXPECT_EQ(first.routes[i].goal, second.routes[i].goal);
    EXPECT_EQ(first.routes[i].guide, second.routes[i].guide);
    EXPECT_EQ(first.routes[i].cost_m, second.routes[i].cost_m);
    EXPECT_GE(std::hypot(first.routes[i].goal.x_m - first.routes[i].start.x_m,
                         first.routes[i].goal.y_m - first.routes[i].start.y_m),
              8000.0 - 1e-3);
  }
  EXPECT_EQ(draw(9, planner(), config_, seed_).from_cache, 6) << "and a longer one goes on";
}

TEST_F(DrawnRoutesTest, OtherQuestionsHaveOtherRoutes) {
  draw(2, planner(), config_, seed_);
  EXPECT_EQ(draw(2, planner(), config_, seed_ + 1).from_cache, 0) << "seed";
  EXPECT_EQ(draw(2, planner(), test::shipped_planning({"weights.visibility=3"}), seed_).from_cache,
            0);
  EXPECT_EQ(
      draw(2, planner(), test::shipped_planning({"local.look_ahead_m=500"}), seed_).from_cache, 2)
      << "routes do not depend on the local planner";
  map_.label = "another";
  test::finish_map(map_);
  EXPECT_EQ(draw(2, planner(), config_, seed_).from_cache, 0) << "map";
}

TEST_F(DrawnRoutesTest, DamagedFileIsPlannedAnewAndReplaced) {
  draw(4, planner(), config_, seed_);
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder_.path())) {
    if (entry.is_regular_file()) {
      files.push_back(entry.path());
    }
  }
  ASSERT_EQ(files.size(), 4U);
  const std::string whole = read_file(files[1]);
  write_file_atomically(files[0], whole.substr(0, whole.size() / 2));
  write_file_atomically(files[1], std::string("[]"));
  planned_ = 0;
  EXPECT_EQ(draw(4, planner(), config_, seed_).from_cache, 2);
  EXPECT_EQ(planned_, 2);
  EXPECT_EQ(draw(4, planner(), config_, seed_).from_cache, 4);
}

TEST_F(DrawnRoutesTest, ProblemsWithoutARouteAreCountedAndReplacedByTheNext) {
  const DrawnRoutes drawn = draw(4, planner(2), config_, seed_);
  ASSERT_EQ(drawn.routes.size(), 4U);
  EXPECT_EQ(drawn.routes[0].problem, 1);
  EXPECT_EQ(drawn.routes[3].problem, 7);
  EXPECT_EQ(drawn.problems, 8);
  EXPECT_EQ(draw(4, planner(2), config_, seed_).from_cache, 8) << "what has none is kept too";
  EXPECT_THROW(draw(4, planner(1), test::shipped_planning({"speed_mps=30"}), seed_), DataError);
}

TEST_F(DrawnRoutesTest, ThreadsDoNotMatter) {
  const auto with_threads = [&](std::size_t threads, std::uint64_t failing) {
    const oneapi::tbb::global_control control(oneapi::tbb::global_control::max_allowed_parallelism,
                                              threads);
    SilentObserver observer;
    return draw_routes(map_, config_, kRules, 7, seed_, {}, planner(failing), observer);
  };
  const DrawnRoutes one = with_threads(1, 3);
  const DrawnRoutes four = with_threads(4, 3);
  ASSERT_EQ(one.routes.size(), four.routes.size());
  for (std::size_t i = 0; i < one.routes.size(); ++i) {
    EXPECT_EQ(one.routes[i].problem, four.routes[i].problem);
    EXPECT_EQ(one.routes[i].guide, four.routes[i].guide);
  }
}

TEST_F(DrawnRoutesTest, InterruptedRunKeepsWhatItHas) {
  const oneapi::tbb::global_control control(oneapi::tbb::global_control::max_allowed_parallelism,
                                            1);
  const RouteFunction usual = planner();
  const RouteFunction stopping = [&](const map::Map& map, const flight::PlanRequest& request,
                                     const planning::PlanningConfig& config, Observer& observer) {
    if (planned_ == 3) {
      return std::variant<flight::RoutePlan, flight::NoPlan>(
          flight::NoPlan{flight::NoPlanCause::kStopped, std::nullopt, "stopped"});
    }
    return usual(map, request, config, observer);
  };
  EXPECT_THROW(draw(8, stopping, config_, seed_), Interrupted);
  EXPECT_EQ(draw(8, planner(), config_, seed_).from_cache, 3);
}

}  // namespace
}  // namespace hedgehop::evaluation
