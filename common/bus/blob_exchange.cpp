#include "bus/blob_exchange.hpp"

#include <algorithm>
#include <deque>
#include <limits>
#include <list>
#include <map>
#include <optional>
#include <span>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "bus/bus.hpp"
#include "bus/packing.hpp"
#include "messages/message_error.hpp"

namespace hedgehop::bus {
namespace {

using messages::BlobRef;
using messages::Chunk;
using messages::chunk_count_of;
using messages::ChunkRange;
using messages::ChunkRequest;
using messages::kChunkBytes;
using messages::MessageError;

/// A chunk that went out this recently is not sent again: several readers may have asked at once.
constexpr std::int64_t kResendPause_us = 50'000;
/// What a chunk costs on the way besides its bytes, and what a kept one costs in memory.
constexpr std::int64_t kChunkOverhead = 120;
/// Requests in one round, each with up to kMaxRangesPerRequest ranges.
constexpr int kRequestsPerRound = 8;

ByteView piece_of(const Bytes& packed, std::int32_t number) {
  const auto begin = static_cast<std::size_t>(number * kChunkBytes);
  return ByteView(packed).subspan(
      begin, std::min(static_cast<std::size_t>(kChunkBytes), packed.size() - begin));
}

/// What must hold for any chunk, wherever it comes from.
bool is_sound(const Chunk& chunk) {
  if (chunk.packed_bytes < 1 || chunk.packed_bytes > messages::kMaxPackedBytes ||
      chunk.number < 0 || chunk.number >= chunk_count_of(chunk.packed_bytes)) {
    return false;
  }
  return static_cast<std::int64_t>(chunk.piece.size()) ==
         std::min(kChunkBytes, chunk.packed_bytes - chunk.number * kChunkBytes);
}

struct Offered {
  BlobRef ref;
  Bytes packed;
  std::optional<Bytes> content;          // once somebody here has asked
  std::vector<std::int64_t> sent_utime;  // of each chunk; 0: never
  std::vector<bool> is_queued;
};

struct Wanted {
  BlobRef ref;
  std::string what;
  std::int64_t order = 0;
  Bytes packed;  // sized by the first chunk
  std::vector<bool> has;
  std::int32_t missing = 0;
  std::optional<Bytes> content;
};

/// Chunks of a blob that nobody has wanted yet.
struct Unclaimed {
  std::int64_t packed_bytes = 0;
  std::map<std::int32_t, Bytes> pieces;
  std::int64_t held_bytes = 0;
  std::list<Hash128>::iterator age;
};

std::vector<ChunkRange> missing_ranges(const Wanted& wanted) {
  std::vector<ChunkRange> ranges;
  const std::int32_t count = wanted.ref.chunk_count();
  for (std::int32_t number = 0; number < count; ++number) {
    if (!wanted.has.empty() && wanted.has[static_cast<std::size_t>(number)]) {
      continue;
    }
    if (!ranges.empty() && ranges.back().first + ranges.back().count == number) {
      ++ranges.back().count;
    } else {
      ranges.push_back({wanted.ref.id, number, 1});
    }
  }
  return ranges;
}

}  // namespace

std::string to_text(const MissingChunks& missing) {
  std::ostringstream text;
  text << missing.what << " (blob " << missing.blob_id.hex().substr(0, 8)
       << "): " << missing.missing_count << " of " << missing.chunk_count << " chunks missing: ";
  constexpr std::size_t kRangesShown = 8;
  for (std::size_t i = 0; i < missing.ranges.size() && i < kRangesShown; ++i) {
    const ChunkRange& range = missing.ranges[i];
    text << (i > 0 ? ", " : "") << range.first;
    if (range.count > 1) {
      text << '-' << range.first + range.count - 1;
    }
  }
  if (missing.ranges.size() > kRangesShown) {
    text << " and " << missing.ranges.size() - kRangesShown << " more ranges";
  }
  return text.str();
}

struct BlobExchange::Impl {
  BlobExchangeOptions options;
  std::int64_t sender_id = 0;
  SendChunk send_chunk;
  SendRequest send_request;

