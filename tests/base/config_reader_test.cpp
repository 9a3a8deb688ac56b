#include "base/config_reader.hpp"

#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <string>

#include "base/errors.hpp"
#include "base/files.hpp"
#include "base/shipped_config.hpp"
#include "support/temporary_folder.hpp"

namespace hedgehop {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

struct Refusal {
  std::string what;
  std::string hint;
};

Refusal refusal_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const ConfigError& error) {
    return {error.what(), error.hint()};
  }
  return {"nothing was refused", ""};
}

Refusal refusal_of(const std::string& text, const std::function<void(ConfigReader&)>& read) {
  return refusal_of([&] {
    ConfigReader reader = ConfigReader::from_text(text, "c.yaml");
    read(reader);
    reader.finish();
  });
}

constexpr const char* kDocument =
    "range_m: 350.5\n"
    "bank_deg: 30\n"
    "\n"
    "nested:\n"
    "  count: 7\n"
    "  is_used: true\n"
    "  name: hills\n"
    "numbers: [1, 2.5]\n"
    "words: [a, b]\n"
    "rules:\n"
    "  - {cost: 1}\n"
    "  - {cost: 2}\n";

TEST(ConfigReader, ValuesComeOutAsWritten) {
  ConfigReader reader = ConfigReader::from_text(kDocument, "c.yaml");
  EXPECT_EQ(reader.required_double("range_m"), 350.5);
  EXPECT_NEAR(reader.required_angle("bank_deg"), std::numbers::pi / 6.0, 1e-15);
  ConfigReader nested = reader.required_section("nested");
  EXPECT_EQ(nested.required_integer("count"), 7);
  EXPECT_TRUE(nested.required_bool("is_used"));
  EXPECT_EQ(nested.required_string("name"), "hills");
  EXPECT_NO_THROW(nested.finish());
  EXPECT_THAT(reader.required_doubles("numbers"), ElementsAre(1.0, 2.5));
  EXPECT_THAT(reader.required_strings("words"), ElementsAre("a", "b"));
  std::vector<ConfigReader> rules = reader.required_sections("rules");
  ASSERT_EQ(rules.size(), 2U);
  EXPECT_EQ(rules[1].required_double("cost"), 2.0);
  EXPECT_NO_THROW(reader.finish());
  EXPECT_TRUE(reader.has("words"));
  EXPECT_FALSE(reader.has("word"));
}

TEST(ConfigReader, UnknownKeyIsRefusedWithFileLineAndTheNearestKnownKey) {
  const Refusal refusal = refusal_of("a_m: 1\nrnage_m: 2\n", [](ConfigReader& reader) {
    reader.required_double("a_m");
    if (reader.has("range_m")) {
      reader.required_double("range_m");
    }
  });
  EXPECT_EQ(refusal.what, "c.yaml:2: unknown key 'rnage_m'");
  const Refusal near = refusal_of("range_m: 1\nrange_mm: 2\n",
                                  [](ConfigReader& reader) { reader.required_double("range_m"); });
  EXPECT_EQ(near.what, "c.yaml:2: unknown key 'range_mm'");
  EXPECT_EQ(near.hint, "did you mean 'range_m'?");
}

TEST(ConfigReader, KeyThatMayBeMissingIsSuggestedToo) {
  ConfigReader reader = ConfigReader::from_text("sped_mps: 3\n", "a.yaml");
  EXPECT_FALSE(reader.has("speed_mps"));
  try {
    reader.finish();
    FAIL();
  } catch (const ConfigError& error) {
    EXPECT_EQ(error.hint(), "did you mean 'speed_mps'?");
  }
}

TEST(ConfigReader, MissingKeyIsRefusedByItsFullName) {
  const Refusal refusal = refusal_of("nested:\n  a: 1\n", [](ConfigReader& reader) {
    reader.required_section("nested").required_double("b");
  });
  EXPECT_THAT(refusal.what, StartsWith("c.yaml:"));
  EXPECT_THAT(refusal.what, HasSubstr("missing key 'nested.b'"));
}

TEST(ConfigReader, DuplicateKeyIsRefusedAtAnyDepth) {
  EXPECT_EQ(refusal_of("a: 1\nb: 2\na: 3\n", [](ConfigReader&) {}).what,
            "c.yaml:3: duplicate key 'a'");
  EXPECT_EQ(refusal_of("x:\n  - {a: 1,\n     a: 2}\n", [](ConfigReader&) {}).what,
            "c.yaml:3: duplicate key 'a'");
}

