#pragma once

// Internal: how bytes get on and off the bus.

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "base/hash.hpp"
#include "base/time.hpp"

namespace hedgehop::bus {

/// A message on its way from a transport to a handler.
struct Incoming {
  std::string channel;
  Time receive_time;
  Bytes bytes;
};

struct TransportCounters {
  std::int64_t dropped_packets = 0;
  std::int64_t bad_packets = 0;
};

class Transport {
 public:
  /// Says whether anybody wants a channel; may be called from another thread.
  using Wants = std::function<bool(std::string_view channel)>;

  virtual ~Transport() = default;
  /// False if the bytes could not be sent.
  virtual bool publish(const std::string& channel, const Bytes& bytes) = 0;
  /// The next message; waits up to `timeout_s` for it.
  virtual std::optional<Incoming> take(double timeout_s) = 0;
  [[nodiscard]] virtual TransportCounters counters() const = 0;
  /// Asks that receiving goes before everything else that the machine does, as far as the system
  /// allows it: for a recorder, which cannot ask again.
  virtual void hurry() {}
  [[nodiscard]] virtual bool is_finished() const { return false; }
  /// Time of a transport that has its own.
  [[nodiscard]] virtual std::optional<Time> time() const { return std::nullopt; }
};

Time wall_clock();

/// udpm://
std::unique_ptr<Transport> udpm_transport(const std::string& url, Transport::Wants wants);
/// memq://
std::unique_ptr<Transport> memory_transport(const std::string& name, Transport::Wants wants);
/// file://
std::unique_ptr<Transport> log_transport(const std::string& path, Transport::Wants wants);

}  // namespace hedgehop::bus
