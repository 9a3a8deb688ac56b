#include "base/hash.hpp"

#include <gtest/gtest.h>
#include <random>
#include <string>

#include "base/errors.hpp"
#include "base/files.hpp"
#include "support/fresh_seed.hpp"
#include "support/temporary_folder.hpp"

namespace hedgehop {
namespace {

TEST(Hash, EmptyInputHasThePublishedValues) {
  // XXH3-128 and SHA-256 of nothing, as their specifications give them.
  EXPECT_EQ(hash128("").hex(), "99aa06d3014798d86001c324468d497f");
  EXPECT_EQ(sha256_hex({}), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
}

TEST(Hash, Sha256OfAbcHasThePublishedValue) {
  EXPECT_EQ(sha256_hex(bytes_of("abc")),
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(Hash, HexIsReadBack) {
  const Hash128 hash{0x0123456789abcdefULL, 0xfedcba9876543210ULL};
  EXPECT_EQ(hash.hex(), "0123456789abcdeffedcba9876543210");
  EXPECT_EQ(hash128_from_hex(hash.hex()), hash);
  EXPECT_FALSE(hash.is_zero());
  EXPECT_TRUE(Hash128{}.is_zero());
}

TEST(Hash, AnythingButThirtyTwoDigitsIsRefused) {
  EXPECT_THROW(hash128_from_hex(""), std::invalid_argument);
  EXPECT_THROW(hash128_from_hex("0123456789abcdeffedcba987654321"), std::invalid_argument);
  EXPECT_THROW(hash128_from_hex("0123456789abcdeffedcba98765432100"), std::invalid_argument);
  EXPECT_THROW(hash128_from_hex("0123456789abcdefgedcba9876543210"), std::invalid_argument);
  EXPECT_THROW(hash128_from_hex("-123456789abcdeffedcba9876543210"), std::invalid_argument);
  EXPECT_THROW(hash128_from_hex(" 123456789abcdeffedcba9876543210"), std::invalid_argument);
}

TEST(Hash, PiecesHashAsTheirConcatenation) {
  std::mt19937_64 random(test::fresh_seed());
  std::string text(5000, ' ');
  for (char& letter : text) {
    letter = static_cast<char>(random());
  }
  for (int trial = 0; trial < 20; ++trial) {
    Hasher128 hasher;
    std::size_t at = 0;
    while (at < text.size()) {
      const std::size_t piece = std::min<std::size_t>(random() % 700, text.size() - at);
      hasher.update(std::string_view(text).substr(at, piece));
      at += piece;
    }
    ASSERT_EQ(hasher.digest(), hash128(text));
  }
  std::string changed = text;
  changed[2500] ^= 1;
  EXPECT_NE(hash128(changed), hash128(text));
}

TEST(Hash, FileHashIsThatOfItsContent) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "a.txt";
  write_file_atomically(path, std::string_view("abc"));
  EXPECT_EQ(sha256_hex_of_file(path.string()), sha256_hex(bytes_of("abc")));
  EXPECT_THROW(sha256_hex_of_file((folder.path() / "none").string()), DataError);
}

}  // namespace
}  // namespace hedgehop
