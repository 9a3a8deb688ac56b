#include "map_sources/height_text.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <string>
#include <vector>

namespace hedgehop::map_sources {
namespace {

constexpr double kFoot_m = 0.3048;
constexpr double kHighest_m = 1000.0;
constexpr double kLevelsMax = 200.0;
constexpr std::size_t kLongest = 200;

bool is_digit(char c) { return c >= '0' && c <= '9'; }

std::string_view trimmed(std::string_view text) {
  const auto is_blank = [](char c) { return c == ' ' || c == '\t'; };
  while (!text.empty() && is_blank(text.front())) {
    text.remove_prefix(1);
  }
  while (!text.empty() && is_blank(text.back())) {
    text.remove_suffix(1);
  }
  return text;
}

// Marks that look like an apostrophe or a quotation mark become one; letters become small.
std::string plain_text(std::string_view text) {
  constexpr std::array<std::pair<std::string_view, std::string_view>, 7> kMarks = {
      {{"\u2032", "'"},
       {"\u2019", "'"},
       {"\u2033", "\""},
       {"\u201d", "\""},
       {"\u2013", "-"},
       {"\u2212", "-"},
       {"\u00a0", " "}}};
  std::string result;
  for (std::size_t i = 0; i < text.size();) {
    const auto mark = std::find_if(kMarks.begin(), kMarks.end(), [&](const auto& entry) {
      return text.substr(i).starts_with(entry.first);
    });
    if (mark != kMarks.end()) {
      result += mark->second;
      i += mark->first.size();
    } else {
      const char c = text[i++];
      result += c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
    }
  }
  return result;
}

// Digits with at most one decimal mark. A comma followed by exactly three digits parts thousands:
// "1,250 ft" read as a decimal would be dangerously low.
std::optional<double> plain_number(std::string_view text, std::string_view& rest) {
  std::size_t length = 0;
  while (length < text.size() &&
         (is_digit(text[length]) || text[length] == '.' || text[length] == ',')) {
    ++length;
  }
  std::string digits;
  for (std::size_t i = 0; i < length; ++i) {
    const std::string_view behind = text.substr(i + 1, length - i - 1);
    const bool parts_thousands = text[i] == ',' && digits.find('.') == std::string::npos &&
                                 behind.substr(0, behind.find_first_of(".,")).size() == 3;
    if (!parts_thousands) {
      digits += text[i] == ',' ? '.' : text[i];
    }
  }
  if (digits.empty() || !is_digit(text.front())) {
    return std::nullopt;
  }
  double value = 0.0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value,
                                            std::chars_format::fixed);
  if (error != std::errc() || end != digits.data() + digits.size()) {
    return std::nullopt;
  }
  rest = trimmed(text.substr(length));
  return value;
}

bool is_one_of(std::string_view word, std::initializer_list<std::string_view> words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

// A number without a unit has `bare_unit_m`.
std::optional<double> single_height_m(std::string_view text, double bare_unit_m) {
  std::string_view unit;
  const auto number = plain_number(trimmed(text), unit);
  if (!number) {
    return std::nullopt;
  }
  if (unit.empty()) {
    return *number * bare_unit_m;
  }
  if (is_one_of(unit, {"m", "m.", "mtr", "mtrs", "meter", "meters", "metre", "metres"})) {
    return number;
  }
  // Feet, and behind them perhaps inches.
  std::string_view inches_text;
  for (const std::string_view foot : {"feet", "foot", "ft.", "ft", "'"}) {
    if (unit.starts_with(foot)) {
      inches_text = trimmed(unit.substr(foot.size()));
      if (inches_text.empty()) {
        return *number * kFoot_m;
      }
      std::string_view inch;
      const auto inches = plain_number(inches_text, inch);
      if (inches && is_one_of(inch, {"\"", "''", "in", "in.", "inch", "inches"}) &&
          *inches < 12.0) {
        return (*number + *inches / 12.0) * kFoot_m;
      }
      return std::nullopt;
    }
  }
  return std::nullopt;
}

// Pieces of a range or list; the first character never parts, so that a sign makes its piece
// unreadable.
std::vector<std::string_view> pieces_of(std::string_view text) {
  std::vector<std::string_view> pieces;
  std::size_t begin = 0;
  for (std::size_t i = 1; i <= text.size(); ++i) {
    if (i == text.size() || text[i] == '-' || text[i] == ';' || text[i] == '/') {
      pieces.push_back(trimmed(text.substr(begin, i - begin)));
      begin = i + 1;
    }
  }
  return pieces;
}

}  // namespace

std::optional<double> height_in_text_m(std::string_view given, double bare_unit_m) {
  if (given.size() > kLongest) {
    return std::nullopt;
  }
  const std::string text = plain_text(trimmed(given));
  const std::vector<std::string_view> pieces = pieces_of(text);
  if (pieces.empty()) {
    return std::nullopt;
  }
  // "30-40 ft": the last one's unit holds for those that have none.
  std::string_view last_unit;
  if (plain_number(pieces.back(), last_unit) && !last_unit.empty()) {
    bare_unit_m = last_unit.front() == 'm' ? 1.0 : kFoot_m;
  }
  std::optional<double> greatest;
  for (const std::string_view piece : pieces) {
    const auto height_m = single_height_m(piece, bare_unit_m);
    if (!height_m || !(*height_m > 0.0) || !(*height_m <= kHighest_m)) {
      return std::nullopt;
    }
    greatest = std::max(greatest.value_or(0.0), *height_m);
  }
  return greatest;
}

std::optional<double> levels_in_text(std::string_view given) {
  if (given.size() > kLongest) {
    return std::nullopt;
  }
  const std::string text = plain_text(trimmed(given));
  std::optional<double> greatest;
  for (const std::string_view piece : pieces_of(text)) {
    std::string_view rest;
    const auto levels = plain_number(piece, rest);
    if (!levels || !rest.empty() || !(*levels > 0.0) || !(*levels <= kLevelsMax)) {
      return std::nullopt;
    }
    greatest = std::max(greatest.value_or(0.0), *levels);
  }
  return greatest;
}

}  // namespace hedgehop::map_sources
