// The first three bytes are the claimed length, the rest is a packed blob.
#include <cstdint>
#include <cstdlib>

#include "bus/packing.hpp"
#include "messages/message_error.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 3) {
    return 0;
  }
  const std::int64_t claimed = data[0] * 65536 + data[1] * 256 + data[2];
  try {
    const auto* packed = reinterpret_cast<const std::byte*>(data + 3);
    const hedgehop::Bytes content = hedgehop::bus::unpack({packed, size - 3}, claimed);
    if (static_cast<std::int64_t>(content.size()) != claimed) {
      std::abort();
    }
  } catch (const hedgehop::messages::MessageError&) {
  }
  return 0;
}
