#include "map_sources/open_air.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "geo/geodesic.hpp"
#include "map_sources/text_in_files.hpp"

namespace hedgehop::map_sources {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kAltitudeMax_m = 100'000.0;
constexpr double kRadiusMax_m = 1'000'000.0;
constexpr double kArcSagitta_m = 1.0;
constexpr std::size_t kCornersMax = 5'000'000;  // of one file

bool is_one_of(std::string_view text, std::initializer_list<std::string_view> words) {
  return std::find(words.begin(), words.end(), text) != words.end();
}

// Takes a plain decimal number without sign off the front.
std::optional<double> take_number(std::string_view& text) {
  if (text.empty() || !((text[0] >= '0' && text[0] <= '9') || text[0] == '.')) {
    return std::nullopt;
  }
  double value = 0.0;
  const auto [end, error] =
      std::from_chars(text.data(), text.data() + text.size(), value, std::chars_format::fixed);
  if (error != std::errc() || !std::isfinite(value)) {
    return std::nullopt;
  }
  text.remove_prefix(static_cast<std::size_t>(end - text.data()));
  return value;
}

// One of two coordinates, "39:29.9 N" for example [deg].
std::optional<double> take_coordinate(std::string_view& text, char positive, char negative,
                                      double high_deg) {
  text = without_blanks(text);
  double value_deg = 0.0;
  double unit = 1.0;
  for (int part = 0; part < 3; ++part, unit /= 60.0) {
    const auto number = take_number(text);
    if (!number || (part > 0 && *number > 60.0)) {
      return std::nullopt;
    }
    value_deg += unit * *number;
    if (text.empty() || text.front() != ':') {
      break;
    }
    text.remove_prefix(1);
  }
  text = without_blanks(text);
  if (text.empty() || value_deg > high_deg) {
    return std::nullopt;
  }
  const char side = upper_case(text.substr(0, 1))[0];
  text.remove_prefix(1);
  if (side != positive && side != negative) {
    return std::nullopt;
  }
  return side == positive ? value_deg : -value_deg;
}

std::optional<geo::GeodeticPosition> take_position(std::string_view& text) {
  const auto latitude_deg = take_coordinate(text, 'N', 'S', 90.0);
  const auto longitude_deg = latitude_deg ? take_coordinate(text, 'E', 'W', 180.0) : std::nullopt;
  if (!longitude_deg) {
    return std::nullopt;
  }
  text = without_blanks(text);
  return geo::GeodeticPosition{radians_from_degrees(*latitude_deg),
                               radians_from_degrees(*longitude_deg)};
}

class Parser {
 public:
  explicit Parser(const std::string& name) : name_(name) {}

  std::vector<OpenAirArea> parse(std::string_view text) {
    text = without_mark(text);
    while (!text.empty()) {
      ++line_;
      parse_line(without_blanks(take_line(text)));
    }
    end_area();
    return std::move(areas_);
  }

 private:
  [[noreturn]] void refuse(const std::string& why) const {
    throw DataError(name_ + ":" + std::to_string(line_) + ": " + why,
                    "correct the line or remove its area; an area that cannot be read is never "
                    "left out");
  }
  [[noreturn]] void refuse_line(std::string_view line) const {
    refuse("'" + clean_name(line, 60) + "' cannot be read");
  }

  void parse_line(std::string_view line) {
    if (line.empty() || line.front() == '*' || line.front() == '#') {
      return;
    }
    const std::string command = upper_case(line.substr(0, 2));
    std::string_view rest = line.substr(std::min<std::size_t>(2, line.size()));
    const bool is_one_letter = command.size() == 2 && (command[1] == ' ' || command[1] == '\t');
    if (!is_one_letter && !rest.empty() && rest.front() != ' ' && rest.front() != '\t') {
      refuse_line(line);
    }
    rest = without_blanks(rest);
    if (command == "AN") {
      current().name = clean_name(rest);
      return;
    }
    rest = without_blanks(rest.substr(0, rest.find('*')));
    if (command == "AC") {
      end_area();
      areas_.push_back({});
      areas_.back().line = line_;
      areas_.back().kind = clean_name(rest, 40);
      areas_.back().floor = {-kInfinity, true};
      areas_.back().ceiling = {kInfinity, false};
      is_open_ = true;
    } else if (command == "AL" || command == "AH") {
      const auto limit = altitude_limit_in(rest, kFoot_m);
      if (!limit) {
        refuse("the altitude '" + clean_name(rest, 60) + "' cannot be read");
      }
      (command == "AL" ? current().floor : current().ceiling) = *limit;
    } else if (command[0] == 'V' && is_one_letter) {
      parse_variable(line);
    } else if (command == "TO" || command == "TC") {
      end_area();
      is_terrain_ = true;
    } else if (is_terrain_ && is_one_of(command, {"DP", "DA", "DB", "DC"})) {
      return;
    } else if (command == "DP") {
      add(position_in(rest, line));
    } else if (command == "DC") {
      add_arc(radius_in(rest, line), 0.0, kTwoPi, false);
    } else if (command == "DA") {
      parse_angles(rest, line);
    } else if (command == "DB") {
      parse_ends(rest, line);
    } else if (command == "DY") {
      refuse("airways (DY) are not supported");
    } else if (!is_one_of(command, {"AT", "AY", "AF", "AG", "AI", "AX", "AA", "TP", "SP", "SB"})) {
      refuse_line(line);
    }
  }

