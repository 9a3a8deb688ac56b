#pragma once

#include <cstdint>
#include <list>
#include <map>
#include <optional>
#include <string>

#include "base/hash.hpp"

namespace hedgehop::bus {

/// A message as LCM's UDP protocol carried it.
struct PacketMessage {
  std::string channel;
  Bytes bytes;
};

/// Turns datagrams of LCM's UDP protocol into messages; trusts no byte of them.
///
/// Big-endian. Whole: u32 "LC02", u32 number, channel, zero, message. In pieces: u32 "LC03", u32
/// number, u32 message length, u32 offset, u16 piece, u16 pieces, (piece 0: channel, zero,) bytes.
/// Pieces of one message share sender and number and may come in any order. Memory grows with what
/// has arrived, not with what a packet claims, and is bounded; the message heard of longest ago
/// makes room.
class PacketReader {
 public:
  /// `sender` tells origins apart (address and port).
  std::optional<PacketMessage> read(ByteView packet, std::uint64_t sender);

  /// Packets that were no LCM, or did not fit the other pieces of their message.
  [[nodiscard]] std::int64_t bad_packets() const { return bad_packets_; }
  /// Messages in pieces that were given up.
  [[nodiscard]] std::int64_t abandoned() const { return abandoned_; }

 private:
  struct Key {
    std::uint64_t sender = 0;
    std::uint32_t number = 0;
    auto operator<=>(const Key&) const = default;
  };
  struct Partial {
    std::uint32_t message_bytes = 0;
    std::uint16_t pieces = 0;
    std::size_t held_bytes = 0;
    std::string channel;  // empty until piece 0 has come
    std::map<std::uint16_t, std::pair<std::uint32_t, Bytes>> arrived;  // piece -> offset, bytes
    std::list<Key>::iterator age;
  };

  std::optional<PacketMessage> bad();
  std::optional<PacketMessage> read_piece(ByteView packet, const Key& key);
  std::optional<PacketMessage> assembled(Partial& partial);
  void abandon(std::map<Key, Partial>::iterator partial);

  std::map<Key, Partial> partials_;
  std::list<Key> ages_;  // heard of longest ago first
  std::size_t held_bytes_ = 0;
  std::int64_t bad_packets_ = 0;
  std::int64_t abandoned_ = 0;
};

}  // namespace hedgehop::bus
