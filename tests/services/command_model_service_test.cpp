#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "planning/planning.hpp"
#include "services/in_process_chain.hpp"
#include "services/small_hills.hpp"
#include "support/temporary_folder.hpp"

namespace hedgehop {
namespace {

planning::PlanningConfig shipped_planning() {
  return planning::read_planning_config(planning::effective_planning_config("", {}), "shipped");
}

// Route and trajectory headers as the planners send them, their blobs on offer.
class CommandModelServiceTest : public ::testing::Test {
 protected:
  void SetUp() override {
    SilentObserver observer;
    plan_ = std::get<flight::Plan>(
        planning::plan(map_, test::across_the_hills(map_), shipped_planning(), {}, observer));
    plan_.trajectory.states.resize(41);  // two seconds of flight
    bus::BlobExchange& exchange = chain_.listener().exchange;
    route_.request_id = plan_.route_plan.request_id;
    route_.map_hash = map_.hash;
    route_.plan = exchange.offer(messages::encode_route_plan(plan_.route_plan), false);
    trajectory_.request_id = route_.request_id;
    trajectory_.map_hash = map_.hash;
    trajectory_.route = route_.plan;
    trajectory_.plan = exchange.offer(messages::encode_flight_plan(plan_, route_.plan.id), false);
    chain_.add_command_model();
  }

  // Step 7 of the route's vehicle.
  [[nodiscard]] messages::VehicleTarget lockstep_target() const {
    messages::VehicleTarget target;
    target.request_id = route_.request_id;
    target.step_number = 7;
    target.is_lockstep = true;
    target.step_s = 0.05;
    target.state = command_model::trimmed_state(10.0, 20.0, 500.0, 40.0, 0.3, 1.0);
    target.command = {38.0, 0.9, 3.0};
    return target;
  }

  test::InProcessChain chain_;
  map::Map map_ = test::small_hills();
  flight::Plan plan_;
  messages::RouteHeader route_;
  messages::TrajectoryHeader trajectory_;
};

TEST_F(CommandModelServiceTest, FliesATrajectoryInRealTimeAndStaysOnIt) {
  bus::Bus& bus = chain_.listener().bus;
  bus.publish(messages::kTrajectoryChannel, trajectory_, bus.now());
  const Time begin = bus.now();
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.vehicle_states.size() >= 41; }, 10.0));

  // 40 steps of 50 ms take two seconds, whoever computes them.
  EXPECT_GE(seconds_between(begin, bus.now()), 2.0);
  ASSERT_EQ(chain_.vehicle_states.size(), 41U);
  for (std::size_t i = 0; i < 41; ++i) {
    const messages::VehicleState& state = chain_.vehicle_states[i];
    const flight::FlightState& wanted = plan_.trajectory.states[i];
    EXPECT_EQ(state.step_number, static_cast<std::int64_t>(i));
    EXPECT_EQ(state.request_id, route_.request_id);
    // The same model under the same commands; only the controller's integrator starts settled.
    EXPECT_NEAR(state.state.x_m, wanted.x_m, 0.01);
    EXPECT_NEAR(state.state.y_m, wanted.y_m, 0.01);
    EXPECT_NEAR(state.state.altitude_m, wanted.altitude_m, 0.5);
    ASSERT_TRUE(state.heading_true_rad.has_value());
    EXPECT_NEAR(*state.heading_true_rad, wanted.heading_true_rad, 1e-4);
  }
  // Once flown, a repeat of the header does not start it again.
  bus.publish(messages::kTrajectoryChannel, trajectory_, bus.now());
  EXPECT_FALSE(chain_.turn_until([&] { return chain_.vehicle_states.size() > 41; }, 0.5));
}

TEST_F(CommandModelServiceTest, ALockstepTargetIsAnsweredByOneStepHoweverOftenItIsAsked) {
  bus::Bus& bus = chain_.listener().bus;
  const messages::VehicleTarget target = lockstep_target();
  bus.publish(messages::kRouteChannel, route_, bus.now());
  bus.publish(messages::kVehicleTargetChannel, target, bus.now());
  bus.publish(messages::kVehicleTargetChannel, target, bus.now());
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.vehicle_states.size() == 2; }, 5.0));

  const command_model::CommandModel model(shipped_planning().vehicle);
  const command_model::ModelState wanted = model.step(target.state, target.command, 0.05);
  for (const messages::VehicleState& answer : chain_.vehicle_states) {
    EXPECT_TRUE(answer.is_lockstep);
    EXPECT_EQ(answer.step_number, 7);
    EXPECT_EQ(answer.state.x_m, wanted.x_m);
    EXPECT_EQ(answer.state.heading_math_rad, wanted.heading_math_rad);
    EXPECT_EQ(answer.state.climb_rate_mps, wanted.climb_rate_mps);
    EXPECT_EQ(answer.state.climb_integral_mps, wanted.climb_integral_mps);
  }
}