  std::map<Hash128, Offered> offered;
  std::deque<std::pair<Hash128, std::int32_t>> send_queue;
  double tokens_bytes = 0.0;
  std::int64_t sent_chunks = 0;

  std::map<Hash128, Wanted> wanted;
  std::map<std::int64_t, Hash128> incomplete;  // by order of want()
  std::int64_t next_order = 0;
  std::int64_t kept_bytes = 0;

  std::map<Hash128, Unclaimed> unclaimed;
  std::list<Hash128> unclaimed_ages;  // touched longest ago first
  std::int64_t unclaimed_bytes = 0;

  Time now;
  bool has_ticked = false;
  // A round of questions: what was asked, what has come since.
  std::int64_t round = 0;
  std::int64_t asked = 0;
  std::int64_t arrived = 0;
  std::int64_t arrived_at_last_tick = 0;
  Time quiet_since;
  double pause_s = 0.0;

  void enqueue(Offered& blob, std::int32_t number) {
    const auto k = static_cast<std::size_t>(number);
    if (blob.is_queued[k]) {
      return;
    }
    const std::int64_t age_us = now.utime_us - blob.sent_utime[k];
    if (blob.sent_utime[k] != 0 && age_us >= 0 && age_us < kResendPause_us) {
      return;
    }
    blob.is_queued[k] = true;
    send_queue.emplace_back(blob.ref.id, number);
  }

  void drop_unclaimed(const Hash128& id) {
    const auto found = unclaimed.find(id);
    if (found != unclaimed.end()) {
      unclaimed_bytes -= found->second.held_bytes;
      unclaimed_ages.erase(found->second.age);
      unclaimed.erase(found);
    }
  }

  void keep_unclaimed(const Chunk& chunk) {
    auto [place, is_new] = unclaimed.try_emplace(chunk.blob_id);
    Unclaimed& blob = place->second;
    if (is_new) {
      blob.packed_bytes = chunk.packed_bytes;
      blob.age = unclaimed_ages.insert(unclaimed_ages.end(), chunk.blob_id);
    } else if (blob.packed_bytes != chunk.packed_bytes) {
      return;
    } else {
      unclaimed_ages.splice(unclaimed_ages.end(), unclaimed_ages, blob.age);
    }
    if (blob.pieces.try_emplace(chunk.number, chunk.piece).second) {
      const auto cost = static_cast<std::int64_t>(chunk.piece.size()) + kChunkOverhead;
      blob.held_bytes += cost;
      unclaimed_bytes += cost;
    }
    while (unclaimed_bytes > options.unclaimed_bytes_max) {
      drop_unclaimed(Hash128(unclaimed_ages.front()));
    }
  }

  void take(Wanted& blob, std::int32_t number, const Bytes& piece) {
    if (blob.missing == 0) {
      return;
    }
    if (blob.has.empty()) {
      blob.packed.resize(static_cast<std::size_t>(blob.ref.packed_bytes));
      blob.has.assign(static_cast<std::size_t>(blob.ref.chunk_count()), false);
    }
    const auto k = static_cast<std::size_t>(number);
    if (blob.has[k]) {
      return;
    }
    std::copy(piece.begin(), piece.end(),
              blob.packed.begin() + static_cast<std::ptrdiff_t>(number * kChunkBytes));
    blob.has[k] = true;
    --blob.missing;
    ++arrived;
    if (blob.missing > 0) {
      return;
    }
    if (hash128(blob.packed) == blob.ref.id) {
      incomplete.erase(blob.order);
      return;
    }
    // At least one chunk lied and nobody can tell which.
    blob.has.assign(blob.has.size(), false);
    blob.missing = blob.ref.chunk_count();
  }

