#include <algorithm>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <set>

#include "base/errors.hpp"
#include "map/map_bundle.hpp"
#include "output/plan_bundle.hpp"
#include "planning/map_for_plan.hpp"
#include "planning/planning.hpp"
#include "preparation/map_patches.hpp"
#include "services/in_process_chain.hpp"
#include "services/small_hills.hpp"
#include "support/temporary_folder.hpp"

namespace hedgehop {
namespace {

using messages::MapPatch;
using messages::PlanStage;
using messages::PlanState;
using ::testing::HasSubstr;

planning::PlanningConfig weighing(const std::string& weight) {
  return planning::read_planning_config(
      planning::effective_planning_config("", {"weights.threats=" + weight}), "test");
}

flight::Plan planned_alone(const map::Map& map, const planning::PlanningConfig& config) {
  SilentObserver observer;
  return std::get<flight::Plan>(
      planning::plan(map, test::across_the_hills(map), config, {}, observer));
}

void expect_same_files(const flight::Plan& a, const flight::Plan& b) {
  EXPECT_EQ(output::plan_json(a), output::plan_json(b));
  EXPECT_EQ(output::route_geojson(a), output::route_geojson(b));
  EXPECT_EQ(output::trajectory_csv(a), output::trajectory_csv(b));
}

// A bundle of the hills on disk, which the command line and the map tiler read.
class NamedObservers : public testing::Test {
 protected:
  NamedObservers() {
    const map::Map map = test::small_hills();
    map::write_map_bundle(map, R"({"inputs": []})", folder_.path());
    chain_.listener().bus.subscribe<messages::Chunk>(
        messages::kChunkChannel, [this](const messages::Chunk& chunk, const messages::Stamp&) {
          sent_blobs_.insert(chunk.blob_id);
        });
  }
  void write_observers(const map::Map& map) {
    std::vector<map::NamedBand> bands;
    for (const map::HeightLayer& threat : map.threats) {
      bands.push_back({threat.name, &threat.height_m});
    }
    map::write_height_bands(map, bands, folder_.path() / map::kThreatsFile);
  }
  // What the tiler reads of the bundle.
  [[nodiscard]] map::Map served_map() const {
    bus::ServiceArguments arguments;
    arguments.values = {{"--map", folder_.path().string()}};
    return services::read_map(arguments);
  }
  void add_planners() {
    chain_.add_map_tiler(served_map());
    chain_.add_global_planner();
    chain_.add_local_planner();
    ASSERT_TRUE(chain_.turn_until([&] { return chain_.index.has_value(); }));
  }
  // As `hedgehop request` asks.
  void ask(const planning::PlanningConfig& config) {
    chain_.ask(test::across_the_hills(hills_),
               chain_.index->hash_for(planning::weighs_threats(config.text)), config.text);
  }
  void publish(map::Patch patch) {
    MapPatch message;
    message.base_map_hash = hills_.hash;
    message.patch = std::move(patch);
    chain_.listener().bus.publish(messages::kMapPatchChannel, message, chain_.listener().bus.now());
  }
  static map::Map patched(const map::Map& map, const map::Patch& patch) {
    SilentObserver observer;
    return preparation::patched_map(
        map, {patch},
        services::read_map_tiler_options(services::load_config("", "map_tiler.yaml").reader())
            .patches,
        observer);
  }

