#include "local_planning/indicator.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <numbers>

namespace hedgehop::local_planning {
namespace {

constexpr IndicatorOptions kUsual{1.0, 9.0, 5.0, 1.0, 0.5};

TEST(Indicator, SettlesBetweenTargetAndVehicleAsTheSpringsSay) {
  // C (t - a) = C_chi (a - chi) at rest: the relative spring pulls BACK to the vehicle.
  Indicator indicator{0.2, 0.0};
  for (int i = 0; i < 400; ++i) {
    indicator.step(1.0, 0.2, 0.0, kUsual, 0.05);
  }
  EXPECT_NEAR(indicator.angle_rad, (9.0 * 1.0 + 0.5 * 0.2) / 9.5, 1e-9);
  EXPECT_NEAR(indicator.rate_radps, 0.0, 1e-9);
}

TEST(Indicator, StrongRelativeSpringStillSettles) {
  IndicatorOptions options = kUsual;
  options.relative_spring_1ps2 = 12.0;  // with the opposite sign this would run away
  Indicator indicator{0.0, 0.0};
  for (int i = 0; i < 400; ++i) {
    indicator.step(1.0, 0.0, 0.0, options, 0.05);
  }
  EXPECT_NEAR(indicator.angle_rad, 9.0 / 21.0, 1e-9);
}

TEST(Indicator, StepResponseFollowsTheClosedForm) {
  // a'' + 6 a' + 9 a = 9 t without the relative spring: critically damped with 3 rad/s.
  IndicatorOptions options = kUsual;
  options.relative_spring_1ps2 = 0.0;
  Indicator indicator{0.0, 0.0};
  for (int i = 1; i <= 4000; ++i) {
    indicator.step(0.5, 0.0, 0.0, options, 0.001);
    const double t = 0.001 * i;
    EXPECT_NEAR(indicator.angle_rad, 0.5 * (1.0 - std::exp(-3.0 * t) * (1.0 + 3.0 * t)), 2e-3);
  }
}

TEST(Indicator, StepResponseDoesNotOvershootAtAnyStep) {
  for (const double step_s : {0.01, 0.05, 0.2}) {
    Indicator indicator{0.0, 0.0};
    double greatest_rad = 0.0;
    for (double t = 0.0; t < 10.0; t += step_s) {
      indicator.step(1.0, indicator.angle_rad, 0.0, kUsual, step_s);
      greatest_rad = std::max(greatest_rad, indicator.angle_rad);
    }
    EXPECT_LE(greatest_rad, 1.02) << step_s;
    EXPECT_NEAR(indicator.angle_rad, 1.0, 1e-3) << step_s;
  }
}

TEST(Indicator, TurnsTheShortWayAcrossSouth) {
  Indicator indicator{3.0, 0.0};
  double furthest_rad = 0.0;
  for (int i = 0; i < 200; ++i) {
    indicator.step(-3.0, indicator.angle_rad, 0.0, kUsual, 0.05);
    furthest_rad = std::max(furthest_rad, std::fabs(wrap_to_pi(indicator.angle_rad - 3.0)));
  }
  EXPECT_NEAR(indicator.angle_rad, -3.0, 1e-3);
  EXPECT_LT(furthest_rad, 0.3);
}

TEST(Indicator, RelativeDamperCarriesItAlongWithATurningVehicle) {
  IndicatorOptions options = kUsual;
  options.spring_1ps2 = 1e-9;
  options.relative_spring_1ps2 = 0.0;
  Indicator indicator{0.0, 0.0};
  for (int i = 0; i < 400; ++i) {
    indicator.step(0.0, 0.0, 0.6, options, 0.05);
  }
  // D a' + D_chi (a' - chi') = 0
  EXPECT_NEAR(indicator.rate_radps, 0.6 * 1.0 / 6.0, 1e-6);
}

}  // namespace
}  // namespace hedgehop::local_planning
