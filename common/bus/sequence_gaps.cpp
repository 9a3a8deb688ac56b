#include "bus/sequence_gaps.hpp"

namespace hedgehop::bus {
namespace {

// More channels and senders than that are an attack; the count begins anew.
constexpr std::size_t kSequencesMax = 4096;
// Nobody sends so much while he is not heard: such a leap is no loss.
constexpr std::int64_t kLeapMax = 1'000'000'000;

}  // namespace

void SequenceGaps::note(std::string_view channel, const messages::Stamp& stamp) {
  if (sequence_count_ > kSequencesMax) {
    channels_.clear();
    sequence_count_ = 0;
  }
  auto senders = channels_.find(channel);
  if (senders == channels_.end()) {
    senders = channels_.emplace(channel, Senders{}).first;
  }
  const auto [place, is_first] =
      senders->second.try_emplace(stamp.sender_id, Sequence{stamp.seq, 0});
  if (is_first) {
    ++sequence_count_;
    return;
  }
  Sequence& sequence = place->second;
  if (stamp.seq > sequence.last) {
    const std::int64_t skipped = stamp.seq - sequence.last - 1;
    if (skipped < kLeapMax) {
      sequence.missing += skipped;
      missing_ += skipped;
    }
    sequence.last = stamp.seq;
  } else if (stamp.seq < sequence.last && sequence.missing > 0) {
    --sequence.missing;  // late, not lost
    --missing_;
  }
}

std::map<std::int64_t, std::int64_t> SequenceGaps::missing_by_sender() const {
  std::map<std::int64_t, std::int64_t> result;
  for (const auto& [channel, senders] : channels_) {
    for (const auto& [sender_id, sequence] : senders) {
      if (sequence.missing > 0) {
        result[sender_id] += sequence.missing;
      }
    }
  }
  return result;
}

}  // namespace hedgehop::bus
