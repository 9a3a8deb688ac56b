#pragma once

#include <cstdint>

#include "base/hash.hpp"
#include "messages/blob.hpp"

namespace hedgehop::bus {

/// Compresses content for the way: one zstd frame with its content size, level 3. Same content and
/// same library, same bytes. Throws std::invalid_argument above messages::kMaxContentBytes.
Bytes pack(ByteView content);

/// Inverse of pack(). Allocates `content_bytes` once the frame itself claims that length. Throws
/// messages::MessageError.
Bytes unpack(ByteView packed, std::int64_t content_bytes);

}  // namespace hedgehop::bus