TEST(ConfigReader, IllTypedValuesAreRefusedInTheirLine) {
  const auto type_error = [](const std::string& value,
                             const std::function<void(ConfigReader&)>& read) {
    return refusal_of("first: 0\nkey_deg: " + value + "\n",
                      [&](ConfigReader& reader) {
                        reader.required_double("first");
                        read(reader);
                      })
        .what;
  };
  const auto number = [](ConfigReader& reader) { reader.required_double("key_deg"); };
  const auto whole = [](ConfigReader& reader) { reader.required_integer("key_deg"); };
  const auto truth = [](ConfigReader& reader) { reader.required_bool("key_deg"); };
  EXPECT_EQ(type_error("many", number), "c.yaml:2: 'key_deg' must be a number");
  EXPECT_EQ(type_error("[1]", number), "c.yaml:2: 'key_deg' must be a number");
  EXPECT_EQ(type_error("", number), "c.yaml:2: 'key_deg' must be a number");
  EXPECT_EQ(type_error(".nan", number), "c.yaml:2: 'key_deg' must be finite");
  EXPECT_EQ(type_error(".inf", number), "c.yaml:2: 'key_deg' must be finite");
  EXPECT_EQ(type_error("1.5", whole), "c.yaml:2: 'key_deg' must be a whole number");
  EXPECT_EQ(type_error("12345678901234567890", whole),
            "c.yaml:2: 'key_deg' must be a whole number");
  EXPECT_EQ(type_error("7", truth), "c.yaml:2: 'key_deg' must be true or false");
  EXPECT_THAT(type_error("3", [](ConfigReader& reader) { reader.required_section("key_deg"); }),
              HasSubstr("must be a mapping"));
  EXPECT_THAT(type_error("3", [](ConfigReader& reader) { reader.required_doubles("key_deg"); }),
              HasSubstr("must be a list of numbers"));
  EXPECT_THAT(
      type_error("[1, x]", [](ConfigReader& reader) { reader.required_doubles("key_deg"); }),
      HasSubstr("must be a number"));
  EXPECT_THAT(type_error("[1]", [](ConfigReader& reader) { reader.required_sections("key_deg"); }),
              HasSubstr("must be a list of mappings"));
}

TEST(ConfigReader, BrokenDocumentsAreRefusedWithTheirPlace) {
  EXPECT_THAT(refusal_of("a: 1\nb: [1, 2\n", [](ConfigReader&) {}).what, StartsWith("c.yaml:"));
  EXPECT_THAT(refusal_of("a: 1\nb: [1, 2\n", [](ConfigReader&) {}).what,
              HasSubstr("not valid YAML"));
  EXPECT_EQ(refusal_of("- 1\n- 2\n", [](ConfigReader&) {}).what,
            "c.yaml:1: a mapping of keys to values is expected");
  EXPECT_EQ(refusal_of("", [](ConfigReader&) {}).what,
            "c.yaml:1: a mapping of keys to values is expected");
}

TEST(ConfigReader, RangeErrorNamesTheLineOfTheKey) {
  const Refusal refusal = refusal_of("a: 1\nb: -2\n", [](ConfigReader& reader) {
    reader.required_double("a");
    reader.require(reader.required_double("b") > 0.0, "b", "must be above 0");
  });
  EXPECT_EQ(refusal.what, "c.yaml:2: 'b' must be above 0");
}

TEST(ConfigReader, FileErrorsNameTheFile) {
  const test::TemporaryFolder folder;
  const std::string path = (folder.path() / "x.yaml").string();
  write_file_atomically(path, std::string_view("a: 1\n"));
  EXPECT_EQ(refusal_of([&] { ConfigReader::from_file(path).finish(); }).what,
            path + ":1: unknown key 'a'");
  EXPECT_THROW(ConfigReader::from_file(path + ".none"), DataError);
}

