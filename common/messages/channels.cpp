#include "messages/channels.hpp"

#include <algorithm>
#include <cstddef>
#include <vector>

namespace hedgehop::messages {
namespace {

constexpr std::size_t kStampBytes = 24;

std::int64_t number_at(ByteView bytes, std::size_t place) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < 8; ++i) {
    value = (value << 8) | std::to_integer<std::uint64_t>(bytes[place + i]);
  }
  return static_cast<std::int64_t>(value);
}

// No two channels carry the same type.
struct ChannelFingerprint {
  std::string_view channel;
  std::int64_t fingerprint = 0;
};
std::vector<ChannelFingerprint> channel_fingerprints() {
  std::vector<ChannelFingerprint> result;
  for (const ChannelType& channel : kChannelTypes) {
    for (const TypeFingerprint& type : type_fingerprints()) {
      if (type.type == channel.type) {
        result.push_back({channel.channel, type.fingerprint});
      }
    }
  }
  return result;
}

}  // namespace

std::optional<Stamp> peek_stamp(std::string_view channel, ByteView bytes) {
  constexpr std::size_t kFingerprintBytes = 8;
  if (bytes.size() < kFingerprintBytes + kStampBytes) {
    return std::nullopt;
  }
  static const std::vector<ChannelFingerprint> kChannels = channel_fingerprints();
  const std::int64_t fingerprint = number_at(bytes, 0);
  const auto known = std::find_if(kChannels.begin(), kChannels.end(), [&](const auto& candidate) {
    return candidate.fingerprint == fingerprint;
  });
  if (known == kChannels.end() || !channel.ends_with(known->channel)) {
    return std::nullopt;
  }
  Stamp stamp;
  stamp.time.utime_us = number_at(bytes, kFingerprintBytes);
  stamp.sender_id = number_at(bytes, kFingerprintBytes + 8);
  stamp.seq = number_at(bytes, kFingerprintBytes + 16);
  if (stamp.seq < 1) {
    return std::nullopt;
  }
  return stamp;
}

}  // namespace hedgehop::messages
