#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <string>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "base/utc_time.hpp"
#include "output/png_image.hpp"
#include "output/report_page.hpp"
#include "output/report_text.hpp"
#include "sample_choices.hpp"
#include "sample_plan.hpp"

namespace hedgehop::output {
namespace {

using testing::HasSubstr;
using testing::Not;

constexpr char kHostile[] = "<script>alert('x')</script>\"&\x01\xff";
constexpr char kTamed[] = "&lt;script&gt;alert(&#39;x&#39;)&lt;/script&gt;&quot;&amp; \xef\xbf\xbd";

int count_of(const std::string& text, const std::string& part) {
  int count = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) {
    ++count;
  }
  return count;
}

/// A page of a plan of which every text from outside is hostile, and one without options.
class Report : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    map_ = test::make_sample_map();
    map_.label = kHostile;
    map_.attributions = {std::string("attribution ") + kHostile};
    map::Area area;
    area.name = kHostile;
    area.polygons.push_back(
        {{{702000, 5531000}, {703000, 5531000}, {703000, 5533000}, {702000, 5531000}}, {}});
    map_.areas.push_back(area);
    test::finish_map(map_);
    plan_ = test::make_sample_plan(map_);
    plan_.route_plan.map.label = map_.label;
    plan_.warnings = {kHostile};
    plan_.route_plan.config_text = std::string("# ") + kHostile;

    ReportContent content;
    content.plan = &plan_;
    content.map = &map_;
    nlohmann::ordered_json manifest;
    manifest["inputs"] = nlohmann::ordered_json::array();
    manifest["inputs"].push_back(
        {{"name", "<b>dem</b>.tif"}, {"kind", "elevation"}, {"bytes", 12345}, {"sha256", "00ff"}});
    manifest["inputs"].push_back("not an object");
    content.map_manifest_json = manifest.dump();
    content.check.verdict = plan_.verdict;
    content.check.verdict.violations[0].rule = kHostile;
    content.check.margins.nearest.push_back({verification::Hazard::kObstacle, kHostile, 31.5, 10.0,
                                             12.0, plan_.trajectory.states[240].point(), 500.0});
    content.legs = briefing::flight_legs(plan_.trajectory, {}, {100.0});
    briefing::Manoeuvre wire;
    wire.kind = briefing::ManoeuvreKind::kWireCrossing;
    wire.name = kHostile;
    wire.time_s = 80.0;
    wire.announced_time_s = 60.0;
    wire.announced_distance_m = 800.0;
    wire.above_m = -1.0;
    content.manoeuvres = {wire};
    content.straight = {1.0, 2.0, 3.0, 4.0};
    content.threats.push_back({kHostile, raster::Grid<float>(map_.geometry, 0.0F)});
    content.exposures = briefing::exposures(content.threats, plan_.trajectory);
    content.start_time = parse_utc("2026-05-01T06:30:00Z");
    content.declination_rad = radians_from_degrees(4.0);
    content.alternatives.push_back({kHostile, &plan_, {10.0, 20.0, 30.0, 40.0}});
    const flight::RouteChoices choices = test::make_sample_choices(plan_);
    for (const flight::RouteChoice& choice : choices.routes) {
      content.choices.push_back(
          {{choice.name, choice.measures, 1.0, 0.4375, true, choice.plan.route.waypoints},
           choice.name == "hidden" ? &plan_ : nullptr});
    }
    content.why_no_more_choices = kHostile;
    page_ = report_page(content);
    content_ = std::move(content);
  }
  static void TearDownTestSuite() { content_ = {}; }

  /// The same without anything that may be left out.
  static std::string plain_page() {
    ReportContent content = content_;
    content.start_time.reset();
    content.declination_rad.reset();
    content.alternatives.clear();
    content.choices.clear();
    content.threats.clear();
    content.exposures.clear();
    content.manoeuvres.clear();
    content.map_manifest_json = "no JSON at all";
    return report_page(content);
  }

  inline static map::Map map_;
  inline static flight::Plan plan_;
  inline static ReportContent content_;
  inline static std::string page_;
};

