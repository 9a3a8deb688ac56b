#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "base/observer.hpp"
#include "bus/event_log.hpp"

namespace hedgehop::bus {

struct ChannelCount {
  std::int64_t events = 0;
  std::int64_t bytes = 0;
};

/// What stands in a log, as far as it can be told without the blobs.
struct LogSummary {
  std::int64_t events = 0;
  Time begin;  // receive times
  Time end;
  std::int64_t backward_times = 0;  // events that were received before the one before them
  std::map<std::string, ChannelCount> channels;
  struct Request {
    bool has_route = false;
    bool has_trajectory = false;
  };
  std::map<std::string, Request> requests;                 // by id
  std::map<std::int64_t, std::int64_t> missing_by_sender;  // numbers that senders left out
  std::int64_t damage_count = 0;
  std::int64_t skipped_bytes = 0;
  std::vector<EventLogReader::Damage> damages;
};
/// Throws DataError, Interrupted.
LogSummary summarize_log(const std::filesystem::path& log, Observer& observer);

/// Which events to copy.
struct LogSelection {
  std::optional<double> from_s;  // after the first event of all
  std::optional<double> to_s;
  std::vector<std::string> channels;  // full names, or beginnings that end with *; empty: all
  bool with_blobs = false;            // MAP_INDEX, CHUNK and CHUNK_REQUEST of any time too
};

struct LogCopy {
  std::int64_t events_read = 0;
  std::int64_t events_written = 0;
  std::int64_t damage_count = 0;
  std::int64_t skipped_bytes = 0;
};

/// Copies what can be read of some logs into a new one, in the order of their receive times (of
/// one log: never out of its own order), numbered anew. The new log appears when it is complete.
/// Throws DataError, UsageError if `out` exists or is one of them, SystemFailure, Interrupted.
LogCopy copy_logs(const std::vector<std::filesystem::path>& logs, const LogSelection& selection,
                  const std::filesystem::path& out, bool overwrite, Observer& observer);

}  // namespace hedgehop::bus
