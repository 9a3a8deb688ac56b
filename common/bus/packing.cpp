#include "bus/packing.hpp"

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string>
#include <vector>
#include <zstd.h>

#include "messages/message_error.hpp"

namespace hedgehop::bus {

namespace {

constexpr int kLevel = 3;
constexpr int kRecordsLevel = 1;  // a quarter of the time, 4 % more bytes
constexpr std::size_t kWordBytes = 8;
constexpr std::size_t kRecordBytesMax = 4096;
constexpr std::array<std::byte, 4> kRecordsMark = {std::byte{'H'}, std::byte{'R'}, std::byte{'3'},
                                                   std::byte{'D'}};
constexpr std::size_t kRecordsHeaderBytes = kRecordsMark.size() + 4;
constexpr std::uint64_t kSignBit = 1ULL << 63;

bool is_record_length(std::size_t record_bytes) {
  return record_bytes >= kWordBytes && record_bytes <= kRecordBytesMax &&
         record_bytes % kWordBytes == 0;
}

std::uint64_t big_endian(const std::byte* at) {
  std::uint64_t word = 0;
  for (std::size_t i = 0; i < kWordBytes; ++i) {
    word = word << 8 | std::to_integer<std::uint64_t>(at[i]);
  }
  return word;
}

void put_big_endian(std::uint64_t word, std::byte* at) {
  for (std::size_t i = 0; i < kWordBytes; ++i) {
    at[i] = static_cast<std::byte>(word >> (8 * (kWordBytes - 1 - i)));
  }
}

// The bits of floats as integers in the floats' order, so that neighbours stay neighbours.
std::uint64_t ordered(std::uint64_t bits) {
  return (bits & kSignBit) != 0 ? ~bits : bits | kSignBit;
}
std::uint64_t unordered(std::uint64_t number) {
  return (number & kSignBit) != 0 ? number & ~kSignBit : ~number;
}

// Small differences of either sign as small numbers.
std::uint64_t folded(std::uint64_t difference) {
  return difference << 1 ^ ((difference & kSignBit) != 0 ? ~0ULL : 0ULL);
}
std::uint64_t unfolded(std::uint64_t number) {
  return number >> 1 ^ ((number & 1) != 0 ? ~0ULL : 0ULL);
}

/// Continues a sequence by its last three members, modulo 2^64.
class Extrapolation {
 public:
  [[nodiscard]] std::uint64_t next() const { return 3 * last_ - 3 * second_ + third_; }
  void append(std::uint64_t member) {
    third_ = second_;
    second_ = last_;
    last_ = member;
  }

