#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/hash.hpp"
#include "messages/message.hpp"

/// Content that is longer than a message travels as a blob: encoded, packed (bus/packing.hpp), cut
/// into chunks. A blob is known by the hash of its packed bytes.
namespace hedgehop::messages {

/// Bytes of a blob in one chunk; only the last chunk is shorter.
inline constexpr std::int64_t kChunkBytes = 1280;
inline constexpr std::int64_t kMaxPackedBytes = 64LL << 20;
inline constexpr std::int64_t kMaxContentBytes = 256LL << 20;
inline constexpr std::size_t kMaxRangesPerRequest = 50;

constexpr std::int32_t chunk_count_of(std::int64_t packed_bytes) {
  return static_cast<std::int32_t>((packed_bytes + kChunkBytes - 1) / kChunkBytes);
}

/// Names a blob and says how long it is.
struct BlobRef {
  Hash128 id;  // of the packed bytes
  std::int64_t packed_bytes = 0;
  std::int64_t content_bytes = 0;  // after unpacking

  [[nodiscard]] std::int32_t chunk_count() const { return chunk_count_of(packed_bytes); }
  bool operator==(const BlobRef&) const = default;
};

/// Channel CHUNK: piece `number` of a blob, chunk_count_of(packed_bytes) in all.
struct Chunk {
  Hash128 blob_id;
  std::int64_t packed_bytes = 0;
  std::int32_t number = 0;
  Bytes piece;  // kChunkBytes long, the last one what is left

  bool operator==(const Chunk&) const = default;
};
Bytes to_message(const Chunk& chunk, const Stamp& stamp);
template <>
Chunk from_message<Chunk>(ByteView bytes, Stamp& stamp);

/// Neighbouring chunks of one blob.
struct ChunkRange {
  Hash128 blob_id;
  std::int32_t first = 0;
  std::int32_t count = 0;

  bool operator==(const ChunkRange&) const = default;
};

/// Channel CHUNK_REQUEST: what a reader lacks; 1 to kMaxRangesPerRequest ranges.
struct ChunkRequest {
  std::vector<ChunkRange> ranges;

  bool operator==(const ChunkRequest&) const = default;
};
Bytes to_message(const ChunkRequest& request, const Stamp& stamp);
template <>
ChunkRequest from_message<ChunkRequest>(ByteView bytes, Stamp& stamp);

}  // namespace hedgehop::messages
