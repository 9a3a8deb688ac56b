#include "messages/message.hpp"

#include "messages/wire.hpp"

#include "hedgehop/all_types.hpp"

namespace hedgehop::messages {
namespace wire {

std::size_t first_bad_utf8(std::string_view text) {
  std::size_t at = 0;
  while (at < text.size()) {
    const auto lead = static_cast<unsigned char>(text[at]);
    // Length of the character, and the range of its second byte that is no overlong form.
    std::size_t length = 1;
    unsigned second_min = 0x80;
    unsigned second_max = 0xBF;
    if (lead >= 0xF0 && lead <= 0xF4) {
      length = 4;
      second_min = lead == 0xF0 ? 0x90 : 0x80;
      second_max = lead == 0xF4 ? 0x8F : 0xBF;
    } else if (lead >= 0xE0 && lead <= 0xEF) {
      length = 3;
      second_min = lead == 0xE0 ? 0xA0 : 0x80;
      second_max = lead == 0xED ? 0x9F : 0xBF;
    } else if (lead >= 0xC2 && lead <= 0xDF) {
      length = 2;
    } else if (lead >= 0x80) {
      return at;
    }
    if (at + length > text.size()) {
      return at;
    }
    for (std::size_t i = 1; i < length; ++i) {
      const auto byte = static_cast<unsigned char>(text[at + i]);
      if (byte < (i == 1 ? second_min : 0x80) || byte > (i == 1 ? second_max : 0xBF)) {
        return at;
      }
    }
    at += length;
  }
  return text.size();
}

std::string cut_text(std::string_view text, std::size_t bytes_max) {
  // Longer texts are cut anyway; a few bytes more, so that the last character shows whether it is
  // whole.
  std::string cut(text.substr(0, bytes_max + 4));
  const bool is_longer = text.size() > cut.size();
  for (char& c : cut) {
    const auto code = static_cast<unsigned char>(c);
    if ((code < 0x20 && c != '\n' && c != '\t') || code == 0x7f) {
      c = ' ';
    }
  }
  for (std::size_t at = first_bad_utf8(cut); at < cut.size(); at = first_bad_utf8(cut)) {
    if (is_longer && at + 4 > cut.size()) {
      cut.resize(at);
      break;
    }
    cut[at] = '?';
  }
  std::size_t size = std::min(cut.size(), bytes_max);
  // A byte 10xxxxxx goes on with the character before it.
  while (size > 0 && size < cut.size() && (static_cast<unsigned char>(cut[size]) & 0xC0U) == 0x80) {
    --size;
  }
  cut.resize(size);
  return cut;
}

}  // namespace wire

const std::vector<TypeFingerprint>& type_fingerprints() {
#define HEDGEHOP_TYPE_ENTRY(type) {#type, hedgehop::type::getHash()},
  static const std::vector<TypeFingerprint> kTypes = {
      HEDGEHOP_FOR_EACH_LCM_TYPE(HEDGEHOP_TYPE_ENTRY)};
#undef HEDGEHOP_TYPE_ENTRY
  return kTypes;
}

Hash128 types_hash() {
  std::ostringstream text;
  for (const TypeFingerprint& type : type_fingerprints()) {
    text << type.type << ' ' << type.fingerprint << '\n';
  }
  return hash128(text.str());
}

}  // namespace hedgehop::messages
