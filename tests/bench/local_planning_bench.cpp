#include <benchmark/benchmark.h>
#include <random>
#include <variant>

#include "command_model/command_model.hpp"
#include "local_planning/histogram_table.hpp"
#include "local_planning/local_planning_setup.hpp"
#include "local_planning/polar_histogram.hpp"
#include "support/rough_terrain.hpp"

namespace hedgehop::local_planning {
namespace {

constexpr double kSpeed_mps = 40.0;

const map::Map& hills() {
  static const map::Map map = [] {
    map::Map made = test::make_rough_map(600, 600, 30.0, 11, 25.0);
    std::mt19937_64 random(5);
    for (auto& value : made.visibility.values()) {
      value = static_cast<std::uint16_t>(random() % 65535);
    }
    test::finish_map(made);
    return made;
  }();
  return map;
}

// The table of the paper: window [m] and number of sectors.
void window_and_sectors(benchmark::internal::Benchmark* bench) {
  for (const int window_m : {300, 350, 400, 450, 500, 550, 600}) {
    for (const int sectors : {32, 64, 128, 256}) {
      bench->Args({window_m, sectors});
    }
  }
}

// One polar histogram with mask and risk, in plain form and from tables with SIMD.
template <typename KernelOf>
void histogram(benchmark::State& state, const KernelOf& kernel_of) {
  const double window_m = static_cast<double>(state.range(0));
  const LocalOptions local = test::shipped_local_options();
  const risk::CostModel costs = test::test_costs(hills());
  const double disc_m = local.safety_radius_m + 0.5 * 1.4142135623730951 * 30.0;
  const Surroundings surroundings(costs, window_m, disc_m, local.semantics_weight,
                                  local.visibility_weight);
  const HistogramOptions options{window_m,
                                 static_cast<int>(state.range(1)),
                                 disc_m,
                                 local.safety_height_m,
                                 local.near_distance_m,
                                 local.truncation_angle_rad,
                                 local.truncation_distance_m,
                                 local.arc_radius_max_factor,
                                 local.is_arc_widened};
  auto kernel = kernel_of(surroundings, options);
  PolarHistogram result;
  double x_m = 2000.0;
  double heading_rad = 0.3;
  for (auto _ : state) {
    const geo::MapPoint place{x_m, 9000.0};
    kernel.compute(place, raster::sample_bilinear(hills().surface_m, place) + 40.0, heading_rad,
                   282.0, result);
    benchmark::DoNotOptimize(result.tan_masked.data());
    x_m = x_m > 16000.0 ? 2000.0 : x_m + 2.0;
    heading_rad += 0.003;
  }
}
void HistogramPlain(benchmark::State& state) {
  histogram(state, [](const Surroundings& surroundings, const HistogramOptions& options) {
    return HistogramKernel(surroundings, options);
  });
}
BENCHMARK(HistogramPlain)->Apply(window_and_sectors)->Unit(benchmark::kMicrosecond);

void HistogramSimd(benchmark::State& state) {
  histogram(state, [](const Surroundings& surroundings, const HistogramOptions& options) {
    return HistogramTable(surroundings, options, histogram_tables(surroundings, options),
                          Kernel::kBest);
  });
}
BENCHMARK(HistogramSimd)->Apply(window_and_sectors)->Unit(benchmark::kMicrosecond);

// The whole closed loop: histogram or rollouts, choice, indicators, climb ahead, command model. One
// item is one step of 50 ms; one kilometre at 40 m/s has 500.
void closed_loop(benchmark::State& state, const char* mode, Kernel kernel) {
  const auto vehicle = test::shipped_vehicle();
  LocalOptions options = test::shipped_local_options(mode);
  options.window_m = static_cast<double>(state.range(0));
  options.sectors = static_cast<int>(state.range(1));
  const risk::CostModel costs = test::test_costs(hills());
  const auto guide = test::stand_in_guide(hills(), {{2000, 2000}, {9000, 6000}, {16000, 9000}},
                                          50.0, 20.0, 30.0, 0.14, 15.24);
  const LocalGround ground = local_ground(costs, options);
  SilentObserver observer;
  std::int64_t steps = 0;
  for (auto _ : state) {
    const auto result = fly_along(ground, vehicle, options, guide,
                                  state_at_start(guide, kSpeed_mps, vehicle.limits), kSpeed_mps, {},
                                  observer, kernel);
    if (!std::holds_alternative<Flight>(result)) {
      state.SkipWithError("the flight got stuck");
      break;
    }
    steps += std::get<Flight>(result).decisions;
  }
  state.SetItemsProcessed(steps);
}
void TvfhPlain(benchmark::State& state) { closed_loop(state, "local.mode=tvfh", Kernel::kPlain); }
void TvfhSimd(benchmark::State& state) { closed_loop(state, "local.mode=tvfh", Kernel::kBest); }
void RolloutPlain(benchmark::State& state) {
  closed_loop(state, "local.mode=rollout", Kernel::kPlain);
}
void RolloutSimd(benchmark::State& state) {
  closed_loop(state, "local.mode=rollout", Kernel::kBest);
}
void usual_windows(benchmark::internal::Benchmark* bench) {
  bench->Args({300, 32})
      ->Args({350, 64})
      ->Args({350, 256})
      ->Args({600, 64})
      ->Unit(benchmark::kMillisecond);
}
BENCHMARK(TvfhPlain)->Apply(usual_windows);
BENCHMARK(TvfhSimd)->Apply(usual_windows);
BENCHMARK(RolloutPlain)->Args({350, 64})->Unit(benchmark::kMillisecond);
BENCHMARK(RolloutSimd)->Args({350, 64})->Unit(benchmark::kMillisecond);

void CommandModelStep(benchmark::State& state) {
  const command_model::CommandModel model(test::shipped_vehicle());
  auto flown = command_model::trimmed_state(0.0, 0.0, 100.0, kSpeed_mps, 0.0, 0.0);
  for (auto _ : state) {
    flown = model.step(flown, {kSpeed_mps, 0.5, 2.0}, 0.05);
    benchmark::DoNotOptimize(flown);
  }
}
BENCHMARK(CommandModelStep);

}  // namespace
}  // namespace hedgehop::local_planning
