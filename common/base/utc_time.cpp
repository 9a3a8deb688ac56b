#include "base/utc_time.hpp"

#include <array>
#include <charconv>
#include <cstdio>

namespace hedgehop {
namespace {

constexpr std::int64_t kSecondsOfDay = 86400;
constexpr int kYearMin = 1970;
constexpr int kYearMax = 2200;

bool is_leap(int year) { return year % 4 == 0 && (year % 100 != 0 || year % 400 == 0); }

int days_of_month(int year, int month) {
  constexpr std::array<int, 12> kDays = {31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31};
  return kDays[static_cast<std::size_t>(month - 1)] + (month == 2 && is_leap(year) ? 1 : 0);
}

int days_of_year(int year) { return is_leap(year) ? 366 : 365; }

// Takes the text apart from its beginning.
class Cursor {
 public:
  explicit Cursor(std::string_view text) : rest_(text) {}

  [[nodiscard]] bool is_at_end() const { return rest_.empty(); }
  bool take(char wanted) {
    if (rest_.empty() || rest_.front() != wanted) {
      return false;
    }
    rest_.remove_prefix(1);
    return true;
  }
  // Exactly so many digits, within a range.
  std::optional<int> number(std::size_t digits, int least, int greatest) {
    int value = 0;
    if (rest_.size() < digits || rest_.front() == '-') {
      return std::nullopt;
    }
    const auto [end, error] = std::from_chars(rest_.data(), rest_.data() + digits, value);
    if (error != std::errc() || end != rest_.data() + digits || value < least || value > greatest) {
      return std::nullopt;
    }
    rest_.remove_prefix(digits);
    return value;
  }
  // The digits behind a decimal point as microseconds.
  std::optional<std::int64_t> fraction_us() {
    std::int64_t value = 0;
    std::int64_t unit = 100'000;
    std::size_t digits = 0;
    for (; !rest_.empty() && rest_.front() >= '0' && rest_.front() <= '9'; ++digits) {
      value += unit * (rest_.front() - '0');
      unit /= 10;
      rest_.remove_prefix(1);
    }
    return digits == 0 ? std::nullopt : std::optional(value);
  }

 private:
  std::string_view rest_;
};

}  // namespace

std::optional<Time> parse_utc(std::string_view text) {
  Cursor cursor(text);
  const auto year = cursor.number(4, kYearMin, kYearMax);
  if (!year || !cursor.take('-')) {
    return std::nullopt;
  }
  const auto month = cursor.number(2, 1, 12);
  if (!month || !cursor.take('-')) {
    return std::nullopt;
  }
  const auto day = cursor.number(2, 1, days_of_month(*year, *month));
  if (!day || !(cursor.take('T') || cursor.take(' '))) {
    return std::nullopt;
  }
  const auto hour = cursor.number(2, 0, 23);
  if (!hour || !cursor.take(':')) {
    return std::nullopt;
  }
  const auto minute = cursor.number(2, 0, 59);
  if (!minute) {
    return std::nullopt;
  }
  std::int64_t second = 0;
  std::int64_t fraction_us = 0;
  if (cursor.take(':')) {
    const auto whole = cursor.number(2, 0, 59);
    if (!whole) {
      return std::nullopt;
    }
    second = *whole;
    if (cursor.take('.')) {
      const auto part = cursor.fraction_us();
      if (!part) {
        return std::nullopt;
      }
      fraction_us = *part;
    }
  }
  std::int64_t ahead_s = 0;  // of the zone
  if (!cursor.take('Z')) {
    const bool is_west = cursor.take('-');
    if (!is_west && !cursor.take('+')) {
      return std::nullopt;
    }
    const auto zone_hour = cursor.number(2, 0, 14);
    if (!zone_hour || !cursor.take(':')) {
      return std::nullopt;
    }
    const auto zone_minute = cursor.number(2, 0, 59);
    if (!zone_minute) {
      return std::nullopt;
    }
    ahead_s = (is_west ? -1 : 1) * (3600 * *zone_hour + 60 * *zone_minute);
  }
  if (!cursor.is_at_end()) {
    return std::nullopt;
  }
  std::int64_t days = *day - 1;
  for (int y = kYearMin; y < *year; ++y) {
    days += days_of_year(y);
  }
  for (int m = 1; m < *month; ++m) {
    days += days_of_month(*year, m);
  }
  const std::int64_t seconds =
      days * kSecondsOfDay + 3600 * *hour + 60 * *minute + second - ahead_s;
  if (seconds < 0) {
    return std::nullopt;
  }
  return Time{seconds * 1'000'000 + fraction_us};
}

std::string utc_text(Time time) {
  const std::int64_t milliseconds = time.utime_us / 1000;
  std::int64_t days = milliseconds / 1000 / kSecondsOfDay;
  const std::int64_t in_day_ms = milliseconds - days * kSecondsOfDay * 1000;
  int year = kYearMin;
  for (; days >= days_of_year(year); ++year) {
    days -= days_of_year(year);
  }
  int month = 1;
  for (; days >= days_of_month(year, month); ++month) {
    days -= days_of_month(year, month);
  }
  std::array<char, 64> buffer{};
  const auto part = [&](std::int64_t unit_ms, std::int64_t count) {
    return static_cast<int>(in_day_ms / unit_ms % count);
  };
  std::snprintf(buffer.data(), buffer.size(), "%04d-%02d-%02dT%02d:%02d:%02d.%03dZ", year, month,
                static_cast<int>(days) + 1, part(3'600'000, 24), part(60'000, 60), part(1000, 60),
                part(1, 1000));
  return buffer.data();
}

}  // namespace hedgehop
