// A stream of datagrams: each begins with one byte for its sender and two for its length.
#include <algorithm>
#include <cstdint>
#include <cstdlib>

#include "bus/packets.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  hedgehop::bus::PacketReader reader;
  std::size_t in = 0;
  std::size_t out = 0;
  while (size >= 3) {
    const std::uint64_t sender = data[0] % 4;
    const std::size_t length = std::min<std::size_t>(data[1] * 256U + data[2], size - 3);
    in += length;
    const auto* packet = reinterpret_cast<const std::byte*>(data + 3);
    if (const auto message = reader.read({packet, length}, sender)) {
      out += message->bytes.size();
      if (message->channel.empty() || message->channel.size() > 63) {
        std::abort();
      }
    }
    data += 3 + length;
    size -= 3 + length;
  }
  if (out > in) {
    std::abort();
  }
  return 0;
}
