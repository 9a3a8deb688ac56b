#include "messages/blob.hpp"

#include <cstring>

#include "messages/wire.hpp"

#include "hedgehop/chunk_request_t.hpp"
#include "hedgehop/chunk_t.hpp"

namespace hedgehop::messages {

static_assert(kChunkBytes == chunk_t::MAX_BYTES);
static_assert(kMaxRangesPerRequest == chunk_request_t::MAX_RANGES);

Bytes to_message(const Chunk& chunk, const Stamp& stamp) {
  chunk_t message{};
  wire::put_stamp(message, stamp);
  wire::put(message.blob_id, chunk.blob_id);
  message.packed_bytes = chunk.packed_bytes;
  message.chunk_number = chunk.number;
  message.chunk_count = chunk_count_of(chunk.packed_bytes);
  message.num_bytes = static_cast<std::int32_t>(chunk.piece.size());
  message.piece.resize(chunk.piece.size());
  if (!chunk.piece.empty()) {
    std::memcpy(message.piece.data(), chunk.piece.data(), chunk.piece.size());
  }
  return wire::published<Chunk>(message);
}

template <>
Chunk from_message<Chunk>(ByteView bytes, Stamp& stamp) {
  const auto message = wire::decoded<chunk_t>(bytes, stamp);
  const wire::Check check(chunk_t::getTypeName());
  Chunk chunk;
  chunk.blob_id = wire::hash_in(message.blob_id);
  chunk.packed_bytes =
      check.within<std::int64_t>("packed_bytes", message.packed_bytes, 1, kMaxPackedBytes);
  const std::int32_t count = chunk_count_of(chunk.packed_bytes);
  check.within("chunk_count", message.chunk_count, count, count);
  chunk.number = check.within("chunk_number", message.chunk_number, 0, count - 1);
  const auto size = static_cast<std::int32_t>(
      std::min(kChunkBytes, chunk.packed_bytes - chunk.number * kChunkBytes));
  check.within("num_bytes", message.num_bytes, size, size);
  chunk.piece.resize(message.piece.size());
  std::memcpy(chunk.piece.data(), message.piece.data(), message.piece.size());
  return chunk;
}

Bytes to_message(const ChunkRequest& request, const Stamp& stamp) {
  chunk_request_t message{};
  wire::put_stamp(message, stamp);
  message.num_ranges = static_cast<std::int32_t>(request.ranges.size());
  for (const ChunkRange& range : request.ranges) {
    chunk_range_t& field = message.ranges.emplace_back();
    wire::put(field.blob_id, range.blob_id);
    field.first_chunk = range.first;
    field.chunk_count = range.count;
  }
  return wire::published<ChunkRequest>(message);
}

template <>
ChunkRequest from_message<ChunkRequest>(ByteView bytes, Stamp& stamp) {
  const auto message = wire::decoded<chunk_request_t>(bytes, stamp);
  const wire::Check check(chunk_request_t::getTypeName());
  check.within<std::int32_t>("num_ranges", message.num_ranges, 1, chunk_request_t::MAX_RANGES);
  const std::int32_t chunks_max = chunk_count_of(kMaxPackedBytes);
  ChunkRequest request;
  for (const chunk_range_t& field : message.ranges) {
    ChunkRange range;
    range.blob_id = wire::hash_in(field.blob_id);
    range.first = check.within("ranges.first_chunk", field.first_chunk, 0, chunks_max - 1);
    range.count =
        check.within("ranges.chunk_count", field.chunk_count, 1, chunks_max - range.first);
    request.ranges.push_back(range);
  }
  return request;
}

}  // namespace hedgehop::messages
