#include "output/json_document.hpp"

#include <cmath>
#include <iterator>
#include <limits>
#include <unordered_set>

#include "base/errors.hpp"

namespace hedgehop::output {
namespace {

using Json = JsonDocument::Json;

constexpr std::size_t kDepthMax = 32;
constexpr char kHint[] = "plan again, or restore the file from where it was written";

struct Place {
  int line = 1;
  char last = ' ';

  /// Of the value that was read last; a number is known to end one character late.
  [[nodiscard]] int line_of_value() const { return last == '\n' ? line - 1 : line; }
};

/// Reads characters and counts lines.
class CountingIterator {
 public:
  using iterator_category = std::input_iterator_tag;
  using value_type = char;
  using difference_type = std::ptrdiff_t;
  using pointer = const char*;
  using reference = const char&;

  CountingIterator(const char* at, Place* place) : at_(at), place_(place) {}
  reference operator*() const { return *at_; }
  CountingIterator& operator++() {
    place_->last = *at_;
    place_->line += *at_ == '\n' ? 1 : 0;
    ++at_;
    return *this;
  }
  bool operator==(const CountingIterator& other) const { return at_ == other.at_; }
  bool operator!=(const CountingIterator& other) const { return at_ != other.at_; }

 private:
  const char* at_;
  Place* place_;
};

/// Notes the line of each value; refuses what the document may not hold.
class LineRecorder {
 public:
  LineRecorder(const Place& place, std::string name, std::unordered_map<std::string, int>& lines)
      : place_(place), name_(std::move(name)), lines_(lines) {}

  bool null() { return value(); }
  bool boolean(bool) { return value(); }
  bool number_integer(Json::number_integer_t) { return value(); }
  bool number_unsigned(Json::number_unsigned_t) { return value(); }
  bool number_float(Json::number_float_t, const std::string&) { return value(); }
  bool string(std::string&) { return value(); }
  bool binary(Json::binary_t&) { return value(); }
  bool start_object(std::size_t) { return open(false); }
  bool start_array(std::size_t) { return open(true); }
  bool end_object() { return close(); }
  bool end_array() { return close(); }
  bool key(std::string& name) {
    Level& level = levels_.back();
    if (!level.keys.insert(name).second) {
      refuse("the key '" + name + "' stands there twice");
    }
    level.key = name;
    return true;
  }
  bool parse_error(std::size_t, const std::string&, const Json::exception&) {
    refuse("this is no valid JSON, the file is damaged or cut off");
  }

 private:
  struct Level {
    bool is_array;
    std::size_t count;
    std::string pointer;
    std::string key;
    std::unordered_set<std::string> keys;
  };

  [[noreturn]] void refuse(const std::string& why) const {
    throw DataError(name_ + ":" + std::to_string(place_.line_of_value()) + ": " + why, kHint);
  }
  std::string next_pointer() {
    if (levels_.empty()) {
      return "";
    }
    Level& level = levels_.back();
    return level.pointer + "/" + (level.is_array ? std::to_string(level.count++) : level.key);
  }
  bool value() {
    lines_[next_pointer()] = place_.line_of_value();
    return true;
  }
  bool open(bool is_array) {
    std::string pointer = next_pointer();
    lines_[pointer] = place_.line_of_value();
    if (levels_.size() >= kDepthMax) {
      refuse("values are nested too deeply");
    }
    levels_.push_back({is_array, 0, std::move(pointer), {}, {}});
    return true;
  }
  bool close() {
    levels_.pop_back();
    return true;
  }

  const Place& place_;
  std::string name_;
  std::unordered_map<std::string, int>& lines_;
  std::vector<Level> levels_;
};

}  // namespace

JsonDocument::JsonDocument(const std::string& text, std::string name) : name_(std::move(name)) {
  Place place;
  LineRecorder recorder(place, name_, lines_);
  Json::sax_parse(CountingIterator(text.data(), &place),
                  CountingIterator(text.data() + text.size(), &place), &recorder);
  value_ = Json::parse(text, nullptr, false);
  if (!value_.is_object()) {
    root().refuse("must be an object");
  }
}

void JsonDocument::Field::refuse(const std::string& why) const {
  const auto line = document_->lines_.find(pointer_);
  throw DataError(document_->name_ + ":" +
                      std::to_string(line == document_->lines_.end() ? 1 : line->second) + ": " +
                      (pointer_.empty() ? "the document" : "field '" + pointer_.substr(1) + "'") +
                      " " + why,
                  kHint);
}

JsonDocument::Field JsonDocument::Field::at(const char* key) const {
  if (!value_->is_object()) {
    refuse("must be an object");
  }
  const auto entry = value_->find(key);
  if (entry == value_->end()) {
    refuse(std::string("lacks the field '") + key + "'");
  }
  return {*document_, *entry, pointer_ + "/" + key};
}

double JsonDocument::Field::number() const {
  if (!value_->is_number() || !std::isfinite(value_->get<double>())) {
    refuse("must be a number");
  }
  return value_->get<double>();
}

double JsonDocument::Field::number_or_nan() const {
  return value_->is_null() ? std::numeric_limits<double>::quiet_NaN() : number();
}

std::int64_t JsonDocument::Field::integer(std::int64_t least, std::int64_t greatest) const {
  const bool is_too_large =
      value_->is_number_unsigned() &&
      value_->get<std::uint64_t>() >
          static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max());
  if (!value_->is_number_integer() || is_too_large || value_->get<std::int64_t>() < least ||
      value_->get<std::int64_t>() > greatest) {
    refuse("must be a whole number from " + std::to_string(least) + " to " +
           std::to_string(greatest));
  }
  return value_->get<std::int64_t>();
}

std::uint64_t JsonDocument::Field::unsigned_integer() const {
  if (!value_->is_number_unsigned()) {
    refuse("must be a whole number from 0 to " +
           std::to_string(std::numeric_limits<std::uint64_t>::max()));
  }
  return value_->get<std::uint64_t>();
}

double JsonDocument::Field::number_within(double magnitude_max) const {
  const double value = number();
  if (std::fabs(value) > magnitude_max) {
    refuse("is out of range");
  }
  return value;
}

bool JsonDocument::Field::boolean() const {
  if (!value_->is_boolean()) {
    refuse("must be true or false");
  }
  return value_->get<bool>();
}

std::string JsonDocument::Field::text() const {
  if (!value_->is_string()) {
    refuse("must be a text");
  }
  return value_->get<std::string>();
}

std::vector<JsonDocument::Field> JsonDocument::Field::entries(std::size_t count_max) const {
  if (!value_->is_array()) {
    refuse("must be a list");
  }
  if (value_->size() > count_max) {
    refuse("must have at most " + std::to_string(count_max) + " entries");
  }
  std::vector<Field> fields;
  fields.reserve(value_->size());
  for (std::size_t i = 0; i < value_->size(); ++i) {
    fields.push_back({*document_, (*value_)[i], pointer_ + "/" + std::to_string(i)});
  }
  return fields;
}

std::string dumped(const JsonDocument::Json& json) {
  return json.dump(1, ' ', false, JsonDocument::Json::error_handler_t::replace) + "\n";
}

}  // namespace hedgehop::output
