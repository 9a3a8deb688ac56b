#include "messages/describe.hpp"

#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <map>
#include <sstream>
#include <vector>

#include "messages/message_error.hpp"
#include "messages/wire.hpp"

namespace hedgehop::messages {
namespace {

struct FieldRow {
  std::string_view type;
  std::string_view name;
  std::string_view field_type;
  std::string_view dimension;  // empty, a number or the name of the count
};
constexpr FieldRow kFields[] = {
#include "hedgehop/type_fields.inc"
};

std::uint64_t fingerprint_in(ByteView bytes) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < 8 && i < bytes.size(); ++i) {
    value = (value << 8) | std::to_integer<std::uint64_t>(bytes[i]);
  }
  return value;
}

class Describer {
 public:
  Describer(ByteView bytes, std::size_t elements_max)
      : bytes_(bytes), elements_max_(elements_max) {}

  std::string message(std::string_view type) {
    at_ = 8;
    text_ = "{\"type\":\"" + std::string(type) + "\"";
    fields(type, false);
    text_ += '}';
    if (at_ != bytes_.size()) {
      throw MessageError(std::string(type) + ": has " + std::to_string(bytes_.size() - at_) +
                         " bytes after its end");
    }
    return std::move(text_);
  }

 private:
  void fields(std::string_view type, bool is_first) {
    std::map<std::string_view, std::int64_t> counts;
    for (const FieldRow& row : kFields) {
      if (row.type != type) {
        continue;
      }
      text_ += (is_first ? "\"" : ",\"") + std::string(row.name) + "\":";
      is_first = false;
      if (row.dimension.empty()) {
        const std::int64_t whole = value(row.field_type);
        if (row.name.starts_with("num_")) {
          counts[row.name] = whole;
        }
        continue;
      }
      std::int64_t count = 0;
      const auto known = counts.find(row.dimension);
      if (known != counts.end()) {
        count = known->second;
      } else {
        std::from_chars(row.dimension.data(), row.dimension.data() + row.dimension.size(), count);
      }
      array(row.field_type, count);
    }
  }

  void array(std::string_view type, std::int64_t count) {
    if (count < 0 || static_cast<std::uint64_t>(count) > bytes_.size()) {
      throw MessageError("a count of " + std::to_string(count) + " elements is out of range");
    }
    text_ += '[';
    std::size_t end = 0;
    for (std::int64_t i = 0; i < count; ++i) {
      if (i > 0) {
        text_ += ',';
      }
      value(type);
      if (static_cast<std::size_t>(i) < elements_max_) {
        end = text_.size();
      } else {
        text_.resize(end);
      }
    }
    if (static_cast<std::uint64_t>(count) > elements_max_) {
      text_ +=
          ",\"... " + std::to_string(count - static_cast<std::int64_t>(elements_max_)) + " more\"";
    }
    text_ += ']';
  }

  // The value if it is a whole number.
  std::int64_t value(std::string_view type) {
    if (type == "double") {
      number(std::bit_cast<double>(unsigned_in(8)));
    } else if (type == "float") {
      number(std::bit_cast<float>(static_cast<std::uint32_t>(unsigned_in(4))));
    } else if (type == "boolean") {
      text_ += unsigned_in(1) != 0 ? "true" : "false";
    } else if (type == "byte") {
      text_ += std::to_string(unsigned_in(1));
    } else if (type == "string") {
      string();
    } else if (type == "int8_t" || type == "int16_t" || type == "int32_t" || type == "int64_t") {
      const int size = type == "int8_t" ? 1 : type == "int16_t" ? 2 : type == "int32_t" ? 4 : 8;
      const int shift = 64 - 8 * size;
      const auto whole = static_cast<std::int64_t>(unsigned_in(size) << shift) >> shift;
      text_ += std::to_string(whole);
      return whole;
    } else {
      text_ += '{';
      fields(type, true);
      text_ += '}';
    }
    return 0;
  }

  template <typename T>
  void number(T value) {
    if (!std::isfinite(value)) {
      text_ += "null";
      return;
    }
    std::array<char, 64> digits;
    const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
    text_.append(digits.data(), end);
  }

  void string() {
    const std::uint64_t size = unsigned_in(4);
    if (size < 1 || size > bytes_.size() - at_) {
      throw MessageError("a text of " + std::to_string(size) + " bytes is out of range");
    }
    const std::string raw(reinterpret_cast<const char*>(bytes_.data() + at_),
                          static_cast<std::size_t>(size - 1));
    at_ += static_cast<std::size_t>(size);
    text_ += '"';
    for (const char c : wire::cut_text(raw, raw.size())) {  // UTF-8, no control characters
      if (c == '"' || c == '\\') {
        text_ += '\\';
        text_ += c;
      } else if (c == '\n') {
        text_ += "\\n";
      } else if (c == '\t') {
        text_ += "\\t";
      } else {
        text_ += c;
      }
    }
    text_ += '"';
  }

  std::uint64_t unsigned_in(int size) {
    if (bytes_.size() - at_ < static_cast<std::size_t>(size)) {
      throw MessageError("is cut short");
    }
    std::uint64_t value = 0;
    for (int i = 0; i < size; ++i) {
      value = (value << 8) | std::to_integer<std::uint64_t>(bytes_[at_++]);
    }
    return value;
  }

  ByteView bytes_;
  std::size_t elements_max_;
  std::size_t at_ = 0;
  std::string text_;
};

}  // namespace

std::optional<std::string_view> type_of(ByteView bytes) {
  if (bytes.size() < 8) {
    return std::nullopt;
  }
  const auto fingerprint = static_cast<std::int64_t>(fingerprint_in(bytes));
  for (const TypeFingerprint& type : type_fingerprints()) {
    if (type.fingerprint == fingerprint) {
      return type.type;
    }
  }
  return std::nullopt;
}

std::string describe(ByteView bytes, std::size_t elements_max) {
  const auto type = type_of(bytes);
  if (!type) {
    std::ostringstream what;
    what << "fingerprint " << std::hex << fingerprint_in(bytes) << " of " << std::dec
         << bytes.size() << " bytes is of no type that this program knows";
    throw MessageError(what.str());
  }
  return Describer(bytes, elements_max).message(*type);
}

}  // namespace hedgehop::messages
