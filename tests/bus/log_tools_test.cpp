#include "bus/log_tools.hpp"

#include <filesystem>
#include <fstream>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/errors.hpp"
#include "base/files.hpp"
#include "bus/event_log_parts.hpp"
#include "bus/sequence_gaps.hpp"
#include "messages/channels.hpp"
#include "support/temporary_folder.hpp"

namespace hedgehop::bus {
namespace {

namespace fs = std::filesystem;
using messages::PlanCancel;
using messages::Stamp;
using testing::ElementsAre;
using testing::HasSubstr;

class LogTools : public testing::Test {
 protected:
  fs::path path(const std::string& name) const { return folder_.path() / name; }

  // Events at these seconds; the message of each is its second in text.
  fs::path log_of(const std::string& name, const std::string& channel,
                  const std::vector<int>& seconds) {
    EventLogWriter writer(path(name), true, 0.1);
    for (const int second : seconds) {
      writer.write(Time{1'000'000LL * second}, channel, bytes_of(std::to_string(second)));
    }
    return path(name);
  }

  static std::vector<std::string> texts(const fs::path& log) {
    EventLogReader reader(log);
    std::vector<std::string> found;
    while (const auto event = reader.next()) {
      EXPECT_EQ(event->number, static_cast<std::int64_t>(found.size()));
      found.emplace_back(reinterpret_cast<const char*>(event->bytes.data()), event->bytes.size());
    }
    EXPECT_EQ(reader.damage_count(), 0);
    return found;
  }

