#include "output/report_page.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "base/utc_time.hpp"
#include "briefing/announcement.hpp"
#include "geo/map_projection.hpp"
#include "output/png_image.hpp"
#include "output/report_charts.hpp"
#include "output/report_map.hpp"
#include "output/report_parts.hpp"
#include "output/report_text.hpp"

namespace hedgehop::output {
namespace {

using Json = nlohmann::ordered_json;
using flight::RouteCost;

constexpr std::size_t kViolationsShown = 40;
constexpr std::size_t kStretchesShown = 12;

std::string paragraph(const std::string& html, const char* classes = "") {
  return std::string("<p") + (*classes != '\0' ? std::string(" class=\"") + classes + "\"" : "") +
         ">" + html + "</p>\n";
}

/// A table in the making; cells are HTML.
class Table {
 public:
  explicit Table(const std::string& id, const std::string& caption = "") {
    html_ = "<div class=\"scroll\"><table id=\"" + id + "\">" +
            (caption.empty() ? "" : "<caption>" + caption + "</caption>") + "\n<thead><tr>";
  }
  /// Names of columns; those that begin with '<' hold text, which stands at the left.
  Table& head(const std::vector<std::string>& names) {
    for (const std::string& name : names) {
      const bool is_text = name.starts_with('<');
      html_ += is_text ? "<th class=\"text\">" + name.substr(1) + "</th>" : "<th>" + name + "</th>";
      is_text_.push_back(is_text);
    }
    html_ += "</tr></thead><tbody>\n";
    return *this;
  }
  Table& row(const std::vector<std::string>& cells, const std::string& attributes = "") {
    html_ += "<tr" + (attributes.empty() ? "" : " " + attributes) + ">";
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const bool is_text = i < is_text_.size() && is_text_[i];
      html_ += (!is_text               ? "<td>"
                : cells[i].size() > 40 ? "<td class=\"text wrap\">"
                                       : "<td class=\"text\">") +
               cells[i] + "</td>";
    }
    html_ += "</tr>\n";
    return *this;
  }
  [[nodiscard]] std::string finished() const { return html_ + "</tbody></table></div>\n"; }

 private:
  std::string html_;
  std::vector<bool> is_text_;
};

std::string jump(double time_s, double until_s = std::numeric_limits<double>::quiet_NaN(),
                 const char* classes = "") {
  std::string text =
      std::string("class=\"jump") + classes + "\" data-time=\"" + fixed_text(time_s, 2) + "\"";
  if (std::isfinite(until_s)) {
    text += " data-until=\"" + fixed_text(until_s, 2) + "\"";
  }
  return text;
}

class Page {
 public:
  explicit Page(const ReportContent& content)
      : c_(content), plan_(*content.plan), map_(*content.map), frame_(drawing_frame(content)) {
    if (!map_.crs_wkt.empty()) {
      projection_.emplace(map_.crs_wkt);
    }
  }

  std::string text() {
    samples_ = report_samples(c_);
    const std::string script(report_part("report.js"));
    std::string body = header() + cards() + navigation() + view() + announcements() + legs() +
                       why() + exposure() + verification() + alternatives() + sources() + footer();
    // 64 hexadecimal digits become 32 bytes.
    const std::string hex = sha256_hex(bytes_of(script));
    std::string digest;
    for (std::size_t i = 0; i + 1 < hex.size(); i += 2) {
      digest += static_cast<char>(std::stoi(hex.substr(i, 2), nullptr, 16));
    }
    return "<!DOCTYPE html>\n<html lang=\"en\" class=\"no-script\">\n<head>\n<meta "
           "charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width, "
           "initial-scale=1\">\n<meta http-equiv=\"Content-Security-Policy\" "
           "content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src "
           "'sha256-" +
           base64(digest) + "'\">\n<title>" + title() + "</title>\n<style>\n" +
           std::string(report_part("report.css")) + "</style>\n</head>\n<body>\n" + body +
           flight_data() + "<script>" + script + "</script>\n</body>\n</html>\n";
  }

 private:
  [[nodiscard]] std::string title() const {
    return "Contour flight, " + fixed_text(plan_.measures.length_m / 1000.0, 1) + " km" +
           (plan_.route_plan.map.label.empty() ? ""
                                               : ": " + html_escaped(plan_.route_plan.map.label));
  }

  [[nodiscard]] std::string eta(double time_s) const {
    if (!c_.start_time || !std::isfinite(time_s)) {
      return "";
    }
    return utc_text(*c_.start_time + time_s).substr(11, 8) + "Z";
  }
  [[nodiscard]] bool has_eta() const { return c_.start_time.has_value(); }

