#include "global_planning/slope_limits.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace hedgehop::global_planning {
namespace {

constexpr double kLow_m = -500.0;
constexpr double kStep_m = 25.0;
constexpr std::size_t kCount = 381;

}  // namespace

SlopeLimits::SlopeLimits(double up, double down,
                         const std::function<Tangents(double altitude_m)>& at)
    : in_air_{up, down} {
  auto table = std::make_shared<std::vector<Tangents>>();
  Tangents least = in_air_;
  for (std::size_t i = 0; i < kCount; ++i) {
    const Tangents here = at(kLow_m + static_cast<double>(i) * kStep_m);
    least = {std::min(least.up, here.up), std::min(least.down, here.down)};
    table->push_back(least);
  }
  in_air_ = table->front();
  greatest_ = in_air_;
  table_ = std::move(table);
}

SlopeLimits SlopeLimits::in_wind(const flight::Wind& wind, double airspeed_mps) const {
  SlopeLimits result = *this;
  result.wind_ = wind;
  result.airspeed_mps_ = airspeed_mps;
  result.greatest_ = wind.is_calm() ? in_air_ : result.in_best_direction(in_air_);
  return result;
}

double SlopeLimits::factor(double dx_m, double dy_m) const {
  const double length_m = std::sqrt(dx_m * dx_m + dy_m * dy_m);
  if (!(length_m > 0.0)) {
    return airspeed_mps_ / (airspeed_mps_ + wind_.speed_mps());
  }
  return airspeed_mps_ /
         flight::ground_speed_mps(wind_, airspeed_mps_, dx_m / length_m, dy_m / length_m);
}

// Climbs are steepest against the wind; a sink that must be is flattest with it.
SlopeLimits::Tangents SlopeLimits::in_best_direction(const Tangents& in_air) const {
  const double slowest = airspeed_mps_ / (airspeed_mps_ - wind_.speed_mps());
  const double fastest = airspeed_mps_ / (airspeed_mps_ + wind_.speed_mps());
  return {in_air.up * (in_air.up > 0.0 ? slowest : fastest),
          in_air.down * (in_air.down > 0.0 ? slowest : fastest)};
}

SlopeLimits::Tangents SlopeLimits::interpolated(double altitude_m) const {
  const std::vector<Tangents>& table = *table_;
  const double place =
      std::clamp((altitude_m - kLow_m) / kStep_m, 0.0, static_cast<double>(kCount - 1));
  const auto below = std::min(static_cast<std::size_t>(place), kCount - 2);
  const double share = place - static_cast<double>(below);
  const Tangents& a = table[below];
  const Tangents& b = table[below + 1];
  return {a.up + share * (b.up - a.up), a.down + share * (b.down - a.down)};
}

}  // namespace hedgehop::global_planning
