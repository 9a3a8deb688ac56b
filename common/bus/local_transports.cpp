#include <algorithm>
#include <chrono>
#include <map>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

#include "bus/event_log.hpp"
#include "bus/inbox.hpp"
#include "bus/transport.hpp"

namespace hedgehop::bus {
namespace {

class MemoryTransport;

/// Who listens under which name in this process.
struct Hub {
  std::mutex mutex;
  std::map<std::string, std::vector<MemoryTransport*>> members;

  static Hub& instance() {
    static Hub hub;
    return hub;
  }
};

class MemoryTransport final : public Transport {
 public:
  MemoryTransport(std::string name, Wants wants)
      : name_(std::move(name)), wants_(std::move(wants)) {
    Hub& hub = Hub::instance();
    const std::lock_guard lock(hub.mutex);
    hub.members[name_].push_back(this);
  }

  ~MemoryTransport() override {
    Hub& hub = Hub::instance();
    const std::lock_guard lock(hub.mutex);
    std::erase(hub.members[name_], this);
  }
  MemoryTransport(const MemoryTransport&) = delete;
  MemoryTransport& operator=(const MemoryTransport&) = delete;

  bool publish(const std::string& channel, const Bytes& bytes) override {
    Hub& hub = Hub::instance();
    const std::lock_guard lock(hub.mutex);
    for (MemoryTransport* member : hub.members[name_]) {
      if (member->wants_(channel)) {
        member->inbox_.put({channel, wall_clock(), bytes});
      }
    }
    return true;
  }

  std::optional<Incoming> take(double timeout_s) override { return inbox_.take(timeout_s); }

  [[nodiscard]] TransportCounters counters() const override { return {inbox_.dropped(), 0}; }

 private:
  std::string name_;
  Wants wants_;
  Inbox inbox_;
};

class LogTransport final : public Transport {
 public:
  LogTransport(const std::string& path, Wants wants) : reader_(path), wants_(std::move(wants)) {}

  bool publish(const std::string&, const Bytes&) override { return true; }

  std::optional<Incoming> take(double timeout_s) override {
    if (is_finished_) {
      std::this_thread::sleep_for(std::chrono::duration<double>(timeout_s));
      return std::nullopt;
    }
    while (std::optional<LogEvent> event = reader_.next()) {
      time_ = std::max(time_, event->receive_time);
      if (wants_(event->channel)) {
        return Incoming{std::move(event->channel), event->receive_time, std::move(event->bytes)};
      }
    }
    is_finished_ = true;
    return std::nullopt;
  }

  [[nodiscard]] TransportCounters counters() const override { return {0, reader_.damage_count()}; }
  [[nodiscard]] bool is_finished() const override { return is_finished_; }
  [[nodiscard]] std::optional<Time> time() const override { return time_; }

 private:
  EventLogReader reader_;
  Wants wants_;
  Time time_;
  bool is_finished_ = false;
};

}  // namespace

std::unique_ptr<Transport> memory_transport(const std::string& name, Transport::Wants wants) {
  return std::make_unique<MemoryTransport>(name, std::move(wants));
}

std::unique_ptr<Transport> log_transport(const std::string& path, Transport::Wants wants) {
  return std::make_unique<LogTransport>(path, std::move(wants));
}

}  // namespace hedgehop::bus
