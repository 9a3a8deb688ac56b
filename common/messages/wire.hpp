#pragma once

// Internal: for the .cpp files of this room, which are the only ones that include generated types.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>

#include "base/hash.hpp"
#include "messages/blob.hpp"
#include "messages/message.hpp"
#include "messages/message_error.hpp"

namespace hedgehop::messages::wire {

/// Place of the first byte that does not belong to a UTF-8 character; the size if all do.
std::size_t first_bad_utf8(std::string_view text);

/// Judges the fields of one message; every failure is a MessageError with type, field and value.
class Check {
 public:
  explicit Check(const char* type) : type_(type) {}

  template <typename T>
  [[noreturn]] void refuse(std::string_view field, const T& value, std::string_view rule) const {
    std::ostringstream what;
    what.precision(17);
    what << type_ << ": " << field << " is " << value << ", must " << rule;
    throw MessageError(what.str());
  }
  [[noreturn]] void refuse(const std::string& what) const {
    throw MessageError(std::string(type_) + ": " + what);
  }

  double finite(std::string_view field, double value) const {
    if (!std::isfinite(value)) {
      refuse(field, value, "be finite");
    }
    return value;
  }
  double finite_or_nan(std::string_view field, double value) const {
    if (std::isinf(value)) {
      refuse(field, value, "be finite or NaN");
    }
    return value;
  }
  double not_negative(std::string_view field, double value) const {
    if (!(std::isfinite(value) && value >= 0.0)) {
      refuse(field, value, "be finite and not negative");
    }
    return value;
  }
  double positive(std::string_view field, double value) const {
    if (!(std::isfinite(value) && value > 0.0)) {
      refuse(field, value, "be finite and above 0");
    }
    return value;
  }
  template <typename T>
  T within(std::string_view field, T value, T low, T high) const {
    if (!(value >= low && value <= high)) {  // false for NaN too
      std::ostringstream rule;
      rule.precision(17);
      rule << "lie in [" << +low << ", " << +high << "]";
      refuse(field, +value, rule.str());
    }
    return value;
  }
  std::int64_t count(std::string_view field, std::int64_t value) const {
    return within<std::int64_t>(field, value, 0, std::numeric_limits<std::int64_t>::max());
  }
  bool boolean(std::string_view field, std::int8_t value) const {
    return within<std::int8_t>(field, value, 0, 1) == 1;
  }
  /// UTF-8 without control characters but tab and line feed: text ends up on terminals and in JSON.
  std::string text(std::string_view field, const std::string& value, std::size_t bytes_max) const {
    if (value.size() > bytes_max) {
      refuse(std::string(field) + " has " + std::to_string(value.size()) +
             " bytes, must have at most " + std::to_string(bytes_max));
    }
    for (const char c : value) {
      const auto code = static_cast<unsigned char>(c);
      if ((code < 0x20 && c != '\n' && c != '\t') || code == 0x7f) {
        refuse(std::string(field) + " holds the control character " + std::to_string(code));
      }
    }
    if (const std::size_t at = first_bad_utf8(value); at < value.size()) {
      refuse(std::string(field) + " is no UTF-8 at byte " + std::to_string(at));
    }
    return value;
  }
  /// NaN stands for nothing.
  template <typename Judge>
  std::optional<double> optional(double value, const Judge& judge) const {
    if (std::isnan(value)) {
      return std::nullopt;
    }
    return judge(value);
  }

