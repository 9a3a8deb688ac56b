#include "bus/packing.hpp"

#include <stdexcept>
#include <string>
#include <zstd.h>

#include "messages/message_error.hpp"

namespace hedgehop::bus {

namespace {
constexpr int kLevel = 3;
}

Bytes pack(ByteView content) {
  if (static_cast<std::int64_t>(content.size()) > messages::kMaxContentBytes) {
    throw std::invalid_argument("a blob of " + std::to_string(content.size()) +
                                " bytes is too long for the bus, at most " +
                                std::to_string(messages::kMaxContentBytes) + " fit");
  }
  Bytes packed(ZSTD_compressBound(content.size()));
  const std::size_t size =
      ZSTD_compress(packed.data(), packed.size(), content.data(), content.size(), kLevel);
  if (ZSTD_isError(size) != 0) {
    throw std::runtime_error(std::string("zstd: ") + ZSTD_getErrorName(size));
  }
  packed.resize(size);
  if (static_cast<std::int64_t>(size) > messages::kMaxPackedBytes) {
    throw std::invalid_argument("a blob of " + std::to_string(size) +
                                " packed bytes is too long for the bus, at most " +
                                std::to_string(messages::kMaxPackedBytes) + " fit");
  }
  return packed;
}

Bytes unpack(ByteView packed, std::int64_t content_bytes) {
  const auto refuse = [](const std::string& why) {
    throw messages::MessageError("packed blob: " + why);
  };
  if (content_bytes < 0 || content_bytes > messages::kMaxContentBytes) {
    refuse("content length " + std::to_string(content_bytes) + " is out of range");
  }
  const unsigned long long claimed = ZSTD_getFrameContentSize(packed.data(), packed.size());
  if (claimed != static_cast<unsigned long long>(content_bytes)) {
    refuse("is no zstd frame of " + std::to_string(content_bytes) + " bytes");
  }
  Bytes content(static_cast<std::size_t>(content_bytes));
  const std::size_t size =
      ZSTD_decompress(content.data(), content.size(), packed.data(), packed.size());
  if (ZSTD_isError(size) != 0 || size != content.size()) {
    refuse(std::string("does not unpack: ") +
           (ZSTD_isError(size) != 0 ? ZSTD_getErrorName(size) : "too short"));
  }
  return content;
}

}  // namespace hedgehop::bus
