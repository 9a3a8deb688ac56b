#include "bus/event_log.hpp"

#include <fstream>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>
#include <unistd.h>

#include "base/errors.hpp"
#include "base/files.hpp"

namespace hedgehop::bus {
namespace {

namespace fs = std::filesystem;

class EventLog : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "hedgehop_log_XXXXXX").string();
    ASSERT_NE(::mkdtemp(name.data()), nullptr);
    folder_ = name;
    path_ = folder_ / "log";
  }
  void TearDown() override { fs::remove_all(folder_); }

  void write_events(int count) {
    EventLogWriter writer(path_, true, 0.1);
    for (int i = 0; i < count; ++i) {
      writer.write(Time{1'000'000 + i}, "CHANNEL_" + std::to_string(i % 3),
                   Bytes(static_cast<std::size_t>(i % 50), static_cast<std::byte>(i)));
    }
  }

  /// Numbers of the events that can be read.
  std::vector<std::int64_t> read_numbers(EventLogReader& reader) {
    std::vector<std::int64_t> numbers;
    while (const auto event = reader.next()) {
      numbers.push_back(event->number);
    }
    return numbers;
  }

  void overwrite(std::int64_t at, const std::string& bytes) {
    std::fstream file(path_, std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(at);
    file.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  }

  /// Place of event k: 28 bytes of header, 9 of the name, k % 50 of the message.
  static std::int64_t place(int k) {
    std::int64_t at = 0;
    for (int i = 0; i < k; ++i) {
      at += 28 + 9 + i % 50;
    }
    return at;
  }

  fs::path folder_;
  fs::path path_;
};

TEST_F(EventLog, TheFormatIsThatOfLcm) {
  {
    EventLogWriter writer(path_, false, 0.1);
    writer.write(Time{0x0102030405060708}, "AB", bytes_of("xyz"));
  }
  const std::string expected(
      "\xED\xA1\xDA\x01\0\0\0\0\0\0\0\0\1\2\3\4\5\6\7\x08\0\0\0\2\0\0\0\3ABxyz", 33);
  EXPECT_EQ(read_file(path_), expected);
}

TEST_F(EventLog, WhatIsWrittenIsRead) {
  write_events(500);
  EventLogReader reader(path_);
  for (int i = 0; i < 500; ++i) {
    const auto event = reader.next();
    ASSERT_TRUE(event);
    EXPECT_EQ(event->number, i);
    EXPECT_EQ(event->receive_time.utime_us, 1'000'000 + i);
    EXPECT_EQ(event->channel, "CHANNEL_" + std::to_string(i % 3));
    EXPECT_EQ(event->bytes, Bytes(static_cast<std::size_t>(i % 50), static_cast<std::byte>(i)));
  }
  EXPECT_FALSE(reader.next());
  EXPECT_EQ(reader.skipped_bytes(), 0);
}

TEST_F(EventLog, ADestroyedSyncWordCostsOneEvent) {
  write_events(500);
  overwrite(place(250), "####");
  EventLogReader reader(path_);
  const auto numbers = read_numbers(reader);
  EXPECT_EQ(numbers.size(), 499U);
  EXPECT_THAT(numbers, testing::Not(testing::Contains(250)));
  EXPECT_EQ(reader.damage_count(), 1);
}

TEST_F(EventLog, AnAbsurdLengthCostsOneEventAndNoMemory) {
  write_events(500);
  for (const std::string length : {"\x7f\xff\xff\xff", "\xff\xff\xff\xff", "\0\x0f\xff\xff"}) {
    overwrite(place(250) + 24, length.size() == 4 ? length : std::string("\0\x0f\xff\xff", 4));
    EventLogReader reader(path_);
    EXPECT_EQ(read_numbers(reader).size(), 499U);
  }
}

TEST_F(EventLog, ALengthThatReachesIntoTheNextEventsCostsOneEvent) {
  write_events(500);
  overwrite(place(250) + 24, std::string("\0\0\0\x80", 4));  // 128 bytes instead of none
  EventLogReader reader(path_);
  const auto numbers = read_numbers(reader);
  EXPECT_EQ(numbers.size(), 499U);
  EXPECT_THAT(numbers, testing::Contains(251));
}

TEST_F(EventLog, ATruncatedEndCostsOneEvent) {
  write_events(500);
  fs::resize_file(path_, fs::file_size(path_) - 5);
  EventLogReader reader(path_);
  EXPECT_EQ(read_numbers(reader).size(), 499U);
}

TEST_F(EventLog, SyncWordsInsideMessagesDoNotConfuse) {
  {
    EventLogWriter writer(path_, false, 0.1);
    for (int i = 0; i < 100; ++i) {
      writer.write(Time{i}, "A", bytes_of("\xED\xA1\xDA\x01\xED\xA1\xDA\x01"));
    }
  }
  EventLogReader reader(path_);
  EXPECT_EQ(read_numbers(reader).size(), 100U);
  EXPECT_EQ(reader.damage_count(), 0);
}

