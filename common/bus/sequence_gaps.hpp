#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <string_view>

#include "messages/message.hpp"

namespace hedgehop::bus {

/// Numbers that are missing in the sequences of senders. What was sent before the first message of
/// a sender that is heard is not missing; what comes late is missing no more.
class SequenceGaps {
 public:
  void note(std::string_view channel, const messages::Stamp& stamp);

  [[nodiscard]] std::int64_t missing() const { return missing_; }
  /// Senders that something is missing of, and how much.
  [[nodiscard]] std::map<std::int64_t, std::int64_t> missing_by_sender() const;

 private:
  struct Sequence {
    std::int64_t last = 0;
    std::int64_t missing = 0;
  };
  using Senders = std::map<std::int64_t, Sequence>;
  std::map<std::string, Senders, std::less<>> channels_;
  std::size_t sequence_count_ = 0;
  std::int64_t missing_ = 0;
};

}  // namespace hedgehop::bus
