#include "output/mcap_file.hpp"

#include <algorithm>
#include <array>

#include "base/errors.hpp"

namespace hedgehop::output {
namespace {

constexpr std::string_view kMagic("\x89MCAP0\r\n", 8);
constexpr std::size_t kChunkBytes = 1U << 20U;

enum class Op : std::uint8_t {
  kHeader = 0x01,
  kFooter = 0x02,
  kSchema = 0x03,
  kChannel = 0x04,
  kMessage = 0x05,
  kChunk = 0x06,
  kMessageIndex = 0x07,
  kChunkIndex = 0x08,
  kStatistics = 0x0B,
  kMetadata = 0x0C,
  kMetadataIndex = 0x0D,
  kSummaryOffset = 0x0E,
  kDataEnd = 0x0F,
};

// CRC-32 as in ISO 3309 and zlib: reflected polynomial 0xEDB88320.
std::uint32_t crc32(std::string_view bytes) {
  static const std::array<std::uint32_t, 256> table = [] {
    std::array<std::uint32_t, 256> made{};
    for (std::uint32_t i = 0; i < 256; ++i) {
      std::uint32_t value = i;
      for (int bit = 0; bit < 8; ++bit) {
        value = (value >> 1U) ^ ((value & 1U) != 0 ? 0xEDB88320U : 0U);
      }
      made[i] = value;
    }
    return made;
  }();
  std::uint32_t crc = 0xFFFFFFFFU;
  for (const char c : bytes) {
    crc = (crc >> 8U) ^ table[(crc ^ static_cast<unsigned char>(c)) & 0xFFU];
  }
  return ~crc;
}

template <typename Integer>
void put(std::string& to, Integer value) {
  for (std::size_t i = 0; i < sizeof(Integer); ++i) {
    to += static_cast<char>(static_cast<std::uint64_t>(value) >> (8 * i) & 0xFFU);
  }
}

void put_text(std::string& to, std::string_view text) {
  put(to, static_cast<std::uint32_t>(text.size()));
  to += text;
}

void put_record(std::string& to, Op op, std::string_view content) {
  put(to, static_cast<std::uint8_t>(op));
  put(to, static_cast<std::uint64_t>(content.size()));
  to += content;
}

}  // namespace

McapFile::McapFile(std::string_view library) : file_(kMagic) {
  std::string header;
  put_text(header, "");  // no profile
  put_text(header, library);
  put_record(file_, Op::kHeader, header);
}

std::uint16_t McapFile::add_channel(std::string_view topic, std::string_view schema_name,
                                    std::string_view schema) {
  HEDGEHOP_ASSERT(messages_ == 0 && channels_.size() < 1000);
  const auto number = static_cast<std::uint16_t>(channels_.size() + 1);
  Channel channel;
  std::string content;
  put(content, number);
  put_text(content, schema_name);
  put_text(content, "jsonschema");
  put_text(content, schema);
  put_record(channel.schema_record, Op::kSchema, content);
  content.clear();
  put(content, number);
  put(content, number);  // of the schema
  put_text(content, topic);
  put_text(content, "json");
  put_text(content, "");  // no metadata: a map of 0 bytes
  put_record(channel.channel_record, Op::kChannel, content);
  file_ += channel.schema_record + channel.channel_record;
  channels_.push_back(std::move(channel));
  return number;
}

void McapFile::add_metadata(std::string_view name, const Entries& entries) {
  end_chunk();
  std::string content;
  put_text(content, name);
  std::string map;
  for (const auto& [key, value] : entries) {
    put_text(map, key);
    put_text(map, value);
  }
  put_text(content, map);
  MetadataPlace place{file_.size(), 0, std::string(name)};
  put_record(file_, Op::kMetadata, content);
  place.bytes = file_.size() - place.offset;
  metadata_.push_back(std::move(place));
}

void McapFile::add_message(std::uint16_t channel, std::uint64_t time_ns, std::string_view json) {
  HEDGEHOP_ASSERT(channel >= 1 && channel <= channels_.size());
  Channel& to = channels_[channel - 1U];
  if (chunk_.empty()) {
    chunk_first_ns_ = chunk_last_ns_ = time_ns;
  }
  if (messages_ == 0) {
    first_ns_ = last_ns_ = time_ns;
  }
  chunk_first_ns_ = std::min(chunk_first_ns_, time_ns);
  chunk_last_ns_ = std::max(chunk_last_ns_, time_ns);
  first_ns_ = std::min(first_ns_, time_ns);
  last_ns_ = std::max(last_ns_, time_ns);
  to.in_chunk.emplace_back(time_ns, chunk_.size());
  std::string content;
  put(content, channel);
  put(content, static_cast<std::uint32_t>(to.messages));
  put(content, time_ns);  // recorded
  put(content, time_ns);  // published
  content += json;
  put_record(chunk_, Op::kMessage, content);
  ++to.messages;
  ++messages_;
  if (chunk_.size() >= kChunkBytes) {
    end_chunk();
  }
}

void McapFile::end_chunk() {
  if (chunk_.empty()) {
    return;
  }
  const std::uint64_t start = file_.size();
  std::string content;
  put(content, chunk_first_ns_);
  put(content, chunk_last_ns_);
  put(content, static_cast<std::uint64_t>(chunk_.size()));
  put(content, crc32(chunk_));
  put_text(content, "");  // no compression
  put(content, static_cast<std::uint64_t>(chunk_.size()));
  content += chunk_;
  put_record(file_, Op::kChunk, content);
  const std::uint64_t chunk_bytes = file_.size() - start;

  const std::uint64_t indexes = file_.size();
  std::string offsets;
  for (std::size_t i = 0; i < channels_.size(); ++i) {
    Channel& channel = channels_[i];
    if (channel.in_chunk.empty()) {
      continue;
    }
    const auto number = static_cast<std::uint16_t>(i + 1);
    put(offsets, number);
    put(offsets, static_cast<std::uint64_t>(file_.size()));
    std::string places;
    for (const auto& [time_ns, offset] : channel.in_chunk) {
      put(places, time_ns);
      put(places, offset);
    }
    std::string index;
    put(index, number);
    put_text(index, places);
    put_record(file_, Op::kMessageIndex, index);
    channel.in_chunk.clear();
  }
  std::string index;
  put(index, chunk_first_ns_);
  put(index, chunk_last_ns_);
  put(index, start);
  put(index, chunk_bytes);
  put_text(index, offsets);
  put(index, static_cast<std::uint64_t>(file_.size()) - indexes);
  put_text(index, "");
  put(index, static_cast<std::uint64_t>(chunk_.size()));
  put(index, static_cast<std::uint64_t>(chunk_.size()));
  std::string record;
  put_record(record, Op::kChunkIndex, index);
  chunk_indexes_.push_back(std::move(record));
  chunk_.clear();
}

std::string McapFile::finish() {
  end_chunk();
  std::string content;
  put(content, crc32(file_));
  put_record(file_, Op::kDataEnd, content);

  const std::uint64_t summary_start = file_.size();
  std::string offsets;  // records of the last section
  const auto add_group = [&](Op op, const std::string& records) {
    if (records.empty()) {
      return;
    }
    std::string offset;
    put(offset, static_cast<std::uint8_t>(op));
    put(offset, static_cast<std::uint64_t>(file_.size()));
    put(offset, static_cast<std::uint64_t>(records.size()));
    put_record(offsets, Op::kSummaryOffset, offset);
    file_ += records;
  };
  std::string schemas;
  std::string channels;
  std::string counts;
  for (std::size_t i = 0; i < channels_.size(); ++i) {
    schemas += channels_[i].schema_record;
    channels += channels_[i].channel_record;
    put(counts, static_cast<std::uint16_t>(i + 1));
    put(counts, channels_[i].messages);
  }
  add_group(Op::kSchema, schemas);
  add_group(Op::kChannel, channels);
  std::string statistics;
  put(statistics, messages_);
  put(statistics, static_cast<std::uint16_t>(channels_.size()));
  put(statistics, static_cast<std::uint32_t>(channels_.size()));
  put(statistics, std::uint32_t{0});  // attachments
  put(statistics, static_cast<std::uint32_t>(metadata_.size()));
  put(statistics, static_cast<std::uint32_t>(chunk_indexes_.size()));
  put(statistics, first_ns_);
  put(statistics, last_ns_);
  put_text(statistics, counts);
  std::string record;
  put_record(record, Op::kStatistics, statistics);
  add_group(Op::kStatistics, record);
  std::string places;
  for (const MetadataPlace& place : metadata_) {
    std::string index;
    put(index, place.offset);
    put(index, place.bytes);
    put_text(index, place.name);
    put_record(places, Op::kMetadataIndex, index);
  }
  add_group(Op::kMetadataIndex, places);
  std::string chunks;
  for (const std::string& index : chunk_indexes_) {
    chunks += index;
  }
  add_group(Op::kChunkIndex, chunks);

  const std::uint64_t offsets_start = file_.size();
  file_ += offsets;
  // The footer's CRC covers its own record up to itself: opcode, length and the two offsets.
  put(file_, static_cast<std::uint8_t>(Op::kFooter));
  put(file_, std::uint64_t{20});
  put(file_, summary_start);
  put(file_, offsets_start);
  put(file_, crc32(std::string_view(file_).substr(static_cast<std::size_t>(summary_start))));
  file_ += kMagic;
  return std::move(file_);
}

}  // namespace hedgehop::output
