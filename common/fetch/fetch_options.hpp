#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "base/config_reader.hpp"
#include "geo/geodetic_box.hpp"

namespace hedgehop::fetch {

/// How servers are treated.
struct Politeness {
  std::string user_agent;
  double pause_s = 0.0;     // between two requests to one host
  int retries_max = 0;      // attempts in a row that bring nothing new
  double back_off_s = 0.0;  // before the first retry, doubles with each
  double back_off_max_s = 0.0;
  double retry_after_max_s = 0.0;  // a longer Retry-After is a refusal
  double connect_timeout_s = 0.0;
  double stall_timeout_s = 0.0;  // without a byte
};

enum class SourceKind : std::uint8_t { kTerrain, kOsm };
enum class ChecksumKind : std::uint8_t { kNone, kMd5, kSha256 };

/// A public source of files: one for each tile, or one for the box.
struct Source {
  std::string name;
  SourceKind kind = SourceKind::kTerrain;
  std::string url;                    // template
  std::string file;                   // template of the name
  int tile_deg = 0;                   // 0: one file for the whole box
  std::vector<long> absent_statuses;  // HTTP statuses that mean "no such tile": sea
  ChecksumKind checksum = ChecksumKind::kNone;
  std::string checksum_url;                                 // template; empty without checksum
  std::vector<std::pair<std::string, std::string>> sha256;  // file name, 64 digits
  std::int64_t bytes_max = 0;
  std::string dem_suffix;  // for `hedgehop prepare --dem`
  std::string licence;
  std::string attribution;
  std::string page;
};

/// What config/fetch.yaml holds.
struct FetchOptions {
  Politeness politeness;
  double terrain_margin_m = 0.0;  // tiles are taken for the box and this much around it
  std::string default_terrain;
  std::string default_osm;
  std::vector<Source> sources;

  /// The whole document. Throws ConfigError.
  static FetchOptions read(ConfigReader& reader);

  /// Throws UsageError with the nearest name if no source of this kind has it.
  [[nodiscard]] const Source& source(SourceKind kind, const std::string& name) const;
};

/// One file of a source.
struct WantedFile {
  std::string url;
  std::string file;
  std::string checksum_url;
};

/// The files of a source that a box needs, tiles row by row from the south-west.
///
/// Names and URLs come from the templates; whole degrees name the south-western corner of a tile.
/// Throws UsageError for a box that is empty, outside the globe or larger than 200 tiles.
std::vector<WantedFile> wanted_files(const Source& source, const geo::GeodeticBox& box,
                                     double margin_m);

}  // namespace hedgehop::fetch
