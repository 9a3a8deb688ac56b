#include "bus/event_log.hpp"

#include <array>
#include <cerrno>
#include <condition_variable>
#include <cstring>
#include <fcntl.h>
#include <fstream>
#include <mutex>
#include <sys/stat.h>
#include <thread>
#include <unistd.h>
#include <utility>
#include <vector>

#include "base/errors.hpp"

namespace hedgehop::bus {
namespace {

constexpr std::uint32_t kSync = 0xEDA1DA01;
constexpr std::size_t kHeaderBytes = 28;
constexpr std::uint32_t kChannelBytesMax = 255;
/// LCM itself sends no more.
constexpr std::uint32_t kMessageBytesMax = 1U << 28;
constexpr std::size_t kReadBytes = 1U << 16;
constexpr std::size_t kDamagesMax = 1000;
/// A process that is killed loses what it has not handed to the system; that costs much less than
/// bringing it to disk, and is done as much more often.
constexpr std::int64_t kHandOversPerFlush = 4;

std::uint64_t number_at(const std::byte* bytes, int size) {
  std::uint64_t value = 0;
  for (int i = 0; i < size; ++i) {
    value = (value << 8) | std::to_integer<std::uint64_t>(bytes[i]);
  }
  return value;
}

void put_number(std::byte*& out, std::uint64_t value, int size) {
  for (int i = size - 1; i >= 0; --i) {
    *out++ = static_cast<std::byte>(value >> (8 * i));
  }
}

}  // namespace

struct EventLogReader::Impl {
  std::ifstream file;
  std::string name;
  std::int64_t file_bytes = 0;
  std::int64_t offset = 0;
  std::int64_t skipped_bytes = 0;
  std::int64_t damage_count = 0;
  std::vector<Damage> damages;

  bool read_at(std::int64_t place, std::byte* into, std::size_t size) {
    if (place < 0 || place + static_cast<std::int64_t>(size) > file_bytes) {
      return false;
    }
    file.clear();
    file.seekg(place);
    file.read(reinterpret_cast<char*>(into), static_cast<std::streamsize>(size));
    return static_cast<std::size_t>(file.gcount()) == size;
  }

  bool has_sync_at(std::int64_t place) {
    std::array<std::byte, 4> word{};
    return read_at(place, word.data(), word.size()) && number_at(word.data(), 4) == kSync;
  }

  /// Number in the header of the event at `place`, or none if the file ends before.
  std::optional<std::uint64_t> event_number_at(std::int64_t place) {
    std::array<std::byte, 12> header{};
    if (!read_at(place, header.data(), header.size())) {
      return std::nullopt;
    }
    return number_at(header.data() + 4, 8);
  }

  /// Length of the whole event at `place`, or 0 if there is none.
  std::int64_t event_bytes_at(std::int64_t place) {
    std::array<std::byte, kHeaderBytes> header{};
    if (!read_at(place, header.data(), header.size()) || number_at(header.data(), 4) != kSync) {
      return 0;
    }
    const std::uint64_t channel_bytes = number_at(header.data() + 20, 4);
    const std::uint64_t message_bytes = number_at(header.data() + 24, 4);
    if (channel_bytes == 0 || channel_bytes > kChannelBytesMax ||
        message_bytes > kMessageBytesMax) {
      return 0;
    }
    const auto size = static_cast<std::int64_t>(kHeaderBytes + channel_bytes + message_bytes);
    return place + size <= file_bytes ? size : 0;
  }

  /// Whole, and followed by an event or by the end of the file. A truncated event may follow too.
  bool is_sound_at(std::int64_t place) {
    const std::int64_t size = event_bytes_at(place);
    if (size == 0) {
      return false;
    }
    const std::int64_t next = place + size;
    return file_bytes - next < 4 || has_sync_at(next);
  }

  /// In sequence an event may be followed by damage. It is itself damaged if its length reaches
  /// over the beginning of a sound one, be it the next or one after more damage. Where it ends at
  /// an event all the same, by chance, the numbers of the events tell which ones it hides.
  bool is_event_in_sequence() {
    const std::int64_t size = event_bytes_at(offset);
    if (size == 0) {
      return false;
    }
    const std::uint64_t number = *event_number_at(offset);
    std::optional<std::uint64_t> next_number;
    if (is_sound_at(offset)) {
      next_number = event_number_at(offset + size);
      if (!next_number || *next_number <= number + 1) {
        return true;
      }
    }
    const auto is_hidden = [&](std::int64_t place) {
      const std::uint64_t found = *event_number_at(place);
      return !next_number || (found > number && found < *next_number);
    };
    std::int64_t inside = find_sync(offset + 1);
    while (inside < offset + size && !(is_sound_at(inside) && is_hidden(inside))) {
      inside = find_sync(inside + 1);
    }
    return inside >= offset + size;
  }

