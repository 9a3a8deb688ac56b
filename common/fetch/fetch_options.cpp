#include "fetch/fetch_options.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "base/angles.hpp"
#include "base/elementary.hpp"
#include "base/errors.hpp"

namespace hedgehop::fetch {
namespace {

constexpr int kTilesMax = 200;
constexpr double kDegree_m = 111000.0;  // of a meridian, rather too short

bool is_hex(const std::string& text, std::size_t digits) {
  return text.size() == digits && text.find_first_not_of("0123456789abcdef") == std::string::npos;
}

bool is_web_url(const std::string& url) {
  return url.starts_with("https://") || url.starts_with("http://");
}

Politeness read_politeness(ConfigReader reader) {
  Politeness politeness;
  const auto seconds = [&](const char* key, double most) {
    const double value_s = reader.required_double(key);
    reader.require(value_s >= 0.0 && value_s <= most, key,
                   "must be from 0 to " + std::to_string(static_cast<int>(most)));
    return value_s;
  };
  politeness.user_agent = reader.required_string("user_agent");
  reader.require(!politeness.user_agent.empty() &&
                     politeness.user_agent.find_first_of("\r\n") == std::string::npos,
                 "user_agent", "must be one line: servers ask who calls");
  politeness.pause_s = seconds("pause_s", 3600.0);
  const std::int64_t retries = reader.required_integer("retries_max");
  reader.require(retries >= 0 && retries <= 20, "retries_max", "must be from 0 to 20");
  politeness.retries_max = static_cast<int>(retries);
  politeness.back_off_s = seconds("back_off_s", 3600.0);
  politeness.back_off_max_s = seconds("back_off_max_s", 3600.0);
  politeness.retry_after_max_s = seconds("retry_after_max_s", 86400.0);
  politeness.connect_timeout_s = seconds("connect_timeout_s", 3600.0);
  politeness.stall_timeout_s = seconds("stall_timeout_s", 3600.0);
  reader.require(politeness.connect_timeout_s > 0.0, "connect_timeout_s", "must be above 0");
  reader.require(politeness.stall_timeout_s >= 1.0, "stall_timeout_s", "must be at least 1");
  reader.finish();
  return politeness;
}

template <typename Value>
Value one_of(ConfigReader& reader, const char* key,
             const std::vector<std::pair<std::string, Value>>& choices) {
  const std::string word = reader.required_string(key);
  std::string all;
  for (const auto& [name, value] : choices) {
    if (name == word) {
      return value;
    }
    all += (all.empty() ? "" : ", ") + name;
  }
  reader.refuse(key, "is '" + word + "', must be one of: " + all);
}

Source read_source(ConfigReader reader) {
  Source source;
  source.name = reader.required_string("name");
  reader.require(!source.name.empty() && source.name != "none", "name", "is no name");
  source.kind = one_of<SourceKind>(reader, "kind",
                                   {{"terrain", SourceKind::kTerrain}, {"osm", SourceKind::kOsm}});
  source.url = reader.required_string("url");
  reader.require(is_web_url(source.url), "url", "must begin with https:// or http://");
  source.file = reader.required_string("file");
  reader.require(!source.file.empty() && source.file.find('/') == std::string::npos &&
                     source.file[0] != '.' && source.file != "fetch.json",
                 "file", "must be the name of a file, without folder and not hidden");
  const std::int64_t tile_deg = reader.required_integer("tile_deg");
  reader.require(tile_deg >= 0 && tile_deg <= 30, "tile_deg", "must be from 0 to 30");
  source.tile_deg = static_cast<int>(tile_deg);
  for (const double status : reader.required_doubles("absent_statuses")) {
    reader.require(status >= 400.0 && status <= 499.0, "absent_statuses",
                   "must be from 400 to 499");
    source.absent_statuses.push_back(static_cast<long>(status));
  }
  source.checksum = one_of<ChecksumKind>(reader, "checksum",
                                         {{"none", ChecksumKind::kNone},
                                          {"md5", ChecksumKind::kMd5},
                                          {"sha256", ChecksumKind::kSha256}});
  source.checksum_url = reader.required_string("checksum_url");
  reader.require(source.checksum == ChecksumKind::kNone ? source.checksum_url.empty()
                                                        : is_web_url(source.checksum_url),
                 "checksum_url", "must be a URL if there is a checksum, and empty otherwise");
  for (const std::string& line : reader.required_strings("sha256")) {
    const std::size_t space = line.find(' ');
    reader.require(space != std::string::npos && space > 0 && is_hex(line.substr(space + 1), 64),
                   "sha256", "must be a list of \"NAME HEX\" with 64 digits of hexadecimal");
    source.sha256.emplace_back(line.substr(0, space), line.substr(space + 1));
  }
  source.bytes_max = reader.required_integer("bytes_max");
  reader.require(source.bytes_max > 0, "bytes_max", "must be above 0");
  source.dem_suffix = reader.required_string("dem_suffix");
  source.licence = reader.required_string("licence");
  reader.require(!source.licence.empty(), "licence",
                 "must say under which terms the files may be used");
  source.attribution = reader.required_string("attribution");
  reader.require(!source.attribution.empty(), "attribution", "must say whom to name");
  source.page = reader.required_string("page");
  reader.finish();
  return source;
}

std::string filled(std::string text,
                   const std::vector<std::pair<std::string, std::string>>& words) {
  for (const auto& [name, value] : words) {
    for (std::size_t at = 0; (at = text.find(name, at)) != std::string::npos; at += value.size()) {
      text.replace(at, name.size(), value);
    }
  }
  return text;
}

std::string number(const char* format, int value) {
  std::array<char, 16> text{};
  std::snprintf(text.data(), text.size(), format, value);
  return text.data();
}

// As short as it can be said, at least to a tenth of a metre.
std::string degrees_text(double angle_rad) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.6f", degrees_from_radians(angle_rad));
  std::string shown = text.data();
  shown.erase(shown.find_last_not_of('0') + 1);
  if (shown.ends_with('.')) {
    shown.pop_back();
  }
  return shown == "-0" ? "0" : shown;
}

}  // namespace