TEST_F(EventLog, ALengthThatReachesOverMoreDamageCostsNoMoreThanThatDamage) {
  write_events(500);
  overwrite(place(250) + 24, std::string("\0\0\x10\0", 4));  // 4096 bytes instead of none
  overwrite(place(252), "####");
  EventLogReader reader(path_);
  const auto numbers = read_numbers(reader);
  // 251 is followed by damage, and nothing before it tells that it is an event
  EXPECT_EQ(numbers.size(), 497U);
  EXPECT_THAT(numbers, testing::IsSupersetOf({249, 253}));
}

TEST_F(EventLog, ALengthThatByChanceEndsAtALaterEventCostsOneEvent) {
  write_events(500);
  const auto message_bytes = static_cast<std::uint32_t>(place(300) - place(250) - 28 - 9);
  std::string length;
  for (int i = 3; i >= 0; --i) {
    length.push_back(static_cast<char>(message_bytes >> (8 * i)));
  }
  overwrite(place(250) + 24, length);
  overwrite(place(251), "####");
  EventLogReader reader(path_);
  const auto numbers = read_numbers(reader);
  EXPECT_EQ(numbers.size(), 498U);
  EXPECT_THAT(numbers, testing::IsSupersetOf({249, 252, 299, 300}));
}

TEST_F(EventLog, ALogInAMessageStaysAMessageWhereNumbersAreConsecutive) {
  write_events(20);
  const std::string inner = read_file(path_);
  {
    EventLogWriter writer(path_, true, 0.1);
    for (int i = 0; i < 5; ++i) {
      writer.write(Time{i}, "LOG", bytes_of(inner));
    }
  }
  EventLogReader reader(path_);
  EXPECT_EQ(read_numbers(reader).size(), 5U);
  EXPECT_EQ(reader.damage_count(), 0);
}

TEST_F(EventLog, RandomDamageNeverCrashesAndLosesLittle) {
  const unsigned seed = std::random_device{}();
  std::cout << "seed " << seed << '\n';
  std::mt19937 random(seed);
  for (int round = 0; round < 30; ++round) {
    write_events(300);
    const auto size = static_cast<std::int64_t>(fs::file_size(path_));
    for (int hit = 0; hit < 5; ++hit) {
      overwrite(static_cast<std::int64_t>(random()) % size,
                std::string(1, static_cast<char>(random())));
    }
    EventLogReader reader(path_);
    EXPECT_GE(read_numbers(reader).size(), 280U);
  }
}

TEST_F(EventLog, FilesThatAreNoLogAreRefusedWithTheirName) {
  EXPECT_THROW(EventLogReader(folder_ / "absent"), DataError);
  EXPECT_THROW(EventLogReader{folder_}, DataError);
  std::ofstream(path_) << "this is no log at all, but long enough to hold an event or two of one";
  try {
    EventLogReader reader(path_);
    FAIL();
  } catch (const DataError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr(path_.string()));
  }
}

TEST_F(EventLog, EventsOutliveTheProcessAfterAQuarterOfTheInterval) {
  EventLogWriter writer(path_, false, 0.1);
  writer.write(Time{1'000'000}, "A", bytes_of("x"));
  EXPECT_EQ(fs::file_size(path_), 0U);
  writer.flush_if_due(Time{1'020'000});
  EXPECT_EQ(fs::file_size(path_), 0U);
  writer.flush_if_due(Time{1'025'000});
  EXPECT_EQ(fs::file_size(path_), 30U);
  // The next ones too, before and after they are brought to disk.
  writer.write(Time{1'090'000}, "A", bytes_of("y"));
  writer.flush_if_due(Time{1'100'000});
  EXPECT_EQ(fs::file_size(path_), 60U);
  writer.write(Time{1'110'000}, "A", bytes_of("z"));
  writer.write(Time{1'136'000}, "A", bytes_of("z"));
  EXPECT_EQ(fs::file_size(path_), 120U);
}

TEST_F(EventLog, AnExistingFileIsNotOverwrittenUnasked) {
  write_events(3);
  EXPECT_THROW(EventLogWriter(path_, false, 0.1), UsageError);
  EXPECT_NO_THROW(EventLogWriter(path_, true, 0.1));
}

TEST_F(EventLog, AFullDiskIsSaidAndLeavesWholeEvents) {
  if (!fs::exists("/dev/full")) {
    GTEST_SKIP() << "no /dev/full here";
  }
  EventLogWriter writer("/dev/full", true, 0.1);
  writer.write(Time{1}, "A", bytes_of("x"));
  EXPECT_THROW(writer.flush(), SystemFailure);
}

}  // namespace
}  // namespace hedgehop::bus