  [[nodiscard]] std::string magnetic(double azimuth_true_rad) const {
    return c_.declination_rad ? briefing::heading_text(briefing::magnetic_from_true_azimuth_rad(
                                    azimuth_true_rad, *c_.declination_rad))
                              : "not given";
  }

  [[nodiscard]] std::string place(const geo::MapPoint& point) const {
    if (!std::isfinite(point.x_m) || !std::isfinite(point.y_m)) {
      return "unknown";
    }
    if (projection_ && map_.geometry.contains(point)) {
      const geo::GeodeticPosition p = projection_->to_geodetic(point);
      return fixed_text(degrees_from_radians(p.latitude_rad), 5) + "," +
             fixed_text(degrees_from_radians(p.longitude_rad), 5);
    }
    return "x " + fixed_text(point.x_m, 0) + " y " + fixed_text(point.y_m, 0);
  }

  [[nodiscard]] std::string header() const {
    const flight::Verdict& verdict = c_.check.verdict;
    std::string html =
        "<header>\n<h1>Contour flight, " + fixed_text(plan_.measures.length_m / 1000.0, 1) + " km ";
    html += verdict.is_verified ? "<span class=\"verdict\">verified</span>"
                                : "<span class=\"verdict bad\">NOT VERIFIED</span>";
    html += "</h1>\n";
    if (!map_.label.empty()) {
      html += paragraph(html_escaped(map_.label), "label");
    }
    html += paragraph(
        "Plan " + plan_.route_plan.request_id.hex().substr(0, 12) + ", map " +
            map_.hash.hex().substr(0, 12) + ", seed " +
            std::to_string(plan_.route_plan.request.seed) +
            (has_eta() ? ". Take-off at " + utc_text(*c_.start_time).substr(0, 19) + "Z (UTC)"
                       : ". No start time is given, so there are no times of day") +
            ".",
        "soft");
    for (const std::string& warning : plan_.warnings) {
      html += paragraph("Warning: " + html_escaped(warning), "bad-text");
    }
    return html + "</header>\n";
  }

  [[nodiscard]] std::string cards() const {
    const flight::PathMeasures& m = plan_.measures;
    const flight::Verdict& v = c_.check.verdict;
    std::string html = "<ul class=\"cards\">";
    const auto card = [&](const std::string& value, const std::string& name) {
      html += "<li><b>" + value + "</b><span>" + name + "</span></li>";
    };
    card(fixed_text(m.length_m / 1000.0, 2) + " km", "flown");
    card(clock_text(m.duration_s), "minutes : seconds");
    if (has_eta()) {
      card(eta(m.duration_s), "arrival");
    }
    card(fixed_text(v.clearance_min_m, 1) + " m", "least clearance");
    card(fixed_text(m.mean_height_m, 1) + " m", "mean height above the surface");
    card(fixed_text(100.0 * m.share_under_ceiling, 1) + " %", "of the way under the ceiling");
    card(fixed_text(m.length_m > 0.0 ? 100.0 * m.visibility_m / m.length_m
                                     : std::numeric_limits<double>::quiet_NaN(),
                    1) +
             " %",
         "of the surroundings see it, on average");
    card(fixed_text(degrees_from_radians(v.bank_max_rad), 1) + "°", "greatest bank");
    const auto wires = std::count_if(
        c_.manoeuvres.begin(), c_.manoeuvres.end(), [](const briefing::Manoeuvre& manoeuvre) {
          return manoeuvre.kind == briefing::ManoeuvreKind::kWireCrossing;
        });
    card(std::to_string(wires), "wire crossings");
    return html + "</ul>\n";
  }

  [[nodiscard]] std::string navigation() const {
    std::string html = "<nav>";
    for (const auto& [id, name] : {std::pair("profile", "map and profile"),
                                   {"announcements", "manoeuvres"},
                                   {"legs", "legs"},
                                   {"why", "why here"},
                                   {"exposure", "exposure"},
                                   {"verification", "verification"},
                                   {"alternatives", "alternatives"},
                                   {"sources", "inputs"}}) {
      html += std::string("<a href=\"#") + id + "\">" + name + "</a>";
    }
    return html + "</nav>\n";
  }

  [[nodiscard]] std::string readout() const {
    std::string html =
        "<div class=\"readout needs-script\"><input type=\"range\" id=\"slider\" min=\"0\" "
        "max=\"0\" value=\"0\" aria-label=\"place along the flight\"><dl>";
    const auto field = [&](const char* id, const char* name) {
      html += std::string("<div><dt>") + name + "</dt><dd data-field=\"" + id + "\"></dd></div>";
    };
    field("time", "time");
    if (has_eta()) {
      field("eta", "UTC");
    }
    field("along", "flown");
    field("altitude", "altitude");
    field("height", "height");
    field("speed", "speed");
    field("climb", "climb");
    field("bank", "bank");
    field("true", "true heading");
    field("grid", "grid heading");
    if (c_.declination_rad) {
      field("magnetic", "magnetic");
    }
    field("cost", "cost per metre");
    if (projection_) {
      field("place", "place");
    }
    return html + "</dl></div>\n";
  }

