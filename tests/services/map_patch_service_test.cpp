#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <limits>
#include <thread>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "output/plan_bundle.hpp"
#include "planning/planning.hpp"
#include "preparation/map_patches.hpp"
#include "services/in_process_chain.hpp"
#include "services/small_hills.hpp"
#include "support/temporary_folder.hpp"

namespace hedgehop {
namespace {

using messages::MapPatch;
using messages::PlanState;
using ::testing::HasSubstr;

const map::Map& hills() {
  static const map::Map map = test::small_hills();
  return map;
}

MapPatch unnumbered(map::Patch patch) {
  MapPatch message;
  message.base_map_hash = hills().hash;
  message.patch = std::move(patch);
  return message;
}

// Across the straight way from start to goal.
map::Patch wall(std::int64_t id) {
  map::Patch patch;
  patch.id = id;
  patch.kind = map::PatchKind::kArea;
  patch.floor.value_m = -1e5;
  patch.ceiling.value_m = 1e5;
  patch.outline = {{test::kUtmWest_m + 3500.0, test::kUtmSouth_m + 1400.0},
                   {test::kUtmWest_m + 3900.0, test::kUtmSouth_m + 1400.0},
                   {test::kUtmWest_m + 3900.0, test::kUtmSouth_m + 3200.0},
                   {test::kUtmWest_m + 3500.0, test::kUtmSouth_m + 3200.0}};
  patch.label = "fire";
  return patch;
}

map::Patch crane(std::int64_t id) {
  map::Patch patch;
  patch.id = id;
  patch.centre = {test::kUtmWest_m + 2500.0, test::kUtmSouth_m + 2500.0};
  patch.radius_m = 40.0;
  patch.height_m = 90.0;
  return patch;
}

map::Map patched(const std::vector<map::Patch>& patches) {
  SilentObserver observer;
  return preparation::patched_map(
      hills(), patches,
      services::read_map_tiler_options(services::load_config("", "map_tiler.yaml").reader())
          .patches,
      observer);
}

class MapPatchService : public testing::Test {
 protected:
  void publish(const MapPatch& message) {
    chain_.listener().bus.publish(messages::kMapPatchChannel, message, chain_.listener().bus.now());
  }
  bool is_numbered(std::int64_t id, bool is_present) {
    return chain_.turn_until([&] {
      const auto patch = chain_.patches.find(id);
      return patch != chain_.patches.end() && patch->second.is_present == is_present;
    });
  }
  // All stages, and a request across the hills whose flight command_model takes up. Its id.
  Hash128 begin_flight(const services::CommandModelOptions& options) {
    chain_.add_map_tiler(hills());
    chain_.add_global_planner();
    chain_.add_local_planner();
    chain_.add_command_model(options);
    chain_.listener().bus.subscribe<messages::ServiceStatus>(
        messages::kServiceStatusChannel,
        [this](const messages::ServiceStatus& status, const messages::Stamp&) {
          said_ = status.name == "command_model" ? status.text : said_;
        });
    const auto config =
        planning::read_planning_config(planning::effective_planning_config("", {}), "shipped");
    return chain_.ask(test::across_the_hills(hills()), hills().hash, config.text).request_id;
  }
  test::InProcessChain chain_;
  std::string said_;  // by command_model
};

TEST_F(MapPatchService, PatchesAreNumberedInOrderAndTheMapOfTheIndexIsThePatchedOne) {
  chain_.add_map_tiler(hills());
  publish(unnumbered(crane(70)));
  publish(unnumbered(wall(60)));
  ASSERT_TRUE(is_numbered(60, true));
  EXPECT_EQ(chain_.patches.at(70).patch_number, 1);
  EXPECT_EQ(chain_.patches.at(60).patch_number, 2);
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.patch_state && chain_.index; }));
  EXPECT_EQ(chain_.index->patch_number, 2);
  EXPECT_EQ(chain_.index->map_hash, patched({crane(70), wall(60)}).hash);
  EXPECT_EQ(chain_.patch_state->map_hash, chain_.index->map_hash);
  EXPECT_EQ(chain_.patch_state->base_map_hash, hills().hash);
  EXPECT_EQ(chain_.patch_state->patch_count, 2);

  // Said again it keeps its number; changed it gets another one; gone it is no more.
  publish(unnumbered(wall(60)));
  chain_.patches.clear();
  ASSERT_TRUE(is_numbered(60, true));
  EXPECT_EQ(chain_.patches.at(60).patch_number, 2);
  map::Patch longer = wall(60);
  longer.outline[0].y_m -= 100.0;
  publish(unnumbered(longer));
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.patches.at(60).patch_number == 3; }));
  for (const std::int64_t id : {60, 70}) {
    MapPatch gone = unnumbered({});
    gone.patch.id = id;
    gone.is_present = false;
    publish(gone);
    ASSERT_TRUE(is_numbered(id, false));
  }
  EXPECT_EQ(chain_.index->patch_number, 5);
  EXPECT_EQ(chain_.index->map_hash, hills().hash);
}

