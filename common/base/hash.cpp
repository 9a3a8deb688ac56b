#include "base/hash.hpp"

#include <array>
#include <charconv>
#include <fstream>
#include <openssl/evp.h>
#include <stdexcept>
#include <xxhash.h>

#include "base/errors.hpp"

namespace hedgehop {
namespace {

std::string to_hex(std::span<const unsigned char> bytes) {
  static constexpr char kDigits[] = "0123456789abcdef";
  std::string hex;
  hex.reserve(bytes.size() * 2);
  for (const unsigned char byte : bytes) {
    hex.push_back(kDigits[byte >> 4]);
    hex.push_back(kDigits[byte & 15]);
  }
  return hex;
}

std::uint64_t parse_hex64(std::string_view digits) {
  std::uint64_t value = 0;
  const auto [end, error] =
      std::from_chars(digits.data(), digits.data() + digits.size(), value, 16);
  if (error != std::errc() || end != digits.data() + digits.size()) {
    throw std::invalid_argument("not a hexadecimal hash: '" + std::string(digits) + "'");
  }
  return value;
}

class Sha256 {
 public:
  Sha256() : context_(EVP_MD_CTX_new(), &EVP_MD_CTX_free) {
    HEDGEHOP_ASSERT(context_ && EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr) == 1);
  }
  void update(const void* data, std::size_t size) {
    HEDGEHOP_ASSERT(EVP_DigestUpdate(context_.get(), data, size) == 1);
  }
  std::string hex() {
    std::array<unsigned char, 32> digest{};
    unsigned int size = 0;
    HEDGEHOP_ASSERT(EVP_DigestFinal_ex(context_.get(), digest.data(), &size) == 1 && size == 32);
    return to_hex(digest);
  }

 private:
  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context_;
};

}  // namespace

std::string Hash128::hex() const {
  std::array<unsigned char, 16> bytes{};
  for (int i = 0; i < 8; ++i) {
    bytes[static_cast<std::size_t>(i)] = static_cast<unsigned char>(high >> (56 - 8 * i));
    bytes[static_cast<std::size_t>(i + 8)] = static_cast<unsigned char>(low >> (56 - 8 * i));
  }
  return to_hex(bytes);
}

Hash128 hash128_from_hex(std::string_view hex) {
  if (hex.size() != 32) {
    throw std::invalid_argument("a hash has 32 hexadecimal digits, this has " +
                                std::to_string(hex.size()));
  }
  return {parse_hex64(hex.substr(0, 16)), parse_hex64(hex.substr(16))};
}

Hash128 hash128(ByteView bytes) {
  const XXH128_hash_t hash = XXH3_128bits(bytes.data(), bytes.size());
  return {hash.high64, hash.low64};
}

struct Hasher128::State {
  std::unique_ptr<XXH3_state_t, decltype(&XXH3_freeState)> xxh{XXH3_createState(), &XXH3_freeState};
};

Hasher128::Hasher128() : state_(std::make_unique<State>()) {
  HEDGEHOP_ASSERT(XXH3_128bits_reset(state_->xxh.get()) == XXH_OK);
}
Hasher128::~Hasher128() = default;

void Hasher128::update(ByteView bytes) {
  HEDGEHOP_ASSERT(XXH3_128bits_update(state_->xxh.get(), bytes.data(), bytes.size()) == XXH_OK);
}

Hash128 Hasher128::digest() const {
  const XXH128_hash_t hash = XXH3_128bits_digest(state_->xxh.get());
  return {hash.high64, hash.low64};
}

std::string sha256_hex(ByteView bytes) {
  Sha256 sha;
  sha.update(bytes.data(), bytes.size());
  return sha.hex();
}

std::string sha256_hex_of_file(const std::string& path) {
  return sha256_hex_of_file(path, [] {});
}

std::string sha256_hex_of_file(const std::string& path,
                               const std::function<void()>& between_blocks) {
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    throw DataError(path + ": cannot be opened for reading");
  }
  Sha256 sha;
  std::vector<char> buffer(1 << 20);
  while (file) {
    file.read(buffer.data(), static_cast<std::streamsize>(buffer.size()));
    sha.update(buffer.data(), static_cast<std::size_t>(file.gcount()));
    between_blocks();
  }
  if (file.bad()) {
    throw DataError(path + ": reading failed");
  }
  return sha.hex();
}

}  // namespace hedgehop