TEST(ConfigOverlay, ReplacesValuesMergesMappingsAndKeepsTheRest) {
  const std::string merged =
      overlay_config("a: 1\nn:\n  b: 2\n  c: [1, 2]\n", "base.yaml", "n: {c: [3]}\n", "mine.yaml");
  ConfigReader reader = ConfigReader::from_text(merged, "merged");
  EXPECT_EQ(reader.required_double("a"), 1.0);
  ConfigReader nested = reader.required_section("n");
  EXPECT_EQ(nested.required_double("b"), 2.0);
  EXPECT_THAT(nested.required_doubles("c"), ElementsAre(3.0));
}

TEST(ConfigOverlay, KeyThatTheBaseDoesNotKnowIsRefusedInTheOverlaysLine) {
  const Refusal refusal = refusal_of([] {
    overlay_config("n:\n  bank_max: 2\n", "base.yaml", "\nn:\n  bank_mx: 3\n", "mine.yaml");
  });
  EXPECT_THAT(refusal.what, StartsWith("mine.yaml:3: unknown key"));
  EXPECT_THAT(refusal.hint, HasSubstr("bank_max"));
}

TEST(ConfigOverlay, MappingCannotReplaceAValueNorTheOtherWayRound) {
  EXPECT_THAT(
      refusal_of([] { overlay_config("a: 1\n", "base.yaml", "a: {b: 1}\n", "mine.yaml"); }).what,
      StartsWith("mine.yaml:1: "));
  EXPECT_THAT(
      refusal_of([] { overlay_config("a: {b: 1}\n", "base.yaml", "a: 1\n", "mine.yaml"); }).what,
      StartsWith("mine.yaml:1: "));
}

TEST(ConfigSetting, ChangesOneValueByItsPath) {
  const std::string text = set_config_value("a: 1\nn:\n  b: 2\n", "n.b=5.5");
  ConfigReader reader = ConfigReader::from_text(text, "set");
  EXPECT_EQ(reader.required_double("a"), 1.0);
  EXPECT_EQ(reader.required_section("n").required_double("b"), 5.5);
}

TEST(ConfigSetting, UnknownPathsShapesAndSyntaxAreRefused) {
  const Refusal unknown = refusal_of([] { set_config_value("n:\n  bank: 2\n", "n.bnk=5"); });
  EXPECT_THAT(unknown.what, HasSubstr("bnk"));
  EXPECT_THAT(unknown.hint, HasSubstr("bank"));
  EXPECT_THAT(refusal_of([] { set_config_value("n:\n  b: 2\n", "n=5"); }).what, HasSubstr("shape"));
  EXPECT_THAT(refusal_of([] { set_config_value("n: 3\n", "n.b=5"); }).what,
              HasSubstr("unknown key"));
  EXPECT_THROW(set_config_value("n: 3\n", "n"), UsageError);
  EXPECT_THROW(set_config_value("n: 3\n", "=3"), UsageError);
}

TEST(ConfigCanonical, LayoutAndCommentsDoNotMatterButOrderAndValuesDo) {
  const std::string plain = canonical_config("a: 1\nb:\n  c: [1, 2]\n", "x");
  EXPECT_EQ(canonical_config("# remark\na:   1 # one\nb: {c: [1,   2]}\n", "y"), plain);
  EXPECT_NE(canonical_config("a: 2\nb: {c: [1, 2]}\n", "y"), plain);
  EXPECT_EQ(canonical_config(plain, "again"), plain);
}

TEST(ConfigCanonical, QuotedWordsStayWords) {
  const std::string text = canonical_config("a: \"1\"\nb: 'true'\nc: \"x: y\"\n", "x");
  ConfigReader reader = ConfigReader::from_text(text, "again");
  EXPECT_EQ(reader.required_string("a"), "1");
  EXPECT_EQ(reader.required_string("b"), "true");
  EXPECT_EQ(reader.required_string("c"), "x: y");
}

TEST(ConfigCanonical, EveryShippedConfigSurvivesItsCanonicalForm) {
  for (const std::string& name : shipped_config_names()) {
    const std::string once = canonical_config(shipped_config(name), name);
    EXPECT_EQ(canonical_config(once, name), once) << name;
  }
}

TEST(NearestWord, IsTheOneWithTheFewestEdits) {
  const std::vector<std::string> known{"clearance_m", "window_m", "sectors"};
  EXPECT_EQ(nearest_word("clearence_m", known), "clearance_m");
  EXPECT_EQ(nearest_word("sector", known), "sectors");
  EXPECT_EQ(nearest_word("bank", known), std::nullopt);
}

}  // namespace
}  // namespace hedgehop