TEST_F(MapPatchService, WhatIsRefusedIsNamedToItsSenderAndChangesNothing) {
  chain_.add_map_tiler(hills());
  const auto refusal_of = [&](const MapPatch& message) {
    chain_.patch_state.reset();
    publish(message);
    EXPECT_TRUE(chain_.turn_until([&] {
      return chain_.patch_state && chain_.patch_state->refused_patch_id == message.patch.id;
    }));
    EXPECT_EQ(chain_.patch_state->refused_sender_id, chain_.listener().bus.sender_id());
    return chain_.patch_state->refusal;
  };
  MapPatch foreign = unnumbered(crane(1));
  foreign.base_map_hash = {1, 2};
  EXPECT_THAT(refusal_of(foreign), HasSubstr(Hash128{1, 2}.hex()));
  EXPECT_THAT(refusal_of(foreign), HasSubstr(hills().hash.hex()));
  MapPatch outside = unnumbered(crane(2));
  outside.patch.centre.x_m = 0.0;
  EXPECT_THAT(refusal_of(outside), HasSubstr("outside the map"));
  MapPatch unknown = unnumbered(crane(3));
  unknown.is_present = false;
  EXPECT_THAT(refusal_of(unknown), HasSubstr("nothing of this id"));
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.index.has_value(); }));
  EXPECT_EQ(chain_.index->patch_number, 0);
  EXPECT_EQ(chain_.index->map_hash, hills().hash);
}

TEST_F(MapPatchService, AMapTilerThatIsStartedAgainKnowsThePatchesOfItsJournal) {
  test::TemporaryFolder folder;
  const auto journal = folder.path() / "patches.lcmlog";
  chain_.add_map_tiler(hills(), journal);
  publish(unnumbered(crane(1)));
  ASSERT_TRUE(is_numbered(1, true));
  publish(unnumbered(wall(2)));
  ASSERT_TRUE(is_numbered(2, true));
  chain_.remove(0);
  chain_.index.reset();
  chain_.patches.clear();
  chain_.add_map_tiler(hills(), journal);
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.index.has_value(); }));
  EXPECT_EQ(chain_.index->patch_number, 2);
  EXPECT_EQ(chain_.index->map_hash, patched({crane(1), wall(2)}).hash);
  publish(unnumbered(crane(3)));
  ASSERT_TRUE(is_numbered(3, true));
  EXPECT_EQ(chain_.patches.at(3).patch_number, 3);

  // Not over another map, and not when it is damaged.
  map::Map other = hills();
  other.label = "OTHER";
  test::finish_map(other);
  chain_.remove(0);
  EXPECT_THROW(chain_.add_map_tiler(other, journal), DataError);
  std::filesystem::resize_file(journal, std::filesystem::file_size(journal) - 5);
  EXPECT_THROW(chain_.add_map_tiler(hills(), journal), DataError);
}

TEST_F(MapPatchService, APlanOverPatchesIsThatOfAMapWithTheSameThingsInIt) {
  chain_.add_map_tiler(hills());
  chain_.add_global_planner();
  chain_.add_local_planner();
  publish(unnumbered(wall(60)));
  publish(unnumbered(crane(70)));
  ASSERT_TRUE(is_numbered(70, true));
  const map::Map map = patched({wall(60), crane(70)});
  const auto config =
      planning::read_planning_config(planning::effective_planning_config("", {}), "shipped");
  chain_.ask(test::across_the_hills(map), map.hash, config.text);
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.plan().has_value(); }));
  EXPECT_EQ(chain_.routes.back().patch_number, 2);
  EXPECT_EQ(chain_.trajectories.back().patch_number, 2);

  SilentObserver observer;
  const auto local = std::get<flight::Plan>(
      planning::plan(map, test::across_the_hills(map), config, {}, observer));
  EXPECT_EQ(output::plan_json(*chain_.plan()), output::plan_json(local));
  EXPECT_EQ(output::trajectory_csv(*chain_.plan()), output::trajectory_csv(local));
}

