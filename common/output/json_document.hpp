#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <unordered_map>
#include <vector>

namespace hedgehop::output {

/// A JSON text from an untrusted file, with the line of each value.
class JsonDocument {
 public:
  using Json = nlohmann::ordered_json;

  /// A value and where it stands; every wrong thing about it becomes a DataError with file, line
  /// and field.
  class Field {
   public:
    [[nodiscard]] Field at(const char* key) const;
    [[nodiscard]] bool has(const char* key) const { return value_->contains(key); }
    [[nodiscard]] bool is_null() const { return value_->is_null(); }
    /// Finite.
    [[nodiscard]] double number() const;
    /// null becomes NaN.
    [[nodiscard]] double number_or_nan() const;
    /// Of a magnitude up to this one.
    [[nodiscard]] double number_within(double magnitude_max) const;
    [[nodiscard]] std::int64_t integer(std::int64_t least, std::int64_t greatest) const;
    [[nodiscard]] std::uint64_t unsigned_integer() const;
    [[nodiscard]] bool boolean() const;
    [[nodiscard]] std::string text() const;
    [[nodiscard]] std::vector<Field> entries(std::size_t count_max) const;
    [[noreturn]] void refuse(const std::string& why) const;

   private:
    friend class JsonDocument;
    Field(const JsonDocument& document, const Json& value, std::string pointer)
        : document_(&document), value_(&value), pointer_(std::move(pointer)) {}
    const JsonDocument* document_;
    const Json* value_;
    std::string pointer_;  // "/route/waypoints/3/x_m"
  };

  /// `name` is what errors call the file. Throws DataError for bad syntax, duplicate keys and
  /// nesting deeper than 32.
  JsonDocument(const std::string& text, std::string name);
  JsonDocument(const JsonDocument&) = delete;
  JsonDocument& operator=(const JsonDocument&) = delete;

  [[nodiscard]] Field root() const { return {*this, value_, ""}; }

 private:
  std::string name_;
  Json value_;
  std::unordered_map<std::string, int> lines_;  // by pointer
};

/// A document as text, its last line ended. Bytes from outside that are no UTF-8 become replacement
/// characters.
std::string dumped(const JsonDocument::Json& json);

}  // namespace hedgehop::output
