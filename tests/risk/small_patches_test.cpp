#include "risk/small_patches.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <gtest/gtest.h>
#include <random>
#include <set>
#include <vector>

#include "support/fresh_seed.hpp"

namespace hedgehop::risk {
namespace {

using Layer = raster::Grid<float>;

constexpr int kSide = 41;

Layer bright() { return Layer({0.0, 0.0, 30.0, kSide, kSide}, 0.8F); }

Layer random_layer() {
  std::mt19937_64 random(test::fresh_seed());
  Layer layer = bright();
  for (float& value : layer.values()) {
    value = static_cast<float>(std::uniform_int_distribution<int>(0, 6)(random)) / 6.0F;
  }
  return layer;
}

template <typename To>
Layer moved(const Layer& layer, const To& to) {
  Layer result = layer;
  for (int row = 0; row < kSide; ++row) {
    for (int column = 0; column < kSide; ++column) {
      const auto [c, r] = to(column, row);
      result.at(c, r) = layer.at(column, row);
    }
  }
  return result;
}

TEST(SmallPatches, ASingleDarkCellIsGoneAndNothingElseChanges) {
  Layer layer = bright();
  layer.at(20, 20) = 0.05F;
  layer.at(0, 0) = 0.05F;    // also in a corner
  layer.at(40, 17) = 0.05F;  // and on the border
  EXPECT_EQ(without_small_patches(layer, 90.0).values(), bright().values());
}

TEST(SmallPatches, PairsAndCornersAreGoneWhereNoStraightRowOfThreeLies) {
  Layer layer = bright();
  layer.at(10, 10) = layer.at(11, 10) = 0.1F;
  layer.at(20, 20) = layer.at(21, 20) = layer.at(20, 21) = 0.1F;
  layer.at(30, 30) = layer.at(31, 31) = 0.1F;
  EXPECT_EQ(without_small_patches(layer, 90.0).values(), bright().values());
}

TEST(SmallPatches, ADarkValleyOneCellWideStaysInEveryDirection) {
  const std::pair<int, int> steps[] = {{1, 0}, {0, 1},  {1, 1}, {1, -1},
                                       {2, 1}, {2, -1}, {1, 2}, {1, -2}};
  for (const auto& [dx, dy] : steps) {
    for (const double patch_m : {90.0, 120.0, 210.0}) {
      // GIVEN the cells that a straight line from edge to edge of a window crosses
      Layer layer = bright();
      const bool is_flat = std::abs(dx) >= std::abs(dy);
      for (int i = 0; i < 20; ++i) {
        const double minor = 0.5 * i * (is_flat ? 2.0 * dy / dx : 2.0 * dx / dy);
        const int k = static_cast<int>(std::floor(minor));
        layer.at(is_flat ? 10 + i : 20 + k, is_flat ? 20 + k : 10 + i) = 0.1F;
      }
      // THEN each of them stays dark
      EXPECT_EQ(without_small_patches(layer, patch_m).values(), layer.values())
          << dx << " " << dy << " " << patch_m;
    }
  }
}

TEST(SmallPatches, ARowStaysExactlyWhenItIsAsLongAsStated) {
  for (int length = 1; length <= 9; ++length) {
    Layer layer = bright();
    for (int i = 0; i < length; ++i) {
      layer.at(10 + i, 20) = 0.1F;
    }
    // 150 m are five cells of 30 m.
    EXPECT_EQ(without_small_patches(layer, 150.0).at(10, 20), length >= 5 ? 0.1F : 0.8F) << length;
  }
}

TEST(SmallPatches, ALureBecomesAsVisibleAsTheLeastOfItsSurroundingsThatCanBeFlown) {
  // A broad valley of 0.3 with one cell of 0.0 in it: the cell becomes valley, not hill.
  Layer layer = bright();
  for (int row = 15; row < 26; ++row) {
    for (int column = 0; column < kSide; ++column) {
      layer.at(column, row) = 0.3F;
    }
  }
  Layer expected = layer;
  layer.at(20, 20) = 0.0F;
  EXPECT_EQ(without_small_patches(layer, 90.0).values(), expected.values());
}

TEST(SmallPatches, TurningAndMirroringTheMapTurnsAndMirrorsTheResult) {
  const Layer layer = random_layer();
  const Layer seen = without_small_patches(layer, 150.0);
  const auto turn = [](int c, int r) { return std::pair(kSide - 1 - r, c); };
  const auto mirror = [](int c, int r) { return std::pair(kSide - 1 - c, r); };
  EXPECT_EQ(without_small_patches(moved(layer, turn), 150.0).values(), moved(seen, turn).values());
  EXPECT_EQ(without_small_patches(moved(layer, mirror), 150.0).values(),
            moved(seen, mirror).values());
}

TEST(SmallPatches, ValuesOnlyGrowAndNoNewOnesAppear) {
  const Layer layer = random_layer();
  const Layer seen = without_small_patches(layer, 90.0);
  const std::set<float> values(layer.values().begin(), layer.values().end());
  int changed = 0;
  for (std::size_t i = 0; i < layer.values().size(); ++i) {
    EXPECT_GE(seen.values()[i], layer.values()[i]);
    EXPECT_TRUE(values.contains(seen.values()[i]));
    changed += seen.values()[i] != layer.values()[i] ? 1 : 0;
  }
  EXPECT_GT(changed, 100);
}

TEST(SmallPatches, EqualsTheDefinitionByBruteForce) {
  // Through thresholds: the cells <= v after are the union of the rows inside the cells <= v
  // before.
  const Layer layer = random_layer();
  const Layer seen = without_small_patches(layer, 90.0);
  using Row = std::array<std::pair<int, int>, 3>;
  std::vector<Row> rows;
  for (const int s : {-1, 0, 1}) {
    rows.push_back({{{0, 0}, {1, s}, {2, 2 * s}}});
    rows.push_back({{{0, 0}, {1, 0}, {2, s}}});
    rows.push_back({{{0, 0}, {1, s}, {2, s}}});
  }
  for (std::size_t i = 0, count = rows.size(); i < count; ++i) {
    Row turned = rows[i];
    for (auto& [dx, dy] : turned) {
      std::swap(dx, dy);
    }
    rows.push_back(turned);
  }
  for (int level = 0; level <= 6; ++level) {
    const float v = static_cast<float>(level) / 6.0F;
    Layer expected({0.0, 0.0, 30.0, kSide, kSide}, 0.0F);
    for (int row = 0; row < kSide; ++row) {
      for (int column = 0; column < kSide; ++column) {
        for (const Row& cells : rows) {
          const bool fits = std::all_of(cells.begin(), cells.end(), [&](const auto& step) {
            const int c = column + step.first;
            const int r = row + step.second;
            return c >= 0 && r >= 0 && c < kSide && r < kSide && layer.at(c, r) <= v;
          });
          if (fits) {
            for (const auto& [dx, dy] : cells) {
              expected.at(column + dx, row + dy) = 1.0F;
            }
          }
        }
      }
    }
    for (std::size_t i = 0; i < seen.values().size(); ++i) {
      ASSERT_EQ(seen.values()[i] <= v, expected.values()[i] == 1.0F) << i << " " << level;
    }
  }
}

TEST(SmallPatches, ASecondTimeNothingMoreIsRemoved) {
  const Layer seen = without_small_patches(random_layer(), 150.0);
  EXPECT_EQ(without_small_patches(seen, 150.0).values(), seen.values());
}

TEST(SmallPatches, LessThanTwoCellsRemoveNothing) {
  const Layer layer = random_layer();
  EXPECT_EQ(without_small_patches(layer, 0.0).values(), layer.values());
  EXPECT_EQ(without_small_patches(layer, 59.0).values(), layer.values());
}

}  // namespace
}  // namespace hedgehop::risk
