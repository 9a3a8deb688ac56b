#include "bus/event_log_parts.hpp"

#include <array>
#include <cstdio>
#include <utility>

#include "base/errors.hpp"

namespace hedgehop::bus {
namespace {

constexpr double kRetry_s = 1.0;

}  // namespace

EventLogParts::EventLogParts(std::filesystem::path path, bool overwrite, double flush_interval_s,
                             std::int64_t part_bytes_max)
    : path_(std::move(path)),
      is_overwriting_(overwrite),
      flush_interval_s_(flush_interval_s),
      part_bytes_max_(part_bytes_max) {
  begin_part();
}

std::filesystem::path EventLogParts::part_name(int number) const {
  if (number == 0) {
    return path_;
  }
  std::array<char, 16> text{};
  std::snprintf(text.data(), text.size(), ".%03d", number);
  return path_.parent_path() / (path_.stem().string() + text.data() + path_.extension().string());
}

void EventLogParts::begin_part() {
  std::error_code error;
  while (next_number_ > 0 && !is_overwriting_ &&
         std::filesystem::exists(part_name(next_number_), error)) {
    ++next_number_;
  }
  part_ = part_name(next_number_);
  writer_ = std::make_unique<EventLogWriter>(part_, is_overwriting_, flush_interval_s_);
  ++next_number_;
  ++part_count_;
}

void EventLogParts::end_part() {
  if (writer_) {
    ended_events_ += writer_->event_count();
    ended_bytes_ += writer_->byte_count();
    const bool is_empty = writer_->written_bytes() == 0;
    writer_.reset();
    std::error_code error;
    if (is_empty && std::filesystem::is_regular_file(part_, error)) {
      std::filesystem::remove(part_, error);
      --next_number_;
      --part_count_;
    }
  }
}

void EventLogParts::fail(const std::string& why, Time now) {
  end_part();
  failure_ = why;
  next_try_ = now + kRetry_s;
}

template <typename Action>
void EventLogParts::guarded(Time now, const Action& action) {
  try {
    if (!writer_ && now >= next_try_) {
      begin_part();
    }
    if (writer_) {
      action();
      if (writer_->written_bytes() > 0) {
        failure_.clear();
      }
    }
  } catch (const UserError& error) {
    fail(error.what(), now);
  }
}

void EventLogParts::write(Time receive_time, const std::string& channel, ByteView bytes) {
  ++told_count_;
  guarded(receive_time, [&] {
    writer_->write(receive_time, channel, bytes);
    if (part_bytes_max_ > 0 && writer_->byte_count() >= part_bytes_max_) {
      writer_->flush();
      end_part();
      begin_part();
    }
  });
}

void EventLogParts::flush_if_due(Time now) {
  guarded(now, [&] { writer_->flush_if_due(now); });
}

std::int64_t EventLogParts::event_count() const {
  return ended_events_ + (writer_ ? writer_->event_count() : 0);
}

std::int64_t EventLogParts::byte_count() const {
  return ended_bytes_ + (writer_ ? writer_->byte_count() : 0);
}

}  // namespace hedgehop::bus
