#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace hedgehop {

/// A strict view of one YAML mapping.
///
/// Each key must be read exactly by its name; finish() (or the end of read_config) refuses keys
/// that nobody read. Every error is a ConfigError that begins with `file:line:` and names the
/// nearest known key. Duplicate keys are refused when the document is loaded. Angles are written in
/// degrees in the file and come out in radians.
class ConfigReader {
 public:
  /// `name` is what errors call the document; usually its path.
  static ConfigReader from_text(std::string_view yaml, std::string name);
  static ConfigReader from_file(const std::string& path);

  ConfigReader(ConfigReader&&) noexcept;
  ConfigReader& operator=(ConfigReader&&) noexcept;
  ~ConfigReader();

  [[nodiscard]] bool has(std::string_view key) const;
  /// Where this mapping begins: `file:line`.
  [[nodiscard]] std::string file_and_line() const;
  double required_double(std::string_view key);
  /// Key ends in `_deg`; the value comes back in radians.
  double required_angle(std::string_view key_deg);
  std::int64_t required_integer(std::string_view key);
  bool required_bool(std::string_view key);
  std::string required_string(std::string_view key);
  std::vector<double> required_doubles(std::string_view key);
  std::vector<std::string> required_strings(std::string_view key);
  /// A nested mapping; must be finished by itself.
  ConfigReader required_section(std::string_view key);
  /// A list of mappings.
  std::vector<ConfigReader> required_sections(std::string_view key);
  /// Every entry of this mapping as key and number, for tables whose keys are data.
  std::vector<std::pair<std::string, double>> all_doubles();

  /// Refuses keys that were not read. Call it once everything has been read.
  void finish() const;

  /// ConfigError with the place of `key`, for values that are well typed but out of range.
  [[noreturn]] void refuse(std::string_view key, const std::string& why) const;
  /// refuse() unless `condition`.
  void require(bool condition, std::string_view key, const std::string& why) const {
    if (!condition) {
      refuse(key, why);
    }
  }

 private:
  struct Node;
  explicit ConfigReader(std::unique_ptr<Node> node);
  std::unique_ptr<Node> node_;
};

/// Merges documents: `overlay` replaces what `text` says, key by key, mappings merged, lists
/// replaced. A key that `text` does not know is refused, unless it is a top-level one in
/// `ignored_keys`, which is left out. Returns canonical YAML.
std::string overlay_config(std::string_view text, const std::string& text_name,
                           std::string_view overlay, const std::string& overlay_name,
                           const std::vector<std::string>& ignored_keys = {});

/// Applies `a.b.c=value` to a document; unknown keys are refused with the nearest known one.
std::string set_config_value(std::string_view text, std::string_view assignment);

/// The text under a top-level key whose value is a word; nullopt if there is no such key.
std::optional<std::string> config_word(std::string_view text, const std::string& name,
                                       std::string_view key);

/// The document without one key ("a.b" lies in the section a), if it is there.
std::string without_config_key(std::string_view text, const std::string& name,
                               std::string_view key);

/// The document with another document as its last top-level section.
std::string with_config_section(std::string_view text, const std::string& name,
                                std::string_view section, std::string_view section_text,
                                const std::string& section_name);

/// The document in a canonical form: comments and layout gone, order of keys kept.
std::string canonical_config(std::string_view text, const std::string& name);

/// The known word nearest to `word` (edit distance at most a third of its length), if any.
std::optional<std::string> nearest_word(std::string_view word,
                                        const std::vector<std::string>& known);

}  // namespace hedgehop
