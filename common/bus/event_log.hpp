#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/hash.hpp"
#include "base/time.hpp"

/// LCM log files. Each event, big-endian: u32 0xEDA1DA01, i64 number, i64 receive time [us], i32
/// length of the channel name, i32 length of the message, name, message. No checksum and no index.
namespace hedgehop::bus {

struct LogEvent {
  std::int64_t number = 0;
  Time receive_time;
  std::string channel;
  Bytes bytes;

  bool operator==(const LogEvent&) const = default;
};

/// Reads a log from front to back and gets over damage: from a place that is no event it goes on at
/// the next one that is whole and followed by another event or the end.
class EventLogReader {
 public:
  /// Throws DataError if the file cannot be read or holds no event at all.
  explicit EventLogReader(const std::filesystem::path& path);
  ~EventLogReader();
  EventLogReader(EventLogReader&&) noexcept;
  EventLogReader& operator=(EventLogReader&&) noexcept;

  /// The next event; none at the end.
  std::optional<LogEvent> next();

  /// Bytes that belonged to no event so far, and how many stretches of them.
  [[nodiscard]] std::int64_t skipped_bytes() const;
  [[nodiscard]] std::int64_t damage_count() const;
  /// The first thousand of these stretches.
  struct Damage {
    std::int64_t offset = 0;
    std::int64_t bytes = 0;
    bool is_at_end = false;  // nothing comes after it: an event that was cut off, for example
  };
  [[nodiscard]] const std::vector<Damage>& damages() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Writes a log. Events reach the disk `flush_interval_s` after write() at the latest, and outlive
/// this process after a quarter of that, provided that flush_if_due() is called meanwhile; and when
/// the writer goes.
class EventLogWriter {
 public:
  /// Throws SystemFailure. An existing file is overwritten only if `overwrite`; else UsageError.
  EventLogWriter(const std::filesystem::path& path, bool overwrite, double flush_interval_s);
  ~EventLogWriter();
  EventLogWriter(const EventLogWriter&) = delete;
  EventLogWriter& operator=(const EventLogWriter&) = delete;

  /// Throws SystemFailure when the disk is full; the file then ends with a whole event, and
  /// nothing can be written to it any more.
  void write(Time receive_time, const std::string& channel, ByteView bytes);
  /// Hands events to the system if the oldest one that waits is older than a quarter of the
  /// interval, and has them brought to disk by a thread of its own if it is older than the
  /// interval.
  void flush_if_due(Time now);
  void flush();

  /// In the file or about to be; what was lost when the disk was full does not count.
  [[nodiscard]] std::int64_t event_count() const;
  [[nodiscard]] std::int64_t byte_count() const;
  /// Of whole events that the file has taken.
  [[nodiscard]] std::int64_t written_bytes() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace hedgehop::bus
