#include "map_sources/obstacle_file.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "base/errors.hpp"
#include "base/files.hpp"
#include "map_sources/text_in_files.hpp"

namespace hedgehop::map_sources {
namespace {

constexpr char kStage[] = "obstacle files";
constexpr double kHeightMax_m = 10'000.0;
constexpr double kRadiusMax_m = 100'000.0;
constexpr std::size_t kColumnsMax = 1000;

// Where something is read, for errors.
struct Place {
  const std::string& file;
  std::int64_t line = 0;

  [[noreturn]] void refuse(const std::string& why, const std::string& hint) const {
    throw DataError(file + ":" + std::to_string(line) + ": " + why, hint);
  }
  [[noreturn]] void refuse(const std::string& why) const {
    refuse(why, "correct or remove the line; an obstacle that cannot be read is never left out");
  }
};

std::string in_quotes(std::string_view text) { return "'" + clean_name(text, 60) + "'"; }

double checked_height_m(const Place& place, double value_m) {
  if (!(value_m >= 0.0 && value_m <= kHeightMax_m)) {
    place.refuse("a height of " + std::to_string(value_m) + " m above the ground is not possible");
  }
  return value_m;
}

double checked_top_m(const Place& place, double value_m) {
  if (!(value_m >= -1000.0 && value_m <= kHeightMax_m)) {
    place.refuse("a top at " + std::to_string(value_m) + " m above the sea is not possible");
  }
  return value_m;
}

double checked_radius_m(const Place& place, double value_m) {
  if (!(value_m >= 0.0 && value_m <= kRadiusMax_m)) {
    place.refuse("a radius or error of " + std::to_string(value_m) + " m is not possible");
  }
  return value_m;
}

geo::GeodeticPosition checked_position(const Place& place, double latitude_deg,
                                       double longitude_deg) {
  if (!(latitude_deg >= -90.0 && latitude_deg <= 90.0 && longitude_deg >= -180.0 &&
        longitude_deg <= 180.0)) {
    place.refuse("latitude " + std::to_string(latitude_deg) + " and longitude " +
                 std::to_string(longitude_deg) + " are not on the globe");
  }
  return {radians_from_degrees(latitude_deg), radians_from_degrees(longitude_deg)};
}

std::optional<double> horizontal_error_of_code(const Place& place, char code) {
  static constexpr std::array<double, 8> kErrors_m = {
      20.0 * kFoot_m,  50.0 * kFoot_m,   100.0 * kFoot_m,       250.0 * kFoot_m,
      500.0 * kFoot_m, 1000.0 * kFoot_m, 0.5 * kNauticalMile_m, kNauticalMile_m};
  if (code == ' ' || code == '9') {
    return std::nullopt;
  }
  if (code < '1' || code > '8') {
    place.refuse("the horizontal accuracy code " + in_quotes({&code, 1}) + " is none of 1 to 9");
  }
  return kErrors_m.at(static_cast<std::size_t>(code - '1'));
}

std::optional<double> vertical_error_of_code(const Place& place, char code) {
  static constexpr std::array<double, 8> kErrors_ft = {3.0,   10.0,  20.0,  50.0,
                                                       125.0, 250.0, 500.0, 1000.0};
  if (code == ' ' || code == 'I') {
    return std::nullopt;
  }
  if (code < 'A' || code > 'H') {
    place.refuse("the vertical accuracy code " + in_quotes({&code, 1}) + " is none of A to I");
  }
  return kErrors_ft.at(static_cast<std::size_t>(code - 'A')) * kFoot_m;
}

StructureKind kind_in(std::string_view text) {
  const std::string type = lower_case(text);
  const auto has = [&](std::initializer_list<std::string_view> words) {
    return std::any_of(words.begin(), words.end(),
                       [&](std::string_view word) { return type.find(word) != std::string::npos; });
  };
  if (has({"wind"})) {
    return StructureKind::kWindTurbine;
  }
  if (has({"cool", "tank", "silo", "dome", "bldg", "building", "elevator"})) {
    return StructureKind::kStructure;
  }
  if (has({"mast", "antenna"})) {
    return StructureKind::kMast;
  }
  if (has({"stack", "chimney"})) {
    return StructureKind::kChimney;
  }
  if (has({"tower", "twr"})) {
    return StructureKind::kTower;
  }
  return StructureKind::kOther;
}

// ---- fixed columns

constexpr std::size_t kDatColumnsMin = 100;

bool is_digit(char c) { return c >= '0' && c <= '9'; }

bool begins_dat_record(std::string_view line) {
  return line.size() >= 12 && is_digit(line[0]) && is_digit(line[1]) && line[2] == '-' &&
         std::all_of(line.begin() + 3, line.begin() + 9, is_digit) && line[9] == ' ' &&
         (line[10] == 'O' || line[10] == 'U');
}

class DatLine {
 public:
  DatLine(std::string_view line, const Place& place) : line_(line), place_(place) {
    if (line.size() < kDatColumnsMin) {
      place.refuse("has " + std::to_string(line.size()) + " columns, an entry of a DOF has 127");
    }
  }
  // Columns as the FAA counts them, from 1, both included.
  [[nodiscard]] std::string_view text(std::size_t first, std::size_t last) const {
    return first > line_.size() ? std::string_view()
                                : without_blanks(line_.substr(first - 1, last - first + 1));
  }
  [[nodiscard]] double number(const char* what, std::size_t first, std::size_t last, double low,
                              double high) const {
    const auto value = number_in(text(first, last));
    if (!value || !(*value >= low && *value <= high)) {
      place_.refuse(std::string(what) + " in columns " + std::to_string(first) + " to " +
                    std::to_string(last) + " is " + in_quotes(text(first, last)));
    }
    return *value;
  }
  [[nodiscard]] char letter(std::size_t column) const {
    return column > line_.size() ? ' ' : line_[column - 1];
  }
  [[nodiscard]] double degrees(const char* what, std::size_t first, std::size_t degree_columns,
                               double high, char positive, char negative) const {
    const double whole = number(what, first, first + degree_columns - 1, 0.0, high);
    const std::size_t minute = first + degree_columns + 1;
    const double minutes = number(what, minute, minute + 1, 0.0, 60.0);
    const double seconds = number(what, minute + 3, minute + 7, 0.0, 60.0);
    const char side = letter(minute + 8);
    if (side != positive && side != negative) {
      place_.refuse(std::string(what) + " ends in " + in_quotes({&side, 1}));
    }
    const double value = whole + minutes / 60.0 + seconds / 3600.0;
    return side == positive ? value : -value;
  }