  [[nodiscard]] std::string view() const {
    return "<section id=\"profile\"><h2>Map and profile</h2>\n<div class=\"view\">\n<div "
           "class=\"map-side\">" +
           report_map(c_, frame_) + "</div>\n<div>" + readout() + profile_charts(c_, samples_) +
           "</div>\n</div></section>\n";
  }

  [[nodiscard]] std::string announcements() const {
    std::string html = "<section id=\"announcements\"><h2>Manoeuvres, announced ahead</h2>\n";
    if (c_.manoeuvres.empty()) {
      return html + paragraph("Straight and level all the way.") + "</section>\n";
    }
    Table table("announcement-table", "When a pilot is told what, and when and where it begins.");
    std::vector<std::string> names = {"told at"};
    if (has_eta()) {
      names.emplace_back("UTC");
    }
    names.insert(names.end(), {"<what", "begins at", "after"});
    table.head(names);
    for (const briefing::Manoeuvre& m : c_.manoeuvres) {
      std::vector<std::string> cells = {clock_text(m.announced_time_s)};
      if (has_eta()) {
        cells.push_back(eta(m.announced_time_s));
      }
      cells.push_back(html_escaped(briefing::announcement_text(m, c_.declination_rad)));
      cells.push_back(clock_text(m.time_s));
      cells.push_back(fixed_text(m.along_m / 1000.0, 2) + " km");
      const bool is_warning =
          (m.kind == briefing::ManoeuvreKind::kWireCrossing && !(m.above_m >= 0.0));
      table.row(cells, jump(m.time_s, std::numeric_limits<double>::quiet_NaN(),
                            is_warning ? " warn" : ""));
    }
    return html + table.finished() + "</section>\n";
  }

  [[nodiscard]] std::string legs() const {
    Table table("leg-table",
                "The flown track as straight legs; courses and speeds are those over the ground. "
                "Magnetic: true less the declination that was given with --declination-deg.");
    std::vector<std::string> names = {"leg", "begins"};
    if (has_eta()) {
      names.emplace_back("UTC");
    }
    names.insert(names.end(), {"lasts", "length", "true", "grid", "magnetic", "speed", "altitude",
                               "height", "ends at"});
    table.head(names);
    for (std::size_t i = 0; i < c_.legs.size(); ++i) {
      const briefing::FlightLeg& leg = c_.legs[i];
      std::vector<std::string> cells = {std::to_string(i + 1), clock_text(leg.start_time_s)};
      if (has_eta()) {
        cells.push_back(eta(leg.start_time_s));
      }
      cells.insert(
          cells.end(),
          {clock_text(leg.duration_s), fixed_text(leg.length_m / 1000.0, 2) + " km",
           briefing::heading_text(leg.course_true_rad), briefing::heading_text(leg.course_grid_rad),
           magnetic(leg.course_true_rad), fixed_text(leg.speed_mps, 1) + " m/s",
           fixed_text(leg.altitude_from_m, 0) + " to " + fixed_text(leg.altitude_to_m, 0) + " m",
           fixed_text(leg.height_min_m, 0) + " to " + fixed_text(leg.height_max_m, 0) + " m",
           place(plan_.trajectory.states[leg.last].point())});
      table.row(cells, jump(leg.start_time_s, leg.start_time_s + leg.duration_s));
    }
    if (!c_.legs.empty()) {
      const auto& end = plan_.trajectory.states.back();
      std::vector<std::string> cells = {"goal", clock_text(end.time_s)};
      if (has_eta()) {
        cells.push_back(eta(end.time_s));
      }
      table.row(cells, jump(end.time_s));
    }
    return "<section id=\"legs\"><h2>Legs</h2>\n" +
           (c_.declination_rad
                ? paragraph("Magnetic declination " +
                                fixed_text(degrees_from_radians(*c_.declination_rad), 1) +
                                "°, east positive, as it was given.",
                            "soft")
                : paragraph("No magnetic declination is given (--declination-deg), so there are "
                            "no magnetic headings.",
                            "soft")) +
           table.finished() + times() + "</section>\n";
  }

