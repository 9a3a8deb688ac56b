#pragma once

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "flight/trajectory.hpp"
#include "flight/vehicle.hpp"
#include "map/map.hpp"
#include "raster/grid.hpp"

namespace hedgehop::test {

inline constexpr double kPi = 3.14159265358979323846;
inline constexpr double kG_mps2 = 9.80665;
inline constexpr double kConvergence_rad = 0.021;

inline flight::Limits test_limits() {
  flight::Limits limits;
  limits.speed_min_mps = 15.0;
  limits.speed_max_mps = 62.0;
  limits.bank_max_rad = 30.0 * kPi / 180.0;
  limits.roll_rate_max_radps = 35.0 * kPi / 180.0;
  limits.pitch_max_rad = 12.0 * kPi / 180.0;
  limits.climb_rate_max_mps = 8.0;
  limits.descent_rate_max_mps = 8.0;
  limits.vertical_acceleration_max_mps2 = 2.5;
  limits.load_factor_max = 1.5;
  return limits;
}

/// A curve of time made of levels and smooth ramps between them, 10 s^3 - 15 s^4 + 6 s^5 each: rate
/// and acceleration are continuous. Greatest rate 1.875 rise / T, acceleration 5.774 rise / T^2,
/// jerk 60 rise / T^3.
class Schedule {
 public:
  explicit Schedule(double value) : first_(value) {}

  /// Adds a ramp from the level reached so far; ramps must follow one another in time.
  Schedule& ramp(double begin_s, double duration_s, double to) {
    ramps_.push_back({begin_s, duration_s, last(), to});
    return *this;
  }

  [[nodiscard]] double last() const { return ramps_.empty() ? first_ : ramps_.back().to; }
  [[nodiscard]] double value(double time_s) const { return evaluate(time_s, 0); }
  [[nodiscard]] double rate(double time_s) const { return evaluate(time_s, 1); }
  [[nodiscard]] double acceleration(double time_s) const { return evaluate(time_s, 2); }

 private:
  struct Ramp {
    double begin_s, duration_s, from, to;
  };

  [[nodiscard]] double evaluate(double time_s, int order) const {
    double level = first_;
    for (const Ramp& ramp : ramps_) {
      const double s = (time_s - ramp.begin_s) / ramp.duration_s;
      if (s < 0.0) {
        break;
      }
      const double rise = ramp.to - ramp.from;
      if (s < 1.0) {
        const double t = ramp.duration_s;
        return order == 0   ? ramp.from + rise * s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
               : order == 1 ? rise * 30.0 * s * s * (1.0 - s) * (1.0 - s) / t
                            : rise * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / (t * t);
      }
      level = ramp.to;
    }
    return order == 0 ? level : 0.0;
  }