// What is asked of the old map meanwhile is neither answered nor mixed: the work stops.
TEST_F(MapPatchService, APlanUnderWayIsGivenUpWhenThePatchComesAndMadeOnTheNewMap) {
  chain_.add_map_tiler(hills());
  chain_.add_global_planner();
  flight::PlanRequest request = test::across_the_hills(hills());
  request.work_budget = 2'000'000'000;  // hours
  const auto config = planning::read_planning_config(
      planning::effective_planning_config("", {"global.planner=bit_star", "global.refine=false"}),
      "shipped");
  chain_.ask(request, hills().hash, config.text);
  // The planner holds this thread until it hears of the patch, which needs a map_tiler in another.
  const std::string url = chain_.url();
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.index.has_value(); }));
  std::thread tiler([&] {
    test::Station station(url, "map_tiler");
    services::MapTilerService service(
        services::read_map_tiler_options(services::load_config("", "map_tiler.yaml").reader()),
        hills(), station.bus, station.exchange);
    bool is_working = false;
    std::int64_t waits_for_patch = 0;
    station.bus.subscribe<messages::PlanStatus>(
        messages::kPlanStatusChannel,
        [&](const messages::PlanStatus& status, const messages::Stamp&) {
          is_working = is_working || status.state == PlanState::kWorking;
          waits_for_patch += status.text.find("(patch 1)") != std::string::npos ? 1 : 0;
        });
    bool is_told = false;
    const Time begin = station.bus.now();
    while (waits_for_patch == 0 && seconds_between(begin, station.bus.now()) < 20.0) {
      station.loop.turn(0.01, [&](Time now) {
        if (is_working && !is_told) {
          is_told = true;
          station.bus.publish(messages::kMapPatchChannel, unnumbered(wall(60)), now);
        }
        service.tick(now);
      });
    }
  });
  EXPECT_TRUE(chain_.turn_until([&] {
    const auto status = chain_.newest_status(messages::PlanStage::kGlobal);
    return status && status->text.find("(patch 1)") != std::string::npos;
  }));
  tiler.join();
  EXPECT_TRUE(chain_.routes.empty());
  EXPECT_EQ(chain_.newest_status(messages::PlanStage::kGlobal)->state, PlanState::kWaiting);

  // Asked on the map that counts now, it is planned.
  request.work_budget = 20000;
  chain_.ask(request, patched({wall(60)}).hash, config.text);
  ASSERT_TRUE(chain_.turn_until([&] { return !chain_.routes.empty(); }));
  EXPECT_EQ(chain_.routes.back().patch_number, 1);
  EXPECT_EQ(chain_.routes.back().map_hash, patched({wall(60)}).hash);
}

TEST_F(MapPatchService, ARouteOfAnotherPatchIsRefusedAndBothAreNamed) {
  chain_.add_map_tiler(hills());
  chain_.add_local_planner();
  publish(unnumbered(crane(1)));
  ASSERT_TRUE(is_numbered(1, true));
  // Made on the base map by somebody who has not heard of the patch.
  SilentObserver observer;
  const auto config =
      planning::read_planning_config(planning::effective_planning_config("", {}), "shipped");
  const auto route = std::get<flight::RoutePlan>(
      planning::plan_route(hills(), test::across_the_hills(hills()), config, {}, observer));
  test::Station& station = chain_.listener();
  messages::RouteHeader header;
  header.request_id = route.request_id;
  header.map_hash = hills().hash;
  header.plan = station.exchange.offer(messages::encode_route_plan(route), true);
  header.provenance = "test";
  station.bus.publish(messages::kRouteChannel, header, station.bus.now());
  const auto text = [&] {
    const auto status = chain_.newest_status(messages::PlanStage::kLocal);
    return status ? status->text : std::string();
  };
  ASSERT_TRUE(chain_.turn_until([&] { return text().find("(patch 1)") != std::string::npos; }));
  EXPECT_THAT(text(), HasSubstr(hills().hash.hex()));
  EXPECT_THAT(text(), HasSubstr(patched({crane(1)}).hash.hex()));
  station.bus.publish(messages::kPlanCancelChannel, messages::PlanCancel{{1, 2}},
                      station.bus.now() + 60.0);  // message time goes on by a minute
  EXPECT_TRUE(chain_.turn_until([&] {
    return chain_.newest_status(messages::PlanStage::kLocal)->state == PlanState::kRefused;
  }));
  EXPECT_TRUE(chain_.trajectories.empty());
}