  const map::Map hills_ = test::small_hills();
  test::TemporaryFolder folder_;
  test::InProcessChain chain_;
  std::set<Hash128> sent_blobs_;
};

map::Patch lookout(std::int64_t id) {
  map::Patch patch;
  patch.id = id;
  patch.kind = map::PatchKind::kThreat;
  patch.centre = {test::kUtmWest_m + 3600.0, test::kUtmSouth_m + 1000.0};
  patch.radius_m = 1500.0;
  patch.height_m = 20.0;
  return patch;
}

TEST_F(NamedObservers, APlanThatWeighsThemOverTheBusIsTheCommandLinesByteForByte) {
  write_observers(test::watched_hills());
  const planning::PlanningConfig config = weighing("20");
  const flight::Plan alone = planned_alone(planning::read_map_for(folder_.path(), config), config);
  // The tower sees 1200 m of the way that is best without it.
  const flight::Plan unweighed = planned_alone(hills_, weighing("0"));
  ASSERT_FALSE(output::trajectory_csv(alone) == output::trajectory_csv(unweighed));

  add_planners();
  ask(config);
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.plan().has_value(); }));
  expect_same_files(*chain_.plan(), alone);
  EXPECT_EQ(chain_.trajectories.back().map_hash, test::watched_hills().hash);
  EXPECT_EQ(chain_.routes.back().map_hash, test::watched_hills().hash);

  // The same services plan without them on the map without them.
  ask(weighing("0"));
  ASSERT_TRUE(chain_.turn_until(
      [&] { return chain_.trajectories.size() > 1 && chain_.plan().has_value(); }));
  expect_same_files(*chain_.plan(), unweighed);
  EXPECT_EQ(chain_.trajectories.back().map_hash, hills_.hash);
}

TEST_F(NamedObservers, TheirLayersTravelOnlyWhereSomebodyWeighsThem) {
  write_observers(test::watched_hills());
  add_planners();
  ASSERT_TRUE(chain_.index->threats.has_value());
  const Hash128 table = chain_.index->threats->table.id;
  ask(weighing("0"));
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.plan().has_value(); }));
  EXPECT_TRUE(sent_blobs_.contains(chain_.index->tile_table.id));
  EXPECT_FALSE(sent_blobs_.contains(table));
  ask(weighing("20"));
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.trajectories.size() > 1; }));
  EXPECT_TRUE(sent_blobs_.contains(table));
}

TEST_F(NamedObservers, AMapWithoutThemRefusesTheirWeightAndSaysWhatToDo) {
  add_planners();
  EXPECT_FALSE(chain_.index->threats.has_value());
  EXPECT_EQ(chain_.index->map_hash, hills_.hash);
  ask(weighing("20"));
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.is_global(PlanState::kRefused); }));
  const std::string text = chain_.newest_status(PlanStage::kGlobal)->text;
  EXPECT_THAT(text, HasSubstr("weights.threats"));
  EXPECT_THAT(text, HasSubstr("the map knows none"));
  EXPECT_THAT(text, HasSubstr("hedgehop prepare --observers"));
  EXPECT_THAT(text, HasSubstr("hedgehop serve --map"));
  EXPECT_THAT(text, HasSubstr("weights.threats=0"));

  // And still plans what it can.
  ask(weighing("0"));
  EXPECT_TRUE(chain_.turn_until([&] { return chain_.plan().has_value(); }));
}

TEST_F(NamedObservers, ALayerThatDoesNotBelongToTheMapEndsItsTilerAtOnce) {
  map::Map below = test::watched_hills();
  below.threats[0].height_m.at(1, 1) = -4.0F;
  write_observers(below);
  EXPECT_THROW((void)served_map(), DataError);
  const map::Map other = test::make_map(20, 20, 30.0, [](double, double) { return 1.0; });
  const raster::Grid<float> layer(other.geometry, 5.0F);
  map::write_height_bands(other, {{"tower", &layer}}, folder_.path() / map::kThreatsFile);
  EXPECT_THROW((void)served_map(), DataError);
}

TEST_F(NamedObservers, AnObserverWhoAppearsIsWeighedLikeThoseOfTheMap) {
  const map::Map watched = test::watched_hills();
  write_observers(watched);
  add_planners();
  publish(lookout(60));
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.index->patch_number == 1; }));
  const map::Map expected = patched(watched, lookout(60));
  ASSERT_EQ(expected.threats.size(), 3U);
  EXPECT_EQ(chain_.index->map_hash, patched(hills_, lookout(60)).hash);
  ASSERT_TRUE(chain_.index->threats.has_value());
  EXPECT_EQ(chain_.index->threats->map_hash, expected.hash);
  ASSERT_TRUE(chain_.turn_until(
      [&] { return chain_.patch_state && chain_.patch_state->patch_number == 1; }));
  EXPECT_EQ(chain_.patch_state->base_map_hash, hills_.hash);
  EXPECT_EQ(chain_.patch_state->map_hash, chain_.index->map_hash);

  const planning::PlanningConfig config = weighing("20");
  ask(config);
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.plan().has_value(); }));
  expect_same_files(*chain_.plan(), planned_alone(expected, config));
}

