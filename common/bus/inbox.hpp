#pragma once

// Internal: the queue between a thread that receives and the thread that polls.

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>

#include "bus/transport.hpp"

namespace hedgehop::bus {

/// Bounded by memory. When it is full the newest message is dropped and counted, as the kernel
/// does.
class Inbox {
 public:
  void put(Incoming message) {
    {
      const std::lock_guard lock(mutex_);
      const std::size_t bytes = cost(message);
      if (bytes_ + bytes > kBytesMax) {
        ++dropped_;
        return;
      }
      bytes_ += bytes;
      queue_.push_back(std::move(message));
    }
    arrived_.notify_one();
  }

  std::optional<Incoming> take(double timeout_s) {
    std::unique_lock lock(mutex_);
    if (queue_.empty() && timeout_s > 0.0) {
      arrived_.wait_for(lock, std::chrono::duration<double>(timeout_s),
                        [&] { return !queue_.empty(); });
    }
    if (queue_.empty()) {
      return std::nullopt;
    }
    Incoming message = std::move(queue_.front());
    queue_.pop_front();
    bytes_ -= cost(message);
    return message;
  }

  [[nodiscard]] std::int64_t dropped() const {
    const std::lock_guard lock(mutex_);
    return dropped_;
  }

 private:
  static constexpr std::size_t kBytesMax = 64U << 20;
  static std::size_t cost(const Incoming& message) {
    return message.bytes.size() + message.channel.size() + 128;
  }

  mutable std::mutex mutex_;
  std::condition_variable arrived_;
  std::deque<Incoming> queue_;
  std::size_t bytes_ = 0;
  std::int64_t dropped_ = 0;
};

}  // namespace hedgehop::bus