FetchOptions FetchOptions::read(ConfigReader& reader) {
  FetchOptions options;
  options.politeness = read_politeness(reader.required_section("politeness"));
  options.terrain_margin_m = reader.required_double("terrain_margin_m");
  reader.require(options.terrain_margin_m >= 0.0 && options.terrain_margin_m <= 100000.0,
                 "terrain_margin_m", "must be from 0 to 100000");
  options.default_terrain = reader.required_string("default_terrain");
  options.default_osm = reader.required_string("default_osm");
  for (ConfigReader& section : reader.required_sections("sources")) {
    const std::string where = section.file_and_line();
    options.sources.push_back(read_source(std::move(section)));
    const Source& newest = options.sources.back();
    if (std::any_of(options.sources.begin(), options.sources.end() - 1,
                    [&](const Source& other) { return other.name == newest.name; })) {
      throw ConfigError(where + ": a second source is called '" + newest.name + "'");
    }
  }
  const auto has = [&](SourceKind kind, const std::string& name) {
    return name == "none" ||
           std::any_of(options.sources.begin(), options.sources.end(), [&](const Source& source) {
             return source.kind == kind && source.name == name;
           });
  };
  reader.require(has(SourceKind::kTerrain, options.default_terrain), "default_terrain",
                 "names no source of terrain");
  reader.require(has(SourceKind::kOsm, options.default_osm), "default_osm",
                 "names no source of OpenStreetMap data");
  reader.finish();
  return options;
}

