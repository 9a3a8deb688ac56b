#include "base/config_reader.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <set>
#include <yaml-cpp/yaml.h>

#include "base/angles.hpp"
#include "base/config_entries.hpp"
#include "base/errors.hpp"
#include "base/files.hpp"

namespace hedgehop {
namespace {

std::string place(const std::string& name, const YAML::Mark& mark) {
  return mark.line < 0 ? name + ": " : name + ":" + std::to_string(mark.line + 1) + ": ";
}

void check_duplicates(const YAML::Node& node, const std::string& name) {
  if (node.IsMap()) {
    std::set<std::string> seen;
    for (const auto& entry : node) {
      if (!entry.first.IsScalar()) {
        throw ConfigError(place(name, entry.first.Mark()) + "a key must be a word");
      }
      if (!seen.insert(entry.first.Scalar()).second) {
        throw ConfigError(place(name, entry.first.Mark()) + "duplicate key '" +
                          entry.first.Scalar() + "'");
      }
      check_duplicates(entry.second, name);
    }
  } else if (node.IsSequence()) {
    for (const auto& item : node) {
      check_duplicates(item, name);
    }
  }
}

YAML::Node load(std::string_view text, const std::string& name) {
  YAML::Node root;
  try {
    root = YAML::Load(std::string(text));
  } catch (const YAML::Exception& error) {
    throw ConfigError(place(name, error.mark) + "not valid YAML: " + error.msg);
  }
  if (!root.IsMap()) {
    throw ConfigError(name + ":1: a mapping of keys to values is expected");
  }
  check_duplicates(root, name);
  return root;
}

void emit(YAML::Emitter& out, const YAML::Node& node) {
  if (node.IsMap()) {
    out << YAML::BeginMap;
    for (const auto& entry : node) {
      out << YAML::Key << entry.first.Scalar() << YAML::Value;
      emit(out, entry.second);
    }
    out << YAML::EndMap;
  } else if (node.IsSequence()) {
    const bool is_flat = std::all_of(node.begin(), node.end(),
                                     [](const YAML::Node& item) { return item.IsScalar(); });
    if (is_flat) {
      out << YAML::Flow;
    }
    out << YAML::BeginSeq;
    for (const auto& item : node) {
      emit(out, item);
    }
    out << YAML::EndSeq;
  } else if (node.IsNull()) {
    out << YAML::Null;
  } else if (node.Tag() == "!") {
    out << YAML::DoubleQuoted << node.Scalar();
  } else {
    out << node.Scalar();
  }
}

std::string emitted(const YAML::Node& node) {
  YAML::Emitter out;
  emit(out, node);
  return std::string(out.c_str()) + "\n";
}

std::string known_keys_hint(std::string_view key, const YAML::Node& node) {
  std::vector<std::string> known;
  for (const auto& entry : node) {
    known.push_back(entry.first.Scalar());
  }
  const auto nearest = nearest_word(key, known);
  return nearest ? "did you mean '" + *nearest + "'?" : "";
}

// What a value in a user's document must be to stand for the one in the shipped document; the
// reader would find it too, but could no longer tell the line that the user wrote.
void check_same_kind(const YAML::Node& shipped, const YAML::Node& value, const std::string& key,
                     const std::string& where) {
  double number = 0.0;
  bool flag = false;
  const char* kind = nullptr;
  if (shipped.IsSequence()) {
    kind = value.IsSequence() ? nullptr : "a list";
  } else if (!value.IsScalar()) {
    kind = "a single value";
  } else if (shipped.Tag() != "!" && YAML::convert<double>::decode(shipped, number)) {
    kind = YAML::convert<double>::decode(value, number) && std::isfinite(number) ? nullptr
                                                                                 : "a number";
  } else if (shipped.Tag() != "!" && YAML::convert<bool>::decode(shipped, flag)) {
    kind = YAML::convert<bool>::decode(value, flag) ? nullptr : "true or false";
  }
  if (kind != nullptr) {
    throw ConfigError(where + "'" + key + "' must be " + kind);
  }
}

// yaml-cpp nodes are references: assigning to an element changes the document.
void merge_into(YAML::Node base, const YAML::Node& overlay, const std::string& overlay_name) {
  for (const auto& entry : overlay) {
    const std::string key = entry.first.Scalar();
    if (!base[key]) {
      throw ConfigError(place(overlay_name, entry.first.Mark()) + "unknown key '" + key + "'",
                        known_keys_hint(key, base));
    }
    if (base[key].IsMap() && entry.second.IsMap()) {
      merge_into(base[key], entry.second, overlay_name);
    } else if (base[key].IsMap() || entry.second.IsMap()) {
      throw ConfigError(place(overlay_name, entry.second.Mark()) + "'" + key + "' must be a " +
                        (base[key].IsMap() ? "mapping" : "single value or list"));
    } else {
      check_same_kind(base[key], entry.second, key, place(overlay_name, entry.second.Mark()));
      base[key] = entry.second;
    }
  }
}

}  // namespace

struct ConfigReader::Node {
  YAML::Node yaml;
  std::string name;
  std::string path;  // dotted path of this mapping, ends in '.', or empty
  std::set<std::string, std::less<>> read;
  std::set<std::string, std::less<>> optional;  // asked for by has()

