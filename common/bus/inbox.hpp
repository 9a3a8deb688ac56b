#pragma once

// Internal: the queue between a thread that receives and the thread that polls.

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <vector>

#include "bus/transport.hpp"

namespace hedgehop::bus {

/// Bounded by memory. When it is full the newest message is dropped and counted, as the kernel
/// does. One thread puts, one takes; it takes all that waits with one lock.
class Inbox {
 public:
  void put(Incoming message) {
    std::vector<Incoming> one;
    one.push_back(std::move(message));
    put(one);
  }
  /// Leaves `messages` empty.
  void put(std::vector<Incoming>& messages) {
    if (messages.empty()) {
      return;
    }
    {
      const std::lock_guard lock(mutex_);
      for (Incoming& message : messages) {
        const std::size_t bytes = cost(message);
        if (bytes_ + bytes > kBytesMax) {
          ++dropped_;
        } else {
          bytes_ += bytes;
          queue_.push_back(std::move(message));
        }
      }
    }
    messages.clear();
    arrived_.notify_one();
  }

  std::optional<Incoming> take(double timeout_s) {
    if (taken_.empty()) {
      std::unique_lock lock(mutex_);
      bytes_ -= taken_bytes_;
      taken_bytes_ = 0;
      if (queue_.empty() && timeout_s > 0.0) {
        arrived_.wait_for(lock, std::chrono::duration<double>(timeout_s),
                          [&] { return !queue_.empty(); });
      }
      if (queue_.empty()) {
        return std::nullopt;
      }
      taken_.swap(queue_);
      taken_bytes_ = bytes_;
    }
    std::optional<Incoming> message = std::move(taken_.front());
    taken_.pop_front();
    return message;
  }

  [[nodiscard]] std::int64_t dropped() const {
    const std::lock_guard lock(mutex_);
    return dropped_;
  }

 private:
  static constexpr std::size_t kBytesMax = 128U << 20;
  static std::size_t cost(const Incoming& message) {
    return message.bytes.size() + message.channel.size() + 128;
  }

  mutable std::mutex mutex_;
  std::condition_variable arrived_;
  std::deque<Incoming> queue_;
  std::size_t bytes_ = 0;  // of both queues
  std::int64_t dropped_ = 0;
  std::deque<Incoming> taken_;  // of the thread that takes
  std::size_t taken_bytes_ = 0;
};

}  // namespace hedgehop::bus
