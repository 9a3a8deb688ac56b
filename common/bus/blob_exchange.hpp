#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "base/hash.hpp"
#include "base/time.hpp"
#include "messages/blob.hpp"
#include "messages/message.hpp"

namespace hedgehop::bus {

class Bus;

struct BlobExchangeOptions {
  double send_rate_bytesps = 8e6;  // pace of chunks, payload bytes per second
  double send_burst_bytes = 65536.0;
  double ask_pause_s = 0.15;                  // silence before missing chunks are asked for again
  double ask_pause_max_s = 2.0;               // pauses double up to this while nothing arrives
  int asked_chunks_max = 2048;                // outstanding at a time
  std::int64_t kept_bytes_max = 512LL << 20;  // of blobs that are wanted or complete
  std::int64_t unclaimed_bytes_max = 128LL << 20;  // of chunks that came before anybody wanted them
};

/// What a wanted blob still lacks.
struct MissingChunks {
  Hash128 blob_id;
  std::string what;  // as want() was told
  std::int32_t chunk_count = 0;
  std::vector<messages::ChunkRange> ranges;
  std::int32_t missing_count = 0;
};
/// "tile ... (blob 0123...): 3 of 12 chunks missing: 4, 7-8".
std::string to_text(const MissingChunks& missing);

/// Both ends of chunked transfer: offers blobs and answers for them, wants blobs and asks for them.
///
/// Chunks may come in any order, more than once, from anybody, and before want(): what nobody has
/// wanted yet is kept, oldest blob dropped first, so that a log works in any interleaving. A blob
/// is complete when its bytes have the hash that names it; chunks that lead to another hash are
/// thrown away and asked for again. Questions are asked in tick(), with jitter drawn from the
/// sender id; a question that nobody answers costs nothing but its message. No clock: `now` comes
/// from the caller and only paces.
class BlobExchange {
 public:
  using SendChunk = std::function<void(const messages::Chunk&)>;
  using SendRequest = std::function<void(const messages::ChunkRequest&)>;

  BlobExchange(const BlobExchangeOptions& options, std::int64_t sender_id, SendChunk send_chunk,
               SendRequest send_request);
  /// Connected: subscribes CHUNK and CHUNK_REQUEST and publishes on them.
  BlobExchange(const BlobExchangeOptions& options, Bus& bus);
  ~BlobExchange();
  BlobExchange(const BlobExchange&) = delete;
  BlobExchange& operator=(const BlobExchange&) = delete;

  /// Packs and keeps content, to answer questions for it. With `send_now` all chunks are queued at
  /// once, so that readers and recorders get them unasked. Offering again is harmless.
  messages::BlobRef offer(ByteView content, bool send_now);
  /// The same for content that ends in smooth records, packed by pack_records().
  messages::BlobRef offer_records(ByteView content, std::size_t record_bytes, bool send_now);
  /// Queues all chunks of an offered blob again.
  void send_again(const Hash128& blob_id);
  void withdraw(const Hash128& blob_id);

  /// Collects a blob. `what` names it to people: "tile of layer surface, column 3, row 0". Wanting
  /// what is offered here or complete already costs nothing. Throws messages::MessageError if the
  /// memory for wanted blobs does not hold it.
  void want(const messages::BlobRef& ref, std::string what);
  /// Gives a blob up, complete or not, and frees it.
  void forget(const Hash128& blob_id);

  /// Unpacked content of a blob that is complete or offered here; nullptr while it is not. Valid
  /// until forget() or withdraw(). A blob that unpacks to something else than its reference says
  /// throws messages::MessageError.
  [[nodiscard]] const Bytes* content(const Hash128& blob_id);
  [[nodiscard]] bool is_complete(const Hash128& blob_id) const;

  /// What is wanted and incomplete, in the order of want().
  [[nodiscard]] std::vector<MissingChunks> missing() const;
  [[nodiscard]] std::int64_t missing_chunk_count() const;
  [[nodiscard]] std::int64_t sent_chunk_count() const;

  void receive(const messages::Chunk& chunk);
  void receive(const messages::ChunkRequest& request);

  /// Sends what the pace allows and asks for what is missing.
  void tick(Time now);
  /// How long tick() may wait without slowing anything down [s]; at most 1.
  [[nodiscard]] double next_tick_s(Time now) const;

 private:
  messages::BlobRef offer_packed(Bytes packed, std::int64_t content_bytes, bool send_now);

  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace hedgehop::bus
