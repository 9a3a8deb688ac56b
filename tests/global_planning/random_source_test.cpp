#include "global_planning/random_source.hpp"

#include <gtest/gtest.h>

namespace hedgehop::global_planning {
namespace {

TEST(RandomSource, SeedZeroGivesThePublishedFirstNumber) {
  // xoshiro256** after four outputs of splitmix64 from 0, as other libraries document it.
  EXPECT_EQ(RandomSource(0).next(), 11091344671253066420U);
}

TEST(RandomSource, UnitNumbersFillZeroToOneEvenly) {
  RandomSource random(7);
  int counts[10] = {};
  for (int k = 0; k < 100000; ++k) {
    const double unit = random.unit();
    ASSERT_GE(unit, 0.0);
    ASSERT_LT(unit, 1.0);
    ++counts[static_cast<int>(unit * 10.0)];
  }
  for (const int count : counts) {
    EXPECT_NEAR(count, 10000, 500);  // five standard deviations of the binomial, 95 each
  }
}

TEST(RandomSource, DifferentSeedsAreUnrelated) {
  RandomSource a(1);
  RandomSource b(2);
  int equal = 0;
  for (int k = 0; k < 1000; ++k) {
    equal += a.next() == b.next() ? 1 : 0;
  }
  EXPECT_EQ(equal, 0);
}

}  // namespace
}  // namespace hedgehop::global_planning
