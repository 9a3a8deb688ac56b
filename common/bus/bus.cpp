#include "bus/bus.hpp"

#include <array>
#include <chrono>
#include <cstdlib>
#include <deque>
#include <iostream>
#include <mutex>
#include <set>
#include <stdexcept>
#include <unistd.h>
#include <vector>

#include "base/errors.hpp"
#include "bus/sequence_gaps.hpp"
#include "bus/transport.hpp"
#include "messages/message_error.hpp"

namespace hedgehop::bus {
namespace {

constexpr double kPollSlice_s = 0.05;
constexpr std::size_t kChannelBytesMax = 63;

double steady_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

std::string effective_url(const std::string& url) {
  if (!url.empty()) {
    return url;
  }
  const char* from_environment = std::getenv("LCM_DEFAULT_URL");
  return from_environment != nullptr && *from_environment != '\0' ? from_environment : kDefaultUrl;
}

std::int64_t drawn_sender_id() {
  std::array<char, 256> host{};
  ::gethostname(host.data(), host.size() - 1);
  static int buses = 0;
  const std::string text = std::string(host.data()) + ' ' + std::to_string(::getpid()) + ' ' +
                           std::to_string(wall_clock().utime_us) + ' ' + std::to_string(++buses);
  return static_cast<std::int64_t>(hash128(text).low >> 1) | 1;
}

}  // namespace

Time wall_clock() {
  return Time{std::chrono::duration_cast<std::chrono::microseconds>(
                  std::chrono::system_clock::now().time_since_epoch())
                  .count()};
}

struct Bus::Impl {
  struct Subscription {
    std::string channel;  // with the prefix
    Decode decode;
  };

  std::string url;
  std::string prefix;
  std::int64_t sender_id = 0;

  std::mutex wanted_mutex;  // guards the next two, which the receiving thread reads
  std::set<std::string, std::less<>> wanted;
  bool is_everything_wanted = false;

  std::deque<Subscription> subscriptions;
  std::vector<std::function<void(const RawMessage&)>> raw_handlers;
  std::vector<std::function<void(const RawMessage&)>> taps;
  std::map<std::string, std::int64_t, std::less<>> last_seq_sent;
  SequenceGaps gaps;
  BusCounters counters;
  Time message_time;
  double next_note_s = 0.0;
  std::int64_t unsent = 0;
  std::unique_ptr<Transport> transport;  // last: its thread uses what stands above

  bool wants(std::string_view channel) {
    const std::lock_guard lock(wanted_mutex);
    return is_everything_wanted || wanted.find(channel) != wanted.end();
  }

  void note(const std::string& text) {
    const double now_s = steady_s();
    if (now_s >= next_note_s) {
      next_note_s = now_s + 1.0;
      std::cerr << "bus: " << text << '\n';
    }
  }

  void hand_over(const Incoming& message) {
    if (!raw_handlers.empty()) {
      const RawMessage raw{message.channel, message.receive_time, message.bytes};
      for (const auto& handler : raw_handlers) {
        handler(raw);
      }
    }
    bool is_counted = false;
    for (Subscription& subscription : subscriptions) {
      if (subscription.channel != message.channel) {
        continue;
      }
      Accepted accepted;
      try {
        accepted = subscription.decode(message.bytes);
      } catch (const messages::MessageError& error) {
        reject(message.channel, error.what());
        return;
      } catch (const std::bad_alloc&) {
        reject(message.channel, "does not fit into memory");
        return;
      }
      if (!is_counted) {
        is_counted = true;
        ++counters.received;
        message_time = std::max(message_time, accepted.stamp.time);
        gaps.note(message.channel, accepted.stamp);
      }
      accepted.deliver();
    }
    if (!is_counted && !raw_handlers.empty()) {
      ++counters.received;
      if (const auto stamp = messages::peek_stamp(message.channel, message.bytes)) {
        gaps.note(message.channel, *stamp);
      }
    }
  }

