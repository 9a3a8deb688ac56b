#include "messages/channels.hpp"

#include <algorithm>
#include <cstddef>

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

}  // namespace

std::optional<Stamp> peek_stamp(std::string_view channel, ByteView bytes) {
  constexpr std::size_t kFingerprintBytes = 8;
  if (bytes.size() < kFingerprintBytes + kStampBytes) {
    return std::nullopt;
  }
  const std::int64_t fingerprint = number_at(bytes, 0);
  const auto& types = type_fingerprints();
  const auto type = std::find_if(types.begin(), types.end(), [&](const TypeFingerprint& candidate) {
    return candidate.fingerprint == fingerprint;
  });
  if (type == types.end() ||
      std::none_of(kChannelTypes.begin(), kChannelTypes.end(), [&](const ChannelType& known) {
        return known.type == type->type && channel.ends_with(known.channel);
      })) {
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