  test::TemporaryFolder folder_;
  SilentObserver observer_;
};

TEST_F(LogTools, ARepairedLogHoldsEveryEventButTheDamagedOneAndNoDamage) {
  const fs::path log = log_of("log", "CHANNEL", {10, 11, 12, 13, 14});
  {
    std::fstream file(log, std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(2 * (28 + 7 + 2));  // sync word of the third event
    file.write("xxxx", 4);
  }
  const LogSummary before = summarize_log(log, observer_);
  EXPECT_EQ(before.damage_count, 1);
  ASSERT_EQ(before.damages.size(), 1U);
  EXPECT_EQ(before.damages[0].offset, 2 * 37);
  EXPECT_EQ(before.damages[0].bytes, 37);
  EXPECT_FALSE(before.damages[0].is_at_end);
  const LogCopy copy = copy_logs({log}, {}, path("whole"), false, observer_);
  EXPECT_EQ(copy.events_written, 4);
  EXPECT_EQ(copy.skipped_bytes, 37);
  EXPECT_THAT(texts(path("whole")), ElementsAre("10", "11", "13", "14"));
  EXPECT_FALSE(fs::exists(path("whole.part")));
}

TEST_F(LogTools, ACutKeepsTheSecondsAndChannelsThatAreAskedForAndBlobsWhereWanted) {
  const fs::path a = log_of("a", "ROUTE", {100, 101, 102, 103, 104});
  const fs::path b = log_of("b", "CHUNK", {100, 104});
  LogSelection selection;
  selection.from_s = 1.0;
  selection.to_s = 3.0;
  copy_logs({a, b}, selection, path("time"), false, observer_);
  EXPECT_THAT(texts(path("time")), ElementsAre("101", "102", "103"));
  selection.with_blobs = true;
  copy_logs({a, b}, selection, path("blobs"), false, observer_);
  EXPECT_THAT(texts(path("blobs")), ElementsAre("100", "101", "102", "103", "104"));
  LogSelection routes;
  routes.channels = {"ROU*", "CHUN"};
  copy_logs({a, b}, routes, path("routes"), false, observer_);
  EXPECT_THAT(texts(path("routes")), ElementsAre("100", "101", "102", "103", "104"));
}

TEST_F(LogTools, LogsAreJoinedByTimeAndEachKeepsItsOwnOrder) {
  const fs::path late = log_of("late", "B", {30, 50, 40});
  const fs::path early = log_of("early", "A", {10, 35, 60});
  copy_logs({late, early}, {}, path("joined"), false, observer_);
  EXPECT_THAT(texts(path("joined")), ElementsAre("10", "30", "35", "50", "40", "60"));
}

TEST_F(LogTools, NothingIsOverwrittenUnaskedAndNoLogOntoItself) {
  const fs::path log = log_of("log", "A", {1, 2});
  EXPECT_THROW(copy_logs({log}, {}, log, true, observer_), UsageError);
  const fs::path other = log_of("other", "A", {3});
  EXPECT_THROW(copy_logs({log}, {}, other, false, observer_), UsageError);
  EXPECT_THAT(texts(other), ElementsAre("3"));
  EXPECT_NO_THROW(copy_logs({log}, {}, other, true, observer_));
  EXPECT_THAT(texts(other), ElementsAre("1", "2"));
  EXPECT_THROW(copy_logs({path("none")}, {}, path("new"), false, observer_), DataError);
  EXPECT_FALSE(fs::exists(path("new")));
}

TEST_F(LogTools, ASummaryCountsWhatEachSenderLeftOutAndStepsBackInTime) {
  {
    EventLogWriter writer(path("log"), true, 0.1);
    const auto add = [&](const std::string& channel, std::int64_t sender, std::int64_t seq,
                         std::int64_t second) {
      writer.write(Time{1'000'000 * second}, channel,
                   to_message(PlanCancel{{1, 2}}, Stamp{Time{1}, sender, seq}));
    };
    add("PLAN_CANCEL", 7, 100, 1);
    add("PLAN_CANCEL", 7, 104, 3);  // 101 to 103 are missing
    add("PLAN_CANCEL", 7, 102, 2);  // but this one was only late
    add("PLAN_CANCEL", 8, 5, 4);
    add("red_PLAN_CANCEL", 8, 50, 5);  // another channel has numbers of its own
    add("ELSEWHERE", 7, 900, 6);       // not ours
  }
  const LogSummary summary = summarize_log(path("log"), observer_);
  EXPECT_EQ(summary.events, 6);
  EXPECT_EQ(summary.backward_times, 1);
  EXPECT_EQ(summary.missing_by_sender, (std::map<std::int64_t, std::int64_t>{{7, 2}}));
  EXPECT_EQ(seconds_between(summary.begin, summary.end), 5.0);
}

TEST(SequenceGaps, HostileNumbersNeitherOverflowNorFillTheMemory) {
  SequenceGaps gaps;
  constexpr std::int64_t kLast = std::numeric_limits<std::int64_t>::max();
  gaps.note("A", Stamp{Time{}, 1, 1});
  gaps.note("A", Stamp{Time{}, 1, kLast});
  EXPECT_EQ(gaps.missing(), 0);  // nobody sends so many unheard
  for (std::int64_t sender = 2; sender < 10002; ++sender) {
    gaps.note("A", Stamp{Time{}, sender, 1});
    gaps.note("A", Stamp{Time{}, sender, 3});
  }
  // The count of a sender may be cut in two where the memory is cleared.
  EXPECT_LE(gaps.missing(), 10000);
  EXPECT_GE(gaps.missing(), 9990);
  EXPECT_LE(gaps.missing_by_sender().size(), 4097U);
}

TEST_F(LogTools, ALongLogGoesOnInPartsThatJoinToTheWhole) {
  std::vector<fs::path> parts = {path("log.lcmlog"), path("log.001.lcmlog"),
                                 path("log.003.lcmlog")};
  write_file_atomically(path("log.002.lcmlog"), std::string_view("somebody else's"));
  {
    EventLogParts log(parts[0], false, 0.1, 1000);
    for (int i = 10; i < 70; ++i) {  // 31 bytes each: 33 events fill a part
      log.write(Time{1'000'000LL * i}, "A", bytes_of(std::to_string(i)));
    }
    EXPECT_EQ(log.event_count(), 60);
    EXPECT_EQ(log.lost_count(), 0);
    EXPECT_EQ(log.part_count(), 2);
    for (int i = 70; i < 99; ++i) {
      log.write(Time{1'000'000LL * i}, "A", bytes_of(std::to_string(i)));
    }
    EXPECT_EQ(log.part_count(), 3);
  }
  EXPECT_EQ(fs::file_size(parts[0]), 33 * 31U);
  EXPECT_EQ(read_file(path("log.002.lcmlog")), "somebody else's");
  copy_logs(parts, {}, path("joined"), false, observer_);
  const auto joined = texts(path("joined"));
  ASSERT_EQ(joined.size(), 89U);
  for (int i = 0; i < 89; ++i) {
    EXPECT_EQ(joined[static_cast<std::size_t>(i)], std::to_string(i + 10));
  }
}

TEST_F(LogTools, AFullDiskIsToldAndTheLogGoesOnWhenThereIsRoom) {
  if (!fs::exists("/dev/full")) {
    GTEST_SKIP() << "no /dev/full here";
  }
  // The name leads to a disk without room, and later to a folder.
  fs::create_symlink("/dev/full", path("log.lcmlog"));
  EventLogParts log(path("log.lcmlog"), true, 0.1, 0);
  log.write(Time{1'000'000}, "A", bytes_of("lost"));
  log.flush_if_due(Time{1'200'000});
  EXPECT_THAT(log.failure(), HasSubstr("No space left"));
  EXPECT_EQ(log.event_count(), 0);
  log.write(Time{1'300'000}, "A", bytes_of("lost too"));
  EXPECT_EQ(log.lost_count(), 2);
  log.write(Time{2'300'000}, "A", bytes_of("kept"));
  log.flush_if_due(Time{2'500'000});
  EXPECT_EQ(log.failure(), "");
  EXPECT_EQ(log.event_count(), 1);
  EXPECT_EQ(log.lost_count(), 2);
  EXPECT_THAT(texts(path("log.001.lcmlog")), ElementsAre("kept"));
}

}  // namespace
}  // namespace hedgehop::bus