TEST_F(CommandModelServiceTest, NeitherManyOtherRoutesNorUnanswerableTargetsKeepLockstepWaiting) {
  bus::Bus& bus = chain_.listener().bus;
  bus::BlobExchange& exchange = chain_.listener().exchange;
  messages::VehicleTarget target = lockstep_target();
  bus.publish(messages::kRouteChannel, route_, bus.now());
  std::vector<messages::RouteHeader> others;
  for (std::uint64_t i = 0; i < 40; ++i) {
    flight::RoutePlan other = plan_.route_plan;
    other.request.seed += 1 + i;
    other.request_id = flight::plan_request_id(other.request, other.map.hash, other.config_text);
    messages::RouteHeader header = route_;
    header.request_id = other.request_id;
    header.plan = exchange.offer(messages::encode_route_plan(other), false);
    others.push_back(header);
    bus.publish(messages::kRouteChannel, header, bus.now());
  }
  const auto is_answered = [&](const Hash128& request_id, std::int64_t step_number) {
    chain_.vehicle_states.clear();
    target.request_id = request_id;
    target.step_number = step_number;
    bus.publish(messages::kVehicleTargetChannel, target, bus.now());
    return chain_.turn_until(
        [&] {
          return !chain_.vehicle_states.empty() &&
                 chain_.vehicle_states.back().step_number == step_number;
        },
        5.0);
  };
  // More routes than models are kept: the first, all the others, the first again.
  EXPECT_TRUE(is_answered(route_.request_id, 1));
  for (const messages::RouteHeader& other : others) {
    ASSERT_TRUE(is_answered(other.request_id, 2));
  }
  EXPECT_TRUE(is_answered(route_.request_id, 3));

  target.request_id = {1, 2};  // of no route
  for (int i = 0; i < 1200; ++i) {
    target.step_number = i;
    bus.publish(messages::kVehicleTargetChannel, target, bus.now());
    chain_.turn();
  }
  EXPECT_TRUE(is_answered(route_.request_id, 4));
}

TEST_F(CommandModelServiceTest, ATrajectoryIsFlownThoughItsRouteWasForgottenMeanwhile) {
  bus::Bus& bus = chain_.listener().bus;
  const messages::VehicleTarget target = lockstep_target();
  bus.publish(messages::kRouteChannel, route_, bus.now());
  bus.publish(messages::kVehicleTargetChannel, target, bus.now());
  ASSERT_TRUE(chain_.turn_until([&] { return !chain_.vehicle_states.empty(); }, 5.0));
  for (std::uint64_t i = 0; i < 1100; ++i) {  // more than are remembered
    messages::RouteHeader other = route_;
    other.request_id = {7, i};
    bus.publish(messages::kRouteChannel, other, bus.now());
    chain_.turn();
  }
  chain_.vehicle_states.clear();
  bus.publish(messages::kTrajectoryChannel, trajectory_, bus.now());
  EXPECT_TRUE(chain_.turn_until([&] { return chain_.vehicle_states.size() >= 3; }, 5.0));
}

TEST_F(CommandModelServiceTest, ARealTimeTargetIsFollowedUntilItIsTooOld) {
  bus::Bus& bus = chain_.listener().bus;
  messages::VehicleTarget target;
  target.request_id = route_.request_id;
  target.step_s = 0.05;
  target.state = command_model::trimmed_state(10.0, 20.0, 500.0, 40.0, 0.0, 0.0);
  target.command = {40.0, 0.0, 0.0};
  bus.publish(messages::kRouteChannel, route_, bus.now());
  bus.publish(messages::kVehicleTargetChannel, target, bus.now());
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.vehicle_states.size() >= 5; }, 5.0));
  // Straight on to the east with 2 m a step.
  EXPECT_NEAR(chain_.vehicle_states[1].state.x_m - chain_.vehicle_states[0].state.x_m, 2.0, 1e-6);
  EXPECT_NEAR(chain_.vehicle_states[4].state.y_m, 20.0, 1e-9);
  // Held for half a second, that is ten steps, then given up.
  EXPECT_FALSE(chain_.turn_until([&] { return chain_.vehicle_states.size() > 12; }, 1.5));
}

