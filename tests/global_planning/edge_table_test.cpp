#include "global_planning/edge_table.hpp"

#include <gtest/gtest.h>
#include <random>
#include <unordered_map>

#include "support/fresh_seed.hpp"

namespace hedgehop::global_planning {
namespace {

TEST(EdgeTable, HoldsWhatAMapOfTheStandardLibraryHolds) {
  std::mt19937_64 random(test::fresh_seed());
  EdgeTable table(2);  // grows many times, and is asked in the middle of that
  std::unordered_map<std::uint64_t, std::pair<double, bool>> wanted;
  for (int step = 0; step < 60000; ++step) {
    // Numbers as edges have them: two small ones side by side, seldom the same again.
    const std::uint64_t edge = (random() % 400 << 32U) | (1 + random() % 400);
    EdgeTable::Entry* entry = table.find(edge);
    const auto found = wanted.find(edge);
    ASSERT_EQ(entry != nullptr, found != wanted.end());
    if (entry == nullptr) {
      const double cost_m = static_cast<double>(random() % 1000);
      wanted[edge] = {cost_m, false};
      EXPECT_EQ(table.insert(edge, cost_m)->edge, edge);
    } else {
      EXPECT_EQ(entry->cost_m, found->second.first);
      EXPECT_EQ(entry->is_fine_checked, found->second.second);
      entry->is_fine_checked = found->second.second = true;
      entry->cost_m = found->second.first += 1.0;
    }
  }
  EXPECT_EQ(table.size(), wanted.size());
  for (const auto& [edge, value] : wanted) {
    const EdgeTable::Entry* entry = table.find(edge);
    ASSERT_NE(entry, nullptr);
    EXPECT_EQ(entry->cost_m, value.first);
    EXPECT_EQ(entry->is_fine_checked, value.second);
  }
}

}  // namespace
}  // namespace hedgehop::global_planning