 private:
  std::uint64_t last_ = 0, second_ = 0, third_ = 0;
};

// What precedes the records is copied; then, word by word of the record, the differences of all
// records, a plane for each of their bytes.
Bytes to_differences(ByteView content, std::size_t record_bytes) {
  const std::size_t records = content.size() / record_bytes;
  const std::size_t head = content.size() - records * record_bytes;
  Bytes planes(content.size());
  std::copy_n(content.begin(), head, planes.begin());
  std::vector<std::uint64_t> differences(records);
  std::byte* plane = planes.data() + head;
  for (std::size_t word = 0; word < record_bytes; word += kWordBytes) {
    Extrapolation extrapolation;
    for (std::size_t record = 0; record < records; ++record) {
      const std::uint64_t number =
          ordered(big_endian(content.data() + head + record * record_bytes + word));
      differences[record] = folded(number - extrapolation.next());
      extrapolation.append(number);
    }
    for (std::size_t i = 0; i < kWordBytes; ++i) {
      for (std::size_t record = 0; record < records; ++record) {
        plane[i * records + record] = static_cast<std::byte>(differences[record] >> (8 * i));
      }
    }
    plane += kWordBytes * records;
  }
  return planes;
}

Bytes from_differences(const Bytes& planes, std::size_t record_bytes) {
  const std::size_t records = planes.size() / record_bytes;
  const std::size_t head = planes.size() - records * record_bytes;
  Bytes content(planes.size());
  std::copy_n(planes.begin(), head, content.begin());
  std::vector<std::uint64_t> differences(records);
  const std::byte* plane = planes.data() + head;
  for (std::size_t word = 0; word < record_bytes; word += kWordBytes) {
    std::fill(differences.begin(), differences.end(), 0);
    for (std::size_t i = 0; i < kWordBytes; ++i) {
      for (std::size_t record = 0; record < records; ++record) {
        differences[record] |= std::to_integer<std::uint64_t>(plane[i * records + record])
                               << (8 * i);
      }
    }
    Extrapolation extrapolation;
    for (std::size_t record = 0; record < records; ++record) {
      const std::uint64_t number = extrapolation.next() + unfolded(differences[record]);
      extrapolation.append(number);
      put_big_endian(unordered(number), content.data() + head + record * record_bytes + word);
    }
    plane += kWordBytes * records;
  }
  return content;
}

Bytes compress(ByteView content, ByteView header, int level) {
  if (static_cast<std::int64_t>(content.size()) > messages::kMaxContentBytes) {
    throw std::invalid_argument("a blob of " + std::to_string(content.size()) +
                                " bytes is too long for the bus, at most " +
                                std::to_string(messages::kMaxContentBytes) + " fit");
  }
  Bytes packed(header.size() + ZSTD_compressBound(content.size()));
  std::copy(header.begin(), header.end(), packed.begin());
  const std::size_t frame_bytes =
      ZSTD_compress(packed.data() + header.size(), packed.size() - header.size(), content.data(),
                    content.size(), level);
  if (ZSTD_isError(frame_bytes) != 0) {
    throw std::runtime_error(std::string("zstd: ") + ZSTD_getErrorName(frame_bytes));
  }
  packed.resize(header.size() + frame_bytes);
  if (static_cast<std::int64_t>(packed.size()) > messages::kMaxPackedBytes) {
    throw std::invalid_argument("a blob of " + std::to_string(packed.size()) +
                                " packed bytes is too long for the bus, at most " +
                                std::to_string(messages::kMaxPackedBytes) + " fit");
  }
  return packed;
}

[[noreturn]] void refuse(const std::string& why) {
  throw messages::MessageError("packed blob: " + why);
}

Bytes decompress(ByteView frame, std::int64_t content_bytes) {
  const unsigned long long claimed = ZSTD_getFrameContentSize(frame.data(), frame.size());
  if (claimed != static_cast<unsigned long long>(content_bytes)) {
    refuse("is no zstd frame of " + std::to_string(content_bytes) + " bytes");
  }
  Bytes content(static_cast<std::size_t>(content_bytes));
  const std::size_t size =
      ZSTD_decompress(content.data(), content.size(), frame.data(), frame.size());
  if (ZSTD_isError(size) != 0 || size != content.size()) {
    refuse(std::string("does not unpack: ") +
           (ZSTD_isError(size) != 0 ? ZSTD_getErrorName(size) : "too short"));
  }
  return content;
}

}  // namespace

Bytes pack(ByteView content) { return compress(content, {}, kLevel); }

Bytes pack_records(ByteView content, std::size_t record_bytes) {
  if (!is_record_length(record_bytes)) {
    throw std::invalid_argument("records of " + std::to_string(record_bytes) +
                                " bytes: needed is a multiple of 8 from 8 to " +
                                std::to_string(kRecordBytesMax));
  }
  std::array<std::byte, kRecordsHeaderBytes> header{};
  std::copy(kRecordsMark.begin(), kRecordsMark.end(), header.begin());
  for (std::size_t i = 0; i < 4; ++i) {
    header[kRecordsMark.size() + i] = static_cast<std::byte>(record_bytes >> (8 * (3 - i)));
  }
  return compress(to_differences(content, record_bytes), header, kRecordsLevel);
}

Bytes unpack(ByteView packed, std::int64_t content_bytes) {
  if (content_bytes < 0 || content_bytes > messages::kMaxContentBytes) {
    refuse("content length " + std::to_string(content_bytes) + " is out of range");
  }
  if (packed.size() < kRecordsHeaderBytes ||
      !std::equal(kRecordsMark.begin(), kRecordsMark.end(), packed.begin())) {
    return decompress(packed, content_bytes);
  }
  std::size_t record_bytes = 0;
  for (std::size_t i = kRecordsMark.size(); i < kRecordsHeaderBytes; ++i) {
    record_bytes = record_bytes << 8 | std::to_integer<std::size_t>(packed[i]);
  }
  if (!is_record_length(record_bytes)) {
    refuse("records of " + std::to_string(record_bytes) + " bytes");
  }
  return from_differences(decompress(packed.subspan(kRecordsHeaderBytes), content_bytes),
                          record_bytes);
}

}  // namespace hedgehop::bus
