// Text of a mapping file: it is read, or refused with the file's name in front.
#include <cstdint>
#include <cstdlib>
#include <string>

#include "base/errors.hpp"
#include "map_sources/vector_mapping.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using hedgehop::map_sources::MappingRule;
  using hedgehop::map_sources::VectorMapping;
  const std::string text(reinterpret_cast<const char*>(data), size);
  try {
    const VectorMapping mapping = VectorMapping::read(text, "m.yaml");
    if (mapping.rules.empty() || mapping.coverage_layers.empty()) {
      std::abort();
    }
    for (const MappingRule& rule : mapping.rules) {
      if (rule.layer.empty() || rule.attribute.empty() != rule.values.empty() ||
          !rule.place.starts_with("m.yaml:")) {
        std::abort();
      }
    }
  } catch (const hedgehop::ConfigError& error) {
    if (!std::string(error.what()).starts_with("m.yaml:")) {
      std::abort();
    }
  }
  return 0;
}
