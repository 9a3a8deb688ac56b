#pragma once

#include <cstddef>
#include <cstdint>

#include "base/hash.hpp"
#include "messages/blob.hpp"

namespace hedgehop::bus {

/// Compresses content for the way: one zstd frame with its content size, level 3. Same content and
/// same library, same bytes. Throws std::invalid_argument above messages::kMaxContentBytes.
Bytes pack(ByteView content);

/// The same for content that ends in as many whole records of `record_bytes` as fit, of eight-byte
/// big-endian floats that vary smoothly from record to record, as the states of a trajectory do.
/// They are replaced by their third differences as integers, whose high bytes are nearly all zero:
/// a trajectory becomes half as long as by pack() alone, and loses no bit. The frame, of level 1,
/// is preceded by "HR3D" and record_bytes as four big-endian bytes. Throws std::invalid_argument
/// unless record_bytes is a multiple of 8 from 8 to 4096.
Bytes pack_records(ByteView content, std::size_t record_bytes);

/// Inverse of pack() and of pack_records(). Allocates `content_bytes` once the frame itself claims
/// that length. Throws messages::MessageError.
Bytes unpack(ByteView packed, std::int64_t content_bytes);

}  // namespace hedgehop::bus