 private:
  std::string_view line_;
  const Place& place_;
};

std::optional<ObstacleRecord> dat_record(std::string_view line, const Place& place) {
  if (!begins_dat_record(line)) {
    place.refuse("does not begin with a number such as 06-001234 and a status, O or U");
  }
  const DatLine columns(line, place);
  if (columns.letter(119) == 'D') {
    return std::nullopt;
  }
  ObstacleRecord record;
  record.line = place.line;
  record.kind = kind_in(columns.text(63, 80));
  record.name =
      clean_name(std::string(columns.text(1, 9)) + " " + std::string(columns.text(63, 80)) + " " +
                 std::string(columns.text(19, 34)));
  record.position = checked_position(place, columns.degrees("latitude", 36, 2, 90.0, 'N', 'S'),
                                     columns.degrees("longitude", 49, 3, 180.0, 'E', 'W'));
  record.height_m =
      checked_height_m(place, columns.number("height", 84, 88, -99999.0, 99999.0) * kFoot_m);
  if (!columns.text(90, 94).empty()) {
    record.top_m = checked_top_m(place, columns.number("top", 90, 94, -99999.0, 99999.0) * kFoot_m);
  }
  record.horizontal_error_m = horizontal_error_of_code(place, columns.letter(98));
  record.vertical_error_m = vertical_error_of_code(place, columns.letter(100));
  record.is_verified = columns.letter(11) == 'O';
  return record;
}

std::vector<ObstacleRecord> parse_dat(std::string_view text, const std::string& name) {
  std::vector<ObstacleRecord> records;
  Place place{name, 0};
  bool is_header = false;
  while (!text.empty()) {
    ++place.line;
    const std::string_view line = take_line(text);
    if (without_blanks(line).empty() || line == "\x1a") {
      continue;
    }
    if (place.line == 1 && !begins_dat_record(line)) {
      is_header = true;
    }
    if (is_header) {
      // A line of dashes ends the header.
      is_header = without_blanks(line).find_first_not_of('-') != std::string_view::npos;
      continue;
    }
    if (auto record = dat_record(line, place)) {
      records.push_back(std::move(*record));
    }
  }
  if (is_header) {
    place.refuse("the header of the obstacle file has no end",
                 "a DOF.DAT has a line of dashes before its first entry");
  }
  return records;
}

// ---- CSV

// The fields of one record, which may go over several lines if one of them is quoted.
class CsvReader {
 public:
  CsvReader(std::string_view text, const std::string& name) : rest_(text), place_{name, 0} {
    std::string_view copy = rest_;
    const std::string_view header = take_line(copy);
    const auto count = [&](char c) { return std::count(header.begin(), header.end(), c); };
    separator_ = count(';') > count(',') ? ';' : count('\t') > count(',') ? '\t' : ',';
  }
  [[nodiscard]] const Place& place() const { return place_; }
  [[nodiscard]] char separator() const { return separator_; }

