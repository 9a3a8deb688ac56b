#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "bus/event_log.hpp"

namespace hedgehop::bus {

/// A log that goes on in further files, and goes on after the disk was full.
///
/// The first part has the given name, `flight.lcmlog`; the next ones are `flight.001.lcmlog` and so
/// on, with the first numbers that are free. A new part begins when one has reached its size, and
/// when one could not be written: a second of events later it is tried with another, so that all
/// that fits is kept. `hedgehop log cut` joins parts.
class EventLogParts {
 public:
  /// @param part_bytes_max  0: one file, however long
  /// Throws as EventLogWriter if the first part cannot be begun.
  EventLogParts(std::filesystem::path path, bool overwrite, double flush_interval_s,
                std::int64_t part_bytes_max);

  /// Never throws for a full disk: see failure().
  void write(Time receive_time, const std::string& channel, ByteView bytes);
  void flush_if_due(Time now);

  /// Why nothing can be written at present; empty while all is well.
  [[nodiscard]] const std::string& failure() const { return failure_; }
  [[nodiscard]] std::int64_t event_count() const;  // in all parts
  [[nodiscard]] std::int64_t byte_count() const;
  [[nodiscard]] std::int64_t lost_count() const { return told_count_ - event_count(); }
  [[nodiscard]] int part_count() const { return part_count_; }

 private:
  [[nodiscard]] std::filesystem::path part_name(int number) const;
  void begin_part();
  void end_part();
  void fail(const std::string& why, Time now);
  template <typename Action>
  void guarded(Time now, const Action& action);

  std::filesystem::path path_;
  bool is_overwriting_;
  double flush_interval_s_;
  std::int64_t part_bytes_max_;
  std::unique_ptr<EventLogWriter> writer_;  // of the present part; none while writing fails
  int part_count_ = 0;
  std::filesystem::path part_;
  int next_number_ = 0;
  std::int64_t told_count_ = 0;
  std::int64_t ended_events_ = 0;  // in the parts before
  std::int64_t ended_bytes_ = 0;
  std::string failure_;
  Time next_try_;
};

}  // namespace hedgehop::bus