 private:
  const char* type_;
};

inline double value_or_nan(const std::optional<double>& value) {
  return value.value_or(std::numeric_limits<double>::quiet_NaN());
}

/// Text fit to be sent: control characters become spaces, bytes that are no UTF-8 question marks;
/// cut to at most `bytes_max` between characters.
std::string cut_text(std::string_view text, std::size_t bytes_max);

inline void put(std::int64_t (&field)[2], const Hash128& hash) {
  field[0] = static_cast<std::int64_t>(hash.high);
  field[1] = static_cast<std::int64_t>(hash.low);
}
inline Hash128 hash_in(const std::int64_t (&field)[2]) {
  return {static_cast<std::uint64_t>(field[0]), static_cast<std::uint64_t>(field[1])};
}

template <typename T>
void put_stamp(T& message, const Stamp& stamp) {
  message.utime = stamp.time.utime_us;
  message.sender_id = stamp.sender_id;
  message.seq = stamp.seq;
  message.version = T::VERSION;
}

template <typename T>
Bytes encoded(const T& message) {
  Bytes bytes(static_cast<std::size_t>(message.getEncodedSize()));
  const int size = message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  if (size != static_cast<int>(bytes.size())) {
    // A text with a zero inside is the only content that encodes shorter than it says.
    throw std::invalid_argument(std::string(T::getTypeName()) + ": cannot be encoded");
  }
  return bytes;
}

/// The first eight bytes; there must be as many.
inline std::int64_t fingerprint_of(ByteView bytes) {
  std::uint64_t fingerprint = 0;
  for (std::size_t i = 0; i < 8; ++i) {
    fingerprint = (fingerprint << 8) | std::to_integer<std::uint64_t>(bytes[i]);
  }
  return static_cast<std::int64_t>(fingerprint);
}

template <typename T>
bool is_of_type(ByteView bytes) {
  return bytes.size() >= 8 && fingerprint_of(bytes) == T::getHash();
}

/// Length, fingerprint, counts and version; what the fields say is for the caller to judge.
template <typename T>
T decoded(ByteView bytes, std::size_t bytes_max) {
  const Check check(T::getTypeName());
  if (bytes.size() < 8 || bytes.size() > bytes_max) {
    check.refuse("has " + std::to_string(bytes.size()) + " bytes, must have 8 to " +
                 std::to_string(bytes_max));
  }
  const std::int64_t fingerprint = fingerprint_of(bytes);
  if (fingerprint != T::getHash()) {
    std::ostringstream what;
    what << "fingerprint is " << std::hex << static_cast<std::uint64_t>(fingerprint) << ", must be "
         << static_cast<std::uint64_t>(T::getHash()) << ": another type or another program version";
    check.refuse(what.str());
  }
  T message{};
  const int size = message.decode(bytes.data(), 0, static_cast<int>(bytes.size()));
  if (size < 0) {
    check.refuse("is cut short, or a count or text length in it is out of range");
  }
  if (static_cast<std::size_t>(size) != bytes.size()) {
    check.refuse("has " + std::to_string(bytes.size() - static_cast<std::size_t>(size)) +
                 " bytes after its end");
  }
  check.within<int>("version", message.version, T::VERSION, T::VERSION);
  return message;
}

template <typename T>
T decoded(ByteView bytes, Stamp& stamp) {
  T message = decoded<T>(bytes, kMaxMessageBytes);
  const Check check(T::getTypeName());
  // Up to the year 2200, so that differences of times never overflow.
  check.within<std::int64_t>("utime", message.utime, 0, 7'258'118'400'000'000);
  check.within<std::int64_t>("seq", message.seq, 1, std::numeric_limits<std::int64_t>::max());
  stamp = {Time{message.utime}, message.sender_id, message.seq};
  return message;
}

/// Encodes, and makes sure that a reader would accept it.
template <typename Content, typename T>
Bytes published(const T& message) {
  Bytes bytes = encoded(message);
  Stamp stamp;
  try {
    from_message<Content>(bytes, stamp);
  } catch (const MessageError& error) {
    throw std::invalid_argument(std::string("cannot be sent: ") + error.what());
  }
  return bytes;
}

/// Works on blob_ref_t, which this header does not include.
template <typename T>
void put_ref(T& field, const BlobRef& ref) {
  put(field.blob_id, ref.id);
  field.packed_bytes = ref.packed_bytes;
  field.content_bytes = ref.content_bytes;
  field.chunk_count = ref.chunk_count();
}
template <typename T>
BlobRef ref_in(const Check& check, const std::string& name, const T& field) {
  BlobRef ref;
  ref.id = hash_in(field.blob_id);
  ref.packed_bytes =
      check.within<std::int64_t>(name + ".packed_bytes", field.packed_bytes, 1, kMaxPackedBytes);
  ref.content_bytes =
      check.within<std::int64_t>(name + ".content_bytes", field.content_bytes, 0, kMaxContentBytes);
  check.within(name + ".chunk_count", field.chunk_count, ref.chunk_count(), ref.chunk_count());
  return ref;
}

}  // namespace hedgehop::messages::wire