  [[nodiscard]] std::string times() const {
    if (!plan_.timetable) {
      return "";
    }
    const flight::Timetable& timetable = *plan_.timetable;
    const Time departure = timetable.entries.front().expected;
    Table table("time-table",
                "Wanted times may be missed by " + fixed_text(timetable.tolerance_s, 1) + " s.");
    table.head({"place", "wanted (UTC)", "expected (UTC)", "late by"});
    for (const flight::Timetable::Entry& entry : timetable.entries) {
      const bool is_goal = entry.place + 1 == timetable.entries.size();
      const double at_s = seconds_between(departure, entry.expected);
      table.row({entry.place == 0 ? "start"
                 : is_goal        ? "goal"
                                  : "via point " + std::to_string(entry.place),
                 entry.wanted ? utc_text(*entry.wanted).substr(0, 19) : "",
                 utc_text(entry.expected).substr(0, 19),
                 entry.wanted ? fixed_text(seconds_between(*entry.wanted, entry.expected), 1) + " s"
                              : ""},
                jump(at_s));
    }
    return "<h3>Times</h3>\n" + table.finished();
  }

  /// "+2.1 (seen more)": how a side differs from here and by what most.
  static std::string difference(const RouteCost& side, const RouteCost& here) {
    const double total = side.total_m() - here.total_m();
    if (!std::isfinite(total)) {
      return "outside";
    }
    const auto more = [&](const flight::CostTerm& term) {
      return side.*term.value_m - here.*term.value_m;
    };
    const auto& greatest = *std::max_element(
        flight::kCostTerms.begin() + 1, flight::kCostTerms.end(),
        [&](const auto& a, const auto& b) { return std::fabs(more(a)) < std::fabs(more(b)); });
    std::string text = (total >= 0.0 ? "+" : "") + fixed_text(total, 2);
    if (std::fabs(more(greatest)) >= 0.05) {
      const bool is_seen = greatest.value_m == &RouteCost::visibility_m;
      text += std::string(" (") +
              (!is_seen               ? greatest.words
               : more(greatest) > 0.0 ? "seen more"
                                      : "seen less") +
              ")";
    }
    return text;
  }

  /// Terms that the route or the flight has; those of eq. (1) always.
  [[nodiscard]] std::vector<flight::CostTerm> shown_terms() const {
    std::vector<flight::CostTerm> shown;
    const RouteCost flown = c_.costs.total();
    for (std::size_t i = 0; i < flight::kCostTerms.size(); ++i) {
      const flight::CostTerm& term = flight::kCostTerms[i];
      if (i < flight::kPaperCostTerms || flown.*term.value_m > 0.0 ||
          plan_.route_plan.route.cost.*term.value_m > 0.0) {
        shown.push_back(term);
      }
    }
    return shown;
  }

  static std::vector<std::string> texts_of(const std::vector<flight::CostTerm>& terms,
                                           const RouteCost& cost, int decimals) {
    std::vector<std::string> texts = {fixed_text(cost.total_m(), decimals)};
    for (const flight::CostTerm& term : terms) {
      texts.push_back(fixed_text(cost.*term.value_m, decimals));
    }
    return texts;
  }

  [[nodiscard]] std::string why() const {
    std::string html = "<section id=\"why\"><h2>Why here</h2>\n";
    html += paragraph(
        "A metre of path costs 1, and more where it is seen, over land use to be avoided, away "
        "from the reference height and for what else the configuration weighs. The line shows what "
        "a metre costs " +
        fixed_text(c_.beside_m, 0) +
        " m to the left and right at the same height: where it lies above the stack, the flight "
        "avoids something.");
    html += cost_chart(c_);
    Table table("why-table", "Mean cost of a metre on each leg, and how it differs beside it.");
    const std::string beside = fixed_text(c_.beside_m, 0) + " m ";
    const std::vector<flight::CostTerm> terms = shown_terms();
    std::vector<std::string> head = {"leg", "here"};
    for (const flight::CostTerm& term : terms) {
      head.emplace_back(term.words);
    }
    head.insert(head.end(), {"<" + beside + "left", "<" + beside + "right"});
    table.head(head);
    for (std::size_t i = 0; i < c_.legs.size(); ++i) {
      const briefing::FlightLeg& leg = c_.legs[i];
      const double from_m = leg.start_along_m;
      const double to_m = i + 1 < c_.legs.size() ? c_.legs[i + 1].start_along_m
                                                 : std::numeric_limits<double>::infinity();
      const auto mean = [&](RouteCost briefing::CostPlace::*side) {
        return briefing::mean_cost(c_.costs, from_m, to_m, side);
      };
      const RouteCost here = mean(&briefing::CostPlace::here);
      std::vector<std::string> row = texts_of(terms, here, 2);
      row.insert(row.begin(), std::to_string(i + 1));
      row.insert(row.end(), {difference(mean(&briefing::CostPlace::left), here),
                             difference(mean(&briefing::CostPlace::right), here)});
      table.row(row, jump(leg.start_time_s, leg.start_time_s + leg.duration_s));
    }
    html += table.finished();
    Table sums("cost-table",
               "The same cost summed over whole paths [m]. The straight line, " +
                   fixed_text(c_.straight_height_m, 1) +
                   " m above the surface all the way, is there to compare with: no helicopter "
                   "could fly it.");
    head.assign({"<path", "total"});
    for (const flight::CostTerm& term : terms) {
      head.emplace_back(term.words);
    }
    sums.head(head);
    const auto sum = [&](const std::string& name, const RouteCost& cost) {
      std::vector<std::string> row = texts_of(terms, cost, 0);
      row.insert(row.begin(), name);
      sums.row(row);
    };
    sum("planned route", plan_.route_plan.route.cost);
    sum("flown trajectory", c_.costs.total());
    sum("straight line", c_.straight);
    html += sums.finished();
    const double bound_m = plan_.route_plan.route.lower_bound_m;
    if (bound_m > 0.0) {
      html += paragraph("No route can cost less than " + fixed_text(bound_m, 0) +
                            " m; the planned one costs " +
                            fixed_text(plan_.route_plan.route.cost.total_m(), 0) + " m.",
                        "soft");
    }
    return html + "</section>\n";
  }