TEST_F(NamedObservers, AnObserverBeyondWhatTheBusCarriesIsRefusedAndTheTilerGoesOn) {
  map::Map crowded = hills_;
  crowded.threats.assign(99, {"tower", raster::Grid<float>(hills_.geometry, 40.0F)});
  test::finish_map(crowded);
  chain_.add_map_tiler(crowded);
  publish(lookout(60));
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.index && chain_.index->patch_number == 1; }));
  EXPECT_EQ(chain_.index->threats->count, 100);
  publish(lookout(61));
  ASSERT_TRUE(chain_.turn_until(
      [&] { return chain_.patch_state && chain_.patch_state->refused_patch_id == 61; }));
  EXPECT_THAT(chain_.patch_state->refusal, HasSubstr("100 named observers"));
  // The one that is there may move.
  map::Patch moved = lookout(60);
  moved.centre.x_m += 300.0;
  publish(moved);
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.index->patch_number == 2; }));
  EXPECT_EQ(chain_.index->threats->count, 100);
}

TEST_F(NamedObservers, AFlightThatWeighsThemIsPlannedAgainOnTheChangedMapWithThem) {
  const map::Map watched = test::watched_hills();
  write_observers(watched);
  add_planners();
  chain_.add_command_model();
  ask(weighing("20"));
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.vehicle_states.size() >= 5; }));
  const Hash128 first = chain_.trajectories.back().request_id;
  // On the map that it was planned on it is not planned again.
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.vehicle_states.size() >= 60; }));
  EXPECT_EQ(chain_.trajectories.back().request_id, first);

  publish(lookout(60));
  ASSERT_TRUE(chain_.turn_until([&] { return chain_.trajectories.back().request_id != first; }));
  EXPECT_EQ(chain_.trajectories.back().map_hash, patched(watched, lookout(60)).hash);
  EXPECT_EQ(chain_.trajectories.back().patch_number, 1);
}

TEST_F(NamedObservers, AFlightThatWeighsThemStillFliesAroundWhatAppears) {
  write_observers(test::watched_hills());
  add_planners();
  services::CommandModelOptions options = test::InProcessChain::shipped_command_model();
  options.replan_lead_s = 0.0;
  chain_.add_command_model(options);
  for (int i = 0; i < 2; ++i) {  // so that it has the map before it flies
    chain_.index.reset();
    ASSERT_TRUE(chain_.turn_until([&] { return chain_.index.has_value(); }));
  }
  std::string said;
  chain_.listener().bus.subscribe<messages::ServiceStatus>(
      messages::kServiceStatusChannel,
      [&](const messages::ServiceStatus& status, const messages::Stamp&) {
        said = status.name == "command_model" ? status.text : said;
      });
  ask(weighing("20"));
  ASSERT_TRUE(chain_.turn_until(
      [&] { return chain_.vehicle_states.size() >= 10 && chain_.plan().has_value(); }));
  map::Patch mast;
  mast.id = 70;
  mast.radius_m = 40.0;
  mast.height_m = 170.0;
  mast.centre = chain_.plan()
                    ->trajectory.states
                    .at(static_cast<std::size_t>(chain_.vehicle_states.back().step_number) + 200)
                    .point();
  publish(mast);
  EXPECT_TRUE(chain_.turn_until([&] { return said.find("has appeared: ") != std::string::npos; }))
      << said;
}

}  // namespace
}  // namespace hedgehop
