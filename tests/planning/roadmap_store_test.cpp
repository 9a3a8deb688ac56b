#include "planning/roadmap_store.hpp"

#include <filesystem>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <variant>

#include "base/files.hpp"
#include "base/shipped_config.hpp"
#include "geo/map_projection.hpp"
#include "support/fractal_terrain.hpp"
#include "support/fresh_seed.hpp"
#include "support/temporary_folder.hpp"
#include "support/test_map.hpp"
#include "support/utm_map.hpp"

namespace hedgehop::planning {
namespace {

using ::testing::HasSubstr;

map::Map hills(std::uint64_t seed) {
  map::Map map = test::make_fractal_map(seed, 200, 30.0, 3000.0, 80.0);
  test::place_in_utm(map);
  test::finish_map(map);
  return map;
}

PlanningConfig config_with(std::vector<std::string> settings) {
  settings.emplace_back("global.planner=roadmap");
  settings.emplace_back("global.work_budget=40000");
  return read_planning_config(effective_planning_config("", settings), "test");
}

TEST(RoadmapStore, TheFileLiesBesideTheBundle) {
  EXPECT_EQ(roadmap_file("a/map"), "a/map.roadmap");
  EXPECT_EQ(roadmap_file("a/map/"), "a/map.roadmap");
  EXPECT_EQ(roadmap_file("map"), "map.roadmap");
  EXPECT_EQ(roadmap_file("."), std::filesystem::current_path().string() + ".roadmap");
}

TEST(RoadmapStore, TheKeyFollowsTheMapAndWhatShapesTheRoadmapAndNothingElse) {
  const map::Map map = hills(3);
  const Hash128 key = roadmap_key(map, config_with({}));
  EXPECT_EQ(roadmap_key(map, config_with({"global.refine=false", "global.guide_spacing_m=40",
                                          "local.passes=2", "speed_mps=35",
                                          "verification.goal_radius_m=70"})),
            key);
  for (const char* setting :
       {"weights.visibility=24", "weights.height_1pm=0.02", "semantics.otherwise=0.1",
        "global.envelope_floor_m=21", "global.envelope_ceiling_m=140", "global.lateral_margin_m=31",
        "global.climb_angle_max_deg=7", "global.turn_radius_m=280", "unknown_visibility=0.9",
        "small_patch_m=60"}) {
    EXPECT_NE(roadmap_key(map, config_with({setting})), key) << setting;
  }
  EXPECT_NE(roadmap_key(hills(4), config_with({})), key);
}

TEST(RoadmapStore, IsMadeWrittenReadAndMadeAgainWhereItDoesNotFit) {
  const test::TemporaryFolder folder;
  const std::filesystem::path file = roadmap_file(folder.path() / "map");
  const map::Map map = hills(3);
  SilentObserver observer;
  const PlanningConfig config = config_with({});
  const ReadyRoadmap first = ready_roadmap(map, config, file, observer);
  EXPECT_TRUE(first.is_built);
  EXPECT_TRUE(first.is_written);
  EXPECT_THAT(first.why_built, HasSubstr("there is no"));
  const ReadyRoadmap second = ready_roadmap(map, config, file, observer);
  EXPECT_FALSE(second.is_built);
  EXPECT_EQ(second.roadmap->written(second.key), first.roadmap->written(first.key));

  const PlanningConfig other = config_with({"global.envelope_floor_m=25"});
  const ReadyRoadmap third = ready_roadmap(map, other, file, observer);
  EXPECT_TRUE(third.is_built);
  EXPECT_THAT(third.why_built, HasSubstr("made of another map or with other settings"));
  EXPECT_FALSE(ready_roadmap(map, other, file, observer).is_built);

  write_file_atomically(file, std::string("no roadmap"));
  EXPECT_TRUE(ready_roadmap(map, other, file, observer).is_written);
  std::filesystem::remove(file);
  std::filesystem::create_directory(file);  // cannot be read, cannot be replaced
  const ReadyRoadmap unkept = ready_roadmap(map, other, file, observer);
  EXPECT_TRUE(unkept.is_built);
  EXPECT_FALSE(unkept.is_written);
  EXPECT_THAT(unkept.why_built, HasSubstr("could not be kept"));
}

TEST(RoadmapStore, RoutesAreTheSameWhetherItWasReadMadeOrKept) {
  const test::TemporaryFolder folder;
  const map::Map map = hills(3);
  SilentObserver observer;
  PlanningConfig config = config_with({"global.refine=false"});
  const geo::MapProjection projection(map.crs_wkt);
  const raster::GridGeometry& g = map.geometry;
  flight::PlanRequest request;
  request.start.position = projection.to_geodetic({g.west_m + 900.0, g.south_m + 1000.0});
  request.goal.position = projection.to_geodetic({g.west_m + 5000.0, g.south_m + 4800.0});
  const auto made = plan_route(map, request, config, {}, observer);
  ASSERT_TRUE(std::holds_alternative<flight::RoutePlan>(made));
  const auto& route = std::get<flight::RoutePlan>(made).route;
  ready_roadmap(map, config, folder.path() / "m.roadmap", observer);
  const ReadyRoadmap ready = ready_roadmap(map, config, folder.path() / "m.roadmap", observer);
  ASSERT_FALSE(ready.is_built);
  config.roadmap = {ready.roadmap, ready.key};
  EXPECT_EQ(
      std::get<flight::RoutePlan>(plan_route(map, request, config, {}, observer)).route.waypoints,
      route.waypoints);
  RoadmapKeeper keeper;
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(std::get<flight::RoutePlan>(
                  keeper(map, request, config_with({"global.refine=false"}), {}, observer))
                  .route.waypoints,
              route.waypoints);
  }
  // One of other settings is not used.
  PlanningConfig higher = config_with({"global.refine=false", "global.envelope_floor_m=30"});
  const auto expected = plan_route(map, request, higher, {}, observer);
  higher.roadmap = {ready.roadmap, ready.key};
  const auto again = plan_route(map, request, higher, {}, observer);
  ASSERT_EQ(expected.index(), again.index());
  if (const auto* plan = std::get_if<flight::RoutePlan>(&expected)) {
    EXPECT_EQ(std::get<flight::RoutePlan>(again).route.waypoints, plan->route.waypoints);
  }
}

}  // namespace
}  // namespace hedgehop::planning