  void reject(const std::string& channel, const std::string& why) {
    ++counters.rejected;
    ++counters.rejected_by_channel[channel];
    counters.last_rejection = channel + ": " + why;
    note("refused a message on " + counters.last_rejection + " (" +
         std::to_string(counters.rejected) + " refused so far)");
  }
};

Bus::Bus(const BusOptions& options) : impl_(std::make_unique<Impl>()) {
  Impl& impl = *impl_;
  impl.url = effective_url(options.url);
  impl.prefix = options.channel_prefix;
  for (const char c : impl.prefix) {
    if ((c < 'A' || c > 'Z') && (c < 'a' || c > 'z') && (c < '0' || c > '9') && c != '_') {
      throw UsageError("channel prefix '" + impl.prefix + "' holds '" + std::string(1, c) + "'",
                       "use letters, digits and underscores");
    }
  }
  for (const messages::ChannelType& type : messages::kChannelTypes) {
    if (impl.prefix.size() + type.channel.size() > kChannelBytesMax) {
      throw UsageError("channel prefix '" + impl.prefix + "' is too long",
                       "use at most 40 characters");
    }
  }
  impl.sender_id = options.sender_id != 0 ? options.sender_id : drawn_sender_id();
  const auto wants = [&impl](std::string_view channel) { return impl.wants(channel); };
  const std::string_view url(impl.url);
  if (url.starts_with("udpm://")) {
    impl.transport = udpm_transport(impl.url, wants);
  } else if (url.starts_with("memq://")) {
    impl.transport = memory_transport(impl.url.substr(7), wants);
  } else if (url.starts_with("file://")) {
    impl.transport = log_transport(impl.url.substr(7, impl.url.find('?') - 7), wants);
  } else {
    throw UsageError("'" + impl.url + "' is no bus that hedgehop knows",
                     "write udpm://GROUP:PORT?ttl=N, memq://NAME or file:///PATH");
  }
}

Bus::~Bus() = default;

messages::Stamp Bus::next_stamp(std::string_view channel, Time content_time) {
  auto found = impl_->last_seq_sent.find(channel);
  if (found == impl_->last_seq_sent.end()) {
    found = impl_->last_seq_sent.emplace(channel, 0).first;
  }
  return {content_time, impl_->sender_id, ++found->second};
}

void Bus::publish_bytes(std::string_view channel, const Bytes& message) {
  Impl& impl = *impl_;
  const std::string name = impl.prefix + std::string(channel);
  if (impl.transport->publish(name, message)) {
    ++impl.counters.published;
  } else {
    ++impl.unsent;
    impl.note("could not send on " + name + " (" + std::to_string(impl.unsent) +
              " messages so far); is the network up?");
  }
  if (!impl.taps.empty()) {
    const RawMessage raw{name, now(), message};
    for (const auto& tap : impl.taps) {
      tap(raw);
    }
  }
}

void Bus::subscribe_decoded(std::string_view channel, Decode decode) {
  const std::string name = impl_->prefix + std::string(channel);
  impl_->subscriptions.push_back({name, std::move(decode)});
  const std::lock_guard lock(impl_->wanted_mutex);
  impl_->wanted.insert(name);
}

void Bus::subscribe_raw(std::function<void(const RawMessage&)> handler) {
  impl_->raw_handlers.push_back(std::move(handler));
  impl_->transport->hurry();
  const std::lock_guard lock(impl_->wanted_mutex);
  impl_->is_everything_wanted = true;
}

void Bus::tap_published(std::function<void(const RawMessage&)> handler) {
  impl_->taps.push_back(std::move(handler));
}

int Bus::poll(double timeout_s) {
  std::optional<Incoming> message = impl_->transport->take(timeout_s);
  if (!message) {
    return 0;
  }
  const double end_s = steady_s() + kPollSlice_s;
  int count = 0;
  while (message) {
    ++count;
    impl_->hand_over(*message);
    if (is_replay() || steady_s() >= end_s) {
      break;
    }
    message = impl_->transport->take(0.0);
  }
  return count;
}

Time Bus::now() const {
  const std::optional<Time> time = impl_->transport->time();
  return time ? *time : wall_clock();
}

Time Bus::message_time() const { return impl_->message_time; }
bool Bus::is_replay() const { return impl_->transport->time().has_value(); }
bool Bus::is_finished() const { return impl_->transport->is_finished(); }
std::int64_t Bus::sender_id() const { return impl_->sender_id; }
const std::string& Bus::url() const { return impl_->url; }

BusCounters Bus::counters() const {
  BusCounters counters = impl_->counters;
  const TransportCounters transport = impl_->transport->counters();
  counters.dropped_packets = transport.dropped_packets;
  counters.bad_packets = transport.bad_packets;
  counters.gaps = impl_->gaps.missing();
  counters.gaps_by_sender = impl_->gaps.missing_by_sender();
  return counters;
}

}  // namespace hedgehop::bus