  // False at the end. Empty lines are passed over.
  bool next(std::vector<std::string>& fields) {
    while (!rest_.empty()) {
      place_.line += 1 + line_breaks_;
      line_breaks_ = 0;
      if (rest_.front() == '\n' || rest_.starts_with("\r\n")) {
        (void)take_line(rest_);
        continue;
      }
      fields.clear();
      bool has_more = true;
      while (has_more) {
        has_more = take_field(fields);
        if (fields.size() > kColumnsMax) {
          place_.refuse("has more than " + std::to_string(kColumnsMax) + " columns");
        }
      }
      return true;
    }
    return false;
  }

 private:
  // Whether another field of the same record follows.
  bool take_field(std::vector<std::string>& fields) {
    std::string field;
    if (!rest_.empty() && rest_.front() == '"') {
      rest_.remove_prefix(1);
      while (true) {
        const std::size_t quote = rest_.find('"');
        if (quote == std::string_view::npos) {
          place_.refuse("a quoted field has no end");
        }
        line_breaks_ +=
            std::count(rest_.begin(), rest_.begin() + static_cast<std::ptrdiff_t>(quote), '\n');
        field += rest_.substr(0, quote);
        rest_.remove_prefix(quote + 1);
        if (!rest_.starts_with('"')) {
          break;
        }
        field += '"';
        rest_.remove_prefix(1);
      }
      const std::size_t end = rest_.find_first_of(std::string{separator_, '\n'});
      const std::string_view behind = rest_.substr(0, std::min(end, rest_.size()));
      if (behind.find_first_not_of(" \r") != std::string_view::npos) {
        place_.refuse("something stands behind a quoted field");
      }
      rest_.remove_prefix(behind.size());
    } else {
      const std::size_t end = rest_.find_first_of(std::string{separator_, '\n'});
      field = rest_.substr(0, std::min(end, rest_.size()));
      rest_.remove_prefix(field.size());
      if (!field.empty() && field.back() == '\r') {
        field.pop_back();
      }
    }
    fields.push_back(std::move(field));
    const bool has_more = !rest_.empty() && rest_.front() == separator_;
    rest_.remove_prefix(rest_.empty() ? 0 : 1);
    return has_more;
  }

