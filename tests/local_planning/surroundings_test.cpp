#include "local_planning/surroundings.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <random>

#include "local_planning_setup.hpp"
#include "support/fresh_seed.hpp"
#include "support/test_map.hpp"

namespace hedgehop::local_planning {
namespace {

map::Area area_over(double west_m, double south_m, double side_m, bool is_hard, double floor_m,
                    double ceiling_m, map::AreaLimit::Reference reference) {
  map::Area area;
  area.is_hard = is_hard;
  area.floor = {floor_m, reference};
  area.ceiling = {ceiling_m, reference};
  area.polygons = {{{{west_m, south_m},
                     {west_m + side_m, south_m},
                     {west_m + side_m, south_m + side_m},
                     {west_m, south_m + side_m},
                     {west_m, south_m}},
                    {}}};
  return area;
}

// Hills of 100 m with voids, half of them under areas whose floors lie among their heights.
map::Map hills_under_areas(double cell_m, std::mt19937_64& random) {
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  map::Map map = test::make_map(60, 50, cell_m, [&](double, double) {
    return unit(random) < 0.03 ? std::nan("") : 300.0 + 100.0 * unit(random);
  });
  for (std::size_t i = 0; i < map.visibility.values().size(); ++i) {
    map.visibility.values()[i] = test::stored_visibility(unit(random));
    map.semantics.values()[i] =
        unit(random) < 0.2 ? static_cast<std::uint16_t>(map::SemanticClass::kSettlement) : 0;
  }
  const double side_m = 15.0 * cell_m;
  using Reference = map::AreaLimit::Reference;
  map.areas = {
      area_over(0.0, 0.0, side_m, true, 450.0, 500.0, Reference::kAmsl),
      area_over(1.5 * side_m, 0.0, side_m, true, 450.0, 900.0, Reference::kAmsl),
      area_over(0.0, 1.5 * side_m, side_m, false, 380.0, 420.0, Reference::kAmsl),
      area_over(1.5 * side_m, 1.5 * side_m, side_m, false, 90.0, 150.0, Reference::kAboveGround)};
  test::finish_map(map);
  return map;
}

void expect_same(const Surroundings& changed, const Surroundings& anew) {
  EXPECT_EQ(changed.geometry(), anew.geometry());
  EXPECT_EQ(changed.surface_m().values(), anew.surface_m().values());
  EXPECT_EQ(changed.risk().values(), anew.risk().values());
  EXPECT_EQ(changed.dilated_layer_m().values(), anew.dilated_layer_m().values());
  EXPECT_EQ(changed.packed().values(), anew.packed().values());
  EXPECT_EQ(changed.risk_max(), anew.risk_max());
}

TEST(Surroundings, TakeInAChangedSurfaceBitByBitAsIfMadeAnew) {
  std::mt19937_64 random(test::fresh_seed());
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  for (const double cell_m : {30.0, 10.0}) {
    // A soft area that costs more than anything else makes another greatest risk as it comes and
    // goes.
    for (const double soft_area : {0.4, 3.0}) {
      for (const double tube_radius_m : {-1.0, 0.6 * cell_m, 46.8}) {
        map::Map map = hills_under_areas(cell_m, random);
        const risk::SemanticCostTable semantics(
            {{static_cast<std::uint16_t>(map::SemanticClass::kSettlement), 1.0}}, 0.0, soft_area);
        const auto made = [&](const risk::CostModel& costs) {
          Surroundings surroundings(costs, 200.0, 24.0 + 0.71 * cell_m, 0.4, 0.8);
          if (tube_radius_m > 0.0) {
            surroundings.pack(tube_radius_m);
          }
          return surroundings;
        };
        risk::CostModel costs(map, {25.0, 0.02, 4.0, 0.01}, semantics, 1.0);
        Surroundings surroundings = made(costs);
        const map::Map before = map;
        std::vector<raster::CellIndex> all;
        for (int round = 0; round < 4; ++round) {
          std::vector<raster::CellIndex> cells;
          for (int i = 0; i < 40; ++i) {
            const raster::CellIndex cell{static_cast<int>(60.0 * unit(random)),
                                         static_cast<int>(50.0 * unit(random))};
            const double what = unit(random);
            map.surface_m.at(cell) = what < 0.1 ? std::numeric_limits<float>::quiet_NaN()
                                     : what < 0.4
                                         ? before.surface_m.at(cell)
                                         : static_cast<float>(300.0 + 250.0 * unit(random));
            cells.push_back(cell);
            all.push_back(cell);
          }
          costs.surface_changed(cells);
          surroundings.surface_changed(costs, cells);
          const risk::CostModel costs_anew(map, {25.0, 0.02, 4.0, 0.01}, semantics, 1.0);
          EXPECT_EQ(costs.semantics_layer().values(), costs_anew.semantics_layer().values());
          expect_same(surroundings, made(costs_anew));
        }
        // And back again.
        map.surface_m = before.surface_m;
        costs.surface_changed(all);
        surroundings.surface_changed(costs, all);
        expect_same(surroundings,
                    made(risk::CostModel(before, {25.0, 0.02, 4.0, 0.01}, semantics, 1.0)));
        if (HasFailure()) {
          return;
        }
      }
    }
  }
}

}  // namespace
}  // namespace hedgehop::local_planning