TEST_F(MapPatchService, AFlightUnderWayIsPlannedAgainFromAheadAndFlownOnWithoutAJump) {
  services::CommandModelOptions options = test::InProcessChain::shipped_command_model();
  options.replan_lead_s = 2.0;
  const Hash128 first = begin_flight(options);
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.vehicle_states.size() >= 5; }));
  ASSERT_EQ(chain_.vehicle_states.back().request_id, first);

  publish(unnumbered(wall(60)));
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.vehicle_states.back().request_id != first; }));
  const std::size_t joined = chain_.vehicle_states.size() - 1;
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.vehicle_states.size() >= joined + 25; }));

  // One vehicle: 40 m/s are 2 m in 50 ms, before, after and where the plans meet.
  for (std::size_t i = 1; i < chain_.vehicle_states.size(); ++i) {
    const auto& before = chain_.vehicle_states[i - 1].state;
    const auto& after = chain_.vehicle_states[i].state;
    const double moved_m = std::hypot(after.x_m - before.x_m, after.y_m - before.y_m);
    if (i == joined) {
      EXPECT_EQ(moved_m, 0.0);  // the state at which it is taken over is told under both requests
    } else {
      EXPECT_NEAR(moved_m, 2.0, 0.7) << i;
      EXPECT_LT(std::fabs(after.altitude_m - before.altitude_m), 1.0) << i;
    }
  }
  const messages::TrajectoryHeader& header = chain_.trajectories.back();
  EXPECT_EQ(header.request_id, chain_.vehicle_states.back().request_id);
  EXPECT_EQ(header.patch_number, 1);
  EXPECT_EQ(header.map_hash, patched({wall(60)}).hash);
  ASSERT_TRUE(chain_.turn_until([&] { return said_.find("on patch 1") != std::string::npos; }));

  // The rest of the flight: from the path on to the same goal, and around the area.
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.plan().has_value(); }));
  const flight::Plan plan = *chain_.plan();
  const auto& place = chain_.vehicle_states[joined].state;
  EXPECT_NEAR(plan.trajectory.states.front().x_m, place.x_m, 0.5);
  EXPECT_NEAR(plan.trajectory.states.front().y_m, place.y_m, 0.5);
  const flight::RequestPoint goal = test::across_the_hills(hills()).goal;
  EXPECT_EQ(plan.route_plan.request.goal.position.latitude_rad, goal.position.latitude_rad);
  EXPECT_EQ(plan.route_plan.request.goal.position.longitude_rad, goal.position.longitude_rad);
  for (const flight::FlightState& state : plan.trajectory.states) {
    EXPECT_FALSE(state.x_m > test::kUtmWest_m + 3500.0 && state.x_m < test::kUtmWest_m + 3900.0 &&
                 state.y_m > test::kUtmSouth_m + 1400.0 && state.y_m < test::kUtmSouth_m + 3200.0);
  }
}

// Nobody plans again here: what happens, the flight does by itself.
TEST_F(MapPatchService, WhatAppearsAheadChangesTheNextStepAndNoCommandedHeadingJumps) {
  services::CommandModelOptions options = test::InProcessChain::shipped_command_model();
  options.replan_lead_s = 0.0;
  begin_flight(options);
  ASSERT_TRUE(chain_.turn_until(
      [&] { return chain_.vehicle_states.size() >= 20 && chain_.plan().has_value(); }));
  const std::vector<flight::FlightState> plan = chain_.plan()->trajectory.states;

  // A mast on the path, 400 m ahead: within what rollouts look at.
  map::Patch mast = crane(70);
  mast.height_m = 170.0;
  mast.centre =
      plan.at(static_cast<std::size_t>(chain_.vehicle_states.back().step_number) + 200).point();
  const std::size_t before = chain_.vehicle_states.size();
  publish(unnumbered(mast));
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.vehicle_states.size() >= before + 40; }));

  std::size_t first_changed = 0;
  for (std::size_t i = before - 10; i < before + 40; ++i) {
    const messages::VehicleState& state = chain_.vehicle_states[i];
    const flight::FlightState& planned = plan.at(static_cast<std::size_t>(state.step_number));
    const double planned_rad = math_angle_from_azimuth_rad(
        grid_from_true_azimuth_rad(planned.commanded_heading_true_rad, planned.convergence_rad));
    const double turned_rad = std::fabs(wrap_to_pi(state.command.heading_math_rad - planned_rad));
    if (first_changed == 0 && turned_rad > 1e-6) {
      first_changed = i;
    }
    const messages::VehicleState& last = chain_.vehicle_states[i - 1];
    EXPECT_EQ(state.step_number, last.step_number + 1);
    EXPECT_LE(std::fabs(wrap_to_pi(state.command.heading_math_rad - last.command.heading_math_rad)),
              options.reaction.heading_rate_max_radps * 0.05 + 1e-9)
        << i;
    EXPECT_NEAR(std::hypot(state.state.x_m - last.state.x_m, state.state.y_m - last.state.y_m), 2.0,
                0.7)
        << i;
  }
  // A state may have been on its way before the patch was.
  EXPECT_GE(first_changed, before);
  EXPECT_LE(first_changed, before + 2);
  EXPECT_TRUE(chain_.turn_until([&] { return said_.find("has appeared") != std::string::npos; }))
      << said_;
}

