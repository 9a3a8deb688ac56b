#pragma once

#include <compare>
#include <cstdint>

namespace hedgehop {

/// A point in time: microseconds since the Unix epoch. Comes from messages; only `bus` reads a
/// clock.
struct Time {
  std::int64_t utime_us = 0;

  auto operator<=>(const Time&) const = default;
};

constexpr double seconds_between(Time from, Time to) {
  return static_cast<double>(to.utime_us - from.utime_us) * 1e-6;
}

constexpr Time operator+(Time time, double seconds) {
  return Time{time.utime_us + static_cast<std::int64_t>(seconds * 1e6)};
}

}  // namespace hedgehop
