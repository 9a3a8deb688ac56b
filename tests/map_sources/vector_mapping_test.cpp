#include "map_sources/vector_mapping.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/errors.hpp"

namespace hedgehop::map_sources {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::StartsWith;

std::string with_rule(const std::string& rule) {
  return "attribution: \"(c) surveyor\"\ncoverage_layers: [a]\nrules:\n" + rule;
}

std::string refusal_of(const std::string& text) {
  try {
    (void)VectorMapping::read(text, "m.yaml");
  } catch (const ConfigError& error) {
    return error.what() + (" | " + error.hint());
  }
  return "";
}

TEST(VectorMapping, KeepsEveryWordOfItsRules) {
  const VectorMapping mapping = VectorMapping::read(
      with_rule("  - {layer: a, attribute: kind, values: [x, '7'], class: building,\n"
                "     height_attribute: h, height_unit: ft, levels_attribute: n,\n"
                "     default_height_m: 4.5}\n"
                "  - {layer: a, class: minor_power_line}\n"),
      "m.yaml");
  EXPECT_EQ(mapping.attribution, "(c) surveyor");
  EXPECT_THAT(mapping.coverage_layers, testing::ElementsAre("a"));
  ASSERT_EQ(mapping.rules.size(), 2U);
  const MappingRule& rule = mapping.rules[0];
  EXPECT_EQ(rule.place, "m.yaml:4");
  EXPECT_EQ(rule.layer, "a");
  EXPECT_EQ(rule.attribute, "kind");
  EXPECT_THAT(rule.values, testing::ElementsAre("x", "7"));
  EXPECT_EQ(rule.kind.object_class, ObjectClass::kBuilding);
  EXPECT_EQ(rule.height_attribute, "h");
  EXPECT_EQ(rule.height_unit_m, 0.3048);
  EXPECT_EQ(rule.levels_attribute, "n");
  EXPECT_EQ(rule.default_height_m, 4.5);
  EXPECT_FALSE(mapping.rules[1].kind.object_class.has_value());
  EXPECT_TRUE(mapping.rules[1].kind.is_minor_line);
  EXPECT_TRUE(mapping.rules[1].attribute.empty());
  EXPECT_FALSE(mapping.rules[1].default_height_m.has_value());
}

TEST(VectorMapping, RefusesWhatCannotBeMeantWithFileAndLine) {
  const struct {
    const char* rule;
    const char* line;
    const char* what;
  } kCases[] = {
      {"  - {layer: a, class: woods}\n", "m.yaml:4: ", "one of forest, tree"},
      {"  - {layer: a, class: forest}\n  - {layer: b, clas: forest}\n", "m.yaml:5: ", "class"},
      {"  - {layer: '', class: forest}\n", "m.yaml:4: ", "must not be empty"},
      {"  - {layer: a, class: forest, attribute: x}\n",
       "m.yaml:4: ", "missing key 'rules[0].values'"},
      {"  - {layer: a, class: forest, values: [x]}\n",
       "m.yaml:4: ", "missing key 'rules[0].attribute'"},
      {"  - {layer: a, class: forest, attribute: x, values: []}\n",
       "m.yaml:4: ", "must not be empty"},
      {"  - {layer: a, class: forest, height_attribute: h}\n",
       "m.yaml:4: ", "missing key 'rules[0].height_unit'"},
      {"  - {layer: a, class: forest, height_attribute: h, height_unit: yd}\n",
       "m.yaml:4: ", "must be m or ft"},
      {"  - {layer: a, class: water, default_height_m: 3}\n", "m.yaml:4: ", "water has no height"},
      {"  - {layer: a, class: forest, levels_attribute: n}\n", "m.yaml:4: ", "buildings only"},
      {"  - {layer: a, class: forest, default_height_m: -1}\n", "m.yaml:4: ", "0 to 1000"},
      {"  - {layer: a, class: forest, default_height_m: high}\n", "m.yaml:4: ", "a number"},
      {"  - {layer: a, class: forest, colour: green}\n", "m.yaml:4: ", "unknown key"},
      {"  - {layer: a, class: forest}\n  - {layer: a, class: water}\n",
       "m.yaml:5: ", "can never hold"},
      {"  - {layer: a, attribute: k, values: [x, y], class: forest}\n"
       "  - {layer: a, attribute: k, values: [y], class: water}\n",
       "m.yaml:5: ", "can never hold"},
      {"  []\n", "m.yaml:", "must not be empty"},
  };
  for (const auto& c : kCases) {
    EXPECT_THAT(refusal_of(with_rule(c.rule)), AllOf(StartsWith(c.line), HasSubstr(c.what)))
        << c.rule;
  }
  EXPECT_THAT(
      refusal_of("attribution: x\ncoverage_layers: []\nrules:\n  - {layer: a, class: water}\n"),
      AllOf(StartsWith("m.yaml:2: "), HasSubstr("must not be empty")));
  // The same values in another layer, or more of them, are another matter.
  EXPECT_EQ(refusal_of(with_rule("  - {layer: a, attribute: k, values: [x], class: forest}\n"
                                 "  - {layer: a, attribute: k, values: [x, y], class: water}\n"
                                 "  - {layer: b, attribute: k, values: [x], class: water}\n"
                                 "  - {layer: a, class: tree}\n")),
            "");
}

}  // namespace
}  // namespace hedgehop::map_sources