  [[nodiscard]] std::string exposure() const {
    std::string html = "<section id=\"exposure\"><h2>Exposure</h2>\n";
    if (c_.exposures.empty()) {
      return html +
             paragraph(
                 "The map names no observers (hedgehop prepare --observers FILE). Seen by " +
                 fixed_text(plan_.measures.length_m > 0.0
                                ? 100.0 * plan_.measures.visibility_m / plan_.measures.length_m
                                : std::numeric_limits<double>::quiet_NaN(),
                            1) +
                 " % of the surroundings on average.") +
             "</section>\n";
    }
    Table table("exposure-table",
                "How long each named observer of the map has the flight in sight. Out of its "
                "range, or over unknown ground, it sees nothing.");
    table.head({"<observer", "in sight", "of the way", "first",
                "<stretches (from to, minutes : "
                "seconds)"});
    for (const briefing::Exposure& exposure : c_.exposures) {
      std::string stretches;
      for (std::size_t i = 0; i < std::min(exposure.stretches.size(), kStretchesShown); ++i) {
        stretches += (i > 0 ? ", " : "") + clock_text(exposure.stretches[i].from_s) + " to " +
                     clock_text(exposure.stretches[i].to_s);
      }
      if (exposure.stretches.size() > kStretchesShown) {
        stretches +=
            ", and " + std::to_string(exposure.stretches.size() - kStretchesShown) + " more";
      }
      const bool is_seen = !exposure.stretches.empty();
      table.row({html_escaped(exposure.name), fixed_text(exposure.seen_s, 1) + " s",
                 fixed_text(100.0 * exposure.share, 1) + " %",
                 is_seen ? clock_text(exposure.stretches.front().from_s) : "never", stretches},
                is_seen ? jump(exposure.stretches.front().from_s) : "");
    }
    return html + table.finished() + "</section>\n";
  }

