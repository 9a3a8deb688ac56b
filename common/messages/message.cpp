#include "messages/message.hpp"

#include "messages/wire.hpp"

#include "hedgehop/all_types.hpp"

namespace hedgehop::messages {
namespace wire {

std::string cut_text(std::string_view text, std::size_t bytes_max) {
  std::size_t size = std::min(text.size(), bytes_max);
  // A byte 10xxxxxx goes on with the character before it.
  while (size > 0 && size < text.size() &&
         (static_cast<unsigned char>(text[size]) & 0xC0U) == 0x80) {
    --size;
  }
  std::string cut(text.substr(0, size));
  for (char& c : cut) {
    const auto code = static_cast<unsigned char>(c);
    if ((code < 0x20 && c != '\n' && c != '\t') || code == 0x7f) {
      c = ' ';
    }
  }
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