  std::string_view rest_;
  Place place_;
  char separator_ = ',';
  std::int64_t line_breaks_ = 0;  // inside the quotes of the record before
};

// Which column says what.
class CsvColumns {
 public:
  CsvColumns(const std::vector<std::string>& header, const Place& place) {
    for (const std::string& field : header) {
      std::string column = lower_case(without_blanks(field));
      std::replace(column.begin(), column.end(), ' ', '_');
      names_.push_back(std::move(column));
    }
    is_faa_ = find({"oas"}) && find({"latdec"});
    latitude = need({"latitude_deg", "latitude", "lat", "latdec"}, "latitude_deg", place);
    longitude = need({"longitude_deg", "longitude", "lon", "long", "lng", "londec"},
                     "longitude_deg", place);
    height_m = find({"height_m", "agl_m", "height_agl_m"});
    height_ft = find({"height_ft", "agl_ft", "height_agl_ft"});
    top_m = find({"top_amsl_m", "amsl_m", "top_m"});
    top_ft = find({"top_amsl_ft", "amsl_ft", "top_ft"});
    if (is_faa_) {
      height_ft = find({"agl"});
      top_ft = find({"amsl"});
    } else if (const auto bare = find({"height", "agl", "elevation", "amsl", "top", "altitude"});
               bare && !height_m && !height_ft && !top_m && !top_ft) {
      place.refuse("column '" + names_[*bare] + "' states no unit",
                   "call it height_m or height_ft if it counts from the ground, top_amsl_m or "
                   "top_amsl_ft if it counts from the sea");
    }
    if (!height_m && !height_ft && !top_m && !top_ft) {
      place.refuse("no column tells the height of the obstacles",
                   "add a column height_m, height_ft, top_amsl_m or top_amsl_ft");
    }
    radius = find({"radius_m"});
    horizontal_error = find({"horizontal_error_m", "horizontal_accuracy_m"});
    vertical_error = find({"vertical_error_m", "vertical_accuracy_m"});
    accuracy = find({"accuracy"});
    type = find({"type", "kind"});
    name = find({"name", "designator", "oas", "id"});
    action = is_faa_ ? find({"action"}) : std::nullopt;
    status = is_faa_ ? find({"verified_status"}) : std::nullopt;
  }

  using Column = std::optional<std::size_t>;
  std::size_t latitude = 0;
  std::size_t longitude = 0;
  Column height_m, height_ft, top_m, top_ft, radius, horizontal_error, vertical_error, accuracy,
      type, name, action, status;

 private:
  [[nodiscard]] Column find(std::initializer_list<std::string_view> names) const {
    for (const std::string_view wanted : names) {
      const auto found = std::find(names_.begin(), names_.end(), wanted);
      if (found != names_.end()) {
        return static_cast<std::size_t>(found - names_.begin());
      }
    }
    return std::nullopt;
  }
  [[nodiscard]] std::size_t need(std::initializer_list<std::string_view> names,
                                 const std::string& best, const Place& place) const {
    const Column column = find(names);
    if (!column) {
      place.refuse("this is no obstacle file: it has no column " + best,
                   "give a DOF.DAT, a DOF as CSV, or a CSV with a header that names latitude_deg, "
                   "longitude_deg and height_m");
    }
    return *column;
  }

