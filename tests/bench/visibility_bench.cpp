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
std::int64_t bare_loop(const float* ground_m, const float* eyes_m, float* greatest, float* seen,
                       const RaySteps& steps, int observers) {
  const hn::CappedTag<float, kLanesMax> tag;
  const auto lanes = static_cast<std::ptrdiff_t>(hn::Lanes(tag));
  decltype(hn::Zero(tag)) ground[kBlockRows];
#pragma GCC unroll 8
  for (int i = 0; i < kBlockRows; ++i) {
    ground[i] = hn::Load(tag, ground_m + i * lanes);
  }
  const float* HWY_RESTRICT inverse_distance = steps.inverse_distance_1pm.data();
  const float* HWY_RESTRICT drop_slope = steps.drop_slope.data();
  const float* HWY_RESTRICT weight = steps.weight.data();
  for (std::ptrdiff_t o = 0; o < observers; ++o) {
    const auto eye = hn::Load(tag, eyes_m + o * lanes);
    auto most = hn::Load(tag, greatest + o * lanes);
    auto sum = hn::Load(tag, seen + o * lanes);
#pragma GCC unroll 8
    for (int i = 0; i < kBlockRows; ++i) {
      const std::ptrdiff_t k = kBlockRows + o + i;
      const auto slope = hn::MulSub(hn::Sub(ground[i], eye), hn::Set(tag, inverse_distance[k]),
                                    hn::Set(tag, drop_slope[k]));
#if HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_AVX3_DL
      sum.raw = _mm512_mask_add_ps(sum.raw, hn::Ge(slope, most).raw, sum.raw,
                                   hn::Set(tag, weight[k]).raw);
#else
      sum = hn::Add(sum, hn::IfThenElseZero(hn::Ge(slope, most), hn::Set(tag, weight[k])));
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

using BareLoop = std::int64_t (*)(const float*, const float*, float*, float*, const RaySteps&, int);

std::int64_t best_bare_loop(const float* ground_m, const float* eyes_m, float* greatest,
                            float* seen, const RaySteps& steps, int observers) {
  return HWY_DYNAMIC_DISPATCH(bare_loop)(ground_m, eyes_m, greatest, seen, steps, observers);
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
  const RaySteps steps = sight_lines(kOptions, kCell_m, false, false).front().steps;
  std::vector<float> memory(static_cast<std::size_t>(kLanesMax) * (3 * kObservers + kBlockRows + 1),
                            0.0F);
  const auto address = reinterpret_cast<std::uintptr_t>(memory.data());
  float* ground_m = memory.data() + (64 - address % 64) % 64 / sizeof(float);
  float* eyes_m = ground_m + kLanesMax * kBlockRows;
  float* greatest = eyes_m + kLanesMax * kObservers;
  float* seen = greatest + kLanesMax * kObservers;
  for (int i = 0; i < kLanesMax * kBlockRows; ++i) {
    ground_m[i] = 300.0F + static_cast<float>(i * 37 % 100);
  }
  for (int i = 0; i < kLanesMax * kObservers; ++i) {
    eyes_m[i] = 350.0F + static_cast<float>(i % 7);
    greatest[i] = -0.1F;
  }
  const BareLoop loop = bare_loop_of(simd);
  double samples = 0.0;
  for (auto _ : state) {
    samples += static_cast<double>(loop(ground_m, eyes_m, greatest, seen, steps, kObservers));
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
    for (const SightLine& line : sight_lines(kOptions, kCell_m, is_transposed, false)) {
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
