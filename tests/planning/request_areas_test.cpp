#include "planning/request_areas.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <limits>

#include "base/errors.hpp"
#include "support/test_map.hpp"
#include "support/utm_map.hpp"

namespace hedgehop::planning {
namespace {

map::Map flat_map() {
  map::Map map = test::make_map(100, 80, 30.0, [](double, double) { return 300.0; });
  test::place_in_utm(map);
  test::finish_map(map);
  return map;
}

map::Area triangle() {
  const auto at = [](double east_m, double north_m) {
    return geo::MapPoint{test::kUtmWest_m + east_m, test::kUtmSouth_m + north_m};
  };
  map::Area area;
  area.name = "fair";
  area.kind = "no_fly";
  area.floor = {-std::numeric_limits<double>::infinity(), map::AreaLimit::Reference::kAboveGround};
  area.ceiling = {650.0, map::AreaLimit::Reference::kAmsl};
  area.polygons = {
      {{at(300.0, 300.0), at(900.5, 300.0), at(600.0, 1200.25), at(300.0, 300.0)}, {}}};
  return area;
}

TEST(RequestAreas, BecomePartOfTheMapAndOfItsHash) {
  const map::Map plain = flat_map();
  map::Map expected = flat_map();
  expected.areas = {triangle()};
  expected.hash = map::map_hash(expected);
  const geo::MapProjection projection(plain.crs_wkt);
  const auto areas = request_areas_of(expected.areas, projection);
  ASSERT_EQ(areas.size(), 1U);
  // The corners lie on whole millimetres, so they come back exactly.
  const map::Map with = map_with_areas(plain, areas);
  EXPECT_EQ(with.hash, expected.hash);
  EXPECT_NE(with.hash, plain.hash);
  map::validate(with);
  EXPECT_EQ(map_with_areas(plain, {}).hash, plain.hash);

  flight::Plan plan;
  plan.route_plan.request.areas = areas;
  plan.route_plan.map.hash = expected.hash;
  EXPECT_EQ(map_of_plan(plain, plan, "p", "m").hash, expected.hash);
  plan.route_plan.request.areas[0].is_hard = false;  // not what it was planned with
  EXPECT_THROW((void)map_of_plan(plain, plan, "p", "m"), UsageError);
  EXPECT_THROW((void)map_of_plan(expected, plan, "p", "m"), UsageError);
}

TEST(RequestAreas, CornerOffTheEarthIsRefused) {
  const map::Map plain = flat_map();
  auto areas = request_areas_of({triangle()}, geo::MapProjection(plain.crs_wkt));
  areas[0].polygons[0].outer[1].latitude_rad = std::nan("");
  EXPECT_THROW((void)map_with_areas(plain, areas), DataError);
}

}  // namespace
}  // namespace hedgehop::planning
