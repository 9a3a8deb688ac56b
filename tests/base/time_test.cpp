#include "base/time.hpp"

#include <algorithm>
#include <atomic>
#include <gtest/gtest.h>
#include <stdexcept>

#include "base/errors.hpp"
#include "base/observer.hpp"
#include "base/shipped_config.hpp"

namespace hedgehop {
namespace {

TEST(Time, SecondsAndMicrosecondsAgree) {
  const Time start{1'700'000'000'000'000};
  EXPECT_EQ((start + 1.5).utime_us, 1'700'000'001'500'000);
  EXPECT_DOUBLE_EQ(seconds_between(start, start + 2.25), 2.25);
  EXPECT_DOUBLE_EQ(seconds_between(start + 1.0, start), -1.0);
  EXPECT_LT(start, start + 0.001);
}

TEST(Errors, EachKindHasItsExitCode) {
  EXPECT_EQ(UsageError("x").code(), ExitCode::kUsage);
  EXPECT_EQ(ConfigError("x").code(), ExitCode::kUsage);
  EXPECT_EQ(DataError("x").code(), ExitCode::kBadData);
  EXPECT_EQ(SystemFailure("x").code(), ExitCode::kFailure);
  EXPECT_EQ(BusError("x").code(), ExitCode::kBusUnreachable);
  EXPECT_EQ(Interrupted().code(), ExitCode::kInterrupted);
  EXPECT_EQ(DataError("what", "do this").hint(), "do this");
  EXPECT_STREQ(DataError("what", "do this").what(), "what");
}

TEST(Errors, BrokenInvariantNamesConditionAndPlace) {
  try {
    HEDGEHOP_ASSERT(1 + 1 == 3);
    FAIL() << "not thrown";
  } catch (const std::logic_error& error) {
    const std::string what = error.what();
    EXPECT_NE(what.find("1 + 1 == 3"), std::string::npos) << what;
    EXPECT_NE(what.find("time_test.cpp:"), std::string::npos) << what;
    EXPECT_EQ(what.find('/'), std::string::npos) << "no folder of the build machine: " << what;
  }
}

TEST(Observer, StopRequestEndsWorkAsInterrupted) {
  class Stopping final : public Observer {
   public:
    void progress(std::string_view, double, double) override {}
    void note(std::string_view) override {}
    [[nodiscard]] bool stop_requested() const override { return is_stopping; }
    std::atomic<bool> is_stopping{false};
  };
  Stopping observer;
  EXPECT_NO_THROW(observer.check_stop());
  observer.is_stopping = true;
  EXPECT_THROW(observer.check_stop(), Interrupted);
  EXPECT_NO_THROW(SilentObserver().check_stop());
}

TEST(ShippedConfig, NamesAreSortedAndUnknownOnesRefused) {
  const auto names = shipped_config_names();
  EXPECT_TRUE(std::is_sorted(names.begin(), names.end()));
  EXPECT_NE(std::find(names.begin(), names.end(), "planning.yaml"), names.end());
  EXPECT_THROW(shipped_config("nothing.yaml"), std::invalid_argument);
}

}  // namespace
}  // namespace hedgehop
