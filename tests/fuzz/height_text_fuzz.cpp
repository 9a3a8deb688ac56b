// Text of a height, as people write it into tags and attributes. The first byte chooses the unit.
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "map_sources/height_text.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 1) {
    return 0;
  }
  const std::string_view text(reinterpret_cast<const char*>(data + 1), size - 1);
  const auto height_m =
      hedgehop::map_sources::height_in_text_m(text, data[0] % 2 == 0 ? 1.0 : 0.3048);
  if (height_m && !(*height_m > 0.0 && *height_m <= 1000.0)) {
    std::abort();
  }
  const auto levels = hedgehop::map_sources::levels_in_text(text);
  if (levels && !(*levels > 0.0 && *levels <= 200.0)) {
    std::abort();
  }
  // A text that starts with no digit is no height.
  const std::size_t start = text.find_first_not_of(" \t");
  const bool has_digit = start != std::string_view::npos &&
                         ((text[start] >= '0' && text[start] <= '9') || text[start] == '\xC2');
  if (height_m && !has_digit) {
    std::abort();
  }
  return 0;
}
