#include <atomic>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <thread>

#include "planning/planning.hpp"
#include "services/in_process_chain.hpp"
#include "services/small_hills.hpp"

namespace hedgehop {
namespace {

using messages::PlanStage;
using testing::HasSubstr;

planning::PlanningConfig shipped_planning() {
  return planning::read_planning_config(planning::effective_planning_config("", {}), "shipped");
}

// A local planner in lockstep in a thread of its own, as it waits for others while it plans.
class LockstepTest : public ::testing::Test {
 protected:
  LockstepTest()
      : station_(chain_.url(), "local_planner"),
        service_(test::frequent_planner_options<services::LocalPlannerService>("local_planner"),
                 station_.bus, station_.exchange, station_.loop, true) {
    station_.tick = [this](Time now) { service_.tick(now); };
    chain_.add_map_tiler(map_);
    chain_.add_global_planner();
    planner_ = std::thread([this] {
      while (!is_over_) {
        station_.loop.turn(0.001, station_.tick);
      }
    });
  }
  ~LockstepTest() override {
    is_over_ = true;
    // What still waits for a step gives up.
    if (request_) {
      chain_.listener().bus.publish(messages::kPlanCancelChannel, {request_->request_id},
                                    chain_.listener().bus.now());
    }
    planner_.join();
  }

  void ask() { request_ = chain_.ask(test::across_the_hills(map_), map_.hash, config_.text); }
  bool arrives(double timeout_s) {
    return chain_.turn_until([&] { return chain_.plan().has_value(); }, timeout_s);
  }
  void expect_the_trajectory_of_one_process() {
    SilentObserver observer;
    const auto wanted = std::get<flight::Plan>(
        planning::plan(map_, test::across_the_hills(map_), config_, {}, observer));
    const messages::TrajectoryHeader& header = chain_.trajectories.back();
    EXPECT_EQ(header.plan, chain_.listener().exchange.offer_records(
                               messages::encode_flight_plan(wanted, header.route.id),
                               messages::kFlightStateBytes, false));
  }
  // Some state of the local planner's status says that.
  bool was_told(const std::string& text) const {
    return std::any_of(chain_.statuses.begin(), chain_.statuses.end(), [&](const auto& status) {
      return status.stage == PlanStage::kLocal && status.text.find(text) != std::string::npos;
    });
  }

  map::Map map_ = test::small_hills();
  planning::PlanningConfig config_ = shipped_planning();
  test::InProcessChain chain_;
  test::Station station_;
  services::LocalPlannerService service_;
  std::thread planner_;
  std::optional<messages::PlanRequestMessage> request_;
  std::atomic<bool> is_over_{false};
};

TEST_F(LockstepTest, TheModelOfAnotherProcessFliesTheSameTrajectory) {
  chain_.add_command_model();
  ask();
  ASSERT_TRUE(arrives(60.0));
  expect_the_trajectory_of_one_process();
  EXPECT_GT(chain_.vehicle_states.size(), 2000U);
}

TEST_F(LockstepTest, InWindTheModelOfAnotherProcessFliesTheSameTrajectoryToo) {
  config_ = planning::read_planning_config(
      planning::effective_planning_config(
          "", {"conditions.wind_mps=12", "conditions.wind_from_deg=200"}),
      "windy");
  chain_.add_command_model();
  ask();
  ASSERT_TRUE(arrives(60.0));
  expect_the_trajectory_of_one_process();
}

TEST_F(LockstepTest, LostAndRepeatedAnswersChangeNothing) {
  test::Station partner(chain_.url(), "command_model");
  const command_model::CommandModel model(shipped_planning().vehicle);
  std::int64_t newest = 0;
  partner.bus.subscribe<messages::VehicleTarget>(
      messages::kVehicleTargetChannel,
      [&](const messages::VehicleTarget& target, const messages::Stamp&) {
        const bool is_first_time = target.step_number > newest;
        newest = std::max(newest, target.step_number);
        if (is_first_time && target.step_number % 500 == 0) {
          return;  // lost
        }
        messages::VehicleState answer;
        answer.request_id = target.request_id;
        answer.step_number = target.step_number;
        answer.is_lockstep = true;
        answer.flight_time_s = 0.0;
        answer.command = target.command;
        answer.state = model.step(target.state, target.command, target.step_s);
        partner.bus.publish(messages::kVehicleStateChannel, answer, partner.bus.now());
        // A late one of the step before, with another state.
        --answer.step_number;
        answer.state.x_m += 1000.0;
        if (answer.step_number > 0) {
          partner.bus.publish(messages::kVehicleStateChannel, answer, partner.bus.now());
        }
      });
  ask();
  ASSERT_TRUE(chain_.turn_until(
      [&] {
        partner.turn();
        return chain_.plan().has_value();
      },
      60.0));
  EXPECT_GT(newest, 2000);
  expect_the_trajectory_of_one_process();
}

TEST_F(LockstepTest, AMissingModelIsNamedWithinASecondAndThePlanGoesOnWhenItComes) {
  bool is_asking = false;
  chain_.listener().bus.subscribe<messages::VehicleTarget>(
      messages::kVehicleTargetChannel,
      [&](const messages::VehicleTarget&, const messages::Stamp&) { is_asking = true; });
  ask();
  ASSERT_TRUE(chain_.turn_until([&] { return is_asking; }));
  EXPECT_TRUE(chain_.turn_until([&] { return was_told("command_model"); }, 1.0));
  EXPECT_FALSE(arrives(0.5));
  chain_.add_command_model();
  // It did not hear the route: the request brings it again.
  ask();
  ASSERT_TRUE(arrives(60.0));
  EXPECT_THAT(chain_.newest_status(PlanStage::kLocal)->text,
              testing::Not(HasSubstr("command_model")));
  expect_the_trajectory_of_one_process();
}

}  // namespace
}  // namespace hedgehop
