#include "bus/log_tools.hpp"

#include <algorithm>
#include <array>
#include <string_view>

#include "base/errors.hpp"
#include "bus/sequence_gaps.hpp"
#include "messages/channels.hpp"
#include "messages/message_error.hpp"

namespace hedgehop::bus {
namespace {

constexpr std::int64_t kStopInterval = 1024;

void check_stop(std::int64_t events, const Observer& observer) {
  if (events % kStopInterval == 0 && observer.stop_requested()) {
    throw Interrupted();
  }
}

// Id of the request that a message of this channel belongs to; empty if it is none.
template <typename T>
std::string request_of(const LogEvent& event, const messages::Channel<T>& channel) {
  if (!event.channel.ends_with(channel.name)) {
    return {};
  }
  try {
    messages::Stamp stamp;
    return messages::from_message<T>(event.bytes, stamp).request_id.hex();
  } catch (const messages::MessageError&) {  // counted as an event all the same
    return {};
  }
}

bool is_selected(const LogEvent& event, Time begin, const LogSelection& selection) {
  constexpr std::array<std::string_view, 3> kBlobs = {messages::kMapIndexChannel.name,
                                                      messages::kChunkChannel.name,
                                                      messages::kChunkRequestChannel.name};
  if (selection.with_blobs && std::any_of(kBlobs.begin(), kBlobs.end(), [&](std::string_view name) {
        return event.channel.ends_with(name);
      })) {
    return true;
  }
  const double time_s = seconds_between(begin, event.receive_time);
  if ((selection.from_s && time_s < *selection.from_s) ||
      (selection.to_s && time_s > *selection.to_s)) {
    return false;
  }
  return selection.channels.empty() ||
         std::any_of(selection.channels.begin(), selection.channels.end(),
                     [&](std::string_view wanted) {
                       return wanted.ends_with('*')
                                  ? event.channel.starts_with(wanted.substr(0, wanted.size() - 1))
                                  : event.channel == wanted;
                     });
}

}  // namespace

LogSummary summarize_log(const std::filesystem::path& log, Observer& observer) {
  LogSummary summary;
  SequenceGaps gaps;
  EventLogReader reader(log);
  Time before;
  while (const auto event = reader.next()) {
    check_stop(summary.events, observer);
    if (summary.events++ == 0) {
      summary.begin = event->receive_time;
    } else if (event->receive_time < before) {
      ++summary.backward_times;
    }
    before = event->receive_time;
    summary.end = std::max(summary.end, event->receive_time);
    ChannelCount& count = summary.channels[event->channel];
    ++count.events;
    count.bytes += static_cast<std::int64_t>(event->bytes.size());
    if (const auto stamp = messages::peek_stamp(event->channel, event->bytes)) {
      gaps.note(event->channel, *stamp);
    }
    if (const auto id = request_of(*event, messages::kPlanRequestChannel); !id.empty()) {
      summary.requests.try_emplace(id);
    }
    if (const auto id = request_of(*event, messages::kRouteChannel); !id.empty()) {
      summary.requests[id].has_route = true;
    }
    if (const auto id = request_of(*event, messages::kTrajectoryChannel); !id.empty()) {
      summary.requests[id].has_trajectory = true;
    }
  }
  summary.missing_by_sender = gaps.missing_by_sender();
  summary.damage_count = reader.damage_count();
  summary.skipped_bytes = reader.skipped_bytes();
  summary.damages = reader.damages();
  return summary;
}

LogCopy copy_logs(const std::vector<std::filesystem::path>& logs, const LogSelection& selection,
                  const std::filesystem::path& out, bool overwrite, Observer& observer) {
  HEDGEHOP_ASSERT(!logs.empty());
  std::error_code error;
  for (const std::filesystem::path& log : logs) {
    if (std::filesystem::equivalent(log, out, error)) {
      throw UsageError(out.string() + ": is one of the logs that are read", "give another --out");
    }
  }
  if (!overwrite && std::filesystem::exists(out, error)) {
    throw UsageError(out.string() + ": exists already",
                     "choose another name, or allow overwriting with --overwrite");
  }
  struct Source {
    EventLogReader reader;
    std::optional<LogEvent> head;
  };
  std::vector<Source> sources;
  for (const std::filesystem::path& log : logs) {
    Source source{EventLogReader(log), std::nullopt};
    source.head = source.reader.next();
    sources.push_back(std::move(source));
  }
  const auto earliest = [&]() -> Source* {
    Source* first = nullptr;
    for (Source& source : sources) {
      if (source.head &&
          (first == nullptr || source.head->receive_time < first->head->receive_time)) {
        first = &source;
      }
    }
    return first;
  };
  LogCopy copy;
  std::filesystem::path temporary = out;
  temporary += ".part";
  try {
    EventLogWriter writer(temporary, true, 3600.0);
    const Source* first = earliest();
    const Time begin = first != nullptr ? first->head->receive_time : Time{};
    while (Source* source = earliest()) {
      check_stop(copy.events_read++, observer);
      if (is_selected(*source->head, begin, selection)) {
        writer.write(source->head->receive_time, source->head->channel, source->head->bytes);
        ++copy.events_written;
      }
      source->head = source->reader.next();
    }
    writer.flush();
  } catch (...) {
    std::filesystem::remove(temporary, error);
    throw;
  }
  for (const Source& source : sources) {
    copy.damage_count += source.reader.damage_count();
    copy.skipped_bytes += source.reader.skipped_bytes();
  }
  std::filesystem::rename(temporary, out, error);
  if (error) {
    std::filesystem::remove(temporary);
    throw SystemFailure(out.string() + ": cannot be written: " + error.message());
  }
  return copy;
}

}  // namespace hedgehop::bus