  double first_;
  std::vector<Ramp> ramps_;
};

/// What a flight does, as curves of time, and where it begins.
struct Manoeuvre {
  Schedule bank_rad{0.0};
  Schedule climb_rate_mps{0.0};
  Schedule speed_mps{40.0};
  double x_m = 0.0;
  double y_m = 0.0;
  double altitude_m = 0.0;
  double azimuth_grid_rad = 0.0;
  double duration_s = 30.0;
};

enum class Integrator { kFine, kExplicitEuler, kSemiImplicitEuler };

/// Flies a manoeuvre: bank, roll rate, pitch, speed and climb rate are closed forms of time,
/// heading and place are integrated from them, by the midpoint rule in steps of 1 ms, or crudely in
/// steps of `step_s` as simple simulators do.
inline flight::Trajectory fly(const Manoeuvre& manoeuvre, const map::Map& map, double step_s = 0.05,
                              Integrator integrator = Integrator::kFine) {
  flight::Trajectory trajectory;
  trajectory.step_s = step_s;
  double x_m = manoeuvre.x_m;
  double y_m = manoeuvre.y_m;
  double altitude_m = manoeuvre.altitude_m;
  double azimuth_rad = manoeuvre.azimuth_grid_rad;
  const auto turn_rate_radps = [&](double t) {
    return kG_mps2 * std::tan(manoeuvre.bank_rad.value(t)) / manoeuvre.speed_mps.value(t);
  };
  const int steps = static_cast<int>(std::lround(manoeuvre.duration_s / step_s));
  for (int i = 0; i <= steps; ++i) {
    const double t = i * step_s;
    flight::FlightState state;
    state.time_s = t;
    state.x_m = x_m;
    state.y_m = y_m;
    state.altitude_m = altitude_m;
    state.speed_mps = manoeuvre.speed_mps.value(t);
    state.convergence_rad = kConvergence_rad;
    const double azimuth_true_rad = azimuth_rad + kConvergence_rad;
    state.heading_true_rad =
        azimuth_true_rad - 2.0 * kPi * std::floor(azimuth_true_rad / (2.0 * kPi));
    state.bank_rad = manoeuvre.bank_rad.value(t);
    state.roll_rate_radps = manoeuvre.bank_rad.rate(t);
    const double pull = manoeuvre.speed_mps.rate(t) / kG_mps2;
    state.pitch_rad = -std::atan(pull);
    state.pitch_rate_radps = -manoeuvre.speed_mps.acceleration(t) / kG_mps2 / (1.0 + pull * pull);
    state.climb_rate_mps = manoeuvre.climb_rate_mps.value(t);
    state.vertical_acceleration_mps2 = manoeuvre.climb_rate_mps.rate(t);
    state.target_heading_true_rad = state.heading_true_rad;
    state.commanded_heading_true_rad = state.heading_true_rad;
    state.commanded_speed_mps = state.speed_mps;
    state.surface_m = raster::sample_bilinear(map.surface_m, state.point());
    state.terrain_m = raster::sample_bilinear(map.terrain_m, state.point());
    trajectory.states.push_back(state);

    const auto advance = [&](double dt, double heading_at_s, double rates_at_s,
                             double azimuth_used_rad) {
      x_m += dt * manoeuvre.speed_mps.value(rates_at_s) * std::sin(azimuth_used_rad);
      y_m += dt * manoeuvre.speed_mps.value(rates_at_s) * std::cos(azimuth_used_rad);
      altitude_m += dt * manoeuvre.climb_rate_mps.value(rates_at_s);
      azimuth_rad += dt * turn_rate_radps(heading_at_s);
    };
    switch (integrator) {
      case Integrator::kFine: {
        const int substeps = static_cast<int>(std::ceil(step_s / 0.001));
        const double dt = step_s / substeps;
        for (int k = 0; k < substeps; ++k) {
          const double middle_s = t + (k + 0.5) * dt;
          advance(dt, middle_s, middle_s,
                  azimuth_rad + 0.5 * dt * turn_rate_radps(t + (k + 0.25) * dt));
        }
        break;
      }
      case Integrator::kExplicitEuler:
        advance(step_s, t, t, azimuth_rad);
        break;
      case Integrator::kSemiImplicitEuler:
        advance(step_s, t + step_s, t + step_s, azimuth_rad + step_s * turn_rate_radps(t + step_s));
        break;
    }
  }
  return trajectory;
}

/// A manoeuvre of random banks, climbs and speeds that keeps every limit, some of them just so.
inline Manoeuvre random_manoeuvre(std::mt19937_64& random, const flight::Limits& limits) {
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  Manoeuvre manoeuvre;
  manoeuvre.duration_s = 40.0;
  manoeuvre.azimuth_grid_rad = uniform(0.0, 2.0 * kPi);
  manoeuvre.speed_mps = Schedule(uniform(limits.speed_min_mps, limits.speed_max_mps));
  for (double t = uniform(0.0, 2.0); t < manoeuvre.duration_s;) {
    const double to = uniform(-1.0, 1.0) * limits.bank_max_rad;
    const double rise = std::fabs(to - manoeuvre.bank_rad.last());
    const double duration_s =
        std::max({1.875 * rise / limits.roll_rate_max_radps, std::sqrt(5.774 * rise / 8.0),
                  std::cbrt(60.0 * rise / 35.0)});
    manoeuvre.bank_rad.ramp(t, duration_s, to);
    t += duration_s + uniform(0.1, 6.0);
  }
  for (double t = uniform(0.0, 2.0); t < manoeuvre.duration_s;) {
    const double to = uniform(-limits.descent_rate_max_mps, limits.climb_rate_max_mps);
    const double rise = std::fabs(to - manoeuvre.climb_rate_mps.last());
    const double duration_s =
        std::max({1.875 * rise / limits.vertical_acceleration_max_mps2, std::sqrt(rise), 0.3});
    manoeuvre.climb_rate_mps.ramp(t, duration_s, to);
    t += duration_s + uniform(0.1, 6.0);
  }
  for (double t = uniform(0.0, 5.0); t < manoeuvre.duration_s;) {
    const double to = uniform(limits.speed_min_mps, limits.speed_max_mps);
    const double rise = std::fabs(to - manoeuvre.speed_mps.last());
    const double duration_s =
        std::max(1.875 * rise / (kG_mps2 * std::tan(limits.pitch_max_rad)), 2.0);
    manoeuvre.speed_mps.ramp(t, duration_s, to);
    t += duration_s + uniform(0.0, 10.0);
  }
  return manoeuvre;
}

/// Lifts a flight as a whole.
inline void lift(flight::Trajectory& trajectory, double by_m) {
  for (flight::FlightState& state : trajectory.states) {
    state.altitude_m += by_m;
  }
}

}  // namespace hedgehop::test
