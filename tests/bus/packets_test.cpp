#include "bus/packets.hpp"

#include <algorithm>
#include <gtest/gtest.h>
#include <iostream>
#include <random>
#include <sys/resource.h>

namespace hedgehop::bus {
namespace {

void put(Bytes& bytes, std::uint64_t value, int size) {
  for (int i = size - 1; i >= 0; --i) {
    bytes.push_back(static_cast<std::byte>(value >> (8 * i)));
  }
}
void put(Bytes& bytes, std::string_view text) {
  for (const char c : text) {
    bytes.push_back(static_cast<std::byte>(c));
  }
}

Bytes whole(std::uint32_t number, const std::string& channel, ByteView content) {
  Bytes packet;
  put(packet, 0x4c433032, 4);
  put(packet, number, 4);
  put(packet, channel);
  put(packet, 0, 1);
  packet.insert(packet.end(), content.begin(), content.end());
  return packet;
}

Bytes piece(std::uint32_t number, std::uint32_t size, std::uint32_t offset, std::uint16_t k,
            std::uint16_t count, const std::string& channel, ByteView content) {
  Bytes packet;
  put(packet, 0x4c433033, 4);
  put(packet, number, 4);
  put(packet, size, 4);
  put(packet, offset, 4);
  put(packet, k, 2);
  put(packet, count, 2);
  if (k == 0) {
    put(packet, channel);
    put(packet, 0, 1);
  }
  packet.insert(packet.end(), content.begin(), content.end());
  return packet;
}

TEST(PacketReader, AWholeMessageComesThrough) {
  PacketReader reader;
  const auto message = reader.read(whole(1, "MAP_INDEX", bytes_of("hello")), 1);
  ASSERT_TRUE(message);
  EXPECT_EQ(message->channel, "MAP_INDEX");
  EXPECT_EQ(message->bytes, Bytes(bytes_of("hello").begin(), bytes_of("hello").end()));
}

TEST(PacketReader, PiecesInAnyOrderMakeTheMessage) {
  const unsigned seed = std::random_device{}();
  std::cout << "seed " << seed << '\n';
  std::mt19937 random(seed);
  for (int round = 0; round < 50; ++round) {
    Bytes content(10'000 + random() % 100'000);
    for (std::byte& b : content) {
      b = static_cast<std::byte>(random());
    }
    std::vector<Bytes> packets;
    constexpr std::size_t kPieceBytes = 1400;
    const auto count = static_cast<std::uint16_t>((content.size() + kPieceBytes - 1) / kPieceBytes);
    for (std::uint16_t k = 0; k < count; ++k) {
      const ByteView part = ByteView(content).subspan(
          k * kPieceBytes, std::min(kPieceBytes, content.size() - k * kPieceBytes));
      packets.push_back(piece(7, static_cast<std::uint32_t>(content.size()),
                              static_cast<std::uint32_t>(k * kPieceBytes), k, count, "A", part));
    }
    std::shuffle(packets.begin(), packets.end(), random);
    PacketReader reader;
    std::optional<PacketMessage> message;
    for (std::size_t i = 0; i < packets.size(); ++i) {
      reader.read(packets[i / 2], 99);  // another sender with the same number disturbs nothing
      message = reader.read(packets[i], 5);
      EXPECT_EQ(message.has_value(), i + 1 == packets.size());
    }
    ASSERT_TRUE(message);
    EXPECT_EQ(message->channel, "A");
    EXPECT_EQ(message->bytes, content);
    EXPECT_EQ(reader.bad_packets(), 0);
  }
}

TEST(PacketReader, PacketsThatEndLiblcmAreCountedAndDropped) {
  PacketReader reader;
  const Bytes some(100, std::byte{1});
  std::vector<Bytes> killers;
  // No zero after the channel: liblcm delivers 4 GB.
  Bytes no_zero;
  put(no_zero, 0x4c433032, 4);
  put(no_zero, 1, 4);
  put(no_zero, "CHANNEL");
  killers.push_back(no_zero);
  // A piece shorter than its header, and pieces that claim to lie outside of their message.
  Bytes short_piece = piece(1, 100, 0, 1, 2, "", {});
  short_piece.resize(12);
  killers.push_back(short_piece);
  killers.push_back(piece(1, 200, 0xFFFFFFF0, 1, 2, "", some));
  killers.push_back(piece(1, 200, 150, 1, 2, "", some));
  killers.push_back(piece(1, 200, 0, 5, 2, "", some));
  killers.push_back(piece(1, 200, 0, 0, 0, "A", some));
  killers.push_back(piece(1, 0xFFFFFFFF, 0, 0, 1, "A", some));
  killers.push_back(piece(1, 1U << 28, 0, 0, 1, "A", some));
  killers.push_back(whole(1, std::string(64, 'A'), some));
  killers.push_back(whole(1, "", some));
  killers.push_back(Bytes(7));
  killers.push_back(Bytes());
  for (std::size_t i = 0; i < killers.size(); ++i) {
    EXPECT_FALSE(reader.read(killers[i], 1)) << i;
    EXPECT_EQ(reader.bad_packets(), static_cast<std::int64_t>(i) + 1) << i;
  }
  // 10 MB claimed in one piece of 100 bytes: nothing is delivered, nothing allocated.
  EXPECT_FALSE(reader.read(piece(2, 10'000'000, 0, 0, 1, "A", some), 1));
  EXPECT_TRUE(reader.read(whole(2, "A", some), 1));
}

TEST(PacketReader, AFloodOfBeginningsStaysWithinItsMemory) {
  rusage before{};
  getrusage(RUSAGE_SELF, &before);
  PacketReader reader;
  const Bytes part(60'000, std::byte{1});
  for (std::uint32_t i = 0; i < 10'000; ++i) {  // 600 MB
    reader.read(piece(i, 15'000'000, 0, 0, 300, "A", part), i % 7);
  }
  rusage after{};
  getrusage(RUSAGE_SELF, &after);
#ifdef __SANITIZE_ADDRESS__
  constexpr std::int64_t kLimit_KiB =
      400 * 1024;  // the sanitizer keeps 256 MB of freed memory back
#else
  constexpr std::int64_t kLimit_KiB = 80 * 1024;
#endif
  EXPECT_LT(after.ru_maxrss - before.ru_maxrss, kLimit_KiB);
  EXPECT_GT(reader.abandoned(), 9'000);
}

TEST(PacketReader, RandomPacketsNeverGiveMoreThanCameIn) {
  const unsigned seed = std::random_device{}();
  std::cout << "seed " << seed << '\n';
  std::mt19937 random(seed);
  PacketReader reader;
  std::size_t in = 0;
  std::size_t out = 0;
  for (int i = 0; i < 100'000; ++i) {
    Bytes packet(random() % 120);
    for (std::byte& b : packet) {
      b = random() % 3 == 0 ? static_cast<std::byte>(random())
                            : static_cast<std::byte>(random() % 3);
    }
    if (packet.size() >= 4 && random() % 10 != 0) {
      const std::uint32_t magic = random() % 2 == 0 ? 0x4c433032 : 0x4c433033;
      for (std::size_t b = 0; b < 4; ++b) {
        packet[b] = static_cast<std::byte>(magic >> (24 - 8 * b));
      }
    }
    in += packet.size();
    if (const auto message = reader.read(packet, random() % 3)) {
      out += message->bytes.size();
      EXPECT_FALSE(message->channel.empty());
    }
  }
  EXPECT_LE(out, in);
}

}  // namespace
}  // namespace hedgehop::bus
