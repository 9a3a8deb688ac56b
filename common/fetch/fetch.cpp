#include "fetch/fetch.hpp"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>

#include "base/angles.hpp"
#include "base/errors.hpp"
#include "base/files.hpp"
#include "base/hash.hpp"
#include "fetch/download.hpp"

namespace hedgehop::fetch {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

struct Recorded {
  std::string sha256;
  std::string url;
  std::string last_modified;
  bool was_brought = false;
};
// What fetch.json says of the files beside it, by name.
using Record = std::map<std::string, Recorded>;

Record read_record(const fs::path& folder) {
  const fs::path file = folder / kFetchFile;
  std::error_code error;
  if (!fs::exists(file, error)) {
    return {};
  }
  try {
    const Json json = Json::parse(read_file(file));
    if (json.at("schema_version").get<int>() != kFetchSchemaVersion) {
      throw DataError(file.string() + " is of another version",
                      "choose another --out, or remove that file");
    }
    Record record;
    for (const Json& entry : json.at("files")) {
      record[entry.at("file").get<std::string>()] = {
          entry.at("sha256").get<std::string>(), entry.at("url").get<std::string>(),
          entry.at("last_modified").get<std::string>(), entry.at("how") == "brought"};
    }
    return record;
  } catch (const Json::exception& wrong) {
    throw DataError(file.string() + " is damaged: " + wrong.what(),
                    "remove it: what lies beside it counts as brought then");
  }
}

// Files of other boxes in the same folder stay recorded.
void write_record(const FetchRequest& request, const std::vector<FetchedFile>& files,
                  const std::string& earlier) {
  Json json;
  json["schema_version"] = kFetchSchemaVersion;
  json["files"] = Json::array();
  json["absent"] = Json::array();
  const auto is_ours = [&](const std::string& name) {
    return std::any_of(files.begin(), files.end(),
                       [&](const FetchedFile& file) { return file.path.filename() == name; });
  };
  if (!earlier.empty()) {
    const Json before = Json::parse(earlier);
    for (const Json& entry : before.at("files")) {
      const std::string name = entry.at("file").get<std::string>();
      std::error_code error;
      if (!is_ours(name) && fs::exists(request.folder / name, error)) {
        json["files"].push_back(entry);
      }
    }
    for (const Json& entry : before.value("absent", Json::array())) {
      if (!is_ours(entry.value("file", ""))) {
        json["absent"].push_back(entry);
      }
    }
  }
  for (const FetchedFile& file : files) {
    const auto source =
        std::find_if(request.sources.begin(), request.sources.end(),
                     [&](const Source& candidate) { return candidate.name == file.source; });
    if (file.state == FileState::kAbsent) {
      json["absent"].push_back(
          {{"file", file.path.filename().string()}, {"source", file.source}, {"url", file.url}});
    } else if (file.state != FileState::kMissing) {
      json["files"].push_back({{"file", file.path.filename().string()},
                               {"source", file.source},
                               {"how", file.state == FileState::kBrought ? "brought" : "fetched"},
                               {"url", file.url},
                               {"bytes", file.bytes},
                               {"sha256", file.sha256},
                               {"last_modified", file.last_modified},
                               {"licence", source->licence},
                               {"attribution", source->attribution},
                               {"page", source->page}});
    }
  }
  write_file_atomically(request.folder / kFetchFile,
                        json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
}

std::string known_sha256(const Source& source, const std::string& name) {
  for (const auto& [file, sha256] : source.sha256) {
    if (file == name) {
      return sha256;
    }
  }
  return {};
}

// What there is of a file already; kMissing if nothing is.
FetchedFile look_at(const FetchRequest& request, const Source& source, const WantedFile& wanted,
                    const Record& record, const Observer& observer) {
  FetchedFile file;
  file.source = source.name;
  file.url = wanted.url;
  file.path = request.folder / wanted.file;
  std::error_code error;
  if (request.is_overwriting || !fs::exists(file.path, error)) {
    return file;
  }
  file.bytes = static_cast<std::int64_t>(fs::file_size(file.path, error));
  if (error) {
    throw DataError(file.path.string() + " is no file: " + error.message(), "move it away");
  }
  file.sha256 = sha256_hex_of_file(file.path.string(), [&] { observer.check_stop(); });
  const std::string known = known_sha256(source, wanted.file);
  const auto recorded = record.find(wanted.file);
  const bool is_recorded = recorded != record.end() && !recorded->second.was_brought;
  if (!known.empty() && known != file.sha256) {
    throw DataError(file.path.string() + " is not the file that the configuration knows (SHA-256)",
                    "--overwrite fetches it again");
  }
  if (is_recorded && recorded->second.sha256 != file.sha256) {
    throw DataError(file.path.string() + " has changed since it was fetched (SHA-256)",
                    "--overwrite fetches it again; a file of your own needs another name");
  }
  file.state = is_recorded ? FileState::kKept : FileState::kBrought;
  if (is_recorded) {
    file.last_modified = recorded->second.last_modified;
    file.url = recorded->second.url;
  }
  return file;
}

}  // namespace

const char* name_of(FileState state) {
  switch (state) {
    case FileState::kFetched:
      return "fetched";
    case FileState::kKept:
      return "kept";
    case FileState::kBrought:
      return "brought";
    case FileState::kAbsent:
      return "absent";
    case FileState::kMissing:
      return "missing";
  }
  return "missing";
}

bool FetchReport::is_complete() const {
  return std::none_of(files.begin(), files.end(),
                      [](const FetchedFile& file) { return file.state == FileState::kMissing; });
}

FetchReport look(const FetchRequest& request, const FetchOptions& options) {
  const Record record = read_record(request.folder);
  const SilentObserver observer;
  FetchReport report;
  for (const Source& source : request.sources) {
    for (const WantedFile& wanted :
         wanted_files(source, request.box,
                      source.kind == SourceKind::kTerrain ? options.terrain_margin_m : 0.0)) {
      report.files.push_back(look_at(request, source, wanted, record, observer));
    }
  }
  return report;
}

FetchReport fetch(const FetchRequest& request, const FetchOptions& options, Observer& observer) {
  std::error_code error;
  if (!fs::is_directory(request.folder, error) && !fs::create_directory(request.folder, error)) {
    throw UsageError("the folder " + request.folder.string() + " cannot be made: " +
                         (error ? error.message() : "something else has that name"),
                     "create the folder above it first, or choose another --out");
  }
  const Record record = read_record(request.folder);
  const fs::path record_file = request.folder / kFetchFile;
  const std::string earlier = fs::exists(record_file, error) ? read_file(record_file) : "";
  Downloader downloader(options.politeness, observer);
  FetchReport report;
  for (const Source& source : request.sources) {
    for (const WantedFile& wanted :
         wanted_files(source, request.box,
                      source.kind == SourceKind::kTerrain ? options.terrain_margin_m : 0.0)) {
      report.files.push_back(look_at(request, source, wanted, record, observer));
      FetchedFile& file = report.files.back();
      if (file.state != FileState::kMissing) {
        continue;
      }
      const Delivery delivery = downloader.download(
          {wanted.url, file.path, source.bytes_max, source.absent_statuses, source.checksum,
           wanted.checksum_url, known_sha256(source, wanted.file)});
      file.trouble = delivery.trouble;
      file.last_modified = delivery.last_modified;
      if (delivery.result == Delivery::Result::kAbsent) {
        file.state = FileState::kAbsent;
      } else if (delivery.result == Delivery::Result::kWhole) {
        file.state = FileState::kFetched;
        file.bytes = static_cast<std::int64_t>(fs::file_size(file.path, error));
        file.sha256 = sha256_hex_of_file(file.path.string());
      }
      write_record(request, report.files, earlier);  // what has come is never without its source
    }
  }
  write_record(request, report.files, earlier);
  return report;
}

}  // namespace hedgehop::fetch