  /// Place of the next sync word at or after `from`; the end if there is none.
  std::int64_t find_sync(std::int64_t from) {
    std::vector<std::byte> block(kReadBytes);
    while (from + 4 <= file_bytes) {
      const auto size = static_cast<std::size_t>(
          std::min<std::int64_t>(static_cast<std::int64_t>(kReadBytes), file_bytes - from));
      if (!read_at(from, block.data(), size)) {
        break;
      }
      for (std::size_t i = 0; i + 4 <= size; ++i) {
        if (number_at(block.data() + i, 4) == kSync) {
          return from + static_cast<std::int64_t>(i);
        }
      }
      from += static_cast<std::int64_t>(size) - 3;
    }
    return file_bytes;
  }
};

EventLogReader::EventLogReader(const std::filesystem::path& path)
    : impl_(std::make_unique<Impl>()) {
  impl_->name = path.string();
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) {
    throw DataError(impl_->name + ": no such file", "give the path of an LCM log");
  }
  impl_->file.open(path, std::ios::binary);
  if (!impl_->file) {
    throw DataError(impl_->name + ": cannot be read: " + std::strerror(errno));
  }
  impl_->file_bytes = static_cast<std::int64_t>(std::filesystem::file_size(path));
  std::int64_t place = impl_->find_sync(0);
  while (place < impl_->file_bytes && !impl_->is_sound_at(place)) {
    place = impl_->find_sync(place + 1);
  }
  if (place >= impl_->file_bytes) {
    throw DataError(impl_->name + ": holds no event of an LCM log",
                    "record one with flight_logger or lcm-logger");
  }
}

EventLogReader::~EventLogReader() = default;
EventLogReader::EventLogReader(EventLogReader&&) noexcept = default;
EventLogReader& EventLogReader::operator=(EventLogReader&&) noexcept = default;

std::optional<LogEvent> EventLogReader::next() {
  Impl& impl = *impl_;
  if (impl.offset >= impl.file_bytes) {
    return std::nullopt;
  }
  if (!impl.is_event_in_sequence()) {
    std::int64_t place = impl.find_sync(impl.offset + 1);
    while (place < impl.file_bytes && !impl.is_sound_at(place)) {
      place = impl.find_sync(place + 1);
    }
    impl.skipped_bytes += place - impl.offset;
    ++impl.damage_count;
    if (impl.damages.size() < kDamagesMax) {
      impl.damages.push_back({impl.offset, place - impl.offset, place >= impl.file_bytes});
    }
    impl.offset = place;
    if (place >= impl.file_bytes) {
      return std::nullopt;
    }
  }
  const std::int64_t size = impl.event_bytes_at(impl.offset);
  Bytes event(static_cast<std::size_t>(size));
  if (!impl.read_at(impl.offset, event.data(), event.size())) {
    throw DataError(impl.name + ": cannot be read at byte " + std::to_string(impl.offset));
  }
  impl.offset += size;
  LogEvent result;
  result.number = static_cast<std::int64_t>(number_at(event.data() + 4, 8));
  result.receive_time.utime_us = static_cast<std::int64_t>(number_at(event.data() + 12, 8));
  const auto channel_bytes = static_cast<std::size_t>(number_at(event.data() + 20, 4));
  result.channel.assign(reinterpret_cast<const char*>(event.data() + kHeaderBytes), channel_bytes);
  result.bytes.assign(event.begin() + static_cast<std::ptrdiff_t>(kHeaderBytes + channel_bytes),
                      event.end());
  return result;
}

std::int64_t EventLogReader::skipped_bytes() const { return impl_->skipped_bytes; }
std::int64_t EventLogReader::damage_count() const { return impl_->damage_count; }
const std::vector<EventLogReader::Damage>& EventLogReader::damages() const {
  return impl_->damages;
}

struct EventLogWriter::Impl {
  int file = -1;
  std::string name;
  std::int64_t flush_interval_us = 0;
  std::int64_t hand_over_us = 0;
  Bytes pending;
  std::optional<Time> oldest_pending;
  std::int64_t pending_count = 0;  // events in it
  std::int64_t event_count = 0;
  std::int64_t byte_count = 0;  // on disk or pending
  std::int64_t written = 0;     // whole events in the file
  std::optional<Time> oldest_unsynced;
  bool is_failed = false;

  // A busy disk may take seconds; meanwhile a recorder must not stand still.
  std::mutex mutex;  // guards the next three
  bool is_sync_wanted = false;
  bool is_ending = false;
  int sync_error = 0;
  std::condition_variable wake;
  std::thread syncer;  // from the first sync on

  void sync_soon() {
    {
      const std::lock_guard lock(mutex);
      is_sync_wanted = true;
      if (!syncer.joinable()) {
        syncer = std::thread([this] { sync_when_wanted(); });
      }
    }
    wake.notify_one();
  }
  void sync_when_wanted() {
    std::unique_lock lock(mutex);
    while (true) {
      wake.wait(lock, [this] { return is_sync_wanted || is_ending; });
      if (!is_sync_wanted) {
        return;
      }
      is_sync_wanted = false;
      lock.unlock();
      const int error = ::fdatasync(file) != 0 ? errno : 0;
      lock.lock();
      if (error != 0 && error != EINVAL && error != EROFS) {
        sync_error = error;
      }
    }
  }
  void end_syncer() {
    {
      const std::lock_guard lock(mutex);
      is_ending = true;
    }
    wake.notify_one();
    if (syncer.joinable()) {
      syncer.join();
    }
  }
  void check_sync() {
    const std::lock_guard lock(mutex);
    if (const int error = std::exchange(sync_error, 0); error != 0) {
      throw SystemFailure(name + ": cannot be brought to disk: " + std::strerror(error));
    }
  }

