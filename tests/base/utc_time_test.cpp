#include "base/utc_time.hpp"

#include <ctime>
#include <gtest/gtest.h>
#include <random>

#include "support/fresh_seed.hpp"

namespace hedgehop {
namespace {

TEST(UtcTime, TextsBecomeTheSecondsThatTheStandardLibraryCounts) {
  EXPECT_EQ(parse_utc("2000-01-01T00:00:00Z")->utime_us, 946'684'800'000'000);
  EXPECT_EQ(parse_utc("1970-01-01T00:00Z")->utime_us, 0);
  EXPECT_EQ(parse_utc("2026-05-01T08:30+02:00"), parse_utc("2026-05-01T06:30:00Z"));
  EXPECT_EQ(parse_utc("2026-04-30T20:15:00-10:15"), parse_utc("2026-05-01T06:30:00Z"));
  EXPECT_EQ(parse_utc("2024-02-29 12:00:00.25Z")->utime_us % 1'000'000, 250'000);
  std::mt19937_64 generator(test::fresh_seed());
  std::uniform_int_distribution<std::int64_t> seconds(0, 7'258'118'399);  // to the end of 2199
  for (int i = 0; i < 2000; ++i) {
    const std::time_t time = seconds(generator);
    std::tm parts{};
    gmtime_r(&time, &parts);
    char text[40];
    std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%S", &parts);
    EXPECT_EQ(utc_text({time * 1'000'000 + 123'999}), std::string(text) + ".123Z");
    EXPECT_EQ(parse_utc(std::string(text) + "Z")->utime_us, time * 1'000'000);
  }
}

TEST(UtcTime, WhatIsNoTimeIsRefused) {
  for (const char* text :
       {"", "2026-05-01", "2026-05-01T06:30", "2026-05-01T06:30:00", "2026-13-01T00:00Z",
        "2026-02-29T00:00Z", "2026-05-01T24:00Z", "2026-05-01T06:60Z", "2026-05-01T06:30:60Z",
        "2026-05-01T06:30:00.Z", "2026-05-01T06:30Zz", "26-05-01T06:30Z", "2026-05-01T06:30+2",
        "1969-12-31T23:59Z", "1970-01-01T00:00+01:00", "2026-05-01T-6:30Z", "tomorrow"}) {
    EXPECT_FALSE(parse_utc(text)) << text;
  }
}

}  // namespace
}  // namespace hedgehop
