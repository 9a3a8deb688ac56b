#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>

#include "base/hash.hpp"
#include "base/time.hpp"
#include "messages/channels.hpp"
#include "messages/message.hpp"

namespace hedgehop::bus {

/// How to get on the bus.
///
/// url:  ""                    LCM_DEFAULT_URL of the environment if set, else kDefaultUrl
///       udpm://GROUP:PORT     multicast; `?ttl=1` crosses the LAN, `&recv_buf_size=N` bytes
///       memq://NAME           inside this process; every Bus of the same name hears all others and
///       itself file:///PATH          hears what an LCM log holds, in its order; what is published
///       goes to
///                             tap_published() only. now() is the time of the log.
struct BusOptions {
  std::string url;
  std::string channel_prefix;  // put before every channel name on the wire
  std::int64_t sender_id = 0;  // 0: drawn from host, process and clock
};

inline constexpr char kDefaultUrl[] = "udpm://239.255.76.67:7667?ttl=0";

/// What has gone through a Bus so far.
struct BusCounters {
  std::int64_t published = 0;
  std::int64_t received = 0;  // accepted by from_message and handed over
  std::int64_t rejected = 0;  // refused by from_message
  std::int64_t gaps = 0;      // numbers missing in the sequences of senders
  std::map<std::int64_t, std::int64_t> gaps_by_sender;
  std::int64_t dropped_packets = 0;  // by the kernel or a full queue of ours
  std::int64_t bad_packets = 0;      // no LCM packets at all, or fragments that do not fit together
  std::map<std::string, std::int64_t> rejected_by_channel;
  std::string last_rejection;  // channel, type, field, value
};

/// A message as it came, before anybody has looked into it.
struct RawMessage {
  std::string_view channel;  // with the prefix
  Time receive_time;
  ByteView bytes;
};

/// A place on the bus.
///
/// Handlers run inside poll(), in the caller's thread, in the order of arrival; a Bus is used by
/// one thread. Queues are bounded by memory (128 MiB), not by count; what does not fit is counted.
/// A message that from_message() refuses is counted, noted on stderr at most once a second, and
/// dropped. A handler must not call poll().
class Bus {
 public:
  /// Throws BusError with what to do when the bus cannot be reached, DataError for a log that
  /// cannot be read, UsageError for an unknown kind of url.
  explicit Bus(const BusOptions& options);
  ~Bus();
  Bus(const Bus&) = delete;
  Bus& operator=(const Bus&) = delete;

  /// Numbers and sends. `content_time` is the time that the content is about. Throws
  /// std::invalid_argument for content that cannot be sent.
  template <typename T>
  void publish(const messages::Channel<T>& channel, const T& content, Time content_time) {
    publish_bytes(channel.name,
                  messages::to_message(content, next_stamp(channel.name, content_time)));
  }

  /// Several handlers for one channel are called in the order of subscription.
  template <typename T>
  void subscribe(const messages::Channel<T>& channel,
                 std::function<void(const T& content, const messages::Stamp& stamp)> handler) {
    subscribe_decoded(channel.name, [handler = std::move(handler)](ByteView bytes) {
      messages::Stamp stamp;
      const T content = messages::from_message<T>(bytes, stamp);
      return Accepted{stamp, [content, stamp, &handler] { handler(content, stamp); }};
    });
  }

  /// Everything on the bus, for a recorder: receiving gets priority. Runs before typed handlers.
  void subscribe_raw(std::function<void(const RawMessage&)> handler);

  /// Hears what this Bus publishes, for a recorder of a replay. Channel names carry the prefix.
  void tap_published(std::function<void(const RawMessage&)> handler);

  /// Waits up to `timeout_s` for a first message, then hands over what is queued, for at most 50
  /// ms, so that a flood cannot hold the caller. A log hands over one message a call, without
  /// waiting. Exceptions of handlers pass through. Returns the number of messages seen.
  int poll(double timeout_s);

  /// Wall clock; with a log, the time of its newest message. The only clock of the project.
  [[nodiscard]] Time now() const;

  /// The newest `utime` of any accepted message; zero before the first. Judge age against this.
  [[nodiscard]] Time message_time() const;

  /// True for file://: nobody answers, and now() stands still once the log is over.
  [[nodiscard]] bool is_replay() const;

  /// True once a log has been read to its end; never for a live bus.
  [[nodiscard]] bool is_finished() const;

  [[nodiscard]] BusCounters counters() const;
  [[nodiscard]] std::int64_t sender_id() const;
  [[nodiscard]] const std::string& url() const;

 private:
  struct Accepted {
    messages::Stamp stamp;
    std::function<void()> deliver;
  };
  using Decode = std::function<Accepted(ByteView)>;
  struct Impl;

  messages::Stamp next_stamp(std::string_view channel, Time content_time);
  void publish_bytes(std::string_view channel, const Bytes& message);
  void subscribe_decoded(std::string_view channel, Decode decode);

  std::unique_ptr<Impl> impl_;
};

}  // namespace hedgehop::bus