TEST_F(Report, TextFromFilesIsNeverMarkup) {
  EXPECT_EQ(html_escaped(kHostile), kTamed);
  // The page's own data and script, nothing else.
  EXPECT_EQ(count_of(page_, "<script"), 2);
  EXPECT_THAT(page_, Not(HasSubstr("alert('x')")));
  EXPECT_THAT(page_, Not(HasSubstr("<b>dem")));
  EXPECT_THAT(page_, HasSubstr("&lt;b&gt;dem&lt;/b&gt;.tif"));
  // Label (in title and page), attribution twice, area, warning, config, rule, obstacle, wire,
  // layer and table of the observer, drawing and table of the alternative.
  EXPECT_GE(count_of(page_, "&lt;script&gt;alert(&#39;x&#39;)&lt;/script&gt;"), 13);
}

TEST_F(Report, NeedsNothingFromOutside) {
  for (const char* word : {"http:", "https:", "url(", "@import", "<link", "src=", "//cdn"}) {
    EXPECT_EQ(count_of(page_, word), 0) << word;
  }
  EXPECT_THAT(page_, HasSubstr("default-src 'none'"));
  // Hillshade, surface, visibility, land use, one observer.
  EXPECT_EQ(count_of(page_, "href=\"data:image/png;base64,iVBORw0KGgo"), 5);
}

TEST_F(Report, IsTheSameForTheSamePlan) { EXPECT_EQ(page_, report_page(content_)); }

TEST_F(Report, EveryLayerHasItsSwitchAndEveryLinkItsTarget) {
  const auto names_after = [&](const std::string& head) {
    std::vector<std::string> names;
    for (std::size_t at = page_.find(head); at != std::string::npos;
         at = page_.find(head, at + 1)) {
      const std::size_t from = at + head.size();
      names.push_back(page_.substr(from, page_.find('"', from) - from));
    }
    return names;
  };
  const auto layers = names_after("<label for=\"");
  EXPECT_EQ(layers.size(), 9U);
  for (const std::string& layer : layers) {
    EXPECT_EQ(count_of(page_, "<input type=\"checkbox\" id=\"" + layer + "\""), 1) << layer;
    EXPECT_EQ(count_of(page_, "<g class=\"" + layer + "\""), 1) << layer;
  }
  const auto links = names_after("href=\"#");
  EXPECT_EQ(links.size(), 8U);
  for (const std::string& link : links) {
    EXPECT_EQ(count_of(page_, " id=\"" + link + "\""), 1) << link;
  }
}

