#include "map_sources/vector_mapping.hpp"

#include <algorithm>
#include <array>

#include "base/errors.hpp"

namespace hedgehop::map_sources {
namespace {

struct KindWord {
  const char* word;
  std::optional<ObjectClass> object_class;
  bool is_minor_line;
};
constexpr std::array<KindWord, 8> kKinds = {{{"forest", ObjectClass::kForest, false},
                                             {"tree", ObjectClass::kTree, false},
                                             {"building", ObjectClass::kBuilding, false},
                                             {"structure", ObjectClass::kStructure, false},
                                             {"built_up_area", ObjectClass::kBuiltUpArea, false},
                                             {"water", ObjectClass::kWater, false},
                                             {"power_line", std::nullopt, false},
                                             {"minor_power_line", std::nullopt, true}}};

std::string all_kinds() {
  std::string words;
  for (const KindWord& kind : kKinds) {
    words += (words.empty() ? "" : ", ") + std::string(kind.word);
  }
  return words;
}

MappedKind kind_of(ConfigReader& reader) {
  const std::string word = reader.required_string("class");
  const auto* const kind =
      std::find_if(kKinds.begin(), kKinds.end(),
                   [&](const KindWord& candidate) { return candidate.word == word; });
  if (kind == kKinds.end()) {
    reader.refuse("class", "is '" + word + "', but must be one of " + all_kinds());
  }
  return {kind->object_class, kind->is_minor_line, word};
}

std::string required_name(ConfigReader& reader, const char* key) {
  const std::string name = reader.required_string(key);
  reader.require(!name.empty(), key, "must not be empty");
  return name;
}

double unit_of(ConfigReader& reader) {
  const std::string unit = reader.required_string("height_unit");
  if (unit == "m") {
    return 1.0;
  }
  reader.require(unit == "ft", "height_unit", "is '" + unit + "', but must be m or ft");
  return 0.3048;
}

MappingRule rule_of(ConfigReader& reader) {
  MappingRule rule;
  rule.place = reader.file_and_line();
  rule.layer = required_name(reader, "layer");
  if (reader.has("attribute") || reader.has("values")) {
    rule.attribute = required_name(reader, "attribute");
    rule.values = reader.required_strings("values");
    reader.require(!rule.values.empty(), "values", "must not be empty");
  }
  rule.kind = kind_of(reader);
  const bool has_height = rule.kind.object_class != ObjectClass::kWater;
  if (reader.has("height_attribute") || reader.has("height_unit")) {
    reader.require(has_height, "height_attribute", "makes no sense: water has no height");
    rule.height_attribute = required_name(reader, "height_attribute");
    rule.height_unit_m = unit_of(reader);
  }
  if (reader.has("levels_attribute")) {
    reader.require(rule.kind.object_class == ObjectClass::kBuilding, "levels_attribute",
                   "makes sense for buildings only");
    rule.levels_attribute = required_name(reader, "levels_attribute");
  }
  if (reader.has("default_height_m")) {
    reader.require(has_height, "default_height_m", "makes no sense: water has no height");
    const double height_m = reader.required_double("default_height_m");
    reader.require(height_m >= 0.0 && height_m <= 1000.0, "default_height_m",
                   "must lie in 0 to 1000");
    rule.default_height_m = height_m;
  }
  reader.finish();
  return rule;
}

// True if every feature that `later` fits has been taken by `earlier`.
bool hides(const MappingRule& earlier, const MappingRule& later) {
  if (earlier.layer != later.layer) {
    return false;
  }
  if (earlier.attribute.empty()) {
    return true;
  }
  return earlier.attribute == later.attribute &&
         std::all_of(later.values.begin(), later.values.end(), [&](const std::string& value) {
           return std::find(earlier.values.begin(), earlier.values.end(), value) !=
                  earlier.values.end();
         });
}

}  // namespace

VectorMapping VectorMapping::read(const std::string& text, const std::string& name) {
  VectorMapping mapping;
  mapping.name = name;
  mapping.text = text;
  ConfigReader reader = ConfigReader::from_text(text, name);
  mapping.attribution = reader.required_string("attribution");
  if (reader.has("crs")) {
    mapping.crs = required_name(reader, "crs");
  }
  mapping.coverage_layers = reader.required_strings("coverage_layers");
  reader.require(!mapping.coverage_layers.empty(), "coverage_layers",
                 "must not be empty: without it every cell would count as unmapped");
  for (ConfigReader& section : reader.required_sections("rules")) {
    MappingRule rule = rule_of(section);
    for (const MappingRule& earlier : mapping.rules) {
      if (hides(earlier, rule)) {
        throw ConfigError(rule.place + ": this rule can never hold, the one of " + earlier.place +
                              " takes all of its features",
                          "put the more particular rule first");
      }
    }
    mapping.rules.push_back(std::move(rule));
  }
  reader.require(!mapping.rules.empty(), "rules", "must not be empty");
  reader.finish();
  return mapping;
}

}  // namespace hedgehop::map_sources