  void send_what_the_pace_allows() {
    while (!send_queue.empty()) {
      const auto [id, number] = send_queue.front();
      const auto found = offered.find(id);
      if (found == offered.end()) {
        send_queue.pop_front();
        continue;
      }
      const ByteView piece = piece_of(found->second.packed, number);
      const double cost = static_cast<double>(piece.size()) + static_cast<double>(kChunkOverhead);
      if (tokens_bytes < cost) {
        return;
      }
      tokens_bytes -= cost;
      send_queue.pop_front();
      const auto k = static_cast<std::size_t>(number);
      found->second.is_queued[k] = false;
      found->second.sent_utime[k] = now.utime_us;
      Chunk chunk;
      chunk.blob_id = id;
      chunk.packed_bytes = found->second.ref.packed_bytes;
      chunk.number = number;
      chunk.piece.assign(piece.begin(), piece.end());
      send_chunk(chunk);
      ++sent_chunks;
    }
  }

  /// In [0, 0.5): the same for the same sender and round, different between senders.
  [[nodiscard]] double jitter() const {
    const std::int64_t seeds[2] = {sender_id, round};
    const std::uint64_t draw = hash128(std::as_bytes(std::span<const std::int64_t>(seeds))).low;
    return static_cast<double>(draw >> 11) * 0x1p-54;
  }

  /// Time until the next round of questions; negative when it is due.
  [[nodiscard]] double until_next_round_s() const {
    if (incomplete.empty()) {
      return 1.0;
    }
    if (arrived >= asked) {
      return -1.0;
    }
    return pause_s * (1.0 + jitter()) - seconds_between(quiet_since, now);
  }

