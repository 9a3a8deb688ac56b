#include "planning/map_for_plan.hpp"

#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/errors.hpp"
#include "map/map_bundle.hpp"
#include "planning/request_areas.hpp"
#include "planning/roadmap_store.hpp"
#include "support/temporary_folder.hpp"
#include "support/test_map.hpp"
#include "support/utm_map.hpp"

namespace hedgehop::planning {
namespace {

class MapForPlan : public testing::Test {
 protected:
  MapForPlan() {
    map_ = test::make_map(100, 80, 30.0, [](double, double) { return 300.0; });
    test::place_in_utm(map_);
    test::finish_map(map_);
    map::write_map_bundle(map_, "{}", folder_.path());
  }
  void add_layer(float lowest_m) {
    raster::Grid<float> layer(map_.geometry, std::nanf(""));
    layer.at(3, 4) = lowest_m;
    map::write_height_bands(map_, {{"tower", &layer}}, folder_.path() / map::kThreatsFile);
  }
  static PlanningConfig config_of(const std::string& setting) {
    return read_planning_config(effective_planning_config("", {setting}), "test");
  }

  test::TemporaryFolder folder_;
  map::Map map_;
};

TEST_F(MapForPlan, HasTheLayersOfNamedObserversWhereTheyAreWeighedAndElseIsTheBundle) {
  add_layer(12.5F);
  const map::Map without = read_map_for(folder_.path(), config_of("weights.threats=0"));
  EXPECT_TRUE(without.threats.empty());
  EXPECT_EQ(without.hash, map_.hash);
  const map::Map with = read_map_for(folder_.path(), config_of("weights.threats=2"));
  ASSERT_EQ(with.threats.size(), 1U);
  EXPECT_EQ(with.threats[0].name, "tower");
  EXPECT_EQ(with.threats[0].height_m.at(3, 4), 12.5F);
  map::validate(with);
  EXPECT_NE(with.hash, map_.hash);
}

TEST_F(MapForPlan, IsAnotherOneWhenAnObserverSeesOtherThings) {
  const PlanningConfig config = config_of("weights.threats=2");
  add_layer(12.5F);
  const map::Map first = read_map_for(folder_.path(), config);
  add_layer(13.0F);
  const map::Map second = read_map_for(folder_.path(), config);
  EXPECT_NE(first.hash, second.hash);
  EXPECT_NE(roadmap_key(first, config), roadmap_key(second, config));
}

TEST_F(MapForPlan, IsNotMadeOfALayerThatHoldsWhatIsNoHeight) {
  add_layer(-1.0F);
  EXPECT_THROW((void)read_map_for(folder_.path(), config_of("weights.threats=2")), DataError);
  EXPECT_NO_THROW((void)read_map_for(folder_.path(), config_of("weights.threats=0")));
}

TEST_F(MapForPlan, AConfigSaysWhetherItWeighsNamedObservers) {
  EXPECT_TRUE(weighs_threats(config_of("weights.threats=0.5").text));
  EXPECT_FALSE(weighs_threats(config_of("weights.threats=0").text));
  EXPECT_FALSE(weighs_threats("]] no yaml"));
  EXPECT_FALSE(weighs_threats(""));
}

TEST_F(MapForPlan, WithoutSuchALayerAWeightOfItIsRefusedWithWhatToDo) {
  try {
    (void)read_map_for(folder_.path(), config_of("weights.threats=2"));
    FAIL() << "a weight without an observer";
  } catch (const UsageError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("weights.threats"));
    EXPECT_THAT(error.hint(), testing::HasSubstr("--observers"));
  }
  EXPECT_THROW(cost_model(map_, config_of("weights.threats=2")), UsageError);
}

TEST_F(MapForPlan, OfAPlanThatWeighedObserversIsTheBundleWithTheirLayers) {
  add_layer(12.5F);
  const PlanningConfig config = config_of("weights.threats=2");
  flight::Plan plan;
  plan.route_plan.config_text = config.text;
  plan.route_plan.map.hash = read_map_for(folder_.path(), config).hash;
  EXPECT_EQ(read_map_of_plan(folder_.path(), plan, "p").threats.size(), 1U);
  plan.route_plan.config_text = config_of("weights.threats=0").text;
  EXPECT_THROW((void)read_map_of_plan(folder_.path(), plan, "p"), UsageError);
  plan.route_plan.map.hash = map_.hash;
  EXPECT_TRUE(read_map_of_plan(folder_.path(), plan, "p").threats.empty());
  plan.route_plan.config_text = "]] no yaml";
  EXPECT_TRUE(read_map_of_plan(folder_.path(), plan, "p").threats.empty());
}

}  // namespace
}  // namespace hedgehop::planning
