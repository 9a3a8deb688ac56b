#include "map_sources/height_text.hpp"

#include <gtest/gtest.h>
#include <string>

namespace hedgehop::map_sources {
namespace {

TEST(HeightText, ReadsTheWaysPeopleWriteHeights) {
  struct Case {
    const char* text;
    double height_m;
  };
  // Feet and inches by hand: 1 ft = 0.3048 m, 1 in = 0.0254 m.
  for (const Case& c : {Case{"12", 12.0},          {"12.5 m", 12.5},
                        {"12,5m", 12.5},           {"  7  ", 7.0},
                        {"9 Meter", 9.0},          {"40'", 12.192},
                        {"40 ft", 12.192},         {"40 FEET", 12.192},
                        {"40ft.", 12.192},         {"12'6\"", 3.81},
                        {"12' 6\"", 3.81},         {"12 ft 6 in", 3.81},
                        {"12ft6in", 3.81},         {"12\u20326\u2033", 3.81},
                        {"12\u20196\u201d", 3.81}, {"5'6.5''", 1.6891},
                        {"3 m - 5 m", 5.0},        {"3 \u2013 5 m", 5.0},
                        {"8;10;9", 10.0},          {"8/10", 10.0},
                        {"30-40 ft", 12.192},      {"40-30 ft", 12.192},
                        {"10 m; 20 ft", 10.0},     {"30-30'6\"", 9.2964},
                        {"1,250.5 ft", 381.1524},  {"1,250 ft", 381.0},
                        {"12,25", 12.25},          {"12\u00a0m", 12.0}}) {
    const auto height_m = height_in_text_m(c.text);
    ASSERT_TRUE(height_m.has_value()) << c.text;
    EXPECT_NEAR(*height_m, c.height_m, 1e-9) << c.text;
  }
}

TEST(HeightText, RefusesWhatIsNoHeight) {
  for (const char* text :
       {"",        " ",      "low",      "-3",       "0",    "0 m", "1e3",    "12 apples",
        "1001",    "nan",    "inf",      "m",        "5-",   "~4",  "3'14\"", "12 m high",
        "3''",     "12\"",   "1.2.3",    "1,2,3",    ".5",   ",5",  "5..6",   "-",
        ";",       "3;;4",   "4 m;high", "12,125 m", "0x12", "+5",  "12 km",  "3500 ft",
        "5'-6\"x", "\u2032", "12'\"",    "1,25,000", "٣"}) {
    EXPECT_FALSE(height_in_text_m(text)) << text;
  }
  EXPECT_FALSE(height_in_text_m(std::string(1000, '1')));
  EXPECT_FALSE(height_in_text_m(std::string(150, '9')));
}

TEST(HeightText, ABareNumberHasTheUnitOfItsColumn) {
  EXPECT_NEAR(*height_in_text_m("100", 0.3048), 30.48, 1e-9);
  EXPECT_NEAR(*height_in_text_m("100 m", 0.3048), 100.0, 1e-9);
  EXPECT_NEAR(*height_in_text_m("90;100", 0.3048), 30.48, 1e-9);
  EXPECT_NEAR(*height_in_text_m("2000", 0.3048), 609.6, 1e-9);
}

TEST(LevelsText, TakesTheGreatestOfAList) {
  EXPECT_EQ(levels_in_text("4"), 4.0);
  EXPECT_EQ(levels_in_text("2.5"), 2.5);
  EXPECT_EQ(levels_in_text("2,5"), 2.5);
  EXPECT_EQ(levels_in_text("2;4;3"), 4.0);
  EXPECT_EQ(levels_in_text("2-3"), 3.0);
  for (const char* text : {"", "0", "-1", "four", "4 m", "201", "1;x", "3'"}) {
    EXPECT_FALSE(levels_in_text(text)) << text;
  }
}

}  // namespace
}  // namespace hedgehop::map_sources