  void ask() {
    if (arrived != arrived_at_last_tick) {
      arrived_at_last_tick = arrived;
      quiet_since = now;
    }
    if (until_next_round_s() > 0.0) {
      return;
    }
    const bool is_unanswered = asked > 0 && arrived == 0;
    pause_s =
        is_unanswered ? std::min(2.0 * pause_s, options.ask_pause_max_s) : options.ask_pause_s;
    ++round;
    asked = 0;
    arrived = 0;
    arrived_at_last_tick = 0;
    quiet_since = now;
    ChunkRequest request;
    int requests = 0;
    for (const auto& [order, id] : incomplete) {
      for (ChunkRange range : missing_ranges(wanted.at(id))) {
        range.count =
            std::min(range.count, static_cast<std::int32_t>(options.asked_chunks_max - asked));
        request.ranges.push_back(range);
        asked += range.count;
        const bool is_full = asked >= options.asked_chunks_max;
        if (is_full || request.ranges.size() == messages::kMaxRangesPerRequest) {
          send_request(request);
          request.ranges.clear();
          if (is_full || ++requests == kRequestsPerRound) {
            return;
          }
        }
      }
    }
    if (!request.ranges.empty()) {
      send_request(request);
    }
  }
};

BlobExchange::BlobExchange(const BlobExchangeOptions& options, std::int64_t sender_id,
                           SendChunk send_chunk, SendRequest send_request)
    : impl_(std::make_unique<Impl>()) {
  impl_->options = options;
  impl_->sender_id = sender_id;
  impl_->send_chunk = std::move(send_chunk);
  impl_->send_request = std::move(send_request);
  impl_->tokens_bytes = options.send_burst_bytes;
  impl_->pause_s = options.ask_pause_s;
}

BlobExchange::BlobExchange(const BlobExchangeOptions& options, Bus& bus)
    : BlobExchange(
          options, bus.sender_id(),
          [&bus](const Chunk& chunk) { bus.publish(messages::kChunkChannel, chunk, bus.now()); },
          [&bus](const ChunkRequest& request) {
            bus.publish(messages::kChunkRequestChannel, request, bus.now());
          }) {
  if (bus.is_replay()) {
    // Time stands still after the last event of a log, so nothing may wait for it.
    impl_->options.send_burst_bytes = std::numeric_limits<double>::infinity();
    impl_->tokens_bytes = impl_->options.send_burst_bytes;
  }
  bus.subscribe<Chunk>(messages::kChunkChannel,
                       [this](const Chunk& chunk, const messages::Stamp&) { receive(chunk); });
  bus.subscribe<ChunkRequest>(
      messages::kChunkRequestChannel,
      [this](const ChunkRequest& request, const messages::Stamp&) { receive(request); });
}

BlobExchange::~BlobExchange() = default;

messages::BlobRef BlobExchange::offer(ByteView content, bool send_now) {
  return offer_packed(pack(content), static_cast<std::int64_t>(content.size()), send_now);
}

messages::BlobRef BlobExchange::offer_records(ByteView content, std::size_t record_bytes,
                                              bool send_now) {
  return offer_packed(pack_records(content, record_bytes),
                      static_cast<std::int64_t>(content.size()), send_now);
}

messages::BlobRef BlobExchange::offer_packed(Bytes packed, std::int64_t content_bytes,
                                             bool send_now) {
  BlobRef ref;
  ref.id = hash128(packed);
  ref.packed_bytes = static_cast<std::int64_t>(packed.size());
  ref.content_bytes = content_bytes;
  const auto [place, is_new] = impl_->offered.try_emplace(ref.id);
  if (is_new) {
    Offered& blob = place->second;
    blob.ref = ref;
    blob.packed = std::move(packed);
    blob.sent_utime.assign(static_cast<std::size_t>(ref.chunk_count()), 0);
    blob.is_queued.assign(static_cast<std::size_t>(ref.chunk_count()), false);
  }
  if (send_now) {
    send_again(ref.id);
  }
  return ref;
}

void BlobExchange::send_again(const Hash128& blob_id) {
  const auto found = impl_->offered.find(blob_id);
  if (found == impl_->offered.end()) {
    throw std::invalid_argument("blob " + blob_id.hex() + " is not offered");
  }
  for (std::int32_t number = 0; number < found->second.ref.chunk_count(); ++number) {
    impl_->enqueue(found->second, number);
  }
}

void BlobExchange::withdraw(const Hash128& blob_id) { impl_->offered.erase(blob_id); }

void BlobExchange::want(const messages::BlobRef& ref, std::string what) {
  Impl& impl = *impl_;
  if (impl.offered.contains(ref.id)) {
    return;
  }
  if (const auto found = impl.wanted.find(ref.id); found != impl.wanted.end()) {
    if (found->second.ref != ref) {
      throw MessageError(what + ": blob " + ref.id.hex() + " is said to have two lengths");
    }
    found->second.what = std::move(what);
    return;
  }
  if (ref.packed_bytes < 1 || ref.packed_bytes > messages::kMaxPackedBytes) {
    throw MessageError(what + ": a packed length of " + std::to_string(ref.packed_bytes) +
                       " bytes is out of range");
  }
  if (impl.kept_bytes + ref.packed_bytes > impl.options.kept_bytes_max) {
    throw MessageError(what + ": " + std::to_string(ref.packed_bytes) +
                       " bytes do not fit beside what is wanted already");
  }
  Wanted& blob = impl.wanted[ref.id];
  blob.ref = ref;
  blob.what = std::move(what);
  blob.order = impl.next_order++;
  blob.missing = ref.chunk_count();
  impl.kept_bytes += ref.packed_bytes;
  impl.incomplete.emplace(blob.order, ref.id);
  impl.pause_s = impl.options.ask_pause_s;  // silence about other blobs says nothing about this one
  if (const auto found = impl.unclaimed.find(ref.id); found != impl.unclaimed.end()) {
    if (found->second.packed_bytes == ref.packed_bytes) {
      for (const auto& [number, piece] : found->second.pieces) {
        impl.take(blob, number, piece);
      }
    }
    impl.drop_unclaimed(ref.id);
  }
}

void BlobExchange::forget(const Hash128& blob_id) {
  Impl& impl = *impl_;
  if (const auto found = impl.wanted.find(blob_id); found != impl.wanted.end()) {
    impl.kept_bytes -= found->second.ref.packed_bytes;
    impl.incomplete.erase(found->second.order);
    impl.wanted.erase(found);
  }
}

const Bytes* BlobExchange::content(const Hash128& blob_id) {
  if (const auto found = impl_->offered.find(blob_id); found != impl_->offered.end()) {
    Offered& blob = found->second;
    if (!blob.content) {
      blob.content = unpack(blob.packed, blob.ref.content_bytes);
    }
    return &*blob.content;
  }
  const auto found = impl_->wanted.find(blob_id);
  if (found == impl_->wanted.end() || found->second.missing > 0) {
    return nullptr;
  }
  Wanted& blob = found->second;
  if (!blob.content) {
    blob.content = unpack(blob.packed, blob.ref.content_bytes);
    blob.packed = Bytes();
  }
  return &*blob.content;
}

bool BlobExchange::is_complete(const Hash128& blob_id) const {
  const auto found = impl_->wanted.find(blob_id);
  return impl_->offered.contains(blob_id) ||
         (found != impl_->wanted.end() && found->second.missing == 0);
}

std::vector<MissingChunks> BlobExchange::missing() const {
  std::vector<MissingChunks> result;
  for (const auto& [order, id] : impl_->incomplete) {
    const Wanted& blob = impl_->wanted.at(id);
    result.push_back({id, blob.what, blob.ref.chunk_count(), missing_ranges(blob), blob.missing});
  }
  return result;
}

std::int64_t BlobExchange::missing_chunk_count() const {
  std::int64_t count = 0;
  for (const auto& [order, id] : impl_->incomplete) {
    count += impl_->wanted.at(id).missing;
  }
  return count;
}

std::int64_t BlobExchange::sent_chunk_count() const { return impl_->sent_chunks; }

void BlobExchange::receive(const messages::Chunk& chunk) {
  Impl& impl = *impl_;
  if (!is_sound(chunk) || impl.offered.contains(chunk.blob_id)) {
    return;
  }
  const auto found = impl.wanted.find(chunk.blob_id);
  if (found == impl.wanted.end()) {
    impl.keep_unclaimed(chunk);
  } else if (found->second.ref.packed_bytes == chunk.packed_bytes) {
    impl.take(found->second, chunk.number, chunk.piece);
  }
}

void BlobExchange::receive(const messages::ChunkRequest& request) {
  for (const ChunkRange& range : request.ranges) {
    const auto found = impl_->offered.find(range.blob_id);
    if (found == impl_->offered.end()) {
      continue;
    }
    const std::int32_t end =
        std::min<std::int32_t>(range.first + range.count, found->second.ref.chunk_count());
    for (std::int32_t number = std::max(range.first, 0); number < end; ++number) {
      impl_->enqueue(found->second, number);
    }
  }
}

void BlobExchange::tick(Time now) {
  Impl& impl = *impl_;
  const double elapsed_s = impl.has_ticked ? seconds_between(impl.now, now) : 0.0;
  if (!impl.has_ticked || elapsed_s < 0.0) {
    impl.quiet_since = now;  // a clock that was set back must not silence us
  }
  impl.has_ticked = true;
  impl.now = now;
  impl.tokens_bytes =
      std::min(impl.options.send_burst_bytes,
               impl.tokens_bytes + std::max(elapsed_s, 0.0) * impl.options.send_rate_bytesps);
  impl.send_what_the_pace_allows();
  impl.ask();
}

double BlobExchange::next_tick_s(Time now) const {
  double wait_s = 1.0;
  if (!impl_->send_queue.empty()) {
    wait_s = 0.001;
  }
  if (!impl_->incomplete.empty()) {
    wait_s = std::min(wait_s, impl_->until_next_round_s() - seconds_between(impl_->now, now));
  }
  return std::clamp(wait_s, 0.0, 1.0);
}

}  // namespace hedgehop::bus