  /// Everything or nothing of `pending` stays in the file.
  void write_pending() {
    std::size_t done = 0;
    while (done < pending.size()) {
      const ssize_t size = ::write(file, pending.data() + done, pending.size() - done);
      if (size < 0 && errno == EINTR) {
        continue;
      }
      if (size <= 0) {
        const int cause = errno;
        is_failed = true;
        event_count -= pending_count;
        byte_count -= static_cast<std::int64_t>(pending.size());
        pending.clear();
        pending_count = 0;
        oldest_pending.reset();
        if (::ftruncate(file, written) != 0) {
          // The torn event stays at the end; readers get over it.
        }
        throw SystemFailure(name + ": cannot be written: " + std::strerror(cause),
                            "make room on the disk; the log is readable up to here");
      }
      done += static_cast<std::size_t>(size);
    }
    written += static_cast<std::int64_t>(pending.size());
    pending.clear();
    pending_count = 0;
    oldest_pending.reset();
  }
};

EventLogWriter::EventLogWriter(const std::filesystem::path& path, bool overwrite,
                               double flush_interval_s)
    : impl_(std::make_unique<Impl>()) {
  impl_->name = path.string();
  impl_->flush_interval_us = static_cast<std::int64_t>(flush_interval_s * 1e6);
  impl_->hand_over_us = impl_->flush_interval_us / kHandOversPerFlush;
  const int flags = O_WRONLY | O_CREAT | O_CLOEXEC | (overwrite ? O_TRUNC : O_EXCL);
  impl_->file = ::open(path.c_str(), flags, 0644);
  if (impl_->file < 0) {
    if (errno == EEXIST) {
      throw UsageError(impl_->name + ": exists already",
                       "choose another name or allow overwriting");
    }
    throw SystemFailure(impl_->name + ": cannot be written: " + std::strerror(errno));
  }
}

EventLogWriter::~EventLogWriter() {
  try {
    if (!impl_->is_failed) {
      flush();
    }
  } catch (const SystemFailure&) {
    // Nobody is left to tell.
  }
  impl_->end_syncer();
  ::close(impl_->file);
}

void EventLogWriter::write(Time receive_time, const std::string& channel, ByteView bytes) {
  Impl& impl = *impl_;
  HEDGEHOP_ASSERT(!channel.empty() && channel.size() <= kChannelBytesMax &&
                  bytes.size() <= kMessageBytesMax);
  if (impl.is_failed) {
    throw SystemFailure(impl.name + ": writing failed before");
  }
  const std::size_t before = impl.pending.size();
  std::array<std::byte, kHeaderBytes> header;
  std::byte* place = header.data();
  put_number(place, kSync, 4);
  put_number(place, static_cast<std::uint64_t>(impl.event_count), 8);
  put_number(place, static_cast<std::uint64_t>(receive_time.utime_us), 8);
  put_number(place, channel.size(), 4);
  put_number(place, bytes.size(), 4);
  impl.pending.insert(impl.pending.end(), header.begin(), header.end());
  const ByteView name = bytes_of(channel);
  impl.pending.insert(impl.pending.end(), name.begin(), name.end());
  impl.pending.insert(impl.pending.end(), bytes.begin(), bytes.end());
  ++impl.event_count;
  ++impl.pending_count;
  impl.byte_count += static_cast<std::int64_t>(impl.pending.size() - before);
  if (!impl.oldest_unsynced) {
    impl.oldest_unsynced = receive_time;
  }
  if (!impl.oldest_pending) {
    impl.oldest_pending = receive_time;
  }
  if (impl.pending.size() >= kReadBytes) {
    impl.write_pending();
  }
  flush_if_due(receive_time);
}

void EventLogWriter::flush_if_due(Time now) {
  if (impl_->oldest_unsynced &&
      now.utime_us - impl_->oldest_unsynced->utime_us >= impl_->flush_interval_us) {
    impl_->check_sync();
    impl_->write_pending();
    impl_->oldest_unsynced.reset();
    impl_->sync_soon();
  } else if (impl_->oldest_pending &&
             now.utime_us - impl_->oldest_pending->utime_us >= impl_->hand_over_us) {
    impl_->write_pending();
  }
}

void EventLogWriter::flush() {
  impl_->write_pending();
  impl_->oldest_unsynced.reset();
  if (::fdatasync(impl_->file) != 0 && errno != EINVAL && errno != EROFS) {
    throw SystemFailure(impl_->name + ": cannot be brought to disk: " + std::strerror(errno));
  }
}

std::int64_t EventLogWriter::event_count() const { return impl_->event_count; }
std::int64_t EventLogWriter::byte_count() const { return impl_->byte_count; }
std::int64_t EventLogWriter::written_bytes() const { return impl_->written; }

}  // namespace hedgehop::bus