  OpenAirArea& current() {
    if (!is_open_) {
      refuse("stands before the first AC");
    }
    return areas_.back();
  }

  void end_area() {
    if (is_open_) {
      std::vector<geo::GeodeticPosition>& outline = areas_.back().outline;
      const auto same = [](const geo::GeodeticPosition& a, const geo::GeodeticPosition& b) {
        return a.latitude_rad == b.latitude_rad && a.longitude_rad == b.longitude_rad;
      };
      while (outline.size() > 1 && same(outline.front(), outline.back())) {
        outline.pop_back();
      }
      if (outline.size() < 3) {
        line_ = areas_.back().line;
        refuse("area '" + areas_.back().name + "' has fewer than three corners");
      }
      const OpenAirArea& area = areas_.back();
      if ((area.floor.is_above_ground == area.ceiling.is_above_ground &&
           area.floor.value_m > area.ceiling.value_m) ||
          area.ceiling.value_m == -kInfinity || area.floor.value_m == kInfinity) {
        line_ = area.line;
        refuse("area '" + area.name + "' ends below its beginning");
      }
    }
    is_open_ = false;
    is_terrain_ = false;
    centre_.reset();
    is_clockwise_ = true;
  }

  void parse_variable(std::string_view line) {
    const std::size_t equals = line.find('=');
    if (equals == std::string_view::npos) {
      refuse_line(line);
    }
    const std::string key = upper_case(without_blanks(line.substr(1, equals - 1)));
    std::string_view value = without_blanks(line.substr(equals + 1));
    value = without_blanks(value.substr(0, value.find('*')));
    if (key == "X") {
      centre_ = position_in(value, line);
    } else if (key == "D") {
      if (value != "+" && value != "-") {
        refuse("the direction of an arc is + or -");
      }
      is_clockwise_ = value == "+";
    } else if (key != "W" && key != "Z" && key != "T") {
      refuse_line(line);
    }
  }

  geo::GeodeticPosition position_in(std::string_view text, std::string_view line) const {
    const auto position = take_position(text);
    if (!position || !text.empty()) {
      refuse_line(line);
    }
    return *position;
  }

  double radius_in(std::string_view text, std::string_view line) const {
    const auto number = take_number(text);
    if (!number || !without_blanks(text).empty()) {
      refuse_line(line);
    }
    return checked_radius_m(*number * kNauticalMile_m);
  }
  double checked_radius_m(double radius_m) const {
    if (!(radius_m > 0.0 && radius_m <= kRadiusMax_m)) {
      refuse("a radius of " + std::to_string(radius_m) + " m is not possible");
    }
    return radius_m;
  }

  void parse_angles(std::string_view rest, std::string_view line) {
    std::array<double, 3> values{};
    for (std::size_t i = 0; i < values.size(); ++i) {
      rest = without_blanks(rest);
      const auto number = take_number(rest);
      rest = without_blanks(rest);
      const bool is_last = i + 1 == values.size();
      if (!number || is_last != rest.empty() || (!is_last && rest.front() != ',')) {
        refuse_line(line);
      }
      values[i] = *number;
      rest.remove_prefix(is_last ? 0 : 1);
    }
    if (values[1] > 360.0 || values[2] > 360.0) {
      refuse_line(line);
    }
    const double radius_m = checked_radius_m(values[0] * kNauticalMile_m);
    const double from_rad = radians_from_degrees(values[1]);
    add_arc(radius_m, from_rad, turn_rad(from_rad, radians_from_degrees(values[2])), true);
  }

  void parse_ends(std::string_view rest, std::string_view line) {
    const std::size_t comma = rest.find(',');
    if (comma == std::string_view::npos) {
      refuse_line(line);
    }
    const geo::GeodeticPosition from = position_in(without_blanks(rest.substr(0, comma)), line);
    const geo::GeodeticPosition to = position_in(without_blanks(rest.substr(comma + 1)), line);
    const geo::Geodesic first = geo::geodesic_between(checked_centre(), from);
    const geo::Geodesic last = geo::geodesic_between(checked_centre(), to);
    checked_radius_m(first.distance_m);
    checked_radius_m(last.distance_m);
    // Ends that lie at different distances are joined by a spiral.
    const double sweep_rad = turn_rad(first.azimuth_rad, last.azimuth_rad);
    add(from);
    const int steps = steps_of(std::max(first.distance_m, last.distance_m), sweep_rad);
    for (int i = 1; i < steps; ++i) {
      const double t = static_cast<double>(i) / steps;
      add(geo::geodesic_end(checked_centre(), first.azimuth_rad + t * sweep_rad,
                            first.distance_m + t * (last.distance_m - first.distance_m)));
    }
    add(to);
  }