  std::vector<std::string> names_;
  bool is_faa_ = false;
};

std::vector<ObstacleRecord> parse_csv(std::string_view text, const std::string& name) {
  CsvReader reader(text, name);
  std::vector<std::string> fields;
  if (!reader.next(fields)) {
    Place{name, 1}.refuse("the obstacle file is empty", "give another file");
  }
  const CsvColumns columns(fields, reader.place());
  std::vector<ObstacleRecord> records;
  while (reader.next(fields)) {
    const Place& place = reader.place();
    const auto text_at = [&](const CsvColumns::Column& column) {
      return column && *column < fields.size() ? without_blanks(fields[*column])
                                               : std::string_view();
    };
    const auto number_at = [&](const CsvColumns::Column& column) -> std::optional<double> {
      std::string value(text_at(column));
      if (value.empty()) {
        return std::nullopt;
      }
      if (reader.separator() == ';') {
        std::replace(value.begin(), value.end(), ',', '.');
      }
      const auto number = number_in(value);
      if (!number) {
        place.refuse(in_quotes(value) + " in column " + std::to_string(*column + 1) +
                     " is not a number");
      }
      return number;
    };
    if (std::all_of(fields.begin(), fields.end(),
                    [](const std::string& f) { return without_blanks(f).empty(); }) ||
        text_at(columns.action) == "D") {
      continue;
    }
    ObstacleRecord record;
    record.line = place.line;
    record.kind = kind_in(text_at(columns.type));
    record.name = clean_name(text_at(columns.name));
    const auto latitude_deg = number_at(columns.latitude);
    const auto longitude_deg = number_at(columns.longitude);
    if (!latitude_deg || !longitude_deg) {
      place.refuse("latitude or longitude is missing");
    }
    record.position = checked_position(place, *latitude_deg, *longitude_deg);
    if (const auto height_m = number_at(columns.height_m)) {
      record.height_m = checked_height_m(place, *height_m);
    } else if (const auto height_ft = number_at(columns.height_ft)) {
      record.height_m = checked_height_m(place, *height_ft * kFoot_m);
    }
    if (const auto top_m = number_at(columns.top_m)) {
      record.top_m = checked_top_m(place, *top_m);
    } else if (const auto top_ft = number_at(columns.top_ft)) {
      record.top_m = checked_top_m(place, *top_ft * kFoot_m);
    }
    if (!record.height_m && !record.top_m) {
      place.refuse("the height is missing");
    }
    record.radius_m = checked_radius_m(place, number_at(columns.radius).value_or(0.0));
    if (const std::string_view code = text_at(columns.accuracy); !code.empty()) {
      if (code.size() > 2) {
        place.refuse("the accuracy code " + in_quotes(code) + " is none such as 1A");
      }
      // One of the two may be missing.
      const bool has_horizontal = is_digit(code.front());
      record.horizontal_error_m =
          has_horizontal ? horizontal_error_of_code(place, code.front()) : std::nullopt;
      if (code.size() == 2 || !has_horizontal) {
        record.vertical_error_m = vertical_error_of_code(place, code.back());
      }
    }
    if (const auto error_m = number_at(columns.horizontal_error)) {
      record.horizontal_error_m = checked_radius_m(place, *error_m);
    }
    if (const auto error_m = number_at(columns.vertical_error)) {
      record.vertical_error_m = checked_height_m(place, *error_m);
    }
    record.is_verified = text_at(columns.status) != "U";
    records.push_back(std::move(record));
  }
  return records;
}

}  // namespace

std::vector<ObstacleRecord> parse_obstacles(std::string_view text, const std::string& name) {
  text = without_mark(text);
  std::string_view copy = text;
  const std::string_view first = take_line(copy);
  const bool is_dat =
      begins_dat_record(first) || without_blanks(first).starts_with("CURRENCY DATE");
  return is_dat ? parse_dat(text, name) : parse_csv(text, name);
}

ObstacleList read_obstacle_files(const std::vector<std::filesystem::path>& files,
                                 const geo::MapProjection& projection,
                                 const geo::GeodeticBox& region, double reach_m,
                                 Observer& observer) {
  constexpr double kEarthRadius_m = 6.3e6;  // rather too small: margins become wider
  ObstacleList list;
  for (std::size_t i = 0; i < files.size(); ++i) {
    observer.check_stop();
    observer.progress(kStage, static_cast<double>(i), static_cast<double>(files.size()));
    const std::vector<ObstacleRecord> records =
        parse_obstacles(read_file(files[i]), files[i].string());
    list.record_count += static_cast<std::int64_t>(records.size());
    for (const ObstacleRecord& record : records) {
      const double margin_rad =
          (record.radius_m + record.horizontal_error_m.value_or(0.0) + reach_m) / kEarthRadius_m;
      const double latitude_rad = record.position.latitude_rad;
      const double longitude_margin_rad =
          margin_rad / std::max(elementary::cos(latitude_rad), 0.05);
      if (latitude_rad < region.south_rad - margin_rad ||
          latitude_rad > region.north_rad + margin_rad ||
          record.position.longitude_rad < region.west_rad - longitude_margin_rad ||
          record.position.longitude_rad > region.east_rad + longitude_margin_rad) {
        continue;
      }
      list.unverified_count += record.is_verified ? 0 : 1;
      list.unknown_accuracy_count += record.horizontal_error_m && record.vertical_error_m ? 0 : 1;
      list.obstacles.push_back({record, projection.to_map(record.position)});
    }
  }
  if (!files.empty()) {
    observer.progress(kStage, static_cast<double>(files.size()), static_cast<double>(files.size()));
  }
  return list;
}

}  // namespace hedgehop::map_sources
