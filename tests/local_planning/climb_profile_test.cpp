#include "local_planning/climb_profile.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <vector>

#include "local_planning/local_planning_setup.hpp"
#include "support/test_map.hpp"

namespace hedgehop::local_planning {
namespace {

constexpr ProfileOptions kUsual{true, 12.0, 0.5, 0.4, 0.8, 5.0};

class ClimbProfile : public ::testing::Test {
 protected:
  // East along y = 1500 m over level ground with a plateau of `rise_m` from x = 1500 m on.
  ClimbAhead ahead(double rise_m, double x_m, double altitude_m, double climb_rate_mps,
                   const ProfileOptions& options = kUsual, double guide_altitude_m = 0.0) {
    const auto map =
        test::make_map(100, 100, 30.0, [&](double x, double) { return x > 1500.0 ? rise_m : 0.0; });
    const risk::CostModel costs = test::test_costs(map);
    const Surroundings surroundings(costs, 350.0, 40.0, 0.0, 0.0);
    const Guide guide({{0, 1500, guide_altitude_m}, {3000, 1500, guide_altitude_m}});
    const auto state =
        command_model::trimmed_state(x_m, 1500.0, altitude_m, 40.0, 0.0, climb_rate_mps);
    const command_model::StateTrigonometry trigonometry = command_model::trigonometry_of(state);
    const auto by = [&](Kernel kernel) {
      ClimbForecast forecast(surroundings, guide, model_, 300.0, 20.0, options, 40.0,
                             step_kernels(kernel));
      return forecast.ahead(state, trigonometry, view_of(state), 0.0);
    };
    const ClimbAhead best = by(Kernel::kBest);
    for (const Kernel kernel : {Kernel::kAvx2, Kernel::kAvx512}) {
      if (is_available(kernel)) {
        const ClimbAhead other = by(kernel);
        EXPECT_EQ(other.climb_rate_mps, best.climb_rate_mps) << name_of_kernel(kernel);
        EXPECT_EQ(other.shortfall_rate_mps, best.shortfall_rate_mps) << name_of_kernel(kernel);
      }
    }
    return best;
  }

  // On the guide, which leads east, 300 m behind its target.
  [[nodiscard]] GuideView view_of(const command_model::ModelState& state) const {
    return {state.x_m, 0.0, 300.0,
            model_.vehicle().vertical_rates(state.speed_mps, state.altitude_m)};
  }

  command_model::CommandModel model_{test::shipped_vehicle()};
};

TEST_F(ClimbProfile, LevelFlightAtTheSafetyHeightNeedsNoClimb) {
  EXPECT_NEAR(ahead(0.0, 300.0, 20.0, 0.0).climb_rate_mps, 0.0, 1e-5);
}

TEST_F(ClimbProfile, StepAheadNeedsTheClosedFormRate) {
  // The plateau's disc begins at the cell of x = 1470..1500 (its centre is 30 m from the next): the
  // first place looked at in it is 20 k m from x = 1175 m with 1175 + 20 k >= 1470: k = 15, t = 7.5
  // s. 30 m to climb from level: 7.1 D - D^2 / 4 = 30 with a = 0.8 * 2.5 = 2.
  const double expected = 2.0 * (7.1 - std::sqrt(7.1 * 7.1 - 30.0));
  EXPECT_NEAR(ahead(30.0, 1175.0, 20.0, 0.0).climb_rate_mps, expected, 1e-4);
}

TEST_F(ClimbProfile, SinkingNeedsMoreClimbThanLevelFlight) {
  const double level = ahead(25.0, 1175.0, 20.0, 0.0).climb_rate_mps;
  const double sinking = ahead(25.0, 1175.0, 20.0, -3.0).climb_rate_mps;
  EXPECT_GT(sinking, level + 0.5);
}

TEST_F(ClimbProfile, ImpossibleClimbIsLimitedAndReportsTheShortfall) {
  const ClimbAhead result = ahead(200.0, 1175.0, 20.0, 0.0);
  EXPECT_EQ(result.climb_rate_mps, 8.0);
  EXPECT_GT(result.shortfall_rate_mps, 8.0);
}

TEST_F(ClimbProfile, GuideAboveTheGroundIsFollowedUpToTheAllowance) {
  // 40 m guide, 5 m allowance, 20 m altitude: 15 m are missing at once, so all the climb there is.
  EXPECT_EQ(ahead(0.0, 300.0, 20.0, 0.0, kUsual, 40.0).climb_rate_mps, 8.0);
  // At 45 m, 10 m above what is wanted: after 12 s of sinking at that rate it is reached.
  EXPECT_NEAR(ahead(0.0, 300.0, 45.0, 0.0, kUsual, 40.0).climb_rate_mps, -10.0 / 12.0, 1e-5);
}

TEST_F(ClimbProfile, FlyingTheRateClearsTheStep) {
  const auto vehicle = test::shipped_vehicle();
  const auto map =
      test::make_map(100, 100, 30.0, [&](double x, double) { return x > 1500.0 ? 35.0 : 0.0; });
  const risk::CostModel costs = test::test_costs(map);
  const Surroundings surroundings(costs, 350.0, 40.0, 0.0, 0.0);
  const Guide guide({{0, 1500, 0}, {3000, 1500, 0}});
  ClimbForecast forecast(surroundings, guide, model_, 300.0, 20.0, kUsual, 40.0,
                         step_kernels(Kernel::kBest));
  for (const double sink_mps : {0.0, -4.0, -8.0}) {
    auto state =
        command_model::trimmed_state(600.0, 1500.0, 20.0 - 10.0 * sink_mps, 40.0, 0.0, sink_mps);
    double least_m = 1e9;
    while (state.x_m < 2500.0) {
      const ClimbAhead wanted =
          forecast.ahead(state, command_model::trigonometry_of(state), view_of(state), 0.0);
      state = model_.step(state, {40.0, 0.0, wanted.climb_rate_mps}, 0.05);
      least_m = std::min(least_m, state.altitude_m - (state.x_m > 1470.0 ? 35.0 : 0.0));
    }
    EXPECT_GT(least_m, 18.5) << "sinking at " << sink_mps;
    EXPECT_LT(state.altitude_m, 35.0 + 23.0) << "and does not stay high above it";
  }
}

}  // namespace
}  // namespace hedgehop::local_planning