TEST_F(CommandModelServiceTest, ARotorPlantKeepsTheTrajectoryInWindAndTellsItsTorqueMargin) {
  chain_.remove(0);
  services::CommandModelOptions options = test::InProcessChain::shipped_command_model();
  options.plant = services::CommandModelOptions::Plant::kRotor;
  options.wind = {6.0, -3.0};
  chain_.add_command_model(options);
  bus::Bus& bus = chain_.listener().bus;
  std::string said;
  bus.subscribe<messages::ServiceStatus>(
      messages::kServiceStatusChannel,
      [&](const messages::ServiceStatus& status, const messages::Stamp&) { said = status.text; });
  bus.publish(messages::kTrajectoryChannel, trajectory_, bus.now());
  ASSERT_TRUE(chain_.turn_until(
      [&] { return said.find("arrived: ") == 0 && chain_.vehicle_states.size() >= 38; }, 15.0));
  for (std::size_t i = 1; i + 3 < chain_.vehicle_states.size(); ++i) {  // not beyond its end
    const messages::VehicleState& state = chain_.vehicle_states[i];
    double nearest_m = 1e9;
    double above_m = 0.0;
    for (const flight::FlightState& wanted : plan_.trajectory.states) {
      const double distance_m =
          std::hypot(state.state.x_m - wanted.x_m, state.state.y_m - wanted.y_m);
      if (distance_m < nearest_m) {
        nearest_m = distance_m;
        above_m = state.state.altitude_m - wanted.altitude_m;
      }
    }
    EXPECT_LT(nearest_m, 3.0) << i;
    EXPECT_LT(std::fabs(above_m), 2.0) << i;
  }
  EXPECT_THAT(said, ::testing::HasSubstr("torque margin"));
}

void expect_late_log_holds_every_chunk(const map::Map& map, const std::string& config_text) {
  const test::TemporaryFolder folder;
  test::InProcessChain chain;
  chain.add_map_tiler(map);
  chain.add_global_planner();
  chain.ask(test::across_the_hills(map), map.hash, config_text);
  // The map has gone to the planner, and nobody has recorded it.
  ASSERT_TRUE(chain.turn_until([&] { return !chain.routes.empty(); }));
  chain.add_flight_logger(folder.path() / "late.lcmlog");
  chain.ask(test::across_the_hills(map), map.hash, config_text);
  const Time begin = chain.listener().bus.now();
  chain.turn_until([&] { return seconds_between(begin, chain.listener().bus.now()) > 4.0; });
  chain.remove(2);

  // A planner that has nothing but the log gets all it needs.
  test::Station replay("file://" + (folder.path() / "late.lcmlog").string(), "global_planner");
  std::vector<messages::RouteHeader> routes;
  replay.bus.tap_published([&](const bus::RawMessage& message) {
    if (message.channel == messages::kRouteChannel.name) {
      messages::Stamp stamp;
      routes.push_back(messages::from_message<messages::RouteHeader>(message.bytes, stamp));
    }
  });
  services::GlobalPlannerService service(
      test::frequent_planner_options<services::GlobalPlannerService>("global_planner"), replay.bus,
      replay.exchange, replay.loop);
  replay.tick = [&](Time now) { service.tick(now); };
  while (!replay.bus.is_finished()) {
    replay.turn();
  }
  replay.turn();
  EXPECT_EQ(service.unanswered(), "");
  ASSERT_FALSE(routes.empty());
  EXPECT_EQ(routes.front().plan, chain.routes.front().plan);
}

TEST(FlightLoggerService, ALoggerThatComesLateStillLeavesALogWithEveryChunk) {
  expect_late_log_holds_every_chunk(test::small_hills(), shipped_planning().text);
}

TEST(FlightLoggerService, NamedObserversThatARequestWeighsAreInTheLogToo) {
  expect_late_log_holds_every_chunk(
      test::watched_hills(), planning::effective_planning_config("", {"weights.threats=20"}));
}

}  // namespace
}  // namespace hedgehop