  [[nodiscard]] std::string verification() const {
    const flight::Verdict& v = c_.check.verdict;
    const verification::Margins& m = c_.check.margins;
    std::string html = "<section id=\"verification\"><h2>Verification</h2>\n";
    html += v.is_verified ? paragraph(
                                "<b>Verified</b> anew for this report, by code that shares nothing "
                                "with the planners: no violation.")
                          : paragraph("<b>NOT VERIFIED</b>: " + std::to_string(v.violation_count) +
                                          " violations.",
                                      "bad-text");
    if (!v.violations.empty()) {
      Table table("violation-table");
      table.head({"<rule", "at", "found", "limit", "<place"});
      for (std::size_t i = 0; i < std::min(v.violations.size(), kViolationsShown); ++i) {
        const flight::Violation& violation = v.violations[i];
        const std::string unit(verification::unit_of(violation.rule));
        table.row({html_escaped(violation.rule), clock_text(violation.time_s),
                   fixed_text(violation.value, 3) + " " + unit,
                   fixed_text(violation.limit, 3) + " " + unit, place(violation.place)},
                  std::isfinite(violation.time_s) ? jump(violation.time_s) : "");
      }
      html += table.finished();
      if (v.violations.size() > kViolationsShown) {
        html += paragraph("hedgehop verify tells all of them.", "soft");
      }
    }
    Table nearest("nearest-table",
                  "Nearest misses: where the flight comes nearest to each kind of "
                  "hazard.");
    nearest.head({"<hazard", "distance", "demanded", "to spare", "at", "<place"});
    for (const verification::NearMiss& miss : m.nearest) {
      const std::string name = miss.name.empty() ? "" : " " + html_escaped(miss.name);
      nearest.row({verification::name_of(miss.hazard) + name, fixed_text(miss.distance_m, 1) + " m",
                   fixed_text(miss.required_m, 1) + " m", fixed_text(miss.spare_m(), 1) + " m",
                   clock_text(miss.time_s), place(miss.place)},
                  std::string(std::isfinite(miss.time_s) ? jump(miss.time_s) : ""));
    }
    html += nearest.finished();
    Table margins("margin-table");
    margins.head({"<margin", "value", "limit"});
    const auto row = [&](const char* name, const std::string& value, const std::string& limit) {
      margins.row({name, value, limit});
    };
    const PlanDemands demands = demands_of(plan_.route_plan.config_text);
    const auto limit = [](const std::optional<double>& value, int decimals, const char* unit) {
      return value ? fixed_text(*value, decimals) + unit : std::string();
    };
    row("least clearance", fixed_text(m.clearance_min_m, 1) + " m",
        limit(demands.required_clearance_m, 1, " m"));
    row("clearance at 1 % of the way", fixed_text(m.clearance_p01_m, 1) + " m", "");
    row("clearance at half of the way", fixed_text(m.clearance_median_m, 1) + " m", "");
    row("greatest height", fixed_text(m.height_max_m, 1) + " m",
        limit(demands.ceiling_height_m, 1, " m"));
    row("load factor", fixed_text(m.load_factor_max, 2), fixed_text(m.load_factor_limit, 2));
    row("bank", fixed_text(degrees_from_radians(v.bank_max_rad), 1) + "°",
        demands.bank_max_rad ? fixed_text(degrees_from_radians(*demands.bank_max_rad), 1) + "°"
                             : "");
    row("climb rate", fixed_text(v.climb_rate_max_mps, 1) + " m/s", "");
    row("descent rate", fixed_text(v.descent_rate_max_mps, 1) + " m/s", "");
    for (std::size_t i = 0; i < m.via.size(); ++i) {
      row(("via point " + std::to_string(i + 1)).c_str(),
          fixed_text(m.via[i].distance_m, 0) + " m off", "");
    }
    return html + margins.finished() + "</section>\n";
  }

  /// Routes that were planned together with the one of this plan.
  [[nodiscard]] std::string choices() const {
    if (c_.choices.empty()) {
      return "";
    }
    Table table("choice-table",
                "Routes to choose from. Seen: integral of the square of the visibility along the "
                "route; land use: integral of its cost. No weights, so that rows can be compared.");
    table.head({"<", "<route", "length", "seen", "land use", "runs with others", "flown in",
                "least clearance", "<verdict"});
    for (std::size_t i = 0; i < c_.choices.size(); ++i) {
      const ReportChoice& choice = c_.choices[i];
      const ListedRoute& route = choice.route;
      const flight::Plan* flown = i == 0 ? &plan_ : choice.flown;
      const bool is_verified =
          i == 0 ? c_.check.verdict.is_verified : flown != nullptr && flown->verdict.is_verified;
      table.row({key_line(i == 0 ? "#58a618" : choice_color(i), ""),
                 html_escaped(route.name) + (i == 0 ? " (this plan)" : ""),
                 fixed_text(route.measures.length_m / 1000.0, 2) + " km",
                 fixed_text(route.measures.visibility_m, 0) + " m",
                 fixed_text(route.measures.semantics_m, 0) + " m",
                 fixed_text(100.0 * route.shared_share, 0) + " %",
                 flown != nullptr ? clock_text(flown->measures.duration_s) : "not flown",
                 flown != nullptr ? fixed_text(flown->verdict.clearance_min_m, 1) + " m" : "",
                 flown == nullptr ? ""
                 : is_verified    ? "verified"
                                  : "not verified"});
    }
    return table.finished() +
           (c_.why_no_more_choices.empty()
                ? ""
                : paragraph("Why there are no more: " + html_escaped(c_.why_no_more_choices) + ".",
                            "soft"));
  }