TEST_F(Report, TagsAreClosedInTheirOrder) {
  const std::size_t end = page_.find("<script type=\"application/json\"");
  std::vector<std::string> open;
  for (std::size_t at = page_.find("<body>"); at < end; at = page_.find('<', at + 1)) {
    const bool is_closing = page_[at + 1] == '/';
    const std::size_t name_at = at + (is_closing ? 2 : 1);
    const std::string name = page_.substr(
        name_at,
        page_.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789", name_at) - name_at);
    ASSERT_FALSE(name.empty()) << page_.substr(at, 60);
    if (is_closing) {
      ASSERT_FALSE(open.empty());
      ASSERT_EQ(open.back(), name);
      open.pop_back();
    } else if (page_[page_.find('>', at) - 1] != '/' && name != "input") {
      open.push_back(name);
    }
  }
  EXPECT_EQ(open, std::vector<std::string>{"body"});
}

TEST_F(Report, TimesOfDayFollowTheStartTime) {
  // 06:30:00 and 60 s.
  EXPECT_THAT(page_, HasSubstr("<td>06:31:00Z</td><td class=\"text wrap\">in 20 s, 800 m: cross "));
  EXPECT_THAT(page_, HasSubstr("1 m BELOW the wire"));
  const std::string plain = plain_page();
  EXPECT_THAT(plain, HasSubstr("No start time is given"));
  EXPECT_EQ(count_of(plain, ">UTC<"), 0);
}

TEST_F(Report, MagneticHeadingsNeedADeclination) {
  EXPECT_THAT(page_, HasSubstr("Magnetic declination 4.0°"));
  EXPECT_EQ(count_of(page_, "not given"), 0);
  const std::string plain = plain_page();
  EXPECT_THAT(plain, HasSubstr("No magnetic declination is given"));
  const auto legs = briefing::flight_legs(plan_.trajectory, {}, {100.0});
  EXPECT_EQ(count_of(plain, "<td>not given</td>"), static_cast<int>(legs.size()));
}

TEST_F(Report, TheScriptsDataAreThoseOfTheTrajectory) {
  const std::string head = "<script type=\"application/json\" id=\"flight\">";
  const std::size_t from = page_.find(head) + head.size();
  const auto data = nlohmann::json::parse(page_.substr(from, page_.find("</script>", from) - from));
  const auto& states = plan_.trajectory.states;
  const std::size_t count = data.at("time_s").size();
  ASSERT_GT(count, 1000U);
  ASSERT_LE(count, 3001U);
  for (const auto& [key, list] : data.items()) {
    if (list.is_array()) {
      EXPECT_EQ(list.size(), count) << key;
    }
  }
  EXPECT_NEAR(data["time_s"].back().get<double>(), states.back().time_s, 0.01);
  EXPECT_NEAR(data["altitude_m"].back().get<double>(), states.back().altitude_m, 0.051);
  EXPECT_NEAR(data["altitude_m"].front().get<double>(), states.front().altitude_m, 0.051);
  EXPECT_EQ(data["start_ms"].get<std::int64_t>(), 1777617000000);
  EXPECT_EQ(data["declination_deg"].get<double>(), 4.0);
}

TEST_F(Report, ViolationsAreShownAsSuch) {
  EXPECT_THAT(page_, HasSubstr("<span class=\"verdict bad\">NOT VERIFIED</span>"));
  EXPECT_THAT(page_, HasSubstr("<td>9.500 </td><td>10.000 </td>"));
}

TEST_F(Report, APlanWithoutAPathIsRefused) {
  flight::Plan empty = plan_;
  empty.trajectory.states.clear();
  ReportContent content;
  content.plan = &empty;
  content.map = &map_;
  EXPECT_THROW(report_page(content), DataError);
}

TEST(ReportText, NumbersAndTimesReadAsPeopleWriteThem) {
  EXPECT_EQ(fixed_text(-0.04, 1), "0.0");
  EXPECT_EQ(fixed_text(-1.25, 1), "-1.2");
  EXPECT_EQ(fixed_text(std::nan(""), 2), "unknown");
  EXPECT_EQ(clock_text(187.4), "03:07");
  EXPECT_EQ(clock_text(3725.0), "62:05");
  EXPECT_EQ(clock_text(-1.0), "-00:01");
  EXPECT_EQ(clock_text(INFINITY), "unknown");
}

TEST(PngImage, Base64IsThatOfItsStandard) {
  // Test vectors of RFC 4648, section 10.
  for (const auto& [plain, packed] :
       std::vector<std::pair<std::string, std::string>>{{"", ""},
                                                        {"f", "Zg=="},
                                                        {"fo", "Zm8="},
                                                        {"foo", "Zm9v"},
                                                        {"foob", "Zm9vYg=="},
                                                        {"fooba", "Zm9vYmE="},
                                                        {"foobar", "Zm9vYmFy"}}) {
    EXPECT_EQ(base64(plain), packed);
  }
  EXPECT_EQ(base64("\xff\xfe\xfd"), "//79");
}

TEST_F(Report, RoutesToChooseFromAreOnTheMapAndInATable) {
  const std::size_t table = page_.find("id=\"choice-table\"");
  ASSERT_NE(table, std::string::npos);
  const std::string rows = page_.substr(table, page_.find("</table>", table) - table);
  EXPECT_THAT(rows, HasSubstr("main (this plan)"));
  EXPECT_THAT(rows, HasSubstr(">13.00 km<"));
  EXPECT_THAT(rows, HasSubstr(">44 %<"));
  EXPECT_EQ(count_of(rows, ">not flown<"), 1) << "short-cut";
  EXPECT_EQ(count_of(page_, "<path class=\"choice\""), 2) << "all but the plan's own";
  EXPECT_THAT(page_, HasSubstr("layer-choices"));
  EXPECT_THAT(page_, HasSubstr(std::string("Why there are no more: ") + kTamed));
  const std::string plain = plain_page();
  EXPECT_THAT(plain, Not(HasSubstr("choice-table")));
  EXPECT_THAT(plain, Not(HasSubstr("layer-choices")));
  EXPECT_THAT(plain, HasSubstr("hedgehop plan --alternatives"));
}

}  // namespace
}  // namespace hedgehop::output
