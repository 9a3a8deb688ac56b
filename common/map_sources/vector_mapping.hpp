#pragma once

#include <optional>
#include <string>
#include <vector>

#include "base/config_reader.hpp"
#include "map_sources/land_use_source.hpp"

namespace hedgehop::map_sources {

/// What a feature of a vector file becomes.
struct MappedKind {
  std::optional<ObjectClass> object_class;  // none: an overhead line
  bool is_minor_line = false;
  std::string word;  // as the mapping names it
};

/// Which features of a layer become what.
struct MappingRule {
  std::string place;  // file:line
  std::string layer;
  std::string attribute;            // empty: every feature of the layer
  std::vector<std::string> values;  // as text, of which one must be equal
  MappedKind kind;
  std::string height_attribute;  // a number or a text; empty: none
  double height_unit_m = 1.0;    // of a bare number
  std::string levels_attribute;  // storeys; empty: none
  std::optional<double> default_height_m;
};

/// How a vector file of any kind is to be read.
struct VectorMapping {
  std::string name;         // of the document
  std::string text;         // the document
  std::string attribution;  // travels with every product; may be empty
  std::string crs;          // of layers that state none; empty: such a layer is refused
  std::vector<std::string> coverage_layers;  // their extents are what the file has mapped
  std::vector<MappingRule> rules;            // the first that fits a feature holds

  /// The whole document (an example: config/mappings/). Throws ConfigError with file and line:
  /// unknown, missing or ill-typed key, unknown class or unit, rule that can never hold.
  static VectorMapping read(const std::string& text, const std::string& name);
};

}  // namespace hedgehop::map_sources