  [[nodiscard]] std::string alternatives() const {
    std::string html = "<section id=\"alternatives\"><h2>Alternatives</h2>\n" + choices();
    if (c_.alternatives.empty()) {
      return html +
             (c_.choices.empty()
                  ? paragraph(
                        "None was given. hedgehop plan --alternatives plans further routes to "
                        "choose from, hedgehop report --compare OTHER_PLAN shows other plans "
                        "on the same map beside this one.",
                        "soft")
                  : "") +
             "</section>\n";
    }
    Table table("alternative-table", "Costs under the configuration of this plan.");
    table.head({"<plan", "length", "time", "cost flown", "visibility", "land use", "mean height",
                "least clearance", "<verdict"});
    const auto row = [&](const std::string& name, const flight::Plan& plan, const RouteCost& cost,
                         const flight::Verdict& verdict) {
      table.row({name, fixed_text(plan.measures.length_m / 1000.0, 2) + " km",
                 clock_text(plan.measures.duration_s), fixed_text(cost.total_m(), 0) + " m",
                 fixed_text(cost.visibility_m, 0) + " m", fixed_text(cost.semantics_m, 0) + " m",
                 fixed_text(plan.measures.mean_height_m, 1) + " m",
                 fixed_text(verdict.clearance_min_m, 1) + " m",
                 verdict.is_verified ? "verified" : "not verified"});
    };
    row("this plan", plan_, c_.costs.total(), c_.check.verdict);
    for (const ReportAlternative& alternative : c_.alternatives) {
      row(html_escaped(alternative.name), *alternative.plan, alternative.flown,
          alternative.plan->verdict);
    }
    return html + table.finished() + "</section>\n";
  }

  /// A value of the manifest, which may be anything.
  static std::string value_text(const Json& json, const char* key) {
    const auto found = json.find(key);
    if (found == json.end() || found->is_null()) {
      return "";
    }
    return html_escaped(found->is_string()
                            ? found->get<std::string>()
                            : found->dump(-1, ' ', false, Json::error_handler_t::replace));
  }

  [[nodiscard]] std::string sources() const {
    std::string html = "<section id=\"sources\"><h2>Inputs and attributions</h2>\n";
    for (const std::string& line : map_.attributions) {
      html += paragraph(html_escaped(line));
    }
    const Json manifest = Json::parse(c_.map_manifest_json, nullptr, false);
    if (manifest.is_object() && manifest.contains("inputs") && manifest["inputs"].is_array()) {
      Table table("input-table", "Files that the map was made from, as its manifest states them.");
      table.head({"<file", "<kind", "bytes", "<datum", "<SHA-256"});
      for (const Json& input : manifest["inputs"]) {
        if (input.is_object()) {
          table.row({value_text(input, "name"), value_text(input, "kind"),
                     value_text(input, "bytes"), value_text(input, "vertical_datum"),
                     value_text(input, "sha256")});
        }
      }
      html += table.finished();
    }
    Table table("map-table");
    table.head({"<map", "<"});
    table.row({"hash", map_.hash.hex()})
        .row({"cells", std::to_string(map_.geometry.columns) + " x " +
                           std::to_string(map_.geometry.rows) + " of " +
                           fixed_text(map_.geometry.cell_m, 1) + " m"})
        .row({"vertical datum", html_escaped(map_.vertical_datum)});
    if (manifest.is_object()) {
      table.row({"coordinate system", value_text(manifest, "crs_code")})
          .row({"made by",
                value_text(manifest, "tool") + " " + value_text(manifest, "tool_version")});
    }
    html += table.finished();
    const flight::PlanRequest& request = plan_.route_plan.request;
    Table plan("plan-table");
    plan.head({"<plan", "<"});
    plan.row({"request", plan_.route_plan.request_id.hex()})
        .row({"start", place(plan_.route_plan.start.point())})
        .row({"goal", place(plan_.route_plan.goal.point())})
        .row({"via points", std::to_string(request.via.size())})
        .row({"seed", std::to_string(request.seed)})
        .row({"work", std::to_string(plan_.route_plan.route.work_units) + " units"});
    return html + plan.finished() + "<details><summary>Effective configuration</summary><pre>" +
           html_escaped(plan_.route_plan.config_text) + "</pre></details></section>\n";
  }

  [[nodiscard]] std::string footer() const {
    std::string html = "<footer>";
    for (const std::string& line : map_.attributions) {
      html += paragraph(html_escaped(line));
    }
    return html +
           paragraph(
               "Made by hedgehop, a planning tool for research. Nothing here is certified "
               "for flight; elevation and map data have errors and holes, and wires are "
               "missing from both. Headings are azimuths, clockwise; altitudes are above "
               "mean sea level, heights above the surface with its trees and buildings.") +
           "</footer>\n";
  }

