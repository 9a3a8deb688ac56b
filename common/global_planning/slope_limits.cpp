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
    : at_any_{up, down} {
  auto table = std::make_shared<std::vector<Tangents>>();
  Tangents least = at_any_;
  for (std::size_t i = 0; i < kCount; ++i) {
    const Tangents here = at(kLow_m + static_cast<double>(i) * kStep_m);
    least = {std::min(least.up, here.up), std::min(least.down, here.down)};
    table->push_back(least);
  }
  at_any_ = table->front();
  table_ = std::move(table);
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