  std::string where(std::string_view key) const { return path + std::string(key); }

  YAML::Node value(std::string_view key) {
    read.emplace(key);
    const YAML::Node& constant = yaml;
    YAML::Node found = constant[std::string(key)];
    if (!found) {
      throw ConfigError(place(name, yaml.Mark()) + "missing key '" + where(key) + "'");
    }
    return found;
  }

  // yaml-cpp places an empty value where the next token begins: its key's line is the one to name.
  YAML::Mark mark_of(const YAML::Node& node, std::string_view key) const {
    if (node.IsNull()) {
      for (const auto& entry : yaml) {
        if (entry.first.Scalar() == key) {
          return entry.first.Mark();
        }
      }
    }
    return node.Mark();
  }

  template <typename T>
  T scalar(const YAML::Node& node, std::string_view key, const char* kind) const {
    T result{};
    if (!node.IsScalar() || !YAML::convert<T>::decode(node, result)) {
      throw ConfigError(place(name, mark_of(node, key)) + "'" + where(key) + "' must be " + kind);
    }
    return result;
  }

  double number(const YAML::Node& node, std::string_view key) const {
    const auto result = scalar<double>(node, key, "a number");
    if (!std::isfinite(result)) {
      throw ConfigError(place(name, node.Mark()) + "'" + where(key) + "' must be finite");
    }
    return result;
  }
};

ConfigReader::ConfigReader(std::unique_ptr<Node> node) : node_(std::move(node)) {}
ConfigReader::ConfigReader(ConfigReader&&) noexcept = default;
ConfigReader& ConfigReader::operator=(ConfigReader&&) noexcept = default;
ConfigReader::~ConfigReader() = default;

ConfigReader ConfigReader::from_text(std::string_view yaml, std::string name) {
  auto node = std::make_unique<Node>();
  node->yaml.reset(load(yaml, name));
  node->name = std::move(name);
  return ConfigReader(std::move(node));
}

ConfigReader ConfigReader::from_file(const std::string& path) {
  return from_text(read_file(path), path);
}

bool ConfigReader::has(std::string_view key) const {
  node_->optional.emplace(key);
  const YAML::Node& constant = node_->yaml;
  return static_cast<bool>(constant[std::string(key)]);
}

std::string ConfigReader::file_and_line() const {
  const YAML::Mark mark = node_->yaml.Mark();
  return mark.line < 0 ? node_->name : node_->name + ":" + std::to_string(mark.line + 1);
}

double ConfigReader::required_double(std::string_view key) {
  return node_->number(node_->value(key), key);
}

double ConfigReader::required_angle(std::string_view key_deg) {
  HEDGEHOP_ASSERT(key_deg.ends_with("_deg"));
  return radians_from_degrees(required_double(key_deg));
}

std::int64_t ConfigReader::required_integer(std::string_view key) {
  return node_->scalar<std::int64_t>(node_->value(key), key, "a whole number");
}

bool ConfigReader::required_bool(std::string_view key) {
  return node_->scalar<bool>(node_->value(key), key, "true or false");
}

std::string ConfigReader::required_string(std::string_view key) {
  return node_->scalar<std::string>(node_->value(key), key, "a word or text");
}

std::vector<double> ConfigReader::required_doubles(std::string_view key) {
  const YAML::Node list = node_->value(key);
  if (!list.IsSequence()) {
    throw ConfigError(place(node_->name, list.Mark()) + "'" + node_->where(key) +
                      "' must be a list of numbers");
  }
  std::vector<double> numbers;
  for (const auto& item : list) {
    numbers.push_back(node_->number(item, key));
  }
  return numbers;
}

std::vector<std::string> ConfigReader::required_strings(std::string_view key) {
  const YAML::Node list = node_->value(key);
  if (!list.IsSequence()) {
    throw ConfigError(place(node_->name, list.Mark()) + "'" + node_->where(key) +
                      "' must be a list of words");
  }
  std::vector<std::string> words;
  for (const auto& item : list) {
    words.push_back(node_->scalar<std::string>(item, key, "a list of words"));
  }
  return words;
}

ConfigReader ConfigReader::required_section(std::string_view key) {
  auto section = std::make_unique<Node>();
  section->yaml.reset(node_->value(key));
  section->name = node_->name;
  section->path = node_->where(key) + ".";
  if (!section->yaml.IsMap()) {
    throw ConfigError(place(node_->name, section->yaml.Mark()) + "'" + node_->where(key) +
                      "' must be a mapping");
  }
  return ConfigReader(std::move(section));
}

std::vector<ConfigReader> ConfigReader::required_sections(std::string_view key) {
  const YAML::Node list = node_->value(key);
  if (!list.IsSequence()) {
    throw ConfigError(place(node_->name, list.Mark()) + "'" + node_->where(key) +
                      "' must be a list of mappings");
  }
  std::vector<ConfigReader> sections;
  for (const auto& item : list) {
    auto section = std::make_unique<Node>();
    section->yaml.reset(static_cast<const YAML::Node&>(item));
    section->name = node_->name;
    section->path = node_->where(key) + "[" + std::to_string(sections.size()) + "].";
    if (!item.IsMap()) {
      throw ConfigError(place(node_->name, item.Mark()) + "'" + node_->where(key) +
                        "' must be a list of mappings");
    }
    sections.push_back(ConfigReader(std::move(section)));
  }
  return sections;
}

std::vector<std::pair<std::string, double>> ConfigReader::all_doubles() {
  std::vector<std::pair<std::string, double>> entries;
  for (const auto& entry : node_->yaml) {
    const std::string key = entry.first.Scalar();
    node_->read.insert(key);
    entries.emplace_back(key, node_->number(entry.second, key));
  }
  return entries;
}

void ConfigReader::finish() const {
  std::vector<std::string> known(node_->read.begin(), node_->read.end());
  known.insert(known.end(), node_->optional.begin(), node_->optional.end());
  for (const auto& entry : node_->yaml) {
    const std::string key = entry.first.Scalar();
    if (!node_->read.contains(key)) {
      const auto nearest = nearest_word(key, known);
      throw ConfigError(
          place(node_->name, entry.first.Mark()) + "unknown key '" + node_->where(key) + "'",
          nearest ? "did you mean '" + *nearest + "'?" : "");
    }
  }
}

void ConfigReader::refuse(std::string_view key, const std::string& why) const {
  const YAML::Node& constant = node_->yaml;
  const YAML::Node found = constant[std::string(key)];
  throw ConfigError(place(node_->name, found ? found.Mark() : constant.Mark()) + "'" +
                    node_->where(key) + "' " + why);
}

std::string overlay_config(std::string_view text, const std::string& text_name,
                           std::string_view overlay, const std::string& overlay_name,
                           const std::vector<std::string>& ignored_keys) {
  YAML::Node base = load(text, text_name);
  YAML::Node top = load(overlay, overlay_name);
  for (const std::string& key : ignored_keys) {
    top.remove(key);
  }
  merge_into(base, top, overlay_name);
  return emitted(base);
}

std::string set_config_value(std::string_view text, std::string_view assignment) {
  const auto equals = assignment.find('=');
  if (equals == std::string_view::npos || equals == 0) {
    throw UsageError("--set wants key=value, not '" + std::string(assignment) + "'",
                     "for example --set global.weights.visibility=25");
  }
  const std::string name = "--set " + std::string(assignment);
  YAML::Node root = load(text, "configuration");
  YAML::Node node = root;
  std::string_view path = assignment.substr(0, equals);
  while (true) {
    const auto dot = path.find('.');
    const std::string key(path.substr(0, dot));
    const YAML::Node& constant = node;
    if (!node.IsMap() || !constant[key]) {
      throw ConfigError(name + ": unknown key '" + key + "'",
                        node.IsMap() ? known_keys_hint(key, node) : "");
    }
    node.reset(node[key]);
    if (dot == std::string_view::npos) {
      break;
    }
    path.remove_prefix(dot + 1);
  }
  try {
    const YAML::Node value = YAML::Load(std::string(assignment.substr(equals + 1)));
    if (value.IsMap() != node.IsMap() || value.IsSequence() != node.IsSequence()) {
      throw ConfigError(name + ": the value has another shape than the one it replaces");
    }
    if (!value.IsMap()) {
      check_same_kind(node, value, std::string(assignment.substr(0, equals)), name + ": ");
    }
    node = value;
  } catch (const YAML::Exception& error) {
    throw ConfigError(name + ": the value is not valid YAML: " + error.msg);
  }
  return emitted(root);
}

std::optional<std::string> config_word(std::string_view text, const std::string& name,
                                       std::string_view key) {
  const YAML::Node root = load(text, name);
  const YAML::Node found = root[std::string(key)];
  if (!found) {
    return std::nullopt;
  }
  if (!found.IsScalar()) {
    throw ConfigError(place(name, found.Mark()) + "'" + std::string(key) + "' must be a word");
  }
  return found.Scalar();
}

std::string without_config_key(std::string_view text, const std::string& name,
                               std::string_view key) {
  YAML::Node root = load(text, name);
  YAML::Node section = root;
  for (auto dot = key.find('.'); dot != std::string_view::npos; dot = key.find('.')) {
    const YAML::Node& constant = section;
    const YAML::Node inner = constant[std::string(key.substr(0, dot))];
    if (!inner || !inner.IsMap()) {
      return emitted(root);
    }
    section.reset(inner);
    key.remove_prefix(dot + 1);
  }
  section.remove(std::string(key));
  return emitted(root);
}

std::string with_config_section(std::string_view text, const std::string& name,
                                std::string_view section, std::string_view section_text,
                                const std::string& section_name) {
  YAML::Node root = load(text, name);
  root[std::string(section)] = load(section_text, section_name);
  return emitted(root);
}

std::vector<ConfigEntry> config_entries(std::string_view text, const std::string& name) {
  std::vector<ConfigEntry> entries;
  const std::function<void(const YAML::Node&, const std::string&)> collect =
      [&](const YAML::Node& map, const std::string& prefix) {
        for (const auto& pair : map) {
          const std::string key = prefix + pair.first.Scalar();
          if (pair.second.IsMap()) {
            collect(pair.second, key + ".");
            continue;
          }
          YAML::Emitter out;
          out.SetSeqFormat(YAML::Flow);
          out.SetMapFormat(YAML::Flow);
          out << pair.second;
          std::string value = out.c_str();
          std::replace(value.begin(), value.end(), '\n', ' ');
          entries.push_back({key, value, pair.first.Mark().line + 1});
        }
      };
  collect(load(text, name), "");
  return entries;
}

std::string canonical_config(std::string_view text, const std::string& name) {
  return emitted(load(text, name));
}

std::optional<std::string> nearest_word(std::string_view word,
                                        const std::vector<std::string>& known) {
  std::optional<std::string> nearest;
  std::size_t best = word.size() / 3 + 1;
  for (const std::string& candidate : known) {
    std::vector<std::size_t> row(candidate.size() + 1);
    for (std::size_t j = 0; j < row.size(); ++j) {
      row[j] = j;
    }
    for (std::size_t i = 1; i <= word.size(); ++i) {
      std::size_t diagonal = row[0];
      row[0] = i;
      for (std::size_t j = 1; j <= candidate.size(); ++j) {
        const std::size_t above = row[j];
        row[j] = std::min(
            {above + 1, row[j - 1] + 1, diagonal + (word[i - 1] == candidate[j - 1] ? 0U : 1U)});
        diagonal = above;
      }
    }
    if (row.back() < best) {
      best = row.back();
      nearest = candidate;
    }
  }
  return nearest;
}

}  // namespace hedgehop