  [[nodiscard]] std::string flight_data() const {
    const auto list = [](const std::vector<double>& values, double per_one) {
      Json json = Json::array();
      for (const double value : values) {
        json.push_back(std::isfinite(value) ? Json(std::round(value * per_one) / per_one) : Json());
      }
      return json;
    };
    std::vector<double> x;
    std::vector<double> y;
    std::vector<double> latitude_deg;
    std::vector<double> longitude_deg;
    for (const std::size_t i : samples_.states) {
      const geo::MapPoint point = plan_.trajectory.states[i].point();
      x.push_back(frame_.x(point.x_m));
      y.push_back(frame_.y(point.y_m));
      if (projection_) {
        const geo::GeodeticPosition p = projection_->to_geodetic(point);
        latitude_deg.push_back(degrees_from_radians(p.latitude_rad));
        longitude_deg.push_back(degrees_from_radians(p.longitude_rad));
      }
    }
    Json json = {{"along_m", list(samples_.along_m, 10.0)},
                 {"time_s", list(samples_.time_s, 100.0)},
                 {"x", list(x, 100.0)},
                 {"y", list(y, 100.0)},
                 {"altitude_m", list(samples_.altitude_m, 10.0)},
                 {"height_m", list(samples_.height_m, 10.0)},
                 {"speed_mps", list(samples_.speed_mps, 10.0)},
                 {"climb_mps", list(samples_.climb_mps, 10.0)},
                 {"bank_deg", list(samples_.bank_deg, 10.0)},
                 {"heading_deg", list(samples_.heading_deg, 10.0)},
                 {"grid_deg", list(samples_.grid_deg, 10.0)},
                 {"cost", list(samples_.cost, 100.0)}};
    if (projection_) {
      json["latitude_deg"] = list(latitude_deg, 1e6);
      json["longitude_deg"] = list(longitude_deg, 1e6);
    }
    if (c_.start_time) {
      json["start_ms"] = c_.start_time->utime_us / 1000;
    }
    if (c_.declination_rad) {
      json["declination_deg"] = degrees_from_radians(*c_.declination_rad);
    }
    // Numbers only, so that nothing in it can end the element.
    return "<script type=\"application/json\" id=\"flight\">" + json.dump() + "</script>\n";
  }

  const ReportContent& c_;
  const flight::Plan& plan_;
  const map::Map& map_;
  DrawingFrame frame_;
  ReportSamples samples_;
  std::optional<geo::MapProjection> projection_;
};

}  // namespace

std::string fixed_text(double value, int decimals) {
  if (!std::isfinite(value)) {
    return "unknown";
  }
  std::array<char, 400> buffer{};
  std::snprintf(buffer.data(), buffer.size(), "%.*f", decimals, value);
  const std::string text = buffer.data();
  return text.starts_with('-') && text.find_first_of("123456789") == std::string::npos
             ? text.substr(1)
             : text;
}

std::string clock_text(double seconds) {
  if (!std::isfinite(seconds) || std::fabs(seconds) > 1e9) {
    return "unknown";
  }
  const long whole = std::lround(seconds);
  std::array<char, 40> buffer{};
  std::snprintf(buffer.data(), buffer.size(), "%s%02ld:%02ld", whole < 0 ? "-" : "",
                std::labs(whole) / 60, std::labs(whole) % 60);
  return buffer.data();
}

std::string key_box(const std::string& color, std::string_view name) {
  return "<span><i style=\"background:" + color + "\"></i>" + html_escaped(name) + "</span>";
}

std::string key_line(const std::string& color, std::string_view name, bool is_dashed) {
  return std::string("<span><i class=\"stroke") + (is_dashed ? " dashed" : "") +
         "\" style=\"border-color:" + color + "\"></i>" + html_escaped(name) + "</span>";
}

std::string html_escaped(std::string_view text) {
  std::string escaped;
  for (std::size_t i = 0; i < text.size();) {
    const auto byte = static_cast<unsigned char>(text[i]);
    std::size_t length = byte < 0x80                   ? 1
                         : byte >= 0xc2 && byte < 0xe0 ? 2
                         : byte >= 0xe0 && byte < 0xf0 ? 3
                         : byte >= 0xf0 && byte < 0xf5 ? 4
                                                       : 0;
    bool is_valid = length > 0 && i + length <= text.size();
    for (std::size_t k = 1; is_valid && k < length; ++k) {
      is_valid = (static_cast<unsigned char>(text[i + k]) & 0xc0U) == 0x80;
    }
    if (!is_valid) {
      escaped += "\xef\xbf\xbd";  // replacement character
      length = 1;
    } else if (byte == '&') {
      escaped += "&amp;";
    } else if (byte == '<') {
      escaped += "&lt;";
    } else if (byte == '>') {
      escaped += "&gt;";
    } else if (byte == '"') {
      escaped += "&quot;";
    } else if (byte == '\'') {
      escaped += "&#39;";
    } else if ((byte < 0x20 && byte != '\n') || byte == 0x7f) {
      escaped += ' ';
    } else {
      escaped += text.substr(i, length);
    }
    i += length;
  }
  return escaped;
}

std::string report_page(const ReportContent& content) {
  if (content.plan->trajectory.states.size() < 2 ||
      content.plan->route_plan.route.waypoints.size() < 2) {
    throw DataError("report: the plan has no path to show", "plan again");
  }
  return Page(content).text();
}

}  // namespace hedgehop::output