  // From one azimuth to another in the direction of the arc; a whole turn if they are the same.
  [[nodiscard]] double turn_rad(double from_rad, double to_rad) const {
    double turn = wrap_to_two_pi(is_clockwise_ ? to_rad - from_rad : from_rad - to_rad);
    turn = turn == 0.0 ? kTwoPi : turn;
    return is_clockwise_ ? turn : -turn;
  }

  // So that chords leave the arc by at most kArcSagitta_m: r (1 - cos(step / 2)) < r step^2 / 8.
  static int steps_of(double radius_m, double sweep_rad) {
    const double step_rad = std::min(std::sqrt(8.0 * kArcSagitta_m / radius_m), 0.25);
    return static_cast<int>(std::ceil(std::fabs(sweep_rad) / step_rad));
  }

  void add_arc(double radius_m, double from_rad, double sweep_rad, bool with_last) {
    const int steps = std::max(3, steps_of(radius_m, sweep_rad));
    for (int i = 0; i < steps + (with_last ? 1 : 0); ++i) {
      add(geo::geodesic_end(checked_centre(), from_rad + sweep_rad * static_cast<double>(i) / steps,
                            radius_m));
    }
  }

  [[nodiscard]] const geo::GeodeticPosition& checked_centre() const {
    if (!centre_) {
      refuse("an arc or circle stands before its centre (V X=)");
    }
    return *centre_;
  }

  void add(const geo::GeodeticPosition& corner) {
    current().outline.push_back(corner);
    if (++corners_ > kCornersMax) {
      refuse("the file has more than " + std::to_string(kCornersMax) + " corners");
    }
  }

  const std::string& name_;
  std::int64_t line_ = 0;
  std::vector<OpenAirArea> areas_;
  bool is_open_ = false;
  bool is_terrain_ = false;
  std::optional<geo::GeodeticPosition> centre_;
  bool is_clockwise_ = true;
  std::size_t corners_ = 0;
};

}  // namespace

std::optional<AltitudeLimit> altitude_limit_in(std::string_view text, double bare_unit_m) {
  std::string compact = upper_case(without_blanks(text));
  std::erase_if(compact, [](char c) { return c == ' ' || c == '\t'; });
  std::string_view rest = compact;
  if (is_one_of(rest, {"GND", "SFC", "GROUND", "SURFACE"})) {
    return AltitudeLimit{-kInfinity, true};
  }
  if (is_one_of(rest, {"UNL", "UNLIM", "UNLTD", "UNLIMITED"})) {
    return AltitudeLimit{kInfinity, false};
  }
  const bool is_level = rest.starts_with("FL");
  rest.remove_prefix(is_level ? 2 : 0);
  const bool is_below = rest.starts_with('-');  // the Dead Sea
  rest.remove_prefix(is_below ? 1 : 0);
  auto number = take_number(rest);
  if (!number || (is_level && is_below)) {
    return std::nullopt;
  }
  AltitudeLimit limit;
  double unit_m = bare_unit_m;
  if (is_level) {
    unit_m = 100.0 * kFoot_m;
    if (!is_one_of(rest, {"", "STD", "MSL", "AMSL"})) {
      return std::nullopt;
    }
  } else {
    const std::initializer_list<std::string_view> sea = {"MSL", "AMSL", "ALT", "QNH"};
    const std::initializer_list<std::string_view> ground = {"AGL", "GND", "SFC", "ASFC", "AAL"};
    if (!is_one_of(rest, sea) && !is_one_of(rest, ground)) {
      // The longest first.
      for (const auto& [word, length_m] : {std::pair<std::string_view, double>{"FEET", kFoot_m},
                                           {"FT", kFoot_m},
                                           {"F", kFoot_m},
                                           {"M", 1.0}}) {
        if (rest.starts_with(word)) {
          unit_m = length_m;
          rest.remove_prefix(word.size());
          break;
        }
      }
    }
    limit.is_above_ground = is_one_of(rest, ground);
    if (!rest.empty() && !limit.is_above_ground && !is_one_of(rest, sea)) {
      return std::nullopt;
    }
    if (unit_m == 0.0 && *number != 0.0) {
      return std::nullopt;
    }
  }
  limit.value_m = (is_below ? -*number : *number) * unit_m;
  if (!(std::fabs(limit.value_m) <= kAltitudeMax_m)) {
    return std::nullopt;
  }
  return limit;
}

std::vector<OpenAirArea> parse_open_air(std::string_view text, const std::string& name) {
  return Parser(name).parse(text);
}

}  // namespace hedgehop::map_sources
