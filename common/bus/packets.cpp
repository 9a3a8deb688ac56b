#include "bus/packets.hpp"

#include <algorithm>

namespace hedgehop::bus {
namespace {

constexpr std::uint32_t kWhole = 0x4c433032;
constexpr std::uint32_t kPiece = 0x4c433033;
constexpr std::size_t kWholeHeaderBytes = 8;
constexpr std::size_t kPieceHeaderBytes = 20;
constexpr std::size_t kChannelBytesMax = 63;
constexpr std::uint32_t kMessageBytesMax = 16U << 20;
constexpr std::size_t kHeldBytesMax = 32U << 20;
constexpr std::size_t kPartialsMax = 64;
/// What holding a piece costs besides its bytes.
constexpr std::size_t kPieceOverhead = 96;

std::uint32_t u32(ByteView bytes, std::size_t at) {
  return (std::to_integer<std::uint32_t>(bytes[at]) << 24) |
         (std::to_integer<std::uint32_t>(bytes[at + 1]) << 16) |
         (std::to_integer<std::uint32_t>(bytes[at + 2]) << 8) |
         std::to_integer<std::uint32_t>(bytes[at + 3]);
}

std::uint16_t u16(ByteView bytes, std::size_t at) {
  return static_cast<std::uint16_t>((std::to_integer<unsigned>(bytes[at]) << 8) |
                                    std::to_integer<unsigned>(bytes[at + 1]));
}

/// The name at the front of `rest`, which then begins behind its zero; empty if there is no proper
/// one.
std::string take_channel(ByteView& rest) {
  const ByteView window = rest.first(std::min(rest.size(), kChannelBytesMax + 1));
  const auto zero = std::find(window.begin(), window.end(), std::byte{0});
  if (zero == window.end()) {
    return {};
  }
  const auto size = static_cast<std::size_t>(zero - window.begin());
  std::string channel(reinterpret_cast<const char*>(rest.data()), size);
  rest = rest.subspan(size + 1);
  return channel;
}

}  // namespace

std::optional<PacketMessage> PacketReader::bad() {
  ++bad_packets_;
  return std::nullopt;
}

std::optional<PacketMessage> PacketReader::read(ByteView packet, std::uint64_t sender) {
  if (packet.size() < kWholeHeaderBytes) {
    return bad();
  }
  const std::uint32_t magic = u32(packet, 0);
  if (magic == kPiece) {
    return read_piece(packet, {sender, u32(packet, 4)});
  }
  if (magic != kWhole) {
    return bad();
  }
  ByteView rest = packet.subspan(kWholeHeaderBytes);
  std::string channel = take_channel(rest);
  if (channel.empty()) {
    return bad();
  }
  return PacketMessage{std::move(channel), Bytes(rest.begin(), rest.end())};
}

std::optional<PacketMessage> PacketReader::read_piece(ByteView packet, const Key& key) {
  if (packet.size() < kPieceHeaderBytes) {
    return bad();
  }
  const std::uint32_t message_bytes = u32(packet, 8);
  const std::uint32_t offset = u32(packet, 12);
  const std::uint16_t piece = u16(packet, 16);
  const std::uint16_t pieces = u16(packet, 18);
  ByteView rest = packet.subspan(kPieceHeaderBytes);
  std::string channel;
  if (piece == 0) {
    channel = take_channel(rest);
    if (channel.empty()) {
      return bad();
    }
  }
  if (message_bytes > kMessageBytesMax || pieces == 0 || piece >= pieces ||
      offset > message_bytes || rest.size() > message_bytes - offset ||
      (rest.empty() && message_bytes > 0)) {
    return bad();
  }

  auto found = partials_.find(key);
  if (found != partials_.end() &&
      (found->second.message_bytes != message_bytes || found->second.pieces != pieces)) {
    // The number has come round, or somebody lies; either way the old pieces are worth nothing.
    abandon(found);
    found = partials_.end();
  }
  if (found == partials_.end()) {
    found = partials_.emplace(key, Partial{}).first;
    found->second.message_bytes = message_bytes;
    found->second.pieces = pieces;
    found->second.age = ages_.insert(ages_.end(), key);
  } else {
    ages_.splice(ages_.end(), ages_, found->second.age);
  }
  Partial& partial = found->second;
  if (piece == 0) {
    partial.channel = std::move(channel);
  }
  const auto [place, is_new] =
      partial.arrived.try_emplace(piece, offset, Bytes(rest.begin(), rest.end()));
  if (is_new) {
    partial.held_bytes += rest.size() + kPieceOverhead;
    held_bytes_ += rest.size() + kPieceOverhead;
  }

  std::optional<PacketMessage> message;
  if (partial.arrived.size() == partial.pieces) {
    message = assembled(partial);
    if (!message) {
      ++bad_packets_;
    }
    held_bytes_ -= partial.held_bytes;
    ages_.erase(partial.age);
    partials_.erase(found);
  }
  while (held_bytes_ > kHeldBytesMax || partials_.size() > kPartialsMax) {
    abandon(partials_.find(ages_.front()));
  }
  return message;
}

std::optional<PacketMessage> PacketReader::assembled(Partial& partial) {
  PacketMessage message;
  message.channel = std::move(partial.channel);
  message.bytes.reserve(partial.held_bytes);
  for (const auto& [piece, content] : partial.arrived) {
    if (content.first != message.bytes.size()) {
      return std::nullopt;
    }
    message.bytes.insert(message.bytes.end(), content.second.begin(), content.second.end());
  }
  if (message.bytes.size() != partial.message_bytes) {
    return std::nullopt;
  }
  return message;
}

void PacketReader::abandon(std::map<Key, Partial>::iterator partial) {
  ++abandoned_;
  held_bytes_ -= partial->second.held_bytes;
  ages_.erase(partial->second.age);
  partials_.erase(partial);
}

}  // namespace hedgehop::bus
