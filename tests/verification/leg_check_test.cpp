#include "verification/leg_check.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <limits>

#include "support/test_map.hpp"

namespace hedgehop::verification {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

map::Map flat() {
  return test::make_map(200, 200, 30.0, [](double, double) { return 100.0; });
}

const LegViolation* find(const LegCheck& check, const std::string& rule) {
  for (const LegViolation& violation : check.violations) {
    if (violation.rule == rule) {
      return &violation;
    }
  }
  return nullptr;
}

const NearMiss* find(const LegCheck& check, Hazard hazard) {
  for (const NearMiss& miss : check.nearest) {
    if (miss.hazard == hazard) {
      return &miss;
    }
  }
  return nullptr;
}

TEST(LegCheck, MeasuresClearanceWhereALegIsLowest) {
  // Down from 160 m to 112 m and up again.
  const LegCheck check =
      check_legs(flat(), {{1000, 1000, 160}, {3000, 1000, 112}, {3000, 4000, 200}}, 10.0);
  EXPECT_TRUE(check.is_verified);
  EXPECT_NEAR(check.clearance_min_m, 12.0, 1e-9);
  EXPECT_DOUBLE_EQ(check.length_m, 5000.0);
  const NearMiss* ground = find(check, Hazard::kGround);
  ASSERT_NE(ground, nullptr);
  EXPECT_NEAR(ground->place.x_m, 3000.0, 1e-6);
  EXPECT_NEAR(ground->spare_m(), 2.0, 1e-9);
  const LegCheck low =
      check_legs(flat(), {{1000, 1000, 160}, {3000, 1000, 108}, {3000, 4000, 200}}, 10.0);
  EXPECT_FALSE(low.is_verified);
  ASSERT_EQ(low.violations.size(), 2U);  // the end of one leg and the beginning of the next
  EXPECT_EQ(low.violations[0].leg, 1U);
  EXPECT_NEAR(low.violations[0].value, 8.0, 1e-9);
}

TEST(LegCheck, FindsTheSpireBetweenTwoWaypoints) {
  map::Map map = flat();
  map.surface_m.at(66, 33) = 145.0F;  // its centre lies at (1995, 1005)
  const LegCheck check = check_legs(map, {{1000, 1005, 150}, {5000, 1005, 150}}, 10.0);
  const LegViolation* violation = find(check, "clearance");
  ASSERT_NE(violation, nullptr);
  EXPECT_NEAR(violation->value, 5.0, 1e-6);
  EXPECT_NEAR(violation->place.x_m, 1995.0, 1e-6);
}

TEST(LegCheck, FindsWiresAndMastsAtTheirPlaces) {
  map::Map map = flat();
  map::OverheadLine line;  // crosses the leg at x = 2000, conductor at 130 m
  line.source_id = 5;
  line.supports = {{{2000.0, 500.0}, 30.0}, {{2000.0, 1500.0}, 30.0}};
  map.overhead_lines = {line};
  map::Obstacle mast;
  mast.name = "mast";
  mast.point = {4000.0, 1040.0};
  mast.radius_m = 15.0;
  mast.top_m = 300.0;
  mast.height_m = 200.0;
  map.obstacles = {mast};
  const auto check = [&](double altitude_m, double required_m) {
    return check_legs(map, {{1000, 1000, altitude_m}, {5000, 1000, altitude_m}}, required_m);
  };
  const LegCheck high = check(150.0, 10.0);
  EXPECT_TRUE(high.is_verified);
  EXPECT_NEAR(find(high, Hazard::kWire)->distance_m, 20.0, 1e-6);
  EXPECT_NEAR(find(high, Hazard::kWire)->place.x_m, 2000.0, 1.0);
  EXPECT_EQ(find(high, Hazard::kWire)->name, "5");
  EXPECT_NEAR(find(high, Hazard::kObstacle)->distance_m, 25.0, 1e-5);
  EXPECT_NEAR(find(high, Hazard::kObstacle)->place.x_m, 4000.0, 1.0);
  const LegCheck low = check(120.0, 10.0);
  ASSERT_NE(find(low, "wire_clearance"), nullptr);
  EXPECT_EQ(find(low, "wire_clearance")->value, 0.0);
  EXPECT_NEAR(find(low, "wire_clearance")->place.x_m, 2000.0, 1.0);
  const LegCheck wide = check(150.0, 25.1);
  ASSERT_NE(find(wide, "obstacle_clearance"), nullptr);
  EXPECT_NEAR(find(wide, "obstacle_clearance")->value, 25.0, 1e-5);
  EXPECT_NE(find(wide, "wire_clearance"), nullptr);
}

TEST(LegCheck, ClimbsOverAnAreaThatALevelLegWouldEnter) {
  map::Map map = flat();
  map::Area area;
  area.name = "range";
  area.floor = {-kInfinity, map::AreaLimit::Reference::kAmsl};
  area.ceiling = {200.0, map::AreaLimit::Reference::kAmsl};
  area.polygons = {{{{4000, 900}, {4200, 900}, {4200, 1100}, {4000, 1100}, {4000, 900}}, {}}};
  map.areas = {area};
  // From 150 m to 250 m over 4 km: 225 m above its western edge, although the leg begins lower.
  const LegCheck over = check_legs(map, {{1000, 1000, 150}, {5000, 1000, 250}}, 10.0);
  EXPECT_TRUE(over.is_verified);
  EXPECT_NEAR(find(over, Hazard::kArea)->distance_m, 25.0, 0.1);
  const LegCheck through = check_legs(map, {{1000, 1000, 150}, {5000, 1000, 150}}, 10.0);
  ASSERT_NE(find(through, "no_fly_area"), nullptr);
  EXPECT_NEAR(find(through, "no_fly_area")->value, -100.0, 1.0);  // in its middle
  EXPECT_EQ(find(through, Hazard::kArea)->distance_m, 0.0);
  const LegCheck beside = check_legs(map, {{1000, 1130, 150}, {5000, 1130, 150}}, 10.0);
  EXPECT_TRUE(beside.is_verified);
  EXPECT_NEAR(find(beside, Hazard::kArea)->distance_m, 30.0, 1e-6);
}

TEST(LegCheck, RefusesWhatIsUnknown) {
  map::Map map = flat();
  map.surface_m.at(66, 33) = std::nanf("");
  EXPECT_NE(find(check_legs(map, {{1000, 1005, 150}, {5000, 1005, 150}}, 10.0), "unknown_surface"),
            nullptr);
  EXPECT_NE(find(check_legs(flat(), {{1000, 1005, 150}, {7000, 1005, 150}}, 10.0), "outside_map"),
            nullptr);
  EXPECT_NE(find(check_legs(flat(), {{1000, 1005, 150}}, 10.0), "states"), nullptr);
  EXPECT_NE(
      find(check_legs(flat(), {{1000, 1005, 150}, {2000, std::nan(""), 150}}, 10.0), "states"),
      nullptr);
}

}  // namespace
}  // namespace hedgehop::verification
