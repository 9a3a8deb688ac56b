#include "preparation/obstacles.hpp"

#include <cmath>
#include <gdal_priv.h>
#include <gtest/gtest.h>
#include <memory>
#include <ogr_geometry.h>
#include <random>
#include <set>

#include "base/angles.hpp"
#include "base/observer.hpp"
#include "base/shipped_config.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::preparation {
namespace {

using map_sources::ObjectClass;
using map_sources::StructureKind;

PrepareOptions shipped_options() {
  ConfigReader reader = ConfigReader::from_text(shipped_config("prepare.yaml"), "prepare.yaml");
  return PrepareOptions::read(reader);
}

std::unique_ptr<OGRPolygon> square_of(const raster::GridGeometry& g, int column, int row) {
  const double west_m = g.west_m + column * g.cell_m;
  const double south_m = g.south_m + row * g.cell_m;
  auto ring = std::make_unique<OGRLinearRing>();
  ring->addPoint(west_m, south_m);
  ring->addPoint(west_m + g.cell_m, south_m);
  ring->addPoint(west_m + g.cell_m, south_m + g.cell_m);
  ring->addPoint(west_m, south_m + g.cell_m);
  ring->closeRings();
  auto square = std::make_unique<OGRPolygon>();
  square->addRingDirectly(ring.release());
  return square;
}

// GEOS as an oracle: every cell of the grid whose distance to the geometry is at most `reach_m`.
std::set<std::pair<int, int>> cells_near(const raster::GridGeometry& g, const OGRGeometry& geometry,
                                         double reach_m) {
  std::set<std::pair<int, int>> cells;
  for (int row = 0; row < g.rows; ++row) {
    for (int column = 0; column < g.columns; ++column) {
      if (square_of(g, column, row)->Distance(&geometry) <= reach_m) {
        cells.emplace(column, row);
      }
    }
  }
  return cells;
}

constexpr raster::GridGeometry kGrid{499995.0, 5499990.0, 30.0, 24, 17};

const raster::Grid<std::uint8_t> kAllTerrain(kGrid, 0);

TEST(ForEachTouchedCell, VisitsExactlyTheCellsThatGeosFindsWithinTheRadius) {
  std::mt19937_64 random(test::fresh_seed());
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (int round = 0; round < 200; ++round) {
    // Places around the grid too, radii from far below a cell to several cells.
    const geo::MapPoint centre{uniform(kGrid.west_m - 100.0, kGrid.east_m() + 100.0),
                               uniform(kGrid.south_m - 100.0, kGrid.north_m() + 100.0)};
    const double radius_m = round % 3 == 0 ? uniform(0.0, 2.0) : uniform(0.0, 150.0);
    std::set<std::pair<int, int>> visited;
    for_each_touched_cell(kGrid, centre, radius_m, [&](raster::CellIndex cell) {
      EXPECT_TRUE(visited.emplace(cell.column, cell.row).second);
    });
    const OGRPoint point(centre.x_m, centre.y_m);
    EXPECT_EQ(visited, cells_near(kGrid, point, radius_m))
        << centre.x_m << " " << centre.y_m << " " << radius_m;
  }
}

TEST(ForEachTouchedCell, APointOfNoWidthStillTouchesItsCell) {
  int count = 0;
  for_each_touched_cell(kGrid, {kGrid.west_m + 44.0, kGrid.south_m + 31.0}, 0.0,
                        [&](raster::CellIndex cell) {
                          EXPECT_EQ(cell, (raster::CellIndex{1, 1}));
                          ++count;
                        });
  EXPECT_EQ(count, 1);
}

TEST(SurfaceModel, EveryCellThatASpanOrAMastTouchesIsRaisedAndNoOther) {
  std::mt19937_64 random(test::fresh_seed());
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  const geo::MapProjection projection("EPSG:32632");
  const raster::Grid<float> terrain_m(kGrid, 300.0F);
  PrepareOptions options = shipped_options();
  SilentObserver observer;
  for (int round = 0; round < 20; ++round) {
    // GIVEN a line of two spans and a mast, anywhere, of different heights
    map_sources::LandUse land_use;
    map_sources::PowerLineObject line;
    OGRLineString spans;
    for (int i = 0; i < 3; ++i) {
      const geo::MapPoint point{uniform(kGrid.west_m - 50.0, kGrid.east_m() + 50.0),
                                uniform(kGrid.south_m - 50.0, kGrid.north_m() + 50.0)};
      line.supports.push_back({point, 20.0, true});
      spans.addPoint(point.x_m, point.y_m);
    }
    land_use.power_lines.push_back(line);
    map_sources::LineObject mast;
    mast.object_class = ObjectClass::kStructure;
    mast.structure_kind = StructureKind::kMast;
    mast.height_m = 70.0;
    mast.vertices = {
        {uniform(kGrid.west_m, kGrid.east_m()), uniform(kGrid.south_m, kGrid.north_m())}};
    land_use.lines.push_back(mast);
    // WHEN the surface is made
    const SurfaceModel model =
        surface_model(terrain_m, kAllTerrain, land_use, {}, projection, options, observer);
    // THEN exactly the cells that GEOS finds stand out, each as high as the highest there
    const OGRPoint place(mast.vertices[0].x_m, mast.vertices[0].y_m);
    const auto of_mast = cells_near(kGrid, place, options.obstacles.safety_radius_m);
    const auto of_line = cells_near(kGrid, spans, 0.0);
    for (int row = 0; row < kGrid.rows; ++row) {
      for (int column = 0; column < kGrid.columns; ++column) {
        const std::pair<int, int> cell(column, row);
        const float expected_m = of_mast.contains(cell)   ? 370.0F
                                 : of_line.contains(cell) ? 320.0F
                                                          : 300.0F;
        ASSERT_EQ(model.surface_m.at(column, row), expected_m) << column << " " << row;
        ASSERT_EQ(model.opaque_m.at(column, row), 300.0F);
      }
    }
    ASSERT_EQ(model.obstacles.size(), 1U);
    EXPECT_EQ(model.obstacles[0].top_m, 370.0);
  }
}

TEST(SurfaceModel, PolesAndSpansHaveTheirOwnBits) {
  GDALAllRegister();
  const geo::MapProjection projection("EPSG:32632");
  const raster::Grid<float> terrain_m(kGrid, 300.0F);
  const geo::MapPoint a = kGrid.centre({2, 5});
  const geo::MapPoint b = kGrid.centre({10, 5});
  const geo::MapPoint c = kGrid.centre({18, 5});
  map_sources::LandUse land_use;
  land_use.power_lines.push_back({1, false, {{a, 20.0, true}, {b, 20.0, false}, {c, 20.0, true}}});
  land_use.mapped.push_back({0.0, 0.0, 1.0, 1.5});
  SilentObserver observer;
  const SurfaceModel model =
      surface_model(terrain_m, kAllTerrain, land_use, {}, projection, shipped_options(), observer);
  const auto has = [&](int column, map::SemanticClass bit) {
    return (model.semantics.at(column, 5) & static_cast<std::uint16_t>(bit)) != 0;
  };
  for (int column = 0; column < kGrid.columns; ++column) {
    EXPECT_EQ(has(column, map::SemanticClass::kPowerLine), column >= 2 && column <= 18) << column;
    EXPECT_EQ(has(column, map::SemanticClass::kPowerPole), column == 2 || column == 18) << column;
  }
}

TEST(ObstaclesOf, ErrorsWidenAndHeightenAndTheHigherStatementCounts) {
  const raster::Grid<float> terrain_m(kGrid, 300.0F);
  PrepareOptions options = shipped_options();
  options.obstacles = {10.0, 70.0, 150.0, 40.0};
  map_sources::ObstacleList listed;
  map_sources::ObstacleObject object;
  object.point = {kGrid.west_m + 200.0, kGrid.south_m + 200.0};
  object.record.height_m = 50.0;
  object.record.radius_m = 5.0;
  object.record.horizontal_error_m = 30.0;
  object.record.vertical_error_m = 6.0;
  listed.obstacles.push_back(object);  // terrain + 50 + 6
  object.record.top_m = 380.0;
  listed.obstacles.push_back(object);  // the stated top is higher
  object.record.top_m = 320.0;
  listed.obstacles.push_back(object);  // and here it is lower
  object.record.height_m.reset();
  object.record.horizontal_error_m.reset();
  object.record.vertical_error_m.reset();
  listed.obstacles.push_back(object);  // top alone, unknown accuracy
  object.point.x_m = kGrid.west_m - 60.0;
  listed.obstacles.push_back(object);  // beside the raster: the terrain there is unknown
  HeightCounts counts;
  const auto obstacles = obstacles_of({}, listed, terrain_m, options, counts);
  ASSERT_EQ(obstacles.size(), 5U);
  EXPECT_EQ(obstacles[0].radius_m, 45.0);
  EXPECT_EQ(obstacles[0].height_m, 56.0);
  EXPECT_EQ(obstacles[0].top_m, 356.0);
  EXPECT_EQ(obstacles[1].top_m, 386.0);
  EXPECT_EQ(obstacles[2].top_m, 356.0);
  EXPECT_EQ(obstacles[3].radius_m, 165.0);
  EXPECT_EQ(obstacles[3].top_m, 360.0);
  EXPECT_EQ(obstacles[3].height_m, 60.0);
  EXPECT_EQ(obstacles[4].top_m, 360.0);
  EXPECT_EQ(obstacles[4].height_m, 60.0);  // above the lowest ground known
  EXPECT_EQ(counts.tagged, 5);
}

TEST(ObstaclesOf, OnASlopeNoCellOfTheDiscIsLowerThanTheTopOrThanTheHeightAboveItsGround) {
  raster::Grid<float> terrain_m(kGrid, 0.0F);
  for (int row = 0; row < kGrid.rows; ++row) {
    for (int column = 0; column < kGrid.columns; ++column) {
      terrain_m.at(column, row) = static_cast<float>(300 + 10 * column);
    }
  }
  map::Obstacle mast;
  mast.point = kGrid.centre({10, 8});
  mast.radius_m = 70.0;
  mast.height_m = 40.0;
  mast.top_m = 440.0;
  raster::Grid<float> surface_m = terrain_m;
  raster::Grid<std::uint16_t> semantics(kGrid, 0);
  raise_obstacles({mast}, terrain_m, surface_m, semantics);
  EXPECT_EQ(surface_m.at(8, 8), 440.0F);   // downhill: the top
  EXPECT_EQ(surface_m.at(12, 8), 460.0F);  // uphill: 420 + 40
  EXPECT_EQ(surface_m.at(7, 8), 370.0F);   // 75 m away: untouched
  EXPECT_EQ(semantics.at(8, 8), static_cast<std::uint16_t>(map::SemanticClass::kObstacle));
  EXPECT_EQ(semantics.at(7, 8), 0);
}

TEST(ObstaclesOf, RotorsOutlinesAndDefaultsOfTheLandUse) {
  const raster::Grid<float> terrain_m(kGrid, 300.0F);
  const PrepareOptions options = shipped_options();
  map_sources::LandUse land_use;
  map_sources::LineObject turbine;
  turbine.object_class = ObjectClass::kStructure;
  turbine.structure_kind = StructureKind::kWindTurbine;
  turbine.vertices = {kGrid.centre({5, 5})};
  land_use.lines.push_back(turbine);
  turbine.radius_m = 40.0;
  land_use.lines.push_back(turbine);
  const auto square = [](double x_m, double y_m, double side_m) {
    return map_sources::MapPolygon{{{x_m, y_m},
                                    {x_m + side_m, y_m},
                                    {x_m + side_m, y_m + side_m},
                                    {x_m, y_m + side_m},
                                    {x_m, y_m}},
                                   {}};
  };
  map_sources::AreaObject chimney;
  chimney.object_class = ObjectClass::kStructure;
  chimney.structure_kind = StructureKind::kChimney;
  chimney.polygons = {square(kGrid.west_m + 300.0, kGrid.south_m + 300.0, 6.0)};
  land_use.areas.push_back(chimney);
  map_sources::AreaObject yard = chimney;
  yard.polygons = {square(kGrid.west_m, kGrid.south_m, 300.0)};
  land_use.areas.push_back(yard);
  HeightCounts counts;
  const auto obstacles = obstacles_of(land_use, {}, terrain_m, options, counts);
  const double safety_m = options.obstacles.safety_radius_m;
  ASSERT_EQ(obstacles.size(), 3U);
  EXPECT_FALSE(is_obstacle(yard));
  EXPECT_EQ(obstacles[0].kind, map::ObstacleKind::kChimney);
  EXPECT_NEAR(obstacles[0].radius_m, 3.0 * std::sqrt(2.0) + safety_m, 1e-9);
  EXPECT_EQ(obstacles[0].point.x_m, kGrid.west_m + 303.0);
  EXPECT_EQ(obstacles[0].height_m, options.default_heights.chimney_m);
  EXPECT_EQ(obstacles[1].radius_m, options.obstacles.wind_turbine_radius_m + safety_m);
  EXPECT_EQ(obstacles[2].radius_m, 40.0 + safety_m);
  EXPECT_EQ(counts.guessed, 3);
}

}  // namespace
}  // namespace hedgehop::preparation
