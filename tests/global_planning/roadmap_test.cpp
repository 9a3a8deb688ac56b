#include "global_planning/roadmap.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <gtest/gtest.h>
#include <limits>
#include <random>

#include "global_planning/lattice_route.hpp"
#include "global_planning/planning_case.hpp"
#include "global_planning/route_finish.hpp"
#include "support/fractal_terrain.hpp"
#include "support/fresh_seed.hpp"

namespace hedgehop::global_planning {
namespace {

using test::PlanningCase;

using test::kWeights;
constexpr std::int64_t kWork = 1000000;
const auto kNeverStop = [] { return false; };
constexpr Hash128 kKey{7, 8};

Roadmap roadmap_of(const PlanningCase& in, const GlobalOptions& options) {
  SilentObserver observer;
  return {in.costs, options, observer};
}

std::vector<flight::Waypoint> route_by(const FlightEnvelope& envelope, const Roadmap& roadmap) {
  std::int64_t work_units = 0;
  return roadmap_route(envelope, roadmap, kWork, work_units, kNeverStop);
}

TEST(Roadmap, OverAFlatPlainAnEdgeCostsItsLengthAtTheFloorAndAllowsTheWholeBand) {
  const PlanningCase in(test::make_map(120, 120, 30.0, [](double, double) { return 100.0; }),
                        kWeights);
  const GlobalOptions options = test::shipped_global_options();
  const Roadmap roadmap = roadmap_of(in, options);
  // Both corners of an edge turn by atan(1 / 2): 2 R tan(atan(1 / 2) / 2) = 2 R (sqrt(5) - 2).
  EXPECT_NEAR(roadmap.spacing_m(), 2.0 * options.turn_radius_m * (std::sqrt(5.0) - 2.0), 0.5);
  const int column = roadmap.columns() / 2;
  const int row = roadmap.rows() / 2;
  const double above_reference_m = options.envelope_floor_m + 2.0 - 15.24;  // with the margin
  for (int d = 0; d < kLatticeDirections; ++d) {
    const auto& step = kLatticeStep[static_cast<std::size_t>(d)];
    const Roadmap::Edge& edge = roadmap.edge(column, row, d);
    const double length_m = roadmap.spacing_m() * std::hypot(step[0], step[1]);
    EXPECT_NEAR(edge.low_cost_m, length_m * (1.0 + 0.01 * above_reference_m), 0.1) << d;
    EXPECT_NEAR(edge.from_low_m, 122.0, 0.01) << d;
    EXPECT_NEAR(edge.from_high_m, 248.0, 0.01) << d;
    EXPECT_NEAR(edge.to_low_m, 122.0, 0.01) << d;
    EXPECT_NEAR(edge.to_high_m, 248.0, 0.01) << d;
    EXPECT_GT(edge.raised_cost_m, edge.low_cost_m) << d;
  }
}

TEST(Roadmap, AnEdgeAllowsTheSameFlightsBothWays) {
  const auto seed = test::fresh_seed();
  const PlanningCase in(test::make_fractal_map(seed, 160, 30.0, 2000.0, 300.0), kWeights);
  const Roadmap roadmap = roadmap_of(in, test::shipped_global_options());
  int flown = 0;
  for (int row = 2; row + 2 < roadmap.rows(); ++row) {
    for (int column = 2; column + 2 < roadmap.columns(); ++column) {
      for (int d = 0; d < kLatticeDirections; ++d) {
        const auto& step = kLatticeStep[static_cast<std::size_t>(d)];
        const Roadmap::Edge& there = roadmap.edge(column, row, d);
        const Roadmap::Edge& back =
            roadmap.edge(column + step[0], row + step[1], (d + 8) % kLatticeDirections);
        ASSERT_EQ(there.from_low_m <= there.from_high_m, back.from_low_m <= back.from_high_m);
        if (there.from_low_m <= there.from_high_m) {
          ++flown;
          EXPECT_EQ(there.from_low_m, back.to_low_m);
          EXPECT_EQ(there.to_high_m, back.from_high_m);
        }
      }
    }
  }
  EXPECT_GT(flown, 100);
}

TEST(Roadmap, ItsRoutesPassTheChecksOfEveryOtherRouteAndCostAboutTheSame) {
  std::vector<double> ratios;
  int problems = 0;
  for (int i = 0; i < 3; ++i) {
    const auto seed = test::fresh_seed();
    const PlanningCase in(test::make_fractal_map(seed, 200, 30.0, 3000.0, 120.0), kWeights);
    const GlobalOptions options = test::shipped_global_options();
    const Roadmap roadmap = roadmap_of(in, options);
    const FlightEnvelope envelope(in.costs, options, in.above(900, 1000), in.above(5000, 4900));
    std::int64_t work_units = 0;
    const auto by_lattice = lattice_route(envelope, options, kWork, work_units, kNeverStop);
    const auto route = route_by(envelope, roadmap);
    problems += by_lattice.empty() ? 0 : 1;
    if (route.empty()) {
      continue;
    }
    EXPECT_EQ(route.front(), envelope.start());
    EXPECT_EQ(route.back(), envelope.goal());
    EXPECT_TRUE(are_turns_allowed(envelope, route));
    for (std::size_t k = 1; k < route.size(); ++k) {
      EXPECT_TRUE(envelope.is_clear(route[k - 1], route[k]));
    }
    if (!by_lattice.empty()) {
      ratios.push_back(envelope.route_cost_m(route, 1.0) / envelope.route_cost_m(by_lattice, 1.0));
    }
  }
  ASSERT_GE(2 * static_cast<int>(ratios.size()), problems);
  if (!ratios.empty()) {
    std::sort(ratios.begin(), ratios.end());
    EXPECT_LT(ratios[ratios.size() / 2], 1.15);
  }
}

TEST(Roadmap, WrittenAndReadItIsTheSame) {
  const auto seed = test::fresh_seed();
  const PlanningCase in(test::make_fractal_map(seed, 160, 30.0, 3000.0, 60.0), kWeights);
  const GlobalOptions options = test::shipped_global_options();
  const Roadmap roadmap = roadmap_of(in, options);
  const Bytes bytes = roadmap.written(kKey);
  std::string why;
  const auto read = Roadmap::read(bytes, kKey, in.map.geometry, why);
  ASSERT_TRUE(read) << why;
  EXPECT_EQ(read->written(kKey), bytes);
  const FlightEnvelope envelope(in.costs, options, in.above(700, 800), in.above(4000, 3900));
  EXPECT_EQ(route_by(envelope, *read), route_by(envelope, roadmap));
}

TEST(Roadmap, AFileOfAnotherMapOrKeyOrACutOrDamagedOneIsRefusedWithTheReason) {
  const PlanningCase in(test::make_fractal_map(3, 100, 30.0, 3000.0, 60.0), kWeights);
  const Roadmap roadmap = roadmap_of(in, test::shipped_global_options());
  const Bytes bytes = roadmap.written(kKey);
  const raster::GridGeometry& geometry = in.map.geometry;
  std::string why;
  EXPECT_FALSE(Roadmap::read(bytes, {7, 9}, geometry, why));
  EXPECT_EQ(why, "it was made of another map or with other settings");
  raster::GridGeometry other = geometry;
  other.west_m += 30.0;
  EXPECT_FALSE(Roadmap::read(bytes, kKey, other, why));
  EXPECT_EQ(why, "it belongs to a map of other extent");
  for (const std::size_t size :
       {std::size_t{0}, std::size_t{50}, std::size_t{112}, bytes.size() / 2, bytes.size() - 1}) {
    EXPECT_FALSE(Roadmap::read(ByteView(bytes).first(size), kKey, geometry, why)) << size;
  }
  Bytes longer = bytes;
  longer.push_back(std::byte{0});
  EXPECT_FALSE(Roadmap::read(longer, kKey, geometry, why));
  // Each byte counts: those of the header, and some of the rest.
  std::mt19937_64 random(test::fresh_seed());
  for (std::size_t i = 0; i < 400; ++i) {
    Bytes damaged = bytes;
    const std::size_t at = i < 112 ? i : random() % bytes.size();
    damaged[at] ^= std::byte{static_cast<unsigned char>(1 + random() % 255)};
    EXPECT_FALSE(Roadmap::read(damaged, kKey, geometry, why)) << at;
  }
}

TEST(Roadmap, NumbersThatCannotBeAreRefusedUnderARightHash) {
  const PlanningCase in(test::make_fractal_map(3, 100, 30.0, 3000.0, 60.0), kWeights);
  const Roadmap roadmap = roadmap_of(in, test::shipped_global_options());
  const Bytes bytes = roadmap.written(kKey);
  const auto with = [&](std::size_t at, float value) {
    Bytes forged = bytes;
    std::memcpy(forged.data() + at, &value, sizeof value);
    std::memset(forged.data() + 96, 0, 16);
    const Hash128 hash = hash128(forged);
    std::memcpy(forged.data() + 96, &hash.high, 8);
    std::memcpy(forged.data() + 104, &hash.low, 8);
    std::string why;
    return Roadmap::read(forged, kKey, in.map.geometry, why) ? std::string("taken") : why;
  };
  constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
  // The cost of an edge in the middle that can be flown.
  const auto node =
      static_cast<std::size_t>(roadmap.rows() / 2 * roadmap.columns() + roadmap.columns() / 2);
  const std::size_t edge = 112 + 24 * 16 * node;
  EXPECT_EQ(with(edge + 16, 1000.0F), "taken");
  EXPECT_EQ(with(edge + 16, -1.0F), "it holds an edge that cannot be");
  EXPECT_EQ(with(edge + 16, kNaN), "it holds an edge that cannot be");
  EXPECT_EQ(with(edge, kNaN), "it holds an edge that cannot be");
  EXPECT_EQ(with(edge + 12, std::numeric_limits<float>::infinity()),
            "it holds an edge that cannot be");
  EXPECT_EQ(with(bytes.size() - 4, 1.0F), "its blocks do not fit the map");  // the frame
  const std::size_t blocks = 17 + 4;  // 3000 m at 180 m, framed
  EXPECT_EQ(with(bytes.size() - 4 * (blocks * blocks / 2 + 1), 0.5F),
            "its blocks do not fit the map");
}

TEST(Roadmap, AllThatItSaysMayBeWrongAndNoRouteIsUnlawful) {
  // The roadmap of a plain on a map with hills.
  const auto seed = test::fresh_seed();
  const PlanningCase plain(test::make_map(160, 160, 30.0, [](double, double) { return 100.0; }),
                           kWeights);
  const PlanningCase hills(test::make_fractal_map(seed, 160, 30.0, 2000.0, 200.0), kWeights);
  const GlobalOptions options = test::shipped_global_options();
  const Roadmap roadmap = roadmap_of(plain, options);
  const FlightEnvelope envelope(hills.costs, options, hills.above(700, 800),
                                hills.above(4000, 3900));
  const auto route = route_by(envelope, roadmap);
  for (std::size_t k = 1; k < route.size(); ++k) {
    EXPECT_TRUE(envelope.is_clear(route[k - 1], route[k]));
  }
  EXPECT_TRUE(route.empty() || are_turns_allowed(envelope, route));
}

TEST(Roadmap, AFieldOverItsBlocksIsTheFieldOfTheEnvelopeAsFarAsItIsNeeded) {
  const auto seed = test::fresh_seed();
  const PlanningCase in(test::make_fractal_map(seed, 160, 30.0, 3000.0, 60.0), kWeights);
  const GlobalOptions options = test::shipped_global_options();
  const flight::Waypoint start = in.above(1500, 1600);
  const flight::Waypoint goal = in.above(3000, 3100);
  const FlightEnvelope envelope(in.costs, options, start, goal);
  const CostField whole(envelope, goal.point(), 120.0);
  const CostField part(CostField(envelope, 120.0), goal.point(), start.point());
  EXPECT_EQ(part.cost_m(start.point()), whole.cost_m(start.point()));
  for (double x_m = 60.0; x_m < 4800.0; x_m += 120.0) {
    for (double y_m = 60.0; y_m < 4800.0; y_m += 120.0) {
      const double all_m = whole.cost_m({x_m, y_m});
      if (all_m < 1.2 * whole.cost_m(start.point())) {
        EXPECT_EQ(part.cost_m({x_m, y_m}), all_m);
      } else {
        EXPECT_GE(part.cost_m({x_m, y_m}), all_m);
      }
    }
  }
}

}  // namespace
}  // namespace hedgehop::global_planning