const Source& FetchOptions::source(SourceKind kind, const std::string& name) const {
  std::vector<std::string> known;
  for (const Source& source : sources) {
    if (source.kind == kind) {
      if (source.name == name) {
        return source;
      }
      known.push_back(source.name);
    }
  }
  std::string all;
  for (const std::string& word : known) {
    all += (all.empty() ? "" : ", ") + word;
  }
  const auto nearest = nearest_word(name, known);
  throw UsageError(std::string("there is no source of ") +
                       (kind == SourceKind::kTerrain ? "terrain" : "OpenStreetMap data") +
                       " called '" + name + "'",
                   (nearest ? "did you mean '" + *nearest + "'? " : "") + "there are: " + all +
                       ", none; more come with --config");
}

std::vector<WantedFile> wanted_files(const Source& source, const geo::GeodeticBox& box,
                                     double margin_m) {
  const double limit_rad = radians_from_degrees(90.0);
  if (!(box.west_rad < box.east_rad && box.south_rad < box.north_rad &&
        box.south_rad >= -limit_rad && box.north_rad <= limit_rad &&
        box.west_rad >= -2.0 * limit_rad && box.east_rad <= 2.0 * limit_rad)) {
    throw UsageError(
        "the box is empty or not on the globe",
        "give --bbox as west,south,east,north in degrees, not across the 180th meridian");
  }
  std::vector<std::pair<std::string, std::string>> words = {
      {"{west}", degrees_text(box.west_rad)},
      {"{south}", degrees_text(box.south_rad)},
      {"{east}", degrees_text(box.east_rad)},
      {"{north}", degrees_text(box.north_rad)}};
  if (source.tile_deg == 0) {
    return {{filled(source.url, words), filled(source.file, words),
             filled(source.checksum_url, words)}};
  }
  // A margin in metres is widest in degrees on the side nearer to the pole.
  const double north_deg = degrees_from_radians(box.north_rad) + margin_m / kDegree_m;
  const double south_deg = degrees_from_radians(box.south_rad) - margin_m / kDegree_m;
  const double widest_deg = std::min(89.0, std::max(std::abs(north_deg), std::abs(south_deg)));
  const double margin_deg =
      margin_m / (kDegree_m * elementary::cos(radians_from_degrees(widest_deg)));
  const auto tile_of = [&](double angle_deg) {
    return source.tile_deg * static_cast<int>(std::floor(angle_deg / source.tile_deg));
  };
  // A box that ends on the edge of a tile does not need the next one.
  const auto last_of = [&](double angle_deg, int first) {
    return std::max(first, tile_of(std::nextafter(angle_deg, -1000.0)));
  };
  const int west = std::max(-180, tile_of(degrees_from_radians(box.west_rad) - margin_deg));
  const int south = std::max(-90, tile_of(south_deg));
  const int east = std::min(180 - source.tile_deg,
                            last_of(degrees_from_radians(box.east_rad) + margin_deg, west));
  const int north = std::min(90 - source.tile_deg, last_of(north_deg, south));
  const long tiles = static_cast<long>((east - west) / source.tile_deg + 1) *
                     ((north - south) / source.tile_deg + 1);
  if (tiles > kTilesMax) {
    throw UsageError("the box needs " + std::to_string(tiles) + " tiles of " + source.name +
                         ", more than " + std::to_string(kTilesMax),
                     "take a smaller --bbox, or bring the files yourself");
  }
  std::vector<WantedFile> wanted;
  for (int latitude = south; latitude <= north; latitude += source.tile_deg) {
    for (int longitude = west; longitude <= east; longitude += source.tile_deg) {
      std::vector<std::pair<std::string, std::string>> tile = words;
      tile.emplace_back("{ns}", latitude < 0 ? "S" : "N");
      tile.emplace_back("{lat2}", number("%02d", std::abs(latitude)));
      tile.emplace_back("{ew}", longitude < 0 ? "W" : "E");
      tile.emplace_back("{lon3}", number("%03d", std::abs(longitude)));
      wanted.push_back(
          {filled(source.url, tile), filled(source.file, tile), filled(source.checksum_url, tile)});
    }
  }
  return wanted;
}

}  // namespace hedgehop::fetch
