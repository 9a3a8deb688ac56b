#include <algorithm>
#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <thread>

#include "output/plan_bundle.hpp"
#include "planning/planning.hpp"
#include "services/in_process_chain.hpp"
#include "services/small_hills.hpp"

namespace hedgehop {
namespace {

using messages::PlanStage;
using messages::PlanState;
using ::testing::HasSubstr;

const map::Map& hills() {
  static const map::Map map = test::small_hills();
  return map;
}

planning::PlanningConfig shipped_planning() {
  return planning::read_planning_config(planning::effective_planning_config("", {}), "shipped");
}

// A planner that spends its whole budget, however soon it has a good route.
planning::PlanningConfig lasting_planning() {
  return planning::read_planning_config(
      planning::effective_planning_config("", {"global.planner=bit_star", "global.refine=false"}),
      "shipped");
}

// What one process makes of the same request; planned once for all tests.
const flight::Plan& plan_in_one_process() {
  static const flight::Plan plan = [] {
    SilentObserver observer;
    return std::get<flight::Plan>(
        planning::plan(hills(), test::across_the_hills(hills()), shipped_planning(), {}, observer));
  }();
  return plan;
}

TEST(PlannerServices, TheChainOverTheBusMakesTheSameFilesAsOneProcess) {
  test::InProcessChain chain;
  chain.add_map_tiler(hills());
  chain.add_global_planner();
  chain.add_local_planner();
  chain.ask(test::across_the_hills(hills()), hills().hash, shipped_planning().text);
  ASSERT_TRUE(chain.turn_until([&] { return chain.plan().has_value(); }));

  const flight::Plan plan = *chain.plan();
  EXPECT_EQ(output::plan_json(plan), output::plan_json(plan_in_one_process()));
  EXPECT_EQ(output::route_geojson(plan), output::route_geojson(plan_in_one_process()));
  EXPECT_EQ(output::trajectory_csv(plan), output::trajectory_csv(plan_in_one_process()));
  EXPECT_EQ(chain.trajectories.back().is_verified, plan_in_one_process().verdict.is_verified);
}

TEST(PlannerServices, ARequestThatIsRepeatedIsAnsweredAgainButPlannedOnce) {
  test::InProcessChain chain;
  chain.add_map_tiler(hills());
  chain.add_global_planner();
  chain.add_local_planner();
  const auto ask = [&] {
    chain.ask(test::across_the_hills(hills()), hills().hash, shipped_planning().text);
  };
  ask();
  ask();
  ASSERT_TRUE(chain.turn_until([&] { return !chain.trajectories.empty(); }));
  ask();
  const std::size_t routes = chain.routes.size();
  const std::size_t trajectories = chain.trajectories.size();
  chain.statuses.clear();
  ASSERT_TRUE(chain.turn_until(
      [&] { return chain.routes.size() > routes && chain.trajectories.size() > trajectories; }));

  EXPECT_EQ(chain.count_of(PlanStage::kGlobal, PlanState::kWorking), 0);
  EXPECT_EQ(chain.count_of(PlanStage::kLocal, PlanState::kWorking), 0);
  EXPECT_EQ(chain.routes.front().plan, chain.routes.back().plan);
  EXPECT_EQ(chain.trajectories.front().plan, chain.trajectories.back().plan);
}

TEST(PlannerServices, ProgressIsToldWhileARouteIsPlanned) {
  test::InProcessChain chain;
  chain.add_map_tiler(hills());
  chain.add_global_planner();
  flight::PlanRequest request = test::across_the_hills(hills());
  request.work_budget = 100000;
  chain.ask(request, hills().hash, lasting_planning().text);
  ASSERT_TRUE(chain.turn_until([&] { return chain.is_global(PlanState::kDone); }));

  std::int64_t newest = 0;
  int rises = 0;
  for (const messages::PlanStatus& status : chain.statuses) {
    EXPECT_GE(status.work_units, newest);
    rises += status.state == PlanState::kWorking && status.work_units > newest ? 1 : 0;
    newest = status.work_units;
  }
  EXPECT_GE(rises, 1);
  EXPECT_LE(newest, 100000);
}

TEST(PlannerServices, ACancellationStopsARunningPlanAndARequestAfterItIsServed) {
  test::InProcessChain chain;
  chain.add_map_tiler(hills());
  chain.add_global_planner();
  flight::PlanRequest request = test::across_the_hills(hills());
  request.work_budget = 2'000'000'000;  // hours
  const auto message = chain.ask(request, hills().hash, lasting_planning().text);
  // The planner holds this thread until it hears the cancellation.
  std::thread user([&] {
    bus::Bus bus({.url = chain.url(), .channel_prefix = {}});
    bool is_working = false;
    bus.subscribe<messages::PlanStatus>(
        messages::kPlanStatusChannel,
        [&](const messages::PlanStatus& status, const messages::Stamp&) {
          is_working = is_working || status.state == PlanState::kWorking;
        });
    while (!is_working) {
      bus.poll(0.05);
    }
    bus.publish(messages::kPlanCancelChannel, messages::PlanCancel{message.request_id}, bus.now());
  });
  EXPECT_TRUE(chain.turn_until([&] { return chain.is_global(PlanState::kCancelled); }));
  user.join();
  EXPECT_TRUE(chain.routes.empty());

  // Cancelled before it is begun, then asked again at once: the cancellation counts for the first.
  chain.statuses.clear();
  request.work_budget = 20000;
  chain.ask(request, hills().hash, lasting_planning().text);
  const Hash128 id = flight::plan_request_id(request, hills().hash, lasting_planning().text);
  chain.listener().bus.publish(messages::kPlanCancelChannel, messages::PlanCancel{id},
                               chain.listener().bus.now());
  chain.ask(request, hills().hash, lasting_planning().text);
  EXPECT_TRUE(chain.turn_until([&] { return chain.is_global(PlanState::kDone); }));
}

TEST(PlannerServices, ARequestThatCannotBeMeantGetsItsCauseAndPlace) {
  test::InProcessChain chain;
  chain.add_map_tiler(hills());
  chain.add_global_planner();
  flight::PlanRequest request = test::across_the_hills(hills());
  request.goal.position.latitude_rad += 0.1;  // 600 km north
  chain.ask(request, hills().hash, shipped_planning().text);
  ASSERT_TRUE(chain.turn_until([&] { return chain.is_global(PlanState::kNoPlan); }));

  const auto status = *chain.newest_status(PlanStage::kGlobal);
  ASSERT_TRUE(status.no_plan.has_value());
  EXPECT_EQ(status.no_plan->cause, flight::NoPlanCause::kGoalOutsideMap);
  EXPECT_THAT(status.no_plan->explanation, HasSubstr("outside the map"));
  ASSERT_TRUE(status.no_plan->place.has_value());
  EXPECT_GT(status.no_plan->place->y_m, hills().geometry.north_m());
}

TEST(PlannerServices, AConfigThatIsWrongRefusesTheRequestAndNamesTheKey) {
  test::InProcessChain chain;
  chain.add_map_tiler(hills());
  chain.add_global_planner();
  std::string config = shipped_planning().text;
  config.replace(config.find("speed_mps"), 9, "spede_mps");
  chain.ask(test::across_the_hills(hills()), hills().hash, config);
  ASSERT_TRUE(chain.turn_until([&] { return chain.is_global(PlanState::kRefused); }));
  EXPECT_THAT(chain.newest_status(PlanStage::kGlobal)->text, HasSubstr("missing key 'speed_mps'"));
}

TEST(PlannerServices, ARequestForAnotherMapIsRefusedAfterALimitInMessageTime) {
  test::InProcessChain chain;
  chain.add_map_tiler(hills());
  chain.add_global_planner();
  const Hash128 other{1, 2};
  chain.ask(test::across_the_hills(hills()), other, shipped_planning().text);
  ASSERT_TRUE(chain.turn_until([&] { return chain.is_global(PlanState::kWaiting); }));
  const auto text = [&] { return chain.newest_status(PlanStage::kGlobal)->text; };
  ASSERT_TRUE(chain.turn_until([&] { return text().find(other.hex()) != std::string::npos; }));
  EXPECT_THAT(text(), HasSubstr(hills().hash.hex()));

  // Message time goes on by a minute.
  chain.listener().bus.publish(messages::kPlanCancelChannel, messages::PlanCancel{other},
                               chain.listener().bus.now() + 60.0);
  EXPECT_TRUE(chain.turn_until([&] { return chain.is_global(PlanState::kRefused); }, 3.0));
}

TEST(PlannerServices, ARouteOfAnotherVersionIsRefusedAndBothVersionsAreNamed) {
  test::InProcessChain chain;
  chain.add_map_tiler(hills());
  chain.add_local_planner();
  const flight::RoutePlan& route = plan_in_one_process().route_plan;
  messages::RouteHeader header;
  header.request_id = route.request_id;
  header.map_hash = hills().hash;
  header.plan = chain.listener().exchange.offer(messages::encode_route_plan(route), true);
  header.provenance = "hedgehop global_planner 0.0.9";
  const auto publish = [&] {
    chain.listener().bus.publish(messages::kRouteChannel, header, chain.listener().bus.now());
  };
  publish();
  const auto is = [&](PlanState state) {
    const auto status = chain.newest_status(PlanStage::kLocal);
    return status && status->state == state;
  };
  ASSERT_TRUE(chain.turn_until([&] { return is(PlanState::kRefused); }));
  const std::string own = bus::provenance_of("global_planner");
  const std::string text = chain.newest_status(PlanStage::kLocal)->text;
  EXPECT_THAT(text, HasSubstr(header.provenance));
  EXPECT_THAT(text, HasSubstr("this is version " + own.substr(own.rfind(' ') + 1)));
  EXPECT_TRUE(chain.trajectories.empty());

  // The same route of this version, or of a planner that is none of ours, is flown.
  header.provenance = own;
  publish();
  ASSERT_TRUE(chain.turn_until([&] { return is(PlanState::kDone); }));
  EXPECT_EQ(bus::reason_against_provenance("somebody's planner 0.0.9"), "");
}

TEST(PlannerServices, ALocalPlannerThatIsAskedToShowsItsHistogramsAndPlansTheSame) {
  test::InProcessChain chain;
  chain.add_map_tiler(hills());
  chain.add_global_planner();
  auto options = test::frequent_planner_options<services::LocalPlannerService>("local_planner");
  EXPECT_EQ(options.histogram_rate_hz, 0.0);  // as shipped: silent
  options.histogram_rate_hz = 20.0;
  test::Station station(chain.url(), "local_planner");
  services::LocalPlannerService service(options, station.bus, station.exchange, station.loop);
  station.tick = [&](Time now) { service.tick(now); };
  std::vector<messages::LocalHistogram> shown;
  chain.listener().bus.subscribe<messages::LocalHistogram>(
      messages::kLocalHistogramChannel,
      [&](const messages::LocalHistogram& histogram, const messages::Stamp&) {
        shown.push_back(histogram);
      });
  const Hash128 id =
      chain.ask(test::across_the_hills(hills()), hills().hash, shipped_planning().text).request_id;
  ASSERT_TRUE(chain.turn_until([&] {
    station.turn();
    return chain.plan().has_value();
  }));
  EXPECT_EQ(output::trajectory_csv(*chain.plan()), output::trajectory_csv(plan_in_one_process()));
  ASSERT_FALSE(shown.empty());
  std::int64_t newest = -1;
  for (const messages::LocalHistogram& histogram : shown) {
    EXPECT_EQ(histogram.request_id, id);
    EXPECT_GT(histogram.step_number, newest);
    newest = histogram.step_number;
    ASSERT_EQ(histogram.sectors.size(), static_cast<std::size_t>(shipped_planning().local.sectors));
    EXPECT_TRUE(hills().geometry.contains(geo::MapPoint{histogram.x_m, histogram.y_m}));
    int known = 0;
    for (const messages::LocalHistogram::Sector& sector : histogram.sectors) {
      const bool is_masked =
          sector.mask == messages::SectorMask::kClimb || sector.mask == messages::SectorMask::kTurn;
      EXPECT_EQ(std::isnan(sector.cost), is_masked);
      known += std::isnan(sector.climb_angle_rad) ? 0 : 1;
    }
    EXPECT_GT(known, 0);
    // Gentle hills: some direction is always feasible, and what is chosen is.
    ASSERT_TRUE(histogram.chosen_sector.has_value());
    EXPECT_FALSE(
        std::isnan(histogram.sectors.at(static_cast<std::size_t>(*histogram.chosen_sector)).cost));
  }
}

TEST(PlannerServices, QuestionsThatLackSomethingGiveWayWhenTheBookIsFull) {
  test::InProcessChain chain;
  chain.add_map_tiler(hills());
  chain.add_global_planner();
  const auto good =
      chain.ask(test::across_the_hills(hills()), hills().hash, shipped_planning().text);
  ASSERT_TRUE(chain.turn_until([&] { return chain.is_global(PlanState::kDone); }));
  // More than the book holds, about maps that nobody has.
  messages::PlanRequestMessage nonsense = good;
  for (std::uint64_t i = 1; i <= 300; ++i) {
    nonsense.request_id = {i, 1};
    nonsense.map_hash = {i, 2};
    chain.listener().bus.publish(messages::kPlanRequestChannel, nonsense,
                                 chain.listener().bus.now());
  }
  chain.turn();
  flight::PlanRequest request = test::across_the_hills(hills());
  request.speed_mps = 39.0;
  const Hash128 id = chain.ask(request, hills().hash, shipped_planning().text).request_id;
  EXPECT_TRUE(chain.turn_until([&] {
    return std::any_of(chain.routes.begin(), chain.routes.end(),
                       [&](const auto& route) { return route.request_id == id; });
  }));
}

TEST(PlannerServices, WithoutAMapTilerTheStatusSaysWhatIsMissing) {
  test::InProcessChain chain;
  chain.add_global_planner();
  chain.ask(test::across_the_hills(hills()), hills().hash, shipped_planning().text);
  EXPECT_TRUE(chain.turn_until(
      [&] {
        const auto status = chain.newest_status(PlanStage::kGlobal);
        return status && status->text.find("MAP_INDEX") != std::string::npos;
      },
      5.0));
  EXPECT_TRUE(chain.is_global(PlanState::kWaiting));
}

TEST(PlannerServices, ALocalPlannerThatStartsLateGetsMapAndRouteFromTheOthers) {
  test::InProcessChain chain;
  chain.add_map_tiler(hills());
  chain.add_global_planner();
  chain.ask(test::across_the_hills(hills()), hills().hash, shipped_planning().text);
  ASSERT_TRUE(chain.turn_until([&] { return chain.is_global(PlanState::kDone); }));
  chain.add_local_planner();
  chain.ask(test::across_the_hills(hills()), hills().hash, shipped_planning().text);
  ASSERT_TRUE(chain.turn_until([&] { return chain.plan().has_value(); }));
  EXPECT_EQ(output::trajectory_csv(*chain.plan()), output::trajectory_csv(plan_in_one_process()));
}

}  // namespace
}  // namespace hedgehop
