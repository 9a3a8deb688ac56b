#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace hedgehop {

using Bytes = std::vector<std::byte>;
using ByteView = std::span<const std::byte>;

inline ByteView bytes_of(std::string_view text) {
  return std::as_bytes(std::span<const char>(text.data(), text.size()));
}

/// 128 bits that identify content (XXH3). Guards against damage and mix-ups, not against an
/// attacker.
struct Hash128 {
  std::uint64_t high = 0;
  std::uint64_t low = 0;

  auto operator<=>(const Hash128&) const = default;
  /// 32 lower-case hexadecimal digits, high half first.
  [[nodiscard]] std::string hex() const;
  [[nodiscard]] bool is_zero() const { return high == 0 && low == 0; }
};

/// Inverse of hex(). Throws std::invalid_argument on anything but 32 hexadecimal digits.
Hash128 hash128_from_hex(std::string_view hex);

Hash128 hash128(ByteView bytes);
inline Hash128 hash128(std::string_view text) { return hash128(bytes_of(text)); }

/// Hash of a sequence of pieces; the same as hash128 of their concatenation.
class Hasher128 {
 public:
  Hasher128();
  ~Hasher128();
  Hasher128(const Hasher128&) = delete;
  Hasher128& operator=(const Hasher128&) = delete;

  void update(ByteView bytes);
  void update(std::string_view text) { update(bytes_of(text)); }
  [[nodiscard]] Hash128 digest() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// SHA-256 as 64 lower-case hexadecimal digits.
std::string sha256_hex(ByteView bytes);

/// SHA-256 of a file's content. Throws DataError if it cannot be read.
std::string sha256_hex_of_file(const std::string& path);

/// The same for large files: `between_blocks` is called after each MiB, and may throw to stop.
std::string sha256_hex_of_file(const std::string& path,
                               const std::function<void()>& between_blocks);

}  // namespace hedgehop
