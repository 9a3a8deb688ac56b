// What the inner loop of the visibility layer would take if there were nothing else to do, against
// the whole layer: both as seconds for each billion of samples, which is nanoseconds a sample.
#include <benchmark/benchmark.h>
#include <cstdint>
#include <vector>

#include "base/observer.hpp"
#include "preparation/visibility.hpp"
#include "preparation/visibility_kernel.hpp"
#include "preparation/visibility_lines.hpp"
#include "support/fractal_terrain.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "bench/visibility_bench.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace hedgehop::preparation::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

// Looks from `observers` rows of eyes at kBlockRows rows of ground that stay in registers, all in
// the nearest cache. Returns the number of samples.
std::int64_t bare_loop(const std::int16_t* ground, const std::int16_t* eyes, std::int16_t* greatest,
                       std::int16_t* seen, const RaySteps& steps, int observers) {
  const hn::CappedTag<std::int16_t, kLanesMax> tag;
  const hn::Repartition<std::int32_t, hn::CappedTag<std::int16_t, kLanesMax>> pairs;
  const auto lanes = static_cast<std::ptrdiff_t>(hn::Lanes(tag));
  const std::int32_t* HWY_RESTRICT ratio = steps.pairs.ratio.data();
  const std::int32_t* HWY_RESTRICT weight = steps.pairs.weight.data();
  decltype(hn::Zero(tag)) rows[kBlockRows];
#pragma GCC unroll 8
  for (int i = 0; i < kBlockRows; ++i) {
    rows[i] = hn::Load(tag, ground + i * lanes);
  }
  for (std::ptrdiff_t o = 0; o < observers; ++o) {
    const std::ptrdiff_t at = steps.block_at[static_cast<std::size_t>(kNearRows + 1 + o)];
    const auto eye = hn::Load(tag, eyes + o * lanes);
    auto most = hn::Load(tag, greatest + o * lanes);
    auto sum = hn::Load(tag, seen + o * lanes);
#pragma GCC unroll 8
    for (int i = 0; i < kBlockRows; ++i) {
      const auto slope = hn::MulFixedPoint15(hn::Sub(rows[i], eye),
                                             hn::BitCast(tag, hn::Set(pairs, ratio[at + i])));
      const auto counts = hn::BitCast(tag, hn::Set(pairs, weight[at + i]));
#if HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_AVX3_DL
      sum.raw = _mm512_mask_add_epi16(sum.raw, hn::Gt(slope, most).raw, sum.raw, counts.raw);
#else
      sum = hn::Add(sum, hn::IfThenElseZero(hn::Gt(slope, most), counts));
#endif
      most = hn::Max(most, slope);
    }
    hn::Store(most, tag, greatest + o * lanes);
    hn::Store(sum, tag, seen + o * lanes);
  }
  return observers * kBlockRows * lanes;
}

}  // namespace hedgehop::preparation::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace hedgehop::preparation {
namespace {

HWY_EXPORT(bare_loop);

using BareLoop = std::int64_t (*)(const std::int16_t*, const std::int16_t*, std::int16_t*,
                                  std::int16_t*, const RaySteps&, int);

std::int64_t best_bare_loop(const std::int16_t* ground, const std::int16_t* eyes,
                            std::int16_t* greatest, std::int16_t* seen, const RaySteps& steps,
                            int observers) {
  return HWY_DYNAMIC_DISPATCH(bare_loop)(ground, eyes, greatest, seen, steps, observers);
}

BareLoop bare_loop_of(Simd simd) {
#if (HWY_TARGETS & HWY_AVX2) && HWY_TARGETS != HWY_AVX2
  if (simd == Simd::kAvx2) {
    return &N_AVX2::bare_loop;
  }
#endif
  return &best_bare_loop;
}

const VisibilityOptions kOptions{5000.0, 15.24, 180, true, 0.13, {}};
constexpr double kCell_m = 30.0;

void count_samples(benchmark::State& state, double samples) {
  state.counters["s_per_billion_samples"] =
      benchmark::Counter(samples * 1e-9, benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

void bare(benchmark::State& state, Simd simd) {
  if (!is_available(simd)) {
    state.SkipWithError("this processor lacks the instructions");
    return;
  }
  constexpr int kObservers = 64;
  const RaySteps steps = sight_lines(kOptions, kCell_m, false).front().steps;
  std::vector<std::int16_t> memory(
      static_cast<std::size_t>(kLanesMax) * (3 * kObservers + kBlockRows + 1), 0);
  const auto address = reinterpret_cast<std::uintptr_t>(memory.data());
  std::int16_t* ground = memory.data() + (64 - address % 64) % 64 / sizeof(std::int16_t);
  std::int16_t* eyes = ground + kLanesMax * kBlockRows;
  std::int16_t* greatest = eyes + kLanesMax * kObservers;
  std::int16_t* seen = greatest + kLanesMax * kObservers;
  for (int i = 0; i < kLanesMax * kBlockRows; ++i) {
    ground[i] = static_cast<std::int16_t>(kUnitsPerMetre * (300 + i * 37 % 100));
  }
  for (int i = 0; i < kLanesMax * kObservers; ++i) {
    eyes[i] = static_cast<std::int16_t>(kUnitsPerMetre * (350 + i % 7));
    greatest[i] = -50 * kUnitsPerMetre;
  }
  const BareLoop loop = bare_loop_of(simd);
  double samples = 0.0;
  for (auto _ : state) {
    samples += static_cast<double>(loop(ground, eyes, greatest, seen, steps, kObservers));
    benchmark::DoNotOptimize(memory.data());
    benchmark::ClobberMemory();
  }
  count_samples(state, samples);
}

// As if each sample of each ray were looked at; those that nobody can see are left out in blocks.
void layer(benchmark::State& state, Simd simd) {
  if (!is_available(simd)) {
    state.SkipWithError("this processor lacks the instructions");
    return;
  }
  constexpr int kSide = 700;
  constexpr int kReach = 169;
  static const map::Map map = test::make_fractal_map(11, kSide, kCell_m, 4000.0, 500.0);
  double samples_a_cell = 0.0;
  for (const bool is_transposed : {false, true}) {
    for (const SightLine& line : sight_lines(kOptions, kCell_m, is_transposed)) {
      samples_a_cell += 2.0 * line.steps.count;
    }
  }
  constexpr int kBlock = kSide - 2 * kReach;
  SilentObserver observer;
  double cells = 0.0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(visibility_of_block({map.surface_m, map.surface_m}, {kReach, kReach},
                                                 kBlock, kBlock, kOptions, {1, simd}, observer));
    cells += 1.0 * kBlock * kBlock;
  }
  state.counters["samples_per_cell"] = samples_a_cell;
  state.counters["s_per_million_cells"] =
      benchmark::Counter(cells * 1e-6, benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
  count_samples(state, samples_a_cell * cells);
}

BENCHMARK_CAPTURE(bare, avx512, Simd::kAvx512)->Name("visibility/bare_loop/avx512");
BENCHMARK_CAPTURE(bare, avx2, Simd::kAvx2)->Name("visibility/bare_loop/avx2");
BENCHMARK_CAPTURE(layer, avx512, Simd::kAvx512)
    ->Name("visibility/layer/avx512")
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(layer, avx2, Simd::kAvx2)
    ->Name("visibility/layer/avx2")
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace hedgehop::preparation
#endif
