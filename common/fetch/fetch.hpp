#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/errors.hpp"
#include "base/observer.hpp"
#include "fetch/fetch_options.hpp"
#include "geo/geodetic_box.hpp"

namespace hedgehop::fetch {

inline constexpr int kFetchSchemaVersion = 1;
inline constexpr char kFetchFile[] = "fetch.json";
/// Exit code when something could not be fetched; the ones of all verbs stand in base/errors.hpp.
inline constexpr ExitCode kNotFetched{7};

struct FetchRequest {
  geo::GeodeticBox box;
  std::vector<Source> sources;  // in this order
  std::filesystem::path folder;
  bool is_overwriting = false;  // fetch again what is there
};

enum class FileState : std::uint8_t {
  kFetched,  // now
  kKept,     // fetched earlier, unchanged since
  kBrought,  // was there without having been fetched
  kAbsent,   // the source has no such tile: sea
  kMissing,  // could not be fetched; `trouble` says why
};
/// "fetched" and so on.
const char* name_of(FileState state);

struct FetchedFile {
  std::string source;
  std::string url;
  std::filesystem::path path;
  FileState state = FileState::kMissing;
  std::int64_t bytes = 0;
  std::string sha256;
  std::string last_modified;  // as the server said, may be empty
  std::string trouble;
};

struct FetchReport {
  std::vector<FetchedFile> files;  // in the order of sources and tiles
  [[nodiscard]] bool is_complete() const;
};

/// Fetches what a box needs, one file after another.
///
/// A file has a temporary name (`.part`) until it is whole and its checksum, if there is one, is
/// right; a broken transfer is taken up where it ended, this time or the next, if the server still
/// has the same file. Failures that may pass are tried again with growing pauses, or after as long
/// as the server says. A host that cannot be reached is asked no more. Nothing that is there is
/// overwritten, unless asked for. `fetch.json` beside the files records source, URL, size, SHA-256,
/// licence and attribution of each; it is written whatever happened.
///
/// What is missing at the end is a value: FileState::kMissing with the reason.
///
/// @throws DataError    a file that was fetched earlier has changed since, or fetch.json is damaged
/// @throws SystemFailure  the folder cannot be written
/// @throws Interrupted  the observer asked to stop; what has come of a file is kept for the next
///                      time
FetchReport fetch(const FetchRequest& request, const FetchOptions& options, Observer& observer);

/// The same without asking anybody: kMissing is what fetch() would ask for.
FetchReport look(const FetchRequest& request, const FetchOptions& options);

}  // namespace hedgehop::fetch