TEST_F(MapPatchService, AFlightUnderControllersReactsWithoutAJumpToo) {
  services::CommandModelOptions options = test::InProcessChain::shipped_command_model();
  options.replan_lead_s = 0.0;
  options.plant = services::CommandModelOptions::Plant::kClosedLoop;
  begin_flight(options);
  ASSERT_TRUE(chain_.turn_until(
      [&] { return chain_.vehicle_states.size() >= 10 && chain_.plan().has_value(); }));
  const messages::VehicleState here = chain_.vehicle_states.back();
  map::Patch mast = crane(70);
  mast.height_m = 170.0;
  mast.centre =
      chain_.plan()->trajectory.states.at(static_cast<std::size_t>(here.step_number) + 200).point();
  const std::size_t before = chain_.vehicle_states.size();
  publish(unnumbered(mast));
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.vehicle_states.size() >= before + 60; }));
  double turned_rad = 0.0;
  for (std::size_t i = before + 2; i < before + 60; ++i) {
    const messages::VehicleState& state = chain_.vehicle_states[i];
    const messages::VehicleState& last = chain_.vehicle_states[i - 1];
    EXPECT_EQ(state.step_number, last.step_number + 1);
    EXPECT_LE(std::fabs(wrap_to_pi(state.command.heading_math_rad - last.command.heading_math_rad)),
              options.reaction.heading_rate_max_radps * 0.05 + 1e-9)
        << i;
    EXPECT_NEAR(std::hypot(state.state.x_m - last.state.x_m, state.state.y_m - last.state.y_m), 2.0,
                0.7)
        << i;
    turned_rad = std::max(turned_rad, std::fabs(wrap_to_pi(state.command.heading_math_rad -
                                                           here.command.heading_math_rad)));
  }
  EXPECT_GT(turned_rad, 10.0 * kDegree_rad) << "three seconds after the mast has appeared";
}

TEST(RestOfFlight, ViaPointsThatHaveBeenPassedAreLeftOutAndTheRestIsAsItWasAskedFor) {
  const geo::MapProjection projection(hills().crs_wkt);
  flight::RoutePlan route;
  route.map.crs_wkt = hills().crs_wkt;
  route.request = test::across_the_hills(hills());
  route.request.speed_mps = 33.0;
  for (const double x_m : {1500.0, 2500.0, 3500.0}) {
    flight::RequestPoint via;
    via.position = projection.to_geodetic({test::kUtmWest_m + x_m, test::kUtmSouth_m + 2600.0});
    route.request.via.push_back(via);
  }
  flight::Trajectory trajectory;
  trajectory.step_s = 0.05;
  for (int i = 0; i < 100; ++i) {  // eastwards past them, 30 m a state
    flight::FlightState state;
    state.x_m = test::kUtmWest_m + 1000.0 + 30.0 * i;
    state.y_m = test::kUtmSouth_m + 2600.0;
    state.altitude_m = 480.0;
    state.surface_m = 410.0;
    state.heading_true_rad = 1.5;
    trajectory.states.push_back(state);
  }
  // State 60 lies at 2800 m.
  const auto rest = services::rest_of_flight({&route, &trajectory, 10, {}}, 60);
  ASSERT_TRUE(rest.has_value());
  ASSERT_EQ(rest->via.size(), 1U);
  EXPECT_EQ(rest->via[0].position.longitude_rad, route.request.via[2].position.longitude_rad);
  EXPECT_EQ(rest->goal.position.longitude_rad, route.request.goal.position.longitude_rad);
  EXPECT_EQ(rest->speed_mps, 33.0);
  EXPECT_EQ(rest->start_heading_true_rad, 1.5);
  EXPECT_DOUBLE_EQ(rest->start.height_m.value(), 70.0);
  const geo::MapPoint start = projection.to_map(rest->start.position);
  EXPECT_NEAR(start.x_m, test::kUtmWest_m + 2800.0, 1e-3);
  EXPECT_NEAR(start.y_m, test::kUtmSouth_m + 2600.0, 1e-3);

  trajectory.states[60].surface_m = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(services::rest_of_flight({&route, &trajectory, 10, {}}, 60).has_value());
}

}  // namespace
}  // namespace hedgehop
