#pragma once

#include <compare>
#include <cstdint>
#include <string_view>
#include <vector>

#include "base/hash.hpp"
#include "base/time.hpp"

/// Messages as plain data. Each published type has one pair of functions:
///
///     Bytes to_message(const X& content, const Stamp& stamp);
///     template <> X from_message<X>(ByteView bytes, Stamp& stamp);
///
/// The first gives what LCM carries: fingerprint and encoded fields. It throws
/// std::invalid_argument when the content cannot be sent, that is when the second would refuse it,
/// so that nothing leaves a process that no reader accepts. The second trusts nothing: length,
/// fingerprint, version, counts, ranges, finiteness. It throws MessageError naming the field and
/// the value.
namespace hedgehop::messages {

/// What every published message begins with.
struct Stamp {
  Time time;                   // of the content
  std::int64_t sender_id = 0;  // drawn once by each process
  std::int64_t seq = 0;        // from 1, per sender and channel

  auto operator<=>(const Stamp&) const = default;
};

/// Longest published message, so that it fits one datagram of an Ethernet frame [bytes].
inline constexpr std::size_t kMaxMessageBytes = 1400;

template <typename T>
T from_message(ByteView bytes, Stamp& stamp);

/// Name and fingerprint of a generated type, as LCM tools see it.
struct TypeFingerprint {
  std::string_view type;  // "map_index_t"
  std::int64_t fingerprint = 0;
};

/// All types of the package, by name.
const std::vector<TypeFingerprint>& type_fingerprints();

/// Hash of type_fingerprints(): two processes understand each other if it is equal.
Hash128 types_hash();

}  // namespace hedgehop::messages
